//! The surfaces of a sheet: the medial sheet and its two sides.

use serde::{Deserialize, Serialize};

/// One side of a sheet. Which of the two is the upper one is fixed by the world, see [`FrameFacts`](super::FrameFacts).
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
pub enum Side {
    /// The side that the upper nodes lie on.
    Upper,
    /// The other one.
    Lower,
}

impl Side {
    /// Both, the upper one first.
    pub const BOTH: [Self; 2] = [Self::Upper, Self::Lower];

    /// Its place in [`Self::BOTH`].
    #[must_use]
    pub(crate) fn number(self) -> usize {
        match self {
            Self::Upper => 0,
            Self::Lower => 1,
        }
    }

    /// Its name in artifacts.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Upper => "upper",
            Self::Lower => "lower",
        }
    }
}

/// A value for each of the three surfaces of a figure.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct PerSurface<T> {
    /// The medial sheet.
    pub medial: T,
    /// The upper side.
    pub upper: T,
    /// The lower side.
    pub lower: T,
}

impl<T> PerSurface<T> {
    /// Something of each of the three.
    #[must_use]
    pub fn map<'a, U>(&'a self, of: impl Fn(&'a T) -> U) -> PerSurface<U> {
        PerSurface { medial: of(&self.medial), upper: of(&self.upper), lower: of(&self.lower) }
    }

    /// The three with their names, in the order medial, upper, lower.
    #[must_use]
    pub fn named(&self) -> [(&'static str, &T); 3] {
        [("medial", &self.medial), ("upper", &self.upper), ("lower", &self.lower)]
    }
}
