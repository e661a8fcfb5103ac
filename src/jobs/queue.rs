//! The service's jobs: what a client can do with them, whoever asks.

use std::collections::BTreeMap;
use std::fs::{File, TryLockError};
use std::io;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use jiff::Timestamp;
use tokio::sync::Notify;
use tokio::task::{JoinError, spawn_blocking};
use tokio_util::sync::CancellationToken;

use super::blobs::Blobs;
use super::expected::expected;
use super::job::{Job, JobId, JobState, RequestedParams, ResultFile};
use super::process::InputLimits;
use super::sqlite::SqliteStore;
use super::store::{CancelAnswer, JobStore, Lease, ListQuery, NewJob, Reclaim, StoreError};
use super::upload::{Received, UploadLimits, preflight};
use crate::pipeline::observer::{Observer, Stage};
use crate::problem::Problem;

/// How long a deletion waits for a running job to let go of its files.
const DELETE_PATIENCE: Duration = Duration::from_secs(5);

/// What bounds the jobs.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct JobLimits {
    /// Jobs that may wait.
    pub max_queued: u64,
    /// Bounds on an upload.
    pub upload: UploadLimits,
    /// Bounds on what a file may unpack to.
    pub input: InputLimits,
}

/// Why something was not done with a job.
#[derive(Debug, thiserror::Error)]
pub enum JobsError {
    /// There is no such job.
    #[error("no such job")]
    NotFound,
    /// The job has no result of this name.
    #[error("no such result")]
    NoSuchResult {
        /// The job's state.
        state: JobState,
    },
    /// The job has ended and cannot be cancelled.
    #[error("the job has ended")]
    AlreadyEnded(JobState),
    /// The file was refused.
    #[error("{}", .0.code)]
    Refused(Box<Problem>),
    /// The store did not do it.
    #[error(transparent)]
    Store(#[from] StoreError),
    /// A file could not be read or written.
    #[error("files of jobs: {0}")]
    Files(#[from] io::Error),
    /// A task of ours panicked.
    #[error("a task failed: {0}")]
    Task(#[from] JoinError),
}

/// Why the jobs cannot be opened.
#[derive(Debug, thiserror::Error)]
pub enum OpenError {
    /// Another server uses the data directory.
    #[error("the data directory is in use by another server")]
    InUse,
    /// The directory cannot be used.
    #[error("the data directory cannot be used: {0}")]
    Files(#[from] io::Error),
    /// The database cannot be used.
    #[error(transparent)]
    Store(#[from] StoreError),
}

/// A job with what only this process knows of it.
#[derive(Clone, Debug)]
pub struct JobStatus {
    /// The row.
    pub job: Job,
    /// How far it is, when it runs here.
    pub progress: Option<Progress>,
    /// 1 for the next to run, when it waits.
    pub queue_position: Option<u64>,
}

/// How far a run is.
#[derive(Clone, Copy, Debug, PartialEq)]
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

/// What is to be served of a result.
#[derive(Clone, Debug)]
pub struct PublishedFile {
    /// Its description.
    pub file: ResultFile,
    /// Where it lies.
    pub path: PathBuf,
}

/// All jobs of one data directory.
pub struct Jobs {
    store: Arc<dyn JobStore>,
    blobs: Blobs,
    limits: JobLimits,
    running: Mutex<BTreeMap<JobId, Arc<Running>>>,
    wake: Notify,
    workers_alive: AtomicUsize,
    /// Held as long as this lives: two servers on one directory would run jobs twice.
    _lock: File,
}

impl Jobs {
    /// Opens the data directory: takes its lock, takes up the jobs of the server that stopped, and
    /// sweeps the files that no job names.
    ///
    /// # Errors
    /// As [`OpenError`].
    pub async fn open(data_dir: &Path, limits: JobLimits) -> Result<Self, OpenError> {
        let blobs = Blobs::open(data_dir)?;
        let lock = lock(data_dir)?;
        let store: Arc<dyn JobStore> = Arc::new(SqliteStore::open(&blobs.database_path()).await?);
        let taken_up = store.reclaim(Reclaim::All, Timestamp::now()).await?;
        let kept = store.kept_files().await?.into_iter().map(|(id, token)| (id.to_string(), token)).collect();
        let swept = blobs.sweep(&kept)?;
        tracing::info!(jobs = kept.len(), taken_up, swept, "data directory opened");
        Ok(Self {
            store,
            blobs,
            limits,
            running: Mutex::default(),
            wake: Notify::new(),
            workers_alive: AtomicUsize::new(0),
            _lock: lock,
        })
    }

    /// What bounds the jobs.
    #[must_use]
    pub fn limits(&self) -> &JobLimits {
        &self.limits
    }

    /// The files.
    #[must_use]
    pub fn blobs(&self) -> &Blobs {
        &self.blobs
    }

    /// The rows.
    #[must_use]
    pub fn store(&self) -> &dyn JobStore {
        &*self.store
    }

    /// Fails when as many jobs wait as may; asked before an upload is read.
    ///
    /// # Errors
    /// [`StoreError::QueueFull`].
    pub async fn check_room(&self) -> Result<(), JobsError> {
        let queued = self.store.count_queued().await?;
        if queued >= self.limits.max_queued { Err(StoreError::QueueFull.into()) } else { Ok(()) }
    }

    /// Accepts a mask. On return the job is on disk and survives the loss of power.
    ///
    /// # Errors
    /// When the file is refused, the queue is full, or storage fails; nothing is left then.
    pub async fn submit(&self, upload: Received, params: &RequestedParams) -> Result<JobStatus, JobsError> {
        let Received { file, mask } = upload;
        let id = JobId::now();
        let (blobs, limits) = (self.blobs.clone(), self.limits.input);
        let header = spawn_blocking(move || {
            let header = preflight(&file, limits).map_err(JobsError::Refused)?;
            blobs.keep_mask(file, id).map_err(JobsError::Files)?;
            Ok::<_, JobsError>(header)
        })
        .await??;
        let expected = expected(&header, mask.bytes, params.checked());
        let new = NewJob { id, mask, params_json: params.json().to_owned(), created_at: Timestamp::now(), expected };
        if let Err(error) = self.store.insert(&new, self.limits.max_queued).await {
            self.erase(id).await?;
            return Err(error.into());
        }
        tracing::info!(job = %id, bytes = new.mask.bytes, "job accepted");
        self.wake.notify_one();
        self.status(id).await
    }

    /// One job.
    ///
    /// # Errors
    /// When there is none of this id, or the store fails.
    pub async fn status(&self, id: JobId) -> Result<JobStatus, JobsError> {
        let job = self.store.get(id).await?.ok_or(JobsError::NotFound)?;
        self.with_progress(job).await
    }

    /// Some jobs, newest first.
    ///
    /// # Errors
    /// When the store fails.
    pub async fn list(&self, query: ListQuery) -> Result<Vec<JobStatus>, JobsError> {
        let mut list = Vec::new();
        for job in self.store.list(query).await? {
            list.push(self.with_progress(job).await?);
        }
        Ok(list)
    }

    /// A published result.
    ///
    /// # Errors
    /// When there is no such job or it has no such result.
    pub async fn result(&self, id: JobId, name: &str) -> Result<PublishedFile, JobsError> {
        let job = self.store.get(id).await?.ok_or(JobsError::NotFound)?;
        let missing = JobsError::NoSuchResult { state: job.state };
        let file = job.results.into_iter().find(|file| file.name == name);
        let (Some(file), Some(token)) = (file, job.results_token) else { return Err(missing) };
        let path = self.blobs.result_path(id, &token, &file.name);
        Ok(PublishedFile { file, path })
    }

    /// Asks for the end of a job; one that runs stops at its next slice of work. A run that is
    /// just done may still succeed.
    ///
    /// # Errors
    /// When there is no such job or it has ended.
    pub async fn cancel(&self, id: JobId) -> Result<JobStatus, JobsError> {
        match self.store.cancel(id, Timestamp::now()).await? {
            CancelAnswer::NotFound => return Err(JobsError::NotFound),
            CancelAnswer::AlreadyEnded(state) => return Err(JobsError::AlreadyEnded(state)),
            CancelAnswer::Requested => self.running_job(id).iter().for_each(|running| running.stop()),
            CancelAnswer::Canceled => {}
        }
        tracing::info!(job = %id, "job cancel requested");
        self.status(id).await
    }

    /// Forgets a job and erases its mask and results; one that runs is stopped first.
    ///
    /// # Errors
    /// When there is no such job or a file cannot be removed.
    pub async fn delete(&self, id: JobId) -> Result<(), JobsError> {
        if !self.store.delete(id).await? {
            return Err(JobsError::NotFound);
        }
        if let Some(running) = self.running_job(id) {
            running.stop();
            // A run that does not stop in time erases its own files when it ends.
            let _ = tokio::time::timeout(DELETE_PATIENCE, running.ended.cancelled()).await;
        }
        self.erase(id).await?;
        tracing::info!(job = %id, "job deleted");
        Ok(())
    }

    /// Names what keeps the service from doing its work; empty when nothing does.
    pub async fn what_is_broken(&self) -> Vec<&'static str> {
        let blobs = self.blobs.clone();
        let files = spawn_blocking(move || blobs.check_writable()).await;
        let checks = [
            ("the database cannot be written", self.store.check_writable().await.is_err()),
            ("the data directory cannot be written", !matches!(files, Ok(Ok(())))),
            ("no worker is alive", self.workers_alive.load(Ordering::Relaxed) == 0),
        ];
        checks.iter().filter(|(_, is_broken)| *is_broken).map(|(what, _)| *what).collect()
    }

    async fn with_progress(&self, job: Job) -> Result<JobStatus, JobsError> {
        let progress = self.running_job(job.id).map(|running| running.progress());
        let queue_position = match job.state {
            JobState::Queued => Some(self.store.count_queued_before(job.id).await? + 1),
            _ => None,
        };
        let progress = progress.filter(|_| job.state == JobState::Running);
        Ok(JobStatus { job, progress, queue_position })
    }

    pub(super) async fn erase(&self, id: JobId) -> Result<(), JobsError> {
        let blobs = self.blobs.clone();
        Ok(spawn_blocking(move || blobs.erase(id)).await??)
    }

    /// Waits until a job may have come.
    pub(super) async fn woken(&self) {
        self.wake.notified().await;
    }

    /// Wakes one more worker: there may be a job.
    pub(super) fn wake_one(&self) {
        self.wake.notify_one();
    }

    pub(super) fn begin(&self, lease: Lease) -> Arc<Running> {
        let running = Arc::new(Running::new(lease));
        self.running_jobs().insert(running.lease.id, Arc::clone(&running));
        running
    }

    pub(super) fn end(&self, running: &Running) {
        self.running_jobs().remove(&running.lease.id);
        running.ended.cancel();
    }

    /// All that run in this process.
    pub(super) fn all_running(&self) -> Vec<Arc<Running>> {
        self.running_jobs().values().cloned().collect()
    }

    pub(super) fn workers_alive(&self) -> &AtomicUsize {
        &self.workers_alive
    }

    fn running_job(&self, id: JobId) -> Option<Arc<Running>> {
        self.running_jobs().get(&id).cloned()
    }

    fn running_jobs(&self) -> MutexGuard<'_, BTreeMap<JobId, Arc<Running>>> {
        // Nothing panics while it is held; a poisoned map would still be whole.
        self.running.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

fn lock(data_dir: &Path) -> Result<File, OpenError> {
    let file = File::create(data_dir.join("lock"))?;
    match file.try_lock() {
        Ok(()) => Ok(file),
        Err(TryLockError::WouldBlock) => Err(OpenError::InUse),
        Err(TryLockError::Error(error)) => Err(error.into()),
    }
}

/// A job that runs in this process: hears its progress and can stop it.
#[derive(Debug)]
pub(super) struct Running {
    pub(super) lease: Lease,
    stop: AtomicBool,
    progress: Mutex<Progress>,
    /// Cancelled once the run has let go of its files.
    ended: CancellationToken,
}

impl Running {
    fn new(lease: Lease) -> Self {
        let progress = Progress { stage: None, structures: 0, structure: 0, fraction: 0.0 };
        Self { lease, stop: AtomicBool::new(false), progress: Mutex::new(progress), ended: CancellationToken::new() }
    }

    pub(super) fn stop(&self) {
        self.stop.store(true, Ordering::Relaxed);
    }

    fn progress(&self) -> Progress {
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
    }

    fn is_cancelled(&self) -> bool {
        self.stop.load(Ordering::Relaxed)
    }
}
