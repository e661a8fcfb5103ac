//! What becomes of every voxel of a label: parts, losses, gaps and hollows, none of them in silence.

use medialrep::model::{LatticeSize, Structure, Verdict};
use medialrep::params::Params;
use medialrep::pipeline::PipelineError;
use medialrep::space::LabelVolume;

use crate::help::phantoms::{check_invariants, model_of, painted, params, run_of, sheets};
use crate::measure::damage::{rows, to_markdown};

type Voxel = [usize; 3];

fn structure_of(dims: Voxel, is_inside: impl Fn(Voxel) -> bool) -> Structure {
    let model = model_of(&mask(dims, is_inside), params());
    check_invariants(&model);
    model.structures.into_iter().next().expect("a structure")
}

fn mask(dims: Voxel, is_inside: impl Fn(Voxel) -> bool) -> LabelVolume {
    painted(dims, [1.0; 3], |at| u16::from(is_inside(at)))
}

fn in_box([i, j, k]: Voxel, low: Voxel, high: Voxel) -> bool {
    (low[0]..high[0]).contains(&i) && (low[1]..high[1]).contains(&j) && (low[2]..high[2]).contains(&k)
}

/// Distance from a place.
fn from_place(at: Voxel, place: [f64; 3]) -> f64 {
    (0..3).map(|axis| (at[axis] as f64 - place[axis]).powi(2)).sum::<f64>().sqrt()
}

fn has_warning(structure: &Structure, code: &str) -> bool {
    structure.warnings.iter().any(|warning| warning.code == code)
}

fn mean_mm(structure: &Structure) -> f64 {
    structure.thickness_summary().total_mm.expect("an area").mean
}

/// Two elliptic plates of 9 voxels with round rims, side by side.
fn in_pair(at: Voxel) -> bool {
    [(31.0, 25.0, 16.0), (92.0, 24.0, 15.0)].iter().any(|&(x, long, wide)| {
        let (x, y, z) = (at[0] as f64 - x, at[1] as f64 - 22.0, at[2] as f64 - 11.0);
        let out = (x / (long - 4.5)).hypot(y / (wide - 4.5)).max(1.0);
        from_place([0; 3], [x - x / out, y - y / out, z]) <= 4.5
    })
}

#[test]
fn a_pair_of_organs_in_one_label_has_figures_for_both() {
    let pair = structure_of([124, 45, 23], in_pair);
    assert_eq!((pair.components(), pair.figures.len(), pair.parts.len()), (2, 2, 2));
    assert!(has_warning(&pair, "several_parts"));
    assert_eq!(pair.quality.kept.kept, 1.0);
    assert_eq!(pair.parts.iter().map(|part| part.voxels).sum::<u64>(), pair.voxels);
    for (number, part) in pair.parts.iter().enumerate() {
        assert_eq!(part.figures, [number]);
        assert!(part.coverage.dice > 0.9 && part.kept_share == 1.0, "{part:?}");
        let alone = structure_of([124, 45, 23], |at| in_pair(at) && (at[0] < 60) == (number == 0));
        let [own, alone] =
            [pair.part_thickness(number), alone.thickness_summary()].map(|s| s.total_mm.expect("an area"));
        assert!((own.mean - alone.mean).abs() < 1e-9, "{} {}", own.mean, alone.mean);
    }
    assert!(pair.quality.coverage.dice > 0.9 && pair.quality.coverage.far_share < 0.1, "{:?}", pair.quality.coverage);
}

#[test]
fn the_uncertainty_of_a_pair_is_that_of_each() {
    let model = model_of(&mask([124, 45, 23], in_pair), Params { uncertainty: 3, ..params() });
    for sheet in model.structures[0].sheets() {
        assert_eq!(sheet.uncertainty.as_ref().map(|u| u.matched), Some(3));
        assert_eq!(sheet.grid, LatticeSize { rows: 12, cols: 20 });
    }
}

