//! What lasts: rows, files, and the marks of processes that live.
//!
//! The store of rows: what is kept of jobs and tokens, and who may change it. One trait, [`Store`],
//! so that the service does not know the database; its parts are traits of their own, so that an
//! implementation can be read in parts too. What every implementation promises is tested in one
//! place, whatever database is behind it. Errors are told by what a caller can do about them.

mod sql;

pub mod sqlite;

pub mod blobs;

pub mod liveness;

use std::collections::BTreeMap;
use std::path::Path;
use std::time::Duration;

use async_trait::async_trait;
use jiff::{SignedDuration, Timestamp};
use uuid::Uuid;

use crate::audit::Mark;
use crate::formats::dicom_object::DicomObject;
use crate::jobs::job::{Job, JobId, JobState, JobWarning, MaskInfo, ResultFile, SendTry};
use crate::jobs::moves::Cause;
use crate::jobs::token::StoredToken;
use crate::problem::Problem;

/// Runs of one job before it is given up. A job that takes its server down with it would
/// otherwise do so for ever.
pub const MAX_ATTEMPTS: u32 = 3;

/// Why a job has failed whose worker was gone that often.
#[must_use]
pub fn too_many_attempts() -> Problem {
    let detail = format!("the job was begun {MAX_ATTEMPTS} times and the server stopped each time");
    Problem::new(500, "too_many_attempts", detail)
        .hint("send it once more on its own; if it fails again, the mask is more than this server can take")
}

/// Why the store did not do what was asked.
#[derive(Debug, thiserror::Error)]
pub enum StoreError {
    /// As many jobs, or bytes of masks, wait as are allowed to.
    #[error("the queue is full")]
    QueueFull,
    /// This tenant has its share of the queue.
    #[error("the tenant's share of the queue is full")]
    ShareFull,
    /// As much is kept of this tenant's files as may be.
    #[error("the tenant's share of the storage is full")]
    StorageShareFull,
    /// The idempotency key was used for another request.
    #[error("the idempotency key belongs to another request")]
    KeyReused,
    /// The lease was lost: the job was given to another worker, deleted or ended.
    #[error("the lease is not held any more")]
    StaleLease,
    /// There is no room for more.
    #[error("the disk has no room for the database")]
    Full,
    /// The database cannot be reached, or others keep it locked: later it may work.
    #[error("the database cannot be used at the moment: {0}")]
    Unavailable(String),
    /// The tables are those of an earlier version of this program, and nothing is to be changed.
    #[error(
        "the database is that of an earlier version of this program (its tables are at step {found}, this version has \
         {known}): the next start of a server brings it up to date"
    )]
    Older {
        /// The last step of its tables.
        found: i64,
        /// The last one of this version.
        known: i64,
    },
    /// The tables are those of a later version of this program.
    #[error(
        "the database was made by a later version of this program (its tables are at step {found}, this version knows \
         {known}): use that version, or a backup made before it"
    )]
    Newer {
        /// A step of its tables that is not known.
        found: i64,
        /// The last one that is.
        known: i64,
    },
    /// It is gone, or empty.
    #[error(
        "there is no database, or an empty one, beside masks, results or an audit log of one: put db/ back from a \
         backup, or move what is left of it out of the data directory"
    )]
    Lost,
    /// It is damaged, or holds what this program never writes.
    #[error("the database is damaged or another program's (a backup may be whole): {0}")]
    Corrupt(String),
    /// Anything else.
    #[error("database: {0}")]
    Other(String),
}

