//! A submission that says where its mask is, in place of the mask.

use axum::body::BodyDataStream;
use futures_util::StreamExt;
use serde::Deserialize;
use serde_json::value::RawValue;
use tokio::time::timeout;

use super::error::ApiError;
use crate::dicomweb::Wanted;
use crate::formats::Uid;
use crate::jobs::service::Jobs;
use crate::jobs::upload::UploadError;
use crate::problem::Problem;

/// Longest body: parameters and labels of the greatest length, and some white space.
const MAX_BYTES: usize = 256 << 10;

/// A submission in JSON.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SourceSubmission {
    /// Where the mask is.
    pub source: Source,
    /// As the field of a form.
    pub params: Option<Box<RawValue>>,
    /// As the field of a form.
    pub labels: Option<Box<RawValue>>,
    /// As the field of a form.
    pub callback_url: Option<String>,
    /// As the field of a form.
    pub deliver_to: Option<String>,
}

/// Where a mask is.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Source {
    /// In an archive.
    pub dicomweb: DicomwebSource,
}

/// Where a mask is in an archive.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct DicomwebSource {
    /// The archive, by the name that the operator gave it.
    pub server: String,
    /// Study Instance UID.
    study: String,
    /// Series Instance UID.
    series: String,
    /// SOP Instance UID.
    instance: Option<String>,
}

impl SourceSubmission {
    /// Reads all of a body.
    ///
    /// # Errors
    /// When it does not come, is too long, or is no such JSON.
    pub async fn read(jobs: &Jobs, mut body: BodyDataStream) -> Result<Self, ApiError> {
        let text =
            timeout(jobs.limits().upload.idle, read_all(&mut body)).await.map_err(|_| UploadError::TooSlow)??;
        // What the parser says may repeat the text.
        serde_json::from_slice(&text).map_err(|error| {
            let fault = if error.is_data() { "is no submission" } else { "is malformed" };
            malformed(format!("the JSON {fault}, seen in line {}, column {}", error.line(), error.column()))
        })
    }
}

impl DicomwebSource {
    /// What is to be fetched.
    ///
    /// # Errors
    /// When an identifier is none.
    pub fn wanted(&self) -> Result<Wanted, ApiError> {
        let instance = self.instance.as_deref().map(|text| uid("source.dicomweb.instance", text)).transpose()?;
        let study = uid("source.dicomweb.study", &self.study)?;
        Ok(Wanted { study, series: uid("source.dicomweb.series", &self.series)?, instance })
    }
}

async fn read_all(body: &mut BodyDataStream) -> Result<Vec<u8>, ApiError> {
    let mut text = Vec::new();
    while let Some(chunk) = body.next().await {
        text.extend_from_slice(&chunk.map_err(|_| UploadError::Interrupted)?);
        if text.len() > MAX_BYTES {
            return Err(malformed(format!("the JSON is longer than {MAX_BYTES} bytes")));
        }
    }
    Ok(text)
}

/// A UID that stands at `place` of a request.
///
/// # Errors
/// When it is none.
pub fn uid(place: &str, text: &str) -> Result<Uid, ApiError> {
    Uid::parse(text).ok_or_else(|| invalid_uid(place))
}

/// What stands at `place` of a request is no UID.
pub fn invalid_uid(place: &str) -> ApiError {
    Problem::new(422, "invalid_uid", "this is no unique identifier of DICOM")
        .at(place)
        .hint("a UID is numbers with dots between them, at most 64 characters: 1.2.840.113619.2.1")
        .into()
}

fn malformed(detail: String) -> ApiError {
    Problem::new(400, "invalid_submission", detail)
        .at("body")
        .hint(
            "send {\"source\": {\"dicomweb\": {\"server\": NAME, \"study\": UID, \"series\": UID, \"instance\": UID}}} \
             and, if wanted, params and labels (objects), callback_url and deliver_to; the instance may be left out. A mask itself \
             is sent without Content-Type: application/json",
        )
        .into()
}
