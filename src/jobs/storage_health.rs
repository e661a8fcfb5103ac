//! Whether the database and the data directory work, for whoever asks. That may be anybody, and as often as they like: so
//! an answer is kept for a second, and looking writes nothing. Writes are tried at intervals, whoever asks.

use std::sync::Arc;
use std::sync::atomic::AtomicBool;
use std::sync::atomic::Ordering::Relaxed;
use std::time::Duration;

use tokio::sync::Mutex;
use tokio::time::{Instant, MissedTickBehavior, interval};

use super::service::Jobs;
use super::store::blobs::Blobs;
use super::store::{Store, StoreError};

/// How long an answer is kept.
const KEPT: Duration = Duration::from_secs(1);
/// How often writes are tried.
const TRY: Duration = Duration::from_secs(5);
/// How long after the last writes were tried it is taken that they do not end: a disk that hangs does not say so. Less than
/// a few tries would tell of a disk that is slow.
const HANGS: Duration = Duration::from_secs(15);

/// What of the storage does not work.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct Storage {
    /// The database.
    pub is_store_broken: bool,
    /// The data directory.
    pub is_folder_broken: bool,
}

/// What is known of the storage.
#[derive(Debug, Default)]
pub(super) struct StorageHealth {
    /// What the last look found, and when.
    looked: Mutex<Option<(Instant, Storage)>>,
    /// What the last writes found, and when.
    tried: Mutex<Option<(Instant, Storage)>>,
    /// Whether workers cannot claim jobs.
    are_claims_failing: AtomicBool,
    /// Whether the database was seen to be damaged. It does not mend itself.
    is_corrupt: AtomicBool,
}

/// Tries whether writes still go, for ever. On a task of its own: erasing much takes minutes.
pub(super) async fn watch(jobs: Arc<Jobs>) {
    let mut ticks = interval(TRY);
    ticks.set_missed_tick_behavior(MissedTickBehavior::Delay);
    loop {
        ticks.tick().await;
        jobs.try_storage().await;
    }
}

/// What is to be taken of the last try.
fn judge(tried: Option<(Instant, Storage)>, now: Instant) -> Storage {
    match tried {
        None => Storage::default(),
        Some((when, _)) if now.duration_since(when) > HANGS => {
            Storage { is_store_broken: true, is_folder_broken: true }
        }
        Some((_, found)) => found,
    }
}

impl StorageHealth {
    /// How it is now, a second ago at the most.
    pub async fn now(&self, store: &dyn Store, blobs: &Blobs) -> Storage {
        // Held while it is looked: whoever asks meanwhile gets the same answer.
        let mut looked = self.looked.lock().await;
        if let Some((when, found)) = *looked
            && when.elapsed() < KEPT
        {
            return found;
        }
        let tried = judge(*self.tried.lock().await, Instant::now());
        let is_seen_broken = self.are_claims_failing.load(Relaxed) || self.is_corrupt.load(Relaxed);
        let found = Storage {
            is_store_broken: tried.is_store_broken || is_seen_broken || store.check_readable().await.is_err(),
            is_folder_broken: tried.is_folder_broken || blobs.look().is_err(),
        };
        *looked = Some((Instant::now(), found));
        found
    }

    /// Tries whether both take a write.
    pub async fn try_writes(&self, store: &dyn Store, blobs: &Blobs) {
        let found = Storage {
            is_store_broken: store.check_writable().await.is_err(),
            is_folder_broken: blobs.check_writable().await.is_err(),
        };
        *self.tried.lock().await = Some((Instant::now(), found));
    }

    /// Whether a worker could ask for a job.
    pub fn claims(&self, work: bool) {
        self.are_claims_failing.store(!work, Relaxed);
    }

    /// Looks at what became of a request.
    pub fn hear<T>(&self, answer: &Result<T, StoreError>) {
        if matches!(answer, Err(StoreError::Corrupt(_))) {
            self.is_corrupt.store(true, Relaxed);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn writes_that_do_not_end_are_broken_ones() {
        let begun = Instant::now();
        let (well, broken) = (Storage::default(), Storage { is_store_broken: true, is_folder_broken: true });
        assert_eq!(judge(None, begun + 2 * HANGS), well, "none was tried yet");
        assert_eq!(judge(Some((begun, well)), begun + HANGS), well);
        assert_eq!(judge(Some((begun, well)), begun + HANGS + TRY), broken);
    }
}
