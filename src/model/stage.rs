//! The stages that a result comes through, and the time each took.

use serde::{Deserialize, Serialize};

use std::time::Duration;

/// The stages in the order of the paper; their names are those of `timings_ms`. They run in another: sheets are laid
/// flat and cut before the sides are looked for, see `pipeline::stages`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
pub enum Stage {
    /// Cutting out, cleaning, resampling and smoothing the mask.
    Mask,
    /// The sub-voxel skin, and the depth of every voxel below it.
    Distance,
    /// Thinning to the medial surface.
    Skeleton,
    /// Single sheets and junctions.
    Sheets,
    /// Upper, lower and crest.
    Sides,
    /// Flattening.
    Isomap,
    /// Lattice and map back to space.
    Lattice,
    /// Thickness vectors.
    Spokes,
    /// Legality and quality.
    Quality,
}

impl Stage {
    /// All stages in order.
    pub const ALL: [Self; 9] = [
        Self::Mask,
        Self::Distance,
        Self::Skeleton,
        Self::Sheets,
        Self::Sides,
        Self::Isomap,
        Self::Lattice,
        Self::Spokes,
        Self::Quality,
    ];

    /// The name in `timings_ms` and in progress reports.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Mask => "mask",
            Self::Distance => "distance",
            Self::Skeleton => "skeleton",
            Self::Sheets => "sheets",
            Self::Sides => "sides",
            Self::Isomap => "isomap",
            Self::Lattice => "lattice",
            Self::Spokes => "spokes",
            Self::Quality => "quality",
        }
    }
}

/// Wall milliseconds of each stage, in the order of [`Stage::ALL`].
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct StageTimings(pub [f64; Stage::ALL.len()]);

impl StageTimings {
    /// Milliseconds of one stage.
    #[must_use]
    pub fn of(&self, stage: Stage) -> f64 {
        self.0[stage as usize]
    }

    /// Adds to the time of one stage.
    pub fn add(&mut self, stage: Stage, time: Duration) {
        self.0[stage as usize] += time.as_secs_f64() * 1e3;
    }

    /// Adds the time of every stage.
    pub fn add_all(&mut self, other: &Self) {
        for (own, more) in self.0.iter_mut().zip(other.0) {
            *own += more;
        }
    }

    /// Milliseconds of all stages.
    #[must_use]
    pub fn total(&self) -> f64 {
        self.0.iter().sum()
    }
}
