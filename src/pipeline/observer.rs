//! How a stage speaks while it works: progress, warnings, and whether to stop.

pub use crate::numerics::cancel::Cancelled;

/// The stages in the order of the paper; their names are those of `timings_ms`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Stage {
    /// Cutting out, cleaning, resampling and smoothing the mask, and its sub-voxel skin.
    Mask,
    /// The depth of every voxel below the skin.
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

/// Something about a result that its reader should know. Codes are stable.
#[derive(Clone, Debug, PartialEq)]
pub struct Warning {
    /// Stable code, snake case.
    pub code: &'static str,
    /// One sentence, with figures.
    pub message: String,
}

/// Listens to a run. Called from worker threads.
pub trait Observer: Sync {
    /// Structures of so many voxels will be worked on; said once, before all else.
    fn begun(&self, _voxels: &[u64]) {}

    /// `stage` of structure `structure` of `structures` has reached `fraction` (0 to 1).
    fn progress(&self, structure: usize, structures: usize, stage: Stage, fraction: f64);

    /// `done` of the `repeats` that follow the stages of a structure are done; said with 0 before the first stage.
    fn repeated(&self, _structure: usize, _structures: usize, _done: usize, _repeats: usize) {}

    /// All is done of a structure, whether it has a medial representation or not.
    fn ended(&self, _structure: usize, _structures: usize) {}

    /// Whether the run should stop; asked at every slice of work, so it must be cheap.
    fn is_cancelled(&self) -> bool {
        false
    }

    /// `Err` once the run should stop.
    ///
    /// # Errors
    /// [`Cancelled`] when [`Self::is_cancelled`].
    fn check(&self) -> Result<(), Cancelled> {
        if self.is_cancelled() { Err(Cancelled) } else { Ok(()) }
    }
}

/// An observer that hears nothing and never stops a run.
pub struct Silent;

impl Observer for Silent {
    fn progress(&self, _structure: usize, _structures: usize, _stage: Stage, _fraction: f64) {}
}