#[test]
fn a_part_that_is_refused_is_named_and_counts() {
    let ball = |at| from_place(at, [68.0, 20.0, 11.0]) <= 9.0;
    let both = mask([90, 56, 24], |at| in_box(at, [6; 3], [46, 36, 15]) || ball(at));
    let both = model_of(&both, sheets()).structures.remove(0);
    assert_eq!((both.components(), both.figures.len()), (1, 1));
    assert!(both.refusal.is_none() && has_warning(&both, "part_refused"));
    assert_eq!(both.parts[1].refusal.as_ref().map(|refusal| refusal.code()), Some("shape_is_a_ball"));
    let kept = both.quality.kept;
    assert!((kept.kept + kept.refused - 1.0).abs() < 1e-12 && kept.kept < 0.8, "{kept:?}");
    assert!(both.quality.reasons.iter().any(|reason| reason.code == "kept_share" && reason.place.is_some()));
}

#[test]
fn a_small_part_is_dropped_and_counts() {
    let speck = |at| in_box(at, [52, 10, 8], [56, 16, 12]);
    let structure = structure_of([62, 42, 22], |at| in_box(at, [6; 3], [46, 36, 15]) || speck(at));
    assert_eq!(structure.parts.len(), 1);
    assert!(has_warning(&structure, "stray_voxels_dropped"));
    let share = 96.0 / (96.0 + 40.0 * 30.0 * 9.0);
    assert!((structure.quality.kept.dropped - share).abs() < 1e-12);
    assert!((structure.quality.kept.kept - (1.0 - share)).abs() < 1e-12);
}

#[test]
fn a_part_that_hangs_on_by_a_corner_is_a_part_by_itself() {
    let hung = |at| in_box(at, [6; 3], [40, 34, 14]) || in_box(at, [40, 34, 14], [52, 46, 20]);
    let structure = structure_of([70, 56, 24], hung);
    assert_eq!(structure.parts.iter().map(|part| part.voxels).collect::<Vec<_>>(), [7616, 864]);
    assert!(structure.figures.iter().any(|figure| figure.part() == 1), "{:?}", structure.warnings);
    assert_eq!(structure.quality.kept.lost, 0.0);
}

#[test]
fn a_fin_of_one_voxel_is_not_lost_in_silence() {
    let finned = |at| in_box(at, [6; 3], [46, 36, 15]) || in_box(at, [20, 36, 10], [34, 50, 11]);
    let structure = structure_of([52, 56, 22], finned);
    assert!(has_warning(&structure, "thin_voxels_lost"));
    let lost = structure.quality.kept.lost * structure.voxels as f64;
    assert!((150.0..=196.0).contains(&lost), "{lost} of 196");
    assert_eq!(structure.quality.verdict, Verdict::Warn);
    let reason = structure.quality.reasons.iter().find(|reason| reason.code == "thin_share").expect("that reason");
    let at = reason.place.expect("a place").position;
    assert!((20.0..34.0).contains(&at.x) && (36.0..50.0).contains(&at.y) && at.z == 10.0, "{at}");
}

#[test]
fn a_gap_of_one_voxel_is_not_closed_in_silence() {
    // A ribbon of 5 voxels folded on itself.
    let folded = |at: Voxel| {
        let (x, y, z) = (at[0] as f64 - 38.3, at[1] as f64 - 20.2, at[2] as f64 - 14.4);
        let banks = (z.abs() - 3.0).abs() <= 2.5 && (-30.0..=0.0).contains(&x);
        let turn = (x.hypot(z) - 3.0).abs() <= 2.5 && x >= 0.0;
        (banks || turn) && y.abs() <= 16.0
    };
    let structure = structure_of([80, 42, 30], folded);
    assert!(has_warning(&structure, "gaps_closed"), "{:?}", structure.warnings);
    assert_eq!(structure.quality.verdict, Verdict::Fail);
    assert!(structure.quality.reasons.iter().any(|reason| reason.code == "closed_share"));
}

