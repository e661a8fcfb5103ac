//! What results take over from a DICOM file.

use std::io::Read;

use super::source::Source;
use super::syntax::read_element_syntax;
use super::tag::Tag;
use super::walk::{Met, Walk};
use crate::cancel::Cancel;
use crate::formats::dicom_origin::{self, DicomOrigin, SEGMENTED_SERIES};
use crate::formats::read::error::ReadError;
use crate::formats::read::stream::Stream;

/// Reads a file that was found to be a segmentation up to its pixels, for its patient, its study and what it refers to.
///
/// # Errors
/// As reading it does.
pub fn read_origin(file: impl Read, max_bytes: u64, cancel: &dyn Cancel) -> Result<DicomOrigin, ReadError> {
    let mut stream = Stream::open(file, max_bytes, cancel)?;
    let mut source = Source::new(&mut stream, max_bytes);
    let (syntax, is_deflated) = read_element_syntax(&mut source)?;
    if is_deflated {
        source.inflate();
    }
    let mut origin = DicomOrigin::default();
    let mut walk = Walk::new(source, syntax);
    while let Some(met) = walk.next()? {
        match met {
            Met::Value { tag, bytes } => origin.keep(halves(tag), &bytes),
            Met::Item { sequence: Tag::REFERENCED_SERIES, number: 1, item } => {
                if let Some(series) = item.bytes(Tag::SERIES) {
                    origin.keep(SEGMENTED_SERIES, series);
                }
            }
            Met::Item { .. } => {}
            Met::Pixels(_) => break,
        }
    }
    Ok(origin)
}

/// Whether results take a value over.
pub(super) fn is_taken_over(tag: Tag) -> bool {
    DicomOrigin::wants(halves(tag))
}

/// Group and element.
fn halves(tag: Tag) -> dicom_origin::Tag {
    let [a, b, c, d] = tag.0.to_be_bytes();
    (u16::from_be_bytes([a, b]), u16::from_be_bytes([c, d]))
}
