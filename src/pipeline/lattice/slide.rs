//! Nodes of a patch, slid along rows and columns until they are equally spaced along both.

use nalgebra::Point2;

use super::patch::Patch;
use crate::cancel::{Cancel, Cancelled};
use crate::model::LatticeSize;

/// Rounds of sliding at most; 20 bring the spacing below 1 % of its mean on ellipses.
const SLIDE_ROUNDS: usize = 30;
/// Largest movement, as a share of the lattice, at which sliding ends.
const SLIDE_TOLERANCE: f64 = 5e-4;
/// Pieces in which the length of an edge is measured.
const EDGE_PIECES: usize = 3;

/// Position of the k-th of `count` equally spaced values between `margin` and `1 − margin`.
pub(super) fn share(k: usize, count: usize, margin: f64) -> f64 {
    margin + (1.0 - 2.0 * margin) * k as f64 / (count - 1) as f64
}

/// Shares of nodes that were equal at first, then slid along rows and columns in turn.
pub(super) fn evenly_spaced(
    patch: &Patch,
    size: LatticeSize,
    margin: f64,
    cancel: &dyn Cancel,
) -> Result<Vec<Point2<f64>>, Cancelled> {
    let LatticeSize { rows, cols } = size;
    let at = |s: Point2<f64>| patch.at(s);
    let mut shares: Vec<Point2<f64>> =
        (0..rows * cols).map(|n| Point2::new(share(n % cols, cols, margin), share(n / cols, rows, margin))).collect();
    let first = shares.clone();
    for _ in 0..SLIDE_ROUNDS {
        let mut moved = 0.0f64;
        for i in 0..rows {
            cancel.check()?;
            moved = moved.max(slide(&mut shares, &at, |k| i * cols + k, cols));
        }
        for j in 0..cols {
            cancel.check()?;
            moved = moved.max(slide(&mut shares, &at, |k| k * cols + j, rows));
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
    /// Sine of the angle at which lines cross at the least, if they did before.
    const LEAST_SINE: f64 = 0.35;
    /// What is kept of the sliding from one try to the next.
    const KEPT: f64 = 0.75;
    /// Tries; a hundredth of the sliding is left after them.
    const TRIES: usize = 16;
    let wanted = LEAST_SINE.min(0.9 * least_sine(patch, size, first));
    let (mut shares, mut kept) = (slid.clone(), 1.0);
    for _ in 0..TRIES {
        cancel.check()?;
        if least_sine(patch, size, &shares) >= wanted {
            return Ok(shares);
        }
        kept *= KEPT;
        shares = first.iter().zip(&slid).map(|(a, b)| a + (b - a) * kept).collect();
    }
    Ok(first.to_vec())
}

/// The smallest sine between the two directions of a lattice at the corners of its quads, negative where
/// one is turned over. The corners of the lattice are left out: on a smooth outline they are flat.
fn least_sine(patch: &Patch, size: LatticeSize, shares: &[Point2<f64>]) -> f64 {
    let LatticeSize { rows, cols } = size;
    let nodes: Vec<Point2<f64>> = shares.iter().map(|s| patch.at(*s)).collect();
    let is_corner = |n: usize| [0, cols - 1, (rows - 1) * cols, rows * cols - 1].contains(&n);
    let mut least = 1.0f64;
    for (i, j) in (0..rows - 1).flat_map(|i| (0..cols - 1).map(move |j| (i, j))) {
        let quad = [(0, 0), (0, 1), (1, 0), (1, 1)].map(|(a, b)| (i + a) * cols + j + b);
        for k in (0..4).filter(|&k| !is_corner(quad[k])) {
            let along = nodes[quad[(k & 2) | 1]] - nodes[quad[k & 2]];
            let across = nodes[quad[2 | (k & 1)]] - nodes[quad[k & 1]];
            least = least.min(along.perp(&across) / (along.norm() * across.norm()).max(1e-12));
        }
    }
    least
}

/// Spaces the nodes of one lattice line equally along it; the ends stay. Returns the largest
/// movement.
fn slide(
    shares: &mut [Point2<f64>],
    at: &impl Fn(Point2<f64>) -> Point2<f64>,
    line: impl Fn(usize) -> usize,
    count: usize,
) -> f64 {
    let old: Vec<Point2<f64>> = (0..count).map(|k| shares[line(k)]).collect();
    let mut reached = vec![0.0];
    for pair in old.windows(2) {
        let piece = |k: usize| at(pair[0] + (pair[1] - pair[0]) * (k as f64 / EDGE_PIECES as f64));
        let length: f64 = (0..EDGE_PIECES).map(|k| (piece(k + 1) - piece(k)).norm()).sum();
        reached.push(reached[reached.len() - 1] + length);
    }
    let total = reached[count - 1];
    let (mut moved, mut edge) = (0.0f64, 0);
    for k in 1..count - 1 {
        let wanted = total * k as f64 / (count - 1) as f64;
        while edge + 2 < count && reached[edge + 1] < wanted {
            edge += 1;
        }
        let length = (reached[edge + 1] - reached[edge]).max(1e-12);
        let new = old[edge] + (old[edge + 1] - old[edge]) * ((wanted - reached[edge]) / length).clamp(0.0, 1.0);
        moved = moved.max((new - old[k]).norm());
        shares[line(k)] = new;
    }
    moved
}
