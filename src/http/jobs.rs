//! `/v1/jobs`.

use std::sync::Arc;
use std::time::Duration;

use axum::Json;
use axum::extract::{Request, State};
use axum::http::header::{CONTENT_TYPE, ETAG, LINK, LOCATION, RETRY_AFTER};
use axum::http::{HeaderMap, HeaderName, HeaderValue, StatusCode};
use axum::response::{IntoResponse, Response};
use serde::Deserialize;
use sha2::{Digest, Sha256};
use utoipa::IntoParams;

use super::auth::{Allowed, Read, TokenProblems, TooManyRequests, Write};
use super::error::{ApiError, NoSuchJob, PROBLEM_JSON};
use super::extract::{IdParam, JobPath, StrictQuery, has_it, list_header};
use super::params_schema::{BytesSchema, FormSchema, SourceSchema, SubmitQuery};
use super::submit;
use super::view::{JobList, JobView};
use crate::formats::hex;
use crate::jobs::job::{JobId, JobState};
use crate::jobs::service::Jobs;
use crate::jobs::store::ListQuery;
use crate::problem::Problem;

/// Most jobs on one page.
const MAX_PAGE: u32 = 200;
/// Jobs on a page when nothing is said.
const PAGE: u32 = 20;
/// Longest wait for the end of a job, seconds. Proxies cut off what is silent for a minute.
pub const MAX_WAIT_S: u32 = 50;

const PREFER: HeaderName = HeaderName::from_static("prefer");
const PREFERENCE_APPLIED: HeaderName = HeaderName::from_static("preference-applied");
const IDEMPOTENT_REPLAYED: HeaderName = HeaderName::from_static("idempotent-replayed");

