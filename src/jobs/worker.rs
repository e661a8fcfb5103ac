//! The workers: each claims a job, runs it on a blocking thread, and writes its outcome.
//!
//! A lease bounds how long a job is held by a worker that is gone. The heartbeat extends the
//! leases of what runs here, and gives jobs whose lease ran out to whoever is alive.

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::time::Duration;

use jiff::{SignedDuration, Timestamp};
use tokio::task::{JoinHandle, spawn_blocking};
use tokio::time::{Instant, MissedTickBehavior, interval, sleep, timeout, timeout_at};
use tokio_util::sync::CancellationToken;

use super::blobs::Blobs;
use super::job::{Job, JobId, JobWarning, RequestedParams, ResultFile};
use super::process::{Artifact, InputLimits, ProcessError, Processed};
use super::queue::{Jobs, JobsError, Running};
use super::store::{Claim, Outcome, Reclaim, StoreError};
use crate::pipeline::observer::{Observer, Warning};
use crate::pipeline::params::CheckedParams;
use crate::problem::Problem;

/// How long a silent worker keeps its job. Three heartbeats, so that one may be lost.
const LEASE: SignedDuration = SignedDuration::from_secs(30);
/// How often leases are extended.
const HEARTBEAT: Duration = Duration::from_secs(10);
/// How often an idle worker looks for jobs though nobody woke it.
const IDLE_POLL: Duration = Duration::from_secs(5);
/// Tries at writing an outcome before it is left to the end of the lease.
const FINISH_TRIES: u32 = 5;
/// How long runs that were put back may take to notice.
const LET_GO: Duration = Duration::from_secs(1);

/// What turns a mask into artifacts: the file, its parameters, bounds, the folder to write to,
/// and who is told. A type of its own so that tests can put another in its place.
pub type Processor = Arc<
    dyn Fn(&Path, &CheckedParams, InputLimits, &Path, &dyn Observer) -> Result<Processed, ProcessError> + Send + Sync,
>;

/// Workers under way.
pub struct Workers {
    jobs: Arc<Jobs>,
    tasks: Vec<JoinHandle<()>>,
    heartbeat: JoinHandle<()>,
    stop: CancellationToken,
}

impl Workers {
    /// Starts `count` workers.
    #[must_use]
    pub fn start(jobs: &Arc<Jobs>, processor: &Processor, count: usize) -> Self {
        let stop = CancellationToken::new();
        let spawn = |_| {
            let alive = Alive::new(Arc::clone(jobs));
            let (jobs, processor, stop) = (Arc::clone(jobs), Arc::clone(processor), stop.clone());
            tokio::spawn(async move {
                work(&jobs, &processor, &stop).await;
                drop(alive);
            })
        };
        let tasks = (0..count).map(spawn).collect();
        let heartbeat = tokio::spawn(beat(Arc::clone(jobs)));
        Self { jobs: Arc::clone(jobs), tasks, heartbeat, stop }
    }

    /// Claims nothing more, waits for what runs, and puts back to the queue what does not end in
    /// time.
    pub async fn drain(mut self, patience: Duration) {
        self.stop.cancel();
        let deadline = Instant::now() + patience;
        for task in &mut self.tasks {
            if timeout_at(deadline, task).await.is_err() {
                break;
            }
        }
        for running in self.jobs.all_running() {
            let released = self.jobs.store().release(&running.lease).await;
            tracing::info!(job = %running.lease.id, is_released = released.is_ok(), "job put back: the server stops");
            running.stop();
        }
        let let_go = async {
            while !self.jobs.all_running().is_empty() {
                sleep(Duration::from_millis(20)).await;
            }
        };
        // A run that does not notice ends with the process; its row is queued already.
        let _ = timeout(LET_GO, let_go).await;
        for task in self.tasks.into_iter().chain([self.heartbeat]).filter(|task| !task.is_finished()) {
            task.abort();
            // Once it has ended, so has its hold on the data directory.
            let _ = task.await;
        }
        self.jobs.store().close().await;
    }
}

/// Counts a worker as alive while it lives.
struct Alive(Arc<Jobs>);

impl Alive {
    fn new(jobs: Arc<Jobs>) -> Self {
        jobs.workers_alive().fetch_add(1, Ordering::Relaxed);
        Self(jobs)
    }
}

impl Drop for Alive {
    fn drop(&mut self) {
        self.0.workers_alive().fetch_sub(1, Ordering::Relaxed);
    }
}

