//! A value for each surface of a sheet.

use serde::{Deserialize, Serialize};

use crate::model::PerSurface;

/// A value for each of the three surfaces of a sheet.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[allow(missing_docs, reason = "fields are those of PerSurface")]
pub struct Surfaces<T> {
    pub medial: T,
    pub upper: T,
    pub lower: T,
}

impl<T> Surfaces<T> {
    /// Something of each.
    pub(super) fn of<'a, U>(all: &'a PerSurface<U>, write: impl Fn(&'a U) -> T) -> Self {
        Self { medial: write(&all.medial), upper: write(&all.upper), lower: write(&all.lower) }
    }
}
