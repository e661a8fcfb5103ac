//! Texts of DICOM as characters: by the value of SpecificCharacterSet (PS3.3 section C.12.1.1.2) of the object that
//! they stand in. What is written in none of these sets is replaced by U+FFFD, never left out.

use encoding_rs::{EUC_KR, Encoding, GB18030, GBK, ISO_2022_JP};

/// How texts of an object are written.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Charset(Kind);

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
enum Kind {
    /// Nothing is said: ASCII, or what many write without saying so.
    #[default]
    Unsaid,
    Latin1,
    /// One that needs no escapes.
    Plain(&'static Encoding),
    /// Escapes lead to it, and are no text themselves.
    Escaped(&'static Encoding, &'static [u8]),
}

impl Kind {
    fn has_escapes(self) -> bool {
        matches!(self, Self::Escaped(..)) || self == Self::Plain(ISO_2022_JP)
    }
}

/// What begins the sequences that lead to another set (ISO 2022).
const ESCAPE: u8 = 0x1b;

impl Charset {
    /// From the value of SpecificCharacterSet. Of several sets, the one that texts change to by escapes, else the first
    /// that is more than ASCII.
    #[must_use]
    pub fn of(value: &[u8]) -> Self {
        let text = String::from_utf8_lossy(value);
        let mut found = Kind::Unsaid;
        for name in text.split('\\') {
            // The same set, with or without escapes to it.
            let name = name.trim_matches([' ', '\0']).replace("ISO 2022 IR ", "ISO_IR ");
            match kind(&name) {
                Some(kind) if found == Kind::Unsaid || kind.has_escapes() => found = kind,
                _ => {}
            }
        }
        Self(found)
    }

    /// A text, whatever its bytes are.
    #[must_use]
    pub fn text(self, bytes: &[u8]) -> String {
        let text = match self.0 {
            Kind::Unsaid => String::from_utf8_lossy(bytes).into_owned(),
            Kind::Latin1 => bytes.iter().map(|byte| char::from(*byte)).collect(),
            Kind::Plain(encoding) => encoding.decode_without_bom_handling(bytes).0.into_owned(),
            Kind::Escaped(encoding, escape) => {
                encoding.decode_without_bom_handling(&without(bytes, escape)).0.into_owned()
            }
        };
        // Escapes to sets that are not read.
        text.replace(char::from(ESCAPE), "\u{fffd}")
    }
}

/// The set of a defined term; `None` of ASCII, and of sets that are not read.
fn kind(name: &str) -> Option<Kind> {
    let label = match name {
        "ISO_IR 100" => return Some(Kind::Latin1),
        "ISO_IR 87" | "ISO_IR 159" => return Some(Kind::Plain(ISO_2022_JP)),
        "ISO_IR 149" => return Some(Kind::Escaped(EUC_KR, b"\x1b$)C")),
        "ISO_IR 58" => return Some(Kind::Escaped(GBK, b"\x1b$)A")),
        "GB18030" | "GBK" => return Some(Kind::Plain(GB18030)),
        "ISO_IR 192" => "utf-8",
        "ISO_IR 101" => "iso-8859-2",
        "ISO_IR 109" => "iso-8859-3",
        "ISO_IR 110" => "iso-8859-4",
        "ISO_IR 144" => "iso-8859-5",
        "ISO_IR 127" => "iso-8859-6",
        "ISO_IR 126" => "iso-8859-7",
        "ISO_IR 138" => "iso-8859-8",
        "ISO_IR 148" => "iso-8859-9",
        "ISO_IR 203" => "iso-8859-15",
        "ISO_IR 166" => "tis-620",
        "ISO_IR 13" => "shift_jis",
        _ => return None,
    };
    Encoding::for_label(label.as_bytes()).map(Kind::Plain)
}

/// The bytes without each place that says `escape`.
fn without(bytes: &[u8], escape: &[u8]) -> Vec<u8> {
    let mut left = Vec::with_capacity(bytes.len());
    let mut rest = bytes;
    while let Some((first, others)) = rest.split_first() {
        match rest.strip_prefix(escape) {
            Some(behind) => rest = behind,
            None => {
                left.push(*first);
                rest = others;
            }
        }
    }
    left
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_read_in_the_sets_that_hospitals_write() {
        // The names of PS3.5, annexes H to K.
        for (set, bytes, text) in [
            (&b"ISO_IR 100 "[..], &b"M\xfcller^J"[..], "Müller^J"),
            (b"", b"Adams^John", "Adams^John"),
            (b"", "Müller".as_bytes(), "Müller"),
            (b"ISO_IR 192", "王^小東".as_bytes(), "王^小東"),
            (b"ISO_IR 144", b"\xbb\xee\xda", "Люк"),
            (b"ISO_IR 126", b"\xc4\xe9\xef", "Διο"),
            (b"GB18030", b"\xcd\xf5^\xd0\xa1\xb6\xab", "王^小东"),
            (b"\\ISO 2022 IR 87", b"Yamada^Tarou=\x1b$B;3ED\x1b(B^\x1b$BB@O:\x1b(B", "Yamada^Tarou=山田^太郎"),
            (b"\\ISO 2022 IR 149", b"Hong^Gildong=\x1b$)C\xfb\xf3^\x1b$)C\xd1\xce\xd4\xd7", "Hong^Gildong=洪^吉洞"),
            (b"\\ISO 2022 IR 58", b"Zhang^XiaoDong=\x1b$)A\xd5\xc5^\x1b$)A\xd0\xa1\xb6\xab", "Zhang^XiaoDong=张^小东"),
        ] {
            assert_eq!(Charset::of(set).text(bytes), text);
        }
    }

    #[test]
    fn what_is_in_no_set_is_replaced() {
        assert_eq!(Charset::of(b"").text(b"M\xfcller"), "M\u{fffd}ller");
        assert_eq!(Charset::of(b"ISO_IR 999").text(b"\x1b-A\xfc"), "\u{fffd}-A\u{fffd}");
    }
}
