//! All elements of an object that this program wrote, as a tree: explicit VR, little endian, all lengths told (PS3.5,
//! chapter 7). For who hands its attributes on; segmentations are read by what is wanted of them alone.
//!
//! Read window by window, so that a file of any length takes the memory of one. Values that are long are not read: it
//! is told where they lie.

use super::syntax::{MAGIC, PREAMBLE_BYTES, UNDEFINED, has_short_length};
use super::tag::Tag;
use super::values::plain;

/// Bytes of a value that is kept; longer ones are told by their place. With less, texts of a report would be missing
/// where attributes are handed on; with more, pictures would stand in answers.
pub const MAX_VALUE_BYTES: u64 = 16 << 10;
/// The same of a sequence with all that is in it: a report of a thousand structures has as much. With more, a tree of
/// millions of elements would stand in memory.
pub const MAX_SEQUENCE_BYTES: u64 = 4 << 20;
/// Bytes that a window must have where the file has as many left: what is kept whole, and its head.
pub const WINDOW_BYTES: u64 = MAX_SEQUENCE_BYTES + 64;
/// Sequences in sequences: a report has seven.
const MAX_DEPTH: usize = 16;
/// Bytes before the value: tag, kind, length.
const SHORT_HEAD: usize = 8;
const LONG_HEAD: usize = 12;

/// Why an object is not one that this program wrote.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("the object is damaged after byte {after}: {what}")]
pub struct ElementsError {
    /// Where the element begins that does not fit.
    pub after: u64,
    /// What does not fit.
    pub what: &'static str,
}

/// Elements in the order of their tags.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct DataSet {
    elements: Vec<Element>,
}

/// An element.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Element {
    /// Its tag.
    pub tag: Tag,
    /// The kind of its value (VR).
    pub kind: [u8; 2],
    /// Its value.
    pub value: ElementValue,
}

/// What an element holds.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum ElementValue {
    /// Bytes as they stand in the file.
    Bytes(Vec<u8>),
    /// The items of a sequence.
    Items(Vec<DataSet>),
    /// More than is kept.
    Long {
        /// Where it begins in the file, bytes.
        at: u64,
        /// Its length, bytes.
        bytes: u64,
    },
}

impl DataSet {
    /// The elements, tags ascending.
    #[must_use]
    pub fn elements(&self) -> &[Element] {
        &self.elements
    }

    /// An element of this tag that no sequence holds.
    #[must_use]
    pub fn get(&self, tag: Tag) -> Option<&Element> {
        self.elements.iter().find(|element| element.tag == tag)
    }
}

/// On the way through a file.
#[derive(Clone, Debug, Default)]
pub struct ElementsReader {
    position: u64,
    set: DataSet,
}

impl ElementsReader {
    /// Where the next window is to begin, bytes from the begin of the file.
    #[must_use]
    pub fn position(&self) -> u64 {
        self.position
    }

    /// Takes the elements that lie as a whole in a window, which begins at [`position`](Self::position). Goes on behind
    /// them, and behind what is too long to be kept.
    ///
    /// # Errors
    /// When the bytes are no such elements, or not one of them is whole.
    pub fn take(&mut self, window: &[u8]) -> Result<(), ElementsError> {
        let begin = self.position;
        let mut rest = Rest { bytes: window, at: begin };
        if begin == 0 {
            rest.pass_meta()?;
            self.position = rest.at;
        }
        while let Some((head, long_at)) = rest.head()? {
            if head.bytes > head.most_bytes() {
                let value = ElementValue::Long { at: long_at, bytes: head.bytes };
                self.push(Element { tag: head.tag, kind: head.kind, value }, rest.at)?;
                self.position = long_at + head.bytes;
                // What follows may lie in the window too.
                let Some(behind) = rest.behind(head.bytes) else { return Ok(()) };
                rest = behind;
                continue;
            }
            let Some(value) = rest.value(head.bytes) else { break };
            self.push(Element { tag: head.tag, kind: head.kind, value: head.read(value, long_at, 0)? }, rest.at)?;
            self.position = rest.at;
        }
        if self.position == begin { Err(rest.damaged("it ends within an element")) } else { Ok(()) }
    }

    fn push(&mut self, element: Element, after: u64) -> Result<(), ElementsError> {
        push(&mut self.set, element, after)
    }

    /// What was taken.
    #[must_use]
    pub fn finish(self) -> DataSet {
        self.set
    }
}

fn push(set: &mut DataSet, element: Element, after: u64) -> Result<(), ElementsError> {
    if set.elements.last().is_some_and(|last| last.tag >= element.tag) {
        return Err(ElementsError { after, what: "elements do not ascend" });
    }
    set.elements.push(element);
    Ok(())
}

