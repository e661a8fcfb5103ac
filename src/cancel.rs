//! How long work is stopped before its end.

/// The work was stopped before its end.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("cancelled")]
pub struct Cancelled;

/// Says whether work is to stop before its end.
///
/// It is asked at every slice of long work, by the thread that does it. A slice takes a few milliseconds at
/// most, even of the largest input, and so much that asking costs nothing.
pub trait Cancel: Sync {
    /// Whether the work should stop. Must be cheap.
    fn is_cancelled(&self) -> bool {
        false
    }

    /// `Err` once the work should stop.
    ///
    /// # Errors
    /// [`Cancelled`] when [`Self::is_cancelled`].
    fn check(&self) -> Result<(), Cancelled> {
        if self.is_cancelled() { Err(Cancelled) } else { Ok(()) }
    }
}

/// Work that is never stopped.
#[derive(Clone, Copy, Debug, Default)]
pub struct Never;

impl Cancel for Never {}

/// Work that is to stop at once.
#[cfg(test)]
pub(crate) struct Stopped;

#[cfg(test)]
impl Cancel for Stopped {
    fn is_cancelled(&self) -> bool {
        true
    }
}
