//! Measures of quality, and how the verdict follows from them.

use medialrep::cancel::Never;
use medialrep::formats::write::thickness::{self, InputFacts, OuterTimings};
use medialrep::model::LatticeSize;
use medialrep::model::{
    Coverage, DistanceSummary, Distortion, Figure, FigureQuality, LengthSummary, Model, Repair, Sheet,
    StructureQuality, Verdict,
};
use medialrep::params::Params;
use medialrep::pipeline::draft::{AnyDraft, Draft};
use medialrep::pipeline::quality::measures::FlatQuads;
use medialrep::pipeline::quality::verdict::{Places, judge};
use medialrep::pipeline::quality::{Answered, figure_quality, quality};
use medialrep::pipeline::solid::changes::Changes;
use medialrep::pipeline::vectors::Nodes;
use nalgebra::{Point2, Point3, Rotation3, Vector3};
use serde_json::Value;

use crate::help::models::{drafted, flat_slab, model};
use crate::help::phantoms::{context, deepened, defaults, model_of, painted, params, sample, sent, volume};

const SIZE: LatticeSize = LatticeSize { rows: 4, cols: 5 };

fn figure_of(nodes: Nodes) -> Sheet {
    Sheet {
        grid: nodes.size,
        medial: nodes.medial,
        upper: nodes.upper,
        lower: nodes.lower,
        crest: nodes.crest,
        flanks: nodes.flanks,
        valid: nodes.valid,
        ..Sheet::default()
    }
}

/// Three rows, the second 1 and the third 9 from the first; vectors 1 and 3 long on the first
/// row, 2 and 3 on the second, 4 and 3 on the third.
fn uneven() -> Sheet {
    let size = LatticeSize { rows: 3, cols: 3 };
    let mut figure = figure_of(flat_slab(size));
    for n in 0..9 {
        let row = n / 3;
        let at = Point3::new([0.0, 1.0, 9.0][row], figure.medial[n].y, 0.0);
        figure.medial[n] = at;
        figure.upper[n] = at + Vector3::z() * [1.0, 2.0, 4.0][row];
        figure.lower[n] = at - Vector3::z() * 3.0;
    }
    figure
}

fn mean(summary: Option<LengthSummary>) -> f64 {
    summary.expect("an area").mean
}

#[test]
fn thickness_is_weighted_by_area_not_by_nodes() {
    let figure = uneven();
    let areas = figure.node_areas_mm2();
    assert_eq!(areas.iter().sum::<f64>(), 9.0 * 6.0);
    // Half a step on each side of a row: 0.5, 4.5 and 4.
    let expected = (0.5 * 1.0 + 4.5 * 2.0 + 4.0 * 4.0) / 9.0;
    let summary = figure.thickness_summary();
    assert_eq!(summary.area_mm2, 54.0);
    assert!((mean(summary.upper_mm) - expected).abs() < 1e-12);
    assert!((mean(summary.lower_mm) - 3.0).abs() < 1e-12 && summary.lower_mm.expect("an area").sd < 1e-6);
    assert!((mean(summary.total_mm) - expected - 3.0).abs() < 1e-12);
    let upper = summary.upper_mm.expect("an area");
    assert_eq!([upper.p5, upper.p50, upper.p95], [1.0, 2.0, 4.0]);
    let sd = ((0.5 * (1.0 - expected).powi(2) + 4.5 * (2.0 - expected).powi(2) + 4.0 * (4.0 - expected).powi(2)) / 9.0)
        .sqrt();
    assert!((upper.sd - sd).abs() < 1e-12);
}

#[test]
fn a_structure_weighs_its_figures_by_area_and_leaves_invalid_nodes_out() {
    let mut structure = model().structures.remove(0);
    structure.figures = [uneven(), figure_of(flat_slab(SIZE))].map(Figure::Sheet).to_vec();
    let [a, b] = [0, 1].map(|f: usize| structure.sheets().nth(f).expect("a sheet").thickness_summary());
    assert_eq!((a.area_mm2, b.area_mm2), (54.0, 72.0));
    let expected = (54.0 * mean(a.upper_mm) + 72.0 * 1.5) / 126.0;
    assert!((mean(structure.thickness_summary().upper_mm) - expected).abs() < 1e-12);
    // A corner taken out takes its quad along.
    structure.figures.truncate(1);
    let Figure::Sheet(sheet) = &mut structure.figures[0] else { panic!("a sheet") };
    sheet.valid[0] = false;
    assert_eq!(structure.thickness_summary().area_mm2, 54.0 - 3.0);
    structure.figures.clear();
    assert_eq!(structure.thickness_summary().upper_mm, None);
}

