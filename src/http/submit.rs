//! Takes a mask and what to do with it out of a request: a raw body, a form, or JSON that says where the mask is.

use std::collections::BTreeMap;
use std::future::Future;
use std::io;
use std::mem::take;
use std::pin::Pin;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::task::{Context, Poll, ready};

use axum::body::{Body, BodyDataStream, Bytes};
use axum::extract::multipart::{Field, Multipart, MultipartError};
use axum::extract::{DefaultBodyLimit, FromRequest, Request};
use axum::http::header::{CACHE_CONTROL, CONTENT_DISPOSITION, CONTENT_ENCODING, CONTENT_LENGTH, CONTENT_TYPE};
use axum::http::{HeaderMap, HeaderName};
use futures_util::{Stream, StreamExt};
use tokio::time::timeout;

use super::error::{ApiError, too_large, unknown_pacs};
use super::extract::{has_token, header, list_header, media_range};
use super::params_schema::SubmitQuery;
use super::source::SourceSubmission;
use crate::formats::params_json::MAX_BYTES as MAX_TEXT_BYTES;
use crate::jobs::caller::Caller;
use crate::jobs::job::RequestedParams;
use crate::jobs::service::Jobs;
use crate::jobs::source::SourceError;
use crate::jobs::submission::Submission;
use crate::jobs::upload::{self, Received, UploadError};
use crate::media_type::parameter;
use crate::name::{MAX_NAME, is_name};
use crate::problem::Problem;

/// What a form may hold beside the mask.
const FORM_OVERHEAD_BYTES: u64 = 1 << 20;
/// Bytes of a form that may wait to be understood. The parser keeps in memory what it reads ahead
/// and what it finds no end of: a part's headers, a gap between parts. It searches all of that anew with
/// every piece, so more would cost time too.
const FORM_BACKLOG_BYTES: u64 = 256 << 10;
/// Bytes of a form that the parser gets at a time.
const FORM_PIECE_BYTES: usize = 32 << 10;
/// Longest idempotency key.
const MAX_KEY_BYTES: usize = 255;
/// Labels of one job.
const MAX_LABELS: usize = 16;
/// Longest value of a label, characters.
const MAX_LABEL_VALUE: usize = 256;

const IDEMPOTENCY_KEY: HeaderName = HeaderName::from_static("idempotency-key");

/// Reads the request. Everything that can be refused before the body is read is.
///
/// # Errors
/// When the request is malformed or too large, what it asks for is refused, or there is no room.
pub async fn receive(
    jobs: &Jobs,
    caller: &Caller,
    query: SubmitQuery,
    request: Request,
) -> Result<Submission, ApiError> {
    let headers = request.headers();
    refuse_encoded(headers)?;
    let kind = header(headers, CONTENT_TYPE).map(|kind| media_range(kind).0).unwrap_or_default();
    let is_form = kind == "multipart/form-data";
    let length = refuse_large(headers, jobs.limits().upload.max_bytes, is_form)?;
    let idempotency_key = idempotency_key(headers)?;
    let may_reuse = !has_token(&list_header(headers, CACHE_CONTROL), "no-cache");
    let mut asked = Asked::default();
    for (name, text) in [
        ("params", query.params),
        ("labels", query.labels),
        ("callback_url", query.callback_url),
        ("deliver_to", query.deliver_to),
    ] {
        if let Some(text) = text {
            asked.set(jobs, name, text.as_bytes())?;
        }
    }
    jobs.admit(caller, length, idempotency_key.as_deref()).await?;
    let upload = if is_form {
        let understood = Arc::new(AtomicU64::new(0));
        let form = Multipart::from_request(bounded(request, Arc::clone(&understood)), &()).await;
        let form = form.map_err(|rejection| invalid_form(rejection.body_text()))?;
        receive_form(jobs, &mut asked, form, &understood).await?
    } else if kind == "application/json" {
        let submission = SourceSubmission::read(jobs, request.into_body().into_data_stream()).await?;
        fetch(jobs, &mut asked, &submission).await?
    } else {
        let body = request.into_body().into_data_stream();
        upload::receive((jobs.blobs(), jobs.limits().min_free_bytes), jobs.limits().upload, body).await?
    };
    let params = asked.params.map_or_else(|| RequestedParams::parse(None), Ok)?;
    let Asked { labels, callback_url, deliver_to, .. } = asked;
    let labels = labels.unwrap_or_default();
    Ok(Submission { upload, params, labels, callback_url, deliver_to, idempotency_key, may_reuse })
}

