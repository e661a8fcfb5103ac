//! What the pipeline makes of masks that are not as they should be, and of each parameter.

use std::sync::atomic::{AtomicUsize, Ordering};

use medialrep::cancel::{Cancel, Cancelled};
use medialrep::model::LatticeSize;
use medialrep::model::{Stage, Structure};
use medialrep::params::{GridChoice, Landmarks, LatticeKind, Neighbors, Params, ParamsError, Prune};
use medialrep::pipeline::observer::Observer;
use medialrep::pipeline::{PipelineError, run};
use medialrep::space::{Grid, Label, LabelVolume};

use crate::help::phantoms::{check_invariants, drift, first_sheet, model_of, painted, params, run_of, sheets, volume};

fn check_refused(volume: &medialrep::space::LabelVolume, params: Params, code: &str) {
    match run_of(volume, params) {
        Err(PipelineError::Refused(refusal)) => {
            assert_eq!(refusal.code(), code, "{refusal}");
            assert!(!refusal.hint().is_empty());
        }
        other => panic!("expected {code}, got {:?}", other.map(|m| m.structures.len())),
    }
}

#[test]
fn a_ball_has_no_sheet() {
    check_refused(&volume("ball"), sheets(), "shape_is_a_ball");
}

#[test]
fn a_tube_has_no_sheet() {
    check_refused(&volume("tube"), sheets(), "shape_is_a_tube");
}

#[test]
fn a_moebius_band_is_not_orientable() {
    check_refused(&volume("mobius"), params(), "not_orientable");
}

#[test]
fn a_mask_thinner_than_two_voxels_names_a_resolution() {
    check_refused(&volume("thin"), params(), "too_thin");
}

#[test]
fn a_speck_is_a_ball() {
    let speck = painted([12, 12, 12], [1.0; 3], |at| u16::from(at.iter().all(|x| (4..8).contains(x))));
    check_refused(&speck, sheets(), "shape_is_a_ball");
}

#[test]
fn the_hint_for_a_thin_object_of_micro_ct_can_be_followed() {
    for edge_mm in [1e-4, 0.002_456, 0.3] {
        let plate = painted([40, 30, 8], [edge_mm; 3], |[i, j, k]| {
            u16::from((3..37).contains(&i) && (3..27).contains(&j) && k == 3)
        });
        let refusal = match run_of(&plate, params()) {
            Err(PipelineError::Refused(refusal)) => refusal,
            other => panic!("{edge_mm} mm: {:?}", other.map(|m| m.structures.len())),
        };
        let resolution_mm: f64 = refusal.hint().rsplit(' ').next().unwrap().parse().unwrap();
        assert!(resolution_mm < edge_mm && !refusal.to_string().contains(" 0.00 "), "{refusal}");
        assert_eq!(field_of(Params { resolution_mm: Some(resolution_mm), ..Params::default() }), None);
    }
}

/// A box of 40 × 30 × 20 voxels with a slab inside of it, as labels outside and inside.
fn framed(outside: i64, inside: i64) -> medialrep::space::LabelVolume {
    let label_at = |[i, j, k]: [usize; 3]| {
        let is_inside = (6..34).contains(&i) && (5..25).contains(&j) && (6..13).contains(&k);
        if is_inside { inside } else { outside }
    };
    medialrep::space::LabelVolume::from_fn([40, 30, 20], [1.0; 3], label_at).expect("a box")
}

#[test]
fn a_background_that_is_not_zero_is_refused_by_name() {
    for (outside, inside) in [(1, 0), (255, 0), (-1, 0), (1, 1)] {
        check_refused(&framed(outside, inside), params(), "label_is_background");
    }
    for (outside, inside) in [(-1, 4), (255, 4)] {
        let model = model_of(&framed(outside, inside), params());
        for structure in &model.structures {
            let code = structure.refusal.as_ref().map(medialrep::model::Refusal::code);
            assert_eq!(code, (structure.label == outside).then_some("label_is_background"));
        }
    }
}

#[test]
fn a_mask_cropped_to_its_object_is_none() {
    let cropped = painted([40, 28, 9], [1.0; 3], |[i, j, k]| {
        let [x, y, z] = [(i as f64 - 19.5) / 20.0, (j as f64 - 13.5) / 14.0, (k as f64 - 4.0) / 4.5];
        u16::from(x * x + y * y + z * z <= 1.0)
    });
    assert_eq!(model_of(&cropped, params()).structures.len(), 1);
}