#[test]
fn a_plane_that_is_the_sheet_has_no_distortion() {
    let nodes = flat_slab(SIZE);
    let none = |found: Distortion| {
        found.area_sd < 1e-6 && found.area_max_log < 1e-9 && found.angle_max_deg < 1e-5 && found.angle_mean_deg < 1e-5
    };
    assert!(none(FlatQuads::from(&nodes).distortion()));
    let scaled: Vec<_> = nodes.intrinsic.medial.iter().map(|p| p * 3.0).collect();
    assert!(none(FlatQuads::of((&nodes).into(), &scaled).distortion()), "scale is no distortion");
}

#[test]
fn distortion_of_a_plane_is_measured() {
    let nodes = flat_slab(LatticeSize { rows: 3, cols: 3 });
    let sheared: Vec<_> = nodes.intrinsic.medial.iter().map(|p| Point2::new(p.x + p.y, p.y)).collect();
    let found = FlatQuads::of((&nodes).into(), &sheared).distortion();
    assert!((found.angle_mean_deg - 45.0).abs() < 1e-9 && (found.angle_max_deg - 45.0).abs() < 1e-9);
    assert!(found.area_sd < 1e-6);
    // One half three times as long in the plane: its share is 3/4, in space it is 1/2.
    let stretched: Vec<_> = nodes.intrinsic.medial.iter().map(|p| Point2::new(p.x.max(3.0 * p.x - 6.0), p.y)).collect();
    let found = FlatQuads::of((&nodes).into(), &stretched).distortion();
    assert!((found.area_max_log - 2.0f64.ln()).abs() < 1e-9, "the ratio is 2 on the shorter half");
    let sd = (0.25f64 * 1.0 + 0.75 * (1.0f64 / 3.0).powi(2)).sqrt();
    assert!((found.area_sd - sd).abs() < 1e-9 && found.angle_max_deg < 1e-5);
}

#[track_caller]
fn check_logs(found: &[Option<f64>], expected: &[Option<f64>]) {
    assert_eq!(found.len(), expected.len());
    for (node, pair) in found.iter().zip(expected).enumerate() {
        match pair {
            (Some(found), Some(expected)) => assert!((found - expected).abs() < 1e-9, "node {node}: {found}"),
            (found, expected) => assert_eq!(found, expected, "node {node}"),
        }
    }
}

#[test]
fn an_even_sheet_has_no_area_distortion_at_any_node() {
    let mut nodes = flat_slab(SIZE);
    check_logs(&FlatQuads::from(&nodes).log_ratio_per_node(), &[Some(0.0); 20]);
    // A corner taken out takes its quad along, and has none any more; its neighbours have others.
    nodes.valid[0] = false;
    let mut expected = [Some(0.0); 20];
    expected[0] = None;
    check_logs(&FlatQuads::from(&nodes).log_ratio_per_node(), &expected);
}

#[test]
fn a_sheet_stretched_on_one_half_has_the_logarithms_of_its_shares() {
    let nodes = flat_slab(LatticeSize { rows: 3, cols: 3 });
    // One half three times as long in the plane: shares 1/4 and 3/4, in space 1/2 each. The nodes
    // between have both halves round them.
    let plane: Vec<_> = nodes.intrinsic.medial.iter().map(|p| Point2::new(p.x.max(3.0 * p.x - 6.0), p.y)).collect();
    let row = [2.0f64.ln(), 0.0, (2.0f64 / 3.0).ln()].map(Some);
    let quads = FlatQuads::of((&nodes).into(), &plane);
    check_logs(&quads.log_ratio_per_node(), &[row, row, row].concat());
    // At the corners there is one quad: the largest of its logarithms is that of the summary.
    assert!((quads.distortion().area_max_log - 2.0f64.ln()).abs() < 1e-9);
}

