//! The lines of a header: `Field = value`, up to the one that says where the voxels are.

use crate::formats::read::error::ReadError;
use crate::formats::read::lines::{Fields, Line, Lines, unknown_line};
use crate::formats::read::stream::Stream;

/// The field that ends a header.
pub(super) const LAST_FIELD: &str = "ElementDataFile";

/// Fields that mean something here, with the names that they have as well.
const FIELDS: &[(&str, &str)] = &[
    ("ObjectType", "ObjectType"),
    ("NDims", "NDims"),
    ("DimSize", "DimSize"),
    ("ElementType", "ElementType"),
    ("ElementNumberOfChannels", "ElementNumberOfChannels"),
    ("BinaryData", "BinaryData"),
    ("BinaryDataByteOrderMSB", "BinaryDataByteOrderMSB"),
    ("ElementByteOrderMSB", "BinaryDataByteOrderMSB"),
    ("CompressedData", "CompressedData"),
    ("HeaderSize", "HeaderSize"),
    ("TransformMatrix", "TransformMatrix"),
    ("Orientation", "TransformMatrix"),
    ("Rotation", "TransformMatrix"),
    ("Offset", "Offset"),
    ("Position", "Offset"),
    ("Origin", "Offset"),
    ("ElementSpacing", "ElementSpacing"),
    ("ElementSize", "ElementSize"),
    ("DistanceUnits", "DistanceUnits"),
    (LAST_FIELD, LAST_FIELD),
];

/// Fields that a file may begin with beside those above.
const FIRST_FIELDS: &[&str] = &["Comment", "ObjectSubType", "ID", "ParentID", "Name", "Color", "AcquisitionDate"];

/// Whether a file begins as headers do: with a line of a known field, of which one says what it is or how many
/// dimensions it has.
pub(super) fn looks_like_header(head: &[u8]) -> bool {
    let mut is_told = false;
    for (n, line) in head.split(|byte| *byte == b'\n').enumerate() {
        let name = match split(line) {
            Some((name, _)) => name,
            None => break,
        };
        is_told |= name == b"ObjectType" || name == b"NDims";
        let is_first = FIRST_FIELDS.iter().any(|field| field.as_bytes() == name);
        if n == 0 && !is_first && known(name).is_none() {
            return false;
        }
    }
    is_told
}

/// Reads up to the line that says where the voxels are; what follows it are they, or names of files.
///
/// # Errors
/// When the file ends before, or a line is none of a header.
pub(super) fn read_header(stream: &mut Stream<'_>) -> Result<Fields, ReadError> {
    let mut lines = Lines::of(stream);
    let mut fields = Fields::default();
    loop {
        let line = lines.next()?;
        if line.trim_ascii().is_empty() {
            continue;
        }
        let number = lines.number();
        let (name, value) = split(&line).ok_or_else(|| unknown_line(number, "a field (`name = value`)"))?;
        let Some(field) = known(name) else { continue };
        let value = String::from_utf8_lossy(value).into_owned();
        fields.add(Line { number, field, value })?;
        if field == LAST_FIELD {
            return Ok(fields);
        }
    }
}

/// Name and value.
fn split(line: &[u8]) -> Option<(&[u8], &[u8])> {
    let middle = line.iter().position(|byte| *byte == b'=')?;
    Some((line[..middle].trim_ascii(), line[middle + 1..].trim_ascii()))
}

fn known(name: &[u8]) -> Option<&'static str> {
    FIELDS.iter().find(|(spelling, _)| spelling.as_bytes() == name).map(|(_, field)| *field)
}