#[test]
fn what_hangs_on_by_a_thin_neck_is_a_part_by_itself() {
    let with_neck_of = |radius: f64| {
        let volume = mask([96, 40, 40], |at| {
            let neck = (20..76).contains(&at[0]) && (at[1] as f64 - 20.0).hypot(at[2] as f64 - 20.0) <= radius;
            neck || from_place(at, [20.0; 3]) <= 14.0 || from_place(at, [76.0, 20.0, 20.0]) <= 10.0
        });
        let model = run_of(&volume, Params::default()).expect("balls have figures");
        check_invariants(&model);
        model.structures.into_iter().next().expect("a structure")
    };
    let thin = with_neck_of(0.0);
    assert_eq!(thin.parts.len(), 2, "{:?}", thin.warnings);
    assert!(thin.quality.kept.kept > 0.99 && thin.quality.coverage.dice > 0.96, "{:?}", thin.quality.kept);
    let thick = with_neck_of(4.0);
    assert_eq!(thick.parts.len(), 1, "{:?}", thick.warnings);
}

#[test]
fn of_a_hollow_object_the_wall_is_measured() {
    let ellipsoid = |at: Voxel, less: f64| {
        let axes = [40.0, 28.0, 14.0].map(|axis: f64| axis - less);
        (0..3).map(|a| ((at[a] as f64 - [43.0, 31.0, 17.0][a]) / axes[a]).powi(2)).sum::<f64>() <= 1.0
    };
    let ball = |at, inner| (inner..30.0).contains(&from_place(at, [34.0; 3]));
    let hollow = [
        (4.0, mask([87, 63, 35], |at| ellipsoid(at, 0.0) && !ellipsoid(at, 4.0))),
        (5.0, mask([69; 3], |at| ball(at, 25.0))),
        (16.0, mask([69; 3], |at| ball(at, 14.0))),
    ];
    for (wall_mm, volume) in hollow {
        let model = run_of(&volume, Params::default()).expect("the wall is measured");
        let structure = &model.structures[0];
        check_invariants(&model);
        assert!(has_warning(structure, "lumen_left_out"), "{:?}", structure.warnings);
        assert_eq!(structure.figures.len(), 2, "two halves");
        assert!(structure.quality.coverage.dice > 0.96, "{}", structure.quality.coverage.dice);
        let thickness = structure.thickness_summary().total_mm.expect("it has an area");
        assert!((thickness.p50 - wall_mm).abs() < 0.1 * wall_mm, "{wall_mm}: {thickness:?}");
    }
}

#[test]
fn what_is_riddled_with_holes_is_refused_by_name() {
    let riddled = mask([66, 56, 30], |at| in_box(at, [3; 3], [63, 53, 27]) && !at.iter().all(|x| x % 9 > 4));
    match run_of(&riddled, params()) {
        Err(PipelineError::Refused(refusal)) => {
            assert_eq!(refusal.code(), "hollow_object", "{refusal}");
            assert!(refusal.hint().contains("filled"));
        }
        other => panic!("expected a refusal, got {:?}", other.map(|model| model.structures.len())),
    }
}

#[test]
fn a_small_cavity_is_filled_and_counts() {
    let holed = |at| in_box(at, [6; 3], [46, 36, 15]) && !in_box(at, [20, 20, 9], [26, 26, 12]);
    let plain = structure_of([52, 42, 22], |at| in_box(at, [6; 3], [46, 36, 15]));
    let structure = structure_of([52, 42, 22], holed);
    assert!(has_warning(&structure, "cavities_filled"));
    assert!((structure.quality.kept.filled - 108.0 / structure.voxels as f64).abs() < 1e-12);
    assert!(structure.quality.coverage.dice < plain.quality.coverage.dice, "the hole is not of the label");
    assert!((mean_mm(&structure) - mean_mm(&plain)).abs() < 1e-9);
}

#[test]
fn what_passes_is_right_within_three_percent() {
    let rows = rows();
    for row in &rows {
        let Ok(said) = &row.outcome else { continue };
        let most = match said.verdict {
            Verdict::Pass => 0.03,
            Verdict::Warn => 0.3,
            Verdict::Fail => f64::INFINITY,
        };
        assert!(row.mean_error.abs() <= most, "{:?} {}:\n{}", row.fault, row.amount, to_markdown(&rows));
    }
}