/// Send a mask.
///
/// The mask is the body as it lies on disk (.nii or .nii.gz, told by its first bytes, never by a
/// header), or the field `mask` of a form, or an instance of a PACS that a JSON body names. The answer comes once the job is on disk: it survives
/// the loss of power. A mask and parameters that were worked on before are answered with a job that
/// has succeeded already (`reused`), unless `Cache-Control: no-cache` is sent.
#[utoipa::path(
    post, path = "/v1/jobs", tag = "jobs",
    params(
        SubmitQuery,
        ("Idempotency-Key" = Option<String>, Header, description = "Names this request: sent again, it gives the same job. Kept as long as the job", min_length = 1, max_length = 255),
        ("Prefer" = Option<String>, Header, description = "`wait=N`: answer once the job has ended, after N seconds (50) at the latest", example = "wait=10"),
        ("Cache-Control" = Option<String>, Header, description = "`no-cache`: compute again what was computed before")
    ),
    request_body(content(
        (inline(BytesSchema) = "application/octet-stream"),
        (inline(BytesSchema) = "application/gzip"),
        (FormSchema = "multipart/form-data"),
        (SourceSchema = "application/json")
    )),
    responses(
        (status = 200, body = JobView, description = "The job, which has ended: it was waited for", headers(
            ("Location" = String, description = "The job"),
            ("Preference-Applied" = String, description = "`wait=N`")
        )),
        (status = 202, body = JobView, description = "The job, on disk", headers(
            ("Location" = String, description = "The job"),
            ("Retry-After" = u32, description = "Seconds until it is worth a look"),
            ("Idempotent-Replayed" = String, description = "`true` when the key was known")
        )),
        (status = 400, body = Problem, content_type = PROBLEM_JSON, description = "`empty_upload`, `upload_interrupted`, `invalid_multipart`, `invalid_query`, `invalid_idempotency_key`, `invalid_submission`, `malformed_params`; of the file `truncated`, `corrupt_gzip`, `bad_dimensions`, `bad_header_field`, `bad_header_line`, `missing_header_line`"),
        TokenProblems,
        (status = 408, body = Problem, content_type = PROBLEM_JSON, description = "`upload_too_slow`"),
        (status = 413, body = Problem, content_type = PROBLEM_JSON, description = "`upload_too_large`, `source_too_large`, `too_many_voxels`"),
        (status = 415, body = Problem, content_type = PROBLEM_JSON, description = "`not_nifti`, `two_file_nifti`, `detached_header`, `content_encoding`"),
        (status = 422, body = Problem, content_type = PROBLEM_JSON, description = "`invalid_params`, `invalid_labels`, `callback_not_allowed`, `idempotency_key_reused`, `unknown_pacs`, `nothing_to_deliver`; of a source `unknown_pacs`, `invalid_uid`, `source_not_found`, `source_is_ambiguous`, `source_has_no_segmentation`; of the file `several_volumes`, `unsupported_datatype`, `unsupported_header`, `bad_affine`, `unsupported_transfer_syntax`, `not_a_segmentation`, `uneven_slices` and others of DICOM"),
        (status = 429, body = Problem, content_type = PROBLEM_JSON, description = "`queue_share_full`, `too_many_requests`; Retry-After says when to try again"),
        (status = 502, body = Problem, content_type = PROBLEM_JSON, description = "`source_refused`, `source_malformed`"),
        (status = 503, body = Problem, content_type = PROBLEM_JSON, description = "`queue_full`, `source_unavailable`; Retry-After says when to try again"),
        (status = 507, body = Problem, content_type = PROBLEM_JSON, description = "`storage_full`, `storage_low`, `storage_share_full`")
    )
)]
pub async fn submit(
    State(jobs): State<Arc<Jobs>>,
    allowed: Allowed<Write>,
    StrictQuery(query): StrictQuery<SubmitQuery>,
    request: Request,
) -> Result<Response, ApiError> {
    let wait = preferred_wait(&list_header(request.headers(), PREFER));
    let submission = submit::receive(&jobs, &allowed.caller, query, request).await?;
    let accepted = jobs.submit(&allowed.caller, submission).await?;
    let mut status = accepted.status;
    if let Some(seconds) = wait {
        let patience = Duration::from_secs(seconds.into());
        status = jobs.status_at_end(&allowed.caller, status.job.id, patience).await?;
    }
    let is_answer = wait.is_some() && status.job.state.has_ended();
    let code = if is_answer { StatusCode::OK } else { StatusCode::ACCEPTED };
    let job = JobView::from(status);
    let mut headers = HeaderMap::new();
    headers.insert(LOCATION, HeaderValue::from_str(job.path()).map_err(|_| Problem::internal())?);
    if !is_answer {
        headers.insert(RETRY_AFTER, HeaderValue::from_static("1"));
    }
    if let Some(seconds) = wait {
        let applied = HeaderValue::from_str(&format!("wait={seconds}")).map_err(|_| Problem::internal())?;
        headers.insert(PREFERENCE_APPLIED, applied);
    }
    if accepted.is_replay {
        headers.insert(IDEMPOTENT_REPLAYED, HeaderValue::from_static("true"));
    }
    Ok((code, headers, Json(job)).into_response())
}

/// Seconds of `wait=N` (RFC 7240), at most as many as this service waits.
fn preferred_wait(prefer: &str) -> Option<u32> {
    let mut preferences = prefer.split([',', ';']).filter_map(|one| one.split_once('='));
    let (_, wait) = preferences.find(|(name, _)| name.trim().eq_ignore_ascii_case("wait"))?;
    wait.trim().trim_matches('"').parse::<u32>().ok().map(|seconds| seconds.min(MAX_WAIT_S))
}

/// Which jobs to list.
#[derive(Debug, Deserialize, IntoParams)]
#[serde(deny_unknown_fields)]
#[into_params(parameter_in = Query)]
pub struct ListParams {
    /// Only those in this state.
    #[param(inline)]
    state: Option<JobState>,
    /// Only those with this label, `name:value`.
    #[param(example = "study:liver-07", pattern = "^[A-Za-z0-9._-]+:.*$")]
    label: Option<String>,
    /// Jobs per page, at most 200.
    #[param(minimum = 1, maximum = 200, default = 20)]
    limit: Option<u32>,
    /// `next_cursor` of the page before.
    #[param(format = "uuid")]
    cursor: Option<String>,
}

