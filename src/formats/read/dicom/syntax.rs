//! How elements are written: by the transfer syntax, which the group before the data set names.

use super::error::DicomFault;
use super::source::Source;
use super::tag::{Tag, TagPath};
use super::values::uid;
use crate::formats::read::error::ReadError;

/// A length that is not told: the end is marked.
pub(super) const UNDEFINED: u32 = u32::MAX;
/// Bytes before the magic, for other programs, and the magic.
pub(super) const PREAMBLE_BYTES: usize = 132;
pub(super) const MAGIC: &[u8] = b"DICM";
/// Bytes of the group that names the transfer syntax: real ones hold two hundred.
const MAX_META_BYTES: u32 = 1 << 16;

/// How elements are written.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Syntax {
    /// Whether each says of what kind its value is.
    pub is_explicit: bool,
    pub is_big_endian: bool,
}

/// Little endian with and without kinds of values.
const EXPLICIT: Syntax = Syntax { is_explicit: true, is_big_endian: false };
pub(super) const IMPLICIT: Syntax = Syntax { is_explicit: false, is_big_endian: false };

/// How pixels are written.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Packing {
    /// One after the other.
    Plain,
    /// Each frame run-length encoded.
    Rle,
    /// Each frame deflated.
    Deflated,
}

/// What a transfer syntax means.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Transfer {
    pub elements: Syntax,
    pub pixels: Packing,
    /// Whether the data set is deflated as a whole.
    pub is_deflated: bool,
}

impl Transfer {
    /// Whether pixels take less room than their number tells.
    pub fn is_compressed(self) -> bool {
        self.is_deflated || self.pixels != Packing::Plain
    }
}

/// What an element begins with.
#[derive(Clone, Copy, Debug)]
pub(super) struct Head {
    pub tag: Tag,
    /// The kind of its value, where that is told.
    pub kind: Option<[u8; 2]>,
    /// Bytes of its value, or [`UNDEFINED`].
    pub length: u32,
}

impl Syntax {
    pub fn u16(self, bytes: [u8; 2]) -> u16 {
        if self.is_big_endian { u16::from_be_bytes(bytes) } else { u16::from_le_bytes(bytes) }
    }

    fn u32(self, bytes: [u8; 4]) -> u32 {
        if self.is_big_endian { u32::from_be_bytes(bytes) } else { u32::from_le_bytes(bytes) }
    }

    /// The head of the next element; `None` at the end of the file, and where zeros fill it up: no element has the tag 0.
    ///
    /// # Errors
    /// When the file ends within it, or it has no kind of value.
    pub fn head(self, source: &mut Source<'_, '_>) -> Result<Option<Head>, ReadError> {
        let mut bytes = [0; 4];
        let start = source.position();
        match source.fill(&mut bytes)? {
            _ if bytes == [0; 4] => return Ok(None),
            4 => {}
            _ => return Err(ReadError::Truncated { expected: start + 8, got: source.position() }),
        }
        let [a, b, c, d] = bytes;
        let tag = Tag(u32::from(self.u16([a, b])) << 16 | u32::from(self.u16([c, d])));
        if !self.is_explicit || tag.is_frame() {
            return Ok(Some(Head { tag, kind: None, length: self.u32(source.array()?) }));
        }
        let kind: [u8; 2] = source.array()?;
        if !kind.iter().all(u8::is_ascii_uppercase) {
            let fault = DicomFault::Malformed { what: "an element has no kind of value (VR)", at: start };
            return Err(fault.at(TagPath::default()));
        }
        let length = if has_short_length(kind) {
            u32::from(self.u16(source.array()?))
        } else {
            let _reserved: [u8; 2] = source.array()?;
            self.u32(source.array()?)
        };
        Ok(Some(Head { tag, kind: Some(kind), length }))
    }
}

/// Kinds of values whose length has two bytes; those to come will have four.
pub(super) fn has_short_length(kind: [u8; 2]) -> bool {
    const SHORT: [&[u8; 2]; 21] = [
        b"AE", b"AS", b"AT", b"CS", b"DA", b"DS", b"DT", b"FD", b"FL", b"IS", b"LO", b"LT", b"PN", b"SH", b"SL", b"SS",
        b"ST", b"TM", b"UI", b"UL", b"US",
    ];
    SHORT.contains(&&kind)
}

