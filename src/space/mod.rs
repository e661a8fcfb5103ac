//! Where things are: the names of points in world and plane, the affine between voxels and the
//! world, dense grids, and lengths in words. Knows no anatomy and no file format.

mod affine;

mod grid;

mod told;

mod volume;

pub use affine::{AffineError, VoxelFromVoxel, WorldFromVoxel};
pub use grid::{Grid, VoxelIndex};
pub use told::{rounded_up, significant};
pub(crate) use volume::ascending;
pub use volume::{Label, LabelCode, LabelVolume, LabelVolumeError, VolumeNotice};

/// A point in NIfTI world space: millimetres, RAS+ (x to the patient's right, y anterior,
/// z superior).
pub type WorldPoint = nalgebra::Point3<f64>;

/// A displacement in world space, millimetres.
pub type WorldVector = nalgebra::Vector3<f64>;

/// A point of a flattened sheet: intrinsic coordinates `(u, v)` in millimetres.
pub type ParamPoint = nalgebra::Point2<f64>;