/// List the caller's jobs, newest first.
#[utoipa::path(
    get, path = "/v1/jobs", tag = "jobs",
    params(ListParams),
    responses(
        (status = 200, body = JobList, description = "A page of jobs", headers(("Link" = String, description = "`rel=\"next\"` when there are more"))),
        (status = 400, body = Problem, content_type = PROBLEM_JSON, description = "`invalid_query`"),
        TokenProblems,
        TooManyRequests
    )
)]
pub async fn list(
    State(jobs): State<Arc<Jobs>>,
    allowed: Allowed<Read>,
    StrictQuery(params): StrictQuery<ListParams>,
) -> Result<impl IntoResponse, ApiError> {
    let limit = params.page_size()?;
    let query = ListQuery {
        owner: allowed.caller.tenant.clone(),
        state: params.state,
        label: params.label()?,
        before: params.before()?,
        limit: limit + 1,
    };
    let mut page = jobs.list(&query).await?;
    let has_more = page.len() > limit as usize;
    page.truncate(limit as usize);
    let list = JobList::new(page, has_more);
    Ok((next_link(&list, &params), Json(list)))
}

impl ListParams {
    fn page_size(&self) -> Result<u32, ApiError> {
        let limit = self.limit.unwrap_or(PAGE);
        if (1..=MAX_PAGE).contains(&limit) {
            return Ok(limit);
        }
        let detail = format!("limit is {limit}, allowed are 1 to {MAX_PAGE}");
        Err(Problem::new(400, "invalid_query", detail).at("query.limit").into())
    }

    fn label(&self) -> Result<Option<(String, String)>, ApiError> {
        let Some(label) = &self.label else { return Ok(None) };
        let (name, value) = label.split_once(':').ok_or_else(|| {
            let problem = Problem::new(400, "invalid_query", "the label has no colon").at("query.label");
            problem.hint("name and value are separated by a colon: study:liver-07")
        })?;
        Ok(Some((name.to_owned(), value.to_owned())))
    }

    fn before(&self) -> Result<Option<JobId>, ApiError> {
        let Some(cursor) = &self.cursor else { return Ok(None) };
        let problem = || Problem::new(400, "invalid_query", "the cursor is none that this server gave");
        JobId::parse(cursor).map(Some).ok_or_else(|| problem().at("query.cursor").into())
    }
}

fn next_link(list: &JobList, params: &ListParams) -> HeaderMap {
    let mut headers = HeaderMap::new();
    let Some(cursor) = list.next_cursor() else { return headers };
    let mut query = form_urlencoded::Serializer::new(String::new());
    query.append_pair("cursor", cursor).append_pair("limit", &params.limit.unwrap_or(PAGE).to_string());
    if let Some(state) = params.state {
        query.append_pair("state", state.name());
    }
    if let Some(label) = &params.label {
        query.append_pair("label", label);
    }
    if let Ok(link) = HeaderValue::from_str(&format!("</v1/jobs?{}>; rel=\"next\"", query.finish())) {
        headers.insert(LINK, link);
    }
    headers
}

/// How a status is asked for.
#[derive(Debug, Deserialize, IntoParams)]
#[serde(deny_unknown_fields)]
#[into_params(parameter_in = Query)]
pub struct StatusQuery {
    /// Answer once the job has ended, after this many seconds at the latest.
    #[param(minimum = 0, maximum = 50, default = 0)]
    wait: Option<u32>,
}

