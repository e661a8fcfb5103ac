//! Every error as `application/problem+json`, with its status: the one place that knows both.

use std::any::Any;
use std::io;

use axum::body::Body;
use axum::http::header::{CONTENT_TYPE, RETRY_AFTER, WWW_AUTHENTICATE};
use axum::http::{HeaderValue, Method, Response, StatusCode, Uri};
use axum::response::IntoResponse;

use super::trace;
use crate::dicomweb::FetchError;
use crate::formats::params_json::ParamsJsonError;
use crate::jobs::error::JobsError;
use crate::jobs::job::JobState;
use crate::jobs::source::SourceError;
use crate::jobs::store::StoreError;
use crate::jobs::upload::UploadError;
use crate::problem::Problem;

/// Media type of a problem object.
pub const PROBLEM_JSON: &str = "application/problem+json";
/// When to try again after the queue was full, seconds.
const RETRY_AFTER_S: u32 = 5;

/// A problem as an answer.
#[derive(Debug)]
pub struct ApiError(Box<Problem>);

impl From<Problem> for ApiError {
    fn from(problem: Problem) -> Self {
        Self(Box::new(problem))
    }
}

impl ApiError {
    /// What is told.
    pub fn problem(&self) -> &Problem {
        &self.0
    }
}

impl IntoResponse for ApiError {
    fn into_response(mut self) -> Response<Body> {
        self.0.trace_id = trace::current();
        let status = StatusCode::from_u16(self.0.status).unwrap_or(StatusCode::INTERNAL_SERVER_ERROR);
        let is_retryable = self.0.retryable;
        let mut response = (status, axum::Json(*self.0)).into_response();
        let headers = response.headers_mut();
        headers.insert(CONTENT_TYPE, HeaderValue::from_static(PROBLEM_JSON));
        if is_retryable {
            headers.insert(RETRY_AFTER, RETRY_AFTER_S.into());
        }
        if status == StatusCode::UNAUTHORIZED {
            headers.insert(WWW_AUTHENTICATE, HeaderValue::from_static("Bearer"));
        }
        response
    }
}

impl From<JobsError> for ApiError {
    fn from(error: JobsError) -> Self {
        match error {
            JobsError::NotFound => no_such_job(),
            JobsError::NoSuchResult { state } => no_such_result(state),
            JobsError::ResultsErased => {
                Problem::new(410, "results_erased", "the results were kept long enough and erased")
                    .hint("send the mask again; GET /v1/limits says how long results are kept")
                    .into()
            }
            JobsError::ResultDamaged => Problem::new(500, "result_damaged", "the stored result is not what was made")
                .hint("send the mask again with Cache-Control: no-cache")
                .into(),
            JobsError::AlreadyEnded(state) => {
                let detail = format!("the job has {}", state.name());
                Problem::new(409, "job_ended", detail).hint("delete it to erase its mask and results").into()
            }
            JobsError::NotRetryable(state) => {
                let detail = format!("only failed and canceled jobs can be run again; this one is {}", state.name());
                Problem::new(409, "not_retryable", detail).into()
            }
            JobsError::MaskErased => Problem::new(409, "mask_erased", "the mask of this job is erased")
                .hint("send it again as a new job")
                .into(),
            JobsError::Refused(problem) => Self(problem),
            other => no_room(other),
        }
    }
}

/// What may be better later, and what is our fault.
fn no_room(error: JobsError) -> ApiError {
    match error {
        JobsError::Store(StoreError::QueueFull) => busy("queue_full", "as many jobs wait as this server lets wait"),
        JobsError::Store(StoreError::ShareFull) => {
            Problem::new(429, "queue_share_full", "as many jobs of this tenant wait as it may have waiting")
                .hint("send it again after the time in Retry-After")
                .into()
        }
        JobsError::Store(StoreError::KeyReused) => {
            Problem::new(422, "idempotency_key_reused", "this key was used for another request")
                .at("header Idempotency-Key")
                .hint("use a new key for every new request")
                .into()
        }
        JobsError::StorageLow => storage_low(),
        JobsError::Store(StoreError::StorageShareFull) => {
            Problem::new(507, "storage_share_full", "as much is kept of this tenant's masks and results as may be")
                .hint("delete jobs, or wait until results are erased")
                .into()
        }
        JobsError::Store(StoreError::Full) => Problem::storage_full().into(),
        JobsError::Store(error @ StoreError::Unavailable(_)) => {
            tracing::error!(%error, "request put off");
            busy("store_unavailable", "the server's database cannot be used at the moment")
        }
        JobsError::Files(error) => files_failed(&error),
        other => internal(&other),
    }
}

fn busy(code: &str, detail: &str) -> ApiError {
    Problem::new(503, code, detail).hint("send it again after the time in Retry-After").into()
}

fn storage_low() -> ApiError {
    Problem::new(507, "storage_low", "the server's disk is nearly full").hint("delete jobs, or try later").into()
}

impl From<UploadError> for ApiError {
    fn from(error: UploadError) -> Self {
        match error {
            UploadError::Empty => {
                Problem::new(400, "empty_upload", "the upload has no bytes").hint("send the mask as the body").into()
            }
            UploadError::TooLarge { limit } => too_large(limit),
            UploadError::Refused(problem) => Self(problem),
            UploadError::Interrupted => {
                Problem::new(400, "upload_interrupted", "the upload ended early or its framing is malformed")
                    .hint("send it again")
                    .into()
            }
            UploadError::TooSlow => Problem::new(408, "upload_too_slow", "the upload paused or took too long")
                .hint("send it again over a faster line, or compressed (.nii.gz)")
                .into(),
            UploadError::StorageLow => storage_low(),
            UploadError::Storage(error) => files_failed(&error),
        }
    }
}