/// A job to be kept.
#[derive(Clone, Debug)]
pub struct NewJob {
    /// Its id.
    pub id: JobId,
    /// Tenant that sent it.
    pub owner: String,
    /// What was uploaded.
    pub mask: MaskInfo,
    /// Parameters as sent.
    pub params_json: String,
    /// The client's own labels.
    pub labels: BTreeMap<String, String>,
    /// Key of the request, unique per owner.
    pub idempotency_key: Option<String>,
    /// Hash of all that was asked for: mask, parameters, labels, callback, delivery.
    pub request_sha256: String,
    /// Hash of mask and parameters: of what the results follow from.
    pub work_sha256: String,
    /// Whom to tell of the end.
    pub callback_url: Option<String>,
    /// Archive that its results go to.
    pub deliver_to: Option<String>,
    /// Trace of the request.
    pub trace_id: String,
    /// When it was accepted.
    pub created_at: Timestamp,
    /// How long it is expected to take: shorter jobs pass longer ones.
    pub expected: Duration,
    /// Results that an equal request left: the job has succeeded at once.
    pub reused: Option<Reused>,
}

/// Results taken over from an equal request.
#[derive(Clone, Debug)]
pub struct Reused {
    /// Folder that they were copied to.
    pub token: String,
    /// The files.
    pub results: Vec<ResultFile>,
    /// Warnings of the run that made them.
    pub warnings: Vec<JobWarning>,
    /// Version that made them.
    pub program: String,
}

/// A job that is expected to take a second longer lets pass what comes up to this many seconds later: so
/// short jobs do not wait for long ones, and long ones not for ever.
pub const PATIENCE: u32 = 10;

/// How long jobs are expected to take that wait in one lane at the most, all but the last: a tenant's long jobs do not hold up
/// its short ones.
pub const LANES: [Duration; 2] = [Duration::from_secs(1), Duration::from_secs(10)];

impl NewJob {
    /// How long it is expected to take, milliseconds.
    #[must_use]
    pub fn expected_ms(&self) -> i64 {
        i64::try_from(self.expected.as_millis()).unwrap_or(i64::MAX)
    }

    /// The lane in which it waits: 0 for the shortest.
    #[must_use]
    pub fn lane(&self) -> i64 {
        LANES.iter().map(|longest| i64::from(self.expected >= *longest)).sum()
    }
}

/// When the turn comes of a job that begins to wait at `now_ms` behind others of its tenant and lane, of which the last has its turn
/// at `last_ms`, milliseconds since 1970. Queued jobs are run in the order of their turns, those of all tenants: one that sends many
/// has its turns far apart, and others' come between. Fixed once, so that a claim looks at the first only.
#[must_use]
pub fn turn_ms(now_ms: i64, last_ms: Option<i64>, expected_ms: i64) -> i64 {
    let begin = last_ms.map_or(now_ms, |last| last.max(now_ms));
    begin.saturating_add(expected_ms.max(1).saturating_mul(PATIENCE.into()))
}

/// What may wait.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct QueueLimits {
    /// Jobs of all tenants.
    pub jobs: u64,
    /// Bytes of their masks.
    pub bytes: u64,
    /// How much of both one tenant may take, percent.
    pub share_percent: u8,
    /// Bytes of files that may be kept of one tenant.
    pub storage_bytes: u64,
}

impl QueueLimits {
    /// Fails when a job with a mask of `bytes` bytes more would be too much beside what waits.
    ///
    /// # Errors
    /// [`StoreError::QueueFull`] or [`StoreError::ShareFull`].
    pub fn check(&self, load: &QueueLoad, bytes: u64) -> Result<(), StoreError> {
        let share = |limit: u64| (u128::from(limit) * u128::from(self.share_percent)).div_ceil(100);
        if load.jobs >= self.jobs || load.bytes.saturating_add(bytes) > self.bytes {
            return Err(StoreError::QueueFull);
        }
        let is_over = u128::from(load.own_jobs) >= share(self.jobs)
            || u128::from(load.own_bytes.saturating_add(bytes)) > share(self.bytes);
        if is_over { Err(StoreError::ShareFull) } else { Ok(()) }
    }

    /// Fails when so many bytes more would be too many beside what is kept of the tenant.
    ///
    /// # Errors
    /// [`StoreError::StorageShareFull`].
    pub fn check_storage(&self, load: &QueueLoad, bytes: u64) -> Result<(), StoreError> {
        let is_over = load.kept_bytes.saturating_add(bytes) > self.storage_bytes;
        if is_over { Err(StoreError::StorageShareFull) } else { Ok(()) }
    }
}

