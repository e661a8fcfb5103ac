//! Work that waits for the disk or takes a processor for long. The threads that answer requests are few:
//! one that waits makes all others wait.

use std::io;

use tokio::task::spawn_blocking;

/// Does it on a thread of its own. Goes on though nobody waits for it any more.
///
/// # Errors
/// Those of the work, and when it panicked.
pub async fn on_own_thread<T: Send + 'static>(work: impl FnOnce() -> io::Result<T> + Send + 'static) -> io::Result<T> {
    spawn_blocking(work).await?
}
