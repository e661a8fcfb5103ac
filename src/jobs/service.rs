//! The service's jobs: what a client can do with them, whoever asks.

use std::io;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::time::Duration;

use jiff::Timestamp;
use tokio::sync::{Mutex, Notify};
use tokio::time::{Instant, timeout, timeout_at};
use tokio_util::sync::CancellationToken;

use super::audit_marks::follow;
use super::blocking::on_own_thread;
use super::caller::{Caller, InTurn, OpenRequest, OpenRequests};
use super::changes::{Changes, RECHECK};
use super::clock::Clock;
use super::error::JobsError;
use super::job::{Job, JobId, JobState};
use super::limits::JobLimits;
use super::place::{OpenError, Place};
use super::running::{Running, RunningJobs};
use super::storage_health::StorageHealth;
use super::store::blobs::Blobs;
use super::store::liveness::Instance;
use super::store::{CancelAnswer, Lease, ListQuery, QueueLimits, RetryAnswer, Store, StoreError};
use super::upkeep::Unnamed;
use crate::audit::{Action, Audit, Entry};
use crate::dicomweb::Pacs;
use crate::metrics::{Metrics, Now};
use crate::pipeline::progress::Progress;
use crate::webhook::Sender;

/// How long a deletion waits for a running job to let go of its files.
const DELETE_PATIENCE: Duration = Duration::from_secs(5);

/// A job with what only this process knows of it.
#[derive(Clone, Debug)]
pub struct JobStatus {
    /// The row.
    pub job: Job,
    /// How far it is, when it runs here.
    pub progress: Option<Progress>,
    /// By turn, from 1, when it waits.
    pub queue_position: Option<u64>,
}

/// All jobs of one data directory, as this process sees them.
pub struct Jobs {
    store: Arc<dyn Store>,
    blobs: Blobs,
    limits: JobLimits,
    instance: Instance,
    running: RunningJobs,
    changes: Arc<Changes>,
    wake: Notify,
    wake_callbacks: Notify,
    wake_deliveries: Notify,
    workers_alive: AtomicUsize,
    requests: Arc<OpenRequests>,
    /// Whether rows were deleted of which something may be left.
    is_to_wipe: AtomicBool,
    /// Lists of each tenant.
    lists: InTurn,
    /// Searches of each tenant.
    searches: InTurn,
    closing: CancellationToken,
    audit: Arc<Audit>,
    metrics: Metrics,
    webhooks: Option<Sender>,
    /// Archives that masks may be fetched from, and results go to.
    pub(super) pacs: Option<Pacs>,
    /// Held while a result is made on request.
    making: Arc<Mutex<()>>,
    unnamed: Mutex<Unnamed>,
    storage_health: StorageHealth,
    clock: Clock,
}

impl Jobs {
    /// Opens the data directory, takes up the jobs of servers that are gone, and sweeps the files
    /// that no job names.
    ///
    /// # Errors
    /// As [`OpenError`].
    pub async fn open(place: &Place, limits: JobLimits, webhooks: Option<Sender>) -> Result<Self, OpenError> {
        let begun = place.clone();
        let (instance, blobs, audit) = on_own_thread(move || begun.begin()).await?;
        let jobs = Self {
            store: place.open_store().await?,
            blobs,
            limits,
            instance,
            running: RunningJobs::default(),
            changes: Arc::default(),
            wake: Notify::new(),
            wake_callbacks: Notify::new(),
            wake_deliveries: Notify::new(),
            workers_alive: AtomicUsize::new(0),
            requests: Arc::default(),
            is_to_wipe: AtomicBool::new(true),
            lists: InTurn::default(),
            searches: InTurn::default(),
            closing: CancellationToken::new(),
            audit: Arc::new(audit),
            metrics: Metrics::new(),
            webhooks,
            pacs: None,
            making: Arc::default(),
            unnamed: Mutex::default(),
            storage_health: StorageHealth::default(),
            clock: Clock::default(),
        };
        jobs.take_over().await?;
        follow(&jobs.audit, &*jobs.store).await?;
        jobs.record(&Caller::default(), Action::Started, None, "ok").await;
        jobs.mark_audit().await;
        Ok(jobs)
    }

