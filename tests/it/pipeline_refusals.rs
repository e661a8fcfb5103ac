//! Shapes that are refused by name, each through the whole pipeline.

use medialrep::model::{Refusal, Structure};
use medialrep::params::{Embedding, Params};
use medialrep::pipeline::PipelineError;
use medialrep::space::{LabelVolume, significant};
use nalgebra::Rotation3;

use crate::help::phantoms::{first_sheet, model_of, painted, params, run_of, run_with, sample, sheets, turned, volume};

/// Why it has no sheet.
fn refusal_of(volume: &LabelVolume) -> Refusal {
    refusal_with(volume, sheets())
}

fn refusal_with(volume: &LabelVolume, params: Params) -> Refusal {
    match run_of(volume, params) {
        Err(PipelineError::Refused(refusal)) => refusal,
        other => panic!("expected a refusal, got {:?}", other.map(|m| m.structures.len())),
    }
}

/// A plate of 50 × 40 × 8 voxels with a round hole of some radius through its middle.
fn holed(radius: f64) -> LabelVolume {
    painted([60, 50, 18], [1.0; 3], |[i, j, k]| {
        let is_plate = (5..55).contains(&i) && (5..45).contains(&j) && (5..13).contains(&k);
        let from_middle = (i as f64 - 29.5).hypot(j as f64 - 24.5);
        u16::from(is_plate && from_middle >= radius)
    })
}

/// A plate of 80 × 40 × 8 voxels with two round holes.
fn holed_twice() -> LabelVolume {
    painted([90, 50, 18], [1.0; 3], |[i, j, k]| {
        let is_plate = (5..85).contains(&i) && (5..45).contains(&j) && (5..13).contains(&k);
        let is_hole = |middle: f64| (i as f64 - middle).hypot(j as f64 - 24.5) < 11.0;
        u16::from(is_plate && !is_hole(25.5) && !is_hole(63.5))
    })
}

#[test]
fn a_sheet_with_two_large_holes_is_cut_through_them() {
    let structure = model_of(&holed_twice(), sheets()).structures.remove(0);
    assert!(structure.figures.len() > 1 && structure.quality.folds == 0);
    assert!(structure.warnings.iter().any(|w| w.code == "divided"), "{:?}", structure.warnings);
    assert!(structure.quality.coverage.dice > 0.94, "overlap {:.3}", structure.quality.coverage.dice);
}

#[test]
fn a_plate_with_one_large_hole_is_a_ring() {
    for max_figures in [None, Some(1)] {
        let structure = model_of(&holed(9.0), Params { max_figures, ..sheets() }).structures.remove(0);
        assert_eq!((structure.figures.len(), structure.quality.folds), (1, 0));
        assert!(structure.warnings.iter().any(|w| w.code == "sheet_closes"), "{:?}", structure.warnings);
        assert!(structure.quality.coverage.dice > 0.95, "overlap {:.3}", structure.quality.coverage.dice);
    }
}

/// Two sheets of some thickness that meet on both sides of a hole, none over it.
fn assert_rings_of_halves(structure: &Structure, thickness_mm: f64) {
    assert_eq!(structure.figures.len(), 2);
    assert!(structure.warnings.iter().any(|w| w.code == "sheet_cut" && w.message.contains("has holes")));
    assert!(structure.junctions.iter().all(|junction| junction.figures == [0, 1]) && !structure.junctions.is_empty());
    assert!(structure.quality.coverage.dice > 0.92, "overlap {:.3}", structure.quality.coverage.dice);
    for sheet in structure.sheets() {
        assert_eq!(sheet.quality.folds, 0);
        let mean = sheet.thickness_summary().total_mm.expect("has vectors").mean;
        assert!((mean - thickness_mm).abs() < 0.05 * thickness_mm, "{mean:.2} mm");
    }
}

#[test]
fn a_sheet_with_large_holes_that_may_not_be_cut_is_refused() {
    let refusal = refusal_with(&holed_twice(), Params { max_figures: Some(1), ..sheets() });
    assert_eq!(refusal.code(), "sheet_has_holes", "{refusal}");
    assert!(refusal.to_string().contains("% of its area") && refusal.hint().contains("fill the holes"));
}

#[test]
fn a_hole_two_or_four_voxels_wide_is_filled_and_said() {
    let structure = model_of(&holed(1.0), params()).structures.remove(0);
    assert!(structure.warnings.iter().any(|w| w.code == "tunnels_closed"), "{:?}", structure.warnings);
    assert_eq!(structure.figures.len(), 1);
    let structure = model_of(&holed(2.0), params()).structures.remove(0);
    assert!(structure.warnings.iter().any(|w| w.code == "sheet_holes_filled"), "{:?}", structure.warnings);
}

