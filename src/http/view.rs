//! Jobs as JSON: what clients see.

use std::collections::BTreeMap;

use serde::Serialize;
use serde_json::value::RawValue;

use super::params_schema::ParamsSchema;
use crate::jobs::job::{
    Callback, Delivery, Job, JobId, JobState, JobWarning, MaskInfo, ResultFile, SendState, SendTry,
};
use crate::jobs::moves::Cause;
use crate::jobs::service::JobStatus;
use crate::pipeline::progress::Progress;
use crate::problem::Problem;

/// A job.
#[derive(Debug, Serialize, utoipa::ToSchema)]
#[schema(as = Job, example = json!({
    "id": "01a20604-b92d-731c-9b47-f6692d322739", "state": "running",
    "progress": {"stage": "isomap", "fraction": 0.55, "structure": 0, "structures": 1},
    "queue_position": null, "attempt": 1, "cancel_requested": false,
    "created_at": "2026-11-23T01:28:22.573Z", "started_at": "2026-11-23T01:28:22.58Z", "ended_at": null,
    "error": null, "warnings": [], "results": [], "params": {"grid": "auto"},
    "mask": {"sha256": "cc9fa289c4879f5d12a020127b7478dadbc4a638e38bc60b672d94b733d703a4", "bytes": 2310},
    "mask_erased": false, "results_erased": false, "reused": false, "labels": {"study": "liver-07"},
    "callback": null, "delivery": null, "trace_id": "0af7651916cd43dd8448eb211c80319c",
    "links": {
        "self": "/v1/jobs/01a20604-b92d-731c-9b47-f6692d322739",
        "events": "/v1/jobs/01a20604-b92d-731c-9b47-f6692d322739/events",
        "cancel": "/v1/jobs/01a20604-b92d-731c-9b47-f6692d322739/cancel", "retry": null
    }
}))]
pub struct JobView {
    /// UUIDv7; ids ascend in order of arrival.
    #[schema(format = "uuid")]
    id: String,
    /// Where the job stands. `succeeded` is for ever; `failed` and `canceled` are until it is run again.
    state: JobState,
    /// How far the run is; null unless running.
    #[schema(required)]
    progress: Option<ProgressView>,
    /// By turn, from 1; a tenant with fewer running jobs goes before one with more. Null unless queued.
    #[schema(required)]
    queue_position: Option<u64>,
    /// Runs begun. More than 1 when the server stopped during a run.
    attempt: u32,
    /// Whether the client asked to stop it.
    cancel_requested: bool,
    /// When it was accepted, RFC 3339.
    #[schema(format = DateTime)]
    created_at: String,
    /// When its last run began, RFC 3339.
    #[schema(required, format = DateTime)]
    started_at: Option<String>,
    /// When it ended, RFC 3339.
    #[schema(required, format = DateTime)]
    ended_at: Option<String>,
    /// Why it failed; null unless failed. Codes: of the file `truncated`, `corrupt_gzip`, `bad_checksum`,
    /// `trailing_data`, `decompressed_too_large`, `wrong_byte_order`, `bad_number`, `not_a_label_map`,
    /// `too_many_labels`, `too_many_layers`; of its labels
    /// `empty_mask`, `label_missing`, `label_is_background`, `intensity_image`; of the shapes, when none has a medial
    /// sheet, `too_thin`, `too_small`, `fragment`, `shape_is_a_ball`, `shape_is_a_tube`, `shape_is_no_tube`, `not_orientable`, `hollow_object`,
    /// `sheet_has_holes`, `too_many_points`, `neighborhood_too_large`, `no_embedding`, `working_grid_too_large`; of the run
    /// `run_too_long`, `needs_too_much_memory`, `needs_too_much_time`, `run_crashed`, `too_many_attempts`, `storage_full`, `mask_damaged`, `internal`.
    #[schema(required)]
    error: Option<Problem>,
    /// What a reader of the results should know.
    warnings: Vec<JobWarning>,
    /// The files it left; empty unless succeeded.
    results: Vec<ResultView>,
    /// Parameters as sent.
    #[schema(value_type = ParamsSchema)]
    params: Box<RawValue>,
    /// What was uploaded.
    mask: MaskInfo,
    /// Whether the mask is erased: then the job cannot be run again.
    mask_erased: bool,
    /// Whether the results were erased before the job: then they cannot be fetched any more.
    results_erased: bool,
    /// Whether the results are those of an equal request that came before.
    reused: bool,
    /// The client's own labels.
    labels: BTreeMap<String, String>,
    /// Whom to tell of the end; null unless asked for.
    #[schema(required)]
    callback: Option<CallbackView>,
    /// The PACS that its DICOM results go to, and how far that is; null unless asked for.
    #[schema(required)]
    delivery: Option<DeliveryView>,
    /// Trace of the request that sent it; the log's lines about the job have it too.
    trace_id: String,
    /// Where to go from here.
    links: Links,
}

/// Whom to tell of the end of a job, and whether that was done.
#[derive(Debug, Serialize, utoipa::ToSchema)]
#[schema(as = Callback)]
pub struct CallbackView {
    /// Where to.
    #[schema(format = "uri")]
    url: String,
    /// Where it stands.
    state: SendState,
    /// All tries, oldest first.
    deliveries: Vec<SendTry>,
}

impl From<Callback> for CallbackView {
    fn from(callback: Callback) -> Self {
        Self { url: callback.url, state: callback.state, deliveries: callback.log }
    }
}