/// What an element begins with.
#[derive(Clone, Copy)]
struct Head {
    tag: Tag,
    kind: [u8; 2],
    /// Bytes of its value.
    bytes: u64,
}

impl Head {
    fn is_sequence(self) -> bool {
        self.kind == *b"SQ"
    }

    fn most_bytes(self) -> u64 {
        if self.is_sequence() { MAX_SEQUENCE_BYTES } else { MAX_VALUE_BYTES }
    }

    fn read(self, value: &[u8], at: u64, depth: usize) -> Result<ElementValue, ElementsError> {
        if self.is_sequence() {
            Ok(ElementValue::Items(items(Rest { bytes: value, at }, depth)?))
        } else {
            Ok(ElementValue::Bytes(value.to_vec()))
        }
    }
}

/// Bytes that are still to be read, and where they lie in the file.
struct Rest<'a> {
    bytes: &'a [u8],
    at: u64,
}

impl<'a> Rest<'a> {
    fn damaged(&self, what: &'static str) -> ElementsError {
        ElementsError { after: self.at, what }
    }

    /// Takes so many bytes; `None` where there are fewer.
    fn value(&mut self, count: u64) -> Option<&'a [u8]> {
        let (value, rest) = self.bytes.split_at_checked(usize::try_from(count).ok()?)?;
        (self.bytes, self.at) = (rest, self.at + count);
        Some(value)
    }

    fn behind(mut self, count: u64) -> Option<Self> {
        self.value(count).map(|_| self)
    }

    /// The head of the next element, and where its value begins; `None` where it is not whole.
    fn head(&mut self) -> Result<Option<(Head, u64)>, ElementsError> {
        let Some(&[a, b, c, d, first, second, short, long, ..]) = self.bytes.first_chunk::<SHORT_HEAD>() else {
            return Ok(None);
        };
        let tag = Tag(u32::from(u16::from_le_bytes([a, b])) << 16 | u32::from(u16::from_le_bytes([c, d])));
        let kind = [first, second];
        if tag.is_frame() || !kind.iter().all(u8::is_ascii_uppercase) {
            return Err(self.damaged("no element begins here"));
        }
        let (head, bytes) = if has_short_length(kind) {
            (SHORT_HEAD, u32::from(u16::from_le_bytes([short, long])))
        } else {
            let Some(&[.., e, f, g, h]) = self.bytes.first_chunk::<LONG_HEAD>() else { return Ok(None) };
            (LONG_HEAD, u32::from_le_bytes([e, f, g, h]))
        };
        if bytes == UNDEFINED {
            return Err(self.damaged("the length of an element is not told"));
        }
        let head_bytes = head as u64;
        self.value(head_bytes);
        Ok(Some((Head { tag, kind, bytes: bytes.into() }, self.at)))
    }

    /// Passes over what stands before the data set.
    fn pass_meta(&mut self) -> Result<(), ElementsError> {
        const EXPLICIT_LITTLE_ENDIAN: &str = "1.2.840.10008.1.2.1";
        let damaged = ElementsError { after: 0, what: "it does not begin as a file of this program" };
        let preamble = self.value(PREAMBLE_BYTES as u64).ok_or(damaged)?;
        let (head, _) = self.head()?.ok_or(damaged)?;
        let length = self.value(head.bytes).and_then(|bytes| bytes.first_chunk()).ok_or(damaged)?;
        let at = self.at;
        let meta = self.value(u32::from_le_bytes(*length).into()).ok_or(damaged)?;
        let meta = data_set(Rest { bytes: meta, at }, 0)?;
        let syntax = match meta.get(Tag::TRANSFER_SYNTAX).map(|element| &element.value) {
            Some(ElementValue::Bytes(bytes)) => plain(bytes),
            _ => None,
        };
        let is_ours = preamble.ends_with(MAGIC) && head.tag == Tag::META_LENGTH;
        if is_ours && syntax == Some(EXPLICIT_LITTLE_ENDIAN) { Ok(()) } else { Err(damaged) }
    }
}

/// A data set that has all these bytes. Nothing in it is too long: what holds it is not.
fn data_set(mut rest: Rest<'_>, depth: usize) -> Result<DataSet, ElementsError> {
    let mut set = DataSet::default();
    while !rest.bytes.is_empty() {
        let cut_off = rest.damaged("an element runs over the end of what holds it");
        let (head, at) = rest.head()?.ok_or(cut_off)?;
        let value = rest.value(head.bytes).ok_or(cut_off)?;
        push(&mut set, Element { tag: head.tag, kind: head.kind, value: head.read(value, at, depth)? }, at)?;
    }
    Ok(set)
}

