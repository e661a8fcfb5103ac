//! Stores the DICOM results of jobs in archives, until they are there or there is no more hope. What is due is in the
//! store: it survives the end of this process. An instance that is sent twice is the same both times, its identifier
//! too: archives keep it once.

use std::collections::BTreeMap;
use std::future::Future;
use std::io;
use std::pin::pin;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

use bytes::Bytes;
use futures_util::stream::BoxStream;
use jiff::{SignedDuration, Timestamp};
use tokio::time::{Instant, timeout};

use super::caller::{Caller, OpenRequests};
use super::error::JobsError;
use super::job::{Job, RequestedParams, SendTry};
use super::results::Published;
use super::service::Jobs;
use super::store::SendNext;
use crate::audit::Action;
use crate::dicomweb::StoreFault;
use crate::dicomweb::client::Archive;
use crate::formats::artifacts::{ARTIFACTS, Artifact};

/// How often it is looked what is due though no job has ended.
const LOOK: Duration = Duration::from_secs(1);
/// For how long a delivery is given to a sender that says nothing. With less, two processes send the same; with more, one
/// that is gone holds a delivery up for longer.
const LEASE: SignedDuration = SignedDuration::from_secs(90);
/// How often a sender says that it is there, and hears whether the results still are.
const RENEWAL: Duration = Duration::from_secs(15);
/// Deliveries to one archive at the same time: half of what it is asked at all, so that masks can be fetched.
const TO_ONE_ARCHIVE: usize = 2;
/// How long nothing is sent to an archive where nobody was: with less, all that is due to it tries in vain.
const PAUSE: Duration = Duration::from_secs(30);
/// Wait after the first try; each further one is twice as long.
const FIRST_WAIT: SignedDuration = SignedDuration::from_secs(5);
/// Longest wait: to an archive that is back it is sent again within this time.
const LONGEST_WAIT: SignedDuration = SignedDuration::from_secs(600);
/// Tries until it is given up: three days, over a weekend. Counted, so that steps of the clock change nothing.
const MOST_TRIES: u32 = 439;

/// What is under way to each archive, and to which nothing is sent for now.
#[derive(Default)]
struct Archives {
    under_way: Arc<OpenRequests>,
    paused_until: Mutex<BTreeMap<String, Instant>>,
}

impl Archives {
    fn is_paused(&self, name: &str) -> bool {
        let paused = self.paused_until.lock().unwrap_or_else(PoisonError::into_inner);
        paused.get(name).is_some_and(|until| Instant::now() < *until)
    }

    fn pause(&self, name: &str) {
        let mut paused = self.paused_until.lock().unwrap_or_else(PoisonError::into_inner);
        paused.insert(name.to_owned(), Instant::now() + PAUSE);
    }
}

/// Goes on for ever; at once when there is no archive.
pub(super) async fn send(jobs: Arc<Jobs>) {
    let Some(pacs) = jobs.pacs.clone() else { return };
    let archives = Arc::default();
    loop {
        for name in pacs.names() {
            send_due(&jobs, name, &archives).await;
        }
        // Over in time or woken by a job that ended: both mean to look again.
        let _ = timeout(LOOK, jobs.deliveries_woken()).await;
    }
}

