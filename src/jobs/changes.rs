//! Tells those who wait that something happened to a job in this process. What happens in another
//! one is seen by looking again, every [`RECHECK`].

use std::collections::BTreeMap;
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use tokio::sync::watch;

use super::job::JobId;

/// How often one who waits looks whether another process changed the job.
pub const RECHECK: Duration = Duration::from_secs(1);

/// How often something happened.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Happened {
    /// The job came into another state.
    pub states: u64,
    /// Its run came further.
    pub steps: u64,
}

/// Those who wait, by job.
#[derive(Debug, Default)]
pub struct Changes {
    watched: Mutex<BTreeMap<JobId, watch::Sender<Happened>>>,
}

impl Changes {
    /// Hears of a job from now on.
    #[must_use]
    pub fn watch(&self, id: JobId) -> watch::Receiver<Happened> {
        let mut watched = self.watched();
        // Those nobody listens to any more are dropped here: their number stays that of listeners.
        watched.retain(|other, sender| *other == id || !sender.is_closed());
        watched.entry(id).or_insert_with(|| watch::Sender::new(Happened::default())).subscribe()
    }

    pub(super) fn state(&self, id: JobId) {
        self.tell(id, |happened| happened.states += 1);
    }

    pub(super) fn step(&self, id: JobId) {
        self.tell(id, |happened| happened.steps += 1);
    }

    fn tell(&self, id: JobId, change: impl FnOnce(&mut Happened)) {
        if let Some(sender) = self.watched().get(&id) {
            sender.send_modify(change);
        }
    }

    fn watched(&self) -> MutexGuard<'_, BTreeMap<JobId, watch::Sender<Happened>>> {
        // Nothing panics while it is held.
        self.watched.lock().unwrap_or_else(PoisonError::into_inner)
    }
}
