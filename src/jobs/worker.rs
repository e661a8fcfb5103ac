//! The workers: each claims a job, runs it on a blocking thread, and writes its outcome.

use std::io;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::time::Duration;

use futures_util::FutureExt;
use jiff::Timestamp;
use tokio::task::{JoinHandle, JoinSet, spawn_blocking};
use tokio::time::{Instant, sleep, timeout, timeout_at};
use tokio_util::sync::CancellationToken;
use tracing::{Instrument, info_span};

use super::blocking::on_own_thread;
use super::caller::Caller;
use super::drafts::sha256_of_file;
use super::error::JobsError;
use super::job::{Job, JobWarning, RequestedParams, ResultFile};
use super::process::{InputLimits, ProcessError};
use super::processed::Processed;
use super::running::Running;
use super::service::Jobs;
use super::store::blobs::LocalMask;
use super::store::{Claim, LEASE, Outcome, StoreError};
use super::submission::PROGRAM;
use super::{callbacks, deliveries, leases, retention, storage_health};
use crate::audit::Action;
use crate::model::Warning;
use crate::params::CheckedParams;
use crate::pipeline::observer::Observer;
use crate::problem::Problem;

/// How often an idle worker looks for jobs though nobody woke it: another process may have taken
/// them in.
const IDLE_POLL: Duration = Duration::from_secs(1);
/// Tries at writing an outcome before it is left to the end of the lease.
const FINISH_TRIES: u32 = 5;
/// Jobs of one worker whose results are on their way to disk while it runs the next: the disk makes them
/// wait, not the processor.
const ENDINGS: usize = 4;
/// How long runs that were put back may take to notice.
const LET_GO: Duration = Duration::from_secs(1);

/// What turns a mask into artifacts: the file, its parameters, bounds, the folder to write to,
/// and who is told. A type of its own so that tests can put another in its place.
pub type Processor = Arc<
    dyn Fn(&Path, &CheckedParams, InputLimits, &Path, &dyn Observer) -> Result<Processed, ProcessError> + Send + Sync,
>;

