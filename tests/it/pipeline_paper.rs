//! `correspondence: "paper"`, on every sample: three embeddings that know nothing of each other.

use medialrep::model::{Model, Sheet, Structure};
use medialrep::params::{Correspondence, Params};
use medialrep::pipeline::PipelineError;
use medialrep::samples;

use crate::help::phantoms::{check_invariants, plain, run_of, sample, sheets};
use crate::measure::accuracy::vector_errors;
use crate::pipeline_folds::check_folds_are_told;

fn paper(name: &str) -> Result<Model, PipelineError> {
    run_of(&plain(name), Params { correspondence: Correspondence::Paper, ..sheets() })
}

/// Mean and largest relative error of the inner vectors of a sample's only structure.
fn errors(name: &str, structure: &Structure) -> [f64; 2] {
    let sample = sample(name);
    let of_figure = |figure: &Sheet| vector_errors(&sample.solids()[0], figure);
    let all: Vec<f64> = structure.sheets().flat_map(of_figure).collect();
    [all.iter().sum::<f64>() / all.len() as f64, all.iter().copied().fold(0.0, f64::max)]
}

/// Sheets, and what the mean and the largest error of the inner vectors stay below: a tenth above what they are.
/// Above, the pairing of the sides has got worse; far below, it has got better, and the bar is to follow.
#[track_caller]
fn check_paper(name: &str, sheets: usize, bars: [f64; 2]) {
    let model = paper(name).expect("no refusal");
    check_invariants(&model);
    let [structure] = &model.structures[..] else { panic!("{name} has one label") };
    assert_eq!(structure.figures.len(), sheets, "{name}");
    check_folds_are_told(structure);
    for figure in structure.sheets() {
        let residual = figure.quality.residual_variance();
        let all = [residual.medial, residual.upper, residual.lower];
        assert!(all.iter().flatten().filter(|r| (0.0..0.05).contains(*r)).count() == 3, "{name}: {all:?}");
        let spread = figure.landmarks.named().map(|(_, count)| *count);
        assert!(spread.iter().all(|count| *count > 0), "each surface is laid flat on its own: {spread:?}");
    }
    let found = errors(name, structure);
    assert!(found[0] < bars[0] && found[1] < bars[1], "{name}: {found:?}, the bars are {bars:?}");
}

#[track_caller]
fn check_refused(name: &str, code: &str) {
    match paper(name) {
        Err(PipelineError::Refused(refusal)) => assert_eq!(refusal.code(), code, "{name}"),
        other => panic!("{name}: expected {code}, got {:?}", other.map(|model| model.structures.len())),
    }
}

#[test]
fn flat_sheets_pair_up() {
    check_paper("slab", 1, [0.087, 0.323]);
}

#[test]
fn an_ellipsoid_pairs_up() {
    check_paper("ellipsoid", 1, [0.014, 0.042]);
}

#[test]
fn a_bent_slab_pairs_up() {
    check_paper("bent_even", 1, [0.112, 0.353]);
}

#[test]
fn a_tapered_slab_pairs_up() {
    check_paper("bent", 1, [0.172, 0.474]);
}

#[test]
fn a_bump_pairs_up() {
    check_paper("bump", 1, [0.1, 0.368]);
}

#[test]
fn a_thick_bend_pairs_up() {
    check_paper("thick_bend", 1, [0.153, 0.46]);
}

#[test]
fn vectors_lean_where_a_slab_is_bent_on_one_half() {
    check_paper("half_bent", 1, [0.431, 0.636]);
}

#[test]
fn a_twisted_slab_pairs_up() {
    check_paper("twisted", 1, [0.089, 0.254]);
}

#[test]
fn a_leaf_pairs_up() {
    check_paper("leaf", 1, [0.205, 0.552]);
}

#[test]
fn the_sheets_of_a_tee_pair_up() {
    check_paper("tee", 3, [0.344, 0.606]);
}

#[test]
fn the_sheets_of_a_wye_pair_up() {
    check_paper("wye", 3, [0.306, 0.556]);
}

#[test]
fn the_sheets_of_a_cross_pair_up() {
    check_paper("cross", 4, [0.386, 0.636]);
}

#[test]
fn two_objects_are_two_results() {
    let model = paper("two").expect("no refusal");
    check_invariants(&model);
    assert_eq!(model.structures.iter().map(|s| (s.label, s.figures.len())).collect::<Vec<_>>(), [(11, 1), (2101, 1)]);
    for structure in &model.structures {
        check_folds_are_told(structure);
    }
}

#[test]
fn what_has_no_sheet_is_refused_as_in_the_other_mode() {
    check_refused("ball", "shape_is_a_ball");
    check_refused("tube", "shape_is_a_tube");
    check_refused("mobius", "not_orientable");
    check_refused("thin", "too_thin");
}

#[test]
fn every_sample_is_run() {
    for (name, _) in samples::list() {
        assert!(include_str!("pipeline_paper.rs").contains(&format!("(\"{name}\"")), "{name}");
    }
}
