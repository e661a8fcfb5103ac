//! The store: what is kept of jobs, and who may change it. One trait, so that the service does
//! not know the database.

use std::time::Duration;

use async_trait::async_trait;
use jiff::Timestamp;

use super::job::{Job, JobId, JobState, JobWarning, MaskInfo, ResultFile};
use crate::problem::Problem;

/// Runs of one job before it is given up. A job that takes its server down with it would
/// otherwise do so for ever.
pub const MAX_ATTEMPTS: u32 = 3;

/// Why the store did not do what was asked.
#[derive(Debug, thiserror::Error)]
pub enum StoreError {
    /// As many jobs wait as are allowed to.
    #[error("the queue is full")]
    QueueFull,
    /// The lease was lost: the job was given to another worker, deleted or ended.
    #[error("the lease is not held any more")]
    StaleLease,
    /// The database failed.
    #[error("database: {0}")]
    Database(#[from] sqlx::Error),
    /// The tables could not be brought up to date.
    #[error("database migration: {0}")]
    Migration(#[from] sqlx::migrate::MigrateError),
    /// A row holds what this program never writes.
    #[error("column {column} of a job holds what no job can have")]
    Corrupt {
        /// Its column.
        column: &'static str,
    },
}

/// A job to be kept.
#[derive(Clone, Debug)]
pub struct NewJob {
    /// Its id.
    pub id: JobId,
    /// What was uploaded.
    pub mask: MaskInfo,
    /// Parameters as sent.
    pub params_json: String,
    /// When it was accepted.
    pub created_at: Timestamp,
    /// How long it is expected to take: shorter jobs pass longer ones.
    pub expected: Duration,
}

/// A job that is expected to take a second longer lets pass what comes up to this many seconds later: so
/// short jobs do not wait for long ones, and long ones not for ever.
pub const PATIENCE: u32 = 10;

impl NewJob {
    /// When its turn comes, milliseconds since 1970: queued jobs are run in this order.
    #[must_use]
    pub fn turn_ms(&self) -> i64 {
        let later = i64::try_from((self.expected * PATIENCE).as_millis()).unwrap_or(i64::MAX);
        self.created_at.as_millisecond().saturating_add(later)
    }
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
    },
    /// With an error.
    Failed(Box<Problem>),
    /// On request.
    Canceled,
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

/// Which running jobs are taken from their workers.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Reclaim {
    /// All: at the start, when no worker can be left.
    All,
    /// Those whose lease ran out before this time.
    LeaseBefore(Timestamp),
}

/// Which jobs to list, newest first.
#[derive(Clone, Copy, Debug, Default)]
pub struct ListQuery {
    /// Only those in this state.
    pub state: Option<JobState>,
    /// Only those that came before this one.
    pub before: Option<JobId>,
    /// At most this many.
    pub limit: u32,
}

/// Keeps jobs. Every call is atomic, and durable when it returns.
#[async_trait]
pub trait JobStore: Send + Sync {
    /// Keeps a job as queued unless `max_queued` wait already.
    async fn insert(&self, job: &NewJob, max_queued: u64) -> Result<(), StoreError>;

    /// One job.
    async fn get(&self, id: JobId) -> Result<Option<Job>, StoreError>;

    /// Some jobs, newest first.
    async fn list(&self, query: ListQuery) -> Result<Vec<Job>, StoreError>;

    /// Jobs that wait.
    async fn count_queued(&self) -> Result<u64, StoreError>;

    /// Jobs that wait and came before this one.
    async fn count_queued_before(&self, id: JobId) -> Result<u64, StoreError>;

    /// Gives the oldest waiting job away under a new lease that ends at `until`.
    async fn claim(&self, now: Timestamp, until: Timestamp) -> Result<Option<Claim>, StoreError>;

    /// Keeps a lease until a later time; `true` when the client asked to cancel meanwhile.
    async fn extend(&self, lease: &Lease, until: Timestamp) -> Result<bool, StoreError>;

    /// Writes the outcome and ends the lease.
    async fn finish(&self, lease: &Lease, outcome: &Outcome, now: Timestamp) -> Result<(), StoreError>;

    /// Puts a job back that its worker could not finish through no fault of the job: the attempt
    /// does not count.
    async fn release(&self, lease: &Lease) -> Result<(), StoreError>;

    /// Takes running jobs from workers that are gone: back to queued, failed after
    /// [`MAX_ATTEMPTS`], canceled where that was asked for. Says how many.
    async fn reclaim(&self, which: Reclaim, now: Timestamp) -> Result<u64, StoreError>;

    /// Asks for the end of a job.
    async fn cancel(&self, id: JobId, now: Timestamp) -> Result<CancelAnswer, StoreError>;

    /// Forgets a job, running or not; `false` when there is none.
    async fn delete(&self, id: JobId) -> Result<bool, StoreError>;

    /// Every job with the attempt whose files are published: what may not be swept.
    async fn kept_files(&self) -> Result<Vec<(JobId, Option<String>)>, StoreError>;

    /// Fails unless the store can be written to.
    async fn check_writable(&self) -> Result<(), StoreError>;

    /// Puts the store to rest; no call succeeds afterwards.
    async fn close(&self);
}
