//! Where voxels lie, whatever the format says it with.

use crate::space::{VolumeNotice, WorldFromVoxel, significant};

/// Voxel edges that make sense for anatomy, mm: finer than any micro-CT, coarser than any scan.
/// Outside them the unit is wrong.
pub(super) const SPACING_MM: std::ops::RangeInclusive<f64> = 1e-4..=1e3;

/// Why a voxel edge is refused.
pub(super) fn bad_spacing(spacing_mm: f64) -> String {
    format!("a voxel edge is {} mm, allowed is 0.0001 to 1000", significant(spacing_mm))
}

/// From the upper three rows of a homogeneous matrix, RAS+ in millimetres.
///
/// # Errors
/// What is wrong with it, in words.
pub(super) fn checked(rows: [[f64; 4]; 3]) -> Result<WorldFromVoxel, String> {
    let map = WorldFromVoxel::from_rows(rows).map_err(|error| error.to_string())?;
    match map.spacing_mm().into_iter().find(|spacing| !SPACING_MM.contains(spacing)) {
        Some(spacing) => Err(bad_spacing(spacing)),
        None => Ok(map),
    }
}

/// The axes of the world that a format counts along, as signs of those of RAS+.
pub(super) type Signs = [f64; 3];

/// To the left, to the back, upwards: DICOM's and ITK's.
pub(super) const LPS: Signs = [-1.0, -1.0, 1.0];

/// The rows of the matrix with these columns, in a world with these axes.
pub(super) fn rows(axes: [[f64; 3]; 3], origin: [f64; 3], signs: Signs) -> [[f64; 4]; 3] {
    std::array::from_fn(|r| [axes[0][r], axes[1][r], axes[2][r], origin[r]].map(|entry| entry * signs[r]))
}

/// That a header tells the edges of voxels and no more.
pub(super) fn no_orientation(message: &str) -> VolumeNotice {
    VolumeNotice { code: "no_orientation", message: message.to_owned() }
}
