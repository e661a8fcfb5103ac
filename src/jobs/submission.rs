//! Takes a mask in: checked, stored, and its row written, or answered from what is there already.

use std::collections::BTreeMap;
use std::fs::File;
use std::path::Path;

use jiff::Timestamp;
use serde_json::Value;
use sha2::{Digest, Sha256};
use tokio::task::spawn_blocking;

use super::caller::Caller;
use super::error::JobsError;
use super::expected::expected;
use super::job::{Job, JobId, RequestedParams, ResultFile};
use super::service::{JobStatus, Jobs};
use super::store::{Inserted, NewJob, Reused, StoreError, new_token};
use super::upload::{Received, preflight};
use crate::audit::Action;
use crate::formats::{Identity, hex};
use crate::problem::Problem;

/// Version that results were made by; those of another one are not reused.
pub const PROGRAM: &str = env!("CARGO_PKG_VERSION");

/// What a client asks for.
#[derive(Debug)]
pub struct Submission {
    /// The mask.
    pub upload: Received,
    /// What to do with it.
    pub params: RequestedParams,
    /// The client's own labels.
    pub labels: BTreeMap<String, String>,
    /// Whom to tell of the end.
    pub callback_url: Option<String>,
    /// Archive that the results go to.
    pub deliver_to: Option<String>,
    /// Names the request, so that sending it again does nothing.
    pub idempotency_key: Option<String>,
    /// Whether the results of an equal request will do.
    pub may_reuse: bool,
}

impl Submission {
    fn work_sha256(&self) -> String {
        hashed(&[&self.upload.mask.sha256, &self.params.canonical()])
    }

    /// The order of names does not matter: some clients shuffle it.
    fn request_sha256(&self) -> String {
        let mut params: Value = serde_json::from_str(self.params.json()).unwrap_or_default();
        params.sort_all_objects();
        let labels: Vec<String> = self.labels.iter().map(|(name, value)| format!("{name}={value}")).collect();
        let callback = self.callback_url.as_deref().unwrap_or_default();
        let (params, labels) = (params.to_string(), labels.join("\n"));
        let mut parts = vec![&*self.upload.mask.sha256, &params, &labels, callback];
        // Left out where there is none: so a request that an earlier version took in is still known.
        parts.extend(self.deliver_to.as_deref());
        hashed(&parts)
    }
}

/// Each part is followed by its length, so that no two lists are written alike. They are short: parameters and
/// labels of at most 64 KiB.
fn hashed(parts: &[&str]) -> String {
    let mut hash = Sha256::new();
    for part in parts {
        hash.update(part);
        hash.update(part.len().to_le_bytes());
    }
    hex(&hash.finalize())
}

/// What became of a submission.
#[derive(Clone, Debug)]
pub struct Accepted {
    /// The job.
    pub status: JobStatus,
    /// Whether the same request was accepted before, under the same key.
    pub is_replay: bool,
}

impl Jobs {
    /// Asked before an upload of `bytes` bytes (0: it is not said) is read: whether there is room
    /// for it. A request whose key is known needs none.
    ///
    /// # Errors
    /// When the queue, the caller's share of it or the disk is full.
    pub async fn admit(&self, caller: &Caller, bytes: u64, key: Option<&str>) -> Result<(), JobsError> {
        let is_known = match key {
            Some(key) => self.store().find_key(&caller.tenant, key).await?.is_some(),
            None => false,
        };
        if !is_known {
            let (limits, load) = (self.queue_limits(&caller.tenant)?, self.store().load(&caller.tenant).await?);
            limits.check_storage(&load, bytes)?;
            limits.check(&load, bytes)?;
        }
        self.check_disk(bytes)
    }

    /// Accepts a mask. On return the job is on disk and survives the loss of power.
    ///
    /// # Errors
    /// When the file is refused, the queue is full, the key was used for something else, or storage
    /// fails; nothing is left then.
    pub async fn submit(&self, caller: &Caller, submission: Submission) -> Result<Accepted, JobsError> {
        let accepted = self.accept(caller, &submission).await;
        // Last: whoever gives up waiting here has a job that is recorded.
        submission.upload.forget().await;
        accepted
    }

    async fn accept(&self, caller: &Caller, submission: &Submission) -> Result<Accepted, JobsError> {
        let new = self.new_job(caller, submission).await?;
        match self.keep(&new, &submission.upload.file).await? {
            Inserted::New => self.begin_to_wait(caller, &new).await,
            Inserted::Known(id) => Ok(Accepted { status: self.status(caller, id).await?, is_replay: true }),
        }
    }