/// Runs one job after the other. While the results of one are synced to disk and its row is written, the
/// next one runs already.
async fn work(jobs: &Arc<Jobs>, processor: &Processor, stop: &CancellationToken) {
    let mut ending: Option<Ending> = None;
    while !stop.is_cancelled() {
        let now = Timestamp::now();
        match jobs.store().claim(now, now + LEASE).await {
            Ok(Some(claim)) => {
                let ran = run(jobs, processor, claim).await;
                ended(jobs, ending.take()).await;
                ending = Some((Arc::clone(&ran.running), tokio::spawn(end(Arc::clone(jobs), ran))));
            }
            Ok(None) => wait(jobs, stop).await,
            Err(error) => {
                tracing::error!(%error, "no job can be claimed");
                wait(jobs, stop).await;
            }
        }
    }
    ended(jobs, ending).await;
}

/// A job whose outcome is being written.
type Ending = (Arc<Running>, JoinHandle<()>);

async fn ended(jobs: &Jobs, ending: Option<Ending>) {
    let Some((running, ending)) = ending else { return };
    if let Err(error) = ending.await {
        tracing::error!(job = %running.lease.id, %error, "a job was not ended; its lease runs out");
        // No longer extended by the heartbeat.
        jobs.end(&running);
    }
}

async fn wait(jobs: &Jobs, stop: &CancellationToken) {
    tokio::select! {
        () = stop.cancelled() => {}
        () = jobs.woken() => {}
        () = sleep(IDLE_POLL) => {}
    }
}

/// A job that was run, its outcome not yet known to anybody.
struct Ran {
    running: Arc<Running>,
    outcome: Outcome,
}

async fn run(jobs: &Arc<Jobs>, processor: &Processor, claim: Claim) -> Ran {
    let Claim { lease, job } = claim;
    let running = jobs.begin(lease);
    // Between the claim and this line nobody could reach the run to stop it.
    if is_unwanted(jobs, &job).await {
        running.stop();
    }
    tracing::info!(job = %job.id, attempt = job.attempt, "job begun");
    let outcome = run_blocking(jobs, processor, &job, &running).await;
    Ran { running, outcome }
}

/// Brings results to disk, then says that they are there.
async fn end(jobs: Arc<Jobs>, ran: Ran) {
    let Ran { running, mut outcome } = ran;
    if matches!(outcome, Outcome::Succeeded { .. }) {
        let (blobs, lease) = (jobs.blobs().clone(), running.lease.clone());
        let synced = spawn_blocking(move || blobs.sync_attempt(lease.id, &lease.token)).await;
        if let Err(error) = synced.unwrap_or_else(|panic| Err(std::io::Error::other(panic))) {
            outcome = storage_failed(running.lease.id, &error);
        }
    }
    let is_written = finish(&jobs, &running, &outcome).await;
    clean_up(&jobs, &running, &outcome, is_written).await;
    jobs.end(&running);
}

async fn is_unwanted(jobs: &Jobs, job: &Job) -> bool {
    jobs.store().get(job.id).await.is_ok_and(|job| job.is_none_or(|job| job.cancel_requested))
}

async fn run_blocking(jobs: &Arc<Jobs>, processor: &Processor, job: &Job, running: &Arc<Running>) -> Outcome {
    let attempt = Attempt {
        blobs: jobs.blobs().clone(),
        limits: jobs.limits().input,
        job: job.clone(),
        running: Arc::clone(running),
    };
    let processor = Arc::clone(processor);
    let ran = spawn_blocking(move || catch_unwind(AssertUnwindSafe(|| attempt.run(&processor)))).await;
    ran.ok().and_then(Result::ok).unwrap_or_else(|| {
        tracing::error!(job = %job.id, "the run panicked");
        Outcome::Failed(Box::new(Problem::internal()))
    })
}

/// One run of one job, on a blocking thread.
struct Attempt {
    blobs: Blobs,
    limits: InputLimits,
    job: Job,
    running: Arc<Running>,
}

impl Attempt {
    fn run(&self, processor: &Processor) -> Outcome {
        let (id, token) = (self.job.id, &self.running.lease.token);
        let params = match RequestedParams::parse(Some(self.job.params_json.as_bytes())) {
            Ok(params) => params,
            Err(error) => return Outcome::Failed(Box::new(Problem::from(&error))),
        };
        let folder = match self.blobs.begin_attempt(id, token) {
            Ok(folder) => folder,
            Err(error) => return storage_failed(id, &error),
        };
        let mask = self.blobs.mask_path(id);
        match processor(&mask, params.checked(), self.limits, &folder, &*self.running) {
            Ok(processed) => succeeded(&processed),
            Err(ProcessError::Cancelled) => Outcome::Canceled,
            Err(ProcessError::Problem(problem)) => {
                if problem.status >= 500 {
                    tracing::error!(job = %id, code = problem.code, "the run failed through our fault");
                }
                Outcome::Failed(problem)
            }
        }
    }
}

