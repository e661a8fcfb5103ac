//! Which DICOM object a file is: what archives name it by.

use std::fmt;

use serde::{Deserialize, Serialize};

/// The identifiers of an object, as they stand in its file. Each is a UID.
#[derive(Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct DicomObject {
    /// SOP Class UID.
    pub class: String,
    /// Study Instance UID.
    pub study: String,
    /// Series Instance UID.
    pub series: String,
    /// SOP Instance UID.
    pub instance: String,
}

/// Tells none of them: a study leads to a patient, and what is shown so ends in logs.
impl fmt::Debug for DicomObject {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter.write_str("DicomObject(hidden)")
    }
}
