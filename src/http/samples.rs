//! `/v1/samples`: the analytic masks, to try the service on.

use std::collections::BTreeMap;
use std::io;
use std::sync::{LazyLock, OnceLock};

use axum::Json;
use axum::body::Bytes;
use axum::extract::Path;
use axum::extract::rejection::PathRejection;
use axum::http::header::{CACHE_CONTROL, CONTENT_DISPOSITION, CONTENT_TYPE, ETAG};
use axum::http::{HeaderMap, StatusCode};
use axum::response::{IntoResponse, Response};
use nalgebra::Rotation3;
use serde::Serialize;
use sha2::{Digest, Sha256};
use tokio::sync::Semaphore;

use super::auth::{Allowed, Read, TokenProblems, TooManyRequests};
use super::error::{ApiError, PROBLEM_JSON};
use super::extract::has_it;
use super::params_schema::BytesSchema;
use crate::formats::{hex, write};
use crate::problem::Problem;
use crate::samples;

/// Masks to try the service on.
#[derive(Debug, Serialize, utoipa::ToSchema)]
pub struct SampleList {
    /// All of them.
    samples: Vec<SampleView>,
}

/// A mask to try the service on.
#[derive(Debug, Serialize, utoipa::ToSchema)]
#[schema(as = Sample)]
pub struct SampleView {
    /// Its name.
    name: &'static str,
    /// What it is.
    about: &'static str,
    /// Where its file is.
    href: String,
}

/// A sample as it is sent.
struct SampleFile {
    bytes: Bytes,
    etag: String,
}

/// The samples asked for so far: each is made once, and a few kilobytes long.
static FILES: LazyLock<BTreeMap<&'static str, OnceLock<SampleFile>>> =
    LazyLock::new(|| samples::list().map(|(name, _)| (name, OnceLock::new())).collect());

/// Who makes a sample: one at a time, so that requests for all of them leave the jobs their processors.
static MAKER: Semaphore = Semaphore::const_new(1);

/// The masks to try the service on.
#[utoipa::path(
    get, path = "/v1/samples", tag = "samples",
    responses((status = 200, body = SampleList, description = "The samples"), TokenProblems, TooManyRequests)
)]
pub async fn samples(_allowed: Allowed<Read>) -> Json<SampleList> {
    let view = |(name, about)| SampleView { name, about, href: format!("/v1/samples/{name}") };
    Json(SampleList { samples: samples::list().map(view).collect() })
}

/// A mask to try the service on, gzip NIfTI with voxels of 1 mm: what `medialrep sample` writes.
#[utoipa::path(
    get, path = "/v1/samples/{name}", tag = "samples",
    params(
        ("name" = String, Path, description = "The sample's name", example = "bent"),
        ("If-None-Match" = Option<String>, Header, description = "An ETag that the client has")
    ),
    responses(
        (status = 200, description = "The file", content((inline(BytesSchema) = "application/gzip")),
            headers(("ETag" = String, description = "The content's SHA-256"))),
        (status = 304, description = "The client has it"),
        TokenProblems,
        TooManyRequests,
        (status = 404, body = Problem, content_type = PROBLEM_JSON, description = "`no_such_sample`")
    )
)]
pub async fn sample(
    _allowed: Allowed<Read>,
    name: Result<Path<String>, PathRejection>,
    headers: HeaderMap,
) -> Result<Response, ApiError> {
    let name = name.map_or_else(|_| String::new(), |Path(name)| name);
    let file = file(&name).await?;
    // Another version of the program may make another file.
    let known = [(ETAG, file.etag.as_str()), (CACHE_CONTROL, "private, max-age=3600")];
    if has_it(&headers, &file.etag) {
        return Ok((StatusCode::NOT_MODIFIED, known).into_response());
    }
    let disposition = format!("attachment; filename=\"{name}.nii.gz\"");
    let sent = [(CONTENT_TYPE, "application/gzip"), (CONTENT_DISPOSITION, &disposition)];
    Ok((known, sent, file.bytes.clone()).into_response())
}

/// The file of a sample, made by whoever asks for it first.
async fn file(name: &str) -> Result<&'static SampleFile, ApiError> {
    let (&name, file) = FILES.get_key_value(name).ok_or_else(no_such_sample)?;
    if let Some(file) = file.get() {
        return Ok(file);
    }
    // Held by the work and not by the request: that one may be given up.
    let turn = MAKER.acquire().await.map_err(|_| Problem::internal())?;
    let made = tokio::task::spawn_blocking(move || {
        let _turn = turn;
        match file.get() {
            Some(file) => Ok(file),
            None => make(name).map(|made| file.get_or_init(|| made)),
        }
    });
    made.await.map_err(io::Error::other).flatten().map_err(|error| {
        tracing::error!(%error, name, "a sample cannot be made");
        Problem::internal().into()
    })
}

fn make(name: &'static str) -> io::Result<SampleFile> {
    let sample = samples::by_name(name).ok_or(io::ErrorKind::NotFound)?;
    let volume = sample.voxelise([samples::SPACING_MM; 3], Rotation3::identity()).map_err(io::Error::other)?;
    let mut bytes = Vec::new();
    write::nifti::write(&volume, &mut bytes)?;
    tracing::info!(name, bytes = bytes.len(), "sample made");
    Ok(SampleFile { etag: format!("\"{}\"", hex(&Sha256::digest(&bytes))), bytes: bytes.into() })
}

fn no_such_sample() -> ApiError {
    Problem::new(404, "no_such_sample", "there is no sample of this name").hint("GET /v1/samples lists them").into()
}
