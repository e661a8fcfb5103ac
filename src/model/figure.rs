//! One single sheet with its two sides, sampled on a lattice.

use super::choices::Automatic;
use super::frame::FrameFacts;
use super::grid::LatticeSize;
use super::quality::FigureQuality;
use super::side::PerSurface;
use super::uncertainty::Uncertainty;
use crate::space::{ParamPoint, WorldPoint, WorldVector};

/// The points of one surface and where ISOMAP put them.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct FlatPoints {
    /// World positions, mm.
    pub positions: Vec<WorldPoint>,
    /// Intrinsic coordinates, mm, one per position.
    pub flat: Vec<ParamPoint>,
}

/// One single sheet and its two sides, sampled on an N × M lattice.
#[derive(Clone, Debug, Default)]
pub struct Figure {
    /// Lattice size; all node arrays hold rows · cols entries, row-major (i slow).
    pub grid: LatticeSize,
    /// Medial nodes.
    pub medial: Vec<WorldPoint>,
    /// Upper nodes.
    pub upper: Vec<WorldPoint>,
    /// Lower nodes.
    pub lower: Vec<WorldPoint>,
    /// Crest points, one per node of the lattice edge in the order of [`ring`].
    pub crest: Vec<WorldPoint>,
    /// Whether a node lies on the sheet (always, for the fitted lattice).
    pub valid: Vec<bool>,
    /// Radius of the largest ball inside the object centred at a medial node, mm.
    pub medial_radius_mm: Vec<f64>,
    /// Natural logarithm of (share of the medial sheet's area in space) / (share in the intrinsic
    /// plane) of the quads round each node; not a number for a node without a quad.
    pub area_distortion: Vec<f64>,
    /// Intrinsic coordinates of the nodes on each surface.
    pub intrinsic: PerSurface<Vec<ParamPoint>>,
    /// Neighbours per point of the neighbourhood graph, the mean where it varies; `None` of a side that takes its
    /// coordinates from the sheet.
    pub neighbors: PerSurface<Option<f64>>,
    /// Landmarks used on each surface; 0 of such a side.
    pub landmarks: PerSurface<usize>,
    /// All points of each surface with their flat coordinates.
    pub points: PerSurface<FlatPoints>,
    /// How good it is.
    pub quality: FigureQuality,
    /// Which way rows, columns and sides lie in the world.
    pub frame: FrameFacts,
    /// What was chosen for it and why.
    pub automatic: Automatic,
    /// Spread of its thickness, when asked for.
    pub uncertainty: Option<Uncertainty>,
}

impl Figure {
    /// Thickness vectors to the upper side.
    #[must_use]
    pub fn upper_vectors(&self) -> Vec<WorldVector> {
        vectors(&self.medial, &self.upper)
    }

    /// Thickness vectors to the lower side.
    #[must_use]
    pub fn lower_vectors(&self) -> Vec<WorldVector> {
        vectors(&self.medial, &self.lower)
    }
}

fn vectors(from: &[WorldPoint], to: &[WorldPoint]) -> Vec<WorldVector> {
    from.iter().zip(to).map(|(a, b)| b - a).collect()
}