/// DICOM results that go to a PACS.
#[derive(Debug, Serialize, utoipa::ToSchema)]
#[schema(as = Delivery)]
pub struct DeliveryView {
    /// The PACS, by the name that the operator gave it.
    to: String,
    /// Where it stands. `waiting`: the job has not succeeded; `due`: they are sent, or sent again; `delivered`: the PACS
    /// has all; `given_up`: it has those of `stored`, and no more are sent.
    state: SendState,
    /// Names of the results that the PACS has.
    stored: Vec<String>,
    /// Tries so far.
    tries: u32,
    /// When it is tried next, RFC 3339; while it is sent, when that would count as broken off. Null unless due.
    #[schema(required, format = DateTime)]
    next_try_at: Option<String>,
    /// The last try; null before the first. Errors: `connect_failed`, `timed_out`, `tls_failed`, `interrupted`,
    /// `redirected`, `refused_status`, `answer_unclear`, `instance_refused`, `class_not_supported`, `results_erased`,
    /// `result_damaged`, `no_such_result`, `storage`.
    #[schema(required)]
    last_try: Option<SendTry>,
}

impl From<Delivery> for DeliveryView {
    fn from(delivery: Delivery) -> Self {
        let Delivery { to, state, stored, tries, next_try_at, last_try } = delivery;
        Self { to, state, stored, tries, next_try_at: next_try_at.map(|time| time.to_string()), last_try }
    }
}

/// How far a run is.
#[derive(Clone, Debug, PartialEq, Serialize, utoipa::ToSchema)]
#[schema(as = Progress)]
pub struct ProgressView {
    /// The stage: read, mask, distance, skeleton, sheets, sides, isomap, lattice, spokes, quality.
    stage: &'static str,
    /// Share of the whole run, 0 to 1.
    #[schema(minimum = 0, maximum = 1)]
    fraction: f64,
    /// The structure worked on, from 0.
    structure: usize,
    /// Structures in all, 0 while the file is read.
    structures: usize,
}

/// A file that a job left.
#[derive(Debug, Serialize, utoipa::ToSchema)]
#[schema(as = Result)]
pub struct ResultView {
    /// File name.
    name: String,
    /// Where to get it.
    href: String,
    /// Media type.
    media_type: String,
    /// Size.
    bytes: u64,
    /// SHA-256 of the content, lower-case hex; also its ETag.
    sha256: String,
}

/// Where to go from a job.
#[derive(Debug, Serialize, utoipa::ToSchema)]
pub struct Links {
    /// The job: GET, DELETE.
    #[serde(rename = "self")]
    itself: String,
    /// What happens to it, as server-sent events.
    events: String,
    /// POST here to stop it; null once it has ended.
    #[schema(required)]
    cancel: Option<String>,
    /// POST here to run it again, where it failed or was canceled and its mask is still there; or to deliver its results
    /// again, where that was given up and they are still there. Else null.
    #[schema(required)]
    retry: Option<String>,
}

/// Jobs, newest first.
#[derive(Debug, Serialize, utoipa::ToSchema)]
pub struct JobList {
    /// The jobs.
    jobs: Vec<JobView>,
    /// Give this as `cursor` for the next page; null on the last.
    #[schema(required)]
    next_cursor: Option<String>,
}

impl JobList {
    /// A page, with whether more follow it.
    pub fn new(page: Vec<JobStatus>, has_more: bool) -> Self {
        let last = page.last().filter(|_| has_more);
        Self {
            next_cursor: last.map(|status| status.job.id.to_string()),
            jobs: page.into_iter().map(Into::into).collect(),
        }
    }

    /// The cursor of the next page.
    pub fn next_cursor(&self) -> Option<&str> {
        self.next_cursor.as_deref()
    }
}

impl JobView {
    /// The path of the job.
    pub fn path(&self) -> &str {
        &self.links.itself
    }
}

/// The path of a job.
pub fn path_of(id: JobId) -> String {
    format!("/v1/jobs/{id}")
}

impl From<JobStatus> for JobView {
    fn from(status: JobStatus) -> Self {
        let JobStatus { job, progress, queue_position } = status;
        let Job { id, state, attempt, cancel_requested, .. } = job;
        let itself = path_of(id);
        let cancel = state.after(Cause::Cancel).map(|_| format!("{itself}/cancel"));
        let is_retryable = state.after(Cause::Retry).is_some() && job.is_mask_kept;
        let is_given_up = job.delivery.as_ref().is_some_and(|delivery| delivery.state == SendState::GivenUp);
        let retry = (is_retryable || is_given_up && job.are_results_kept).then(|| format!("{itself}/retry"));
        let results = job.artifacts().cloned().map(|file| result_view(&itself, file)).collect();
        Self {
            id: id.to_string(),
            state,
            progress: progress.map(Into::into),
            queue_position,
            attempt,
            cancel_requested,
            created_at: job.created_at.to_string(),
            started_at: job.started_at.map(|time| time.to_string()),
            ended_at: job.ended_at.map(|time| time.to_string()),
            error: job.error,
            warnings: job.warnings,
            results,
            params: RawValue::from_string(job.params_json).unwrap_or_default(),
            mask: job.mask,
            mask_erased: !job.is_mask_kept,
            results_erased: !job.are_results_kept,
            reused: job.reused,
            labels: job.labels,
            callback: job.callback.map(Into::into),
            delivery: job.delivery.map(Into::into),
            trace_id: job.trace_id,
            links: Links { events: format!("{itself}/events"), itself, cancel, retry },
        }
    }
}

impl From<Progress> for ProgressView {
    fn from(progress: Progress) -> Self {
        Self {
            stage: progress.stage.map_or("read", |stage| stage.name()),
            fraction: progress.fraction,
            structure: progress.structure,
            structures: progress.structures,
        }
    }
}

fn result_view(job: &str, file: ResultFile) -> ResultView {
    let ResultFile { name, media_type, bytes, sha256, dicom: _ } = file;
    ResultView { href: format!("{job}/results/{name}"), name, media_type, bytes, sha256 }
}
