//! Sends webhooks of jobs that have ended, until they arrive or there is no more hope. What is due
//! is in the store: it survives the end of this process.

use std::sync::Arc;
use std::time::Duration;

use jiff::{SignedDuration, Timestamp};
use serde_json::json;
use sha2::{Digest, Sha256};
use tokio::time::timeout;
use tokio_util::task::TaskTracker;
use uuid::Builder;

use super::caller::OpenRequests;
use super::job::{Job, SendTry};
use super::service::Jobs;
use super::store::{DueCallback, SendNext, host_of};
use crate::webhook::{Message, SendError, Sender, next_try_after};

/// How often it is looked what is due though no job has ended.
const LOOK: Duration = Duration::from_secs(1);
/// For how long a webhook is given to a sender: longer than one try can take.
const TRY: SignedDuration = SignedDuration::from_secs(60);
/// Webhooks sent at the same time.
const AT_ONCE: usize = 32;
/// The same to one host, and for one tenant: those that hang leave room for the others.
const TO_ONE_HOST: usize = 4;
/// See [`TO_ONE_HOST`].
const OF_ONE_TENANT: usize = 8;

/// Goes on for ever; at once when there is nothing to send with.
pub(super) async fn send(jobs: Arc<Jobs>) {
    let Some(sender) = jobs.webhooks().cloned() else { return };
    let sending = TaskTracker::new();
    let [of_tenants, to_hosts]: [Arc<OpenRequests>; 2] = Default::default();
    loop {
        while sending.len() < AT_ONCE {
            let now = Timestamp::now();
            let is_busy = |tenant: &str, host: &str| {
                of_tenants.is_full(tenant, OF_ONE_TENANT) || to_hosts.is_full(host, TO_ONE_HOST)
            };
            match jobs.store().claim_callback(now, now + TRY, &is_busy).await {
                Ok(Some(due)) => {
                    let own = of_tenants.open(&due.job.owner, OF_ONE_TENANT);
                    let share = (own, to_hosts.open(host_of(&due.url), TO_ONE_HOST));
                    let (jobs, sender) = (Arc::clone(&jobs), sender.clone());
                    sending.spawn(async move {
                        send_one(Arc::clone(&jobs), sender, due).await;
                        drop(share);
                        jobs.wake_callbacks();
                    });
                }
                Ok(None) => break,
                Err(error) => {
                    tracing::error!(%error, "webhooks cannot be looked up");
                    break;
                }
            }
        }
        // Over in time or woken by a job that ended: both mean to look again.
        let _ = timeout(LOOK, jobs.callbacks_woken()).await;
    }
}

async fn send_one(jobs: Arc<Jobs>, sender: Sender, due: DueCallback) {
    let sent = sender.send(&due.url, &message(&due.job)).await;
    let code = sent.as_ref().err().map_or("delivered", SendError::code);
    let next = match &sent {
        Ok(_) => SendNext::Delivered,
        Err(error) if error.is_final() => SendNext::GiveUp,
        Err(_) => match next_try_after(due.tries + 1) {
            Some(wait) => SendNext::TryAt(Timestamp::now() + wait),
            None => SendNext::GiveUp,
        },
    };
    let id = due.job.id;
    tracing::info!(job = %id, trace_id = due.job.trace_id, code, tries = due.tries + 1, "webhook sent");
    jobs.metrics().callback(code);
    let status = match &sent {
        Ok(status) => Some(*status),
        Err(error) => error.status(),
    };
    let tried = SendTry { at: Timestamp::now(), status, error: sent.err().map(|error| error.code().to_owned()) };
    if let Err(error) = jobs.store().callback_tried(id, &tried, next).await {
        tracing::error!(job = %id, %error, "the outcome of a webhook cannot be written; it is sent again");
    }
}

/// Thin: which job ended and how. Whoever wants more asks for it, with a token.
fn message(job: &Job) -> Message {
    let ended_ms = job.ended_at.map_or(0, Timestamp::as_millisecond);
    // The same in every try, another when the job is run again.
    let hash = Sha256::digest(format!("{}@{ended_ms}", job.id));
    let mut id = [0; 16];
    id.copy_from_slice(&hash[..16]);
    let body = json!({
        "type": "job.ended",
        "timestamp": job.ended_at.map(|time| time.to_string()),
        "data": {"id": job.id.to_string(), "state": job.state, "href": format!("/v1/jobs/{}", job.id)}
    });
    Message { id: Builder::from_custom_bytes(id).into_uuid(), body: body.to_string().into() }
}