    /// The audit log.
    pub(super) fn audit(&self) -> Arc<Audit> {
        Arc::clone(&self.audit)
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
    pub fn store(&self) -> &dyn Store {
        &*self.store
    }

    /// The clock of the wall.
    pub(super) fn clock(&self) -> &Clock {
        &self.clock
    }

    /// Files that no job names, as far as is known.
    pub(super) fn known_unnamed(&self) -> &Mutex<Unnamed> {
        &self.unnamed
    }

    /// What operators alarm on.
    #[must_use]
    pub fn metrics(&self) -> &Metrics {
        &self.metrics
    }

    /// What sends webhooks, when any may be sent.
    #[must_use]
    pub fn webhooks(&self) -> Option<&Sender> {
        self.webhooks.as_ref()
    }

    /// How the service is at this moment.
    ///
    /// # Errors
    /// When the store fails or the disk does not say how much room it has.
    pub async fn now(&self) -> Result<Now, JobsError> {
        let load = self.store.load("").await?;
        let oldest = self.store.oldest_queued().await?;
        let waited = oldest.map_or(0.0, |time| Timestamp::now().duration_since(time).as_secs_f64());
        Ok(Now {
            queued: load.jobs,
            queued_bytes: load.bytes,
            oldest_queued_seconds: waited.max(0.0),
            running: self.running.all().len() as u64,
            workers: self.workers_alive.load(Ordering::Relaxed) as u64,
            disk_free_bytes: self.blobs.room()?.free_bytes,
            disk_min_free_bytes: self.limits.min_free_bytes,
        })
    }

    /// Those who wait for something to happen.
    #[must_use]
    pub fn changes(&self) -> &Changes {
        &self.changes
    }

    /// Ready once the service is told to stop: nobody waits any longer.
    #[must_use]
    pub fn closing(&self) -> &CancellationToken {
        &self.closing
    }

    /// Counts a request of a tenant while it is open; `None` when it has too many.
    #[must_use]
    pub fn open_request(&self, tenant: &str) -> Option<OpenRequest> {
        let limit = if tenant.is_empty() { usize::MAX } else { self.limits.max_requests };
        self.requests.open(tenant, limit)
    }

    /// One job.
    ///
    /// # Errors
    /// When the caller has none of this id, or the store fails.
    pub async fn status(&self, caller: &Caller, id: JobId) -> Result<JobStatus, JobsError> {
        let job = self.own(caller, id).await?;
        let position = match job.state {
            JobState::Queued => self.store.positions(&[id]).await?.get(&id).copied(),
            _ => None,
        };
        Ok(self.with_progress(job, position))
    }

    /// One job, once it has ended or `patience` is over.
    ///
    /// # Errors
    /// As [`Self::status`].
    pub async fn status_at_end(&self, caller: &Caller, id: JobId, patience: Duration) -> Result<JobStatus, JobsError> {
        let deadline = Instant::now() + patience;
        let mut changes = self.changes.watch(id);
        loop {
            let seen = changes.borrow_and_update().states;
            let status = self.status(caller, id).await?;
            if status.job.state.has_ended() || Instant::now() >= deadline || self.closing.is_cancelled() {
                return Ok(status);
            }
            let changed = changes.wait_for(|happened| happened.states != seen);
            let until = deadline.min(Instant::now() + RECHECK);
            tokio::select! {
                _ = timeout_at(until, changed) => {}
                () = self.closing.cancelled() => {}
            }
        }
    }

    /// Some of the caller's jobs, newest first.
    ///
    /// # Errors
    /// When the store fails.
    pub async fn list(&self, query: &ListQuery) -> Result<Vec<JobStatus>, JobsError> {
        // One after the other for each tenant: those of one cannot take all connections to the database.
        let own = self.lists.of(&query.owner);
        let _turn = own.lock().await;
        let jobs = self.store.list(query).await?;
        let waiting: Vec<JobId> = jobs.iter().filter(|job| job.state == JobState::Queued).map(|job| job.id).collect();
        let positions = self.store.positions(&waiting).await?;
        let with_progress = |job: Job| {
            let position = positions.get(&job.id).copied();
            self.with_progress(job, position)
        };
        Ok(jobs.into_iter().map(with_progress).collect())
    }

    /// Asks for the end of a job; one that runs stops at its next slice of work. A run that is
    /// just done may still succeed.
    ///
    /// # Errors
    /// When there is no such job or it has ended.
    pub async fn cancel(&self, caller: &Caller, id: JobId) -> Result<JobStatus, JobsError> {
        self.own(caller, id).await?;
        let mut canceled = self.store.cancel(id, Timestamp::now()).await;
        if matches!(canceled, Err(StoreError::Full)) && self.gives_room().await {
            canceled = self.store.cancel(id, Timestamp::now()).await;
        }
        match canceled? {
            CancelAnswer::NotFound => return Err(JobsError::NotFound),
            CancelAnswer::AlreadyEnded(state) => return Err(JobsError::AlreadyEnded(state)),
            CancelAnswer::Requested => self.running.stop(id),
            CancelAnswer::Canceled => {
                self.metrics.ended("canceled", "");
                self.has_ended(id).await;
            }
        }
        tracing::info!(job = %id, "job cancel requested");
        self.record(caller, Action::Cancel, Some(id), "accepted").await;
        self.status(caller, id).await
    }

    /// Runs a failed or canceled job again; one that has succeeded delivers its results again where that was given up.
    ///
    /// # Errors
    /// When there is no such job, it is in another state, its mask is erased or the queue is full.
    pub async fn retry(&self, caller: &Caller, id: JobId) -> Result<JobStatus, JobsError> {
        let job = self.own(caller, id).await?;
        let is_known = job.delivery.is_some_and(|delivery| self.check_pacs(&delivery.to).is_ok());
        match self.store.retry(id, Timestamp::now(), self.queue_limits(&caller.tenant)?).await? {
            RetryAnswer::NotFound => return Err(JobsError::NotFound),
            RetryAnswer::NotRetryable(JobState::Succeeded)
                if is_known && self.store.retry_delivery(id, Timestamp::now()).await? =>
            {
                tracing::info!(job = %id, "results are delivered again");
                self.record(caller, Action::Retry, Some(id), "delivery").await;
                self.wake_deliveries();
                return self.status(caller, id).await;
            }
            RetryAnswer::NotRetryable(state) => return Err(JobsError::NotRetryable(state)),
            RetryAnswer::MaskErased => return Err(JobsError::MaskErased),
            RetryAnswer::Queued => {}
        }
        tracing::info!(job = %id, "job retried");
        self.record(caller, Action::Retry, Some(id), "accepted").await;
        self.changes.state(id);
        self.wake_one();
        self.status(caller, id).await
    }

    /// Forgets a job and erases its mask and results; one that runs is stopped first.
    ///
    /// # Errors
    /// When there is no such job or a file cannot be removed.
    pub async fn delete(&self, caller: &Caller, id: JobId) -> Result<(), JobsError> {
        self.own(caller, id).await?;
        let mut deleted = self.store.delete(id).await;
        if matches!(deleted, Err(StoreError::Full)) && self.gives_room().await {
            deleted = self.store.delete(id).await;
        }
        if !deleted? {
            return Err(JobsError::NotFound);
        }
        self.note_deleted();
        // Before the files go: files of a job that the log has and the database has not tell of a database that lost something.
        self.record(caller, Action::Delete, Some(id), "erased").await;
        if let Some(running) = self.running.get(id) {
            running.stop();
            // A run that does not stop in time erases its own files when it ends.
            let _ = timeout(DELETE_PATIENCE, running.ended.cancelled()).await;
        }
        self.blobs.erase(id).await?;
        tracing::info!(job = %id, "job deleted");
        self.changes.state(id);
        Ok(())
    }

    /// Gives up the room that was kept back, for a change that must work on a full disk; `false` when it is used up.
    async fn gives_room(&self) -> bool {
        let blobs = self.blobs.clone();
        let is_given = on_own_thread(move || Ok(blobs.give_up_reserve())).await.unwrap_or(false);
        if is_given {
            tracing::warn!("the disk is full: the room that was kept back is used");
        }
        is_given
    }

    /// Rows were deleted: what is left of them is wiped soon.
    pub(super) fn note_deleted(&self) {
        self.is_to_wipe.store(true, Ordering::Relaxed);
    }

    /// Wipes what is left of deleted rows; where readers hold it back, the next time.
    pub(super) async fn wipe_deleted(&self) {
        if !self.is_to_wipe.swap(false, Ordering::Relaxed) {
            return;
        }
        match self.store.wipe_deleted().await {
            Ok(true) => {}
            Ok(false) => self.note_deleted(),
            Err(error) => {
                self.note_deleted();
                tracing::warn!(%error, "what is left of deleted rows cannot be wiped");
            }
        }
    }

    /// Names what keeps the service from doing its work; empty when nothing does. It costs nothing to ask, however often.
    pub async fn what_is_broken(&self) -> Vec<&'static str> {
        let storage = self.storage_health.now(&*self.store, &self.blobs).await;
        let checks = [
            ("the server is stopping", self.closing.is_cancelled()),
            ("the database cannot be written", storage.is_store_broken),
            ("the data directory cannot be written", storage.is_folder_broken),
            ("no worker is alive", self.workers_alive.load(Ordering::Relaxed) == 0),
        ];
        checks.iter().filter(|(_, is_broken)| *is_broken).map(|(what, _)| *what).collect()
    }

