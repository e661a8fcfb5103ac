//! Where the voxels are and what they are: the header checked field by field, but for the orientation.

use super::header::{RawHeader, check_rank};
use super::kind::{Kind, Version};
use crate::formats::read::error::ReadError;
use crate::formats::read::stored::{Datatype, Layers, Scaling, Stored, voxels_of};

/// Where voxels may start at the latest: extensions of real files hold kilobytes.
const MAX_VOX_OFFSET: f64 = 16_777_216.0;

/// Where the voxels are and what they are, checked.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Layout {
    pub stored: Stored,
    /// Bytes before the first voxel.
    pub offset: u64,
}

impl Layout {
    /// Checks all fields but the orientation.
    pub fn check(raw: &RawHeader, kind: Kind, max_voxels: u64) -> Result<Self, ReadError> {
        let datatype = datatype_of(raw.datatype)?;
        if usize::try_from(raw.bitpix) != Ok(8 * datatype.bytes()) {
            let allowed = "8 times the bytes of the datatype";
            return Err(ReadError::BadHeaderField { field: "bitpix", got: f64::from(raw.bitpix), allowed });
        }
        let dims = check_dims(raw, kind.version)?;
        let too_many = |voxels| ReadError::TooManyVoxels { voxels, allowed: max_voxels };
        let voxels = voxels_of(dims, max_voxels).map_err(too_many)?;
        let offset = check_offset(raw.vox_offset, kind.version)?;
        let (order, scaling, layers) = (kind.order, check_scaling(raw)?, Layers::ONE);
        Ok(Self { stored: Stored { dims, voxels, datatype, order, scaling, layers }, offset })
    }
}

fn datatype_of(code: i32) -> Result<Datatype, ReadError> {
    let name = match code {
        2 => return Ok(Datatype::Uint8),
        4 => return Ok(Datatype::Int16),
        8 => return Ok(Datatype::Int32),
        16 => return Ok(Datatype::Float32),
        64 => return Ok(Datatype::Float64),
        256 => return Ok(Datatype::Int8),
        512 => return Ok(Datatype::Uint16),
        768 => return Ok(Datatype::Uint32),
        1024 => return Ok(Datatype::Int64),
        1280 => return Ok(Datatype::Uint64),
        1 => "one bit",
        32 => "complex64",
        128 => "RGB",
        1536 => "float128",
        1792 => "complex128",
        2048 => "complex256",
        2304 => "RGBA",
        _ => "unknown",
    };
    Err(ReadError::UnsupportedDatatype { code, name })
}

/// The three lengths; a plane is a volume of one slice. Trailing dimensions of 0 or 1 are both
/// met in real files and mean one volume.
fn check_dims(raw: &RawHeader, version: Version) -> Result<[usize; 3], ReadError> {
    let rank = check_rank(raw.dim[0])?;
    let (longest, allowed) = match version {
        Version::Nifti1 => (32_767, "1 to 32767"),
        Version::Nifti2 => (1 << 31, "1 to 2147483648"),
    };
    let mut dims = [1; 3];
    for axis in 1..=rank {
        let got = raw.dim[axis];
        match axis {
            1..=3 if (1..=longest).contains(&got) => {
                dims[axis - 1] = usize::try_from(got).map_err(|_| ReadError::BadDimensions { axis, got, allowed })?;
            }
            1..=3 => return Err(ReadError::BadDimensions { axis, got, allowed }),
            _ if got > 1 => return Err(ReadError::SeveralVolumes { axis, count: got }),
            _ if got < 0 => return Err(ReadError::BadDimensions { axis, got, allowed: "0 or 1" }),
            _ => {}
        }
    }
    Ok(dims)
}

/// Some writers leave 0 for a single file, meaning right after the header and its four
/// extension bytes.
fn check_offset(vox_offset: f64, version: Version) -> Result<u64, ReadError> {
    let (first, allowed) = match version {
        Version::Nifti1 => (352.0, "0, or a whole number from 352 to 16777216"),
        Version::Nifti2 => (544.0, "0, or a whole number from 544 to 16777216"),
    };
    let offset = if vox_offset == 0.0 { first } else { vox_offset };
    if !(first..=MAX_VOX_OFFSET).contains(&offset) || offset.fract() != 0.0 {
        return Err(ReadError::BadHeaderField { field: "vox_offset", got: vox_offset, allowed });
    }
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "checked to be whole and in range")]
    let offset = offset as u64;
    Ok(offset)
}

/// A slope of 0 or NaN means that values are not scaled.
fn check_scaling(raw: &RawHeader) -> Result<Option<Scaling>, ReadError> {
    let (slope, intercept) = (raw.scl_slope, raw.scl_inter);
    if slope == 0.0 || slope.is_nan() || (slope == 1.0 && intercept == 0.0) {
        return Ok(None);
    }
    for (field, got) in [("scl_slope", slope), ("scl_inter", intercept)] {
        if !got.is_finite() {
            return Err(ReadError::BadHeaderField { field, got, allowed: "a finite number" });
        }
    }
    Ok(Some(Scaling { slope, intercept }))
}