/// Workers under way, and what keeps house beside them.
pub struct Workers {
    jobs: Arc<Jobs>,
    tasks: Vec<JoinHandle<()>>,
    housekeeping: Vec<JoinHandle<()>>,
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
        let housekeeping = vec![
            tokio::spawn(leases::extend(Arc::clone(jobs))),
            tokio::spawn(leases::watch(Arc::clone(jobs))),
            tokio::spawn(retention::keep(Arc::clone(jobs))),
            tokio::spawn(storage_health::watch(Arc::clone(jobs))),
            tokio::spawn(callbacks::send(Arc::clone(jobs))),
            tokio::spawn(deliveries::send(Arc::clone(jobs))),
        ];
        Self { jobs: Arc::clone(jobs), tasks, housekeeping, stop }
    }

    /// Claims nothing more, waits for what runs, and puts back to the queue what does not end in
    /// time.
    pub async fn drain(mut self, patience: Duration) {
        self.jobs.closing().cancel();
        self.stop.cancel();
        let deadline = Instant::now() + patience;
        for task in &mut self.tasks {
            if timeout_at(deadline, task).await.is_err() {
                break;
            }
        }
        for running in self.jobs.running().all() {
            let released = self.jobs.store().release(&running.lease, Timestamp::now()).await;
            tracing::info!(job = %running.lease.id, is_released = released.is_ok(), "job put back: the server stops");
            running.stop();
        }
        let let_go = async {
            while !self.jobs.running().all().is_empty() {
                sleep(Duration::from_millis(20)).await;
            }
        };
        // A run that does not notice ends with the process; its row is queued already.
        let _ = timeout(LET_GO, let_go).await;
        for task in self.tasks.into_iter().chain(self.housekeeping).filter(|task| !task.is_finished()) {
            task.abort();
            // Once it has ended, so has its hold on the data directory.
            let _ = task.await;
        }
        self.jobs.record(&Caller::default(), Action::Stopped, None, "ok").await;
        self.jobs.mark_audit().await;
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

/// Runs one job after the other. While the results of some are synced to disk and their rows are written,
/// the next one runs already.
async fn work(jobs: &Arc<Jobs>, processor: &Processor, stop: &CancellationToken) {
    let mut endings = JoinSet::new();
    while !stop.is_cancelled() {
        let now = Timestamp::now();
        match jobs.store().claim(jobs.instance().id(), now, now + LEASE).await {
            Ok(Some(claim)) => {
                jobs.storage_health().claims(true);
                let span = info_span!("job", job = %claim.job.id, trace_id = claim.job.trace_id);
                let ran = run(jobs, processor, claim).instrument(span.clone()).await;
                while endings.len() >= ENDINGS {
                    endings.join_next().await;
                }
                endings.spawn(end_or_let_go(Arc::clone(jobs), ran).instrument(span));
            }
            Ok(None) => {
                jobs.storage_health().claims(true);
                wait(jobs, stop).await;
            }
            Err(error) => {
                jobs.storage_health().claims(false);
                tracing::error!(%error, "no job can be claimed");
                wait(jobs, stop).await;
            }
        }
    }
    while endings.join_next().await.is_some() {}
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
    tracing::info!(attempt = job.attempt, "job begun");
    if job.attempt == 1 {
        jobs.metrics().waited(Timestamp::now().duration_since(job.created_at).as_secs_f64());
    }
    let begun = Instant::now();
    let outcome = run_blocking(jobs, processor, &job, &running).await;
    jobs.metrics().ran(begun.elapsed().as_secs_f64());
    Ran { running, outcome }
}

/// A job that was not ended, for a fault of ours, is no longer held: its lease runs out.
async fn end_or_let_go(jobs: Arc<Jobs>, ran: Ran) {
    let running = Arc::clone(&ran.running);
    if AssertUnwindSafe(end(Arc::clone(&jobs), ran)).catch_unwind().await.is_err() {
        tracing::error!("the job was not ended; its lease runs out");
        jobs.running().end(&running);
    }
}

/// Brings results to disk, then says that they are there.
async fn end(jobs: Arc<Jobs>, ran: Ran) {
    let Ran { running, mut outcome } = ran;
    let lease = &running.lease;
    if let Outcome::Succeeded { results, .. } = &outcome {
        let names: Vec<&str> = results.iter().map(|file| file.name.as_str()).collect();
        if let Err(error) = jobs.blobs().keep_results(lease.id, &lease.token, &names).await {
            outcome = storage_failed(&error);
        }
    }
    let finished = finish(&jobs, &running, &outcome).await;
    clean_up(&jobs, &running, &outcome, finished).await;
    jobs.running().end(&running);
    if finished == Finished::Written {
        jobs.has_ended(lease.id).await;
    }
}

async fn is_unwanted(jobs: &Jobs, job: &Job) -> bool {
    jobs.store().get(job.id).await.is_ok_and(|job| job.is_none_or(|job| job.cancel_requested))
}

async fn run_blocking(jobs: &Arc<Jobs>, processor: &Processor, job: &Job, running: &Arc<Running>) -> Outcome {
    let mask = match jobs.blobs().local_mask(job.id).await {
        Ok(mask) => mask,
        Err(error) => return mask_unread(jobs, &error),
    };
    let attempt = Attempt { jobs: Arc::clone(jobs), job: job.clone(), mask, running: Arc::clone(running) };
    let (processor, span) = (Arc::clone(processor), tracing::Span::current());
    let ran = spawn_blocking(move || {
        let _in_job = span.enter();
        catch_unwind(AssertUnwindSafe(|| attempt.run(&processor)))
    });
    ran.await.ok().and_then(Result::ok).unwrap_or_else(|| {
        tracing::error!("the run panicked");
        Outcome::Failed(Box::new(Problem::internal()))
    })
}

/// One run of one job, on a blocking thread.
struct Attempt {
    jobs: Arc<Jobs>,
    job: Job,
    mask: LocalMask,
    running: Arc<Running>,
}

impl Attempt {
    fn run(&self, processor: &Processor) -> Outcome {
        let params = match RequestedParams::parse(Some(self.job.params_json.as_bytes())) {
            Ok(params) => params,
            Err(error) => return Outcome::Failed(Box::new(Problem::from(&error))),
        };
        match sha256_of_file(self.mask.path()) {
            Ok(sha256) if sha256 == self.job.mask.sha256 => {}
            Ok(_) => return mask_lost(&self.jobs, &io::Error::other("its hash is another")),
            Err(error) => return mask_unread(&self.jobs, &error),
        }
        let folder = match self.jobs.blobs().begin_attempt(&self.running.lease.token) {
            Ok(folder) => folder,
            Err(error) => return storage_failed(&error),
        };
        self.process(processor, &params, &folder)
    }

    fn process(&self, processor: &Processor, params: &RequestedParams, folder: &Path) -> Outcome {
        let limits = self.jobs.limits();
        match processor(self.mask.path(), params.checked(), limits.input, folder, &*self.running) {
            Ok(processed) => {
                for (stage, seconds) in &processed.stage_seconds {
                    self.jobs.metrics().stage(stage.name(), *seconds);
                }
                succeeded(&processed)
            }
            Err(ProcessError::Cancelled) if self.running.took_too_long() => {
                let detail = format!("the run took longer than {} s", limits.max_run.as_secs());
                let problem = Problem::new(422, "run_too_long", detail);
                Outcome::Failed(Box::new(
                    problem.hint("crop the mask, set resolution_mm, or send fewer labels at once"),
                ))
            }
            Err(ProcessError::Cancelled) => Outcome::Canceled,
            Err(ProcessError::Io { doing, error }) => {
                tracing::error!(%error, "{doing} failed");
                Outcome::Failed(Box::new(Problem::of_storage(&error)))
            }
            Err(ProcessError::Crashed { how }) => {
                tracing::error!(how, "the run crashed");
                Outcome::Failed(Box::new(Problem::new(
                    500,
                    "run_crashed",
                    "the run crashed; the server's log has the place",
                )))
            }
            Err(ProcessError::Problem(problem)) => {
                if problem.is_our_fault() {
                    tracing::error!(code = problem.code, "the run failed through our fault");
                }
                Outcome::Failed(problem)
            }
        }
    }
}

/// The mask is not there, or not what was sent: nothing is computed from it.
fn mask_lost(jobs: &Jobs, error: &io::Error) -> Outcome {
    tracing::error!(%error, "the stored mask is damaged");
    jobs.metrics().damaged();
    let problem = Problem::new(500, "mask_damaged", "the stored mask is not what was sent").hint("send it again");
    Outcome::Failed(Box::new(problem))
}

/// The mask cannot be read. It may be whole: only one that is gone is lost.
fn mask_unread(jobs: &Jobs, error: &io::Error) -> Outcome {
    if error.kind() == io::ErrorKind::NotFound {
        return mask_lost(jobs, error);
    }
    tracing::error!(%error, "the stored mask cannot be read");
    Outcome::Failed(Box::new(Problem::of_storage(error)))
}

fn storage_failed(error: &io::Error) -> Outcome {
    tracing::error!(%error, "results cannot be written");
    Outcome::Failed(Box::new(Problem::of_storage(error)))
}

fn succeeded(processed: &Processed) -> Outcome {
    let warning = |warning: &Warning| JobWarning { code: warning.code.to_string(), message: warning.message.clone() };
    Outcome::Succeeded {
        results: processed.files.iter().map(ResultFile::from).collect(),
        warnings: processed.warnings.iter().map(warning).collect(),
        program: PROGRAM.to_owned(),
    }
}

/// Whether an outcome was written.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Finished {
    Written,
    /// The job is not this worker's any more.
    NotOurs,
    /// The store fails: it may be written or not, and the end of the lease decides.
    Unknown,
}

