//! Searches for DICOM results (QIDO-RS, PS3.18 section 10.6): studies, series and instances, newest first.

use axum::Json;
use axum::http::HeaderValue;
use axum::http::header::{CONTENT_TYPE, WARNING};
use axum::response::{IntoResponse, Response};

use super::accept::Accepted;
use super::auth::{TokenProblems, TooManyRequests};
use super::dicom_path::{DicomRequest, SeriesParam, StudyParam, path_of};
use super::error::ApiError;
use crate::dicomweb::entries::{Level, RETRIEVE_URL};
use crate::dicomweb::json::{Attributes, DICOM_JSON, attribute, key};
use crate::dicomweb::query::{Query, QueryError};
use crate::jobs::objects::{Found, FoundObject};
use crate::problem::Problem;

/// Parameters of every search, described.
#[derive(utoipa::IntoParams)]
#[into_params(parameter_in = Query)]
#[expect(dead_code, reason = "describes what Query::parse takes")]
pub struct SearchParams {
    /// Results wanted at the most; the server gives 1000
    limit: Option<u32>,
    /// Results that are passed over
    offset: Option<u32>,
    /// Attributes to be told beside those that always are: keywords or tags with commas between, or `all`
    includefield: Option<String>,
    /// Names that sound alike are not found: `true` is answered with a warning
    fuzzymatching: Option<bool>,
    /// Media type, in place of the header
    accept: Option<String>,
    /// An attribute to match, here PatientID: any of those that api.md lists, by keyword or tag
    #[param(rename = "PatientID")]
    patient_id: Option<String>,
}

/// What every search may answer; only described, never made.
#[derive(utoipa::IntoResponses)]
#[expect(dead_code, reason = "describes answers, is none")]
pub enum SearchProblems {
    /// `invalid_query`
    #[response(status = 400, content_type = "application/problem+json")]
    Malformed(Problem),
    /// `not_acceptable`
    #[response(status = 406, content_type = "application/problem+json")]
    OtherKind(Problem),
}

/// `invalid_uid`
#[derive(utoipa::IntoResponses)]
#[response(status = 422, content_type = "application/problem+json")]
#[expect(dead_code, reason = "describes an answer, is none")]
pub struct InvalidUid(Problem);

/// Search studies with DICOM results (QIDO-RS).
///
/// What is not known to the search is ignored, which `Warning: 299` says; so it does when not all results were looked at.
#[utoipa::path(
    get, path = "/dicom-web/studies", tag = "dicomweb", params(SearchParams),
    responses(
        (status = 200, body = [Object], content_type = DICOM_JSON, description = "Studies, newest first; an empty list where there are none", headers(("Warning" = String, description = "What was not looked at"))),
        TokenProblems, TooManyRequests, SearchProblems
    )
)]
pub async fn studies(request: DicomRequest) -> Result<Response, ApiError> {
    search(request, Level::Study).await
}

/// Search series of DICOM results (QIDO-RS).
#[utoipa::path(
    get, path = "/dicom-web/series", tag = "dicomweb", params(SearchParams),
    responses(
        (status = 200, body = [Object], content_type = DICOM_JSON, description = "Series, newest first", headers(("Warning" = String, description = "What was not looked at"))),
        TokenProblems, TooManyRequests, SearchProblems
    )
)]
pub async fn series(request: DicomRequest) -> Result<Response, ApiError> {
    search(request, Level::Series).await
}

/// Search DICOM results (QIDO-RS).
#[utoipa::path(
    get, path = "/dicom-web/instances", tag = "dicomweb", params(SearchParams),
    responses(
        (status = 200, body = [Object], content_type = DICOM_JSON, description = "Instances, newest first", headers(("Warning" = String, description = "What was not looked at"))),
        TokenProblems, TooManyRequests, SearchProblems
    )
)]
pub async fn instances(request: DicomRequest) -> Result<Response, ApiError> {
    search(request, Level::Instance).await
}

/// Search series of a study (QIDO-RS).
#[utoipa::path(
    get, path = "/dicom-web/studies/{study}/series", tag = "dicomweb", params(StudyParam, SearchParams),
    responses(
        (status = 200, body = [Object], content_type = DICOM_JSON, description = "Series, newest first", headers(("Warning" = String, description = "What was not looked at"))),
        TokenProblems, TooManyRequests, SearchProblems, InvalidUid
    )
)]
pub async fn series_of_study(request: DicomRequest) -> Result<Response, ApiError> {
    search(request, Level::Series).await
}

