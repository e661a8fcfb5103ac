//! How many rows and columns a lattice gets (section 3 of the paper), and the evidence for it and for what else was
//! chosen.

use super::chords::following;
use crate::cancel::Cancelled;
use crate::model::{Automatic, GridFrom, LatticeSize, PerSurface};
use crate::numerics::field::floor_index;
use crate::params::{CheckedParams, GridChoice, LATTICE_SIDE, Neighbors};
use crate::pipeline::chart::{Chart, Lattice};
use crate::pipeline::context::Context;
use crate::pipeline::plane::strip::SheetPoints;
use crate::pipeline::plane::{AUTO_RADIUS, Flat};

/// The lattice for a sheet and the evidence for all choices.
///
/// # Errors
/// When it is cancelled.
pub(super) fn automatic(
    flat: &PerSurface<Flat>,
    chart: &Chart,
    points: &SheetPoints,
    voxel_mm: f64,
    context: &Context<'_>,
) -> Result<(LatticeSize, Automatic), Cancelled> {
    let params: &CheckedParams = context.params;
    let [length_mm, width_mm] = chart.extents().map(|side| side.max(1.0) * voxel_mm);
    let (size, grid_from) = match (params.grid, params.spacing_mm) {
        (GridChoice::Fixed { rows, cols }, _) => (LatticeSize { rows, cols }, GridFrom::Asked),
        (GridChoice::Auto, Some(spacing)) => {
            (spaced([length_mm, width_mm], params.margin(), spacing), GridFrom::Spacing)
        }
        (GridChoice::Auto, None) => (following(chart, points, context)?, GridFrom::Shape),
    };
    let (neighborhood_mm, neighborhood) = match params.neighbors {
        Neighbors::Auto => (Some(AUTO_RADIUS * voxel_mm), format!("ball of {AUTO_RADIUS} voxels")),
        Neighbors::RadiusMm(radius) => (Some(radius), format!("ball of {radius} mm, as asked")),
        Neighbors::Count(k) => (None, format!("{k} nearest, as asked")),
    };
    let graph_pieces = flat.map(|flat| flat.embedded.map_or(0, |embedded| embedded.pieces));
    let facts = Automatic { neighborhood_mm, neighborhood, graph_pieces, grid_from, length_mm, width_mm, kind: None };
    Ok((size, facts))
}
/// Lattice whose nodes are `spacing` apart on what the margin leaves of a rectangle.
fn spaced([length, width]: [f64; 2], margin: f64, spacing: f64) -> LatticeSize {
    let left = 1.0 - 2.0 * margin;
    LatticeSize { rows: nodes_on(width * left, spacing), cols: nodes_on(length * left, spacing) }
}

/// Nodes that are nearest to `spacing` apart on a line.
pub(in crate::pipeline) fn nodes_on(length: f64, spacing: f64) -> usize {
    (floor_index(length / spacing + 0.5) + 1).clamp(*LATTICE_SIDE.start(), *LATTICE_SIDE.end())
}

/// The size at which the nodes of a lattice are `spacing` voxels apart in the mean: lines of a sheet
/// that is no rectangle are longer or shorter than its moments tell.
#[must_use]
pub fn respaced(lattice: &Lattice, spacing: f64) -> LatticeSize {
    let LatticeSize { rows, cols } = lattice.size;
    let (mut along, mut across) = (0.0f64, 0.0f64);
    for n in 0..rows * cols {
        if n % cols + 1 < cols {
            along += (lattice.nodes[n] - lattice.nodes[n + 1]).norm();
        }
        if n + cols < rows * cols {
            across += (lattice.nodes[n] - lattice.nodes[n + cols]).norm();
        }
    }
    LatticeSize { rows: nodes_on(across / cols as f64, spacing), cols: nodes_on(along / rows as f64, spacing) }
}