/// What waits.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct QueueLoad {
    /// Jobs of all tenants.
    pub jobs: u64,
    /// Bytes of their masks.
    pub bytes: u64,
    /// Jobs of the tenant that was asked for.
    pub own_jobs: u64,
    /// Bytes of its masks.
    pub own_bytes: u64,
    /// Bytes of all files that are kept of it.
    pub kept_bytes: u64,
}

impl QueueLoad {
    /// The same without one of the tenant's own jobs.
    #[must_use]
    pub fn without_own(self, bytes: u64) -> Self {
        Self {
            jobs: self.jobs.saturating_sub(1),
            bytes: self.bytes.saturating_sub(bytes),
            own_jobs: self.own_jobs.saturating_sub(1),
            own_bytes: self.own_bytes.saturating_sub(bytes),
            ..self
        }
    }
}

/// What became of a job to be kept.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Inserted {
    /// It is kept.
    New,
    /// The same request was kept before, under the same idempotency key.
    Known(JobId),
}

/// The right to write one job's outcome. The token is the fence: a worker that lost its lease
/// holds a token that the store no longer knows.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Lease {
    /// The job.
    pub id: JobId,
    /// Unique for every claim.
    pub token: String,
}

/// How long a silent worker keeps its job. Three heartbeats, so that one may be lost.
pub const LEASE: SignedDuration = SignedDuration::from_secs(30);

/// A name that nothing else has.
#[must_use]
pub fn new_token() -> String {
    Uuid::now_v7().hyphenated().to_string()
}

/// A job that was given to a worker.
#[derive(Clone, Debug)]
pub struct Claim {
    /// The right to write its outcome.
    pub lease: Lease,
    /// The job, already running.
    pub job: Job,
}

/// How a run ended.
#[derive(Clone, Debug)]
pub enum Outcome {
    /// With results, whose files lie in the folder of the lease token.
    Succeeded {
        /// What it left.
        results: Vec<ResultFile>,
        /// What its reader should know.
        warnings: Vec<JobWarning>,
        /// Version of the program that made them.
        program: String,
    },
    /// With an error.
    Failed(Box<Problem>),
    /// On request.
    Canceled,
}

impl Outcome {
    /// As a cause of a move.
    #[must_use]
    pub fn cause(&self) -> Cause {
        match self {
            Self::Succeeded { .. } => Cause::Succeed,
            Self::Failed(_) => Cause::Fail,
            Self::Canceled => Cause::Stop,
        }
    }
}

/// What a request to cancel came to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum CancelAnswer {
    /// It had not begun and never will.
    Canceled,
    /// It runs and will stop soon.
    Requested,
    /// It had ended before.
    AlreadyEnded(JobState),
    /// There is no such job.
    NotFound,
}

/// What a request to run a job again came to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum RetryAnswer {
    /// It waits again.
    Queued,
    /// It has not failed and was not canceled.
    NotRetryable(JobState),
    /// Its mask is erased.
    MaskErased,
    /// There is no such job.
    NotFound,
}

/// Which running jobs are taken from their workers.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Reclaim<'a> {
    /// Those of a process that is gone.
    Instance(&'a str),
    /// Those whose lease ran out before this time.
    LeaseBefore(Timestamp),
}

/// A running job as its own process has to see it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Held {
    /// The right that the store knows.
    pub lease: Lease,
    /// Whether its client asked to stop it.
    pub cancel_requested: bool,
}

/// Which jobs to list, newest first.
#[derive(Clone, Debug, Default)]
pub struct ListQuery {
    /// Only those of this tenant.
    pub owner: String,
    /// Only those in this state.
    pub state: Option<JobState>,
    /// Only those with this label: name and value.
    pub label: Option<(String, String)>,
    /// Only those that came before this one.
    pub before: Option<JobId>,
    /// At most this many.
    pub limit: u32,
}