/// A box of 24 × 30 × 12 voxels and a slab of nodes in it, of which some are moved.
pub fn boxed(change: impl FnOnce(&mut Nodes)) -> (StructureQuality, FigureQuality) {
    let inside = |[i, j, k]: [usize; 3]| (4..28).contains(&i) && (4..34).contains(&j) && (4..16).contains(&k);
    let volume = painted([32, 38, 20], [1.0; 3], |at| u16::from(inside(at)));
    let (params, (solid, depth)) = (defaults(), deepened(&volume));
    let sent = sent(&volume, &context(&params));
    let middle = depth.skin.iter().map(|s| s.position.coords).sum::<Vector3<f64>>() / depth.skin.len() as f64;
    let mut nodes = flat_slab(SIZE);
    let here = nodes.medial.iter().map(|p| p.coords).sum::<Vector3<f64>>() / nodes.medial.len() as f64;
    for list in [&mut nodes.medial, &mut nodes.upper, &mut nodes.lower, &mut nodes.crest] {
        for p in list {
            let from = p.coords - here;
            *p = Point3::from(middle + Vector3::new(from.x * 11.0 / 4.0, from.y * 14.0 / 7.0, from.z * 4.0));
        }
    }
    change(&mut nodes);
    nodes.straighten_arcs();
    let (changes, draft) = (Changes::default(), drafted(nodes));
    let answered = Answered {
        part: 0,
        solid: &solid,
        skin: &depth.skin,
        changes: &changes,
        drafts: vec![AnyDraft::Sheet(&draft)],
        skins: vec![&depth.skin],
        pruned: 0,
    };
    let mut measured = quality(&sent, &[answered], &context(&params)).unwrap();
    (measured.structure, measured.figures.remove(0))
}

#[test]
fn nodes_off_the_middle_are_measured_by_the_nearest_skin() {
    let centred = boxed(|_| ()).1.medial_offset;
    assert!(centred.p95 < 0.02, "{centred:?}");
    // 2 of 6 off the middle: |8 − 4| / 12.
    let shifted = boxed(|nodes| nodes.medial.iter_mut().for_each(|p| p.z += 2.0)).1.medial_offset;
    assert!((shifted.mean - 1.0 / 3.0).abs() < 0.05, "{shifted:?}");
}

#[test]
fn a_single_figure_fits_as_the_structure_does() {
    let (quality, figure) = boxed(|_| ());
    assert_eq!(quality.coverage, figure.coverage);
    assert!(quality.coverage.dice > 0.8, "{:?}", quality.coverage);
    assert!(quality.coverage.mask_to_model.max_mm >= quality.coverage.mask_to_model.mean_mm);
}

#[test]
fn each_sheet_of_a_tee_is_measured_against_its_share_of_the_mask() {
    let model = model_of(&volume("tee"), params());
    let structure = &model.structures[0];
    assert_eq!(structure.figures.len(), 3);
    for figure in structure.sheets() {
        let Coverage { dice, covered_share, .. } = figure.quality.coverage;
        assert!(dice > 0.6 && dice <= 1.0 && covered_share > 0.4, "{:?}", figure.quality.coverage);
    }
    check_reproducible(&written(&model)["structures"][0]["quality"]);
}

#[test]
fn an_unrepaired_figure_had_its_folds_before() {
    let mut nodes = flat_slab(SIZE);
    nodes.upper[8].z = -1.0;
    let draft = drafted(nodes);
    let quality = figure_quality(&draft, &Never).unwrap().0;
    assert_eq!(quality.repair, Repair { folds_before: quality.folds, ..Repair::default() });
    let repair = Repair { folds_before: 40, moved_nodes: 3, shortened_nodes: 1, ..Repair::default() };
    let repaired = Draft { repair, ..draft };
    assert_eq!(figure_quality(&repaired, &Never).unwrap().0.repair, repair);
}

fn written(model: &Model) -> Value {
    let mut bytes = Vec::new();
    let input = InputFacts { sha256: String::new(), format: "nifti1".to_owned() };
    thickness::write(model, &input, &[], OuterTimings::default(), &mut bytes).unwrap();
    serde_json::from_slice(&bytes).unwrap()
}

/// The verdict and the codes of the reasons again, from the thresholds alone.
fn check_reproducible(quality: &Value) {
    let mut reasons = Vec::new();
    let mut worst = "pass";
    for (code, measure) in quality["thresholds"].as_object().unwrap() {
        let is_beyond = |limit: &Value| match (measure["value"].as_f64(), limit.as_f64()) {
            (_, None) => false,
            (None, Some(_)) => true,
            (Some(value), Some(limit)) if measure["bad"] == "below" => value < limit,
            (Some(value), Some(limit)) => value > limit,
        };
        let verdict = [("fail", "fail"), ("warn", "warn")].into_iter().find(|(name, _)| is_beyond(&measure[*name]));
        if let Some((verdict, limit)) = verdict {
            worst = if worst == "fail" { "fail" } else { verdict };
            reasons.push((code.as_str(), measure[limit].clone()));
        }
    }
    assert_eq!(quality["verdict"], worst, "{quality:#}");
    let given: Vec<_> = quality["reasons"]
        .as_array()
        .unwrap()
        .iter()
        .map(|r| (r["code"].as_str().unwrap(), r["threshold"].clone()))
        .collect();
    assert_eq!(given, reasons);
}

