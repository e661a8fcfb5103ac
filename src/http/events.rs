//! `/v1/jobs/{id}/events`: what happens to a job, as server-sent events. A state has a number, so
//! that one who comes back hears what was missed; progress has none, only the last of it counts.

use std::convert::Infallible;
use std::sync::Arc;
use std::time::Duration;

use axum::extract::State;
use axum::http::{HeaderMap, HeaderName, HeaderValue, StatusCode};
use axum::response::sse::{Event, KeepAlive, Sse};
use axum::response::{IntoResponse, Response};
use futures_util::stream::unfold;
use serde::Serialize;
use tokio::sync::watch;
use tokio::time::{Instant, timeout};

use super::auth::{Allowed, Read, TokenProblems, TooManyRequests};
use super::error::{ApiError, NoSuchJob};
use super::extract::{IdParam, JobPath};
use super::view::ProgressView;
use crate::jobs::changes::{Happened, RECHECK};
use crate::jobs::error::JobsError;
use crate::jobs::job::{JobId, JobState};
use crate::jobs::service::{JobStatus, Jobs};

/// Shortest time between two events of progress.
const PACE: Duration = Duration::from_millis(100);
/// How often a silent stream says that it is alive: proxies cut off what is silent for a minute.
const KEEP_ALIVE: Duration = Duration::from_secs(15);
/// How long a client waits before it comes back.
const COME_BACK: Duration = Duration::from_secs(2);

const LAST_EVENT_ID: HeaderName = HeaderName::from_static("last-event-id");
/// Tells proxies not to keep events back.
const UNBUFFERED: HeaderName = HeaderName::from_static("x-accel-buffering");

/// A job came into a state.
#[derive(Debug, Serialize, utoipa::ToSchema)]
pub struct StateEvent {
    /// The state.
    state: JobState,
    /// When, RFC 3339.
    #[schema(format = DateTime)]
    at: String,
}

/// One of the events of a stream.
#[derive(utoipa::ToSchema)]
#[expect(dead_code, reason = "describes what is written as text")]
pub struct JobEvent {
    /// `state`, `progress` or `gone`.
    event: String,
    /// Number of a state.
    #[schema(nullable = false)]
    id: Option<String>,
    /// JSON: a StateEvent, a Progress, or an empty object.
    data: String,
    /// Milliseconds until a client that was cut off should come back.
    #[schema(nullable = false)]
    retry: Option<u32>,
}

/// What happens to a job, as it happens.
///
/// Server-sent events. `event: state` has an `id` and the data of StateEvent; a client that comes
/// back with `Last-Event-ID` gets the states that it missed. `event: progress` has the data of
/// Progress and no id. The stream ends once the job has ended; `event: gone` says that it was
/// deleted.
#[utoipa::path(
    get, path = "/v1/jobs/{id}/events", tag = "jobs",
    params(
        IdParam,
        ("Last-Event-ID" = Option<String>, Header, description = "Number of the last state that the client has")
    ),
    responses(
        (status = 200, body = JobEvent, content_type = "text/event-stream", description = "The events, each as described"),
        (status = 204, description = "The job has ended and the client has all events"),
        TokenProblems,
        TooManyRequests,
        NoSuchJob
    )
)]
pub async fn events(
    State(jobs): State<Arc<Jobs>>,
    allowed: Allowed<Read>,
    JobPath(id): JobPath,
    headers: HeaderMap,
) -> Result<Response, ApiError> {
    let heard = headers.get(LAST_EVENT_ID).and_then(|id| id.to_str().ok()).and_then(|id| id.parse().ok()).unwrap_or(0);
    let changes = jobs.changes().watch(id);
    let status = jobs.status(&allowed.caller, id).await?;
    if status.job.state.has_ended() && heard >= status.job.history.len() {
        return Ok(StatusCode::NO_CONTENT.into_response());
    }
    let follower = Follower { jobs, allowed, id, changes, heard, progress: None, paused_until: Instant::now() };
    let stream = unfold(Some(follower), |follower| async move { follower?.next().await });
    let events = Sse::new(stream).keep_alive(KeepAlive::new().interval(KEEP_ALIVE));
    Ok(([(UNBUFFERED, HeaderValue::from_static("no"))], events).into_response())
}

/// One who listens.
struct Follower {
    jobs: Arc<Jobs>,
    allowed: Allowed<Read>,
    id: JobId,
    changes: watch::Receiver<Happened>,
    /// States told.
    heard: usize,
    /// Progress told last.
    progress: Option<ProgressView>,
    /// Progress is not told before.
    paused_until: Instant,
}

impl Follower {
    /// The next event, and whoever waits for the one after; nothing at the end.
    async fn next(mut self) -> Option<(Result<Event, Infallible>, Option<Self>)> {
        loop {
            let seen = *self.changes.borrow();
            let status = match self.jobs.status(&self.allowed.caller, self.id).await {
                Ok(status) => status,
                Err(JobsError::NotFound) => return Some((Ok(Event::default().event("gone").data("{}")), None)),
                // The client comes back and hears what it missed.
                Err(_) => return None,
            };
            if let Some(event) = self.news(&status) {
                return Some((Ok(event), Some(self)));
            }
            if status.job.state.has_ended() || self.jobs.closing().is_cancelled() {
                return None;
            }
            self.wait(seen).await;
        }
    }

    /// What has not been told yet.
    fn news(&mut self, status: &JobStatus) -> Option<Event> {
        if let Some(change) = status.job.history.get(self.heard) {
            self.heard += 1;
            let data = StateEvent { state: change.state, at: change.at.to_string() };
            let event = Event::default().event("state").id(self.heard.to_string()).retry(COME_BACK);
            return event.json_data(data).ok();
        }
        let progress: ProgressView = status.progress?.into();
        if self.progress.as_ref() == Some(&progress) || Instant::now() < self.paused_until {
            return None;
        }
        self.progress = Some(progress.clone());
        self.paused_until = Instant::now() + PACE;
        Event::default().event("progress").json_data(progress).ok()
    }

    /// Until something new may have happened that `seen` does not count.
    async fn wait(&mut self, seen: Happened) {
        let closing = self.jobs.closing().clone();
        // A state is told at once, progress when its pause is over.
        let pause = self.paused_until.saturating_duration_since(Instant::now());
        if timeout(pause, self.changes.wait_for(|now| now.states != seen.states)).await.is_ok() {
            return;
        }
        tokio::select! {
            _ = timeout(RECHECK, self.changes.wait_for(|now| *now != seen)) => {}
            () = closing.cancelled() => {}
        }
    }
}
