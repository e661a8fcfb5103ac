//! Who listens to a run.

use crate::cancel::Cancel;
use crate::model::Stage;

/// Memory that a run may take when nothing is said.
pub const MEMORY_BYTES: u64 = 3 << 30;

/// Listens to a run, and may stop it ([`Cancel`]). Called from worker threads.
pub trait Observer: Cancel {
    /// Memory that the run may take. What would need more is refused before it begins.
    fn memory_bytes(&self) -> u64 {
        MEMORY_BYTES
    }

    /// Structures of so many voxels will be worked on; said once, before all else.
    fn begun(&self, _voxels: &[u64]) {}

    /// `stage` of structure `structure` of `structures` has reached `fraction` (0 to 1). A structure of several
    /// sheets goes through some stages once for each sheet: then `fraction` is that of all sheets.
    fn progress(&self, structure: usize, structures: usize, stage: Stage, fraction: f64);

    /// `done` of the `repeats` that follow the stages of a structure are done; said with 0 before the first stage.
    fn repeated(&self, _structure: usize, _structures: usize, _done: usize, _repeats: usize) {}

    /// All is done of a structure, whether it has a medial representation or not.
    fn ended(&self, _structure: usize, _structures: usize) {}
}

/// An observer that hears nothing and never stops a run.
#[derive(Clone, Copy, Debug, Default)]
pub struct Silent;

impl Cancel for Silent {}

impl Observer for Silent {
    fn progress(&self, _structure: usize, _structures: usize, _stage: Stage, _fraction: f64) {}
}

/// Passes a wish to stop on, and no progress.
pub(super) struct Muted<'a>(pub &'a dyn Observer);

impl Cancel for Muted<'_> {
    fn is_cancelled(&self) -> bool {
        self.0.is_cancelled()
    }
}

impl Observer for Muted<'_> {
    fn memory_bytes(&self) -> u64 {
        self.0.memory_bytes()
    }

    fn progress(&self, _structure: usize, _structures: usize, _stage: Stage, _fraction: f64) {}
}
