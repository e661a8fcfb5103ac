//! The figures of `docs/accuracy.json`, held: what is measured now against what was written then.

use std::fmt::Write;
use std::path::Path;

use crate::measure::accuracy::{Accuracy, Outcome, measured};
use crate::measure::shapes::{CASES, Case, SHAPES};
use crate::measure::table::{FILE, Table};

/// How far a measure may move, as a share of what is written.
const SHARE: f64 = 0.05;

/// What a measure may move by however small it is. Below it lies what another order of the same sums or
/// another machine's sine can do, and nobody can measure it: a fiftieth of a voxel of 1 mm is 20 µm, a
/// thousandth of a thickness of 10 mm is 10 µm. A larger one would let the smallest figures grow unseen.
fn floor(measure: &str) -> f64 {
    match measure {
        "medial" | "skin" => 0.01,
        // Of all nodes, and a sum of what moves along the sheet and across it.
        "drift" => 0.02,
        // Relative errors, and the share of the voxels that is missed.
        "radius" | "vector" | "dice" => 0.001,
        // Of one vector.
        "worst" => 0.005,
        // Counts have no slack.
        _ => 0.0,
    }
}

/// A measure as one that is better when it is smaller: of the overlap, what is missed.
fn error(measure: &str, value: Option<f64>) -> Option<f64> {
    if measure == "dice" { value.map(|dice| 1.0 - dice) } else { value }
}