#[test]
fn an_image_of_intensities_is_refused_by_name() {
    // A slope with noise: some 300 greys.
    let grey = |[i, j, k]: [usize; 3]| (4 * (i + j) + (i * 7 + j * 13 + k * 29) % 23) as i64;
    let image = medialrep::space::LabelVolume::from_fn([40, 30, 12], [1.0; 3], grey).expect("a box");
    assert!(image.labels().len() > 200);
    check_refused(&image, params(), "intensity_image");
    // As many labels, each of a block, are a label map: what is refused is their shape.
    let block = |[i, j, k]: [usize; 3]| (1 + i / 4 + 10 * (j / 4) + 80 * (k / 4)) as i64;
    let atlas = medialrep::space::LabelVolume::from_fn([40, 32, 12], [1.0; 3], block).expect("a box");
    check_refused(&atlas, sheets(), "shape_is_a_ball");
}

#[test]
fn an_empty_mask_is_refused() {
    check_refused(&painted([5, 6, 7], [1.0; 3], |_| 0), params(), "empty_mask");
}

#[test]
fn a_label_that_is_not_there_is_refused_with_those_that_are() {
    check_refused(&volume("slab"), Params { labels: Some(vec![7]), ..params() }, "label_missing");
}

#[test]
fn one_refused_structure_does_not_spoil_the_others() {
    let slab = |[i, j, k]: [usize; 3]| (5..45).contains(&i) && (5..30).contains(&j) && (5..13).contains(&k);
    let ball = |at: [usize; 3]| {
        let d = [at[0] as f64 - 25.0, at[1] as f64 - 45.0, at[2] as f64 - 15.0];
        d.iter().map(|x| x * x).sum::<f64>() <= 100.0
    };
    let both = painted([50, 60, 30], [1.0; 3], |at| if slab(at) { 1 } else { 2 * u16::from(ball(at)) });
    let model = model_of(&both, sheets());
    check_invariants(&model);
    assert!(model.structures[0].refusal.is_none() && model.structures[0].figures.len() == 1);
    assert_eq!(model.structures[1].refusal.as_ref().map(|r| r.code()), Some("shape_is_a_ball"));
}

fn warnings(volume: &medialrep::space::LabelVolume) -> Vec<String> {
    model_of(volume, params()).structures[0].warnings.iter().map(|w| w.code.to_string()).collect()
}

fn in_slab([i, j, k]: [usize; 3]) -> bool {
    (6..46).contains(&i) && (6..36).contains(&j) && (6..15).contains(&k)
}

#[test]
fn stray_voxels_and_cavities_are_mended_with_a_word() {
    let plain = painted([52, 42, 22], [1.0; 3], |at| u16::from(in_slab(at)));
    let holed = |at: [usize; 3]| at[0] == 20 && at[1] == 20 && at[2] == 10;
    let dirty = painted([52, 42, 22], [1.0; 3], |at| u16::from((in_slab(at) && !holed(at)) || at == [2, 2, 2]));
    assert_eq!(warnings(&plain), Vec::<&str>::new());
    assert_eq!(warnings(&dirty), ["stray_voxels_dropped", "cavities_filled"]);
    let (a, b) = (model_of(&plain, params()), model_of(&dirty, params()));
    assert!(
        drift(a.structures[0].sheets().next().expect("a sheet"), b.structures[0].sheets().next().expect("a sheet"))
            < 1e-9
    );
}

#[test]
fn an_object_cut_by_the_image_is_said() {
    let cut = painted([40, 42, 22], [1.0; 3], |at| u16::from(in_slab(at)));
    assert_eq!(warnings(&cut), ["cut_by_image"]);
}

#[test]
fn an_object_in_the_last_slice_of_a_file_without_empty_ones_may_go_on() {
    let low = painted([52, 42, 22], [1.0; 3], |[i, j, k]| u16::from(in_slab([i, j, k + 5])));
    let high = painted([52, 42, 16], [1.0; 3], |at| u16::from(in_slab(at)));
    for volume in [low, high] {
        assert_eq!(warnings(&volume), Vec::<&str>::new());
        assert_eq!(warnings(&volume.with_added_slices(2)), ["edge_unknown"]);
    }
}

#[test]
fn a_background_is_one_in_a_file_without_empty_slices_too() {
    let in_file = |k: usize| (1..25).contains(&k);
    let outside = |at: [usize; 3]| in_file(at[2]) && !in_slab([at[0], at[1], at[2].saturating_sub(2)]);
    let volume = painted([52, 42, 26], [1.0; 3], |at| u16::from(outside(at))).with_added_slices(2);
    check_refused(&volume, params(), "label_is_background");
}

