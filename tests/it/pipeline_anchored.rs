//! Anchored vectors: true lengths, no crossings, the sheet up to its rim, lattices that meet.

use medialrep::model::{NodeRepair, Sheet, Side, Structure, Verdict, ring};
use medialrep::params::{Correspondence, LatticeKind, Params};
use medialrep::space::{LabelVolume, WorldPoint};
use nalgebra::Rotation3;

use crate::help::phantoms::{drift, model_of, painted, params, plain, rms, run_with, sample, turned, volume};

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
fn edge_vectors_end_where_the_ball_touches() {
    for name in ["slab", "bent_even", "thick_bend", "tee", "wye"] {
        let structure = structure_of(name, 1.0, Rotation3::identity());
        for figure in structure.sheets() {
            for side in Side::BOTH {
                for (length, radius) in figure.lengths_mm(side).iter().zip(&figure.medial_radius_mm) {
                    assert!(*length <= 1.15 * radius + 0.5, "{name}: {length:.2} where the radius is {radius:.2}");
                }
            }
        }
    }
}

#[test]
fn a_plate_with_a_round_rim_is_as_thick_as_it_is() {
    let structure = model_of(&plain("slab"), params()).structures.remove(0);
    let mean = structure.thickness_summary().total_mm.expect("an area").mean;
    assert!((mean - 8.0).abs() < 0.08, "{mean:.3} mm of 8");
}

#[test]
fn arcs_follow_the_round_rim() {
    for name in ["slab", "bent_even", "twisted"] {
        let shape = sample(name);
        let structure = model_of(&plain(name), params()).structures.remove(0);
        let figure = structure.sheets().next().expect("a sheet");
        let off = rms(figure.crest_arcs().iter().flatten().map(|p| shape.signed_mm(*p)));
        assert!(off < 0.35, "{name}: arcs lie {off:.2} mm from the surface");
        assert!(structure.quality.coverage.dice > 0.965, "{name}: {:.3}", structure.quality.coverage.dice);
        assert_eq!((structure.quality.folded_wedges, structure.quality.self_intersections), (0, Some(0)), "{name}");
    }
}

/// A tapering strap of elliptic section with a bow in it, 120 mm long: too round for a sheet, and too long for 6 × 8 nodes.
fn strap() -> LabelVolume {
    painted([126, 80, 32], [1.0; 3], |[i, j, k]| {
        let (x, y, z) = (i as f64 - 62.5, j as f64 - 39.5, k as f64 - 15.5);
        let (bow, width) = (y - 18.0 * (-((x + 25.0) / 22.0).powi(2)).exp(), 12.0 - 0.09 * (x + 60.0));
        u16::from(x.abs() <= 60.0 && (bow / width).powi(2) + (z / (0.72 * width)).powi(2) <= 1.0)
    })
}

#[test]
fn repair_keeps_nodes_in_the_solid_and_apart_and_says_how_many_it_spoilt() {
    let volume = strap();
    let model = run_with(&volume, r#"{"grid":{"rows":6,"cols":8},"kinds":["sheet"]}"#).expect("an answer");
    let figure = model.structures[0].sheets().next().expect("a sheet");
    for node in &figure.medial {
        // Voxels are cubes of 1 mm from the origin on: a node is within one of the voxel that it lies in.
        let voxels = volume.indices();
        let is_in = |offset: usize| {
            voxels.as_slice()[offset] == 1
                && (WorldPoint::from(voxels.index(offset).map(|x| x as f64)) - node).amax() < 1.0
        };
        assert!((0..voxels.as_slice().len()).any(is_in), "{node} lies outside");
    }
    for (n, node) in figure.medial.iter().enumerate() {
        for other in &figure.medial[n + 1..] {
            assert!((node - other).norm() > 0.1, "two nodes in {node}");
        }
    }
    let repair = figure.quality.repair;
    let spoilt = figure.repaired.iter().filter(|what| **what >= Some(NodeRepair::Shortened)).count();
    assert_eq!((repair.nodes, repair.marred_nodes), (48, spoilt));
    let quality = &model.structures[0].quality;
    if repair.marred_share() > 0.05 {
        assert!(quality.reasons.iter().any(|reason| reason.code == "repaired_share"));
        assert_eq!(quality.verdict, Verdict::Fail);
    }
}
