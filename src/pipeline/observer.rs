//! How a stage speaks while it works: progress, warnings, and whether to stop.

use crate::model::Stage;
pub use crate::numerics::cancel::Cancelled;

/// Listens to a run. Called from worker threads.
pub trait Observer: Sync {
    /// `stage` of structure `structure` of `structures` has reached `fraction` (0 to 1).
    fn progress(&self, structure: usize, structures: usize, stage: Stage, fraction: f64);

    /// `done` of the `repeats` that follow the stages of a structure are done; said with 0 before the first stage.
    fn repeated(&self, _structure: usize, _structures: usize, _done: usize, _repeats: usize) {}

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
