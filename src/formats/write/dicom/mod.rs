//! Results as DICOM objects, for archives and viewers of images: a picture, a document, surfaces and a structured report.
//!
//! Patient, study and frame of reference are those of the DICOM object that the mask came in ([`DicomOrigin`]); without
//! one the patient is empty and the study is the result's own.

mod dataset;

mod uid;

mod instance;

mod picture;

mod document;

mod content;

mod measurements;

use std::io::{self, Write};

use super::record::Record;
use crate::formats::dicom_object::DicomObject;
use instance::{Instance, Kind};

#[allow(unused_imports, reason = "named in the text above")]
use crate::formats::dicom_origin::DicomOrigin;

/// The kinds of object that are made.
const KINDS: [Kind; 4] = [picture::KIND, document::PDF, document::STL, measurements::KIND];

/// Which object the artifact of this name is; `None` where it is no DICOM.
#[must_use]
pub fn object_of(record: &Record, artifact: &str) -> Option<DicomObject> {
    let kind = KINDS.into_iter().find(|kind| kind.artifact == artifact)?;
    Some(instance::object(record, kind))
}

/// Writes `picture.dcm`, a Secondary Capture.
///
/// # Errors
/// When writing fails.
pub fn write_picture(record: &Record, out: &mut dyn Write) -> io::Result<()> {
    write(&picture::instance(record)?, out)
}

/// Writes `report.pdf.dcm`, an Encapsulated PDF.
///
/// # Errors
/// When writing fails, or the document has more bytes than the format can tell.
pub fn write_pdf(record: &Record, out: &mut dyn Write) -> io::Result<()> {
    write(&document::pdf(record)?, out)
}

/// Writes `surfaces.stl.dcm`, an Encapsulated STL.
///
/// # Errors
/// When writing fails, or the surfaces have more bytes than the format can tell.
pub fn write_stl(record: &Record, out: &mut dyn Write) -> io::Result<()> {
    write(&document::stl(record)?, out)
}

/// Writes `report.sr.dcm`, a Comprehensive 3D SR.
///
/// # Errors
/// When writing fails.
pub fn write_report(record: &Record, out: &mut dyn Write) -> io::Result<()> {
    write(&measurements::instance(record), out)
}

fn write(instance: &Instance, out: &mut dyn Write) -> io::Result<()> {
    out.write_all(&instance.file())
}
