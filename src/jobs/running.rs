//! A job that runs in this process: hears its progress and can stop it.

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

use tokio_util::sync::CancellationToken;

use super::changes::Changes;
use super::store::Lease;
use crate::pipeline::observer::{Observer, Stage};

/// How far a run is.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Progress {
    /// The stage, `None` while the file is read.
    pub stage: Option<Stage>,
    /// Structures, 0 while the file is read.
    pub structures: usize,
    /// The structure worked on, from 0.
    pub structure: usize,
    /// Share of the whole run, 0 to 1.
    pub fraction: f64,
}

/// A run under way.
#[derive(Debug)]
pub(super) struct Running {
    pub(super) lease: Lease,
    stop: AtomicBool,
    /// When it has taken too long.
    deadline: Instant,
    /// Whether that is why it was stopped.
    is_late: AtomicBool,
    progress: Mutex<Progress>,
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
        *self.progress.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Observer for Running {
    #[expect(clippy::cast_precision_loss, reason = "a few stages of a few structures")]
    fn progress(&self, structure: usize, structures: usize, stage: Stage, fraction: f64) {
        let stages_done = Stage::ALL.iter().take_while(|s| **s < stage).count() as f64 + fraction.clamp(0.0, 1.0);
        let structures_done = structure as f64 + stages_done / Stage::ALL.len() as f64;
        let fraction = structures_done / structures.max(1) as f64;
        *self.progress.lock().unwrap_or_else(PoisonError::into_inner) =
            Progress { stage: Some(stage), structures, structure, fraction };
        self.changes.step(self.lease.id);
    }

    fn is_cancelled(&self) -> bool {
        self.stop.load(Ordering::Relaxed)
    }
}
