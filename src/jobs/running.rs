//! Jobs that run in this process: hears of their progress and can stop them.

use std::collections::BTreeMap;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use tokio_util::sync::CancellationToken;

use super::changes::Changes;
use super::job::JobId;
use super::store::Lease;
use crate::cancel::Cancel;
use crate::model::Stage;
use crate::pipeline::observer::Observer;
use crate::pipeline::progress::{Overall, Progress};

/// A run under way.
#[derive(Debug)]
pub(super) struct Running {
    pub(super) lease: Lease,
    stop: AtomicBool,
    /// When it has taken too long.
    deadline: Instant,
    /// Whether that is why it was stopped.
    is_late: AtomicBool,
    progress: Mutex<Overall>,
    changes: Arc<Changes>,
    /// Cancelled once the run has let go of its files.
    pub(super) ended: CancellationToken,
}

impl Running {
    pub(super) fn new(lease: Lease, longest: Duration, changes: Arc<Changes>) -> Self {
        Self {
            lease,
            stop: AtomicBool::new(false),
            deadline: Instant::now() + longest,
            is_late: AtomicBool::new(false),
            progress: Mutex::default(),
            changes,
            ended: CancellationToken::new(),
        }
    }

    pub(super) fn stop(&self) {
        self.stop.store(true, Ordering::Relaxed);
    }

    /// Stops it when it has taken too long. Looked at from outside, now and then: the run itself asks too
    /// often whether to stop to look at a clock each time.
    pub(super) fn stop_if_late(&self) {
        if Instant::now() >= self.deadline && !self.stop.load(Ordering::Relaxed) {
            self.is_late.store(true, Ordering::Relaxed);
            self.stop();
        }
    }

    /// Whether it was its time that ran out, not somebody who stopped it.
    pub(super) fn took_too_long(&self) -> bool {
        self.is_late.load(Ordering::Relaxed)
    }

    pub(super) fn progress(&self) -> Progress {
        self.told().progress()
    }

    fn told(&self) -> MutexGuard<'_, Overall> {
        // Nothing panics while it is held.
        self.progress.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// All that run in this process.
#[derive(Debug, Default)]
pub(super) struct RunningJobs {
    by_id: Mutex<BTreeMap<JobId, Arc<Running>>>,
}

impl RunningJobs {
    pub(super) fn begin(&self, running: Running) -> Arc<Running> {
        let running = Arc::new(running);
        self.by_id().insert(running.lease.id, Arc::clone(&running));
        running
    }

    /// A job that was taken away and came back is another run, which stays.
    pub(super) fn end(&self, running: &Running) {
        let mut jobs = self.by_id();
        if jobs.get(&running.lease.id).is_some_and(|other| other.lease == running.lease) {
            jobs.remove(&running.lease.id);
        }
        running.ended.cancel();
    }

    pub(super) fn get(&self, id: JobId) -> Option<Arc<Running>> {
        self.by_id().get(&id).cloned()
    }

    pub(super) fn all(&self) -> Vec<Arc<Running>> {
        self.by_id().values().cloned().collect()
    }

    /// Stops a job if it runs here.
    pub(super) fn stop(&self, id: JobId) {
        if let Some(running) = self.get(id) {
            running.stop();
        }
    }

    fn by_id(&self) -> MutexGuard<'_, BTreeMap<JobId, Arc<Running>>> {
        // Nothing panics while it is held; a poisoned map would still be whole.
        self.by_id.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Observer for Running {
    fn begun(&self, voxels: &[u64]) {
        self.told().tell_sizes(voxels);
    }

    fn progress(&self, structure: usize, structures: usize, stage: Stage, fraction: f64) {
        self.told().tell(structure, structures, stage, fraction);
        self.changes.step(self.lease.id);
    }

    fn repeated(&self, structure: usize, structures: usize, done: usize, repeats: usize) {
        self.told().tell_repeat(structure, structures, done, repeats);
        self.changes.step(self.lease.id);
    }

    fn ended(&self, structure: usize, structures: usize) {
        self.told().tell_end(structure, structures);
        self.changes.step(self.lease.id);
    }
}

impl Cancel for Running {
    fn is_cancelled(&self) -> bool {
        self.stop.load(Ordering::Relaxed)
    }
}
