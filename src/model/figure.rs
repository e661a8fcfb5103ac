//! A figure: a part of an organ that is represented by itself.

use serde::{Deserialize, Serialize};

use super::automatic::Automatic;
use super::frame::FrameFacts;
use super::lattice::{LatticeSize, ring};
use super::quality::{FigureQuality, NodeRepair};
use super::shell::{Flanks, Shell};
use super::side::{PerSurface, Side};
use super::tube::Tube;
use super::uncertainty::Uncertainty;
use crate::space::{ParamPoint, WorldPoint, WorldVector};

/// A part of an organ that is represented by itself, of one of several kinds.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
#[expect(clippy::large_enum_variant, reason = "a structure has a few")]
pub enum Figure {
    /// A single medial sheet with its two sides.
    Sheet(Sheet),
    /// A centreline with the wall round it.
    Tube(Tube),
}

/// One single sheet and its two sides, sampled on an N × M lattice (sections 2.3 to 4 of the paper).
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub struct Sheet {
    /// Lattice size; all node arrays hold rows · cols entries, row-major (i slow).
    pub grid: LatticeSize,
    /// Medial nodes.
    pub medial: Vec<WorldPoint>,
    /// Upper nodes.
    pub upper: Vec<WorldPoint>,
    /// Lower nodes.
    pub lower: Vec<WorldPoint>,
    /// Crest points, one per node of the lattice edge in the order of [`ring`](super::ring).
    pub crest: Vec<WorldPoint>,
    /// The flanks of the arc through each.
    pub flanks: Vec<Flanks>,
    /// Whether a node lies on the sheet (always, for the fitted lattice).
    pub valid: Vec<bool>,
    /// What was done to each node so that no vectors cross.
    pub repaired: Vec<Option<NodeRepair>>,
    /// Radius of the largest ball inside the object centred at a medial node, mm.
    pub medial_radius_mm: Vec<f64>,
    /// Natural logarithm of (share of the medial sheet's area in space) / (share in the intrinsic
    /// plane) of the quads round each node; `None` for a node without a quad.
    pub area_distortion: Vec<Option<f64>>,
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
    /// Which part of the structure it belongs to.
    #[serde(default)]
    pub part: usize,
}

/// The points of one surface and where it was laid flat.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct FlatPoints {
    /// World positions, mm.
    pub positions: Vec<WorldPoint>,
    /// Intrinsic coordinates, mm, one per position.
    pub flat: Vec<ParamPoint>,
}

impl Figure {
    /// Its lattice.
    #[must_use]
    pub fn grid(&self) -> LatticeSize {
        match self {
            Self::Sheet(sheet) => sheet.grid,
            Self::Tube(tube) => tube.grid,
        }
    }

    /// The sheet that it is.
    #[must_use]
    pub fn as_sheet(&self) -> Option<&Sheet> {
        match self {
            Self::Sheet(sheet) => Some(sheet),
            Self::Tube(_) => None,
        }
    }

    /// The tube that it is.
    #[must_use]
    pub fn as_tube(&self) -> Option<&Tube> {
        match self {
            Self::Sheet(_) => None,
            Self::Tube(tube) => Some(tube),
        }
    }

    /// Which part of the structure it belongs to.
    #[must_use]
    pub fn part(&self) -> usize {
        match self {
            Self::Sheet(sheet) => sheet.part,
            Self::Tube(tube) => tube.part,
        }
    }

    /// How good it is.
    #[must_use]
    pub fn quality(&self) -> &FigureQuality {
        match self {
            Self::Sheet(sheet) => &sheet.quality,
            Self::Tube(tube) => &tube.quality,
        }
    }
}

impl Sheet {
    /// Nodes of a side.
    #[must_use]
    pub fn side(&self, side: Side) -> &[WorldPoint] {
        match side {
            Side::Upper => &self.upper,
            Side::Lower => &self.lower,
        }
    }

    /// The arc over each crest point, in their order: the points on the way from the upper to the lower node,
    /// these two not among them. The one in the middle is the crest point.
    #[must_use]
    pub fn crest_arcs(&self) -> Vec<Vec<WorldPoint>> {
        let mut arcs = Vec::with_capacity(self.flanks.len());
        for (place, node) in ring(self.grid).into_iter().enumerate() {
            let arc = Shell::from(self).arc(place, node);
            arcs.push(arc[1..arc.len() - 1].to_vec());
        }
        arcs
    }

    /// Thickness vectors to a side: from each medial node to the corresponding node of the side.
    #[must_use]
    pub fn vectors(&self, side: Side) -> Vec<WorldVector> {
        self.medial.iter().zip(self.side(side)).map(|(from, to)| to - from).collect()
    }

    /// Lengths of the thickness vectors to a side, mm: the paper's thickness.
    #[must_use]
    pub fn lengths_mm(&self, side: Side) -> Vec<f64> {
        self.vectors(side).iter().map(WorldVector::norm).collect()
    }

    /// Sum of both lengths at each node, mm.
    #[must_use]
    pub fn total_mm(&self) -> Vec<f64> {
        let (upper, lower) = (self.lengths_mm(Side::Upper), self.lengths_mm(Side::Lower));
        upper.iter().zip(&lower).map(|(upper, lower)| upper + lower).collect()
    }

    /// Whether a node can be drawn: it lies on the sheet, and its places are finite.
    #[must_use]
    pub fn drawable(&self) -> Vec<bool> {
        let is_finite = |point: &WorldPoint| point.iter().all(|x| x.is_finite());
        let mut drawable = self.valid.clone();
        for (node, is_drawable) in drawable.iter_mut().enumerate() {
            let places = [&self.medial[node], &self.upper[node], &self.lower[node]];
            *is_drawable &= places.into_iter().all(is_finite);
        }
        drawable
    }
}