/// One job: its state, progress, error, warnings and results.
#[utoipa::path(
    get, path = "/v1/jobs/{id}", tag = "jobs",
    params(
        IdParam,
        StatusQuery,
        ("If-None-Match" = Option<String>, Header, description = "An ETag that the client has")
    ),
    responses(
        (status = 200, body = JobView, description = "The job", headers(("ETag" = String, description = "Changes with the answer"))),
        (status = 304, description = "Nothing has changed since the ETag"),
        (status = 400, body = Problem, content_type = PROBLEM_JSON, description = "`invalid_query`"),
        TokenProblems,
        TooManyRequests,
        NoSuchJob
    )
)]
pub async fn status(
    State(jobs): State<Arc<Jobs>>,
    allowed: Allowed<Read>,
    JobPath(id): JobPath,
    StrictQuery(query): StrictQuery<StatusQuery>,
    headers: HeaderMap,
) -> Result<Response, ApiError> {
    let seconds = query.wait.unwrap_or(0);
    if seconds > MAX_WAIT_S {
        let detail = format!("wait is {seconds}, allowed are 0 to {MAX_WAIT_S} seconds");
        return Err(Problem::new(400, "invalid_query", detail).at("query.wait").into());
    }
    let status = jobs.status_at_end(&allowed.caller, id, Duration::from_secs(seconds.into())).await?;
    // A few kilobytes: hashed in microseconds.
    let body = serde_json::to_vec(&JobView::from(status)).map_err(|_| Problem::internal())?;
    let etag = format!("\"{}\"", hex(&Sha256::digest(&body)[..16]));
    let tag = [(ETAG, HeaderValue::from_str(&etag).map_err(|_| Problem::internal())?)];
    if has_it(&headers, &etag) {
        return Ok((StatusCode::NOT_MODIFIED, tag).into_response());
    }
    Ok((tag, [(CONTENT_TYPE, "application/json")], body).into_response())
}

/// Forget a job and erase its mask and results. One that runs is stopped first.
#[utoipa::path(
    delete, path = "/v1/jobs/{id}", tag = "jobs",
    params(IdParam),
    responses(
        (status = 204, description = "Nothing of it is left"),
        TokenProblems,
        TooManyRequests,
        NoSuchJob
    )
)]
pub async fn delete(
    State(jobs): State<Arc<Jobs>>,
    allowed: Allowed<Write>,
    JobPath(id): JobPath,
) -> Result<StatusCode, ApiError> {
    jobs.delete(&allowed.caller, id).await?;
    Ok(StatusCode::NO_CONTENT)
}

/// Stop a job. One that waits ends at once, one that runs within a second.
#[utoipa::path(
    post, path = "/v1/jobs/{id}/cancel", tag = "jobs",
    params(IdParam),
    responses(
        (status = 202, body = JobView, description = "The job, canceled or about to be"),
        TokenProblems,
        TooManyRequests,
        NoSuchJob,
        (status = 409, body = Problem, content_type = PROBLEM_JSON, description = "`job_ended`")
    )
)]
pub async fn cancel(
    State(jobs): State<Arc<Jobs>>,
    allowed: Allowed<Write>,
    JobPath(id): JobPath,
) -> Result<impl IntoResponse, ApiError> {
    let status = jobs.cancel(&allowed.caller, id).await?;
    Ok((StatusCode::ACCEPTED, Json(JobView::from(status))))
}

/// Run a failed or canceled job again.
///
/// Of one that has succeeded, deliver the results again where that was given up.
#[utoipa::path(
    post, path = "/v1/jobs/{id}/retry", tag = "jobs",
    params(IdParam),
    responses(
        (status = 202, body = JobView, description = "The job, waiting again, or its delivery due again"),
        TokenProblems,
        NoSuchJob,
        (status = 409, body = Problem, content_type = PROBLEM_JSON, description = "`not_retryable`, `mask_erased`"),
        (status = 429, body = Problem, content_type = PROBLEM_JSON, description = "`queue_share_full`, `too_many_requests`"),
        (status = 503, body = Problem, content_type = PROBLEM_JSON, description = "`queue_full`")
    )
)]
pub async fn retry(
    State(jobs): State<Arc<Jobs>>,
    allowed: Allowed<Write>,
    JobPath(id): JobPath,
) -> Result<impl IntoResponse, ApiError> {
    let status = jobs.retry(&allowed.caller, id).await?;
    Ok((StatusCode::ACCEPTED, Json(JobView::from(status))))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_preference_to_wait_is_found_and_bounded() {
        for (prefer, seconds) in [
            ("wait=10", Some(10)),
            ("respond-async, wait=5", Some(5)),
            ("wait=\"7\"", Some(7)),
            ("wait=9999", Some(MAX_WAIT_S)),
            ("respond-async", None),
            ("wait=soon", None),
        ] {
            assert_eq!(preferred_wait(prefer), seconds, "{prefer}");
        }
    }
}
