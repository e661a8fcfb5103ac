//! The surfaces of a sheet: the medial sheet and its two sides.

/// A value for each of the three surfaces of a figure.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct PerSurface<T> {
    /// The medial sheet.
    pub medial: T,
    /// The side that [`Figure::upper`] lies on.
    pub upper: T,
    /// The other side.
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
