//! What a reader is asked and answers, whatever the format.

use serde::{Deserialize, Serialize};

use super::error::ReadError;
use crate::formats::dicom_origin::DicomOrigin;
use crate::space::LabelVolume;

/// Bounds on what a file may ask of the machine.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct InputLimits {
    /// Voxels of the volume.
    pub max_voxels: u64,
    /// Bytes after decompression.
    pub max_decompressed_bytes: u64,
}

impl Default for InputLimits {
    fn default() -> Self {
        Self { max_voxels: 1 << 29, max_decompressed_bytes: 4 << 30 }
    }
}

/// What a header says of the work that a file is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HeaderFacts {
    /// Voxels of the volume.
    pub voxels: u64,
    /// Edge of a cube with the volume of a voxel, mm.
    pub voxel_mm: f64,
    /// Whether the voxels are compressed in the file.
    pub is_compressed: bool,
}

/// What the first bytes say to a reader.
#[derive(Debug)]
pub(in crate::formats) enum Sniffed {
    /// Another format.
    Other,
    /// Its own.
    Own,
    /// Its own, but no file that can be read.
    Refused(ReadError),
}

/// What a reader makes of a stream.
#[derive(Debug)]
pub(in crate::formats) struct Found {
    /// The label map.
    pub volume: LabelVolume,
    /// The format with its version: `nifti1`, `nifti1.gz`.
    pub format: &'static str,
    /// What results take over of a DICOM file.
    pub origin: Option<DicomOrigin>,
}