#[test]
fn a_flat_ring_laid_flat_by_lle_is_two_sheets_that_meet_at_both_ends() {
    let ring = painted([70, 70, 18], [1.0; 3], |[i, j, k]| {
        let r = (i as f64 - 34.5).hypot(j as f64 - 34.5);
        u16::from((14.0..30.0).contains(&r) && (5..13).contains(&k))
    });
    let params = Params { embedding: Embedding::Lle, ..params() };
    assert_rings_of_halves(&model_of(&ring, params).structures.remove(0), 8.0);
}

#[test]
fn a_torus_is_a_tube_as_long_as_its_circle() {
    let torus = painted([70, 70, 24], [1.0; 3], |[i, j, k]| {
        let r = (i as f64 - 34.5).hypot(j as f64 - 34.5) - 22.0;
        u16::from(r.hypot(k as f64 - 11.5) <= 7.0)
    });
    let refusal = refusal_of(&torus);
    let Refusal::Tube { length_mm, .. } = refusal else { panic!("{refusal}") };
    assert!((length_mm / (std::f64::consts::TAU * 22.0) - 1.0).abs() < 0.2, "{length_mm}");
}

#[test]
fn a_ball_and_a_tube_are_told_with_their_sizes() {
    let ball = refusal_of(&volume("ball"));
    let Refusal::Ball { radius_mm } = ball else { panic!("{ball:?}") };
    assert!((radius_mm - 15.0).abs() < 1.0, "{radius_mm}");
    let tube = refusal_of(&volume("tube"));
    let Refusal::Tube { length_mm, radius_mm } = tube else { panic!("{tube:?}") };
    assert!((radius_mm - 8.0).abs() < 1.0 && (55.0..75.0).contains(&length_mm), "{length_mm} {radius_mm}");
    for refusal in [ball, tube] {
        assert!(!refusal.to_string().contains(" 0.0"), "{refusal}");
    }
}

#[test]
fn the_resolution_that_a_thin_plate_is_told_does() {
    let plate = |spacing: f64| {
        let [length, width, thickness] = [30.0, 24.0, 1.0];
        let dims =
            [length, width, thickness].map(|mm: f64| (0..).find(|n| f64::from(*n) * spacing >= mm).expect("some"));
        let dims = dims.map(|n: i32| usize::try_from(n).expect("positive"));
        painted(dims.map(|n| n + 6), [spacing; 3], move |at| {
            u16::from((0..3).all(|a| (3..3 + dims[a]).contains(&at[a])))
        })
    };
    let whole_voxels = Params { resolution_mm: Some(1.0), ..params() };
    let refusal = refusal_with(&plate(1.0), whole_voxels);
    let Refusal::TooThin { resolution_mm, thickness_mm, .. } = refusal else { panic!("{refusal}") };
    assert!((thickness_mm - 1.0).abs() < 0.3, "{thickness_mm}");
    assert!(refusal.hint().ends_with(&significant(resolution_mm)));
    for done in [
        run_of(&plate(resolution_mm), params()),
        run_of(&plate(1.0), Params { resolution_mm: Some(resolution_mm), ..params() }),
    ] {
        let figure = first_sheet(&done.expect("fine enough now"));
        let total =
            |n: usize| (figure.upper[n] - figure.medial[n]).norm() + (figure.lower[n] - figure.medial[n]).norm();
        let middle = 6 * 20 + 10;
        assert!((total(middle) - 1.0).abs() < 0.25, "{:.2} mm in the middle", total(middle));
    }
}

#[test]
fn the_sample_of_a_thin_sheet_works_at_the_resolution_it_is_told() {
    let whole_voxels = Params { resolution_mm: Some(1.0), ..params() };
    let Refusal::TooThin { resolution_mm, .. } = refusal_with(&volume("thin"), whole_voxels) else {
        panic!("not too thin")
    };
    let fine = sample("thin").voxelise([resolution_mm; 3], Rotation3::identity()).expect("fits");
    assert_eq!(model_of(&fine, params()).structures[0].figures.len(), 1);
}

#[test]
fn a_moebius_band_is_refused_on_any_grid() {
    for rotation in [Rotation3::identity(), turned()] {
        let band = sample("mobius").voxelise([1.0; 3], rotation).expect("fits");
        assert_eq!(refusal_of(&band).code(), "not_orientable");
    }
}

#[test]
fn a_few_voxels_are_a_fragment_and_refused_with_their_number() {
    let clump =
        |edge: usize| painted([14; 3], [1.0; 3], move |at| u16::from(at.iter().all(|x| (4..4 + edge).contains(x))));
    let refusal = run_with(&clump(3), "{}").map(|model| model.structures.len()).expect_err("27 voxels are no organ");
    assert_eq!(refusal.to_string(), "the object is a fragment of 27 voxels");
    assert!(run_with(&clump(4), "{}").is_ok(), "64 voxels may be a small one");
}
