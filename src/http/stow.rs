//! `/dicom-web/studies`: an archive stores segmentations here, each a job (STOW-RS, PS3.18 section 10.5).

use std::fs::File;
use std::sync::Arc;
use std::time::Duration;

use axum::Json;
use axum::body::BodyDataStream;
use axum::extract::rejection::PathRejection;
use axum::extract::{Path, Request, State};
use axum::http::header::{CONTENT_TYPE, LINK};
use axum::http::{HeaderMap, HeaderValue, StatusCode};
use axum::response::{IntoResponse, Response};
use futures_util::{StreamExt, stream};
use serde::Deserialize;
use serde_json::{Value, json};
use tokio::time::{Instant, timeout, timeout_at};

use super::auth::{Allowed, TokenProblems, Write};
use super::error::{ApiError, PROBLEM_JSON, too_large};
use super::extract::{StrictQuery, header};
use super::source::uid;
use super::submit::{check_archive, refuse_encoded};
use super::view::path_of;
use crate::dicomweb::multipart::{Chunks, MultipartError, MultipartLimits, Part, Parts, boundary_of};
use crate::formats::{IDENTITY_BYTES, Identity, Uid};
use crate::jobs::blocking::on_own_thread;
use crate::jobs::caller::Caller;
use crate::jobs::job::{JobId, RequestedParams};
use crate::jobs::service::Jobs;
use crate::jobs::submission::Submission;
use crate::jobs::upload::{self, Received, UploadError, UploadLimits};
use crate::problem::Problem;

/// Instances of one request. Archives send a series or a study; with no bound, the answer has none.
const MAX_INSTANCES: usize = 4096;
/// Jobs that the header Link names: proxies take headers of a few kilobytes. The body names all.
const MAX_LINKS: usize = 32;
const DICOM_JSON: &str = "application/dicom+json";

/// Why an instance was not stored: values of Failure Reason (0008,1197).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u16)]
enum Failure {
    /// Processing failure.
    OurFault = 0x0110,
    /// SOP class not supported.
    OtherClass = 0x0122,
    /// Out of resources.
    NoRoom = 0xA700,
    /// Cannot understand.
    Refused = 0xC000,
    /// Transfer syntax not supported.
    TransferSyntax = 0xC122,
}

/// What became of an instance.
struct Stored {
    /// Class and instance, where the file says both.
    reference: Option<(Uid, Uid)>,
    outcome: Result<JobId, Failure>,
}

/// What both routes may answer; only described, never made.
#[derive(utoipa::IntoResponses)]
#[expect(dead_code, reason = "describes answers, is none")]
pub enum StoreProblems {
    /// `empty_upload`, `upload_interrupted`, `invalid_multipart`
    #[response(status = 400, content_type = "application/problem+json")]
    Malformed(Problem),
    /// `upload_too_slow`
    #[response(status = 408, content_type = "application/problem+json")]
    TooSlow(Problem),
    /// `upload_too_large`
    #[response(status = 413, content_type = "application/problem+json")]
    TooLarge(Problem),
    /// `not_multipart_dicom`, `content_encoding`
    #[response(status = 415, content_type = "application/problem+json")]
    OtherKind(Problem),
    /// `queue_share_full`, `too_many_requests`
    #[response(status = 429, content_type = "application/problem+json")]
    TooMany(Problem),
    /// `queue_full`, `store_unavailable`
    #[response(status = 503, content_type = "application/problem+json")]
    Busy(Problem),
    /// `storage_full`, `storage_low`, `storage_share_full`
    #[response(status = 507, content_type = "application/problem+json")]
    NoRoom(Problem),
}

/// What the query of a request may say.
#[derive(Debug, Default, Deserialize, utoipa::IntoParams)]
#[serde(deny_unknown_fields)]
#[into_params(parameter_in = Query)]
pub struct StoreQuery {
    /// The PACS that DICOM results go to, by the name that the operator gave it; without it that of the token, if it has
    /// one.
    #[param(example = "main", max_length = 64)]
    deliver_to: Option<String>,
}