/// The measures by name, in the order of the file.
fn named(accuracy: &Accuracy) -> [(&'static str, Option<f64>); 10] {
    [
        ("sheets", Some(accuracy.sheets as f64)),
        ("medial", Some(accuracy.medial)),
        ("skin", Some(accuracy.skin)),
        ("radius", accuracy.radius),
        ("vector", Some(accuracy.vector)),
        ("worst", Some(accuracy.worst)),
        ("drift", accuracy.drift),
        ("folds", Some(accuracy.folds as f64)),
        ("corners", Some(accuracy.corners as f64)),
        ("dice", Some(accuracy.dice)),
    ]
}

/// One line for each measure that has moved.
fn moved(shape: &str, case: &Case, was: &Outcome, is: &Outcome) -> String {
    let mut lines = String::new();
    let (Outcome::Measured(was), Outcome::Measured(is)) = (was, is) else {
        let told = |outcome: &Outcome| match outcome {
            Outcome::Measured(_) => "a result".to_owned(),
            Outcome::Refused { refused } => format!("refused ({refused})"),
        };
        return if was == is { lines } else { format!("{shape}, {}: was {}, is {}\n", case.name, told(was), told(is)) };
    };
    for ((measure, was), (_, is)) in named(was).into_iter().zip(named(is)) {
        let slack = |was: f64| (SHARE * was).max(floor(measure));
        let word = match (error(measure, was), error(measure, is)) {
            (None, None) => continue,
            (Some(a), Some(b)) if (b - a).abs() <= slack(a) => continue,
            // More sheets or fewer, more corners or fewer: neither is better.
            _ if measure == "sheets" || measure == "corners" => "other",
            (Some(a), Some(b)) if b < a => "better",
            _ => "worse",
        };
        let told = |value: Option<f64>| value.map_or_else(|| "none".to_owned(), |value| value.to_string());
        writeln!(lines, "{shape}, {}: {measure} was {}, is {}, {word}", case.name, told(was), told(is)).unwrap();
    }
    lines
}

fn check_held(name: &str) {
    let at = SHAPES.iter().position(|shape| shape.sample == name).expect("a shape of that name");
    let written = written();
    let now = measured(&SHAPES[at]);
    let mut lines = String::new();
    for ((case, was), is) in CASES.iter().zip(&written.0[at]).zip(&now) {
        lines += &moved(name, case, was, is);
    }
    assert!(lines.is_empty(), "{lines}if that is meant, write {FILE} anew with `make accuracy` in the same commit");
}

fn written() -> Table {
    Table::read(Path::new(env!("CARGO_MANIFEST_DIR")))
        .unwrap_or_else(|error| panic!("{FILE}: {error}; write it with `make accuracy`"))
}

#[test]
fn a_slab_is_as_accurate_as_written() {
    check_held("slab");
}

#[test]
fn an_ellipsoid_is_as_accurate_as_written() {
    check_held("ellipsoid");
}

#[test]
fn a_bent_slab_is_as_accurate_as_written() {
    check_held("bent_even");
}

#[test]
fn a_bump_is_as_accurate_as_written() {
    check_held("bump");
}

#[test]
fn a_thick_bend_is_as_accurate_as_written() {
    check_held("thick_bend");
}

#[test]
fn a_half_bent_slab_is_as_accurate_as_written() {
    check_held("half_bent");
}

#[test]
fn a_twisted_slab_is_as_accurate_as_written() {
    check_held("twisted");
}

#[test]
fn a_leaf_is_as_accurate_as_written() {
    check_held("leaf");
}

#[test]
fn a_tee_is_as_accurate_as_written() {
    check_held("tee");
}

#[test]
fn a_wye_is_as_accurate_as_written() {
    check_held("wye");
}

#[test]
fn a_cross_is_as_accurate_as_written() {
    check_held("cross");
}

#[test]
fn every_shape_of_the_file_is_held_by_a_test() {
    for shape in &SHAPES {
        let call = format!("\n    check_held(\"{}\");", shape.sample);
        assert!(include_str!("accuracy.rs").contains(&call), "{}", shape.sample);
    }
}

fn good() -> Accuracy {
    Accuracy {
        sheets: 1,
        medial: 0.4,
        skin: 0.3,
        radius: Some(0.02),
        vector: 0.02,
        worst: 0.1,
        drift: None,
        folds: 0,
        corners: 3344,
        dice: 0.96,
    }
}

/// A slab of which nothing is wrong but what `change` does.
fn changed(change: impl FnOnce(&mut Accuracy)) -> String {
    let was = good();
    let mut is = was.clone();
    change(&mut is);
    moved("slab", &CASES[0], &Outcome::Measured(was), &Outcome::Measured(is))
}

#[test]
fn what_moves_by_less_than_a_twentieth_is_as_written() {
    assert_eq!(changed(|_| ()), "");
    assert_eq!(changed(|is| is.medial = 0.419), "");
    assert_eq!(changed(|is| is.dice = 0.9585), "");
}

#[test]
fn what_moves_by_more_is_told_with_shape_case_and_measure() {
    assert_eq!(changed(|is| is.medial = 0.421), "slab, plain: medial was 0.4, is 0.421, worse\n");
    assert_eq!(changed(|is| is.skin = 0.28), "slab, plain: skin was 0.3, is 0.28, better\n");
    assert_eq!(changed(|is| is.dice = 0.957), "slab, plain: dice was 0.96, is 0.957, worse\n");
    assert_eq!(changed(|is| is.folds = 1), "slab, plain: folds was 0, is 1, worse\n");
    assert_eq!(changed(|is| is.sheets = 2), "slab, plain: sheets was 1, is 2, other\n");
    assert_eq!(changed(|is| is.radius = None), "slab, plain: radius was 0.02, is none, worse\n");
    assert_eq!(changed(|is| is.medial = f64::NAN), "slab, plain: medial was 0.4, is NaN, worse\n");
}

#[test]
fn a_refusal_is_told_where_there_was_a_result_and_the_other_way_round() {
    let refused = |code: &str| Outcome::Refused { refused: code.to_owned() };
    let told = |was, is| moved("slab", &CASES[0], &refused(was), &refused(is));
    assert_eq!(told("too_thin", "too_thin"), "");
    assert_eq!(told("too_thin", "too_small"), "slab, plain: was refused (too_thin), is refused (too_small)\n");
    let result = Outcome::Measured(good());
    assert_eq!(moved("slab", &CASES[0], &result, &refused("x")), "slab, plain: was a result, is refused (x)\n");
}

#[test]
fn the_file_is_as_the_program_writes_it() {
    let text = std::fs::read_to_string(Path::new(env!("CARGO_MANIFEST_DIR")).join(FILE)).unwrap();
    assert_eq!(written().to_text(), text);
}

#[test]
fn the_document_has_the_figures_of_the_file() {
    let document = std::fs::read_to_string(Path::new(env!("CARGO_MANIFEST_DIR")).join("docs/accuracy.md")).unwrap();
    let table = written().to_markdown();
    assert!(document.contains(&table), "copy it from `cargo run --example accuracy -- --table`:\n{table}");
}
