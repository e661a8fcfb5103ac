//! Stores the DICOM results of jobs in archives, until they are there or there is no more hope. What is due is in the
//! store: it survives the end of this process. An instance that is sent twice is the same both times, its identifier
//! too: archives keep it once.

use std::io;
use std::sync::Arc;
use std::time::Duration;

use bytes::Bytes;
use futures_util::stream::BoxStream;
use jiff::{SignedDuration, Timestamp};
use tokio::time::timeout;

use super::caller::{Caller, OpenRequests};
use super::error::JobsError;
use super::job::{Delivery, Job, RequestedParams, SendTry};
use super::results::Published;
use super::service::Jobs;
use super::store::SendNext;
use crate::audit::Action;
use crate::dicomweb::client::Archive;
use crate::dicomweb::{StoreFault, time_to_store};
use crate::formats::artifacts::{ARTIFACTS, Artifact};

/// How often it is looked what is due though no job has ended.
const LOOK: Duration = Duration::from_secs(1);
/// For how long a delivery is given to a sender, beside the time that storing takes: results may have to be made, one
/// after the other. With less, two processes send the same; with more, one that is gone holds a delivery up for longer.
const STEP: SignedDuration = SignedDuration::from_secs(120);
/// Deliveries to one archive at the same time: half of what it is asked at all, so that masks can be fetched.
const TO_ONE_ARCHIVE: usize = 2;
/// Wait after the first try; each further one is twice as long.
const FIRST_WAIT: SignedDuration = SignedDuration::from_secs(5);
/// Longest wait: an archive that is back gets what it missed within this time.
const LONGEST_WAIT: SignedDuration = SignedDuration::from_secs(600);
/// Tries until it is given up: three days, over a weekend. Counted, so that steps of the clock change nothing.
const MOST_TRIES: u32 = 439;

/// Goes on for ever; at once when there is no archive.
pub(super) async fn send(jobs: Arc<Jobs>) {
    let Some(pacs) = jobs.pacs.clone() else { return };
    let under_way: Arc<OpenRequests> = Arc::default();
    loop {
        for name in pacs.names() {
            send_due(&jobs, name, &under_way).await;
        }
        // Over in time or woken by a job that ended: both mean to look again.
        let _ = timeout(LOOK, jobs.deliveries_woken()).await;
    }
}

/// Begins what is due to one archive, as much as may be under way.
async fn send_due(jobs: &Arc<Jobs>, name: &str, under_way: &Arc<OpenRequests>) {
    while let Some(turn) = under_way.open(name, TO_ONE_ARCHIVE) {
        let now = Timestamp::now();
        match jobs.store().claim_delivery(name, now, now + STEP).await {
            Ok(Some(job)) => {
                let jobs = Arc::clone(jobs);
                tokio::spawn(async move {
                    deliver(&jobs, &job).await;
                    drop(turn);
                    jobs.wake_deliveries();
                });
            }
            Ok(None) => return,
            Err(error) => {
                tracing::error!(%error, "deliveries cannot be looked up");
                return;
            }
        }
    }
}

/// Why not all of a job's results are in the archive.
#[derive(Clone, Copy, Debug)]
struct Missed {
    code: &'static str,
    status: Option<u16>,
    /// Whether trying again is of no use.
    is_final: bool,
}

impl From<StoreFault> for Missed {
    fn from(fault: StoreFault) -> Self {
        Self { code: fault.code(), status: fault.status(), is_final: fault.is_final() }
    }
}

impl From<JobsError> for Missed {
    fn from(error: JobsError) -> Self {
        let (code, is_final) = match error {
            JobsError::ResultsErased | JobsError::NotFound => ("results_erased", true),
            JobsError::ResultDamaged => ("result_damaged", true),
            JobsError::NoSuchResult { .. } => ("no_such_result", true),
            error => {
                tracing::error!(%error, "a result cannot be read to be delivered");
                ("storage", false)
            }
        };
        Self { code, status: None, is_final }
    }
}

