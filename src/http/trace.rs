//! One line and one count per request, and the trace that it belongs to (W3C `traceparent`): its id
//! goes into every line of the log, into problem objects, and with the job to the worker. Routes are
//! written, never paths or queries: those hold what clients wrote.

use std::sync::Arc;
use std::time::Instant;

use axum::extract::{MatchedPath, Request, State};
use axum::http::{HeaderMap, Method};
use axum::middleware::Next;
use axum::response::Response;
use tracing::{Instrument, info_span};

use crate::formats::hex;
use crate::jobs::service::Jobs;

/// Trace of a request: 32 hexadecimal digits.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct TraceId(pub String);

tokio::task_local! {
    static CURRENT: TraceId;
}

/// Trace of the request that is being answered.
pub fn current() -> Option<String> {
    CURRENT.try_with(|id| id.0.clone()).ok()
}

/// Traces, logs and counts.
pub async fn requests(State(jobs): State<Arc<Jobs>>, mut request: Request, next: Next) -> Response {
    let begun = Instant::now();
    let method = request.method().clone();
    let route = request.extensions().get::<MatchedPath>().map_or("none", MatchedPath::as_str).to_owned();
    let trace = TraceId::of(request.headers());
    let span = info_span!("request", trace_id = trace.0);
    request.extensions_mut().insert(trace.clone());
    let answer = async {
        let response = next.run(request).await;
        let (status, seconds) = (response.status().as_u16(), begun.elapsed().as_secs_f64());
        tracing::info!(%method, route, status, ms = (seconds * 1e6).round() / 1e3, "request");
        jobs.metrics().request(label_of(&method), &route, status, seconds);
        response
    };
    CURRENT.scope(trace, answer.instrument(span)).await
}

/// A method as a label: one of the client's own making would be a label of its own.
fn label_of(method: &Method) -> &'static str {
    const KNOWN: [&str; 7] = ["GET", "HEAD", "POST", "PUT", "PATCH", "DELETE", "OPTIONS"];
    KNOWN.into_iter().find(|known| *known == method.as_str()).unwrap_or("other")
}

impl TraceId {
    /// The one that the client sent, or a new one.
    fn of(headers: &HeaderMap) -> Self {
        let sent = headers.get("traceparent").and_then(|value| value.to_str().ok()).and_then(parse);
        sent.unwrap_or_else(Self::random)
    }

    fn random() -> Self {
        let mut id = [0; 16];
        // Without random numbers there is no trace; there is still an answer.
        let _ = getrandom::fill(&mut id);
        Self(hex(&id))
    }
}

/// `00-{trace}-{span}-{flags}` in lower-case hexadecimal; later versions may go on after that.
fn parse(text: &str) -> Option<TraceId> {
    let mut parts = text.split('-');
    let mut part = |digits: usize| {
        let part = parts.next()?;
        let is_hex = part.bytes().all(|b| b.is_ascii_digit() || (b'a'..=b'f').contains(&b));
        (part.len() == digits && is_hex).then_some(part)
    };
    let (version, trace, span, _) = (part(2)?, part(32)?, part(16)?, part(2)?);
    let is_nought = |part: &str| part.bytes().all(|b| b == b'0');
    let is_ended = version != "00" || parts.next().is_none();
    (version != "ff" && !is_nought(trace) && !is_nought(span) && is_ended).then(|| TraceId(trace.to_owned()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn methods_of_a_client_s_own_making_are_one_label() {
        assert_eq!(label_of(&Method::PATCH), "PATCH");
        for made_up in ["AAAA", "get", "CONNECT", "M1234567"] {
            assert_eq!(label_of(&Method::from_bytes(made_up.as_bytes()).expect("a token")), "other", "{made_up}");
        }
    }

    #[test]
    fn a_traceparent_is_read_as_the_standard_says() {
        let (trace, span) = ("0af7651916cd43dd8448eb211c80319c", "b7ad6b7169203331");
        let ids = [format!("00-{trace}-{span}-01"), format!("cc-{trace}-{span}-01-what-comes-later")];
        for text in ids {
            assert_eq!(parse(&text), Some(TraceId(trace.to_owned())), "{text}");
        }
        let nought = "0".repeat(32);
        for text in [
            String::new(),
            format!("ff-{trace}-{span}-01"),
            format!("00-{nought}-{span}-01"),
            format!("00-{trace}-0000000000000000-01"),
            format!("00-{}-{span}-01", trace.to_uppercase()),
            format!("00-{trace}-{span}-01-more"),
            format!("00-{trace}-{span}"),
        ] {
            assert_eq!(parse(&text), None, "{text}");
        }
    }
}
