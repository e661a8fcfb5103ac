//! Writers, one for each artifact and one for samples.

pub mod nifti;
