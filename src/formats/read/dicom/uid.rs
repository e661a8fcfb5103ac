//! Unique identifiers (PS3.5 chapter 9).

use std::fmt;

use super::values::plain;

/// Longest identifier.
const MAX_UID_BYTES: usize = 64;

/// A unique identifier of DICOM: numbers with dots between them. It can stand in a path as it is.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Uid(String);

impl Uid {
    /// Reads one. Leading zeros of a number are forbidden and taken all the same: archives hold such studies, and find
    /// them by the very text.
    #[must_use]
    pub fn parse(text: &str) -> Option<Self> {
        let is_number = |part: &str| !part.is_empty() && part.bytes().all(|byte| byte.is_ascii_digit());
        (text.len() <= MAX_UID_BYTES && text.split('.').all(is_number)).then(|| Self(text.to_owned()))
    }

    /// Reads one as it stands in a file, padded to an even length.
    pub(super) fn of_file(bytes: &[u8]) -> Option<Self> {
        Self::parse(plain(bytes)?)
    }

    /// The text.
    #[must_use]
    pub fn as_str(&self) -> &str {
        &self.0
    }
}

impl fmt::Display for Uid {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn identifiers_are_numbers_and_dots() {
        let longest = format!("2.25.{}", "1".repeat(59));
        for good in ["1", "1.2.840.10008.1.2", "2.25.0", "1.02", &longest] {
            assert!(Uid::parse(good).is_some(), "{good}");
        }
        let long = format!("{longest}1");
        for bad in ["", ".", "..", "1.", ".1", "1..2", "1/2", "1.2%2e", "1 ", "a", "１", &long] {
            assert!(Uid::parse(bad).is_none(), "{bad}");
        }
        assert_eq!(Uid::of_file(b"1.2\0"), Uid::parse("1.2"));
    }
}
