//! `/v1/limits`: what is taken in, how much of it, and how long it is kept. Tells only: bodies are held to it by
//! `submit` and `jobs::upload`, jobs by `jobs::limits`.

use std::sync::Arc;
use std::time::Duration;

use axum::Json;
use axum::extract::State;
use serde::Serialize;
use serde_json::Value;

use super::jobs::MAX_WAIT_S;
use super::params_schema::ParamsSchema;
use crate::formats::artifacts::ARTIFACTS;
use crate::formats::readers;
use crate::jobs::service::Jobs;
use crate::params::LABEL_COUNT;

/// Dimensions of a volume that carry the mask; further ones must be 1.
const DIMENSIONS: u32 = 3;

/// What bounds requests.
#[derive(Debug, Serialize, utoipa::ToSchema)]
pub struct Limits {
    /// Files that are taken: told by their first bytes.
    formats: Vec<String>,
    /// Largest upload, bytes as sent.
    max_upload_bytes: u64,
    /// Longest silence during an upload, seconds.
    upload_idle_seconds: u64,
    /// Longest upload, seconds.
    upload_seconds: u64,
    /// Largest volume, voxels.
    max_voxels: u64,
    /// Dimensions of a volume.
    dimensions: u32,
    /// Most labels that `params.labels` may name.
    max_params_labels: usize,
    /// Longest run of a job, seconds.
    max_run_seconds: u64,
    /// Memory of all runs together, bytes; a run that needs more is refused.
    run_memory_bytes: u64,
    /// Processor time of a run, whatever the size of its file, seconds.
    run_cpu_seconds: f64,
    /// Processor time of a run besides, for each kilobyte of its file once that is compressed, seconds.
    run_cpu_seconds_per_kilobyte: f64,
    /// Jobs that may wait.
    max_queued_jobs: u64,
    /// Bytes of masks that may wait.
    max_queued_bytes: u64,
    /// How much of both one tenant may take, percent.
    tenant_share_percent: u8,
    /// Requests of one tenant that may be open.
    max_open_requests: usize,
    /// Longest `wait`, seconds.
    max_wait_seconds: u32,
    /// How long after a job's end what is kept.
    retention: RetentionView,
    /// Names of the results.
    results: Vec<&'static str>,
    /// Whether webhooks are sent.
    webhooks: bool,
    /// Whether masks can be fetched from a PACS.
    pacs: bool,
    /// The parameters as JSON Schema (that of Params), to make a form from: bounds, defaults, descriptions.
    #[schema(value_type = Object)]
    params: Value,
}

/// Seconds after the end of a job; null is for ever.
#[derive(Debug, Serialize, utoipa::ToSchema)]
#[schema(as = Retention)]
pub struct RetentionView {
    /// The job.
    #[schema(required)]
    jobs_seconds: Option<u64>,
    /// Its mask.
    #[schema(required)]
    masks_seconds: Option<u64>,
    /// Its results.
    #[schema(required)]
    results_seconds: Option<u64>,
}

/// What bounds requests, and how long what is kept.
#[utoipa::path(get, path = "/v1/limits", tag = "operation", security(()), responses((status = 200, body = Limits, description = "The limits of this server")))]
pub async fn limits(State(jobs): State<Arc<Jobs>>) -> Json<Limits> {
    let limits = jobs.limits();
    let seconds = |time: Option<Duration>| time.map(|time| time.as_secs());
    let keep = limits.keep;
    Json(Limits {
        formats: readers::versions_with_endings(),
        max_upload_bytes: limits.upload.max_bytes,
        upload_idle_seconds: limits.upload.idle.as_secs(),
        upload_seconds: limits.upload.total.as_secs(),
        max_voxels: limits.input.max_voxels,
        dimensions: DIMENSIONS,
        max_params_labels: *LABEL_COUNT.end(),
        max_run_seconds: limits.max_run.as_secs(),
        run_memory_bytes: limits.run_memory_bytes,
        run_cpu_seconds: limits.run_cpu.least.as_secs_f64(),
        run_cpu_seconds_per_kilobyte: limits.run_cpu.per_kb.as_secs_f64(),
        max_queued_jobs: limits.queue.jobs,
        max_queued_bytes: limits.queue.bytes,
        tenant_share_percent: limits.queue.share_percent,
        max_open_requests: limits.max_requests,
        max_wait_seconds: MAX_WAIT_S,
        retention: RetentionView {
            jobs_seconds: seconds(keep.jobs),
            masks_seconds: seconds(keep.masks),
            results_seconds: seconds(keep.results),
        },
        results: ARTIFACTS.iter().map(|artifact| artifact.name).collect(),
        webhooks: jobs.webhooks().is_some(),
        pacs: jobs.has_pacs(),
        params: ParamsSchema::json(),
    })
}