/// Which DICOM objects to find among the results that are kept, newest job first.
#[derive(Clone, Debug, Default)]
pub struct ObjectQuery {
    /// Only those of this tenant.
    pub owner: String,
    /// Only these.
    pub by: ObjectsBy,
    /// At most this many.
    pub limit: u32,
}

/// DICOM objects by one identifier.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub enum ObjectsBy {
    /// Whatever they are called.
    #[default]
    Any,
    /// Of this study.
    Study(String),
    /// Of this series.
    Series(String),
    /// This one, of as many jobs as have it.
    Instance(String),
}

/// A result that is a DICOM object.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct KeptObject {
    /// Its job.
    pub id: JobId,
    /// The attempt that made it.
    pub token: String,
    /// Its file.
    pub file: ResultFile,
    /// Which object it is.
    pub object: DicomObject,
}

/// What of a job's files may not be swept.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct KeptFiles {
    /// The job.
    pub id: JobId,
    /// Whether its mask is kept.
    pub mask: bool,
    /// Attempts whose files are published or being made.
    pub tokens: Vec<String>,
}

/// A webhook whose time has come.
#[derive(Clone, Debug)]
pub struct DueCallback {
    /// The job it tells of, ended.
    pub job: Job,
    /// Where to.
    pub url: String,
    /// Tries so far.
    pub tries: u32,
}

/// The host that a URL leads to, with its port.
#[must_use]
pub fn host_of(url: &str) -> &str {
    let rest = url.split_once("://").map_or(url, |(_, rest)| rest);
    rest.split(['/', '?', '#']).next().unwrap_or(rest)
}

/// How a webhook or a delivery goes on after a try.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SendNext {
    /// It arrived.
    Delivered,
    /// Once more at this time.
    TryAt(Timestamp),
    /// No more.
    GiveUp,
}

/// Jobs from the view of clients.
#[async_trait]
pub trait JobStore: Send + Sync {
    /// Keeps a job as queued, or as succeeded when its results are reused. Says so when its
    /// idempotency key is known.
    async fn insert(&self, job: &NewJob, limits: QueueLimits) -> Result<Inserted, StoreError>;

    /// One job.
    async fn get(&self, id: JobId) -> Result<Option<Job>, StoreError>;

    /// Some jobs, newest first.
    async fn list(&self, query: &ListQuery) -> Result<Vec<Job>, StoreError>;

    /// The job that a tenant sent under an idempotency key.
    async fn find_key(&self, owner: &str, key: &str) -> Result<Option<JobId>, StoreError>;

    /// The newest job of a tenant that succeeded with equal work, whose results are kept and were
    /// made by this version of the program.
    async fn find_equal(&self, owner: &str, work_sha256: &str, program: &str) -> Result<Option<Job>, StoreError>;

    /// Asks for the end of a job.
    async fn cancel(&self, id: JobId, now: Timestamp) -> Result<CancelAnswer, StoreError>;

    /// Puts a failed or canceled job back into the queue, its attempts counted anew.
    async fn retry(&self, id: JobId, now: Timestamp, limits: QueueLimits) -> Result<RetryAnswer, StoreError>;

    /// Names one more result of a job that has succeeded, in the folder `token`; one that is named already stays.
    /// `false` when the job is gone, or its results are.
    async fn add_result(&self, id: JobId, token: &str, file: &ResultFile) -> Result<bool, StoreError>;

    /// Whether a tenant has a job.
    async fn has_jobs_of(&self, owner: &str) -> Result<bool, StoreError>;

    /// Gives a tenant all jobs that nobody owns; says how many. Where it used their idempotency key itself, they lose theirs.
    async fn adopt_jobs(&self, owner: &str) -> Result<u64, StoreError>;

    /// Forgets a job, running or not; `false` when there is none.
    async fn delete(&self, id: JobId) -> Result<bool, StoreError>;
}

