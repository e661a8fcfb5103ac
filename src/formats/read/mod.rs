//! What readers are made of, then the readers: each makes a [`LabelVolume`](crate::space::LabelVolume) of a
//! stream. Which there are stands in [`readers`](super::readers).

mod error;

pub(super) mod answers;

pub(super) mod sniff;

pub(super) mod stream;

mod stored;

mod voxels;

mod layers;

mod lines;

mod text;

mod body;

mod place;

pub(super) mod nifti;

pub(super) mod dicom;
pub(super) mod nrrd;

pub(super) mod metaimage;

pub use answers::{HeaderFacts, InputLimits};
pub use dicom::{DicomError, DicomFault, IDENTITY_BYTES, Identity, Uid};
pub use error::ReadError;
pub use lines::LineFault;