/// Search DICOM results of a study (QIDO-RS).
#[utoipa::path(
    get, path = "/dicom-web/studies/{study}/instances", tag = "dicomweb", params(StudyParam, SearchParams),
    responses(
        (status = 200, body = [Object], content_type = DICOM_JSON, description = "Instances, newest first", headers(("Warning" = String, description = "What was not looked at"))),
        TokenProblems, TooManyRequests, SearchProblems, InvalidUid
    )
)]
pub async fn instances_of_study(request: DicomRequest) -> Result<Response, ApiError> {
    search(request, Level::Instance).await
}

/// Search DICOM results of a series (QIDO-RS).
#[utoipa::path(
    get, path = "/dicom-web/studies/{study}/series/{series}/instances", tag = "dicomweb",
    params(StudyParam, SeriesParam, SearchParams),
    responses(
        (status = 200, body = [Object], content_type = DICOM_JSON, description = "Instances, newest first", headers(("Warning" = String, description = "What was not looked at"))),
        TokenProblems, TooManyRequests, SearchProblems, InvalidUid
    )
)]
pub async fn instances_of_series(request: DicomRequest) -> Result<Response, ApiError> {
    search(request, Level::Instance).await
}

async fn search(request: DicomRequest, level: Level) -> Result<Response, ApiError> {
    let DicomRequest { jobs, allowed, path, parameters, accepted } = request;
    if !is_json_accepted(&accepted) {
        return Err(not_acceptable(DICOM_JSON));
    }
    let query = Query::parse(level, &parameters).map_err(malformed)?;
    let found = jobs.search(&allowed.caller, &path, &query).await?;
    let notes = notes(&query, &found);
    let results: Vec<Attributes> = found.results.into_iter().map(|result| with_url(result, level)).collect();
    let mut answer = Json(results).into_response();
    answer.headers_mut().insert(CONTENT_TYPE, HeaderValue::from_static(DICOM_JSON));
    for note in notes {
        answer.headers_mut().append(WARNING, note);
    }
    Ok(answer)
}

fn with_url(result: FoundObject, level: Level) -> Attributes {
    let mut attributes = result.attributes;
    attributes.insert(key(RETRIEVE_URL), attribute("UR", vec![path_of(&result.object, level).into()]));
    attributes
}

/// What whoever asks should know of the search, as values of Warning.
fn notes(query: &Query, found: &Found) -> Vec<HeaderValue> {
    let mut notes = query.notes().to_vec();
    if found.is_cut {
        notes.push(CUT.to_owned());
    }
    if found.has_more {
        notes.push("There are additional results that can be requested".to_owned());
    }
    if found.unread > 0 {
        notes.push(format!("{} results could not be read", found.unread));
    }
    notes.iter().map(|note| warning(note)).collect()
}

/// What is told where not all results were looked at.
pub const CUT: &str = "Only the newest results were looked at. Name a series or an instance to find older ones.";

/// A note as a value of Warning (RFC 7234, section 5.5). It is ASCII without quotes.
pub fn warning(note: &str) -> HeaderValue {
    let text = format!("299 medialrep \"{note}\"");
    HeaderValue::from_str(&text).unwrap_or(HeaderValue::from_static("299 medialrep \"a note that cannot be sent\""))
}

/// Whether attributes may be sent as the JSON of DICOM.
pub fn is_json_accepted(accepted: &Accepted) -> bool {
    accepted.has(DICOM_JSON) || accepted.has("application/json")
}

/// What is sent is not what is accepted.
pub fn not_acceptable(sent: &str) -> ApiError {
    let problem = Problem::new(406, "not_acceptable", "the answer is in no media type that is accepted");
    problem.at("header Accept").hint(format!("accept {sent}")).into()
}

fn malformed(error: QueryError) -> ApiError {
    Problem::new(400, "invalid_query", "a parameter of the search is malformed or given twice")
        .at(format!("query.{}", error.name))
        .hint(format!("send {}", error.wanted))
        .into()
}
