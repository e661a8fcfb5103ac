//! A data set of DICOM and its bytes: explicit VR, little endian, elements in the order of their tags, even lengths
//! (PS3.5, sections 6 and 7).

use std::collections::BTreeMap;

use crate::formats::dicom_origin::Tag;

/// A text VR with the bytes or characters that a value has at the most.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Text {
    /// Code string: capitals, digits, space, underscore.
    Cs,
    Da,
    Tm,
    Dt,
    /// Decimal number.
    Ds,
    /// Whole number.
    Is,
    Lo,
    Sh,
    /// One text of up to 1024 characters.
    St,
    /// A text of any length.
    Ut,
    Ui,
}

impl Text {
    fn name(self) -> [u8; 2] {
        match self {
            Self::Cs => *b"CS",
            Self::Da => *b"DA",
            Self::Tm => *b"TM",
            Self::Dt => *b"DT",
            Self::Ds => *b"DS",
            Self::Is => *b"IS",
            Self::Lo => *b"LO",
            Self::Sh => *b"SH",
            Self::St => *b"ST",
            Self::Ut => *b"UT",
            Self::Ui => *b"UI",
        }
    }

    fn most(self) -> usize {
        match self {
            Self::Cs | Self::Ds | Self::Sh => 16,
            Self::Is => 12,
            Self::Da => 8,
            Self::Tm => 14,
            Self::Dt => 26,
            Self::Lo | Self::Ui => 64,
            Self::St => 1024,
            Self::Ut => usize::MAX,
        }
    }

    /// A text as a value of this kind may be: characters that are none of it are replaced, the rest is cut.
    fn fitted(self, text: &str) -> String {
        let mut fitted = String::new();
        for character in text.trim().chars().take(self.most()) {
            let is_fit = match self {
                Self::Cs => character.is_ascii_uppercase() || character.is_ascii_digit() || " _".contains(character),
                Self::Ui => character.is_ascii_digit() || character == '.',
                Self::Da | Self::Tm | Self::Dt | Self::Ds | Self::Is => character.is_ascii_graphic(),
                // A backslash parts values.
                Self::Lo | Self::Sh | Self::St | Self::Ut => !character.is_control() && character != '\\',
            };
            fitted.push(if is_fit { character } else { '_' });
        }
        fitted
    }
}

#[derive(Clone, Debug, PartialEq)]
enum Value {
    Bytes([u8; 2], Vec<u8>),
    Items(Vec<Dataset>),
}

/// Elements by tag.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Dataset {
    elements: BTreeMap<Tag, Value>,
}

impl Dataset {
    /// Sets a text, UTF-8, fitted to its kind; an empty one is there without a value.
    pub fn text(&mut self, tag: Tag, kind: Text, text: &str) {
        self.bytes(tag, kind.name(), kind.fitted(text).as_bytes());
    }

    /// The same, in the letters that every character set has.
    pub fn ascii(&mut self, tag: Tag, kind: Text, text: &str) {
        let ascii: String = text.chars().map(|c| if c.is_ascii() { c } else { '?' }).collect();
        self.text(tag, kind, &ascii);
    }

    /// Sets bytes as they are, filled up to an even number with what their kind is filled up with.
    pub fn bytes(&mut self, tag: Tag, vr: [u8; 2], bytes: &[u8]) {
        let mut bytes = bytes.to_vec();
        if !bytes.len().is_multiple_of(2) {
            bytes.push(if matches!(&vr, b"UI" | b"OB" | b"OW" | b"UN") { 0 } else { b' ' });
        }
        self.elements.insert(tag, Value::Bytes(vr, bytes));
    }

    /// Sets a whole number of two bytes.
    pub fn short(&mut self, tag: Tag, value: u16) {
        self.bytes(tag, *b"US", &value.to_le_bytes());
    }

    /// Sets a whole number of four bytes.
    pub fn long(&mut self, tag: Tag, value: u32) {
        self.bytes(tag, *b"UL", &value.to_le_bytes());
    }

    /// Sets a sequence.
    pub fn items(&mut self, tag: Tag, items: Vec<Self>) {
        self.elements.insert(tag, Value::Items(items));
    }

