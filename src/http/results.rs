//! `/v1/jobs/{id}/results/{name}`: the files that a job left. A result never changes, so its
//! hash is its ETag and caches may keep it for ever.

use std::io::SeekFrom;
use std::sync::Arc;

use axum::body::Body;
use axum::extract::State;
use axum::http::header::{
    ACCEPT_RANGES, CACHE_CONTROL, CONTENT_DISPOSITION, CONTENT_LENGTH, CONTENT_RANGE, CONTENT_TYPE, ETAG,
    IF_NONE_MATCH, IF_RANGE, RANGE,
};
use axum::http::{HeaderMap, HeaderName, Response, StatusCode};
use tokio::io::{AsyncReadExt, AsyncSeekExt};
use tokio_util::io::ReaderStream;

use super::error::{ApiError, PROBLEM_JSON};
use super::extract::ResultPath;
use super::params_schema::BytesSchema;
use crate::jobs::queue::{Jobs, JobsError, PublishedFile};
use crate::problem::Problem;

/// A file that the job left.
#[utoipa::path(
    get, path = "/v1/jobs/{id}/results/{name}", tag = "jobs",
    params(
        ("id" = String, Path, description = "The job's id"),
        ("name" = String, Path, description = "model.glb, thickness.json, thickness.csv or points.csv"),
        ("If-None-Match" = Option<String>, Header, description = "An ETag that the client has"),
        ("Range" = Option<String>, Header, description = "One range of bytes")
    ),
    responses(
        (status = 200, description = "The whole file", content(
            (inline(BytesSchema) = "model/gltf-binary"), (serde_json::Value = "application/json"), (String = "text/csv")
        ), headers(("ETag" = String, description = "The content's SHA-256"))),
        (status = 206, description = "The range asked for"),
        (status = 304, description = "The client has it"),
        (status = 404, body = Problem, content_type = PROBLEM_JSON, description = "`no_such_job`, `no_such_result`"),
        (status = 416, body = Problem, content_type = PROBLEM_JSON, description = "`range_not_satisfiable`")
    )
)]
pub async fn result(
    State(jobs): State<Arc<Jobs>>,
    ResultPath(id, name): ResultPath,
    headers: HeaderMap,
) -> Result<Response<Body>, ApiError> {
    serve(&jobs.result(id, &name).await?, &headers).await
}

async fn serve(published: &PublishedFile, headers: &HeaderMap) -> Result<Response<Body>, ApiError> {
    let PublishedFile { file, path } = published;
    let etag = format!("\"{}\"", file.sha256);
    let answer = Response::builder()
        .header(ETAG, &etag)
        .header(CACHE_CONTROL, "private, max-age=31536000, immutable")
        .header(ACCEPT_RANGES, "bytes");
    if header(headers, IF_NONE_MATCH).is_some_and(|list| matches(list, &etag)) {
        return finish(answer.status(StatusCode::NOT_MODIFIED), Body::empty());
    }
    let range = match asked_range(headers, &etag, file.bytes) {
        Asked::Unsatisfiable => return Err(unsatisfiable(file.bytes)),
        Asked::Whole => None,
        Asked::Part(first, last) => Some((first, last)),
    };
    let (first, last) = range.unwrap_or((0, file.bytes.saturating_sub(1)));
    let length = if file.bytes == 0 { 0 } else { last - first + 1 };
    let mut content = tokio::fs::File::open(path).await.map_err(JobsError::Files)?;
    content.seek(SeekFrom::Start(first)).await.map_err(JobsError::Files)?;
    let mut answer = answer
        .header(CONTENT_TYPE, &file.media_type)
        .header(CONTENT_LENGTH, length)
        .header(CONTENT_DISPOSITION, format!("attachment; filename=\"{}\"", file.name));
    if range.is_some() {
        answer = answer
            .status(StatusCode::PARTIAL_CONTENT)
            .header(CONTENT_RANGE, format!("bytes {first}-{last}/{}", file.bytes));
    }
    finish(answer, Body::from_stream(ReaderStream::with_capacity(content.take(length), 64 << 10)))
}

fn finish(answer: axum::http::response::Builder, body: Body) -> Result<Response<Body>, ApiError> {
    answer.body(body).map_err(|_| Problem::internal().into())
}

fn header(headers: &HeaderMap, name: HeaderName) -> Option<&str> {
    headers.get(name)?.to_str().ok()
}

fn matches(list: &str, etag: &str) -> bool {
    list.split(',').map(|tag| tag.trim().trim_start_matches("W/")).any(|tag| tag == "*" || tag == etag)
}

/// What part of a file is wanted.
#[derive(Debug, PartialEq, Eq)]
enum Asked {
    Whole,
    /// First and last byte.
    Part(u64, u64),
    Unsatisfiable,
}

/// One range of bytes (RFC 9110, section 14). Anything else is answered with the whole file, as
/// the standard allows.
fn asked_range(headers: &HeaderMap, etag: &str, bytes: u64) -> Asked {
    let is_current = header(headers, IF_RANGE).is_none_or(|tag| tag == etag);
    let range = header(headers, RANGE).filter(|_| is_current).and_then(|range| range.strip_prefix("bytes="));
    let Some((first, last)) = range.and_then(|range| range.split_once('-')) else { return Asked::Whole };
    match (first.trim().parse::<u64>(), last.trim().parse::<u64>()) {
        (Ok(first), Ok(last)) if first > last => Asked::Whole,
        (Ok(first), _) if first >= bytes => Asked::Unsatisfiable,
        (Ok(first), Ok(last)) => Asked::Part(first, last.min(bytes - 1)),
        (Ok(first), Err(_)) if last.trim().is_empty() => Asked::Part(first, bytes - 1),
        (Err(_), Ok(0)) if first.trim().is_empty() => Asked::Unsatisfiable,
        (Err(_), Ok(count)) if first.trim().is_empty() && bytes > 0 => {
            Asked::Part(bytes.saturating_sub(count), bytes - 1)
        }
        _ => Asked::Whole,
    }
}

fn unsatisfiable(bytes: u64) -> ApiError {
    Problem::new(416, "range_not_satisfiable", format!("the file has {bytes} bytes")).at("header Range").into()
}

#[cfg(test)]
mod tests {
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
        ] {
            assert_eq!(asked(range), expected, "{range}");
        }
    }

    #[test]
    fn a_list_of_etags_is_searched() {
        assert!(matches("\"a\", W/\"b\"", "\"b\""));
        assert!(matches("*", "\"b\""));
        assert!(!matches("\"a\"", "\"b\""));
    }
}
