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

/// What the run has told of itself.
#[derive(Debug, Default)]
struct Told {
    last: Progress,
    /// Share of each structure that is done. Several are worked on side by side.
    done: Vec<f64>,
}

impl Told {
    #[expect(clippy::cast_precision_loss, reason = "a few stages of a few structures")]
    fn tell(&mut self, structure: usize, structures: usize, stage: Stage, fraction: f64) {
        self.done.resize(structures.max(structure + 1), 0.0);
        let stages_done = Stage::ALL.iter().take_while(|s| **s < stage).count() as f64 + fraction.clamp(0.0, 1.0);
        // A structure whose sheets are cut goes through some stages again: what was done stays done.
        self.done[structure] = self.done[structure].max(stages_done / Stage::ALL.len() as f64);
        let fraction = self.done.iter().sum::<f64>() / self.done.len() as f64;
        self.last = Progress { stage: Some(stage), structures, structure, fraction };
    }
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
    progress: Mutex<Told>,
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
        self.progress.lock().unwrap_or_else(PoisonError::into_inner).last
    }
}

impl Observer for Running {
    fn progress(&self, structure: usize, structures: usize, stage: Stage, fraction: f64) {
        self.progress.lock().unwrap_or_else(PoisonError::into_inner).tell(structure, structures, stage, fraction);
        self.changes.step(self.lease.id);
    }

    fn is_cancelled(&self) -> bool {
        self.stop.load(Ordering::Relaxed)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn structures_side_by_side_never_take_progress_back() {
        let mut told = Told::default();
        let mut before = 0.0;
        let begun = [(2, Stage::Quality, 0.5), (0, Stage::Mask, 0.1), (1, Stage::Isomap, 1.0)];
        let again = [(1, Stage::Lattice, 0.2), (1, Stage::Isomap, 0.5), (2, Stage::Quality, 1.0)];
        for (structure, stage, fraction) in begun.into_iter().chain(again) {
            told.tell(structure, 3, stage, fraction);
            assert!(told.last.fraction >= before, "{structure} {stage:?} {fraction}");
            assert_eq!((told.last.structure, told.last.stage), (structure, Some(stage)));
            before = told.last.fraction;
        }
        for structure in 0..3 {
            told.tell(structure, 3, Stage::Quality, 1.0);
        }
        assert!((told.last.fraction - 1.0).abs() < 1e-12);
    }
}
