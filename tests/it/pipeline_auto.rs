//! What is chosen when the choice is left to the program.

use medialrep::model::GridFrom;
use medialrep::model::LatticeSize;
use medialrep::model::Sheet;
use medialrep::params::{Correspondence, GridChoice, Neighbors, Params};
use medialrep::space::LabelVolume;

use crate::help::phantoms::{first_sheet, model_of, params, sample, volume};

fn figure_of(volume: &LabelVolume, params: Params) -> Sheet {
    first_sheet(&model_of(volume, params))
}

/// Mean distances between neighbouring medial nodes along rows and along columns, mm.
fn mean_steps(figure: &Sheet) -> [f64; 2] {
    let LatticeSize { rows, cols } = figure.grid;
    let step = |a: usize, b: usize| (figure.medial[a] - figure.medial[b]).norm();
    let along: Vec<f64> = (0..rows * cols).filter(|n| n % cols + 1 < cols).map(|n| step(n, n + 1)).collect();
    let across: Vec<f64> = (0..(rows - 1) * cols).map(|n| step(n, n + cols)).collect();
    [along, across].map(|steps| steps.iter().sum::<f64>() / steps.len() as f64)
}

/// Every pair of nodes that are next to each other along a row or a column.
fn neighbours(LatticeSize { rows, cols }: LatticeSize) -> Vec<(usize, usize)> {
    let mut pairs = Vec::new();
    for n in 0..rows * cols {
        if n % cols + 1 < cols {
            pairs.push((n, n + 1));
        }
        if n + cols < rows * cols {
            pairs.push((n, n + cols));
        }
    }
    pairs
}

#[test]
fn nodes_are_as_far_apart_as_was_asked() {
    for name in ["slab", "bent_even", "ellipsoid"] {
        for (spacing_mm, margin) in [(3.0, 0.05), (2.0, 0.0)] {
            let asked =
                Params { grid: GridChoice::Auto, spacing_mm: Some(spacing_mm), margin: Some(margin), ..params() };
            let figure = figure_of(&volume(name), asked);
            assert_eq!(figure.automatic.grid_from, GridFrom::Spacing);
            // The lattice stays off the rim, and the corners are cut: rows and columns are a little
            // shorter than the rectangle.
            for step in mean_steps(&figure) {
                assert!((step / spacing_mm - 1.0).abs() < 0.06, "{name}: {step:.2} mm for {spacing_mm} mm");
            }
        }
    }
}

#[test]
fn without_a_spacing_the_chords_between_nodes_follow_the_surface() {
    for name in ["slab", "bent_even"] {
        let figure = figure_of(&volume(name), Params { grid: GridChoice::Auto, ..params() });
        assert_eq!(figure.automatic.grid_from, GridFrom::Shape);
        let (mut near, mut all) = (0, 0);
        for side in [&figure.upper, &figure.lower] {
            for (a, b) in neighbours(figure.grid) {
                all += 1;
                near += usize::from(sample(name).signed_mm(nalgebra::center(&side[a], &side[b])).abs() < 0.6);
            }
        }
        // A quarter of a voxel for the chord, and the nodes are off by up to a third of one.
        assert!(near * 20 >= all * 19, "{name}: {near} of {all} chords are near the surface");
    }
}

#[test]
fn the_extents_of_the_sheet_are_told() {
    let facts = figure_of(&volume("slab"), params()).automatic;
    assert!((facts.length_mm - 54.0).abs() < 2.0 && (facts.width_mm - 38.0).abs() < 2.0, "{facts:?}");
}

#[test]
fn the_neighbourhood_chosen_is_told_with_its_evidence() {
    let figure = figure_of(&volume("slab"), params());
    let facts = &figure.automatic;
    assert_eq!((facts.neighborhood.as_str(), facts.neighborhood_mm), ("ball of 4 voxels", Some(4.0)));
    // The sides have a graph of their own only where they are laid flat on their own.
    let pieces = |figure: &Sheet| {
        let pieces = &figure.automatic.graph_pieces;
        [pieces.medial, pieces.upper, pieces.lower]
    };
    assert_eq!(pieces(&figure), [1, 0, 0]);
    let paper = Params { correspondence: Correspondence::Paper, ..params() };
    assert_eq!(pieces(&figure_of(&volume("slab"), paper)), [1; 3]);
    assert_eq!(facts.grid_from, GridFrom::Asked);
    let sparse = figure_of(&volume("slab"), Params { neighbors: Neighbors::RadiusMm(0.9), ..params() });
    assert!(sparse.automatic.graph_pieces.medial > 1);
    assert_eq!(sparse.automatic.neighborhood, "ball of 0.9 mm, as asked");
}