impl From<SourceError> for ApiError {
    fn from(error: SourceError) -> Self {
        let detail = error.to_string();
        let problem = match error {
            SourceError::Upload(error) => return error.into(),
            SourceError::UnknownServer { known } => return unknown_pacs(&known, "source.dicomweb.server"),
            SourceError::Fetch(error) => fetch_failed(error, detail),
            SourceError::Busy | SourceError::TooSlow => {
                Problem::new(503, "source_unavailable", detail).hint("send it again after the time in Retry-After")
            }
            SourceError::NoSegmentation { .. } => {
                Problem::new(422, "source_has_no_segmentation", detail).hint("name a series of modality SEG")
            }
            SourceError::Several { .. } => Problem::new(422, "source_is_ambiguous", detail)
                .hint("name the one that is meant in source.dicomweb.instance"),
            SourceError::Wrong(_) => Problem::new(502, "source_malformed", detail)
                .hint("for who runs the PACS to look at: what it sends for this study, series and instance"),
            SourceError::TooLarge { .. } => Problem::new(413, "source_too_large", detail).hint(
                "name the instance in source.dicomweb.instance; if that is too large itself, GET /v1/limits says \
                       how much is taken",
            ),
        };
        problem.at("source.dicomweb").into()
    }
}

/// The status of the archive is told, nothing else that it wrote.
fn fetch_failed(error: FetchError, detail: String) -> Problem {
    match error {
        FetchError::NotFound(_) => Problem::new(422, "source_not_found", detail)
            .hint("check study, series and instance in the PACS; it may also hide what the service may not see"),
        FetchError::Refused(_) | FetchError::Redirected(_) => Problem::new(502, "source_refused", detail)
            .hint("the operator's to look at: URL and credentials of the PACS, and what its account may read"),
        error if error.is_passing() => Problem::new(503, "source_unavailable", detail)
            .hint("send it again after the time in Retry-After; if that does not help, the PACS is to be looked at"),
        FetchError::Unreachable(_) | FetchError::Failed(_) => Problem::new(502, "source_refused", detail)
            .hint("the operator's to look at: the certificate of the PACS, and --pacs-ca-file"),
        FetchError::Malformed(_) => Problem::new(502, "source_malformed", detail)
            .hint("the operator's to look at: the URL is to be that of DICOMweb, below which studies lies"),
    }
}

/// No archive has the name that stands at `place`.
pub fn unknown_pacs(known: &[String], place: &str) -> ApiError {
    let hint = match known {
        [] => "this server asks no PACS: its operator names some with --pacs".to_owned(),
        known => format!("there are {}", known.join(", ")),
    };
    Problem::new(422, "unknown_pacs", "no PACS has this name").at(place).hint(hint).into()
}

impl From<ParamsJsonError> for ApiError {
    fn from(error: ParamsJsonError) -> Self {
        Problem::from(&error).into()
    }
}

/// An upload above the limit.
pub fn too_large(limit_bytes: u64) -> ApiError {
    Problem::new(413, "upload_too_large", format!("the upload is larger than {limit_bytes} bytes"))
        .hint("send it compressed (.nii.gz), or crop it to the labels wanted")
        .into()
}

/// `no_such_job`
#[derive(utoipa::IntoResponses)]
#[response(status = 404, content_type = "application/problem+json")]
#[expect(dead_code, reason = "describes an answer, is none")]
pub struct NoSuchJob(Problem);

/// A job that is not there. Says the same for an id that never was and one that is malformed.
pub fn no_such_job() -> ApiError {
    Problem::new(404, "no_such_job", "there is no job of this id").hint("it may have been deleted").into()
}

fn no_such_result(state: JobState) -> ApiError {
    Problem::new(404, "no_such_result", format!("the job ({}) has no result of this name", state.name()))
        .hint("names are listed under results once the job has succeeded")
        .into()
}

fn files_failed(error: &io::Error) -> ApiError {
    tracing::error!(%error, "a file cannot be read or written");
    Problem::of_storage(error).into()
}

/// Our fault: logged here, once; the client is told nothing of the inside.
fn internal(error: &dyn std::fmt::Display) -> ApiError {
    tracing::error!(%error, "request failed");
    Problem::internal().into()
}

/// Answer for a path that is no route.
pub fn no_such_route(uri: &Uri) -> ApiError {
    let detail = if uri.path().starts_with("/v1/") { "there is nothing at this path" } else { "there is no such page" };
    Problem::new(404, "no_such_route", detail).hint("GET / says what is where, GET /openapi.yaml in full").into()
}

/// Answer for a route that has no such method.
pub async fn wrong_method(method: Method) -> ApiError {
    let detail = format!("{method} is not allowed here");
    Problem::new(405, "method_not_allowed", detail).hint("the Allow header says what is").into()
}

/// Answer when a handler panicked.
pub fn handler_panicked(_payload: Box<dyn Any + Send>) -> Response<Body> {
    ApiError::from(Problem::internal()).into_response()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_the_database_lacks_is_told_apart_from_a_fault() {
        for (error, status, is_retryable) in [
            (StoreError::Full, 507, true),
            (StoreError::Unavailable("locked".to_owned()), 503, true),
            (StoreError::Corrupt("column id".to_owned()), 500, false),
            (StoreError::Other("no such table".to_owned()), 500, false),
        ] {
            let answer = ApiError::from(JobsError::Store(error)).into_response();
            assert_eq!((answer.status().as_u16(), answer.headers().contains_key(RETRY_AFTER)), (status, is_retryable));
        }
    }
}