fn storage_failed(job: JobId, error: &std::io::Error) -> Outcome {
    tracing::error!(%job, %error, "results cannot be written");
    let problem = if error.kind() == std::io::ErrorKind::StorageFull {
        Problem::new(507, "storage_full", "the server has no room for the results")
    } else {
        Problem::internal()
    };
    Outcome::Failed(Box::new(problem))
}

fn succeeded(processed: &Processed) -> Outcome {
    let result = |artifact: &Artifact| ResultFile {
        name: artifact.name.to_owned(),
        media_type: artifact.media_type.to_owned(),
        bytes: artifact.bytes,
        sha256: artifact.sha256.clone(),
    };
    let warning = |warning: &Warning| JobWarning { code: warning.code.to_owned(), message: warning.message.clone() };
    Outcome::Succeeded {
        results: processed.artifacts.iter().map(result).collect(),
        warnings: processed.warnings.iter().map(warning).collect(),
    }
}

/// Writes the outcome; `false` when the job is not this worker's any more or the store fails for
/// good, so that the end of the lease decides.
async fn finish(jobs: &Jobs, running: &Running, outcome: &Outcome) -> bool {
    let id = running.lease.id;
    for tried in 1..=FINISH_TRIES {
        match jobs.store().finish(&running.lease, outcome, Timestamp::now()).await {
            Ok(()) => {
                tracing::info!(job = %id, outcome = name(outcome), "job ended");
                return true;
            }
            Err(StoreError::StaleLease) => {
                tracing::info!(job = %id, "outcome dropped: the job was given away or deleted");
                return false;
            }
            Err(error) => {
                tracing::error!(job = %id, %error, tried, "outcome cannot be written");
                sleep(Duration::from_millis(200) * tried).await;
            }
        }
    }
    false
}

/// Removes what an attempt left that is not published, and everything of a job that is gone or
/// whose mask was refused: the same mask would be refused again, so nobody needs it any more.
async fn clean_up(jobs: &Jobs, running: &Running, outcome: &Outcome, is_written: bool) {
    let id = running.lease.id;
    let erased = match outcome {
        Outcome::Succeeded { .. } if is_written => Ok(()),
        Outcome::Failed(problem) if is_written && problem.status < 500 => jobs.erase(id).await,
        _ if matches!(jobs.store().get(id).await, Ok(None)) => jobs.erase(id).await,
        _ => erase_attempt(jobs, running).await,
    };
    if let Err(error) = erased {
        tracing::error!(job = %id, %error, "files cannot be removed; the next start sweeps them");
    }
}

async fn erase_attempt(jobs: &Jobs, running: &Running) -> Result<(), JobsError> {
    let (blobs, lease) = (jobs.blobs().clone(), running.lease.clone());
    Ok(spawn_blocking(move || blobs.erase_attempt(lease.id, &lease.token)).await??)
}

fn name(outcome: &Outcome) -> &str {
    match outcome {
        Outcome::Succeeded { .. } => "succeeded",
        Outcome::Failed(problem) => &problem.code,
        Outcome::Canceled => "canceled",
    }
}

async fn beat(jobs: Arc<Jobs>) {
    let mut ticks = interval(HEARTBEAT);
    ticks.set_missed_tick_behavior(MissedTickBehavior::Delay);
    loop {
        ticks.tick().await;
        for running in jobs.all_running() {
            match jobs.store().extend(&running.lease, Timestamp::now() + LEASE).await {
                Ok(false) => {}
                Ok(true) | Err(StoreError::StaleLease) => running.stop(),
                Err(error) => tracing::error!(job = %running.lease.id, %error, "lease cannot be extended"),
            }
        }
        match jobs.store().reclaim(Reclaim::LeaseBefore(Timestamp::now()), Timestamp::now()).await {
            Ok(0) => {}
            Ok(count) => {
                tracing::warn!(count, "jobs taken from workers that are gone");
                jobs.wake_one();
            }
            Err(error) => tracing::error!(%error, "leases cannot be checked"),
        }
    }
}
