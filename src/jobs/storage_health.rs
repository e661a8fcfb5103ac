//! Whether the database and the data directory work, for whoever asks. That may be anybody, and as often as they like: so
//! an answer is kept for a second, and looking writes nothing. Writes are tried at intervals, whoever asks.

use std::sync::atomic::AtomicBool;
use std::sync::atomic::Ordering::Relaxed;
use std::time::Duration;

use tokio::sync::Mutex;
use tokio::time::Instant;

use super::store::blobs::Blobs;
use super::store::{Store, StoreError};

/// How long an answer is kept.
const KEPT: Duration = Duration::from_secs(1);
/// How long after the last writes were tried it is taken that they do not end: a disk that hangs does not say so. They are tried
/// every five seconds.
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
        let tried = match *self.tried.lock().await {
            None => Storage::default(),
            Some((when, _)) if when.elapsed() > HANGS => Storage { is_store_broken: true, is_folder_broken: true },
            Some((_, found)) => found,
        };
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
