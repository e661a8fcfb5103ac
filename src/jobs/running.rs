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
    /// What is done of each structure. Several are worked on side by side.
    done: Vec<Done>,
}

/// What is done of a structure.
#[derive(Clone, Debug, Default)]
struct Done {
    /// Share of its stages.
    stages: f64,
    /// Repeats that follow them, each of which takes as long.
    repeats: usize,
    repeated: usize,
}

#[expect(clippy::cast_precision_loss, reason = "a few stages and repeats of a few structures")]
impl Told {
    fn tell(&mut self, structure: usize, structures: usize, stage: Stage, fraction: f64) {
        let stages_done = Stage::ALL.iter().take_while(|s| **s < stage).count() as f64 + fraction.clamp(0.0, 1.0);
        let done = self.done_of(structure, structures);
        // A structure whose sheets are cut goes through some stages again: what was done stays done.
        done.stages = done.stages.max(stages_done / Stage::ALL.len() as f64);
        self.last = Progress { stage: Some(stage), structures, structure, fraction: self.fraction() };
    }

    fn tell_repeat(&mut self, structure: usize, structures: usize, repeated: usize, repeats: usize) {
        let done = self.done_of(structure, structures);
        done.repeats = repeats;
        done.repeated = done.repeated.max(repeated);
        self.last = Progress { structures, structure, fraction: self.fraction(), ..self.last };
    }

    fn done_of(&mut self, structure: usize, structures: usize) -> &mut Done {
        self.done.resize(structures.max(structure + 1), Done::default());
        &mut self.done[structure]
    }

    fn fraction(&self) -> f64 {
        let share = |done: &Done| (done.stages + done.repeated as f64) / (1 + done.repeats) as f64;
        self.done.iter().map(share).sum::<f64>() / self.done.len() as f64
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
        self.told().last
    }

    fn told(&self) -> MutexGuard<'_, Told> {
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
    fn progress(&self, structure: usize, structures: usize, stage: Stage, fraction: f64) {
        self.told().tell(structure, structures, stage, fraction);
        self.changes.step(self.lease.id);
    }

    fn repeated(&self, structure: usize, structures: usize, done: usize, repeats: usize) {
        self.told().tell_repeat(structure, structures, done, repeats);
        self.changes.step(self.lease.id);
    }
}

impl Cancel for Running {
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

    #[test]
    fn repeats_count_as_much_as_the_run_that_they_repeat() {
        let mut told = Told::default();
        told.tell_repeat(0, 1, 0, 3);
        told.tell(0, 1, Stage::Quality, 1.0);
        assert!((told.last.fraction - 0.25).abs() < 1e-12);
        // They end in any order.
        for (done, fraction) in [(2, 0.75), (1, 0.75), (3, 1.0)] {
            told.tell_repeat(0, 1, done, 3);
            assert!((told.last.fraction - fraction).abs() < 1e-12, "{done}");
        }
        assert_eq!(told.last.stage, Some(Stage::Quality));
    }
}