/// Whose instances come, and what of them is taken.
struct Errand<'a> {
    jobs: &'a Jobs,
    caller: &'a Caller,
    /// The only study whose instances are taken.
    study: Option<&'a Uid>,
    /// Archive that the results go to.
    deliver_to: Option<String>,
}

impl<'a> Errand<'a> {
    /// # Errors
    /// When there is no archive of the name that the request, or else its token, gives.
    fn new(jobs: &'a Jobs, caller: &'a Caller, study: Option<&'a Uid>, query: StoreQuery) -> Result<Self, ApiError> {
        let (deliver_to, place) = match query.deliver_to {
            Some(name) => (Some(name), "query.deliver_to"),
            None => (caller.deliver_to.clone(), "the token"),
        };
        if let Some(name) = &deliver_to {
            check_archive(jobs, name, place)?;
        }
        Ok(Self { jobs, caller, study, deliver_to })
    }
}

/// Store segmentations (STOW-RS).
///
/// Each becomes a job with the default parameters. An instance that was stored before, byte for byte, gives the job
/// that it gave then, as long as that is kept: so a request can be sent again after a fault.
#[utoipa::path(
    post, path = "/dicom-web/studies", tag = "dicomweb",
    params(StoreQuery),
    request_body(content((inline(super::params_schema::BytesSchema) = "multipart/related"))),
    responses(
        (status = 200, body = Object, content_type = DICOM_JSON, description = "Every instance is a job: ReferencedSOPSequence (00081199) has them with RetrieveURL (00081190)", headers(("Link" = String, description = "The jobs, `rel=\"monitor\"`: the first 32"))),
        (status = 202, body = Object, content_type = DICOM_JSON, description = "Some are, others stand in FailedSOPSequence (00081198) or OtherFailuresSequence (0008119A) with FailureReason (00081197)", headers(("Link" = String, description = "The jobs, `rel=\"monitor\"`: the first 32"))),
        (status = 409, body = Object, content_type = DICOM_JSON, description = "None is a job"),
        TokenProblems,
        StoreProblems,
        (status = 422, body = Problem, content_type = PROBLEM_JSON, description = "`unknown_pacs`")
    )
)]
pub async fn store(
    State(jobs): State<Arc<Jobs>>,
    allowed: Allowed<Write>,
    StrictQuery(query): StrictQuery<StoreQuery>,
    request: Request,
) -> Result<Response, ApiError> {
    let errand = Errand::new(&jobs, &allowed.caller, None, query)?;
    Ok(answer(&receive(&errand, request).await?))
}

/// Store segmentations of one study (STOW-RS).
///
/// As without the study; an instance of another one is not stored.
#[utoipa::path(
    post, path = "/dicom-web/studies/{study}", tag = "dicomweb",
    params(
        ("study" = String, Path, description = "Study Instance UID", max_length = 64, pattern = "^[0-9]+([.][0-9]+)*$"),
        StoreQuery
    ),
    request_body(content((inline(super::params_schema::BytesSchema) = "multipart/related"))),
    responses(
        (status = 200, body = Object, content_type = DICOM_JSON, description = "Every instance is a job", headers(("Link" = String, description = "The jobs, `rel=\"monitor\"`: the first 32"))),
        (status = 202, body = Object, content_type = DICOM_JSON, description = "Some are", headers(("Link" = String, description = "The jobs, `rel=\"monitor\"`: the first 32"))),
        (status = 409, body = Object, content_type = DICOM_JSON, description = "None is a job"),
        TokenProblems,
        StoreProblems,
        (status = 422, body = Problem, content_type = PROBLEM_JSON, description = "`invalid_uid`, `unknown_pacs`")
    )
)]
pub async fn store_in_study(
    State(jobs): State<Arc<Jobs>>,
    allowed: Allowed<Write>,
    study: Result<Path<String>, PathRejection>,
    StrictQuery(query): StrictQuery<StoreQuery>,
    request: Request,
) -> Result<Response, ApiError> {
    let study = study.map_or_else(|_| String::new(), |Path(study)| study);
    let study = uid("path.study", &study)?;
    let errand = Errand::new(&jobs, &allowed.caller, Some(&study), query)?;
    Ok(answer(&receive(&errand, request).await?))
}