#[test]
fn labels_that_overlap_are_each_computed_as_if_alone() {
    let dims = [52, 42, 30];
    let thick = |[i, j, k]: [usize; 3]| in_slab([i, j, k.saturating_sub(4)]);
    let grid = |index: u16, is_inside: &dyn Fn([usize; 3]) -> bool| {
        let alone = painted(dims, [1.0; 3], |at| u16::from(is_inside(at)));
        let indices = alone.indices().as_slice().iter().map(|one| one * index).collect();
        (alone, Grid::from_vec(dims, indices).expect("as many as before"))
    };
    let ((first, below), (second, above)) = (grid(1, &in_slab), grid(2, &thick));
    let labels = vec![Label::new(3), Label::new(7)];
    let both = LabelVolume::layered((below, vec![above]), labels, first.world_from_voxel()).expect("two layers");
    let model = model_of(&both, params());
    for (structure, alone) in model.structures.iter().zip([first, second]) {
        let alone = &model_of(&alone, params()).structures[0];
        assert_eq!(structure.voxels, alone.voxels);
        let of = |structure: &Structure| structure.sheets().next().expect("a sheet").medial.clone();
        assert_eq!(of(structure), of(alone));
    }
}

#[test]
fn padding_changes_nothing() {
    let small = painted([52, 42, 22], [1.0; 3], |at| u16::from(in_slab(at)));
    let large = painted([70, 55, 40], [1.0; 3], |at| u16::from(in_slab(at)));
    let (a, b) = (model_of(&small, params()), model_of(&large, params()));
    assert_eq!(
        a.structures[0].sheets().next().expect("a sheet").medial,
        b.structures[0].sheets().next().expect("a sheet").medial
    );
    assert_eq!(
        a.structures[0].sheets().next().expect("a sheet").upper,
        b.structures[0].sheets().next().expect("a sheet").upper
    );
}

#[test]
fn max_figures_keeps_the_largest() {
    let model = model_of(&volume("tee"), Params { max_figures: Some(2), ..params() });
    assert!(model.structures[0].figures.len() <= 2);
}

#[test]
fn full_pruning_leaves_one_sheet_and_none_leaves_all() {
    for (name, sheets) in [("tee", 3), ("cross", 4)] {
        let figures = |strength| {
            let params = Params { prune: Prune::Strength(strength), ..params() };
            model_of(&volume(name), params).structures[0].figures.len()
        };
        assert_eq!(figures(1.0), 1, "{name}");
        assert!(figures(0.0) >= sheets, "{name}");
    }
}

#[test]
fn landmarks_agree_with_exact_isomap() {
    let volume = volume("leaf");
    let exact = model_of(&volume, Params { landmarks: Landmarks::All, ..params() });
    let few = model_of(&volume, params());
    let (a, b) =
        (exact.structures[0].sheets().next().expect("a sheet"), few.structures[0].sheets().next().expect("a sheet"));
    assert!(a.landmarks.medial > 5 * b.landmarks.medial);
    let flat = |f: &medialrep::model::Sheet| f.points.medial.flat.clone();
    let (a, b) = (flat(a), flat(b));
    let extent = a.iter().map(|p| p.x).fold(0.0, f64::max) - a.iter().map(|p| p.x).fold(0.0, f64::min);
    let off = crate::help::phantoms::rms(a.iter().zip(&b).map(|(p, q)| (p - q).norm()));
    assert!(off <= 0.01 * extent, "off by {off:.3} of {extent:.1}");
}

#[test]
fn neighbourhoods_are_what_was_asked_for() {
    let volume = volume("leaf");
    let degree = |neighbors| {
        model_of(&volume, Params { neighbors, ..params() }).structures[0]
            .sheets()
            .next()
            .expect("a sheet")
            .neighbors
            .medial
            .expect("laid flat")
    };
    let twelve = degree(Neighbors::Count(12));
    assert!((12.0..18.0).contains(&twelve), "k = 12, made symmetric: {twelve}");
    assert!(degree(Neighbors::RadiusMm(2.5)) < degree(Neighbors::RadiusMm(5.0)));
}

#[test]
fn a_neighbourhood_too_small_to_connect_is_joined_and_said() {
    let params = Params { neighbors: Neighbors::RadiusMm(0.9), ..params() };
    let model = model_of(&volume("leaf"), params);
    assert!(model.structures[0].warnings.iter().any(|w| w.code == "neighborhood_too_small"));
}

#[test]
fn the_regular_lattice_is_a_rectangle_with_nodes_off_the_sheet_flagged() {
    let model = model_of(&volume("ellipsoid"), Params { lattice: LatticeKind::Regular, ..params() });
    let figure = model.structures[0].sheets().next().expect("a sheet");
    let flat = &figure.intrinsic.medial;
    let invalid = figure.valid.iter().filter(|v| !**v).count();
    assert!((10..120).contains(&invalid), "the corners of a rectangle round an ellipse: {invalid} of 240");
    assert!(!figure.valid[0] && figure.valid[6 * 20 + 10]);
    assert!((flat[0].y - flat[19].y).abs() < 1e-9 && (flat[0].x - flat[11 * 20].x).abs() < 1e-9);
    assert!(model.structures[0].quality.reasons.iter().any(|r| r.code == "invalid_nodes"));
}

