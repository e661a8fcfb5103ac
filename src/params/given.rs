//! A value as it was given, before it is known what for.

use std::fmt::{self, Write};

/// Characters of a given text that an error repeats.
const MAX_ECHO: usize = 60;

/// A value as JSON and its kin have them. Whole numbers keep all their digits; names of an object are
/// each there once.
#[derive(Clone, Debug, PartialEq)]
pub enum Given {
    /// No value.
    Nothing,
    /// Yes or no.
    Flag(bool),
    /// A number that was written as a whole one.
    Whole(i128),
    /// Any other number.
    Number(f64),
    /// A text.
    Text(String),
    /// A list.
    List(Vec<Given>),
    /// Values by name, in the order given.
    Object(Vec<(String, Given)>),
}

impl Given {
    /// A text.
    #[must_use]
    pub fn text(text: &str) -> Self {
        Self::Text(text.to_owned())
    }

    /// A count.
    #[must_use]
    pub fn count(count: usize) -> Self {
        Self::Whole(count as i128)
    }

    /// Values by name.
    #[must_use]
    pub fn object<const N: usize>(entries: [(&str, Self); N]) -> Self {
        Self::Object(entries.map(|(name, value)| (name.to_owned(), value)).into())
    }

    /// The number, whole or not.
    #[must_use]
    pub fn as_number(&self) -> Option<f64> {
        match self {
            Self::Whole(whole) => Some(*whole as f64),
            Self::Number(number) => Some(*number),
            _ => None,
        }
    }

    /// The whole number, if `T` holds it.
    #[must_use]
    pub fn as_whole<T: TryFrom<i128>>(&self) -> Option<T> {
        match self {
            Self::Whole(whole) => T::try_from(*whole).ok(),
            _ => None,
        }
    }

    /// The text.
    #[must_use]
    pub fn as_text(&self) -> Option<&str> {
        match self {
            Self::Text(text) => Some(text),
            _ => None,
        }
    }

    /// The value of this name, of an object.
    #[must_use]
    pub fn part(&self, name: &str) -> Option<&Self> {
        match self {
            Self::Object(entries) => entries.iter().find(|(key, _)| key == name).map(|(_, value)| value),
            _ => None,
        }
    }
}

/// As JSON, without spaces.
impl fmt::Display for Given {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Nothing => f.write_str("null"),
            Self::Flag(flag) => flag.fmt(f),
            Self::Whole(whole) => whole.fmt(f),
            // The form with an exponent where digits would be many.
            Self::Number(number) => write!(f, "{number:?}"),
            Self::Text(text) => write_quoted(f, text),
            Self::List(entries) => {
                f.write_char('[')?;
                for (n, entry) in entries.iter().enumerate() {
                    write!(f, "{}{entry}", comma(n))?;
                }
                f.write_char(']')
            }
            Self::Object(entries) => {
                f.write_char('{')?;
                for (n, (name, value)) in entries.iter().enumerate() {
                    f.write_str(comma(n))?;
                    write_quoted(f, name)?;
                    write!(f, ":{value}")?;
                }
                f.write_char('}')
            }
        }
    }
}

fn comma(n: usize) -> &'static str {
    if n == 0 { "" } else { "," }
}

fn write_quoted(f: &mut fmt::Formatter<'_>, text: &str) -> fmt::Result {
    f.write_char('"')?;
    for c in text.chars() {
        match c {
            '"' | '\\' => write!(f, "\\{c}")?,
            c if c.is_control() => write!(f, "\\u{:04x}", u32::from(c))?,
            c => f.write_char(c)?,
        }
    }
    f.write_char('"')
}

/// The start of a text, without control characters: it ends up in a terminal.
#[must_use]
pub(crate) fn echo(text: &str) -> String {
    let mut short: String = text.chars().filter(|c| !c.is_control()).take(MAX_ECHO).collect();
    if text.chars().nth(MAX_ECHO).is_some() {
        short.push('…');
    }
    short
}
