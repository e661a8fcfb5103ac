//! The NIfTI header: both versions into one plain struct, then checked field by field.

use nifti::NiftiHeader;

use super::read_error::ReadError;
use super::sniff::{ByteOrder, Kind, Version};

/// Where voxels may start at the latest: extensions of real files hold kilobytes.
const MAX_VOX_OFFSET: f64 = 16_777_216.0;

/// The fields of either version that matter here, not yet checked.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct RawHeader {
    pub dim: [i64; 8],
    pub datatype: i32,
    pub bitpix: i32,
    pub pixdim: [f64; 8],
    pub vox_offset: f64,
    pub scl_slope: f64,
    pub scl_inter: f64,
    pub space_unit: u8,
    pub qform_code: i32,
    pub sform_code: i32,
    pub quatern: [f64; 3],
    pub qoffset: [f64; 3],
    pub srow: [[f64; 4]; 3],
}

impl RawHeader {
    /// From the bytes of a header of that kind, at least [`Version::header_bytes`] of them.
    pub fn parse(bytes: &[u8], kind: Kind) -> Result<Self, ReadError> {
        match kind.version {
            Version::Nifti1 => Self::parse_1(bytes, kind),
            Version::Nifti2 => Ok(Self::parse_2(bytes, kind)),
        }
    }

    /// The nifti crate takes the byte order from `dim[0]`, we from the size field; where they
    /// differ the header is damaged.
    fn parse_1(bytes: &[u8], kind: Kind) -> Result<Self, ReadError> {
        let rank_bytes = [bytes[40], bytes[41]];
        let rank = match kind.order {
            ByteOrder::Little => i16::from_le_bytes(rank_bytes),
            ByteOrder::Big => i16::from_be_bytes(rank_bytes),
        };
        check_rank(i64::from(rank))?;
        let header = NiftiHeader::from_reader(bytes).map_err(|_| ReadError::NotNifti { looks_like: None })?;
        if header.sizeof_hdr != 348 {
            return Err(ReadError::NotNifti { looks_like: None });
        }
        let row = |row: [f32; 4]| row.map(f64::from);
        Ok(Self {
            // The crate reads lengths as unsigned; the standard says signed.
            dim: header.dim.map(|n| i64::from(n.cast_signed())),
            datatype: i32::from(header.datatype),
            bitpix: i32::from(header.bitpix),
            pixdim: header.pixdim.map(f64::from),
            vox_offset: f64::from(header.vox_offset),
            scl_slope: f64::from(header.scl_slope),
            scl_inter: f64::from(header.scl_inter),
            space_unit: header.xyzt_units & 7,
            qform_code: i32::from(header.qform_code),
            sform_code: i32::from(header.sform_code),
            quatern: [header.quatern_b, header.quatern_c, header.quatern_d].map(f64::from),
            qoffset: [header.quatern_x, header.quatern_y, header.quatern_z].map(f64::from),
            srow: [row(header.srow_x), row(header.srow_y), row(header.srow_z)],
        })
    }

    /// Offsets of nifti2.h.
    #[allow(clippy::cast_precision_loss, reason = "an offset beyond 2^53 is refused all the same")]
    fn parse_2(bytes: &[u8], kind: Kind) -> Self {
        let fields = Fields { bytes, order: kind.order };
        Self {
            dim: std::array::from_fn(|n| fields.int64(16 + 8 * n)),
            datatype: i32::from(fields.int16(12)),
            bitpix: i32::from(fields.int16(14)),
            pixdim: std::array::from_fn(|n| fields.float64(104 + 8 * n)),
            vox_offset: fields.int64(168) as f64,
            scl_slope: fields.float64(176),
            scl_inter: fields.float64(184),
            space_unit: (fields.int32(500) & 7).to_le_bytes()[0],
            qform_code: fields.int32(344),
            sform_code: fields.int32(348),
            quatern: std::array::from_fn(|n| fields.float64(352 + 8 * n)),
            qoffset: std::array::from_fn(|n| fields.float64(376 + 8 * n)),
            srow: std::array::from_fn(|r| std::array::from_fn(|c| fields.float64(400 + 32 * r + 8 * c))),
        }
    }
}

