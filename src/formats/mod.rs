//! Files: label maps in, medial representations out. In reading order: what a file is, the
//! NIfTI reader part by part, the parameters, then one writer per artifact.

mod read_error;

mod sniff;

mod stream;

mod nifti_header;

mod nifti_affine;

mod nifti_voxels;

pub mod nifti;

pub mod nifti_write;

pub mod params_json;

pub mod write;

pub mod artifacts;

pub use nifti::{InputLimits, ReadVolume, read, read_file};
pub use read_error::ReadError;
#[cfg(feature = "service")]
pub(crate) use stream::hex;