/// Jobs from the view of workers.
#[async_trait]
pub trait QueueStore: Send + Sync {
    /// What waits, of all and of one tenant.
    async fn load(&self, owner: &str) -> Result<QueueLoad, StoreError>;

    /// When the job arrived that has waited longest.
    async fn oldest_queued(&self) -> Result<Option<Timestamp>, StoreError>;

    /// The places of those of these jobs that wait among all that do, from 1.
    async fn positions(&self, ids: &[JobId]) -> Result<BTreeMap<JobId, u64>, StoreError>;

    /// Gives the waiting job whose turn comes first to `instance` under a new lease that ends at `until`.
    async fn claim(&self, instance: &str, now: Timestamp, until: Timestamp) -> Result<Option<Claim>, StoreError>;

    /// Keeps a lease until a later time.
    async fn extend(&self, lease: &Lease, until: Timestamp) -> Result<(), StoreError>;

    /// All that `instance` runs.
    async fn held_by(&self, instance: &str) -> Result<Vec<Held>, StoreError>;

    /// Writes the outcome and ends the lease.
    async fn finish(&self, lease: &Lease, outcome: &Outcome, now: Timestamp) -> Result<(), StoreError>;

    /// Puts a job back that its worker could not finish through no fault of the job: the attempt
    /// does not count.
    async fn release(&self, lease: &Lease, now: Timestamp) -> Result<(), StoreError>;

    /// Takes running jobs from workers that are gone: back to queued, failed after
    /// [`MAX_ATTEMPTS`], canceled where that was asked for. Says which, and their states. Several that ran in one process that is
    /// gone are suspects: none is charged with an attempt, and each runs alone in its process from then on.
    async fn reclaim(&self, which: Reclaim<'_>, now: Timestamp) -> Result<Vec<(JobId, JobState)>, StoreError>;
}

/// What is erased in time.
#[async_trait]
pub trait RetentionStore: Send + Sync {
    /// Marks masks of jobs that ended before this time as erased; at most `limit`.
    async fn expire_masks(&self, ended_before: Timestamp, limit: u32) -> Result<Vec<JobId>, StoreError>;

    /// Marks the mask of one job as erased.
    async fn forget_mask(&self, id: JobId) -> Result<(), StoreError>;

    /// Says that the results of a job are erased.
    async fn forget_results(&self, id: JobId) -> Result<(), StoreError>;

    /// Marks results of jobs that ended before this time as erased; at most `limit`.
    async fn expire_results(&self, ended_before: Timestamp, limit: u32) -> Result<Vec<JobId>, StoreError>;

    /// Forgets jobs that ended before this time; at most `limit`.
    async fn expire_jobs(&self, ended_before: Timestamp, limit: u32) -> Result<Vec<JobId>, StoreError>;

    /// Jobs whose rows were deleted a while ago at the most: their end may not stand in the audit log yet.
    async fn erased_jobs(&self) -> Result<Vec<JobId>, StoreError>;

    /// Forgets that rows were deleted before this time.
    async fn forget_erased(&self, before: Timestamp) -> Result<(), StoreError>;

    /// What may not be swept.
    async fn kept_files(&self) -> Result<Vec<KeptFiles>, StoreError>;
}

/// Results that are DICOM objects. Erased results, and those of jobs that are gone, are not found.
#[async_trait]
pub trait ObjectStore: Send + Sync {
    /// Some objects, newest job first. One that several jobs have comes once for each.
    async fn find_objects(&self, query: &ObjectQuery) -> Result<Vec<KeptObject>, StoreError>;
}

/// Webhooks under way.
#[async_trait]
pub trait CallbackStore: Send + Sync {
    /// The webhook whose time came first, of those of whose tenant and host `is_busy` does not hold, given to the caller until `until`.
    /// However many wait of one tenant for one host, one of them is looked at.
    async fn claim_callback(
        &self,
        now: Timestamp,
        until: Timestamp,
        is_busy: &(dyn for<'a> Fn(&'a str, &'a str) -> bool + Sync),
    ) -> Result<Option<DueCallback>, StoreError>;

    /// Writes what came of a try.
    async fn callback_tried(&self, id: JobId, tried: &SendTry, next: SendNext) -> Result<(), StoreError>;
}

/// Results on their way to archives.
#[async_trait]
pub trait DeliveryStore: Send + Sync {
    /// The job whose delivery to this archive came due first, given to the caller until `until`.
    async fn claim_delivery(&self, to: &str, now: Timestamp, until: Timestamp) -> Result<Option<Job>, StoreError>;

