//! The files of a job that has succeeded: those that its run left, and those that are made when somebody asks.

use std::io;

use super::blocking::on_own_thread;
use super::caller::Caller;
use super::drafts::RECORD;
use super::error::JobsError;
use super::job::{Job, JobId, ResultFile};
use super::process::{ProcessError, make};
use super::service::Jobs;
use super::store::blobs::Content;
use super::store::new_token;
use crate::cancel::Never;
use crate::formats::artifacts::{self, Artifact};
use crate::formats::write::record::Record;

/// A published result.
#[derive(Clone, Debug)]
pub struct Published {
    /// Its job.
    pub id: JobId,
    /// The attempt that made it.
    pub token: String,
    /// Its description.
    pub file: ResultFile,
}

impl Published {
    /// The name as a code of ours: it is one of the contract's.
    #[must_use]
    pub fn code(&self) -> &str {
        &self.file.name
    }
}

impl Jobs {
    /// A result by its name. An artifact that was not made with the job is made from its record, and kept.
    ///
    /// # Errors
    /// When there is no such job, it has no such result, or it was erased.
    pub async fn result(&self, caller: &Caller, id: JobId, name: &str) -> Result<Published, JobsError> {
        let job = self.own(caller, id).await?;
        self.result_of(&job, name).await
    }

    /// As [`result`](Self::result), of a job that is at hand.
    ///
    /// # Errors
    /// When it has no such result, or it was erased.
    pub(super) async fn result_of(&self, job: &Job, name: &str) -> Result<Published, JobsError> {
        let id = job.id;
        let missing = JobsError::NoSuchResult { state: job.state };
        let Some(artifact) = artifacts::by_name(name) else { return Err(missing) };
        let Some(token) = job.results_token.clone() else { return Err(missing) };
        if !job.are_results_kept {
            let was_there = job.has_result(name) || job.has_result(RECORD.0);
            return Err(if was_there { JobsError::ResultsErased } else { missing });
        }
        if let Some(file) = job.result(name) {
            return Ok(Published { id, token, file: file.clone() });
        }
        let file = self.made(job, &token, artifact).await?.ok_or(missing)?;
        Ok(Published { id, token, file })
    }

    /// An artifact made from the job's record; `None` when a version of the program ran the job that kept none.
    async fn made(&self, job: &Job, token: &str, artifact: &'static Artifact) -> Result<Option<ResultFile>, JobsError> {
        let Some(record) = job.result(RECORD.0) else { return Ok(None) };
        // One at a time: a record may take as much memory as a run.
        let turn = self.making().lock_owned().await;
        // Another request may have made it meanwhile.
        let job = self.store().get(job.id).await?.ok_or(JobsError::NotFound)?;
        if let Some(file) = job.result(artifact.name) {
            return Ok(Some(file.clone()));
        }
        self.check_disk(record.bytes)?;
        let bytes = self.record_bytes(&job, token, record).await?;
        let (blobs, draft) = (self.blobs().clone(), new_token());
        let folder = draft.clone();
        let made = on_own_thread(move || {
            let folder = blobs.begin_attempt(&folder)?;
            let record = Record::read(bytes.as_slice()).map_err(io::Error::other)?;
            let made = make(&record, artifact, &folder, &Never).map_err(into_io)?;
            // Held to the end of the work, though whoever asked may be gone; and by who asked until the result is named.
            Ok((ResultFile::from(&made), turn))
        });
        let (file, _turn) = match made.await {
            Ok(made) => made,
            Err(error) => {
                self.end_draft(draft).await?;
                return Err(error.into());
            }
        };
        let kept = self.blobs().keep_made(job.id, (&draft, token), &file.name).await;
        self.end_draft(draft).await?;
        kept?;
        tracing::info!(job = %job.id, name = file.name, "result made on request");
        if self.store().add_result(job.id, token, &file).await? {
            Ok(Some(file))
        } else {
            Err(JobsError::ResultsErased)
        }
    }

    async fn end_draft(&self, draft: String) -> Result<(), JobsError> {
        let blobs = self.blobs().clone();
        Ok(on_own_thread(move || blobs.end_attempt(&draft)).await?)
    }

    /// The bytes of the record, once they were found to be what was kept.
    async fn record_bytes(&self, job: &Job, token: &str, record: &ResultFile) -> Result<Vec<u8>, JobsError> {
        match self.content(job.id, token, record).await? {
            Content::Bytes(bytes, _) => Ok(bytes.to_vec()),
            Content::Stored => Ok(self.blobs().read_all(job.id, token, record).await?),
        }
    }

    /// A file of a job, once it was found to be what was kept.
    ///
    /// # Errors
    /// [`JobsError::ResultDamaged`] when it is not, or is gone though the job should have it.
    pub async fn content(&self, id: JobId, token: &str, file: &ResultFile) -> Result<Content, JobsError> {
        match self.blobs().read_checked(id, token, file).await {
            Ok(Some(content)) => return Ok(content),
            Ok(None) => {}
            Err(error) if error.kind() == io::ErrorKind::NotFound => match self.store().get(id).await? {
                None => return Err(JobsError::NotFound),
                Some(job) if !job.are_results_kept => return Err(JobsError::ResultsErased),
                Some(_) => {}
            },
            Err(error) => return Err(error.into()),
        }
        self.metrics().damaged();
        tracing::error!(job = %id, name = file.name, "a result is not what was published");
        Err(JobsError::ResultDamaged)
    }
}

fn into_io(error: ProcessError) -> io::Error {
    match error {
        ProcessError::Io { error, .. } => error,
        ProcessError::Crashed { how } => io::Error::other(how.clone()),
        ProcessError::Cancelled => io::Error::other("cancelled"),
        ProcessError::Problem(problem) => io::Error::other(problem.detail.clone()),
    }
}
