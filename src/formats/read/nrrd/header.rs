//! The lines of a header: `field: value`, `key:=value`, `# comment`, up to an empty one.

use super::segments::{KeptExtent, SegmentKeys};
use crate::formats::read::error::ReadError;
use crate::formats::read::lines::{Fields, Line, Lines, unknown_line};
use crate::formats::read::stream::Stream;

/// Fields that mean something here, as they are named in messages. They are compared in lower case and without spaces:
/// `data file` and `datafile` are one.
const FIELDS: &[&str] = &[
    "type",
    "dimension",
    "sizes",
    "encoding",
    "endian",
    "space",
    "space dimension",
    "space directions",
    "space origin",
    "space units",
    "spacings",
    "units",
    "kinds",
    "data file",
    "line skip",
    "byte skip",
];

/// What the header says, not yet checked.
#[derive(Debug, Default)]
pub(super) struct Header {
    pub fields: Fields,
    pub segments: SegmentKeys,
    /// Slicer 4: where in the image that was segmented the volume lies.
    pub extent: Option<KeptExtent>,
}

/// Whether a first line is that of a version that is read.
pub(super) fn is_magic(line: &[u8]) -> bool {
    let line = line.trim_ascii_end();
    let version = line.strip_prefix(b"NRRD000").unwrap_or_default();
    line == b"NRRD00.01" || matches!(version, [b'1'..=b'5'])
}

impl Header {
    /// Reads up to the empty line that ends it.
    ///
    /// # Errors
    /// When the file ends before, or a line is none of a header.
    pub fn read(stream: &mut Stream<'_>) -> Result<Self, ReadError> {
        let mut lines = Lines::of(stream);
        let mut header = Self::default();
        // `sniff` took it for the magic.
        lines.next()?;
        loop {
            let line = lines.next()?;
            if line.is_empty() {
                return Ok(header);
            }
            if !line.starts_with(b"#") {
                header.take(&line, lines.number())?;
            }
        }
    }

    fn take(&mut self, line: &[u8], number: u64) -> Result<(), ReadError> {
        let Some(colon) = line.iter().position(|byte| *byte == b':') else {
            return Err(unknown_line(number, "a field (`name: value`), a key (`name:=value`) or empty"));
        };
        let (name, value) = (&line[..colon], &line[colon + 1..]);
        if let Some(value) = value.strip_prefix(b"=") {
            if name == b"Segmentation_Extent" {
                self.extent = KeptExtent::parse(value, number);
            } else {
                self.segments.take(name, value);
            }
            return Ok(());
        }
        let Some(field) = known(name) else { return Ok(()) };
        let value = String::from_utf8_lossy(value).trim().to_owned();
        self.fields.add(Line { number, field, value })
    }
}

/// The field that is meant.
fn known(name: &[u8]) -> Option<&'static str> {
    let mut plain: Vec<u8> = name.to_ascii_lowercase();
    plain.retain(|byte| *byte != b' ');
    if plain == b"spacedim" {
        return Some("space dimension");
    }
    FIELDS.iter().copied().find(|field| field.bytes().filter(|byte| *byte != b' ').eq(plain.iter().copied()))
}
