//! NIfTI files byte by byte, so that every field can be wrong.

use std::io::Write;

use flate2::Compression;
use flate2::write::GzEncoder;

/// The fields of a file; [`Nifti::bytes`] writes them as they stand, checked by nobody.
#[derive(Clone, Debug)]
pub struct Nifti {
    pub version: u8,
    pub big_endian: bool,
    pub magic: Vec<u8>,
    pub dim: [i64; 8],
    pub datatype: i16,
    pub bitpix: i16,
    pub pixdim: [f64; 8],
    pub vox_offset: f64,
    pub scl_slope: f64,
    pub scl_inter: f64,
    pub xyzt_units: u8,
    pub qform_code: i16,
    pub sform_code: i16,
    pub quatern: [f64; 3],
    pub qoffset: [f64; 3],
    pub srow: [[f64; 4]; 3],
    /// Between header and voxels.
    pub extension: Vec<u8>,
    /// As stored.
    pub voxels: Vec<u8>,
}

/// Header and extension flag of a version.
fn first_offset(version: u8) -> f64 {
    if version == 1 { 352.0 } else { 544.0 }
}

impl Nifti {
    /// A good uint8 file of 4 × 3 × 2 voxels with the values 0 to 23, spacing 1 × 2 × 3 mm.
    pub fn small(version: u8) -> Self {
        let magic: &[u8] = if version == 1 { b"n+1\0" } else { b"n+2\0\r\n\x1a\n" };
        Self {
            version,
            big_endian: false,
            magic: magic.to_vec(),
            dim: [3, 4, 3, 2, 1, 1, 1, 1],
            datatype: 2,
            bitpix: 8,
            pixdim: [1.0, 1.0, 2.0, 3.0, 0.0, 0.0, 0.0, 0.0],
            vox_offset: first_offset(version),
            scl_slope: 0.0,
            scl_inter: 0.0,
            xyzt_units: 2,
            qform_code: 0,
            sform_code: 1,
            quatern: [0.0; 3],
            qoffset: [0.0; 3],
            srow: [[1.0, 0.0, 0.0, -10.0], [0.0, 2.0, 0.0, -20.0], [0.0, 0.0, 3.0, -30.0]],
            extension: vec![0; 4],
            voxels: (0..24).collect(),
        }
    }

    /// With records of a code and a content each between header and voxels.
    pub fn with_extensions(self, records: &[(i32, &str)]) -> Self {
        let mut extension = vec![1, 0, 0, 0];
        for (code, content) in records {
            // A whole number of 16 bytes.
            let size = (8 + content.len()).next_multiple_of(16);
            let start = extension.len();
            let mut head = Fields { bytes: vec![0; 8], big_endian: self.big_endian };
            head.put(0, i32::try_from(size).unwrap().to_le_bytes());
            head.put(4, code.to_le_bytes());
            extension.extend(head.bytes);
            extension.extend(content.as_bytes());
            extension.resize(start + size, 0);
        }
        let vox_offset = first_offset(self.version) - 4.0 + extension.len() as f64;
        Self { extension, vox_offset, ..self }
    }

    pub fn bytes(&self) -> Vec<u8> {
        let mut bytes = if self.version == 1 { self.header_1() } else { self.header_2() };
        bytes.extend(&self.extension);
        bytes.extend(&self.voxels);
        bytes
    }

    #[allow(clippy::cast_possible_truncation, reason = "NIfTI-1 has narrower fields")]
    fn header_1(&self) -> Vec<u8> {
        let mut out = Fields { bytes: vec![0; 348], big_endian: self.big_endian };
        out.put(0, 348_i32.to_le_bytes());
        for n in 0..8 {
            out.put(40 + 2 * n, (self.dim[n] as i16).to_le_bytes());
            out.put(76 + 4 * n, (self.pixdim[n] as f32).to_le_bytes());
        }
        out.put(70, self.datatype.to_le_bytes());
        out.put(72, self.bitpix.to_le_bytes());
        out.put(108, (self.vox_offset as f32).to_le_bytes());
        out.put(112, (self.scl_slope as f32).to_le_bytes());
        out.put(116, (self.scl_inter as f32).to_le_bytes());
        out.put(123, [self.xyzt_units]);
        out.put(252, self.qform_code.to_le_bytes());
        out.put(254, self.sform_code.to_le_bytes());
        for n in 0..3 {
            out.put(256 + 4 * n, (self.quatern[n] as f32).to_le_bytes());
            out.put(268 + 4 * n, (self.qoffset[n] as f32).to_le_bytes());
            for c in 0..4 {
                out.put(280 + 16 * n + 4 * c, (self.srow[n][c] as f32).to_le_bytes());
            }
        }
        out.bytes[344..348].copy_from_slice(&self.magic);
        out.bytes
    }

    #[allow(clippy::cast_possible_truncation, reason = "saturates, which is wanted")]
    fn header_2(&self) -> Vec<u8> {
        let mut out = Fields { bytes: vec![0; 540], big_endian: self.big_endian };
        out.put(0, 540_i32.to_le_bytes());
        out.bytes[4..12].copy_from_slice(&self.magic);
        out.put(12, self.datatype.to_le_bytes());
        out.put(14, self.bitpix.to_le_bytes());
        for n in 0..8 {
            out.put(16 + 8 * n, self.dim[n].to_le_bytes());
            out.put(104 + 8 * n, self.pixdim[n].to_le_bytes());
        }
        out.put(168, (self.vox_offset as i64).to_le_bytes());
        out.put(176, self.scl_slope.to_le_bytes());
        out.put(184, self.scl_inter.to_le_bytes());
        out.put(500, i32::from(self.xyzt_units).to_le_bytes());
        out.put(344, i32::from(self.qform_code).to_le_bytes());
        out.put(348, i32::from(self.sform_code).to_le_bytes());
        for n in 0..3 {
            out.put(352 + 8 * n, self.quatern[n].to_le_bytes());
            out.put(376 + 8 * n, self.qoffset[n].to_le_bytes());
            for c in 0..4 {
                out.put(400 + 32 * n + 8 * c, self.srow[n][c].to_le_bytes());
            }
        }
        out.bytes
    }
}

struct Fields {
    bytes: Vec<u8>,
    big_endian: bool,
}

impl Fields {
    fn put<const N: usize>(&mut self, offset: usize, mut field: [u8; N]) {
        if self.big_endian {
            field.reverse();
        }
        self.bytes[offset..offset + N].copy_from_slice(&field);
    }
}

/// One gzip member.
pub fn gzip(bytes: &[u8]) -> Vec<u8> {
    let mut encoder = GzEncoder::new(Vec::new(), Compression::fast());
    encoder.write_all(bytes).unwrap();
    encoder.finish().unwrap()
}
