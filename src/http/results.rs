//! `/v1/jobs/{id}/results/{name}`: the files that a job left. A result never changes, so its
//! hash is its ETag and caches may keep it for ever.

use std::sync::Arc;

use axum::body::Body;
use axum::extract::State;
use axum::http::header::{
    ACCEPT_RANGES, CACHE_CONTROL, CONTENT_DISPOSITION, CONTENT_LENGTH, CONTENT_RANGE, CONTENT_TYPE, ETAG, IF_RANGE,
    LOCATION, RANGE, VARY,
};
use axum::http::{HeaderMap, HeaderValue, Response, StatusCode};
use axum::response::IntoResponse;

use super::accept::Accepted;
use super::auth::{Allowed, Read, TokenProblems, TooManyRequests};
use super::connections::Held;
use super::error::{ApiError, PROBLEM_JSON};
use super::extract::{IdParam, JobPath, ResultPath, has_it, header};
use super::params_schema::BytesSchema;
use crate::audit::Action;
use crate::formats::artifacts::by_name;
use crate::jobs::error::JobsError;
use crate::jobs::results::Published;
use crate::jobs::service::Jobs;
use crate::jobs::store::blobs::Content;
use crate::problem::Problem;

/// A file that the job left. An artifact that was not made with the job is made now, and kept.
#[utoipa::path(
    get, path = "/v1/jobs/{id}/results/{name}", tag = "jobs",
    params(
        IdParam,
        ("name" = String, Path, description = "A file of the table of outputs: model.glb, thickness.json, report.pdf, report.sr.dcm, …"),
        ("If-None-Match" = Option<String>, Header, description = "An ETag that the client has"),
        ("Range" = Option<String>, Header, description = "One range of bytes")
    ),
    responses(
        (status = 200, description = "The whole file", content(
            (inline(BytesSchema) = "model/gltf-binary"), (serde_json::Value = "application/json"), (String = "text/csv"),
            (inline(BytesSchema) = "image/png"), (inline(BytesSchema) = "application/pdf"),
            (inline(BytesSchema) = "model/stl"), (inline(BytesSchema) = "application/dicom")
        ), headers(("ETag" = String, description = "The content's SHA-256"))),
        (status = 206, description = "The range asked for"),
        (status = 304, description = "The client has it"),
        TokenProblems,
        TooManyRequests,
        (status = 404, body = Problem, content_type = PROBLEM_JSON, description = "`no_such_job`, `no_such_result`"),
        (status = 410, body = Problem, content_type = PROBLEM_JSON, description = "`results_erased`"),
        (status = 500, body = Problem, content_type = PROBLEM_JSON, description = "`result_damaged`, `internal`"),
        (status = 416, body = Problem, content_type = PROBLEM_JSON, description = "`range_not_satisfiable`"),
        (status = 507, body = Problem, content_type = PROBLEM_JSON, description = "`storage_low`, `storage_full`: it would be made now")
    )
)]
pub async fn result(
    State(jobs): State<Arc<Jobs>>,
    allowed: Allowed<Read>,
    ResultPath(id, name): ResultPath,
    headers: HeaderMap,
) -> Result<Response<Body>, ApiError> {
    let published = jobs.result(&allowed.caller, id, &name).await?;
    let answer = serve(&jobs, &published, &headers).await?;
    jobs.record(&allowed.caller, Action::ReadResult, Some(id), published.code()).await;
    Ok(answer)
}

/// The result in the media type asked for.
///
/// 303 to `model.glb` (`model/gltf-binary`), `thickness.json`
/// (`application/json`, and when anything will do) or `thickness.csv` (`text/csv`).
#[utoipa::path(
    get, path = "/v1/jobs/{id}/result", tag = "jobs",
    params(
        IdParam,
        ("Accept" = Option<String>, Header, description = "Media types wanted")
    ),
    responses(
        (status = 303, description = "Where it is", headers(("Location" = String, description = "The file"))),
        TokenProblems,
        TooManyRequests,
        (status = 404, body = Problem, content_type = PROBLEM_JSON, description = "`no_such_job`, `no_such_result`"),
        (status = 406, body = Problem, content_type = PROBLEM_JSON, description = "`not_acceptable`"),
        (status = 410, body = Problem, content_type = PROBLEM_JSON, description = "`results_erased`"),
        (status = 500, body = Problem, content_type = PROBLEM_JSON, description = "`result_damaged`, `internal`"),
        (status = 507, body = Problem, content_type = PROBLEM_JSON, description = "`storage_low`, `storage_full`: it would be made now")
    )
)]
pub async fn pick(
    State(jobs): State<Arc<Jobs>>,
    allowed: Allowed<Read>,
    JobPath(id): JobPath,
    headers: HeaderMap,
) -> Result<impl IntoResponse, ApiError> {
    let name = preferred(&Accepted::of(&headers, &[])).ok_or_else(not_acceptable)?;
    jobs.result(&allowed.caller, id, name).await?;
    let location = HeaderValue::from_str(&format!("/v1/jobs/{id}/results/{name}")).map_err(|_| Problem::internal())?;
    Ok((StatusCode::SEE_OTHER, [(LOCATION, location), (VARY, HeaderValue::from_static("Accept"))]))
}