struct Fields<'a> {
    bytes: &'a [u8],
    order: ByteOrder,
}

impl Fields<'_> {
    /// The bytes at an offset in little-endian order.
    fn at<const N: usize>(&self, offset: usize) -> [u8; N] {
        let mut field = [0; N];
        field.copy_from_slice(&self.bytes[offset..offset + N]);
        if self.order == ByteOrder::Big {
            field.reverse();
        }
        field
    }

    fn int16(&self, offset: usize) -> i16 {
        i16::from_le_bytes(self.at(offset))
    }

    fn int32(&self, offset: usize) -> i32 {
        i32::from_le_bytes(self.at(offset))
    }

    fn int64(&self, offset: usize) -> i64 {
        i64::from_le_bytes(self.at(offset))
    }

    fn float64(&self, offset: usize) -> f64 {
        f64::from_le_bytes(self.at(offset))
    }
}

/// How voxels are stored.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Datatype {
    Uint8,
    Int8,
    Int16,
    Uint16,
    Int32,
    Uint32,
    Int64,
    Uint64,
    Float32,
    Float64,
}

impl Datatype {
    fn from_code(code: i32) -> Result<Self, ReadError> {
        let name = match code {
            2 => return Ok(Self::Uint8),
            4 => return Ok(Self::Int16),
            8 => return Ok(Self::Int32),
            16 => return Ok(Self::Float32),
            64 => return Ok(Self::Float64),
            256 => return Ok(Self::Int8),
            512 => return Ok(Self::Uint16),
            768 => return Ok(Self::Uint32),
            1024 => return Ok(Self::Int64),
            1280 => return Ok(Self::Uint64),
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

    /// Bytes of a voxel.
    pub fn bytes(self) -> usize {
        match self {
            Self::Uint8 | Self::Int8 => 1,
            Self::Int16 | Self::Uint16 => 2,
            Self::Int32 | Self::Uint32 | Self::Float32 => 4,
            Self::Int64 | Self::Uint64 | Self::Float64 => 8,
        }
    }
}

/// Stored values to labels: value = slope · stored + intercept.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Scaling {
    pub slope: f64,
    pub intercept: f64,
}

/// Where the voxels are and what they are, checked.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Layout {
    pub dims: [usize; 3],
    pub voxels: usize,
    pub datatype: Datatype,
    pub order: ByteOrder,
    pub offset: u64,
    pub scaling: Option<Scaling>,
}

impl Layout {
    /// Checks all fields but the orientation.
    pub fn check(raw: &RawHeader, kind: Kind, max_voxels: u64) -> Result<Self, ReadError> {
        let datatype = Datatype::from_code(raw.datatype)?;
        if usize::try_from(raw.bitpix) != Ok(8 * datatype.bytes()) {
            let allowed = "8 times the bytes of the datatype";
            return Err(ReadError::BadHeaderField { field: "bitpix", got: f64::from(raw.bitpix), allowed });
        }
        let dims = check_dims(raw, kind.version)?;
        let product: u128 = dims.iter().map(|n| *n as u128).product();
        let too_many = || ReadError::TooManyVoxels { voxels: product, allowed: max_voxels };
        if product > u128::from(max_voxels) {
            return Err(too_many());
        }
        let voxels = usize::try_from(product).map_err(|_| too_many())?;
        let offset = check_offset(raw.vox_offset, kind.version)?;
        Ok(Self { dims, voxels, datatype, order: kind.order, offset, scaling: check_scaling(raw)? })
    }
}

fn check_rank(rank: i64) -> Result<usize, ReadError> {
    match usize::try_from(rank) {
        Ok(rank @ 1..=7) => Ok(rank),
        _ => Err(ReadError::BadDimensions { axis: 0, got: rank, allowed: "1 to 7 (the number of dimensions)" }),
    }
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
