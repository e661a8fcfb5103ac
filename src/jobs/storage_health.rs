//! Whether the database and the data directory work, for whoever asks. That may be anybody, and as often as they like: so
//! an answer is kept for a second, and looking writes nothing. Writes are tried at intervals, whoever asks.

use std::time::Duration;

use tokio::sync::Mutex;
use tokio::time::Instant;

use super::store::Store;
use super::store::blobs::Blobs;

/// How long an answer is kept.
const KEPT: Duration = Duration::from_secs(1);

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
    /// What the last writes found.
    tried: Mutex<Storage>,
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
        let tried = *self.tried.lock().await;
        let found = Storage {
            is_store_broken: tried.is_store_broken || store.check_readable().await.is_err(),
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
        *self.tried.lock().await = found;
    }
}
