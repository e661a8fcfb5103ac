//! Turned cells and wedges, and the closed surface, on figures made by hand.

use std::collections::BTreeMap;

use medialrep::cancel::Never;
use medialrep::model::LatticeSize;
use medialrep::model::closed;
use medialrep::model::{LatticePlace, Side, TriangleMesh, ring};
use medialrep::numerics::triangles::{self_intersections, volume};
use medialrep::pipeline::quality::figure_quality;
use medialrep::pipeline::vectors::Nodes;
use medialrep::pipeline::vectors::legality::{Illegal, Legality, Part, legality};
use nalgebra::{Point3, Vector3};

use crate::help::models::{drafted, flat_slab, outward, with_straight_arcs};

const SIZE: LatticeSize = LatticeSize { rows: 4, cols: 5 };

fn of(nodes: &Nodes) -> Legality {
    legality((&with_straight_arcs(nodes)).into())
}

/// All points in a mirror: the lattice becomes a left-handed one.
fn mirrored(mut nodes: Nodes) -> Nodes {
    for list in [&mut nodes.medial, &mut nodes.upper, &mut nodes.lower, &mut nodes.crest] {
        list.iter_mut().for_each(|p| p.x = -p.x);
    }
    nodes
}

fn parts(legality: &Legality) -> Vec<(Part, LatticePlace)> {
    legality.parts.iter().map(|illegal| (illegal.part, illegal.place)).collect()
}

fn at(side: Side, i: usize, j: usize) -> LatticePlace {
    LatticePlace { side, i, j }
}

#[test]
fn a_flat_slab_is_legal_in_a_right_handed_and_in_a_left_handed_space() {
    let slab = of(&flat_slab(SIZE));
    assert!(slab.is_legal(), "{:?}", slab.parts);
    let (cells, wedges) = (2 * 3 * 4, 2 * 14);
    assert_eq!((slab.checked, slab.corners), (9 * cells + 3 * 7 * wedges, 8 * cells));
    let turned = of(&mirrored(flat_slab(SIZE)));
    assert!(turned.is_legal());
    assert_eq!(turned.orientation, -slab.orientation);
}

#[test]
fn a_node_on_the_wrong_side_names_the_cells_round_it() {
    let mut nodes = flat_slab(SIZE);
    let node = 2 * SIZE.cols + 3;
    nodes.upper[node].z = -1.0;
    let found = of(&nodes);
    let cells = [(1, 2), (1, 3), (2, 2), (2, 3)].map(|(i, j)| (Part::Cell, at(Side::Upper, i, j)));
    assert_eq!(parts(&found), cells);
    // In each cell the corners at both ends of that one vector.
    assert_eq!((found.folds, found.folded_wedges), (8, 0));
}

#[test]
fn a_vector_without_length_is_a_fold() {
    let mut nodes = flat_slab(SIZE);
    nodes.lower[7] = nodes.medial[7];
    assert!(of(&nodes).folds > 0);
    nodes.lower[7].z = f64::NAN;
    assert!(of(&nodes).folds > 0, "what is no number is no good");
}

#[test]
fn a_side_that_lies_on_the_other_one_is_found() {
    let mut nodes = flat_slab(SIZE);
    nodes.lower.clone_from(&nodes.upper);
    let found = of(&nodes);
    assert_eq!(found.folds, found.corners / 2, "one of the two sides, as a whole");
    assert!(found.parts.iter().all(|illegal| illegal.place.side == Side::Lower));
    // Both sides exchanged is only another name for them.
    let mut nodes = flat_slab(SIZE);
    std::mem::swap(&mut nodes.upper, &mut nodes.lower);
    assert!(of(&nodes).is_legal());
}

#[test]
fn a_cell_that_is_turned_over_only_in_its_middle_is_found() {
    let mut nodes = flat_slab(LatticeSize { rows: 2, cols: 2 });
    // The upper quad turned by 180°, three times as long and a third as wide: every corner has a
    // positive Jacobian, while the mean of the edges changes handedness.
    let centre = Vector3::new(1.0, 1.5, 0.0);
    for point in &mut nodes.upper {
        let from = point.coords - centre;
        *point = Point3::from(centre + Vector3::new(-3.0 * from.x, -from.y / 3.0, from.z));
    }
    let found = of(&nodes);
    assert_eq!((found.folds, found.folded_centres), (0, 1));
    let cell = Illegal { part: Part::Cell, place: at(Side::Upper, 0, 0), corners: 0, is_centre_bad: true };
    assert_eq!(found.parts[0], cell);
    let quality = figure_quality(&drafted(with_straight_arcs(&nodes)), &Never).unwrap().0;
    assert_eq!((quality.folds, quality.folded_cells), (0, vec![at(Side::Upper, 0, 0)]));
}

#[test]
fn a_crest_point_inside_of_the_sheet_turns_four_wedges() {
    let mut nodes = flat_slab(SIZE);
    let place = 2;
    let node = ring(SIZE)[place];
    nodes.crest[place] = nodes.medial[node] - outward(SIZE, node) * 0.5;
    let found = of(&nodes);
    let places = [(Side::Upper, 1), (Side::Upper, 2), (Side::Lower, 1), (Side::Lower, 2)];
    assert_eq!(parts(&found), places.map(|(side, j)| (Part::Wedge, at(side, 0, j))));
    assert_eq!((found.folds, found.folded_wedges), (0, 4));
}

#[test]
fn a_crest_vector_without_length_is_illegal() {
    let mut nodes = flat_slab(SIZE);
    nodes.crest[3] = nodes.medial[ring(SIZE)[3]];
    assert_eq!(of(&nodes).folded_wedges, 4);
}

