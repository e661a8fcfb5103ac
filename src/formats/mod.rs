//! Files: label maps in, medial representations out. In reading order: which formats are read, the
//! readers, the parameters, which artifacts are made, their writers.

pub mod readers;

mod read;

pub mod params_json;

pub mod dicom_origin;

pub mod artifacts;

pub mod write;

pub(crate) use read::stream::hex;
pub use read::{DicomError, DicomFault, HeaderFacts, IDENTITY_BYTES, Identity, InputLimits, LineFault, ReadError, Uid};
pub use readers::{ReadVolume, read, read_file};