/// What is asked for beside the mask, each thing once.
#[derive(Default)]
struct Asked {
    params: Option<RequestedParams>,
    labels: Option<BTreeMap<String, String>>,
    callback_url: Option<String>,
    deliver_to: Option<String>,
}

impl Asked {
    fn set(&mut self, jobs: &Jobs, name: &str, text: &[u8]) -> Result<(), ApiError> {
        let is_there = match name {
            "params" => self.params.replace(RequestedParams::parse(Some(text))?).is_some(),
            "labels" => self.labels.replace(parse_labels(text)?).is_some(),
            "deliver_to" => self.deliver_to.replace(parse_archive(jobs, text)?).is_some(),
            _ => self.callback_url.replace(parse_callback(jobs, text)?).is_some(),
        };
        if is_there { Err(given_twice()) } else { Ok(()) }
    }
}

/// Fetches the mask of a submission that says where it is. All else that it says is checked first.
async fn fetch(jobs: &Jobs, asked: &mut Asked, submission: &SourceSubmission) -> Result<Received, ApiError> {
    let texts = [
        ("params", submission.params.as_ref().map(|json| json.get())),
        ("labels", submission.labels.as_ref().map(|json| json.get())),
        ("callback_url", submission.callback_url.as_deref()),
        ("deliver_to", submission.deliver_to.as_deref()),
    ];
    for (name, text) in texts {
        if let Some(text) = text {
            asked.set(jobs, name, text.as_bytes())?;
        }
    }
    let source = &submission.source.dicomweb;
    Ok(jobs.fetch(&source.server, &source.wanted()?).await?)
}

async fn receive_form(
    jobs: &Jobs,
    asked: &mut Asked,
    mut form: Multipart,
    understood: &AtomicU64,
) -> Result<Received, ApiError> {
    let mut mask = None;
    while let Some(field) = in_time(jobs, form.next_field()).await?.map_err(|e| broken_form(&e))? {
        // A file name beside the field's may hold any bytes.
        let disposition =
            field.headers().get(CONTENT_DISPOSITION).map(|value| String::from_utf8_lossy(value.as_bytes()));
        match disposition.and_then(|text| parameter(&text, "name")).as_deref() {
            Some("mask") if mask.is_none() => {
                let count = |chunk: &Result<Bytes, _>| {
                    understood.fetch_add(chunk.as_ref().map_or(0, |bytes| bytes.len() as u64), Ordering::Relaxed);
                };
                mask = Some(
                    upload::receive(
                        (jobs.blobs(), jobs.limits().min_free_bytes),
                        jobs.limits().upload,
                        field.inspect(count),
                    )
                    .await?,
                );
            }
            Some("mask") => return Err(given_twice()),
            Some(name @ ("params" | "labels" | "callback_url" | "deliver_to")) => {
                let text = in_time(jobs, read_text(field)).await??;
                asked.set(jobs, name, &text)?;
            }
            _ => return Err(invalid_form("a field is none of mask, params, labels, callback_url and deliver_to")),
        }
    }
    mask.ok_or_else(|| invalid_form("the field mask is missing"))
}

fn given_twice() -> ApiError {
    Problem::new(400, "invalid_multipart", "mask, params, labels, callback_url or deliver_to is given twice")
        .at("query and body")
        .hint("give each once, in the query or in the body (form or JSON)")
        .into()
}