fn not_acceptable() -> ApiError {
    let problem = Problem::new(406, "not_acceptable", "there is no result of a media type that is accepted");
    problem.at("header Accept").hint("accept model/gltf-binary, application/json or text/csv").into()
}

/// The artifact of the media type that is wanted most; of equals the more telling one.
fn preferred(accepted: &Accepted) -> Option<&'static str> {
    let mut best = None;
    for name in ["thickness.json", "model.glb", "thickness.csv"] {
        let media_type = by_name(name)?.media_type;
        let weight = accepted.weight(|range| range.covers(media_type));
        if weight > best.map_or(0.0, |(_, most)| most) {
            best = Some((name, weight));
        }
    }
    best.map(|(name, _)| name)
}

async fn serve(jobs: &Jobs, published: &Published, headers: &HeaderMap) -> Result<Response<Body>, ApiError> {
    let file = &published.file;
    let etag = format!("\"{}\"", file.sha256);
    let answer = Response::builder()
        .header(ETAG, &etag)
        .header(CACHE_CONTROL, "private, max-age=31536000, immutable")
        .header(ACCEPT_RANGES, "bytes");
    if has_it(headers, &etag) {
        return finish(answer.status(StatusCode::NOT_MODIFIED), Body::empty());
    }
    let range = match asked_range(headers, &etag, file.bytes) {
        Asked::Unsatisfiable => return Ok(unsatisfiable(file.bytes)),
        Asked::Whole => None,
        Asked::Part(first, last) => Some((first, last + 1)),
    };
    let (first, end) = range.unwrap_or((0, file.bytes));
    let body = checked_body(jobs, published, (first, end)).await?;
    let mut answer = answer
        .header(CONTENT_TYPE, &file.media_type)
        .header(CONTENT_LENGTH, end - first)
        .header(CONTENT_DISPOSITION, format!("attachment; filename=\"{}\"", file.name));
    if range.is_some() {
        let range = format!("bytes {first}-{}/{}", end - 1, file.bytes);
        answer = answer.status(StatusCode::PARTIAL_CONTENT).header(CONTENT_RANGE, range);
    }
    finish(answer, body)
}

/// Bytes `first` to before `end`, once the whole file was found to be what was published.
pub(super) async fn checked_body(
    jobs: &Jobs,
    published: &Published,
    (first, end): (u64, u64),
) -> Result<Body, ApiError> {
    let Published { id, token, file } = published;
    match jobs.content(*id, token, file).await? {
        Content::Bytes(bytes, held) => {
            let at = |place: u64| usize::try_from(place).unwrap_or(usize::MAX).min(bytes.len());
            Ok(Body::new(Held { body: Body::from(bytes.slice(at(first)..at(end))), held }))
        }
        Content::Stored => {
            let stream = jobs.blobs().read_range((*id, token, &file.name), (first, end)).await;
            Ok(Body::from_stream(stream.map_err(JobsError::Files)?))
        }
    }
}

fn finish(answer: axum::http::response::Builder, body: Body) -> Result<Response<Body>, ApiError> {
    answer.body(body).map_err(|_| Problem::internal().into())
}

/// What part of a file is wanted.
#[derive(Debug, PartialEq, Eq)]
enum Asked {
    Whole,
    /// First and last byte.
    Part(u64, u64),
    Unsatisfiable,
}

