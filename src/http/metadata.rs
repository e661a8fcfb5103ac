//! What DICOM results say of themselves, as JSON, and the long values that this leaves out (WADO-RS, PS3.18 sections
//! 10.4.1.1.2 and 10.4.1.1.5).

use std::io;
use std::sync::Arc;

use axum::body::{Body, Bytes};
use axum::extract::Path;
use axum::http::Response;
use axum::http::header::CONTENT_TYPE;
use futures_util::{StreamExt, stream};
use serde_json::Value;
use tokio::sync::Mutex;

use super::auth::{TokenProblems, TooManyRequests};
use super::dicom_path::{DicomRequest, InstanceParam, SeriesParam, StudyParam, path_of};
use super::error::ApiError;
use super::params_schema::BytesSchema;
use super::qido::{InvalidUid, is_json_accepted, not_acceptable};
use super::related::{Form, Part, body_of, finish, once};
use super::wado::{AcceptParam, RetrieveProblems, Target, broken, no_such_object, warned};
use crate::audit::Action;
use crate::dicomweb::entries::{Level, tag_of};
use crate::dicomweb::json::{DICOM_JSON, attributes, key};
use crate::dicomweb::multipart::Framing;
use crate::formats::dicom_elements::{DataSet, ElementValue, Tag};
use crate::jobs::blocking::on_own_thread;
use crate::jobs::caller::Caller;
use crate::jobs::error::JobsError;
use crate::jobs::service::Jobs;
use crate::jobs::store::KeptObject;
use crate::problem::Problem;

const OCTETS: &str = "application/octet-stream";
/// What the file in an encapsulated document is.
const DOCUMENT_TYPE: Tag = Tag(0x0042_0012);
const DOCUMENT: Tag = Tag(0x0042_0011);

/// The attributes of all DICOM results of a study (WADO-RS).
#[utoipa::path(
    get, path = "/dicom-web/studies/{study}/metadata", tag = "dicomweb", params(StudyParam, AcceptParam),
    responses(
        (status = 200, body = [Object], content_type = DICOM_JSON, description = "An object for each; long values are BulkDataURI"),
        TokenProblems, TooManyRequests, RetrieveProblems, InvalidUid
    )
)]
pub async fn study_metadata(request: DicomRequest) -> Result<Response<Body>, ApiError> {
    metadata(request).await
}

/// The attributes of all DICOM results of a series (WADO-RS).
#[utoipa::path(
    get, path = "/dicom-web/studies/{study}/series/{series}/metadata", tag = "dicomweb",
    params(StudyParam, SeriesParam, AcceptParam),
    responses(
        (status = 200, body = [Object], content_type = DICOM_JSON, description = "An object for each; long values are BulkDataURI"),
        TokenProblems, TooManyRequests, RetrieveProblems, InvalidUid
    )
)]
pub async fn series_metadata(request: DicomRequest) -> Result<Response<Body>, ApiError> {
    metadata(request).await
}

/// The attributes of a DICOM result (WADO-RS).
#[utoipa::path(
    get, path = "/dicom-web/studies/{study}/series/{series}/instances/{instance}/metadata", tag = "dicomweb",
    params(StudyParam, SeriesParam, InstanceParam, AcceptParam),
    responses(
        (status = 200, body = [Object], content_type = DICOM_JSON, description = "A list of one object; long values are BulkDataURI"),
        TokenProblems, TooManyRequests, RetrieveProblems, InvalidUid
    )
)]
pub async fn instance_metadata(request: DicomRequest) -> Result<Response<Body>, ApiError> {
    metadata(request).await
}

