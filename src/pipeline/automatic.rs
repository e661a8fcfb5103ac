//! What was chosen where the user left the choice to the program, and from what.

use super::isomap::{AUTO_RADIUS, Flat};
use super::lattice::Lattice;
use super::model::PerSurface;
use super::outline::Region;
use super::params::{CheckedParams, GridChoice, LATTICE_SIDE, LatticeSize, Neighbors};
use crate::numerics::field::floor_index;

/// Nodes of an automatic lattice without a spacing: the paper's 6 × 8 and a little more.
const NODES: f64 = 64.0;

/// Where the size of a lattice comes from.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum GridFrom {
    /// The parameter `grid`.
    #[default]
    Asked,
    /// The parameter `spacing_mm` and the sheet's extents.
    Spacing,
    /// The sheet's extents alone: about [`NODES`] nodes, as far apart along rows as along columns.
    Size,
}

impl GridFrom {
    /// Stable name.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Asked => "asked",
            Self::Spacing => "spacing_mm",
            Self::Size => "size",
        }
    }
}

/// The choices for one figure with what speaks for them.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Automatic {
    /// Radius of the neighbourhood, mm; none where a number of neighbours was asked for.
    pub neighborhood_mm: Option<f64>,
    /// The same in words.
    pub neighborhood: String,
    /// Pieces that each neighbourhood graph fell into before touching points joined them; 1 when
    /// the neighbourhood was large enough.
    pub graph_pieces: PerSurface<usize>,
    /// Where the lattice's size comes from.
    pub grid_from: GridFrom,
    /// Longer side of the rectangle with the flattened sheet's second moments, mm.
    pub length_mm: f64,
    /// Its shorter side.
    pub width_mm: f64,
}

/// The lattice for a sheet and the evidence for all choices.
#[must_use]
pub fn automatic(
    params: &CheckedParams,
    flat: &PerSurface<Flat>,
    region: &Region,
    voxel_mm: f64,
) -> (LatticeSize, Automatic) {
    // The side of a rectangle is √12 times its root second moment.
    let [length_mm, width_mm] = region.principal_axes().1.map(|e| (e * 12.0f64.sqrt()).max(1.0) * voxel_mm);
    let (size, grid_from) = match (params.grid, params.spacing_mm) {
        (GridChoice::Fixed(size), _) => (size, GridFrom::Asked),
        (GridChoice::Auto, Some(spacing)) => (spaced([length_mm, width_mm], params.margin, spacing), GridFrom::Spacing),
        (GridChoice::Auto, None) => {
            let spacing = (length_mm * width_mm / NODES).sqrt();
            (spaced([length_mm, width_mm], 0.0, spacing), GridFrom::Size)
        }
    };
    let (neighborhood_mm, neighborhood) = match params.neighbors {
        Neighbors::Auto => (Some(AUTO_RADIUS * voxel_mm), format!("ball of {AUTO_RADIUS} voxels")),
        Neighbors::RadiusMm(radius) => (Some(radius), format!("ball of {radius} mm, as asked")),
        Neighbors::Count(k) => (None, format!("{k} nearest, as asked")),
    };
    let graph_pieces = PerSurface { medial: flat.medial.pieces, upper: flat.upper.pieces, lower: flat.lower.pieces };
    let facts = Automatic { neighborhood_mm, neighborhood, graph_pieces, grid_from, length_mm, width_mm };
    (size, facts)
}

/// Lattice whose nodes are `spacing` apart on what the margin leaves of a rectangle.
fn spaced([length, width]: [f64; 2], margin: f64, spacing: f64) -> LatticeSize {
    let left = 1.0 - 2.0 * margin;
    LatticeSize { rows: nodes_on(width * left, spacing), cols: nodes_on(length * left, spacing) }
}

/// Nodes that are nearest to `spacing` apart on a line.
fn nodes_on(length: f64, spacing: f64) -> usize {
    (floor_index(length / spacing + 0.5) + 1).clamp(*LATTICE_SIDE.start(), *LATTICE_SIDE.end())
}

/// The size at which the nodes of a lattice are `spacing` voxels apart in the mean: lines of a sheet
/// that is no rectangle are longer or shorter than its moments tell.
#[must_use]
pub fn respaced(lattice: &Lattice, spacing: f64) -> LatticeSize {
    let LatticeSize { rows, cols } = lattice.size;
    let step = |a: usize, b: usize| (lattice.nodes[a] - lattice.nodes[b]).norm();
    let along: f64 = (0..rows * cols).filter(|n| n % cols + 1 < cols).map(|n| step(n, n + 1)).sum();
    let across: f64 = (0..(rows - 1) * cols).map(|n| step(n, n + cols)).sum();
    LatticeSize { rows: nodes_on(across / cols as f64, spacing), cols: nodes_on(along / rows as f64, spacing) }
}