/// Takes all instances of a request. What broke it leaves the jobs that were accepted before.
async fn receive(errand: &Errand<'_>, request: Request) -> Result<Vec<Stored>, ApiError> {
    let jobs = errand.jobs;
    refuse_encoded(request.headers())?;
    let boundary = boundary_of(header(request.headers(), CONTENT_TYPE).unwrap_or_default()).map_err(unusable)?;
    jobs.admit(errand.caller, 0, None).await?;
    // More than may wait is never accepted.
    let limits = MultipartLimits { max_bytes: jobs.limits().queue.bytes, max_parts: MAX_INSTANCES };
    let body = watched(request.into_body().into_data_stream(), jobs.limits().upload.idle);
    let mut parts = Parts::new(body, &boundary, limits);
    let deadline = Instant::now() + jobs.limits().upload.total;
    let mut stored = Vec::new();
    loop {
        // Small parts may come faster than the clock is asked below.
        if Instant::now() >= deadline {
            return Err(UploadError::TooSlow.into());
        }
        let next = timeout_at(deadline, parts.next_part()).await.map_err(|_| UploadError::TooSlow)?;
        let Some(part) = next.map_err(unusable)? else { break };
        let one = store_one(errand, (part, deadline)).await;
        // What keeps a file tells only that its bytes ended early.
        stored.push(one.map_err(|error| parts.fault().map_or(error, unusable))?);
    }
    if stored.is_empty() { Err(UploadError::Empty.into()) } else { Ok(stored) }
}

/// A body that ends with a fault where it pauses for longer than `idle`.
fn watched(body: BodyDataStream, idle: Duration) -> Chunks {
    Box::pin(stream::unfold(body, move |mut body| async move {
        let chunk = match timeout(idle, body.next()).await {
            Ok(chunk) => chunk?.map_err(|_| MultipartError::Broken),
            Err(_) => Err(MultipartError::TooSlow),
        };
        Some((chunk, body))
    }))
}

/// Takes one instance, until `deadline` at the most.
///
/// # Errors
/// What breaks the request as a whole.
async fn store_one(errand: &Errand<'_>, (mut part, deadline): (Part<'_, Chunks>, Instant)) -> Result<Stored, ApiError> {
    let jobs = errand.jobs;
    let head = timeout_at(deadline, part.peek(IDENTITY_BYTES)).await.map_err(|_| UploadError::TooSlow)?;
    let identity = Identity::of_head(head.map_err(unusable)?).unwrap_or_default();
    let is_segmentation = identity.is_segmentation();
    let (Some(class), Some(instance)) = (identity.class, identity.instance) else {
        return Ok(Stored { reference: None, outcome: Err(Failure::Refused) });
    };
    let outcome = if is_segmentation {
        let left = deadline.saturating_duration_since(Instant::now());
        let limits = UploadLimits { total: left, ..jobs.limits().upload };
        match upload::receive((jobs.blobs(), jobs.limits().min_free_bytes), limits, part).await {
            Ok(received) => submit(errand, received).await,
            Err(error @ (UploadError::Interrupted | UploadError::TooSlow)) => return Err(error.into()),
            Err(error) => Err(failure(error.into())),
        }
    } else {
        Err(Failure::OtherClass)
    };
    Ok(Stored { reference: Some((class, instance)), outcome })
}

async fn submit(errand: &Errand<'_>, upload: Received) -> Result<JobId, Failure> {
    // An archive that does not know whether its request arrived sends it again. The key is kept with the job: the hash
    // tells the instance apart without its UID, which leads to a patient.
    let mut key = format!("stow {}", upload.mask.sha256);
    if let Some(name) = &errand.deliver_to {
        key.push_str(&format!(" {name}"));
    }
    if let Err(failure) = check(errand, &key, &upload).await {
        upload.forget().await;
        return Err(failure);
    }
    let submission = Submission {
        upload,
        params: RequestedParams::parse(None).map_err(|_| Failure::OurFault)?,
        labels: [].into(),
        callback_url: None,
        deliver_to: errand.deliver_to.clone(),
        idempotency_key: Some(key),
        may_reuse: true,
    };
    let accepted = errand.jobs.submit(errand.caller, submission).await;
    accepted.map(|accepted| accepted.status.job.id).map_err(|error| failure(error.into()))
}