async fn deliver(jobs: &Jobs, job: &Job) {
    let Some(delivery) = &job.delivery else { return };
    let tried = store_all(jobs, job, delivery).await;
    let now = Timestamp::now();
    let next = match &tried {
        Ok(_) => SendNext::Delivered,
        Err(missed) if missed.is_final => SendNext::GiveUp,
        Err(_) => next_wait(delivery.tries).map_or(SendNext::GiveUp, |wait| SendNext::TryAt(now + wait)),
    };
    let (code, status) = match tried {
        Ok(status) => ("delivered", status),
        Err(missed) => (missed.code, missed.status),
    };
    tracing::info!(job = %job.id, trace_id = job.trace_id, pacs = delivery.to, code, tries = delivery.tries + 1,
        is_given_up = next == SendNext::GiveUp, "results delivered");
    jobs.metrics().delivery(code);
    let error = (next != SendNext::Delivered).then(|| code.to_owned());
    if let Err(error) = jobs.store().delivery_tried(job.id, &SendTry { at: now, status, error }, next).await {
        tracing::error!(job = %job.id, %error, "the outcome of a delivery cannot be written; it is sent again");
        return;
    }
    if !matches!(next, SendNext::TryAt(_)) {
        let tenant = Caller { tenant: job.owner.clone(), trace_id: job.trace_id.clone(), ..Caller::default() };
        jobs.record(&tenant, Action::Deliver, Some(job.id), code).await;
    }
}

/// How long to wait after a try that so many went before; none when it was the last.
fn next_wait(before: u32) -> Option<SignedDuration> {
    let wait = FIRST_WAIT.saturating_mul(1 << before.min(16)).min(LONGEST_WAIT);
    (before + 1 < MOST_TRIES).then_some(wait)
}

/// Stores what the archive has not got yet; the status of the last answer. One that is not taken does not keep the others
/// from being stored.
async fn store_all(jobs: &Jobs, job: &Job, delivery: &Delivery) -> Result<Option<u16>, Missed> {
    let archive = jobs.pacs.as_ref().and_then(|pacs| pacs.archive(&delivery.to));
    let Some(archive) = archive else { return Ok(None) };
    let (mut status, mut missed) = (None, None);
    for name in wanted(job) {
        if delivery.stored.iter().any(|stored| stored == name) {
            continue;
        }
        match store_one(jobs, archive, job, name).await {
            Ok(answered) => status = Some(answered),
            // Nobody is there: the next would wait as long.
            Err(fault) if fault.status.is_none() && !fault.is_final => return Err(fault),
            // What may be mended is told rather than what may not: it is tried again.
            Err(fault) => missed = Some(missed.filter(|other: &Missed| !other.is_final).unwrap_or(fault)),
        }
    }
    missed.map_or(Ok(status), Err)
}

async fn store_one(jobs: &Jobs, archive: Archive<'_>, job: &Job, name: &str) -> Result<u16, Missed> {
    let published = jobs.result_of(job, name).await?;
    let bytes = published.file.bytes;
    let until = Timestamp::now() + time_to_store(bytes) + STEP;
    jobs.store().extend_delivery(job.id, until).await.map_err(JobsError::Store)?;
    let content = content(jobs, published).await?;
    let _turn = archive.turn().await;
    let status = archive.store(content, bytes).await?;
    jobs.store().delivery_stored(job.id, name).await.map_err(JobsError::Store)?;
    Ok(status)
}

/// The bytes of a result, once they were found to be what was published. Not held in memory: an archive may be slow.
async fn content(jobs: &Jobs, published: Published) -> Result<BoxStream<'static, io::Result<Bytes>>, JobsError> {
    let Published { id, token, file } = published;
    drop(jobs.content(id, &token, &file).await?);
    Ok(jobs.blobs().read_range((id, &token, &file.name), (0, file.bytes)).await?)
}

/// The results that are delivered: the DICOM objects that the job's parameters ask for, all where they ask for none.
fn wanted(job: &Job) -> Vec<&'static str> {
    const ALL: &[Artifact] = &ARTIFACTS;
    let asked = RequestedParams::parse(Some(job.params_json.as_bytes()));
    let outputs = asked.as_ref().map_or(&[][..], |asked| &asked.checked().outputs[..]);
    let all: Vec<&str> = ALL.iter().filter(|artifact| artifact.is_dicom()).map(|artifact| artifact.name).collect();
    let named: Vec<&str> = all.iter().copied().filter(|name| outputs.contains(name)).collect();
    if named.is_empty() { all } else { named }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn waits_grow_to_ten_minutes_and_end_after_three_days() {
        let waits: Vec<i64> = (0..).map_while(next_wait).map(|wait| wait.as_secs()).collect();
        assert_eq!(waits[..9], [5, 10, 20, 40, 80, 160, 320, 600, 600]);
        assert_eq!(waits.iter().sum::<i64>() / 3600, 71);
        assert_eq!(next_wait(MOST_TRIES), None);
    }
}
