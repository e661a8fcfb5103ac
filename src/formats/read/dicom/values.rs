//! What is kept of a data set, and what its bytes say: numbers, texts, UIDs.

use super::tag::Tag;
use super::uid::Uid;

/// Numbers from here on are no place in a patient, mm.
const MAX_NUMBER: f64 = 1e7;
/// Characters of a name, as of all formats; DICOM allows 64.
const MAX_TEXT_CHARS: usize = 80;

/// A value that is kept.
#[derive(Debug)]
pub(super) enum Value {
    Bytes(Vec<u8>),
    /// The first item of a sequence.
    Item(Item),
}

/// An item of a sequence: what is kept of it.
#[derive(Debug)]
pub(super) struct Item {
    elements: Vec<(Tag, Value)>,
    is_big_endian: bool,
}

impl Item {
    pub fn new(is_big_endian: bool) -> Self {
        Self { elements: Vec::new(), is_big_endian }
    }

    /// Takes in an element, unless one of the same tag is there.
    pub fn push(&mut self, tag: Tag, value: Value) {
        if self.get(tag).is_none() {
            self.elements.push((tag, value));
        }
    }

    fn get(&self, tag: Tag) -> Option<&Value> {
        self.elements.iter().find(|(found, _)| *found == tag).map(|(_, value)| value)
    }

    /// A value with anything in it.
    pub fn bytes(&self, tag: Tag) -> Option<&[u8]> {
        match self.get(tag) {
            Some(Value::Bytes(bytes)) if !bytes.is_empty() => Some(bytes),
            _ => None,
        }
    }

    /// The first item of a sequence.
    pub fn first(&self, tag: Tag) -> Option<&Self> {
        match self.get(tag) {
            Some(Value::Item(item)) => Some(item),
            _ => None,
        }
    }

    /// The whole numbers of two bytes that a value has.
    pub fn shorts(&self, tag: Tag) -> Option<Vec<u16>> {
        self.bytes(tag).map(|bytes| shorts(bytes, self.is_big_endian))
    }
}

/// Whole numbers of two bytes (US).
pub(super) fn shorts(bytes: &[u8], is_big_endian: bool) -> Vec<u16> {
    let (pairs, _) = bytes.as_chunks::<2>();
    let number = |pair: &[u8; 2]| if is_big_endian { u16::from_be_bytes(*pair) } else { u16::from_le_bytes(*pair) };
    pairs.iter().map(number).collect()
}

/// Text without the spaces and zeros that fill it up; `None` of other bytes than ASCII.
pub(super) fn plain(bytes: &[u8]) -> Option<&str> {
    let text = std::str::from_utf8(bytes).ok().filter(|text| text.is_ascii())?;
    Some(text.trim_matches([' ', '\0']))
}

/// Numbers in decimals (DS), `N` of them, finite and of a size that can be a place; `None` of anything else.
pub(super) fn decimals<const N: usize>(bytes: &[u8]) -> Option<[f64; N]> {
    let mut numbers = [0.0; N];
    let mut parts = plain(bytes)?.split('\\');
    for number in &mut numbers {
        let parsed: f64 = parts.next()?.trim().parse().ok()?;
        // Also none of NaN.
        *number = Some(parsed).filter(|parsed| parsed.abs() < MAX_NUMBER)?;
    }
    parts.next().is_none().then_some(numbers)
}

/// A whole number in decimals (IS).
pub(super) fn whole(bytes: &[u8]) -> Option<u64> {
    plain(bytes)?.parse().ok()
}

/// A UID: numbers with points between them. Anything else is none, so that no other text passes for one.
pub(super) fn uid(bytes: &[u8]) -> Option<String> {
    Some(Uid::of_file(bytes)?.to_string())
}

/// How texts are written (SpecificCharacterSet).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) enum Charset {
    #[default]
    Ascii,
    Latin1,
    Utf8,
    /// Any other, or several: not read.
    Other,
}

impl Charset {
    /// From the value of SpecificCharacterSet.
    pub fn of(bytes: &[u8]) -> Self {
        match plain(bytes) {
            Some("" | "ISO_IR 6" | "ISO 2022 IR 6") => Self::Ascii,
            Some("ISO_IR 100" | "ISO 2022 IR 100") => Self::Latin1,
            Some("ISO_IR 192") => Self::Utf8,
            _ => Self::Other,
        }
    }

    /// A text; `None` where it is not in this charset, is empty, too long, or has control characters.
    pub fn text(self, bytes: &[u8]) -> Option<String> {
        let text = match self {
            Self::Ascii | Self::Other => plain(bytes)?.to_owned(),
            Self::Latin1 => bytes.iter().map(|byte| char::from(*byte)).collect(),
            Self::Utf8 => std::str::from_utf8(bytes).ok()?.to_owned(),
        };
        let text = text.trim_matches([' ', '\0']);
        let is_good = (1..=MAX_TEXT_CHARS).contains(&text.chars().count()) && !text.chars().any(char::is_control);
        is_good.then(|| text.to_owned())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_as_many_as_wanted_finite_and_no_larger_than_a_place() {
        assert_eq!(decimals::<3>(b"-1.5\\ 2e1 \\3 "), Some([-1.5, 20.0, 3.0]));
        for wrong in ["1\\2", "1\\2\\3\\4", "1\\2\\nan", "1\\2\\inf", "1\\2\\1e7", "1\\\\3", ""] {
            assert_eq!(decimals::<3>(wrong.as_bytes()), None, "{wrong}");
        }
    }

    #[test]
    fn texts_are_read_in_three_charsets() {
        assert_eq!(Charset::of(b"ISO_IR 192").text("Milz ÄÖ ".as_bytes()).as_deref(), Some("Milz ÄÖ"));
        assert_eq!(Charset::of(b"ISO_IR 100").text(b"Nebenh\xf6hle").as_deref(), Some("Nebenhöhle"));
        assert_eq!(Charset::of(b"").text(b"Liver\0").as_deref(), Some("Liver"));
        for (charset, text) in [
            (&b"ISO_IR 6"[..], &b"Nebenh\xf6hle"[..]),
            (b"ISO_IR 192", b"\xf6"),
            (b"\\ISO 2022 IR 87", b"\x1b$B4N\x1b(B"),
            (b"ISO_IR 6", b"a\nb"),
            (b"ISO_IR 6", b"  "),
        ] {
            assert_eq!(Charset::of(charset).text(text), None, "{text:?}");
        }
    }

    #[test]
    fn a_uid_is_digits_and_points() {
        assert_eq!(uid(b"1.2.840\0").as_deref(), Some("1.2.840"));
        for wrong in [&b"1.2.DOE"[..], b"", b"1.2 3", &[b'1'; 65]] {
            assert_eq!(uid(wrong), None);
        }
    }
}