    /// What is to be kept of a submission.
    async fn new_job(&self, caller: &Caller, submission: &Submission) -> Result<NewJob, JobsError> {
        let (id, now) = (JobId::now(), Timestamp::now());
        let (file, limits) = (submission.upload.file.to_path_buf(), self.limits().input);
        let is_delivered = submission.deliver_to.is_some();
        let header = spawn_blocking(move || {
            let header = preflight(&file, limits)?;
            if is_delivered { check_deliverable(&file).map(|()| header) } else { Ok(header) }
        });
        let header = header.await?.map_err(JobsError::Refused)?;
        let mask = &submission.upload.mask;
        Ok(NewJob {
            id,
            owner: caller.tenant.clone(),
            request_sha256: submission.request_sha256(),
            work_sha256: submission.work_sha256(),
            expected: expected(&header, mask.bytes, submission.params.checked()),
            reused: self.reuse(caller, submission, id).await?,
            mask: mask.clone(),
            params_json: submission.params.json().to_owned(),
            labels: submission.labels.clone(),
            idempotency_key: submission.idempotency_key.clone(),
            callback_url: submission.callback_url.clone(),
            deliver_to: submission.deliver_to.clone(),
            trace_id: caller.trace_id.clone(),
            created_at: now,
        })
    }

    /// Mask first, row then; leaves no file of a job that is not new.
    async fn keep(&self, new: &NewJob, file: &Path) -> Result<Inserted, JobsError> {
        let inserted = match self.blobs().keep_mask(file, new.id).await {
            Ok(()) => {
                let inserted = self.store().insert(new, self.queue_limits(&new.owner)?).await;
                self.storage_health().hear(&inserted);
                inserted.map_err(JobsError::Store)
            }
            Err(error) => Err(JobsError::Files(error)),
        };
        if is_not_kept(&inserted)
            && let Err(error) = self.blobs().erase(new.id).await
        {
            tracing::error!(job = %new.id, %error, "files of a refused job cannot be removed; they are swept later");
        }
        inserted
    }

    async fn begin_to_wait(&self, caller: &Caller, new: &NewJob) -> Result<Accepted, JobsError> {
        let is_reused = new.reused.is_some();
        tracing::info!(job = %new.id, bytes = new.mask.bytes, is_reused, "job accepted");
        self.metrics().accepted(is_reused);
        self.wake_one();
        self.record(caller, Action::Submit, Some(new.id), if is_reused { "reused" } else { "accepted" }).await;
        if is_reused {
            self.has_ended(new.id).await;
        }
        Ok(Accepted { status: self.status(caller, new.id).await?, is_replay: false })
    }

    /// Takes over the results of equal work, copied so that each job can be deleted by itself.
    async fn reuse(&self, caller: &Caller, submission: &Submission, id: JobId) -> Result<Option<Reused>, JobsError> {
        if !submission.may_reuse {
            return Ok(None);
        }
        let equal = self.store().find_equal(&caller.tenant, &submission.work_sha256(), PROGRAM).await?;
        let Some(Job { id: from, results, warnings, results_token: Some(from_token), .. }) = equal else {
            return Ok(None);
        };
        if results.iter().any(ResultFile::is_unnamed_object) {
            return Ok(None);
        }
        for file in &results {
            match self.content(from, &from_token, file).await {
                Ok(_) => {}
                // Damaged, or deleted in this moment: then it is computed again.
                Err(JobsError::ResultDamaged | JobsError::NotFound | JobsError::ResultsErased) => return Ok(None),
                Err(JobsError::Files(error)) => {
                    tracing::error!(job = %from, name = file.name, %error, "a result cannot be read");
                    self.metrics().damaged();
                    return Ok(None);
                }
                Err(error) => return Err(error),
            }
        }
        let token = new_token();
        match self.blobs().copy_results((from, &from_token), (id, &token), &results).await {
            Ok(()) => Ok(Some(Reused { token, results, warnings, program: PROGRAM.to_owned() })),
            // Deleted in this moment, say: then it is computed again.
            Err(error) => {
                tracing::info!(%error, "results cannot be reused");
                self.blobs().erase_results(id).await?;
                Ok(None)
            }
        }
    }
}

/// Whether results of this file can go to an archive: without a patient and a study, it would not know where to. Blocks.
///
/// # Errors
/// When the file is no DICOM, or cannot be read.
fn check_deliverable(file: &Path) -> Result<(), Box<Problem>> {
    let identity =
        File::open(file).and_then(Identity::of_file).map_err(|error| Box::new(Problem::of_storage(&error)))?;
    if identity.is_some_and(|identity| identity.study.is_some()) {
        return Ok(());
    }
    let problem =
        Problem::new(422, "nothing_to_deliver", "results for a PACS need a patient and a study, and the mask has none");
    Err(Box::new(problem.at("deliver_to").hint("send a DICOM segmentation, or leave deliver_to out")))
}

/// Whether it is certain that no row was kept. What an error of the database leaves is unknown: a change that could not be
/// brought to disk may be there after the next start. Files without a row are swept.
fn is_not_kept(inserted: &Result<Inserted, JobsError>) -> bool {
    match inserted {
        Ok(Inserted::New) => false,
        Ok(Inserted::Known(_)) => true,
        Err(JobsError::Store(error)) => matches!(
            error,
            StoreError::QueueFull | StoreError::ShareFull | StoreError::StorageShareFull | StoreError::KeyReused
        ),
        Err(_) => true,
    }
}