/// Reads up to the data set; how that is written.
///
/// # Errors
/// When the group before it is damaged, or the pixels are compressed in a way that is not read.
pub(super) fn read_transfer(source: &mut Source<'_, '_>) -> Result<Transfer, ReadError> {
    transfer(read_transfer_uid(source)?)
}

/// Reads up to the data set; how its elements are written, and whether they are deflated. However pixels are compressed,
/// the elements are explicit and little endian (PS3.5 annex A.4).
///
/// # Errors
/// When the group before it is damaged.
pub(super) fn read_element_syntax(source: &mut Source<'_, '_>) -> Result<(Syntax, bool), ReadError> {
    let known = transfer(read_transfer_uid(source)?);
    Ok(known.map_or((EXPLICIT, false), |transfer| (transfer.elements, transfer.is_deflated)))
}

fn read_transfer_uid(source: &mut Source<'_, '_>) -> Result<String, ReadError> {
    source.skip(PREAMBLE_BYTES as u64)?;
    let malformed = |what, at| DicomFault::Malformed { what, at }.at(TagPath::top(Tag::META_LENGTH));
    let start = source.position();
    let length = match EXPLICIT.head(source)? {
        Some(Head { tag: Tag::META_LENGTH, length: 4, .. }) => u32::from_le_bytes(source.array()?),
        _ => return Err(malformed("the group before the data set has no length", start)),
    };
    if length > MAX_META_BYTES {
        return Err(malformed("the group before the data set is too long", start));
    }
    let end = source.position() + u64::from(length);
    let mut found = None;
    while source.position() < end {
        let Some(head) = EXPLICIT.head(source)? else {
            return Err(ReadError::Truncated { expected: end, got: source.position() });
        };
        if source.position() + u64::from(head.length) > end {
            return Err(malformed("an element is longer than what holds it", source.position()));
        }
        if head.tag == Tag::TRANSFER_SYNTAX {
            found = uid(&source.take(u64::from(head.length))?);
        } else {
            source.skip(u64::from(head.length))?;
        }
    }
    let missing = DicomFault::Missing { name: "TransferSyntaxUID" };
    found.ok_or_else(|| missing.at(TagPath::top(Tag::TRANSFER_SYNTAX)))
}

fn transfer(uid: String) -> Result<Transfer, ReadError> {
    let plain = |elements| Transfer { elements, pixels: Packing::Plain, is_deflated: false };
    let big_endian = Syntax { is_explicit: true, is_big_endian: true };
    Ok(match uid.as_str() {
        "1.2.840.10008.1.2" => plain(IMPLICIT),
        "1.2.840.10008.1.2.1" => plain(EXPLICIT),
        "1.2.840.10008.1.2.2" => plain(big_endian),
        "1.2.840.10008.1.2.1.99" => Transfer { is_deflated: true, ..plain(EXPLICIT) },
        "1.2.840.10008.1.2.5" => Transfer { pixels: Packing::Rle, ..plain(EXPLICIT) },
        "1.2.840.10008.1.2.8.1" => Transfer { pixels: Packing::Deflated, ..plain(EXPLICIT) },
        _ => {
            let fault = DicomFault::TransferSyntax { name: name_of(&uid), uid };
            return Err(fault.at(TagPath::top(Tag::TRANSFER_SYNTAX)));
        }
    })
}

/// What others are called that are met.
fn name_of(uid: &str) -> Option<&'static str> {
    match uid.strip_prefix("1.2.840.10008.1.2.4.")?.parse().ok()? {
        50..=70 => Some("JPEG"),
        80 | 81 => Some("JPEG-LS"),
        90..=95 => Some("JPEG 2000"),
        100..=108 => Some("video"),
        110..=112 => Some("JPEG XL"),
        201..=203 => Some("HTJ2K"),
        _ => None,
    }
}
