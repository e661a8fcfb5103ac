//! Nodes of a patch, slid along rows and columns until they are equally spaced along both.

use nalgebra::{Point2, Vector2};

use super::patch::Patch;
use crate::cancel::{Cancel, Cancelled};
use crate::model::LatticeSize;
use crate::numerics::polyline::Polyline;

/// Rounds of sliding at most; 20 bring the spacing below 1 % of its mean on ellipses. Without any, the spacing of
/// organs varies by 0.10 on average, not 0.04, and 31 of 75 masks lie more than 5 % further from the model; 3 do nearly
/// as well as 30, and 90 no better.
const SLIDE_ROUNDS: usize = 30;
/// Largest movement, as a share of the lattice, at which sliding ends. From 1e-4 to 4e-3 nothing changes but by chance:
/// less only takes longer.
const SLIDE_TOLERANCE: f64 = 5e-4;
/// Pieces in which the length of an edge is measured: with one, bends between two nodes are cut short. With 1 or 9,
/// spacing varies no more and no less than with 3.
const EDGE_PIECES: usize = 3;

/// Position of the k-th of `count` equally spaced values between `margin` and `1 − margin`.
pub(super) fn share(k: usize, count: usize, margin: f64) -> f64 {
    margin + (1.0 - 2.0 * margin) * k as f64 / (count - 1) as f64
}

/// Equal shares of the nodes, row-major. `margins`: left free at the ends of rows and of columns.
pub(super) fn equal_shares(size: LatticeSize, margins: [f64; 2]) -> Vec<Point2<f64>> {
    let mut shares = Vec::with_capacity(size.rows * size.cols);
    for i in 0..size.rows {
        for j in 0..size.cols {
            shares.push(Point2::new(share(j, size.cols, margins[0]), share(i, size.rows, margins[1])));
        }
    }
    shares
}

/// Shares of nodes that were equal at first, then slid along rows and columns in turn.
pub(super) fn evenly_spaced(
    patch: &Patch,
    size: LatticeSize,
    margins: [f64; 2],
    cancel: &dyn Cancel,
) -> Result<Vec<Point2<f64>>, Cancelled> {
    let LatticeSize { rows, cols } = size;
    let first = equal_shares(size, margins);
    let mut shares = first.clone();
    for _ in 0..SLIDE_ROUNDS {
        let mut moved = 0.0f64;
        for i in 0..rows {
            cancel.check()?;
            moved = moved.max(slide(patch, &mut shares, Line { first: i * cols, step: 1, count: cols }));
        }
        for j in 0..cols {
            cancel.check()?;
            moved = moved.max(slide(patch, &mut shares, Line { first: j, step: cols, count: rows }));
        }
        if moved < SLIDE_TOLERANCE {
            break;
        }
    }
    upright(patch, size, &first, shares, cancel)
}

/// Takes back as much of the sliding as it takes for rows and columns to cross: where a region narrows
/// or turns, lines that are spaced evenly lean over until they run together.
fn upright(
    patch: &Patch,
    size: LatticeSize,
    first: &[Point2<f64>],
    slid: Vec<Point2<f64>>,
    cancel: &dyn Cancel,
) -> Result<Vec<Point2<f64>>, Cancelled> {
    /// Sine of the angle at which lines cross at the least, if they did before. With 0.7, too much of the sliding is taken
    /// back: the mask of a T-shaped solid lies 0.44 mm from the model on average, not 0.38; with 0.1, 17 nodes
    /// of a spleen are repaired, not 14.
    const LEAST_SINE: f64 = 0.35;
    /// Halvings of the share that is kept. After eight it is known to 1/256; steps by a factor would be cliffs, at which
    /// nodes of mirror images lie 0.5 voxel apart.
    const TRIES: usize = 8;
    let wanted = LEAST_SINE.min(0.9 * least_sine(patch, size, first));
    let kept_share =
        |kept: f64| -> Vec<Point2<f64>> { first.iter().zip(&slid).map(|(a, b)| a + (b - a) * kept).collect() };
    if least_sine(patch, size, &slid) >= wanted {
        return Ok(slid);
    }
    let (mut kept, mut too_much) = (0.0, 1.0);
    for _ in 0..TRIES {
        cancel.check()?;
        let middle = (kept + too_much) / 2.0;
        if least_sine(patch, size, &kept_share(middle)) >= wanted {
            kept = middle;
        } else {
            too_much = middle;
        }
    }
    Ok(kept_share(kept))
}

/// The smallest sine between the two directions of a lattice at the corners of its quads, negative where
/// one is turned over. The corners of the lattice are left out: on a smooth outline they are flat.
fn least_sine(patch: &Patch, size: LatticeSize, shares: &[Point2<f64>]) -> f64 {
    let LatticeSize { rows, cols } = size;
    let nodes: Vec<Point2<f64>> = shares.iter().map(|s| patch.at(*s)).collect();
    let corners = [0, cols - 1, (rows - 1) * cols, rows * cols - 1];
    let mut least = 1.0f64;
    for first in 0..(rows - 1) * cols {
        if first % cols + 1 == cols {
            continue;
        }
        let quad = [first, first + 1, first + cols, first + cols + 1];
        for (k, node) in quad.iter().enumerate() {
            if !corners.contains(node) {
                let along = nodes[quad[(k & 2) | 1]] - nodes[quad[k & 2]];
                let across = nodes[quad[2 | (k & 1)]] - nodes[quad[k & 1]];
                least = least.min(along.perp(&across) / (along.norm() * across.norm()).max(1e-12));
            }
        }
    }
    least
}

/// A row or a column of a lattice.
#[derive(Clone, Copy)]
struct Line {
    /// Its first node.
    first: usize,
    /// From one node to the next.
    step: usize,
    /// Number of nodes.
    count: usize,
}

/// Spaces the nodes of one lattice line equally along it; the ends stay. Returns the largest
/// movement.
fn slide(patch: &Patch, shares: &mut [Point2<f64>], line: Line) -> f64 {
    let old: Vec<Vector2<f64>> = (0..line.count).map(|k| shares[line.first + k * line.step].coords).collect();
    let edges = Polyline::measured(old, |from, to| edge_length(patch, from, to));
    let new = edges.evenly(line.count, line.count - 1);
    let mut moved = 0.0f64;
    for k in 1..line.count - 1 {
        moved = moved.max((new[k] - edges.points()[k]).norm());
        shares[line.first + k * line.step] = new[k].into();
    }
    moved
}

/// Length of the way between two shares.
fn edge_length(patch: &Patch, from: Vector2<f64>, to: Vector2<f64>) -> f64 {
    let shares = (0..=EDGE_PIECES).map(|k| Point2::from(from + (to - from) * (k as f64 / EDGE_PIECES as f64)));
    patch.length(shares)
}
