//! Why something was not done with a job.

use std::io;

use tokio::task::JoinError;

use super::job::JobState;
use super::store::StoreError;
use crate::problem::Problem;

/// Why something was not done with a job.
#[derive(Debug, thiserror::Error)]
pub enum JobsError {
    /// There is no such job, or it is another tenant's.
    #[error("no such job")]
    NotFound,
    /// The job has no result of this name.
    #[error("no such result")]
    NoSuchResult {
        /// The job's state.
        state: JobState,
    },
    /// Its results were erased in time.
    #[error("the results are erased")]
    ResultsErased,
    /// A result on disk is not what was published.
    #[error("a result is damaged")]
    ResultDamaged,
    /// The job has ended and cannot be cancelled.
    #[error("the job has ended")]
    AlreadyEnded(JobState),
    /// The job has not failed and was not canceled.
    #[error("the job cannot be run again")]
    NotRetryable(JobState),
    /// The mask was erased.
    #[error("the mask is erased")]
    MaskErased,
    /// The disk has less room than is to be left free.
    #[error("the disk is nearly full")]
    StorageLow,
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
