//! A figure on its way through the stages, in work space.

use super::plane::Flat;
use super::plane::tangents::PlaneDistortion;
use super::vectors::Nodes;
use crate::model::{Automatic, FrameFacts, PerSurface, Repair};

/// Its nodes and its flattened surfaces.
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
}
