//! What bounds the jobs, and how long what is kept of them.

use std::time::Duration;

use super::process::InputLimits;
use super::store::QueueLimits;
use super::upload::UploadLimits;

/// What bounds the jobs.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct JobLimits {
    /// What may wait.
    pub queue: QueueLimits,
    /// Room on the disk below which nothing is taken in, bytes.
    pub min_free_bytes: u64,
    /// How much of the disk the files of one tenant may take, percent.
    pub storage_percent: u8,
    /// Requests of one tenant at the same time; who is not known is many.
    pub max_requests: usize,
    /// Longest run of a job.
    pub max_run: Duration,
    /// Bounds on an upload.
    pub upload: UploadLimits,
    /// Bounds on what a file may unpack to.
    pub input: InputLimits,
    /// How long what is kept.
    pub keep: Retention,
}

/// How long after the end of a job what is kept of it; `None` is for ever.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Retention {
    /// The job itself, and all else of it.
    pub jobs: Option<Duration>,
    /// Its mask.
    pub masks: Option<Duration>,
    /// Its results.
    pub results: Option<Duration>,
}