/// A judged quality that is good but for what `change` does.
fn judged(change: impl FnOnce(&mut StructureQuality)) -> StructureQuality {
    let coverage = Coverage { dice: 0.97, covered_share: 0.95, ..Coverage::default() };
    let mut quality = StructureQuality { coverage, ..StructureQuality::default() };
    change(&mut quality);
    judge(&mut quality, &[FigureQuality { valid_share: 1.0, ..FigureQuality::default() }], 1.0, &Places::default());
    quality
}

#[test]
fn the_thresholds_reproduce_the_verdict() {
    let mut model = model();
    type Change = fn(&mut StructureQuality);
    let cases: [(Verdict, Change); 12] = [
        (Verdict::Pass, |_| ()),
        (Verdict::Fail, |q| q.folds = 1),
        (Verdict::Fail, |q| q.folded_centres = 1),
        (Verdict::Fail, |q| q.folded_wedges = 1),
        (Verdict::Warn, |q| q.self_intersections = Some(2)),
        (Verdict::Warn, |q| q.coverage.dice = 0.8),
        (Verdict::Fail, |q| q.coverage.dice = 0.5),
        (Verdict::Warn, |q| q.medial_offset.p95 = 0.2),
        (Verdict::Fail, |q| q.residual_variance = f64::INFINITY),
        (Verdict::Pass, |q| q.turned_over = Some(0.02)),
        (Verdict::Fail, |q| q.turned_over = Some(0.021)),
        (Verdict::Fail, |q| q.spacing_variation = f64::NAN),
    ];
    for (verdict, change) in cases {
        let quality = judged(change);
        assert_eq!(quality.verdict, verdict, "{:?}", quality.reasons);
        assert_eq!(quality.reasons.is_empty(), verdict == Verdict::Pass);
        model.structures[0].quality = quality;
        check_reproducible(&written(&model)["structures"][0]["quality"]);
    }
}

#[test]
fn a_failure_is_told_by_what_fails() {
    let code_of = |change: fn(&mut StructureQuality)| judged(change).deciding_reason().map(|r| r.code.to_string());
    assert_eq!(code_of(|_| ()), None);
    assert_eq!(code_of(|q| q.coverage.dice = 0.8).as_deref(), Some("dice"));
    let warned_of_first = code_of(|q| (q.coverage.dice, q.spacing_variation) = (0.8, 0.5));
    assert_eq!(warned_of_first.as_deref(), Some("spacing_variation"));
}

#[test]
fn a_count_is_told_as_a_count() {
    let quality = judged(|q| q.folded_wedges = 3);
    let message = "the crest is turned over: the number of its wedges is 3, none is allowed";
    assert_eq!(quality.reasons[0].message, message);
}

#[test]
fn nodes_spoilt_are_a_warning_from_a_hundredth_and_a_failure_from_a_twentieth() {
    let of = |marred_nodes: usize| judged(|q| q.repair = Repair { nodes: 100, marred_nodes, ..Repair::default() });
    assert_eq!([0, 1, 2, 5].map(|n| of(n).verdict), [Verdict::Pass, Verdict::Pass, Verdict::Warn, Verdict::Warn]);
    let quality = of(6);
    assert_eq!((quality.verdict, quality.reasons[0].code.as_ref()), (Verdict::Fail, "repaired_share"));
}

#[test]
fn thick_objects_are_judged_by_tenths_of_their_radius() {
    let judged = |grain_mm: f64| {
        let mask_to_model = DistanceSummary { p95_mm: 6.0, ..DistanceSummary::default() };
        let coverage = Coverage { dice: 0.97, covered_share: 0.95, grain_mm, mask_to_model, ..Coverage::default() };
        let mut quality = StructureQuality { coverage, ..StructureQuality::default() };
        judge(&mut quality, &[], 1.0, &Places::default());
        quality.verdict
    };
    assert_eq!([judged(1.0), judged(2.0)], [Verdict::Warn, Verdict::Pass]);
    let fine = sample("slab").voxelise([0.35; 3], Rotation3::identity()).expect("fits in memory");
    let quality = model_of(&fine, Params::default()).structures.remove(0).quality;
    // The slab is 8 mm thick: its median radius is near 4 mm.
    assert!((0.35..0.41).contains(&quality.coverage.grain_mm), "{}", quality.coverage.grain_mm);
    assert_ne!(quality.verdict, Verdict::Fail);
}
