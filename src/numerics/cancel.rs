//! How long work is stopped before its end.

/// The user asked to stop.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("cancelled")]
pub struct Cancelled;

/// Asked at every slice of long work, by the thread that does it: `Err` once the work is to end. A slice
/// takes a few milliseconds at most, even of the largest input, and so much that asking costs nothing.
pub type GoOn<'a> = dyn Fn() -> Result<(), Cancelled> + Sync + 'a;

/// A [`GoOn`] that never ends the work.
///
/// # Errors
/// None.
pub fn to_the_end() -> Result<(), Cancelled> {
    Ok(())
}