fn idempotency_key(headers: &HeaderMap) -> Result<Option<String>, ApiError> {
    let Some(key) = headers.get(IDEMPOTENCY_KEY) else { return Ok(None) };
    let key = key.to_str().ok().filter(|key| (1..=MAX_KEY_BYTES).contains(&key.len()));
    match key {
        Some(key) => Ok(Some(key.to_owned())),
        None => Err(Problem::new(400, "invalid_idempotency_key", "the key is empty, too long or not ASCII")
            .at("header Idempotency-Key")
            .hint(format!("send 1 to {MAX_KEY_BYTES} visible ASCII characters, a UUID say"))
            .into()),
    }
}

fn parse_labels(text: &[u8]) -> Result<BTreeMap<String, String>, ApiError> {
    let problem = |detail: &str| {
        let hint = format!(
            "send a JSON object of at most {MAX_LABELS} strings; names have 1 to {MAX_NAME} letters, digits, \
             dots, hyphens and underscores, values at most {MAX_LABEL_VALUE} characters"
        );
        ApiError::from(Problem::new(422, "invalid_labels", detail).at("labels").hint(hint))
    };
    let labels: BTreeMap<String, String> =
        serde_json::from_slice(text).map_err(|_| problem("the labels are no JSON object of strings"))?;
    let is_value = |value: &str| value.chars().count() <= MAX_LABEL_VALUE && !value.chars().any(char::is_control);
    if labels.len() > MAX_LABELS {
        return Err(problem("there are too many labels"));
    }
    if !labels.iter().all(|(name, value)| is_name(name) && is_value(value)) {
        return Err(problem("a label's name or value is not allowed"));
    }
    Ok(labels)
}

fn parse_archive(jobs: &Jobs, text: &[u8]) -> Result<String, ApiError> {
    // What is no text is no name.
    let name = String::from_utf8_lossy(text);
    check_archive(jobs, &name, "deliver_to")?;
    Ok(name.into_owned())
}

/// Whether results can go to the archive whose name stands at `place`.
///
/// # Errors
/// When there is none of this name.
pub(super) fn check_archive(jobs: &Jobs, name: &str, place: &str) -> Result<(), ApiError> {
    jobs.check_pacs(name).map_err(|error| match error {
        SourceError::UnknownServer { known } => unknown_pacs(&known, place),
        error => error.into(),
    })
}

fn parse_callback(jobs: &Jobs, text: &[u8]) -> Result<String, ApiError> {
    let refused = |detail: String| {
        let problem = Problem::new(422, "callback_not_allowed", detail).at("callback_url");
        ApiError::from(problem.hint("use a URL that the server's operator has listed with --webhook-targets"))
    };
    let Some(webhooks) = jobs.webhooks() else {
        return Err(refused("this server sends no webhooks".to_owned()));
    };
    let url = std::str::from_utf8(text).map_err(|_| refused("the URL is not UTF-8".to_owned()))?;
    let checked = webhooks.targets().check(url).map_err(|error| refused(error.to_string()))?;
    Ok(checked.as_str().to_owned())
}

async fn read_text(mut field: Field<'_>) -> Result<Vec<u8>, ApiError> {
    let mut text = Vec::new();
    while let Some(chunk) = field.chunk().await.map_err(|e| broken_form(&e))? {
        text.extend_from_slice(&chunk);
        if text.len() > MAX_TEXT_BYTES {
            return Err(invalid_form(format!("a field beside the mask is longer than {MAX_TEXT_BYTES} bytes")));
        }
    }
    Ok(text)
}

async fn in_time<T>(jobs: &Jobs, reading: impl Future<Output = T>) -> Result<T, ApiError> {
    timeout(jobs.limits().upload.idle, reading).await.map_err(|_| UploadError::TooSlow.into())
}

/// A body that a proxy or a client compressed on the way would have to be unpacked without a
/// bound before anything is known of it.
pub(super) fn refuse_encoded(headers: &HeaderMap) -> Result<(), ApiError> {
    match &list_header(headers, CONTENT_ENCODING) {
        codings if codings.is_empty() || codings.eq_ignore_ascii_case("identity") => Ok(()),
        _ => Err(Problem::new(415, "content_encoding", "the body has a Content-Encoding")
            .at("header Content-Encoding")
            .hint("send the body as it is, without Content-Encoding; a mask may be a compressed file (.nii.gz)")
            .into()),
    }
}

