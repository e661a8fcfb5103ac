//! Takes a mask and its parameters out of a request: a raw body or a form.

use std::future::Future;
use std::io;
use std::mem::take;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::task::{Poll, ready};

use axum::body::{Body, Bytes};
use axum::extract::multipart::{Field, Multipart, MultipartError};
use axum::extract::{DefaultBodyLimit, FromRequest, Request};
use axum::http::header::{CONTENT_ENCODING, CONTENT_LENGTH, CONTENT_TYPE};
use axum::http::{HeaderMap, HeaderName};
use futures_util::StreamExt;
use futures_util::stream::poll_fn;
use tokio::time::timeout;

use super::error::{ApiError, too_large};
use crate::formats::params_json::MAX_BYTES as MAX_PARAMS_BYTES;
use crate::jobs::job::RequestedParams;
use crate::jobs::queue::Jobs;
use crate::jobs::upload::{self, Received, UploadError};
use crate::problem::Problem;

/// What a form may hold beside the mask.
const FORM_OVERHEAD_BYTES: u64 = 1 << 20;
/// Bytes of a form that may wait to be understood. The parser keeps in memory what it reads ahead
/// and what it finds no end of: a part's headers, a gap between parts. It searches all of that anew with
/// every piece, so more would cost time too.
const FORM_BACKLOG_BYTES: u64 = 256 << 10;
/// Bytes of a form that the parser gets at a time.
const FORM_PIECE_BYTES: usize = 32 << 10;

/// A mask on disk and what to do with it.
pub struct Submission {
    /// The mask.
    pub mask: Received,
    /// What to do with it.
    pub params: RequestedParams,
}

/// Reads the request. Everything that can be refused before the body is read is.
///
/// # Errors
/// When the request is malformed or too large, the parameters are refused, or the queue is full.
pub async fn receive(jobs: &Jobs, query_params: Option<&str>, request: Request) -> Result<Submission, ApiError> {
    let headers = request.headers();
    refuse_encoded(headers)?;
    let is_form = header(headers, CONTENT_TYPE).is_some_and(|kind| kind.starts_with("multipart/form-data"));
    refuse_large(headers, jobs.limits().upload.max_bytes, is_form)?;
    let params = query_params.map(|json| RequestedParams::parse(Some(json.as_bytes()))).transpose()?;
    jobs.check_room().await?;
    if is_form {
        let understood = Arc::new(AtomicU64::new(0));
        let form = Multipart::from_request(bounded(request, Arc::clone(&understood)), &()).await;
        let form = form.map_err(|rejection| invalid_form(rejection.body_text()))?;
        return receive_form(jobs, params, form, &understood).await;
    }
    let body = request.into_body().into_data_stream();
    let mask = upload::receive(jobs.blobs(), jobs.limits().upload, body).await?;
    Ok(Submission { mask, params: params.map_or_else(|| RequestedParams::parse(None), Ok)? })
}

async fn receive_form(
    jobs: &Jobs,
    mut params: Option<RequestedParams>,
    mut form: Multipart,
    understood: &AtomicU64,
) -> Result<Submission, ApiError> {
    let mut mask = None;
    while let Some(field) = in_time(jobs, form.next_field()).await?.map_err(|e| broken_form(&e))? {
        match field.name() {
            Some("mask") if mask.is_none() => {
                let count = |chunk: &Result<Bytes, _>| {
                    understood.fetch_add(chunk.as_ref().map_or(0, |bytes| bytes.len() as u64), Ordering::Relaxed);
                };
                mask = Some(upload::receive(jobs.blobs(), jobs.limits().upload, field.inspect(count)).await?);
            }
            Some("params") if params.is_none() => {
                let json = in_time(jobs, read_params(field)).await??;
                params = Some(RequestedParams::parse(Some(&json))?);
            }
            Some("mask" | "params") => return Err(invalid_form("mask or params is given twice")),
            _ => return Err(invalid_form("a field is neither mask nor params")),
        }
    }
    let mask = mask.ok_or_else(|| invalid_form("the field mask is missing"))?;
    Ok(Submission { mask, params: params.map_or_else(|| RequestedParams::parse(None), Ok)? })
}