/// Whether there is room for an instance now, those before it counted, and it is of the study that the request is for.
async fn check(errand: &Errand<'_>, key: &str, upload: &Received) -> Result<(), Failure> {
    let Errand { jobs, caller, study, .. } = errand;
    jobs.admit(caller, upload.mask.bytes, Some(key)).await.map_err(|error| failure(error.into()))?;
    let Some(study) = *study else { return Ok(()) };
    let file = upload.file.to_path_buf();
    let found = on_own_thread(move || Identity::of_file(File::open(file)?)).await;
    let found = found.map_err(|error| failure(UploadError::Storage(error).into()))?;
    if found.and_then(|identity| identity.study).as_ref() == Some(study) {
        return Ok(());
    }
    tracing::info!("an instance that is of another study than its request was not stored");
    Err(Failure::Refused)
}

/// The reason that comes nearest to a problem, whose code is logged.
fn failure(error: ApiError) -> Failure {
    let problem = error.problem();
    tracing::info!(code = problem.code, "an instance was not stored");
    match (problem.status, problem.code.as_str()) {
        (413 | 429 | 503 | 507, _) => Failure::NoRoom,
        (500.., _) => Failure::OurFault,
        (_, "unsupported_transfer_syntax") => Failure::TransferSyntax,
        _ => Failure::Refused,
    }
}

/// As PS3.18 section 10.5.3 has it, in the JSON of its annex F.
fn answer(stored: &[Stored]) -> Response {
    let (mut accepted, mut failed, mut unknown, mut links) = (Vec::new(), Vec::new(), Vec::new(), Vec::new());
    for Stored { reference, outcome } in stored {
        let mut item = json!({});
        if let Some((class, instance)) = reference {
            item["00081150"] = element("UI", class.as_str().into());
            item["00081155"] = element("UI", instance.as_str().into());
        }
        match outcome {
            Ok(id) => {
                item["00081190"] = element("UR", path_of(*id).into());
                links.push(format!("<{}>; rel=\"monitor\"", path_of(*id)));
                accepted.push(item);
            }
            Err(reason) => {
                item["00081197"] = element("US", (*reason as u16).into());
                if reference.is_some() { failed.push(item) } else { unknown.push(item) }
            }
        }
    }
    let status = match (accepted.len(), failed.len() + unknown.len()) {
        (0, _) => StatusCode::CONFLICT,
        (_, 0) => StatusCode::OK,
        _ => StatusCode::ACCEPTED,
    };
    // There is nothing to be retrieved of the study.
    let mut body = json!({"00081190": {"vr": "UR"}});
    for (tag, items) in [("00081198", failed), ("00081199", accepted), ("0008119A", unknown)] {
        if !items.is_empty() {
            body[tag] = json!({"vr": "SQ", "Value": items});
        }
    }
    links.truncate(MAX_LINKS);
    let mut headers = HeaderMap::new();
    headers.insert(CONTENT_TYPE, HeaderValue::from_static(DICOM_JSON));
    if let Ok(link) = HeaderValue::from_str(&links.join(", "))
        && !link.is_empty()
    {
        headers.insert(LINK, link);
    }
    (status, headers, Json(body)).into_response()
}

fn element(kind: &str, value: Value) -> Value {
    json!({"vr": kind, "Value": [value]})
}

fn unusable(error: MultipartError) -> ApiError {
    match error {
        MultipartError::NotMultipart => Problem::new(415, "not_multipart_dicom", error.to_string())
            .at("header Content-Type")
            .hint("send multipart/related; type=\"application/dicom\"; boundary=…, as STOW-RS has it")
            .into(),
        MultipartError::TooLarge { limit } => too_large(limit),
        MultipartError::CutOff | MultipartError::Broken => UploadError::Interrupted.into(),
        MultipartError::TooSlow => UploadError::TooSlow.into(),
        error => Problem::new(400, "invalid_multipart", error.to_string())
            .at("body")
            .hint("send parts of application/dicom between boundaries, as STOW-RS has it")
            .into(),
    }
}