/// One range of bytes (RFC 9110, section 14), in which a number larger than any is the largest. Anything else is answered with the whole file, as
/// the standard allows.
fn asked_range(headers: &HeaderMap, etag: &str, bytes: u64) -> Asked {
    let is_current = header(headers, IF_RANGE).is_none_or(|tag| tag == etag);
    let range = header(headers, RANGE).filter(|_| is_current).and_then(|range| range.split_once('='));
    let range = range.filter(|(unit, _)| unit.eq_ignore_ascii_case("bytes")).and_then(|(_, set)| set.split_once('-'));
    let Some((first, last)) = range.map(|(first, last)| (first.trim_start(), last.trim_end())) else {
        return Asked::Whole;
    };
    match (position(first), position(last)) {
        (Some(first), Some(last)) if first > last => Asked::Whole,
        (Some(first), Some(_)) if first >= bytes => Asked::Unsatisfiable,
        (Some(first), Some(last)) => Asked::Part(first, last.min(bytes - 1)),
        (Some(first), None) if last.is_empty() && first >= bytes => Asked::Unsatisfiable,
        (Some(first), None) if last.is_empty() => Asked::Part(first, bytes - 1),
        (None, Some(0)) if first.is_empty() => Asked::Unsatisfiable,
        (None, Some(count)) if first.is_empty() && bytes > 0 => Asked::Part(bytes.saturating_sub(count), bytes - 1),
        _ => Asked::Whole,
    }
}

/// A number of digits alone.
fn position(text: &str) -> Option<u64> {
    let is_number = !text.is_empty() && text.bytes().all(|b| b.is_ascii_digit());
    is_number.then(|| text.parse().unwrap_or(u64::MAX))
}

fn unsatisfiable(bytes: u64) -> Response<Body> {
    let problem = Problem::new(416, "range_not_satisfiable", format!("the file has {bytes} bytes")).at("header Range");
    let mut answer = ApiError::from(problem).into_response();
    if let Ok(length) = HeaderValue::from_str(&format!("bytes */{bytes}")) {
        answer.headers_mut().insert(CONTENT_RANGE, length);
    }
    answer
}

#[cfg(test)]
mod tests {
    use axum::http::header::ACCEPT;

    use super::*;

    fn asked(range: &str) -> Asked {
        asked_range(&[(RANGE, range.parse().unwrap())].into_iter().collect(), "\"x\"", 10)
    }

    #[test]
    fn one_range_is_read_and_anything_else_means_the_whole() {
        for (range, expected) in [
            ("bytes=0-3", Asked::Part(0, 3)),
            ("bytes=4-", Asked::Part(4, 9)),
            ("bytes=8-99", Asked::Part(8, 9)),
            ("bytes=-3", Asked::Part(7, 9)),
            ("bytes=-99", Asked::Part(0, 9)),
            ("bytes=10-", Asked::Unsatisfiable),
            ("bytes=-0", Asked::Unsatisfiable),
            ("bytes=5-2", Asked::Whole),
            ("bytes=0-1,3-4", Asked::Whole),
            ("lines=0-1", Asked::Whole),
            ("bytes=a-b", Asked::Whole),
            ("BYTES=0-3", Asked::Part(0, 3)),
            ("bytes=0-99999999999999999999999", Asked::Part(0, 9)),
            ("bytes=-99999999999999999999999", Asked::Part(0, 9)),
            ("bytes=99999999999999999999999-", Asked::Unsatisfiable),
            ("bytes=99999999999999999999999-5", Asked::Whole),
            ("bytes=+0-3", Asked::Whole),
            ("bytes=0 - 3", Asked::Whole),
        ] {
            assert_eq!(asked(range), expected, "{range}");
        }
    }

    #[test]
    fn the_media_type_wanted_most_is_picked() {
        for (accept, name) in [
            ("*/*", Some("thickness.json")),
            ("application/json", Some("thickness.json")),
            ("model/gltf-binary, application/json;q=0.9", Some("model.glb")),
            ("model/*;q=0.2, */*;q=0.1", Some("model.glb")),
            ("text/csv;q=0.5, application/json;q=0.4", Some("thickness.csv")),
            ("application/*;q=0, */*", Some("model.glb")),
            ("Application/JSON", Some("thickness.json")),
            ("image/png", None),
            ("*/*;q=0", None),
        ] {
            let headers = [(ACCEPT, accept.parse().unwrap())].into_iter().collect();
            assert_eq!(preferred(&Accepted::of(&headers, &[])), name, "{accept}");
        }
    }
}
