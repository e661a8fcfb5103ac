//! `/v1/jobs`.

use std::sync::Arc;

use axum::Json;
use axum::extract::{Request, State};
use axum::http::header::{LINK, LOCATION, RETRY_AFTER};
use axum::http::{HeaderMap, HeaderValue, StatusCode};
use axum::response::IntoResponse;
use serde::Deserialize;
use utoipa::IntoParams;

use super::error::{ApiError, PROBLEM_JSON};
use super::extract::{JobPath, StrictQuery};
use super::params_schema::{BytesSchema, FormSchema, ParamsQuery};
use super::submit;
use super::view::{JobList, JobView};
use crate::jobs::job::{JobId, JobState};
use crate::jobs::queue::Jobs;
use crate::jobs::store::ListQuery;
use crate::problem::Problem;

/// Most jobs on one page.
const MAX_PAGE: u32 = 200;
/// Jobs on a page when nothing is said.
const PAGE: u32 = 20;

/// Send a mask.
///
/// The mask is the body as it lies on disk (.nii or .nii.gz, told by its first bytes, never by a
/// header), or the field `mask` of a form. The answer comes once the job is on disk: it survives
/// the loss of power.
#[utoipa::path(
    post, path = "/v1/jobs", tag = "jobs",
    params(ParamsQuery),
    request_body(content(
        (inline(BytesSchema) = "application/octet-stream"),
        (inline(BytesSchema) = "application/gzip"),
        (FormSchema = "multipart/form-data")
    )),
    responses(
        (status = 202, body = JobView, description = "The job, on disk", headers(
            ("Location" = String, description = "The job"),
            ("Retry-After" = u32, description = "Seconds until it is worth a look")
        )),
        (status = 400, body = Problem, content_type = PROBLEM_JSON, description = "`empty_upload`, `upload_interrupted`, `invalid_multipart`, `invalid_query`, `malformed_params`, and what is malformed in the file's header"),
        (status = 408, body = Problem, content_type = PROBLEM_JSON, description = "`upload_too_slow`"),
        (status = 413, body = Problem, content_type = PROBLEM_JSON, description = "`upload_too_large`, `too_many_voxels`"),
        (status = 415, body = Problem, content_type = PROBLEM_JSON, description = "`not_nifti`, `two_file_nifti`, `content_encoding`"),
        (status = 422, body = Problem, content_type = PROBLEM_JSON, description = "`invalid_params`, and what in the file's header cannot be worked on"),
        (status = 503, body = Problem, content_type = PROBLEM_JSON, description = "`queue_full`; Retry-After says when to try again"),
        (status = 507, body = Problem, content_type = PROBLEM_JSON, description = "`storage_full`")
    )
)]
pub async fn submit(
    State(jobs): State<Arc<Jobs>>,
    StrictQuery(query): StrictQuery<ParamsQuery>,
    request: Request,
) -> Result<impl IntoResponse, ApiError> {
    let submission = submit::receive(&jobs, query.params.as_deref(), request).await?;
    let job = JobView::from(jobs.submit(submission.mask, &submission.params).await?);
    let location = HeaderValue::from_str(job.path()).map_err(|_| Problem::internal())?;
    let headers = [(LOCATION, location), (RETRY_AFTER, HeaderValue::from_static("1"))];
    Ok((StatusCode::ACCEPTED, headers, Json(job)))
}

/// Which jobs to list.
#[derive(Debug, Deserialize, IntoParams)]
#[serde(deny_unknown_fields)]
#[into_params(parameter_in = Query)]
pub struct ListParams {
    /// Only those in this state.
    #[param(inline)]
    state: Option<JobState>,
    /// Jobs per page, at most 200.
    #[param(minimum = 1, maximum = 200, default = 20)]
    limit: Option<u32>,
    /// `next_cursor` of the page before.
    cursor: Option<String>,
}

/// List jobs, newest first.
#[utoipa::path(
    get, path = "/v1/jobs", tag = "jobs",
    params(ListParams),
    responses(
        (status = 200, body = JobList, description = "A page of jobs", headers(("Link" = String, description = "`rel=\"next\"` when there are more"))),
        (status = 400, body = Problem, content_type = PROBLEM_JSON, description = "`invalid_query`")
    )
)]
pub async fn list(
    State(jobs): State<Arc<Jobs>>,
    StrictQuery(params): StrictQuery<ListParams>,
) -> Result<impl IntoResponse, ApiError> {
    let limit = params.page_size()?;
    let query = ListQuery { state: params.state, before: params.before()?, limit: limit + 1 };
    let mut page = jobs.list(query).await?;
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

    fn before(&self) -> Result<Option<JobId>, ApiError> {
        let Some(cursor) = &self.cursor else { return Ok(None) };
        let problem = || Problem::new(400, "invalid_query", "the cursor is none that this server gave");
        JobId::parse(cursor).map(Some).ok_or_else(|| problem().at("query.cursor").into())
    }
}

fn next_link(list: &JobList, params: &ListParams) -> HeaderMap {
    let link = list.next_cursor().and_then(|cursor| {
        let state = params.state.map(|state| format!("&state={}", state.name())).unwrap_or_default();
        let limit = params.limit.unwrap_or(PAGE);
        HeaderValue::from_str(&format!("</v1/jobs?cursor={cursor}&limit={limit}{state}>; rel=\"next\"")).ok()
    });
    link.into_iter().map(|link| (LINK, link)).collect()
}

/// One job: its state, progress, error, warnings and results.
#[utoipa::path(
    get, path = "/v1/jobs/{id}", tag = "jobs",
    params(("id" = String, Path, description = "The job's id")),
    responses(
        (status = 200, body = JobView, description = "The job"),
        (status = 404, body = Problem, content_type = PROBLEM_JSON, description = "`no_such_job`")
    )
)]
pub async fn status(State(jobs): State<Arc<Jobs>>, JobPath(id): JobPath) -> Result<Json<JobView>, ApiError> {
    Ok(Json(jobs.status(id).await?.into()))
}

/// Forget a job and erase its mask and results. One that runs is stopped first.
#[utoipa::path(
    delete, path = "/v1/jobs/{id}", tag = "jobs",
    params(("id" = String, Path, description = "The job's id")),
    responses(
        (status = 204, description = "Nothing of it is left"),
        (status = 404, body = Problem, content_type = PROBLEM_JSON, description = "`no_such_job`")
    )
)]
pub async fn delete(State(jobs): State<Arc<Jobs>>, JobPath(id): JobPath) -> Result<StatusCode, ApiError> {
    jobs.delete(id).await?;
    Ok(StatusCode::NO_CONTENT)
}

/// Stop a job. One that waits ends at once, one that runs at its next slice of work.
#[utoipa::path(
    post, path = "/v1/jobs/{id}/cancel", tag = "jobs",
    params(("id" = String, Path, description = "The job's id")),
    responses(
        (status = 202, body = JobView, description = "The job, canceled or about to be"),
        (status = 404, body = Problem, content_type = PROBLEM_JSON, description = "`no_such_job`"),
        (status = 409, body = Problem, content_type = PROBLEM_JSON, description = "`job_ended`")
    )
)]
pub async fn cancel(State(jobs): State<Arc<Jobs>>, JobPath(id): JobPath) -> Result<impl IntoResponse, ApiError> {
    let status = jobs.cancel(id).await?;
    Ok((StatusCode::ACCEPTED, Json(JobView::from(status))))
}