/// Writes the outcome.
async fn finish(jobs: &Jobs, running: &Running, outcome: &Outcome) -> Finished {
    for tried in 1..=FINISH_TRIES {
        match jobs.store().finish(&running.lease, outcome, Timestamp::now()).await {
            Ok(()) => {
                let (state, code) = name(outcome);
                tracing::info!(state, code, "job ended");
                jobs.metrics().ended(state, code);
                return Finished::Written;
            }
            Err(StoreError::StaleLease) => {
                tracing::info!("outcome dropped: the job was given away or deleted");
                return Finished::NotOurs;
            }
            Err(error) => {
                tracing::error!(%error, tried, "outcome cannot be written");
                sleep(Duration::from_millis(200) * tried).await;
            }
        }
    }
    Finished::Unknown
}

/// Removes the attempt's scratch files, what it stored that is not published, everything of a job
/// that is gone, and a mask that was refused: it would be refused again, so nobody needs it.
async fn clean_up(jobs: &Jobs, running: &Running, outcome: &Outcome, finished: Finished) {
    let lease = running.lease.clone();
    let (blobs, token) = (jobs.blobs().clone(), lease.token.clone());
    let scratch = on_own_thread(move || blobs.end_attempt(&token)).await;
    let erased = async {
        scratch?;
        match (outcome, finished) {
            (_, Finished::Unknown) | (Outcome::Succeeded { .. }, Finished::Written) => return Ok(()),
            (Outcome::Failed(problem), Finished::Written) if !problem.is_our_fault() => {
                jobs.forget_mask(lease.id).await
            }
            _ => {}
        }
        if matches!(jobs.store().get(lease.id).await, Ok(None)) {
            jobs.blobs().erase(lease.id).await?;
        }
        Ok::<_, JobsError>(jobs.blobs().erase_attempt(lease.id, &lease.token).await?)
    };
    if let Err(error) = erased.await {
        tracing::error!(%error, "files cannot be removed; they are swept later");
    }
}

/// State and code.
fn name(outcome: &Outcome) -> (&'static str, &str) {
    match outcome {
        Outcome::Succeeded { .. } => ("succeeded", ""),
        Outcome::Failed(problem) => ("failed", &problem.code),
        Outcome::Canceled => ("canceled", ""),
    }
}