async fn read_params(mut field: Field<'_>) -> Result<Vec<u8>, ApiError> {
    let mut json = Vec::new();
    while let Some(chunk) = field.chunk().await.map_err(|e| broken_form(&e))? {
        json.extend_from_slice(&chunk);
        if json.len() > MAX_PARAMS_BYTES {
            return Err(invalid_form(format!("params is longer than {MAX_PARAMS_BYTES} bytes")));
        }
    }
    Ok(json)
}

async fn in_time<T>(jobs: &Jobs, reading: impl Future<Output = T>) -> Result<T, ApiError> {
    timeout(jobs.limits().upload.idle, reading).await.map_err(|_| UploadError::TooSlow.into())
}

/// A body that a proxy or a client compressed on the way would have to be unpacked without a
/// bound before anything is known of it.
fn refuse_encoded(headers: &HeaderMap) -> Result<(), ApiError> {
    match header(headers, CONTENT_ENCODING) {
        None | Some("identity") => Ok(()),
        Some(_) => Err(Problem::new(415, "content_encoding", "the body has a Content-Encoding")
            .at("header Content-Encoding")
            .hint("send the .nii.gz itself as the body, without Content-Encoding")
            .into()),
    }
}

fn refuse_large(headers: &HeaderMap, max_bytes: u64, is_form: bool) -> Result<(), ApiError> {
    let length = header(headers, CONTENT_LENGTH).and_then(|text| text.parse::<u64>().ok());
    let limit = if is_form { max_bytes.saturating_add(FORM_OVERHEAD_BYTES) } else { max_bytes };
    if length.is_some_and(|length| length > limit) { Err(too_large(max_bytes)) } else { Ok(()) }
}

/// Bounds what the parser keeps in memory. It takes all that there is before it looks at any of it, so
/// there is one piece at a time. The framework's own limit, on the whole body, is off: ours counts the
/// mask while it streams.
fn bounded(mut request: Request, understood: Arc<AtomicU64>) -> Request {
    DefaultBodyLimit::disable().apply(&mut request);
    request.map(|body| {
        let (mut chunks, mut rest) = (body.into_data_stream(), Bytes::new());
        let (mut passed, mut is_pause_due) = (0, false);
        Body::from_stream(poll_fn(move |context| {
            if take(&mut is_pause_due) {
                context.waker().wake_by_ref();
                return Poll::Pending;
            }
            if rest.is_empty() {
                match ready!(chunks.poll_next_unpin(context)) {
                    Some(Ok(chunk)) => rest = chunk,
                    Some(Err(error)) => return Poll::Ready(Some(Err(io::Error::other(error)))),
                    None => return Poll::Ready(None),
                }
            }
            let piece = rest.split_to(rest.len().min(FORM_PIECE_BYTES));
            is_pause_due = true;
            passed += piece.len() as u64;
            let backlog = passed.saturating_sub(understood.load(Ordering::Relaxed));
            let is_bounded = backlog <= FORM_BACKLOG_BYTES;
            Poll::Ready(Some(if is_bounded { Ok(piece) } else { Err(io::ErrorKind::InvalidData.into()) }))
        }))
    })
}

fn header(headers: &HeaderMap, name: HeaderName) -> Option<&str> {
    headers.get(name).map(|value| value.to_str().unwrap_or("unreadable"))
}

fn broken_form(error: &MultipartError) -> ApiError {
    if error.status().is_client_error() { invalid_form(error.body_text()) } else { UploadError::Interrupted.into() }
}

fn invalid_form(detail: impl Into<String>) -> ApiError {
    Problem::new(400, "invalid_multipart", detail)
        .at("body")
        .hint("send a form with the file field mask and, if wanted, the field params (JSON)")
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
