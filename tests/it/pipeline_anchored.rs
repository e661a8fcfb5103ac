//! Anchored vectors: true lengths, no crossings, the sheet up to its rim, lattices that meet.

use medialrep::model::{Sheet, Side, Structure, Verdict, ring};
use medialrep::params::{Correspondence, LatticeKind, Params};
use medialrep::space::WorldPoint;
use nalgebra::Rotation3;

use crate::help::phantoms::{drift, model_of, params, rms, sample, turned, volume};

fn structure_of(name: &str, spacing_mm: f64, rotation: Rotation3<f64>) -> Structure {
    let volume = sample(name).voxelise([spacing_mm; 3], rotation).expect("fits");
    model_of(&volume, params()).structures.remove(0)
}

/// Relative errors of vector lengths against a constant half-thickness, away from the rim.
fn length_errors(figure: &Sheet, half_mm: f64) -> Vec<f64> {
    let is_inner = |n: usize| (3..9).contains(&(n / 20)) && (5..15).contains(&(n % 20));
    let both = Side::BOTH.map(|side| figure.vectors(side));
    let lengths = both.iter().flat_map(|v| v.iter().enumerate().filter(|(n, _)| is_inner(*n)).map(|(_, v)| v.norm()));
    lengths.map(|l| (l / half_mm - 1.0).abs()).collect()
}

#[test]
fn it_is_the_default_and_paper_stays() {
    assert_eq!(Params::default().correspondence, Correspondence::Anchored);
    let paper = Params { correspondence: Correspondence::Paper, ..params() };
    let model = model_of(&volume("bent_even"), paper);
    assert_eq!(model.params.correspondence, Correspondence::Paper);
    let quality = &model.structures[0].sheets().next().expect("a sheet").quality;
    assert!(quality.residual_variance().upper.expect("its own") < 0.01, "sides are laid flat on their own");
    let anchored = structure_of("bent_even", 1.0, Rotation3::identity());
    assert!(anchored.sheets().next().expect("a sheet").quality.embedding.upper.is_none(), "sides are not laid flat");
}

#[test]
fn vectors_have_the_true_length_however_the_slab_is_bent() {
    for (name, half_mm) in [("bent_even", 6.0), ("half_bent", 6.0), ("thick_bend", 11.0), ("twisted", 5.0)] {
        let errors =
            length_errors(structure_of(name, 1.0, Rotation3::identity()).sheets().next().expect("a sheet"), half_mm);
        let (mean, worst) =
            (errors.iter().sum::<f64>() / errors.len() as f64, errors.iter().fold(0.0f64, |a, b| a.max(*b)));
        assert!(mean < 0.02 && worst < 0.05, "{name}: {mean:.4} {worst:.4}");
    }
}

#[test]
fn no_vectors_cross_on_any_shape() {
    for name in
        ["slab", "ellipsoid", "bent", "bump", "thick_bend", "half_bent", "twisted", "leaf", "tee", "wye", "cross"]
    {
        let structure = structure_of(name, 1.0, Rotation3::identity());
        for figure in structure.sheets() {
            let quality = &figure.quality;
            assert_eq!((quality.folds, quality.folded_cells.len(), quality.folded_wedges.len()), (0, 0, 0), "{name}");
        }
        assert!(structure.quality.verdict != Verdict::Fail, "{name}: {:?}", structure.quality.reasons);
    }
}

#[test]
fn the_lattice_reaches_the_rim_of_the_sheet() {
    // The flat sheet of the slab has 54 × 38 mm; a margin of 2 % leaves 1.1 and 0.8 mm free.
    let structure = structure_of("slab", 1.0, turned());
    let figure = structure.sheets().next().expect("a sheet");
    let extent = |axis: usize| {
        let values = figure.medial.iter().map(|p| p[axis]);
        values.clone().fold(f64::NEG_INFINITY, f64::max) - values.fold(f64::INFINITY, f64::min)
    };
    let mut extents = [extent(0), extent(1), extent(2)];
    extents.sort_by(f64::total_cmp);
    assert!((extents[1] - 38.0 * 0.96).abs() < 1.2 && (extents[2] - 54.0 * 0.96).abs() < 1.2, "{extents:?}");
}

#[test]
fn the_same_solid_on_a_turned_grid_has_the_same_nodes() {
    for name in ["ellipsoid", "bent_even", "twisted", "half_bent"] {
        let (a, b) = (structure_of(name, 1.0, Rotation3::identity()), structure_of(name, 1.0, turned()));
        let drift = drift(a.sheets().next().expect("a sheet"), b.sheets().next().expect("a sheet"));
        assert!(drift < 0.75, "{name}: {drift:.3} voxels");
    }
}

#[test]
fn finer_masks_give_smaller_errors() {
    let error = |spacing_mm: f64| {
        let shape = sample("twisted");
        let structure = structure_of("twisted", spacing_mm, turned());
        let figure = structure.sheets().next().expect("a sheet");
        (
            rms(figure.medial.iter().map(|p| shape.to_sheet_mm(*p))),
            rms(figure.upper.iter().chain(&figure.lower).map(|p| shape.signed_mm(*p))),
        )
    };
    let (coarse, fine) = (error(1.0), error(0.6));
    assert!(fine.0 < 0.85 * coarse.0 && fine.1 < 0.75 * coarse.1, "{coarse:?} {fine:?}");
}

#[test]
fn neighbouring_lattices_meet_at_the_hinge() {
    for name in ["tee", "wye"] {
        let structure = structure_of(name, 1.0, Rotation3::identity());
        let hinge = structure.junctions.iter().find(|j| j.figures == [0, 1, 2]).expect("a hinge of all three");
        for figure in structure.sheets() {
            // Along the middle of the hinge: its ends are corners of the lattices.
            let edge: Vec<WorldPoint> = ring(figure.grid).into_iter().map(|n| figure.medial[n]).collect();
            let gap =
                |p: &WorldPoint| edge.iter().chain(&figure.crest).map(|e| (e - p).norm()).fold(f64::INFINITY, f64::min);
            let middle = hinge.points.iter().filter(|p| p.z.abs() < 15.0);
            let gaps: Vec<f64> = middle.map(gap).collect();
            let mean = gaps.iter().sum::<f64>() / gaps.len() as f64;
            assert!(mean < 1.8, "{name}: {mean:.2} mm from the hinge, nodes are 2 to 4 mm apart");
        }
    }
}

#[test]
fn a_regular_lattice_flags_what_lies_off_the_sheet_and_stays_legal_on_it() {
    let params = Params { lattice: LatticeKind::Regular, ..params() };
    let structure = model_of(&volume("ellipsoid"), params).structures.remove(0);
    let figure = structure.sheets().next().expect("a sheet");
    let valid = figure.valid.iter().filter(|v| **v).count();
    assert!(valid > 120 && valid < 240, "{valid} of 240 on an ellipse");
    assert_eq!(figure.quality.folds, 0);
}

#[test]
fn edge_vectors_of_an_abrupt_end_lean_towards_the_crest_and_inner_ones_do_not() {
    let structure = structure_of("slab", 1.0, Rotation3::identity());
    let figure = structure.sheets().next().expect("a sheet");
    let vectors = figure.vectors(Side::Upper);
    let lean = |n: usize| (vectors[n].z.abs() / vectors[n].norm()).acos().to_degrees();
    let (edge, inner) = (lean(10), lean(6 * 20 + 10));
    assert!(edge > 30.0 && inner < 3.0, "{edge:.0}° at the edge, {inner:.0}° inside");
    assert!((vectors[6 * 20 + 10].norm() - 4.0).abs() < 0.6);
}
