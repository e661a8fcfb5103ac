//! Files: label maps in, medial representations out. In reading order: which formats are read, the
//! readers, the parameters, which artifacts are made, their writers.

pub mod readers;

mod read;

pub mod params_json;

pub mod dicom_origin;

pub mod dicom_object;

/// Objects that this program wrote, element by element.
pub mod dicom_elements {
    pub use super::read::dicom::{
        DataSet, Element, ElementValue, ElementsError, ElementsReader, MAX_SEQUENCE_BYTES, MAX_VALUE_BYTES, Tag,
        WINDOW_BYTES,
    };
}

pub mod artifacts;

pub mod write;

pub(crate) use read::stream::hex;
pub use read::{DicomError, DicomFault, HeaderFacts, IDENTITY_BYTES, Identity, InputLimits, LineFault, ReadError, Uid};
pub use readers::{ReadVolume, read, read_file};