/// The length that is said, 0 when it is not.
fn refuse_large(headers: &HeaderMap, max_bytes: u64, is_form: bool) -> Result<u64, ApiError> {
    let length = header(headers, CONTENT_LENGTH).and_then(|text| text.parse::<u64>().ok()).unwrap_or(0);
    let limit = if is_form { max_bytes.saturating_add(FORM_OVERHEAD_BYTES) } else { max_bytes };
    if length > limit { Err(too_large(max_bytes)) } else { Ok(length) }
}

/// Bounds what the parser keeps in memory. It takes all that there is before it looks at any of it, so
/// there is one piece at a time. The framework's own limit, on the whole body, is off: ours counts the
/// mask while it streams.
fn bounded(mut request: Request, understood: Arc<AtomicU64>) -> Request {
    DefaultBodyLimit::disable().apply(&mut request);
    request.map(|body| {
        let chunks = body.into_data_stream();
        Body::from_stream(Pieces { chunks, rest: Bytes::new(), passed: 0, is_pause_due: false, understood })
    })
}

/// A body in pieces, after each of which the parser gets time to look at it.
struct Pieces {
    chunks: BodyDataStream,
    /// Of the last chunk.
    rest: Bytes,
    /// Bytes given to the parser.
    passed: u64,
    is_pause_due: bool,
    /// Bytes that the parser has let go of.
    understood: Arc<AtomicU64>,
}

impl Stream for Pieces {
    type Item = io::Result<Bytes>;

    fn poll_next(mut self: Pin<&mut Self>, context: &mut Context<'_>) -> Poll<Option<io::Result<Bytes>>> {
        if take(&mut self.is_pause_due) {
            context.waker().wake_by_ref();
            return Poll::Pending;
        }
        if self.rest.is_empty() {
            match ready!(self.chunks.poll_next_unpin(context)) {
                Some(Ok(chunk)) => self.rest = chunk,
                Some(Err(error)) => return Poll::Ready(Some(Err(io::Error::other(error)))),
                None => return Poll::Ready(None),
            }
        }
        Poll::Ready(Some(self.next_piece()))
    }
}

impl Pieces {
    fn next_piece(&mut self) -> io::Result<Bytes> {
        let length = self.rest.len().min(FORM_PIECE_BYTES);
        let piece = self.rest.split_to(length);
        self.is_pause_due = true;
        self.passed += piece.len() as u64;
        let backlog = self.passed.saturating_sub(self.understood.load(Ordering::Relaxed));
        if backlog <= FORM_BACKLOG_BYTES { Ok(piece) } else { Err(io::ErrorKind::InvalidData.into()) }
    }
}

fn broken_form(error: &MultipartError) -> ApiError {
    if error.status().is_client_error() { invalid_form(error.body_text()) } else { UploadError::Interrupted.into() }
}

fn invalid_form(detail: impl Into<String>) -> ApiError {
    Problem::new(400, "invalid_multipart", detail)
        .at("body")
        .hint("send a form with the file field mask and, if wanted, params and labels (JSON), callback_url and deliver_to")
        .into()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[tokio::test]
    async fn a_form_that_is_understood_passes_in_pieces_and_whole() {
        let understood = Arc::new(AtomicU64::new(0));
        let sent: Vec<u8> = (0..=250).cycle().take(1 << 20).collect();
        let request = bounded(Request::new(Body::from(sent.clone())), Arc::clone(&understood));
        let mut pieces = request.into_body().into_data_stream();
        let mut received = Vec::new();
        while let Some(piece) = pieces.next().await {
            let piece = piece.unwrap();
            assert!(piece.len() <= FORM_PIECE_BYTES);
            understood.fetch_add(piece.len() as u64, Ordering::Relaxed);
            received.extend(piece);
        }
        assert!(received == sent);
    }
}
