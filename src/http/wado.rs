//! DICOM results as an archive or a viewer fetches them (WADO-RS, PS3.18 section 10.4): the files of a study, a series
//! or an instance, as they were made.

use std::io;
use std::sync::Arc;

use axum::body::Body;
use axum::http::Response;
use axum::http::header::WARNING;
use futures_util::{StreamExt, TryStreamExt, stream};

use super::auth::{TokenProblems, TooManyRequests};
use super::dicom_path::{DicomRequest, InstanceParam, SeriesParam, StudyParam};
use super::error::ApiError;
use super::params_schema::BytesSchema;
use super::qido::{CUT, InvalidUid, not_acceptable, warning};
use super::related::{Form, Part, body_of, finish};
use super::results::checked_body;
use crate::audit::Action;
use crate::dicomweb::multipart::Framing;
use crate::jobs::caller::Caller;
use crate::jobs::objects::ObjectPath;
use crate::jobs::results::Published;
use crate::jobs::service::Jobs;
use crate::jobs::store::KeptObject;
use crate::problem::Problem;

const DICOM: &str = "application/dicom";
/// What a part is.
const PART: &str = "application/dicom; transfer-syntax=1.2.840.10008.1.2.1";

/// The parameter of every retrieval, described.
#[derive(utoipa::IntoParams)]
#[into_params(parameter_in = Query)]
#[expect(dead_code, reason = "describes what Accepted::of takes")]
pub struct AcceptParam {
    /// Media types, in place of the header
    accept: Option<String>,
}

/// What every retrieval may answer; only described, never made.
#[derive(utoipa::IntoResponses)]
#[expect(dead_code, reason = "describes answers, is none")]
pub enum RetrieveProblems {
    /// `invalid_query`
    #[response(status = 400, content_type = "application/problem+json")]
    Malformed(Problem),
    /// `no_such_object`
    #[response(status = 404, content_type = "application/problem+json")]
    Missing(Problem),
    /// `not_acceptable`
    #[response(status = 406, content_type = "application/problem+json")]
    OtherKind(Problem),
    /// `result_damaged`, `internal`
    #[response(status = 500, content_type = "application/problem+json")]
    Damaged(Problem),
}

/// Fetch the DICOM results of a study (WADO-RS).
#[utoipa::path(
    get, path = "/dicom-web/studies/{study}", tag = "dicomweb", params(StudyParam, AcceptParam),
    responses(
        (status = 200, description = "The files, each a part of `application/dicom`", content((inline(BytesSchema) = "multipart/related"))),
        TokenProblems, TooManyRequests, RetrieveProblems, InvalidUid
    )
)]
pub async fn retrieve_study(request: DicomRequest) -> Result<Response<Body>, ApiError> {
    files(request).await
}

/// Fetch the DICOM results of a series (WADO-RS).
#[utoipa::path(
    get, path = "/dicom-web/studies/{study}/series/{series}", tag = "dicomweb",
    params(StudyParam, SeriesParam, AcceptParam),
    responses(
        (status = 200, description = "The files, each a part of `application/dicom`", content((inline(BytesSchema) = "multipart/related"))),
        TokenProblems, TooManyRequests, RetrieveProblems, InvalidUid
    )
)]
pub async fn retrieve_series(request: DicomRequest) -> Result<Response<Body>, ApiError> {
    files(request).await
}

/// Fetch a DICOM result (WADO-RS).
///
/// As the only part of `multipart/related`, or as it is where `application/dicom` is accepted more.
#[utoipa::path(
    get, path = "/dicom-web/studies/{study}/series/{series}/instances/{instance}", tag = "dicomweb",
    params(StudyParam, SeriesParam, InstanceParam, AcceptParam),
    responses(
        (status = 200, description = "The file", content((inline(BytesSchema) = "multipart/related"), (inline(BytesSchema) = "application/dicom"))),
        TokenProblems, TooManyRequests, RetrieveProblems, InvalidUid
    )
)]
pub async fn retrieve_instance(request: DicomRequest) -> Result<Response<Body>, ApiError> {
    files(request).await
}

/// What a path leads to: one object, and those behind it.
pub struct Target {
    /// The newest.
    pub first: KeptObject,
    /// The others, newest first.
    pub rest: Vec<KeptObject>,
    /// Whether there are more than are looked at.
    pub is_cut: bool,
}

impl Target {
    /// Looks for them.
    ///
    /// # Errors
    /// When there are none.
    pub async fn find(jobs: &Jobs, caller: &Caller, path: &ObjectPath) -> Result<Self, ApiError> {
        let (objects, is_cut) = jobs.objects(caller, path).await?;
        let mut objects = objects.into_iter();
        let first = objects.next().ok_or_else(no_such_object)?;
        Ok(Self { first, rest: objects.collect(), is_cut })
    }
}

/// There is nothing of these identifiers, or nothing that the caller may see.
pub fn no_such_object() -> ApiError {
    Problem::new(404, "no_such_object", "there is no DICOM result of these identifiers")
        .hint(
            "GET /dicom-web/studies lists what there is: results that were made with their job, or fetched from it \
             once",
        )
        .into()
}

async fn files(request: DicomRequest) -> Result<Response<Body>, ApiError> {
    let DicomRequest { jobs, allowed, path, accepted, .. } = request;
    let single = path.instance.as_ref().map(|_| DICOM);
    let form = Form::of(&accepted, DICOM, single)
        .ok_or_else(|| not_acceptable("multipart/related; type=\"application/dicom\"; transfer-syntax=*"))?;
    let Target { first, rest, is_cut } = Target::find(&jobs, &allowed.caller, &path).await?;
    // What is wrong with the first is told in words; later, the answer has begun.
    let first = part_of(&jobs, &allowed.caller, first).await?;
    if form == Form::Single {
        return finish(DICOM, first.bytes, Body::from_stream(first.body));
    }
    let framing = Framing::new();
    let mut length = first.length(&framing) + framing.end().len() as u64;
    for kept in &rest {
        length += Part::of(PART, kept.file.bytes).length(&framing);
    }
    // The request counts as open until its end.
    let allowed = Arc::new(allowed);
    let rest = stream::iter(rest).then(move |kept| {
        let (jobs, allowed) = (Arc::clone(&jobs), Arc::clone(&allowed));
        async move { part_of(&jobs, &allowed.caller, kept).await.map_err(|error| broken(&error)) }
    });
    let parts = stream::once(async move { Ok(first) }).chain(rest).boxed();
    Ok(warned(finish(&framing.media_type(DICOM), length, body_of(parts, framing))?, is_cut))
}

/// A file, once it was found to be what was kept.
async fn part_of(jobs: &Jobs, caller: &Caller, kept: KeptObject) -> Result<Part, ApiError> {
    let (id, name, bytes) = (kept.id, kept.file.name.clone(), kept.file.bytes);
    let published = Published { id, token: kept.token, file: kept.file };
    let body = checked_body(jobs, &published, (0, bytes)).await?;
    jobs.record(caller, Action::ReadResult, Some(id), &name).await;
    Ok(Part::of(PART, bytes).with(body.into_data_stream().map_err(io::Error::other).boxed()))
}

/// What ends an answer that has begun.
pub fn broken(error: &ApiError) -> io::Error {
    io::Error::other(error.problem().code.clone())
}

/// Says that not all objects were looked at, where it is so.
pub fn warned(mut answer: Response<Body>, is_cut: bool) -> Response<Body> {
    if is_cut {
        answer.headers_mut().insert(WARNING, warning(CUT));
    }
    answer
}
