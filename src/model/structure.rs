//! A whole result, and one label's part of it.

use super::figure::Figure;
use super::meshes::TriangleMesh;
use super::quality::StructureQuality;
use super::refusal::Refusal;
use super::stage::StageTimings;
use super::warning::Warning;
use crate::params::CheckedParams;
use crate::space::{WorldFromVoxel, WorldPoint};

/// Where sheets meet (a hinge).
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Junction {
    /// Indices of the figures that meet.
    pub figures: Vec<usize>,
    /// Points of the hinge.
    pub points: Vec<WorldPoint>,
}

/// One label's result.
#[derive(Clone, Debug)]
pub struct Structure {
    /// Its value in the file.
    pub label: i64,
    /// Voxels with that value.
    pub voxels: u64,
    /// Their volume.
    pub volume_mm3: f64,
    /// Edge of the isotropic working voxel, mm.
    pub working_voxel_mm: f64,
    /// The sheets, the largest first; empty when refused.
    pub figures: Vec<Figure>,
    /// Where they meet.
    pub junctions: Vec<Junction>,
    /// Sheets of the skeleton that were pruned.
    pub pruned: usize,
    /// How good it is.
    pub quality: StructureQuality,
    /// What its reader should know.
    pub warnings: Vec<Warning>,
    /// Why there is no medial representation.
    pub refusal: Option<Refusal>,
    /// The smooth outer surface of the mask.
    pub object: TriangleMesh,
    /// Wall time of each stage.
    pub timings: StageTimings,
}

/// A whole result: one structure per label.
#[derive(Clone, Debug)]
pub struct Model {
    /// The parameters used.
    pub params: CheckedParams,
    /// Where the input's voxels lie.
    pub world_from_voxel: WorldFromVoxel,
    /// Voxels of the input along each axis.
    pub dims: [usize; 3],
    /// One per label, ascending, or in the order asked for.
    pub structures: Vec<Structure>,
}
