//! A job: its identity, its states, and what is known about it.

use std::collections::BTreeMap;
use std::fmt;

use jiff::Timestamp;
use serde::{Deserialize, Serialize};
use uuid::Uuid;

use super::drafts::{RECORD, WrittenFile};
use crate::formats::dicom_object::DicomObject;
use crate::formats::params_json::{self, ParamsJsonError};
use crate::params::CheckedParams;
use crate::problem::Problem;

/// Names a job. UUIDv7: ids ascend in order of arrival and cannot be guessed.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct JobId(Uuid);

impl JobId {
    /// A new id, greater than all that this process made before.
    #[must_use]
    pub fn now() -> Self {
        Self(Uuid::now_v7())
    }

    /// Reads the canonical form: 36 characters, lower case, hyphens. Nothing else names a job, so
    /// that a job has one address.
    #[must_use]
    pub fn parse(text: &str) -> Option<Self> {
        let id = Self(Uuid::try_parse(text).ok()?);
        // As others print it too: in either case (RFC 9562, section 4), and in no other form.
        id.to_string().eq_ignore_ascii_case(text).then_some(id)
    }
}

impl fmt::Display for JobId {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.0.hyphenated().fmt(f)
    }
}

/// Where a job stands. A queued one is run or canceled; one that runs ends, or is queued again when its
/// worker is gone; a failed or canceled one is queued again when its client asks for it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, utoipa::ToSchema)]
#[serde(rename_all = "lowercase")]
pub enum JobState {
    /// Waits for a worker.
    Queued,
    /// A worker has it.
    Running,
    /// Ended with results.
    Succeeded,
    /// Ended with an error.
    Failed,
    /// Ended because its client asked for it.
    Canceled,
}

impl JobState {
    /// All states.
    pub const ALL: [Self; 5] = [Self::Queued, Self::Running, Self::Succeeded, Self::Failed, Self::Canceled];

    /// The name used in the API and in the store.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Queued => "queued",
            Self::Running => "running",
            Self::Succeeded => "succeeded",
            Self::Failed => "failed",
            Self::Canceled => "canceled",
        }
    }

    /// The state of this name.
    #[must_use]
    pub fn from_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|state| state.name() == name)
    }

    /// Whether nothing more will happen by itself.
    #[must_use]
    pub fn has_ended(self) -> bool {
        matches!(self, Self::Succeeded | Self::Failed | Self::Canceled)
    }
}

/// What was uploaded.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, utoipa::ToSchema)]
pub struct MaskInfo {
    /// SHA-256 of the bytes as sent, lower-case hex.
    pub sha256: String,
    /// Bytes as sent.
    pub bytes: u64,
}

/// A file that a job left.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct ResultFile {
    /// File name, as in the contract.
    pub name: String,
    /// Media type.
    pub media_type: String,
    /// Size.
    pub bytes: u64,
    /// SHA-256 of the content, lower-case hex.
    pub sha256: String,
    /// Which object it is, where it is DICOM and made by a version that says so. Nobody is told but who searches for it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub dicom: Option<DicomObject>,
}

impl ResultFile {
    /// Whether it is DICOM and was made by a version that did not say which object it is: searches do not find it.
    #[must_use]
    pub fn is_unnamed_object(&self) -> bool {
        self.dicom.is_none() && self.media_type == "application/dicom"
    }
}

impl From<&WrittenFile> for ResultFile {
    fn from(file: &WrittenFile) -> Self {
        Self {
            name: file.name.to_owned(),
            media_type: file.media_type.to_owned(),
            bytes: file.bytes,
            sha256: file.sha256.clone(),
            dicom: file.dicom.clone(),
        }
    }
}

/// Something about a result that its reader should know.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, utoipa::ToSchema)]
pub struct JobWarning {
    /// Stable code, snake case.
    pub code: String,
    /// One sentence.
    pub message: String,
}

/// Parameters as a client sent them, and what they mean.
#[derive(Clone, Debug)]
pub struct RequestedParams {
    json: String,
    checked: CheckedParams,
}

impl RequestedParams {
    /// Reads a JSON object; nothing at all means all defaults.
    ///
    /// # Errors
    /// When the text is no JSON object, names an unknown parameter or holds a value out of range.
    pub fn parse(json: Option<&[u8]>) -> Result<Self, ParamsJsonError> {
        let bytes = json.unwrap_or(b"{}");
        let checked = params_json::parse(bytes)?;
        Ok(Self { json: String::from_utf8_lossy(bytes).into_owned(), checked })
    }

    /// The JSON text as sent.
    #[must_use]
    pub fn json(&self) -> &str {
        &self.json
    }

    /// What it means.
    #[must_use]
    pub fn checked(&self) -> &CheckedParams {
        &self.checked
    }