/// The items of a sequence that has all these bytes.
fn items(mut rest: Rest<'_>, depth: usize) -> Result<Vec<DataSet>, ElementsError> {
    if depth >= MAX_DEPTH {
        return Err(rest.damaged("sequences are nested too deep"));
    }
    let mut items = Vec::new();
    while !rest.bytes.is_empty() {
        let cut_off = rest.damaged("an item runs over the end of its sequence");
        let &[a, b, c, d, e, f, g, h] = rest.value(8).and_then(|head| head.first_chunk()).ok_or(cut_off)?;
        if [a, b, c, d] != [0xfe, 0xff, 0x00, 0xe0] {
            return Err(rest.damaged("a sequence has something else than items"));
        }
        let at = rest.at;
        let item = rest.value(u32::from_le_bytes([e, f, g, h]).into()).ok_or(cut_off)?;
        items.push(data_set(Rest { bytes: item, at }, depth + 1)?);
    }
    Ok(items)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// An element, with a length of four bytes where its kind has one.
    fn element(tag: u32, kind: &[u8; 2], value: &[u8]) -> Vec<u8> {
        let (group, number) = ((tag >> 16) as u16, (tag & 0xffff) as u16);
        let length = u32::try_from(value.len()).expect("a short value").to_le_bytes();
        let length = if has_short_length(*kind) { length[..2].to_vec() } else { [&[0, 0][..], &length].concat() };
        [&group.to_le_bytes()[..], &number.to_le_bytes(), kind, &length, value].concat()
    }

    fn item(content: &[u8]) -> Vec<u8> {
        let length = u32::try_from(content.len()).expect("a short item").to_le_bytes();
        [&[0xfe, 0xff, 0x00, 0xe0][..], &length, content].concat()
    }

    fn file(content: &[Vec<u8>]) -> Vec<u8> {
        let syntax = element(0x0002_0010, b"UI", b"1.2.840.10008.1.2.1\0");
        let length = u32::try_from(syntax.len()).expect("a short group").to_le_bytes();
        [&[0; 128][..], b"DICM", &element(0x0002_0000, b"UL", &length), &syntax, &content.concat()].concat()
    }

    /// All of a file, in windows of this length.
    fn read(file: &[u8], window: usize) -> Result<DataSet, ElementsError> {
        let mut reader = ElementsReader::default();
        while let Some(rest) = file.get(usize::try_from(reader.position()).expect("in memory")..) {
            if rest.is_empty() {
                break;
            }
            reader.take(&rest[..rest.len().min(window)])?;
        }
        Ok(reader.finish())
    }

    #[test]
    fn a_tree_is_read_with_the_place_of_what_is_long_in_windows_of_any_length() {
        let long = vec![7; 40_000];
        let sequence = item(&element(0x0008_0100, b"SH", b"AB"));
        let file = file(&[
            element(0x0008_0060, b"CS", b"SR"),
            element(0x0040_a043, b"SQ", &[sequence.clone(), item(&[])].concat()),
            element(0x0042_0011, b"OB", &long),
            element(0x0042_0012, b"LO", b"a/b "),
        ]);
        for window in [300, 1000, 41_000, file.len()] {
            let set = read(&file, window).expect("a whole file");
            let tags: Vec<u32> = set.elements().iter().map(|element| element.tag.0).collect();
            assert_eq!(tags, [0x0008_0060, 0x0040_a043, 0x0042_0011, 0x0042_0012], "{window}");
            let Some(ElementValue::Items(items)) = set.get(Tag(0x0040_a043)).map(|own| &own.value) else { panic!() };
            assert_eq!((items.len(), items[0].elements().len(), items[1].elements().len()), (2, 1, 0));
            let Some(&ElementValue::Long { at, bytes }) = set.get(Tag(0x0042_0011)).map(|own| &own.value) else {
                panic!()
            };
            let at = usize::try_from(at).expect("in memory");
            assert!(bytes == 40_000 && file[at..at + 40_000] == long);
        }
    }

    #[test]
    fn what_is_damaged_is_refused_where_it_is() {
        let good = element(0x0008_0060, b"CS", b"SR");
        let nested = (0..20).fold(Vec::new(), |inner, _| element(0x0040_a730, b"SQ", &item(&inner)));
        for (content, what) in [
            (vec![good.clone(), good.clone()], "elements do not ascend"),
            (vec![good.clone(), good[..9].to_vec()], "it ends within an element"),
            (vec![element(0x0008_0060, b"c!", b"SR")], "no element begins here"),
            (vec![element(0x0040_a043, b"SQ", &good)], "a sequence has something else than items"),
            (vec![element(0x0040_a043, b"SQ", &item(&good[..9]))], "an element runs over the end of what holds it"),
            (vec![nested], "sequences are nested too deep"),
        ] {
            assert_eq!(read(&file(&content), 1 << 20).map_err(|error| error.what), Err(what));
        }
        assert!(read(b"no DICOM", 100).is_err());
    }
}