/// The upper edge drawn out to the crest, all round: the rim is sharp above.
fn sharp() -> Nodes {
    let mut nodes = flat_slab(SIZE);
    for (place, node) in ring(SIZE).into_iter().enumerate() {
        nodes.upper[node] += outward(SIZE, node);
        nodes.crest[place] = nodes.upper[node];
    }
    nodes
}

#[test]
fn a_crest_that_is_the_upper_edge_is_legal() {
    let found = of(&sharp());
    assert!(found.is_legal(), "{:?}", found.parts);
    let (cells, wedges) = (2 * 3 * 4, 14);
    assert_eq!(found.checked, 9 * cells + 3 * 7 * wedges, "the upper wedges have no volume");
}

#[test]
fn parts_with_an_invalid_node_are_no_parts() {
    let mut nodes = flat_slab(SIZE);
    nodes.valid[0] = false;
    nodes.upper[0].z = -9.0;
    let found = of(&nodes);
    assert!(found.is_legal());
    assert_eq!(found.corners, 2 * 8 * (3 * 4 - 1));
}

/// Every edge once in each direction, and Euler's number of a sphere.
#[track_caller]
pub fn check_watertight(mesh: &TriangleMesh) {
    let mut edges: BTreeMap<(u32, u32), [usize; 2]> = BTreeMap::new();
    for [a, b, c] in &mesh.triangles {
        for (from, to) in [(a, b), (b, c), (c, a)] {
            assert_ne!(from, to);
            edges.entry((*from.min(to), *from.max(to))).or_default()[usize::from(from < to)] += 1;
        }
    }
    assert!(edges.values().all(|directions| *directions == [1, 1]));
    assert_eq!(mesh.positions.len() + mesh.triangles.len(), edges.len() + 2);
}

fn volume_of(mesh: &TriangleMesh) -> f64 {
    volume(&mesh.positions, &mesh.triangles)
}

#[test]
fn the_closed_surface_is_watertight_and_faces_outward() {
    for nodes in [flat_slab(SIZE), mirrored(flat_slab(SIZE))] {
        let mesh = closed((&with_straight_arcs(&nodes)).into()).unwrap();
        check_watertight(&mesh);
        assert_eq!(mesh.positions.len(), 2 * 20 + 5 * 14);
        // A roof of half the height 1.5 and the width 1 all round the rectangle of 6 × 12.
        let expected = 3.0 * (6.0 * 12.0 + (6.0 + 12.0) + 4.0 / 3.0);
        assert!((volume_of(&mesh) - expected).abs() < 1e-9, "{}", volume_of(&mesh));
        assert_eq!(self_intersections(&mesh.positions, &mesh.triangles, &Never), Ok(0));
    }
}

#[test]
fn the_closed_surface_stays_watertight_where_the_crest_merges() {
    let mesh = closed((&with_straight_arcs(&sharp())).into()).unwrap();
    check_watertight(&mesh);
    assert_eq!(mesh.positions.len(), 2 * 20 + 2 * 14, "the lower flanks are left");
    // Upper, lower edge and crest in one, all round and on parts of the edge, corners too.
    for merged in [0..14, 0..1, 3..6, 4..5, 11..14] {
        for size in [SIZE, LatticeSize { rows: 3, cols: 3 }] {
            let mut nodes = flat_slab(size);
            let edge: Vec<usize> = ring(size);
            for place in merged.clone().filter(|place| *place < edge.len()) {
                nodes.upper[edge[place]] = nodes.crest[place];
                nodes.lower[edge[place]] = nodes.crest[place];
            }
            let mesh = closed((&with_straight_arcs(&nodes)).into()).unwrap();
            check_watertight(&mesh);
            assert!(volume_of(&mesh) > 0.0);
            assert_eq!(self_intersections(&mesh.positions, &mesh.triangles, &Never), Ok(0));
        }
    }
}

#[test]
fn a_figure_with_an_invalid_node_has_no_closed_surface() {
    let mut nodes = flat_slab(SIZE);
    nodes.valid[7] = false;
    assert_eq!(closed((&with_straight_arcs(&nodes)).into()), None);
    let quality = figure_quality(&drafted(with_straight_arcs(&nodes)), &Never).unwrap().0;
    assert_eq!(quality.self_intersections, None);
    let mut nodes = flat_slab(SIZE);
    nodes.crest[1].x = f64::NAN;
    assert_eq!(closed((&with_straight_arcs(&nodes)).into()), None);
}

#[test]
fn a_surface_that_runs_through_itself_is_found() {
    let mut nodes = flat_slab(SIZE);
    nodes.upper[7].z = -4.0;
    let quality = figure_quality(&drafted(with_straight_arcs(&nodes)), &Never).unwrap().0;
    assert!(quality.self_intersections.unwrap() > 0);
    // Without any fold: a strip bent round by more than a whole turn runs into its own start,
    // while every cell is the right way out.
    let mut nodes = flat_slab(LatticeSize { rows: 3, cols: 40 });
    for list in [&mut nodes.medial, &mut nodes.upper, &mut nodes.lower, &mut nodes.crest] {
        for p in list {
            let (radius, angle) = (18.0 + p.z, p.y / 18.0);
            *p = Point3::new(p.x, radius * angle.sin(), radius * angle.cos());
        }
    }
    let quality = figure_quality(&drafted(with_straight_arcs(&nodes)), &Never).unwrap().0;
    assert_eq!((quality.folds, quality.folded_centres, quality.folded_wedges.len()), (0, 0, 0));
    assert!(quality.self_intersections.unwrap() > 0);
}
