//! Headers of text: their lines with their numbers, what is wrong with one, and numbers in them.

use std::collections::BTreeMap;

use super::error::ReadError;
use super::stream::Stream;

/// Bytes of a line: descriptions of segments take a few hundred, lists of terms some thousand.
const MAX_LINE_BYTES: usize = 1 << 18;
/// Bytes of a header: one of a hundred segments takes about 100 000.
const MAX_HEADER_BYTES: u64 = 1 << 24;
/// Numbers in a line: a matrix of four by four has 16.
const MAX_NUMBERS: usize = 32;
/// Numbers from here on are no places or lengths in millimetres of anything that is scanned.
const TOO_LARGE: f64 = 1e7;

/// A line that means something: what is said in it, of a field with a known name.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Line {
    /// From 1.
    pub number: u64,
    /// The field as the format spells it.
    pub field: &'static str,
    /// What it is, without space around.
    pub value: String,
}

/// What is wrong with a line of a header. Holds numbers and fixed words only: a header may name a patient.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum LineFault {
    /// Something else than it should be.
    #[error("it should be {expected}")]
    Malformed {
        /// What it should be.
        expected: &'static str,
    },
    /// Something that is not read.
    #[error("{what} is not read")]
    Unsupported {
        /// What it is.
        what: &'static str,
        /// What to do.
        hint: &'static str,
    },
    /// Voxels in another file.
    #[error("the voxels are in another file, which is not opened")]
    Detached {
        /// What to do.
        hint: &'static str,
    },
    /// No usable orientation.
    #[error("the orientation is unusable: {reason}")]
    Orientation {
        /// What is wrong with it.
        reason: String,
    },
    /// More voxels than allowed.
    #[error("{voxels} voxels, allowed are {allowed}")]
    TooManyVoxels {
        /// Voxels, of all layers.
        voxels: u128,
        /// Voxels allowed.
        allowed: u64,
    },
    /// A series or a vector image.
    #[error("the file holds {count} volumes, one is needed")]
    SeveralVolumes {
        /// Their number.
        count: u64,
    },
}

impl LineFault {
    /// Stable code, snake case.
    #[must_use]
    pub fn code(&self) -> &'static str {
        match self {
            Self::Malformed { .. } => "bad_header_line",
            Self::Unsupported { .. } => "unsupported_header",
            Self::Detached { .. } => "detached_header",
            Self::Orientation { .. } => "bad_affine",
            Self::TooManyVoxels { .. } => "too_many_voxels",
            Self::SeveralVolumes { .. } => "several_volumes",
        }
    }

    /// HTTP status.
    #[must_use]
    pub fn status(&self) -> u16 {
        match self {
            Self::Malformed { .. } => 400,
            Self::TooManyVoxels { .. } => 413,
            Self::Detached { .. } => 415,
            Self::Unsupported { .. } | Self::Orientation { .. } | Self::SeveralVolumes { .. } => 422,
        }
    }

    /// What to do.
    #[must_use]
    pub fn hint(&self) -> &'static str {
        match self {
            Self::Malformed { .. } => "export the mask again, or repair the line: the header is text",
            Self::Unsupported { hint, .. } | Self::Detached { hint } => hint,
            Self::Orientation { .. } => "set finite axes of which no two are parallel, with a spacing in mm",
            Self::TooManyVoxels { .. } => "crop the volume to the structures of interest, or resample it",
            Self::SeveralVolumes { .. } => "send one volume: split the series and send the one with the mask",
        }
    }
}

/// A line with this number that is none of a known field.
pub(super) fn unknown_line(line: u64, expected: &'static str) -> ReadError {
    ReadError::HeaderLine { line, field: "", fault: LineFault::Malformed { expected } }
}

impl Line {
    /// The error that something is wrong with it.
    pub fn fault(&self, fault: LineFault) -> ReadError {
        ReadError::HeaderLine { line: self.number, field: self.field, fault }
    }

    /// The error that it should be something else.
    pub fn malformed(&self, expected: &'static str) -> ReadError {
        self.fault(LineFault::Malformed { expected })
    }

    /// The error that what it says is not read.
    pub fn unsupported(&self, what: &'static str, hint: &'static str) -> ReadError {
        self.fault(LineFault::Unsupported { what, hint })
    }

    /// All that it says, in words between spaces.
    pub fn words(&self) -> impl Iterator<Item = &str> {
        self.value.split_ascii_whitespace()
    }

    /// As many finite numbers as are wanted, and no more.
    pub fn numbers(&self, count: usize, expected: &'static str) -> Result<Vec<f64>, ReadError> {
        let numbers: Option<Vec<f64>> = self.words().take(MAX_NUMBERS + 1).map(number).collect();
        numbers.filter(|numbers| numbers.len() == count).ok_or_else(|| self.malformed(expected))
    }

    /// Lengths of axes: whole numbers above 0.
    pub fn sizes(&self, expected: &'static str) -> Result<Vec<usize>, ReadError> {
        let length = |word: &str| word.parse::<usize>().ok().filter(|length| *length > 0);
        let sizes: Option<Vec<usize>> = self.words().take(MAX_NUMBERS).map(length).collect();
        sizes.ok_or_else(|| self.malformed(expected))
    }
}

/// A finite number of a size that places and lengths have.
pub(super) fn number(word: &str) -> Option<f64> {
    word.parse::<f64>().ok().filter(|number| number.abs() < TOO_LARGE)
}

/// The lines of a header that mean something, by field.
#[derive(Debug, Default)]
pub(super) struct Fields {
    lines: BTreeMap<&'static str, Line>,
}

impl Fields {
    /// Adds a line.
    ///
    /// # Errors
    /// When there is one of that field already: no one knows which was meant.
    pub fn add(&mut self, line: Line) -> Result<(), ReadError> {
        if self.lines.contains_key(line.field) {
            return Err(line.malformed("the only line of this field"));
        }
        self.lines.insert(line.field, line);
        Ok(())
    }

    /// The line of a field.
    pub fn get(&self, field: &str) -> Option<&Line> {
        self.lines.get(field)
    }

    /// The line of a field without which nothing can be read.
    pub fn needed(&self, field: &'static str) -> Result<&Line, ReadError> {
        self.get(field).ok_or(ReadError::NoHeaderLine { field })
    }
}

/// Reads lines, and counts them.
pub(super) struct Lines<'s, 'a> {
    stream: &'s mut Stream<'a>,
    start: u64,
    number: u64,
}

impl<'s, 'a> Lines<'s, 'a> {
    /// From here on.
    pub fn of(stream: &'s mut Stream<'a>) -> Self {
        let start = stream.position();
        Self { stream, start, number: 0 }
    }

    /// The number of the line that was read last.
    pub fn number(&self) -> u64 {
        self.number
    }

    /// The next line without its end (LF or CR LF).
    ///
    /// # Errors
    /// When the file ends before the line does, or line or header are longer than any that means something.
    pub fn next(&mut self) -> Result<Vec<u8>, ReadError> {
        self.number += 1;
        let mut line = self.stream.line(MAX_LINE_BYTES)?;
        if line.len() == MAX_LINE_BYTES {
            return Err(unknown_line(self.number, "a line of at most 262144 bytes"));
        }
        if line.pop() != Some(b'\n') {
            let got = self.stream.position();
            return Err(ReadError::Truncated { expected: got + 1, got });
        }
        if self.stream.position() - self.start > MAX_HEADER_BYTES {
            return Err(unknown_line(self.number, "within the first 16777216 bytes, as all of the header"));
        }
        if line.last() == Some(&b'\r') {
            line.pop();
        }
        Ok(line)
    }
}
