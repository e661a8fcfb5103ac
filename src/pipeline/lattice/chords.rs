//! The size of a lattice that follows its surfaces: as few nodes as leave chords between them near enough.
//!
//! 1. A fine lattice is laid over the region and brought to space, the sheet and, by its radius along the normal, both
//!    sides;
//! 2. along its rows, and along its columns, as few nodes are taken as keep the chords between them within a tolerance of
//!    all three surfaces;
//! 3. but no more than the points of the sheet carry, and no fewer than the paper's 6 × 8.

use nalgebra::{Point3, Vector3};

use super::{LEAST_SIZE, lattice};
use crate::cancel::Cancelled;
use crate::model::LatticeSize;
use crate::numerics::field::floor_index;
use crate::params::LatticeKind;
use crate::pipeline::context::Context;
use crate::pipeline::lattice::map::SpaceFromPlane;
use crate::pipeline::plane::region::Region;
use crate::pipeline::plane::strip::SheetPoints;

/// The lattice that stands for the smooth surfaces. Coarser ones cut off the bends that are looked for.
const FINE: LatticeSize = LatticeSize { rows: 25, cols: 49 };
/// How far a chord may lie from the surface, voxels: half of one is what the mask says of its boundary.
const TOLERANCE: f64 = 0.25;
/// Share of the places that must be within it: at corners the fits that the fine lattice is made of are rough.
const WITHIN: f64 = 0.95;
/// Distance between nodes at the least, voxels. A fit takes points within five: nearer nodes tell the same twice.
const LEAST_SPACING: f64 = 2.0;

/// The size of the lattice for a region.
///
/// # Errors
/// When it is cancelled.
pub(super) fn following(
    region: &Region,
    points: &SheetPoints,
    context: &Context<'_>,
) -> Result<LatticeSize, Cancelled> {
    let Some(fine) = lattice(region, LatticeKind::Fitted, FINE, 0.0, 0.0, context)? else { return Ok(LEAST_SIZE) };
    let map = SpaceFromPlane::new(&points.flat, &points.positions, &points.radii).over_holes();
    let nodes = map.rough_nodes(&fine.nodes, context)?;
    let mut layers = [Vec::new(), Vec::new(), Vec::new()];
    for node in &nodes {
        let normal = node.tangents[0].cross(&node.tangents[1]).try_normalize(1e-12).unwrap_or_else(Vector3::zeros);
        for (layer, side) in layers.iter_mut().zip([0.0, 1.0, -1.0]) {
            layer.push(node.position + normal * (side * node.value));
        }
    }
    let LatticeSize { rows, cols } = FINE;
    let mut along: Vec<Vec<Point3<f64>>> = Vec::new();
    let mut across: Vec<Vec<Point3<f64>>> = Vec::new();
    for layer in &layers {
        for i in 0..rows {
            along.push((0..cols).map(|j| layer[i * cols + j]).collect());
        }
        for j in 0..cols {
            across.push((0..rows).map(|i| layer[i * cols + j]).collect());
        }
    }
    // The rim is a curve of the sheet itself: its first and last lines.
    let rim_along = [along[0].clone(), along[rows - 1].clone()];
    let rim_across = [across[0].clone(), across[cols - 1].clone()];
    Ok(LatticeSize {
        rows: fewest(&across, &rim_across, LEAST_SIZE.rows),
        cols: fewest(&along, &rim_along, LEAST_SIZE.cols),
    })
}

/// The fewest nodes, from `least` on, whose chords follow all lines; no more than the points carry.
fn fewest(lines: &[Vec<Point3<f64>>], rim: &[Vec<Point3<f64>>], least: usize) -> usize {
    let mut longest = 0.0f64;
    for line in lines {
        longest = longest.max(length(line));
    }
    let most = floor_index(longest / LEAST_SPACING) + 1;
    let mut count = least;
    while count < most && (share_within(lines, count) < WITHIN || share_within(rim, count) < WITHIN) {
        count += 1;
    }
    count
}

fn length(line: &[Point3<f64>]) -> f64 {
    line.windows(2).map(|pair| (pair[1] - pair[0]).norm()).sum()
}

/// Share of the places on the lines that lie near the chords between so many nodes.
fn share_within(lines: &[Vec<Point3<f64>>], count: usize) -> f64 {
    let (mut near, mut all) = (0usize, 0usize);
    for line in lines {
        let last = (line.len() - 1) as f64;
        let knots: Vec<Point3<f64>> = (0..count).map(|k| at(line, last * k as f64 / (count - 1) as f64)).collect();
        for (n, p) in line.iter().enumerate() {
            let chord = floor_index(n as f64 / last * (count - 1) as f64).min(count - 2);
            all += 1;
            near += usize::from(distance(*p, knots[chord], knots[chord + 1]) <= TOLERANCE);
        }
    }
    near as f64 / all.max(1) as f64
}

/// The place on a line of equally spaced points.
fn at(line: &[Point3<f64>], place: f64) -> Point3<f64> {
    let n = floor_index(place).min(line.len() - 2);
    line[n] + (line[n + 1] - line[n]) * (place - n as f64)
}

/// Distance of a point from the line through two others, from the first where they are one.
fn distance(p: Point3<f64>, a: Point3<f64>, b: Point3<f64>) -> f64 {
    let along = (b - a).try_normalize(1e-12).unwrap_or_else(Vector3::zeros);
    let v = p - a;
    (v - along * v.dot(&along)).norm()
}
