//! A figure on its way through the stages, in work space.

use nalgebra::Point3;

use super::plane::Flat;
use super::plane::embedding::MAX_TURNED_OVER;
use super::plane::tangents::PlaneDistortion;
use super::tubes::TubeDraft;
use super::tubes::legality::legality as tubes_legality;
use super::vectors::Nodes;
use super::vectors::legality::legality as sheets_legality;
use crate::model::{Automatic, Body, FrameFacts, PerSurface, Repair};

/// A figure of any kind.
#[derive(Clone, Copy, Debug)]
pub enum AnyDraft<'a> {
    /// A sheet.
    Sheet(&'a Draft),
    /// A tube.
    Tube(&'a TubeDraft),
}

impl<'a> AnyDraft<'a> {
    /// What its nodes enclose.
    #[must_use]
    pub fn body(self) -> Body<'a> {
        match self {
            Self::Sheet(draft) => Body::Sheet((&draft.nodes).into()),
            Self::Tube(draft) => Body::Tube(draft.into()),
        }
    }

    /// Its thickness vectors, each with its ends.
    #[must_use]
    pub fn vectors(self) -> Vec<[Point3<f64>; 2]> {
        let mut vectors = Vec::new();
        match self {
            Self::Sheet(Draft { nodes, .. }) => {
                for node in (0..nodes.medial.len()).filter(|&node| nodes.valid[node]) {
                    vectors.push([nodes.medial[node], nodes.upper[node]]);
                    vectors.push([nodes.medial[node], nodes.lower[node]]);
                }
            }
            Self::Tube(TubeDraft { nodes, .. }) => {
                for (node, wall) in nodes.wall.iter().enumerate() {
                    vectors.push([nodes.centres[node % nodes.size.cols], *wall]);
                }
            }
        }
        vectors
    }

    /// Whether no part of it is turned over.
    #[must_use]
    pub fn is_legal(self) -> bool {
        match self {
            Self::Sheet(draft) => sheets_legality((&draft.nodes).into()).parts.is_empty(),
            Self::Tube(draft) => tubes_legality(&draft.nodes).wedges.is_empty(),
        }
    }

    /// Whether the plane of its sheet shows its back in more than a little.
    #[must_use]
    pub fn is_turned_over(self) -> bool {
        match self {
            Self::Sheet(draft) => draft.distortion.medial.is_some_and(|plane| plane.turned_over > MAX_TURNED_OVER),
            Self::Tube(_) => false,
        }
    }

    /// What was repaired.
    #[must_use]
    pub fn repair(self) -> &'a Repair {
        match self {
            Self::Sheet(draft) => &draft.repair,
            Self::Tube(draft) => &draft.repair,
        }
    }

    /// What was chosen for it.
    #[must_use]
    pub fn choices(self) -> &'a Automatic {
        match self {
            Self::Sheet(draft) => &draft.choices,
            Self::Tube(draft) => &draft.choices,
        }
    }

    /// Inscribed radii at its nodes.
    #[must_use]
    pub fn radii(self) -> &'a [f64] {
        match self {
            Self::Sheet(draft) => &draft.nodes.radii,
            Self::Tube(draft) => &draft.radii,
        }
    }
}

/// The nodes and flattened surfaces of a sheet.
#[derive(Clone, Debug)]
pub struct Draft {
    /// Nodes of its lattices.
    pub nodes: Nodes,
    /// Its flattened surfaces.
    pub flat: PerSurface<Flat>,
    /// What their planes do to angles and sides.
    pub distortion: PerSurface<Option<PlaneDistortion>>,
    /// Which way it lies in the world.
    pub frame: FrameFacts,
    /// What was chosen for it.
    pub choices: Automatic,
    /// What was repaired.
    pub repair: Repair,
    /// The same on the lattice that is asked for, where this one is only there to choose by.
    pub asked: Option<Box<Self>>,
}

impl Draft {
    /// The sheet on the lattice that is asked for.
    #[must_use]
    pub fn into_asked(mut self) -> Self {
        let Some(asked) = self.asked.take() else { return self };
        let choices = Automatic { kind: self.choices.kind, ..asked.choices };
        Self { choices, ..*asked }
    }
}
