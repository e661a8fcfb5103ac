//! The size of a lattice that follows its surfaces: as few nodes as leave chords between them near enough.
//!
//! 1. The fine lattice of the region's lines is brought to space, the sheet and, by its radius along the normal, both
//!    sides;
//! 2. along its rows, and along its columns, as few nodes are taken as keep the chords between them within a tolerance of
//!    all three surfaces;
//! 3. but no more than the points of the sheet carry, and no fewer than the paper's 6 × 8.

use nalgebra::{Point3, Vector3};

use super::LEAST_SIZE;
use crate::cancel::Cancelled;
use crate::model::LatticeSize;
use crate::numerics::field::floor_index;
use crate::numerics::polyline::{Polyline, fewest_nodes, longest};
use crate::pipeline::chart::Chart;
use crate::pipeline::context::Context;
use crate::pipeline::lattice::map::SpaceFromPlane;
use crate::pipeline::plane::strip::SheetPoints;

/// How far a chord may lie from the surface, voxels: half of one is what the mask says of its boundary.
pub(in crate::pipeline) const TOLERANCE: f64 = 0.25;
/// The same over a sheet that is bent in both directions: there the chords of rows and of columns are off by the sum of both.
/// With [`TOLERANCE`] a kidney has an overlap of 0.930, in two figures, for one pole is left over, and not 0.945 in one; with a
/// quarter of it 0.940, and 4 nodes are cut short, not none. Another kidney has 0.956 with any.
const TOLERANCE_OF_BOWLS: f64 = TOLERANCE / 2.0;
/// Share of the places that must be within it: at corners the fits that the fine lattice is made of are rough.
pub(in crate::pipeline) const WITHIN: f64 = 0.95;
/// Distance between nodes at the least, voxels. A fit takes points within five: nearer nodes tell the same twice.
pub(in crate::pipeline) const LEAST_SPACING: f64 = 2.0;
/// Nodes along a side at the most. Smooth organs ask for 35; one that asks for more is rough all over, and its lines are no
/// longer those of a surface: a plate of one voxel across its stairs asks for 626.
pub(in crate::pipeline) const MOST_NODES: usize = 64;

/// The size of the lattice for a chart.
///
/// # Errors
/// When it is cancelled.
pub(super) fn following(chart: &Chart, points: &SheetPoints, context: &Context<'_>) -> Result<LatticeSize, Cancelled> {
    let fine = chart.fine(context)?;
    let map = SpaceFromPlane::of(points).over_holes();
    let nodes = map.rough_nodes(&fine.nodes, context)?;
    let mut layers = [Vec::new(), Vec::new(), Vec::new()];
    for node in &nodes {
        let normal = node.tangents[0].cross(&node.tangents[1]).try_normalize(1e-12).unwrap_or_else(Vector3::zeros);
        for (layer, side) in layers.iter_mut().zip([0.0, 1.0, -1.0]) {
            layer.push(node.position + normal * (side * node.value));
        }
    }
    let LatticeSize { rows, cols } = fine.size;
    let (along, across) = (lines(&layers, [rows, cols, 1]), lines(&layers, [cols, rows, cols]));
    let tolerance = if points.is_unrolled { TOLERANCE_OF_BOWLS } else { TOLERANCE };
    Ok(LatticeSize {
        rows: fewest(&across, cols, LEAST_SIZE.rows, tolerance),
        cols: fewest(&along, rows, LEAST_SIZE.cols, tolerance),
    })
}

/// The lines of all layers, the sheet's first: `count` of them, each of `length` nodes that lie `step` apart in their order.
fn lines(layers: &[Vec<Point3<f64>>; 3], [count, length, step]: [usize; 3]) -> Vec<Polyline<3>> {
    let mut lines = Vec::new();
    for layer in layers {
        for line in 0..count {
            let first = if step == 1 { line * length } else { line };
            lines.push(Polyline::open((0..length).map(|n| layer[first + n * step].coords).collect()));
        }
    }
    lines
}

/// The fewest nodes, from `least` on, whose chords follow all lines, and the sheet's rim: the first and the last of its
/// `count` lines. No more than the points carry.
fn fewest(lines: &[Polyline<3>], count: usize, least: usize, tolerance: f64) -> usize {
    let all: Vec<&Polyline<3>> = lines.iter().collect();
    let most = (floor_index(longest(lines) / LEAST_SPACING) + 1).min(MOST_NODES);
    fewest_nodes(&[&all, &[all[0], all[count - 1]]], [least, most, 1], (tolerance, WITHIN))
}
