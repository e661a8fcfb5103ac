//! How many nodes a tube has, around and along.

use super::wall::Laying;
use crate::cancel::Cancelled;
use crate::model::{GridFrom, LatticeSize};
use crate::numerics::field::floor_index;
use crate::numerics::polyline::{Polyline, fewest_nodes, longest};
use crate::params::GridChoice;
use crate::pipeline::context::Context;
use crate::pipeline::lattice::chords::{LEAST_SPACING, MOST_NODES, TOLERANCE, WITHIN};
use crate::pipeline::lattice::size::nodes_on;

/// The wall that is looked at for the size of another.
const FINE: LatticeSize = LatticeSize { rows: 48, cols: 24 };
/// Nodes around at the least, and along: fewer are no wall.
const LEAST: LatticeSize = LatticeSize { rows: 12, cols: 8 };
/// Nodes along at the most: a gut of nine haustra takes 80.
const MOST_ALONG: usize = 128;
/// Nodes around with `spacing_mm` at the least: with fewer, none are opposite.
const LEAST_ROWS: usize = 4;

/// How many nodes around and along; `None` when there is no wall.
///
/// # Errors
/// When it is cancelled.
pub(super) fn size(
    laying: &Laying<'_>,
    number: usize,
    context: &Context<'_>,
) -> Result<Option<(LatticeSize, GridFrom)>, Cancelled> {
    let params = context.params;
    if let Some(size) = context.repeated_size(number) {
        return Ok(Some((size, GridFrom::Shape)));
    }
    Ok(match (params.grid, params.spacing_mm) {
        (GridChoice::Fixed { rows, cols }, _) => Some((LatticeSize { rows, cols }, GridFrom::Asked)),
        (GridChoice::Auto, Some(spacing_mm)) => {
            let spacing = spacing_mm / laying.solid.unit_mm;
            // As many on either half of a section, so that each has one opposite.
            let half = std::f64::consts::PI * laying.radius;
            let rows = (2 * (nodes_on(half, spacing) - 1)).max(LEAST_ROWS);
            let cols = nodes_on(laying.line.length(), spacing);
            Some((LatticeSize { rows, cols }, GridFrom::Spacing))
        }
        (GridChoice::Auto, None) => following(laying, context)?.map(|size| (size, GridFrom::Shape)),
    })
}

/// As few nodes as leave chords between them within a tolerance of a finer wall: along from tip to tip, and around.
fn following(laying: &Laying<'_>, context: &Context<'_>) -> Result<Option<LatticeSize>, Cancelled> {
    let most_on = |length: f64| floor_index(length / LEAST_SPACING) + 1;
    let cols = most_on(2.0 * laying.line.length()).clamp(FINE.cols, MOST_ALONG);
    let fine = LatticeSize { cols, ..FINE };
    let Some((nodes, _)) = laying.nodes(fine, context)? else { return Ok(None) };
    let (mut along, mut around) = (Vec::with_capacity(fine.rows), Vec::with_capacity(fine.cols));
    // The ends of a line are nodes of their own: the tips, or the first row again.
    let tips = if nodes.is_ring() { 0 } else { 2 };
    for row in 0..fine.rows {
        let mut line: Vec<_> = (0..fine.cols).map(|col| nodes.wall_at(row, col).coords).collect();
        if tips > 0 {
            line.insert(0, nodes.tips[0].coords);
            line.push(nodes.tips[1].coords);
        }
        along.push(Polyline::open(line));
    }
    for col in 0..fine.cols {
        around.push(Polyline::closed(nodes.ring(col).iter().map(|wall| wall.coords).collect()));
    }
    let fewest = |lines: &[Polyline<3>], [least, most, step]: [usize; 3]| {
        let all: Vec<&Polyline<3>> = lines.iter().collect();
        let most = most_on(longest(lines)).min(most);
        fewest_nodes(&[&all], [least, most, step], (TOLERANCE, WITHIN))
    };
    let cols = fewest(&along, [LEAST.cols + tips, MOST_ALONG + tips, 1]) - tips;
    let rows = fewest(&around, [LEAST.rows + 1, MOST_NODES + 1, 2]) - 1;
    Ok(Some(LatticeSize { rows, cols }))
}
