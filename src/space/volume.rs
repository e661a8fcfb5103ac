//! A label map in world space: what every format is read into.

use super::{Grid, WorldFromVoxel};

/// Something about a file that is not an error but that its user should know.
#[derive(Clone, Debug, PartialEq)]
pub struct VolumeNotice {
    /// Stable code, snake case.
    pub code: &'static str,
    /// One sentence.
    pub message: String,
}

/// A label map. Voxels hold an index into `label_values`, so that any label value costs two
/// bytes a voxel.
#[derive(Clone, Debug)]
pub struct LabelVolume {
    /// Index into `label_values` per voxel.
    pub indices: Grid<u16>,
    /// The label of each index; entry 0 is the background and always 0, the rest ascends.
    pub label_values: Vec<i64>,
    /// Voxels of each label, in the order of `label_values`.
    pub label_voxels: Vec<u64>,
    /// Where the voxels lie.
    pub world_from_voxel: WorldFromVoxel,
    /// What was noticed while reading.
    pub notices: Vec<VolumeNotice>,
}
