//! Sheets that cannot be laid out in one piece are cut.

use medialrep::model::Structure;
use medialrep::params::Params;
use medialrep::space::LabelVolume;

use crate::help::phantoms::{model_of, painted, params, volume};

fn structure(volume: &LabelVolume, params: Params) -> Structure {
    model_of(volume, params).structures.remove(0)
}

fn cuts(structure: &Structure) -> usize {
    structure.warnings.iter().filter(|w| w.code == "sheet_cut").count()
}

/// A shell 6 voxels thick around all of a sphere but an opening about the z axis.
pub fn bowl(opening_deg: f64) -> LabelVolume {
    painted([48; 3], [1.0; 3], |index| {
        let [x, y, z] = index.map(|i| i as f64 - 23.5);
        let radius = (x * x + y * y + z * z).sqrt();
        u16::from((radius - 18.0).abs() < 3.0 && z < opening_deg.to_radians().cos() * radius)
    })
}

/// A plate 110 long and 40 wide with a slot from one end, 40 deep.
fn notched() -> LabelVolume {
    painted([118, 48, 14], [1.0; 3], |[x, y, z]| {
        let is_plate = (4..114).contains(&x) && (4..44).contains(&y) && (4..10).contains(&z);
        let is_slot = x >= 74 && (20..24).contains(&y);
        u16::from(is_plate && !is_slot)
    })
}

/// A flat L 8 thick, of two arms 24 wide and 90 long.
fn bent_in_its_plane() -> LabelVolume {
    painted([100, 100, 16], [1.0; 3], |[x, y, z]| {
        let is_inside = (4..94).contains(&x) && (4..94).contains(&y) && (4..12).contains(&z);
        u16::from(is_inside && (x < 28 || y < 28))
    })
}

#[test]
fn a_bowl_that_is_nearly_closed_is_cut_until_every_part_can_be_laid_flat() {
    let bowl = structure(&bowl(12.0), params());
    assert_eq!(cuts(&bowl), 1);
    assert!(bowl.figures.len() > 1);
    for figure in bowl.sheets() {
        let plane = figure.quality.embedding.medial.expect("laid flat");
        assert!(plane.unrolled.is_some() || plane.residual_variance < 0.018, "{plane:?}");
    }
    // Every part meets another one.
    for number in 0..bowl.figures.len() {
        assert!(bowl.junctions.iter().any(|j| j.figures.contains(&number)), "figure {number} has no junction");
    }
}

#[test]
fn parts_reach_the_hinge_that_they_meet_at() {
    let plate = structure(&notched(), params());
    // The crest of a lattice at a hinge is the hinge; its points are 2 to 4 voxels apart.
    let ends: Vec<_> = plate.sheets().map(|f| [&f.medial[..], &f.crest].concat()).collect();
    let gap = |p: &medialrep::space::WorldPoint| {
        let to =
            |nodes: &[medialrep::space::WorldPoint]| nodes.iter().map(|q| (q - p).norm()).fold(f64::INFINITY, f64::min);
        ends.iter().map(|nodes| to(nodes)).fold(0.0, f64::max)
    };
    let points = &plate.junctions[0].points;
    let mean = points.iter().map(gap).sum::<f64>() / points.len() as f64;
    assert!(mean < 2.0, "the lattices end {mean:.1} voxels before the hinge in the mean");
}

#[test]
fn a_plate_that_forks_around_a_slot_is_cut_at_its_bottom() {
    let plate = structure(&notched(), params());
    assert_eq!((cuts(&plate), plate.figures.len(), plate.junctions.len()), (1, 2, 1));
    let hinge = &plate.junctions[0].points;
    let mean = hinge.iter().map(|p| p.x.abs()).sum::<f64>() / hinge.len() as f64;
    assert!((mean - 74.0).abs() < 8.0, "the cut lies at {mean:.1}");
}

#[test]
fn a_sheet_that_bends_in_its_plane_is_cut_in_its_arms() {
    let plate = structure(&bent_in_its_plane(), params());
    let told: Vec<_> = plate.warnings.iter().filter(|w| w.code == "sheet_cut").map(|w| w.message.as_str()).collect();
    assert!(told.len() == 1 && told[0].contains("no lattice fits it"), "{told:?}");
    assert_eq!((plate.figures.len(), plate.junctions.len()), (2, 1));
    let overlap = plate.quality.coverage.dice;
    assert!(overlap > 0.93, "overlap {overlap:.3}");
}

#[test]
fn sheets_that_can_be_laid_flat_stay_whole() {
    for name in ["leaf", "half_bent", "thick_bend", "twisted"] {
        assert_eq!(cuts(&structure(&volume(name), params())), 0, "{name}");
    }
}

#[test]
fn no_sheet_is_cut_into_more_figures_than_asked_for() {
    let one = Params { max_figures: Some(1), ..params() };
    assert_eq!(structure(&notched(), one).figures.len(), 1);
}