    /// A code as the only item of a sequence.
    pub fn code(&mut self, tag: Tag, code: Code<'_>) {
        self.items(tag, vec![code.item()]);
    }

    /// The bytes of all elements.
    pub fn encoded(&self) -> Vec<u8> {
        let mut out = Vec::new();
        for (tag, value) in &self.elements {
            match value {
                Value::Bytes(vr, bytes) => put(&mut out, *tag, *vr, bytes),
                Value::Items(items) => {
                    let mut content = Vec::new();
                    for item in items {
                        let item = item.encoded();
                        put_tag(&mut content, (0xfffe, 0xe000));
                        content.extend(length(item.len()));
                        content.extend(item);
                    }
                    put(&mut out, *tag, *b"SQ", &content);
                }
            }
        }
        out
    }

    /// A whole file: preamble, file meta information, data set. The class and the instance are those of the data set.
    pub fn file(&self, (class, instance): (&str, &str)) -> Vec<u8> {
        const EXPLICIT_LITTLE_ENDIAN: &str = "1.2.840.10008.1.2.1";
        let mut meta = Self::default();
        meta.bytes((0x0002, 0x0001), *b"OB", &[0, 1]);
        meta.text((0x0002, 0x0002), Text::Ui, class);
        meta.text((0x0002, 0x0003), Text::Ui, instance);
        meta.text((0x0002, 0x0010), Text::Ui, EXPLICIT_LITTLE_ENDIAN);
        meta.text((0x0002, 0x0012), Text::Ui, super::uid::IMPLEMENTATION);
        meta.text((0x0002, 0x0013), Text::Sh, "MEDIALREP");
        let meta = meta.encoded();
        let mut file = vec![0; 128];
        file.extend(b"DICM");
        put(&mut file, (0x0002, 0x0000), *b"UL", &length(meta.len()));
        file.extend(meta);
        file.extend(self.encoded());
        file
    }
}

/// An element.
fn put(out: &mut Vec<u8>, tag: Tag, vr: [u8; 2], bytes: &[u8]) {
    put_tag(out, tag);
    out.extend(vr);
    let has_long_length = matches!(&vr, b"OB" | b"OW" | b"SQ" | b"UT" | b"UN");
    match u16::try_from(bytes.len()) {
        Ok(short) if !has_long_length => out.extend(short.to_le_bytes()),
        _ => {
            out.extend([0; 2]);
            out.extend(length(bytes.len()));
        }
    }
    out.extend(bytes);
}

fn put_tag(out: &mut Vec<u8>, (group, element): Tag) {
    out.extend(group.to_le_bytes());
    out.extend(element.to_le_bytes());
}

/// A length of four bytes. Files that are put in are refused when they are longer than these tell; all else is shorter.
fn length(bytes: usize) -> [u8; 4] {
    u32::try_from(bytes).unwrap_or(u32::MAX).to_le_bytes()
}

/// A code of a coding scheme with its meaning.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Code<'a>(pub &'a str, pub &'a str, pub &'a str);

impl Code<'_> {
    pub fn item(self) -> Dataset {
        let Self(value, scheme, meaning) = self;
        let mut item = Dataset::default();
        item.text((0x0008, 0x0100), Text::Sh, value);
        item.text((0x0008, 0x0102), Text::Sh, scheme);
        item.text((0x0008, 0x0104), Text::Lo, meaning);
        item
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn elements_are_in_order_and_of_even_length() {
        let mut dataset = Dataset::default();
        dataset.short((0x0028, 0x0010), 258);
        dataset.text((0x0008, 0x0018), Text::Ui, "1.2.3");
        let expected =
            [b"\x08\x00\x18\x00UI\x06\x001.2.3\0".as_slice(), b"\x28\x00\x10\x00US\x02\x00\x02\x01"].concat();
        assert_eq!(dataset.encoded(), expected);
    }

    #[test]
    fn texts_are_fitted_to_their_kind() {
        assert_eq!(Text::Lo.fitted("a\\b\nc"), "a_b_c");
        assert_eq!(Text::Sh.fitted("éééééééééééééééééééé").chars().count(), 16);
        assert_eq!(Text::Cs.fitted("a1 B"), "_1 B");
    }
}