#[test]
fn an_automatic_lattice_follows_the_spacing() {
    let params = Params { grid: GridChoice::Auto, spacing_mm: Some(5.0), margin: Some(0.0), ..params() };
    let figure = first_sheet(&model_of(&volume("bent_even"), params));
    let LatticeSize { rows, cols } = figure.grid;
    let step = (figure.medial[cols / 2 + 1] - figure.medial[cols / 2]).norm();
    assert!((4.0..6.0).contains(&step), "{rows} × {cols}, {step:.2} mm apart");
}

#[test]
fn the_margin_keeps_nodes_off_the_edge() {
    let extent = |margin: f64| {
        let figure = first_sheet(&model_of(&volume("bent_even"), Params { margin: Some(margin), ..params() }));
        (figure.intrinsic.medial[5 * 20 + 19] - figure.intrinsic.medial[5 * 20]).norm()
    };
    let ratio = extent(0.2) / extent(0.0);
    assert!((ratio - 0.6).abs() < 0.03, "ratio {ratio:.3}");
}

#[test]
fn a_coarser_working_voxel_is_used_and_told() {
    let params = Params { resolution_mm: Some(1.5), ..params() };
    let structure = &model_of(&volume("bent_even"), params).structures[0];
    assert!((structure.working_voxel_mm - 1.5).abs() < 1e-12);
    assert!(structure.quality.coverage.dice > 0.9);
}

#[test]
fn a_working_grid_that_is_too_large_is_refused_before_it_is_made() {
    let params = Params { resolution_mm: Some(0.01), ..params() };
    check_refused(&volume("slab"), params, "working_grid_too_large");
}

fn field_of(params: Params) -> Option<String> {
    params.check().err().map(|e: ParamsError| e.field.to_string())
}

#[test]
fn parameters_out_of_range_are_refused_by_name() {
    let base = Params::default;
    let grid = |rows, cols| GridChoice::Fixed { rows, cols };
    let cases = [
        (Params { grid: grid(2, 8), ..base() }, "grid.rows"),
        (Params { grid: grid(6, 513), ..base() }, "grid.cols"),
        (Params { margin: Some(-0.1), ..base() }, "margin"),
        (Params { margin: Some(f64::NAN), ..base() }, "margin"),
        (Params { neighbors: Neighbors::Count(3), ..base() }, "neighbors.k"),
        (Params { neighbors: Neighbors::RadiusMm(0.0), ..base() }, "neighbors.epsilon_mm"),
        (Params { landmarks: Landmarks::Count(2), ..base() }, "landmarks"),
        (Params { prune: Prune::Strength(1.5), ..base() }, "prune"),
        (Params { grid: grid(6, 8), spacing_mm: Some(3.0), ..base() }, "spacing_mm"),
        (Params { resolution_mm: Some(0.0), ..base() }, "resolution_mm"),
        (Params { max_figures: Some(0), ..base() }, "max_figures"),
        (Params { labels: Some(vec![]), ..base() }, "labels"),
        (Params { labels: Some(vec![0]), ..base() }, "labels"),
    ];
    for (params, field) in cases {
        assert_eq!(field_of(params).as_deref(), Some(field));
    }
}

/// Stops at the n-th look.
struct StopsAt {
    looks: AtomicUsize,
    limit: usize,
}

impl Observer for StopsAt {
    fn progress(&self, _structure: usize, _structures: usize, _stage: Stage, _fraction: f64) {}
}

impl Cancel for StopsAt {
    fn is_cancelled(&self) -> bool {
        self.looks.fetch_add(1, Ordering::Relaxed) >= self.limit
    }
}

#[test]
fn a_run_stops_wherever_it_is_asked_to() {
    let (volume, params) = (volume("slab"), params().check().expect("in range"));
    let ended = StopsAt { looks: AtomicUsize::new(0), limit: usize::MAX };
    run(&volume, &params, &ended).expect("runs to its end");
    let looks = ended.looks.load(Ordering::Relaxed);
    assert!(looks > 30, "only {looks} looks");
    for limit in [0, 1, looks / 2, looks - 1] {
        let stops = StopsAt { looks: AtomicUsize::new(0), limit };
        assert_eq!(run(&volume, &params, &stops).err(), Some(PipelineError::Cancelled(Cancelled)), "at look {limit}");
    }
}
