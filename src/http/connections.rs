//! The connections that are open: how many there may be, and which has to go when there are too many.
//!
//! A client that asks and never reads holds its connection, what was written to it and could not be sent, and with a few thousand
//! of them everybody else out. So each connection is watched: one that takes what it is sent too slowly is closed, and when all
//! places are taken, the next client takes that of the one that has done nothing for longest.

use std::collections::BTreeMap;
use std::io;
use std::pin::Pin;
use std::sync::atomic::{AtomicBool, AtomicU64, AtomicUsize, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::task::{Context, Poll};
use std::time::Duration;

use axum::body::Body;
use axum::http::StatusCode;
use hyper::body::{Bytes, Frame, SizeHint};
use tokio::io::{AsyncRead, AsyncWrite, ReadBuf};
use tokio::net::TcpStream;
use tokio::sync::Notify;
use tokio::time::{Instant, Sleep, sleep_until, timeout};
use tokio_util::sync::CancellationToken;

use super::error::PROBLEM_JSON;
use crate::config::ConnectionLimits;
use crate::problem::Problem;

/// Time without a byte in either direction, and without an answer that is being made, after which a connection may lose its place.
const GIVES_WAY_AFTER: Duration = Duration::from_secs(1);
/// How often a client without a place looks whether one may be had.
const LOOK: Duration = Duration::from_millis(50);

/// All connections.
#[derive(Debug)]
pub(super) struct Connections {
    limits: ConnectionLimits,
    begun: Instant,
    open: Mutex<BTreeMap<u64, Arc<Open>>>,
    left: Notify,
    next: AtomicU64,
}

/// One connection, as long as it has its place.
#[derive(Debug)]
pub(super) struct Open {
    number: u64,
    all: Arc<Connections>,
    /// When a byte last went either way, ms since the server began.
    moved_at: AtomicU64,
    /// Requests that are being answered.
    answering: AtomicUsize,
    /// Whether it does not take what it is sent.
    is_stalled: AtomicBool,
    /// Cancelled when it has to go.
    close: CancellationToken,
}

/// A place, given back when it is dropped.
#[derive(Debug)]
pub(super) struct PlaceTaken(pub Arc<Open>);

impl Connections {
    pub fn new(limits: ConnectionLimits) -> Arc<Self> {
        let (open, left, next) = Default::default();
        Arc::new(Self { limits, begun: Instant::now(), open, left, next })
    }

    /// A place for one more connection, that of another one if need be; waits as long as all are at work.
    pub async fn admit(self: &Arc<Self>) -> PlaceTaken {
        loop {
            if let Some(open) = self.try_admit() {
                return PlaceTaken(open);
            }
            let _ = timeout(LOOK, self.left.notified()).await;
        }
    }

    fn try_admit(self: &Arc<Self>) -> Option<Arc<Open>> {
        let now = self.now_ms();
        let mut open = self.open();
        if open.len() >= self.limits.max_connections {
            let longest = open.values().filter(|other| other.may_give_way(now)).min_by_key(|other| other.moved_ms());
            let number = longest?.number;
            if let Some(other) = open.remove(&number) {
                other.close.cancel();
            }
        }
        let number = self.next.fetch_add(1, Ordering::Relaxed);
        let own = Arc::new(Open {
            number,
            all: Arc::clone(self),
            moved_at: now.into(),
            answering: AtomicUsize::new(0),
            is_stalled: AtomicBool::new(false),
            close: CancellationToken::new(),
        });
        open.insert(number, Arc::clone(&own));
        Some(own)
    }

    fn now_ms(&self) -> u64 {
        u64::try_from(self.begun.elapsed().as_millis()).unwrap_or(u64::MAX)
    }

    fn open(&self) -> MutexGuard<'_, BTreeMap<u64, Arc<Open>>> {
        // Nothing panics while it is held.
        self.open.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Open {
    /// Ready once it has to go.
    pub fn closed(&self) -> impl Future<Output = ()> + use<> {
        self.close.clone().cancelled_owned()
    }

    fn moved(&self) {
        self.moved_at.store(self.all.now_ms(), Ordering::Relaxed);
    }

    fn moved_ms(&self) -> u64 {
        self.moved_at.load(Ordering::Relaxed)
    }

    fn may_give_way(&self, now_ms: u64) -> bool {
        let is_at_work = self.answering.load(Ordering::Relaxed) > 0 && !self.is_stalled.load(Ordering::Relaxed);
        let still = now_ms.saturating_sub(self.moved_ms());
        !is_at_work && u128::from(still) >= GIVES_WAY_AFTER.as_millis()
    }
}

impl Drop for PlaceTaken {
    fn drop(&mut self) {
        self.0.all.open().remove(&self.0.number);
        self.0.all.left.notify_one();
    }
}

/// An answer under way, until the last byte of its body is taken.
pub(super) struct Answering(Arc<Open>);

impl Answering {
    pub fn of(open: &Arc<Open>) -> Self {
        open.answering.fetch_add(1, Ordering::Relaxed);
        Self(Arc::clone(open))
    }

    /// A body that is an answer under way.
    pub fn with(self, body: Body) -> Body {
        Body::new(Held { body, held: self })
    }
}

impl Drop for Answering {
    fn drop(&mut self) {
        self.0.answering.fetch_sub(1, Ordering::Relaxed);
        self.0.moved();
    }
}

/// A body, and what is held until it has been sent.
pub(super) struct Held<T> {
    pub body: Body,
    pub held: T,
}

impl<T: Send + Unpin + 'static> hyper::body::Body for Held<T> {
    type Data = Bytes;
    type Error = axum::Error;

    fn poll_frame(mut self: Pin<&mut Self>, cx: &mut Context<'_>) -> Poll<Option<Result<Frame<Bytes>, axum::Error>>> {
        let _ = &self.held;
        Pin::new(&mut self.body).poll_frame(cx)
    }

    fn is_end_stream(&self) -> bool {
        self.body.is_end_stream()
    }

    fn size_hint(&self) -> SizeHint {
        self.body.size_hint()
    }
}

/// What the HTTP library says by itself to a request whose head it cannot read begins so; our answers have more headers.
const BARE_REFUSAL: &[u8] = b"HTTP/1.1 4";

/// What is said instead of such an answer, which has no body: the library lets nobody else answer.
fn explained(bare: &[u8]) -> Option<Vec<u8>> {
    let text = std::str::from_utf8(bare.strip_prefix(BARE_REFUSAL)?).ok()?.to_ascii_lowercase();
    let is_bare = text.contains("content-length: 0\r\n") && text.ends_with("\r\n\r\n");
    if !is_bare || text.contains("x-content-type-options") {
        return None;
    }
    let (status, code, detail, hint) = match text.get(..2)? {
        "14" => (414, "uri_too_long", "the address is too long", "send parameters as a part of a form"),
        "31" => (431, "headers_too_large", "the headers are too large", "send fewer or shorter headers"),
        _ => (
            400,
            "malformed_request",
            "the head of the request is malformed",
            "percent-encode what is not allowed in an address: quotes as %22, spaces as %20",
        ),
    };
    let problem = Problem::new(status, code, detail).hint(hint);
    let body = serde_json::to_string(&problem).ok()?;
    let head = format!(
        "HTTP/1.1 {status} {}\r\ncontent-type: {PROBLEM_JSON}\r\ncontent-length: {}\r\nconnection: close\r\n\
         x-content-type-options: nosniff\r\n\r\n",
        StatusCode::from_u16(status).ok()?.canonical_reason().unwrap_or_default(),
        body.len()
    );
    Some([head.as_bytes(), body.as_bytes()].concat())
}

/// A stream that is closed when what is written to it is taken too slowly.
#[derive(Debug)]
pub(super) struct Watched {
    stream: TcpStream,
    open: Arc<Open>,
    /// Since when the other side does not take what is written.
    stalled_since: Option<Instant>,
    /// How long it did not in all, and what it took, since that was last judged.
    stalled: Duration,
    taken: u64,
    alarm: Pin<Box<Sleep>>,
}

impl Watched {
    pub fn new(stream: TcpStream, open: Arc<Open>) -> Self {
        let alarm = Box::pin(sleep_until(Instant::now()));
        Self { stream, open, stalled_since: None, stalled: Duration::ZERO, taken: 0, alarm }
    }

    /// Writes something better than a refusal without a word, if this is one: then it need not be written.
    fn explain_refusal(&self, bytes: &[u8]) -> bool {
        if self.open.answering.load(Ordering::Relaxed) > 0 {
            return false;
        }
        let Some(explained) = explained(bytes) else { return false };
        // It is short, and the last thing that is written: room for it is there, or nobody reads.
        self.stream.try_write(&explained).is_ok()
    }

    /// Judges a write. Only time in which the other side takes nothing counts, so that one that is served slowly is not closed.
    fn judge(&mut self, cx: &mut Context<'_>, written: Poll<io::Result<usize>>) -> Poll<io::Result<usize>> {
        let limits = self.open.all.limits;
        let now = Instant::now();
        match &written {
            Poll::Ready(outcome) => {
                if let Some(since) = self.stalled_since.take() {
                    self.stalled += now - since;
                    self.open.is_stalled.store(false, Ordering::Relaxed);
                }
                if let Ok(count) = outcome {
                    self.taken += *count as u64;
                    self.open.moved();
                }
            }
            Poll::Pending => {
                self.open.is_stalled.store(true, Ordering::Relaxed);
                let since = *self.stalled_since.get_or_insert(now);
                let left = limits.write_idle.saturating_sub(self.stalled);
                if since + left > now {
                    self.alarm.as_mut().reset(since + left);
                    if self.alarm.as_mut().poll(cx).is_pending() {
                        return Poll::Pending;
                    }
                }
            }
        }
        if self.stalled + self.stalled_since.map_or(Duration::ZERO, |since| now - since) < limits.write_idle {
            return written;
        }
        let pace = self.taken as f64 / limits.write_idle.as_secs_f64();
        if pace < limits.write_bytes_per_second as f64 {
            return Poll::Ready(Err(io::Error::new(io::ErrorKind::TimedOut, "the answer is read too slowly")));
        }
        (self.stalled, self.taken) = (Duration::ZERO, 0);
        if let Some(since) = &mut self.stalled_since {
            *since = now;
            self.alarm.as_mut().reset(now + limits.write_idle);
            let _ = self.alarm.as_mut().poll(cx);
        }
        written
    }
}

impl AsyncRead for Watched {
    fn poll_read(mut self: Pin<&mut Self>, cx: &mut Context<'_>, buffer: &mut ReadBuf<'_>) -> Poll<io::Result<()>> {
        let before = buffer.filled().len();
        let read = Pin::new(&mut self.stream).poll_read(cx, buffer);
        if buffer.filled().len() > before {
            self.open.moved();
        }
        read
    }
}

impl AsyncWrite for Watched {
    fn poll_write(mut self: Pin<&mut Self>, cx: &mut Context<'_>, buffer: &[u8]) -> Poll<io::Result<usize>> {
        if self.explain_refusal(buffer) {
            return Poll::Ready(Ok(buffer.len()));
        }
        let written = Pin::new(&mut self.stream).poll_write(cx, buffer);
        self.judge(cx, written)
    }

    fn poll_write_vectored(
        mut self: Pin<&mut Self>,
        cx: &mut Context<'_>,
        buffers: &[io::IoSlice<'_>],
    ) -> Poll<io::Result<usize>> {
        if let [only] = buffers
            && self.explain_refusal(only)
        {
            return Poll::Ready(Ok(only.len()));
        }
        let written = Pin::new(&mut self.stream).poll_write_vectored(cx, buffers);
        self.judge(cx, written)
    }

    fn is_write_vectored(&self) -> bool {
        self.stream.is_write_vectored()
    }

    fn poll_flush(mut self: Pin<&mut Self>, cx: &mut Context<'_>) -> Poll<io::Result<()>> {
        Pin::new(&mut self.stream).poll_flush(cx)
    }

    fn poll_shutdown(mut self: Pin<&mut Self>, cx: &mut Context<'_>) -> Poll<io::Result<()>> {
        Pin::new(&mut self.stream).poll_shutdown(cx)
    }
}