    /// What is known of the storage.
    pub(super) fn storage_health(&self) -> &StorageHealth {
        &self.storage_health
    }

    /// Tries whether the database and the data directory take a write.
    pub(super) async fn try_storage(&self) {
        self.storage_health.try_writes(&*self.store, &self.blobs).await;
        let (blobs, min_free_bytes) = (self.blobs.clone(), self.limits.min_free_bytes);
        if let Err(error) = on_own_thread(move || blobs.keep_reserve(min_free_bytes)).await {
            tracing::warn!(%error, "no room of the disk can be kept back");
        }
    }

    /// Whether the disk has less room than is to be left free: then nothing is taken in.
    #[must_use]
    pub fn is_disk_low(&self) -> bool {
        self.check_disk(0).is_err()
    }

    /// Says in the audit log what somebody did. The service goes on when that fails: on a full disk
    /// deleting must still work.
    pub async fn record(&self, caller: &Caller, action: Action, job: Option<JobId>, outcome: &str) {
        let (audit, caller, outcome) = (Arc::clone(&self.audit), caller.clone(), outcome.to_owned());
        // Another process may hold the lock of the file.
        let written = on_own_thread(move || append(&audit, &caller, action, job, &outcome)).await;
        if let Err(error) = written {
            self.metrics.audit_failed();
            tracing::error!(%error, "the audit log cannot be written");
        }
    }