    /// All parameters, defaults too, in one fixed order: equal for requests that mean the same.
    #[must_use]
    pub fn canonical(&self) -> String {
        params_json::params_to_json(&self.checked).to_string()
    }
}

/// A state that a job came into.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Change {
    /// The state.
    pub state: JobState,
    /// When.
    pub at: Timestamp,
}

/// Where a message about a job stands: its webhook, or the delivery of its results.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, utoipa::ToSchema)]
#[serde(rename_all = "snake_case")]
pub enum SendState {
    /// The job has not come so far: not ended, or not succeeded where results are delivered.
    Waiting,
    /// It is to be sent, or sent again.
    Due,
    /// It arrived.
    Delivered,
    /// It did not arrive, or not all of it, and is not tried again.
    GivenUp,
}

impl SendState {
    /// The name used in the API and in the store.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Waiting => "waiting",
            Self::Due => "due",
            Self::Delivered => "delivered",
            Self::GivenUp => "given_up",
        }
    }

    /// The state of this name.
    #[must_use]
    pub fn from_name(name: &str) -> Option<Self> {
        [Self::Waiting, Self::Due, Self::Delivered, Self::GivenUp].into_iter().find(|state| state.name() == name)
    }
}

/// One try at sending something.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, utoipa::ToSchema)]
pub struct SendTry {
    /// When, RFC 3339.
    #[schema(value_type = String, format = DateTime)]
    pub at: Timestamp,
    /// Status of the answer, if there was one.
    #[schema(required)]
    pub status: Option<u16>,
    /// Why it did not arrive; null when it did.
    #[schema(required)]
    pub error: Option<String>,
}

/// Whom to tell of the end of a job, and whether that was done.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Callback {
    /// Where to.
    pub url: String,
    /// Where it stands.
    pub state: SendState,
    /// All tries, oldest first.
    pub log: Vec<SendTry>,
}

/// Results that go to an archive, and how far that is.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Delivery {
    /// The archive, by the name that the operator gave it.
    pub to: String,
    /// Where it stands.
    pub state: SendState,
    /// Names of the results that the archive has.
    pub stored: Vec<String>,
    /// Tries so far.
    pub tries: u32,
    /// When it is tried next, while it is due.
    pub next_try_at: Option<Timestamp>,
    /// The last try.
    pub last_try: Option<SendTry>,
}

/// Everything the store knows of a job that a client may see.
#[derive(Clone, Debug)]
pub struct Job {
    /// Its id.
    pub id: JobId,
    /// Tenant that sent it; empty when nobody was asked who they are.
    pub owner: String,
    /// The client's own labels.
    pub labels: BTreeMap<String, String>,
    /// Trace of the request that sent it.
    pub trace_id: String,
    /// Where it stands.
    pub state: JobState,
    /// All states it came into, oldest first.
    pub history: Vec<Change>,
    /// Runs begun, this one included.
    pub attempt: u32,
    /// Whether its client asked to stop it.
    pub cancel_requested: bool,
    /// What was uploaded.
    pub mask: MaskInfo,
    /// Parameters as sent.
    pub params_json: String,
    /// When it was accepted.
    pub created_at: Timestamp,
    /// When its last run began.
    pub started_at: Option<Timestamp>,
    /// When it ended.
    pub ended_at: Option<Timestamp>,
    /// Why it failed.
    pub error: Option<Problem>,
    /// Warnings of the run.
    pub warnings: Vec<JobWarning>,
    /// What it left.
    pub results: Vec<ResultFile>,
    /// The attempt whose files are published.
    pub results_token: Option<String>,
    /// Whether its results are those of an equal request.
    pub reused: bool,
    /// Version of the program that made the results.
    pub program: Option<String>,
    /// Whether its mask is still there.
    pub is_mask_kept: bool,
    /// Whether its results, if it had any, are still there.
    pub are_results_kept: bool,
    /// Whom to tell of its end.
    pub callback: Option<Callback>,
    /// Where its results go.
    pub delivery: Option<Delivery>,
}

impl Job {
    /// The results that are still there, and the attempt that made them.
    #[must_use]
    pub fn kept_results(&self) -> Option<(&str, &[ResultFile])> {
        let token = self.results_token.as_deref().filter(|_| self.are_results_kept)?;
        Some((token, &self.results))
    }

    /// A file that it left, by its name.
    #[must_use]
    pub fn result(&self, name: &str) -> Option<&ResultFile> {
        self.results.iter().find(|file| file.name == name)
    }

    /// Whether it left a file of this name.
    #[must_use]
    pub fn has_result(&self, name: &str) -> bool {
        self.result(name).is_some()
    }

    /// The artifacts that it left: all files but its record.
    pub fn artifacts(&self) -> impl Iterator<Item = &ResultFile> {
        self.results.iter().filter(|file| file.name != RECORD.0)
    }
}