/// Begins what is due to one archive, as much as may be under way.
async fn send_due(jobs: &Arc<Jobs>, name: &str, archives: &Arc<Archives>) {
    while !archives.is_paused(name)
        && let Some(turn) = archives.under_way.open(name, TO_ONE_ARCHIVE)
    {
        let (now, until) = (Timestamp::now(), Timestamp::now() + LEASE);
        match jobs.store().claim_delivery(name, now, until).await {
            Ok(Some(job)) => {
                let (jobs, archives, name) = (Arc::clone(jobs), Arc::clone(archives), name.to_owned());
                tokio::spawn(async move {
                    if (Held { jobs: &jobs, job: &job, until }).deliver(&name).await.is_err() {
                        archives.pause(&name);
                    }
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

/// Nobody was there.
struct Away;

/// Why not all of a job's results are in the archive.
#[derive(Clone, Copy, Debug)]
struct Missed {
    code: &'static str,
    status: Option<u16>,
    /// Whether trying again is of no use.
    is_final: bool,
}

impl Missed {
    /// The job is deleted, its results are erased, or another process sends them.
    const LOST: Self = Self { code: "lost", status: None, is_final: true };

    fn is_lost(&self) -> bool {
        self.code == Self::LOST.code
    }

    /// Whether the archive answered nothing, and would not answer to the next result either.
    fn is_away(&self) -> bool {
        matches!(self.code, "connect_failed" | "tls_failed")
    }

    fn timed_out(&self) -> bool {
        self.code == "timed_out"
    }
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

/// What came of a try.
struct Tried {
    /// Results that the archive has got by it.
    stored: usize,
    /// Status of the last answer.
    outcome: Result<Option<u16>, Missed>,
}

/// A delivery that this process has been given.
struct Held<'a> {
    jobs: &'a Jobs,
    job: &'a Job,
    /// Until when, unless it is renewed. Whoever knows another time has lost it.
    until: Timestamp,
}

impl Held<'_> {
    /// Tries once.
    ///
    /// # Errors
    /// When nobody was there.
    async fn deliver(mut self, to: &str) -> Result<(), Away> {
        let (job, before) = (self.job, self.job.delivery.as_ref().map_or(0, |delivery| delivery.tries));
        let Tried { stored, outcome } = self.store_all(to).await;
        if outcome.is_err_and(|missed| missed.is_lost()) {
            tracing::info!(job = %job.id, pacs = to, stored, "a delivery is not ours any more");
            return Ok(());
        }
        let now = Timestamp::now();
        let next = match &outcome {
            Ok(_) => SendNext::Delivered,
            Err(missed) if missed.is_final => SendNext::GiveUp,
            Err(_) => next_wait(before).map_or(SendNext::GiveUp, |wait| SendNext::TryAt(now + wait)),
        };
        let (code, status) = match outcome {
            Ok(status) => ("delivered", status),
            Err(missed) => (missed.code, missed.status),
        };
        tracing::info!(job = %job.id, trace_id = job.trace_id, pacs = to, code, stored, tries = before + 1, "results sent");
        self.jobs.metrics().delivery(code);
        let error = outcome.is_err().then(|| code.to_owned());
        let tried = SendTry { at: now, status, error };
        if let Err(error) = self.jobs.store().delivery_tried(job.id, self.until, &tried, next).await {
            tracing::error!(job = %job.id, %error, "the outcome of a delivery cannot be written; it is sent again");
        }
        if stored > 0 || next == SendNext::GiveUp {
            let code = if stored > 0 && outcome.is_err() { "partly_delivered" } else { code };
            let tenant = Caller { tenant: job.owner.clone(), trace_id: job.trace_id.clone(), ..Caller::default() };
            self.jobs.record(&tenant, Action::Deliver, Some(job.id), code).await;
        }
        let is_away = outcome.is_err_and(|missed| missed.is_away() || missed.timed_out() && stored == 0);
        if is_away { Err(Away) } else { Ok(()) }
    }

    /// Stores what the archive has not got yet. One that is not taken does not keep the others from being stored.
    async fn store_all(&mut self, to: &str) -> Tried {
        let (mut stored, mut outcome): (usize, Result<Option<u16>, Missed>) = (0, Ok(None));
        let jobs = self.jobs;
        let Some(archive) = jobs.pacs.as_ref().and_then(|pacs| pacs.archive(to)) else {
            return Tried { stored, outcome: Err(Missed::LOST) };
        };
        for name in wanted(self.job) {
            if self.job.delivery.iter().any(|delivery| delivery.stored.iter().any(|known| known == name)) {
                continue;
            }
            match (self.store_one(archive, name).await, &outcome) {
                (Ok(status), before) => {
                    stored += 1;
                    if before.is_ok() {
                        outcome = Ok(Some(status));
                    }
                }
                (Err(missed), Err(before)) if missed.timed_out() && before.timed_out() => {
                    return Tried { stored, outcome: Err(missed) };
                }
                (Err(missed), _) if missed.is_lost() || missed.is_away() => {
                    return Tried { stored, outcome: Err(missed) };
                }
                // What may be mended is told rather than what may not: it is tried again.
                (Err(_), Err(before)) if !before.is_final => {}
                (Err(missed), _) => outcome = Err(missed),
            }
        }
        Tried { stored, outcome }
    }

    async fn store_one(&mut self, archive: Archive<'_>, name: &str) -> Result<u16, Missed> {
        let (jobs, job) = (self.jobs, self.job);
        let published = self.while_held(jobs.result_of(job, name)).await??;
        let _turn = self.while_held(archive.turn()).await?;
        // It may have been erased meanwhile.
        self.renew().await?;
        let (bytes, content) = (published.file.bytes, content(jobs, published).await?);
        let status = self.while_held(archive.store(content, bytes)).await??;
        jobs.store().delivery_stored(job.id, name).await.map_err(JobsError::Store)?;
        Ok(status)
    }

    /// Does what may take long, as long as the delivery is this process's.
    async fn while_held<T>(&mut self, work: impl Future<Output = T>) -> Result<T, Missed> {
        let mut work = pin!(work);
        loop {
            match timeout(RENEWAL, &mut work).await {
                Ok(done) => return Ok(done),
                Err(_) => self.renew().await?,
            }
        }
    }

    async fn renew(&mut self) -> Result<(), Missed> {
        let until = Timestamp::now() + LEASE;
        let is_held = self.jobs.store().extend_delivery(self.job.id, self.until, until).await;
        if !is_held.map_err(JobsError::Store)? {
            return Err(Missed::LOST);
        }
        self.until = until;
        Ok(())
    }
}

/// How long to wait after a try that so many went before; none when it was the last.
fn next_wait(before: u32) -> Option<SignedDuration> {
    let wait = FIRST_WAIT.saturating_mul(1 << before.min(16)).min(LONGEST_WAIT);
    (before + 1 < MOST_TRIES).then_some(wait)
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
        assert_eq!(waits.iter().sum::<i64>() / 3600, 72);
        assert_eq!(next_wait(MOST_TRIES), None);
    }
}