    /// Keeps it for who holds it until `held` until a later time; `false` when it is not theirs any more: another took it, or
    /// the results are erased.
    async fn extend_delivery(&self, id: JobId, held: Timestamp, until: Timestamp) -> Result<bool, StoreError>;

    /// Makes all that wait for a next try due now, also those that somebody had who is gone. Only for one who is alone:
    /// else two send the same.
    async fn all_deliveries_due(&self, now: Timestamp) -> Result<(), StoreError>;

    /// Writes that the archive has one more of the results.
    async fn delivery_stored(&self, id: JobId, name: &str) -> Result<(), StoreError>;

    /// Makes a delivery due again that was given up, its tries counted anew; `false` when there is none whose results are
    /// kept.
    async fn retry_delivery(&self, id: JobId, now: Timestamp) -> Result<bool, StoreError>;

    /// Writes what came of a try of who holds it until `held`; nothing when it is not theirs any more.
    async fn delivery_tried(
        &self,
        id: JobId,
        held: Timestamp,
        tried: &SendTry,
        next: SendNext,
    ) -> Result<(), StoreError>;
}

/// What is remembered of the audit log.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct AuditMarks {
    /// The entry before the first one of its present file.
    pub head: Mark,
    /// The last entry.
    pub tip: Mark,
}

/// Access tokens.
#[async_trait]
pub trait TokenStore: Send + Sync {
    /// Keeps a new token.
    async fn insert_token(&self, token: &StoredToken) -> Result<(), StoreError>;

    /// The token with this public half.
    async fn get_token(&self, id: &str) -> Result<Option<StoredToken>, StoreError>;

    /// All tokens, oldest first, revoked ones too.
    async fn list_tokens(&self) -> Result<Vec<StoredToken>, StoreError>;

    /// Whether there ever was a token: from then on nobody is let in without.
    async fn has_tokens(&self) -> Result<bool, StoreError>;

    /// Revokes a token; `false` when there is none, or it was revoked before.
    async fn revoke_token(&self, id: &str, now: Timestamp) -> Result<bool, StoreError>;
}

/// Keeps jobs and tokens. Every call is atomic, and durable when it returns.
#[async_trait]
pub trait Store:
    JobStore + QueueStore + RetentionStore + ObjectStore + CallbackStore + DeliveryStore + TokenStore
{
    /// Fails unless the store can be written to.
    async fn check_writable(&self) -> Result<(), StoreError>;

    /// Fails unless the store can be read. Writes nothing.
    async fn check_readable(&self) -> Result<(), StoreError>;

    /// What the store finds wrong with itself; empty when nothing is.
    async fn check_integrity(&self) -> Result<Vec<String>, StoreError>;

    /// What is remembered of the audit log.
    async fn audit_marks(&self) -> Result<Option<AuditMarks>, StoreError>;

    /// Remembers it, unless a later entry is remembered already.
    async fn mark_audit(&self, marks: &AuditMarks) -> Result<(), StoreError>;

    /// Takes away what is left of deleted rows outside of the tables; `false` when others hold it back at the moment.
    async fn wipe_deleted(&self) -> Result<bool, StoreError>;

    /// Writes a copy of all of it as it is now to a file that is not there yet; others may write meanwhile.
    async fn copy_to(&self, file: &Path) -> Result<(), StoreError>;

    /// Puts the store to rest; no call succeeds afterwards.
    async fn close(&self);
}
