//! The NIfTI header: both versions into one plain struct.

use nifti::NiftiHeader;

use super::kind::{Kind, Version};
use crate::formats::read::error::ReadError;
use crate::formats::read::stored::ByteOrder;

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
        // Magic and length were looked at, so that it has nothing to refuse.
        let short = |_| ReadError::Truncated { expected: 348, got: bytes.len() as u64 };
        let header = NiftiHeader::from_reader(bytes).map_err(short)?;
        if header.sizeof_hdr != 348 {
            let got = f64::from(header.sizeof_hdr);
            return Err(ReadError::BadHeaderField { field: "sizeof_hdr", got, allowed: "348" });
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

/// The number of dimensions.
pub(super) fn check_rank(rank: i64) -> Result<usize, ReadError> {
    match usize::try_from(rank) {
        Ok(rank @ 1..=7) => Ok(rank),
        _ => Err(ReadError::BadDimensions { axis: 0, got: rank, allowed: "1 to 7 (the number of dimensions)" }),
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