    pub(super) fn check_disk(&self, bytes: u64) -> Result<(), JobsError> {
        let has_room = self.blobs.room()?.has(self.limits.min_free_bytes.saturating_add(bytes));
        if has_room { Ok(()) } else { Err(JobsError::StorageLow) }
    }

    /// What may wait of a tenant; who is alone has no share.
    pub(super) fn queue_limits(&self, tenant: &str) -> Result<QueueLimits, JobsError> {
        if tenant.is_empty() {
            return Ok(QueueLimits { share_percent: 100, storage_bytes: u64::MAX, ..self.limits.queue });
        }
        let share = self.blobs.room()?.all_bytes / 100 * u64::from(self.limits.storage_percent);
        Ok(QueueLimits { storage_bytes: self.limits.queue.storage_bytes.min(share), ..self.limits.queue })
    }

    /// A job of the caller's; another tenant's is as good as none.
    pub(super) async fn own(&self, caller: &Caller, id: JobId) -> Result<Job, JobsError> {
        let job = self.store.get(id).await;
        self.storage_health.hear(&job);
        job?.filter(|job| job.owner == caller.tenant).ok_or(JobsError::NotFound)
    }

    fn with_progress(&self, job: Job, queue_position: Option<u64>) -> JobStatus {
        let progress = self.running.get(job.id).map(|running| running.progress());
        let progress = progress.filter(|_| job.state == JobState::Running);
        JobStatus { job, progress, queue_position }
    }

    /// Waits until a job may have come.
    pub(super) async fn woken(&self) {
        self.wake.notified().await;
    }

    /// Waits until a webhook may be due.
    pub(super) async fn callbacks_woken(&self) {
        self.wake_callbacks.notified().await;
    }

    /// Wakes who sends webhooks: one may be due.
    pub(super) fn wake_callbacks(&self) {
        self.wake_callbacks.notify_one();
    }

    /// Waits until a delivery may be due.
    pub(super) async fn deliveries_woken(&self) {
        self.wake_deliveries.notified().await;
    }

    /// Wakes who delivers results: some may be due.
    pub(super) fn wake_deliveries(&self) {
        self.wake_deliveries.notify_one();
    }

    /// Wakes one more worker: there may be a job.
    pub(super) fn wake_one(&self) {
        self.wake.notify_one();
    }

    pub(super) fn instance(&self) -> &Instance {
        &self.instance
    }

    /// Says that a run begins in this process.
    pub(super) fn begin(&self, lease: Lease) -> Arc<Running> {
        let running = self.running.begin(Running::new(lease, self.limits.max_run, Arc::clone(&self.changes)));
        self.changes.state(running.lease.id);
        running
    }

    /// What runs in this process.
    pub(super) fn running(&self) -> &RunningJobs {
        &self.running
    }

    pub(super) fn searches(&self) -> &InTurn {
        &self.searches
    }

    pub(super) fn making(&self) -> Arc<Mutex<()>> {
        Arc::clone(&self.making)
    }

    pub(super) fn workers_alive(&self) -> &AtomicUsize {
        &self.workers_alive
    }
}

/// One entry of the audit log. Blocks.
fn append(audit: &Audit, caller: &Caller, action: Action, job: Option<JobId>, outcome: &str) -> io::Result<()> {
    let job = job.map(|id| id.to_string());
    audit.append(&Entry {
        tenant: Some(caller.tenant.as_str()).filter(|tenant| !tenant.is_empty()),
        token: caller.token.as_deref(),
        action,
        job: job.as_deref(),
        outcome,
        trace_id: Some(caller.trace_id.as_str()).filter(|id| !id.is_empty()),
    })
}