/// A long value of a DICOM result, where BulkDataURI leads to (WADO-RS).
///
/// A document also as the media type that it says that it is.
#[utoipa::path(
    get, path = "/dicom-web/studies/{study}/series/{series}/instances/{instance}/bulkdata/{tag}", tag = "dicomweb",
    params(
        StudyParam, SeriesParam, InstanceParam,
        ("tag" = String, Path, description = "Its tag", pattern = "^[0-9A-Fa-f]{8}$"),
        AcceptParam
    ),
    responses(
        (status = 200, description = "Its bytes", content((inline(BytesSchema) = "multipart/related"), (inline(BytesSchema) = "application/octet-stream"))),
        TokenProblems, TooManyRequests, RetrieveProblems, InvalidUid
    )
)]
pub async fn bulk_data(
    request: DicomRequest,
    Path((.., tag)): Path<(String, String, String, String)>,
) -> Result<Response<Body>, ApiError> {
    let DicomRequest { jobs, allowed, path, accepted, .. } = request;
    let kept = Target::find(&jobs, &allowed.caller, &path).await?.first;
    let set = jobs.data_set(&kept).await?;
    let value = tag_of(&tag).and_then(|tag| set.get(tag));
    let Some((tag, &ElementValue::Long { at, bytes })) = value.map(|own| (own.tag, &own.value)) else {
        return Err(no_such_object());
    };
    let document = document_type(&set).filter(|own| tag == DOCUMENT && accepted.weight(|r| r.is(own)) > 0.0);
    let single = document.unwrap_or_else(|| OCTETS.to_owned());
    let form = Form::of(&accepted, OCTETS, Some(&single)).ok_or_else(|| not_acceptable(OCTETS))?;
    let stream = jobs.blobs().read_range((kept.id, &kept.token, &kept.file.name), (at, at + bytes)).await;
    let part = Part::of(OCTETS, bytes).with(stream.map_err(JobsError::Files)?.boxed());
    jobs.record(&allowed.caller, Action::ReadResult, Some(kept.id), &kept.file.name).await;
    match form {
        Form::Single => finish(&single, bytes, Body::from_stream(part.body)),
        Form::Multipart => {
            let framing = Framing::new();
            let length = part.length(&framing) + framing.end().len() as u64;
            let parts = stream::once(async move { Ok(part) }).boxed();
            finish(&framing.media_type(OCTETS), length, body_of(parts, framing))
        }
    }
}

/// What the file in an encapsulated document says that it is, where that is a media type that can stand in a header.
fn document_type(set: &DataSet) -> Option<String> {
    let ElementValue::Bytes(bytes) = &set.get(DOCUMENT_TYPE)?.value else { return None };
    let text = std::str::from_utf8(bytes).ok()?.trim_end_matches([' ', '\0']).to_ascii_lowercase();
    let is_type =
        text.contains('/') && text.bytes().all(|byte| byte.is_ascii_alphanumeric() || b"/+-.".contains(&byte));
    is_type.then_some(text)
}

async fn metadata(request: DicomRequest) -> Result<Response<Body>, ApiError> {
    let DicomRequest { jobs, allowed, path, accepted, .. } = request;
    if !is_json_accepted(&accepted) {
        return Err(not_acceptable(DICOM_JSON));
    }
    let Target { first, rest, is_cut } = Target::find(&jobs, &allowed.caller, &path).await?;
    let first = described(&jobs, &allowed.caller, &first).await?;
    // One after the other: a study may have more than memory has room for. The request counts as open until its end.
    let allowed = Arc::new(allowed);
    let rest = stream::iter(rest).then(move |kept| {
        let (jobs, allowed) = (Arc::clone(&jobs), Arc::clone(&allowed));
        async move {
            let json = described(&jobs, &allowed.caller, &kept).await.map_err(|error| broken(&error))?;
            Ok::<_, io::Error>(Bytes::from(format!(",{json}")))
        }
    });
    let whole = once(Bytes::from(format!("[{first}"))).chain(rest).chain(once(Bytes::from_static(b"]")));
    let answer = Response::builder().header(CONTENT_TYPE, DICOM_JSON);
    let answer = answer.body(Body::from_stream(whole)).map_err(|_| Problem::internal())?;
    Ok(warned(answer, is_cut))
}

/// The attributes of an object, as JSON. One at a time of all requests: a large report takes much memory meanwhile.
async fn described(jobs: &Jobs, caller: &Caller, kept: &KeptObject) -> Result<String, ApiError> {
    static TURN: Mutex<()> = Mutex::const_new(());
    let turn = TURN.lock().await;
    let set = jobs.data_set(kept).await?;
    jobs.record(caller, Action::ReadResult, Some(kept.id), &kept.file.name).await;
    let path = path_of(&kept.object, Level::Instance);
    let written = on_own_thread(move || {
        // Held to the end of the work, though whoever asked may be gone.
        let _turn = turn;
        let attributes = attributes(&set, Some(&|tag| format!("{path}/bulkdata/{}", key(tag))));
        Ok(Value::Object(attributes.into_iter().collect()).to_string())
    });
    Ok(written.await.map_err(JobsError::Files)?)
}
