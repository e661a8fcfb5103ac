//! Erases what has been kept long enough, and sweeps what no job names.

use std::sync::Arc;
use std::time::Duration;

use jiff::Timestamp;
use tokio::time::{Instant, MissedTickBehavior, interval};

use super::caller::Caller;
use super::error::JobsError;
use super::job::JobId;
use super::service::Jobs;
use crate::audit::Action;

/// How often it is looked what is due.
const LOOK: Duration = Duration::from_secs(5);
/// How often files that no job names are looked for.
const SWEEP: Duration = Duration::from_secs(3600);
/// How long the clock must not have jumped before anything is erased: one that is forty days ahead for some seconds would
/// erase everything.
const STEADY: Duration = Duration::from_secs(3600);
/// How long it is known that a row was deleted. Its end is in the audit log in the same moment, unless the server was killed; then
/// its files are swept by the next start, or by another server within two hours.
const KNOWN_ERASED: Duration = Duration::from_secs(3 * 3600);
/// How many jobs are erased at once: others want to write in between.
const BATCH: u32 = 100;

/// Goes on for ever.
pub(super) async fn keep(jobs: Arc<Jobs>) {
    let mut ticks = interval(LOOK);
    ticks.set_missed_tick_behavior(MissedTickBehavior::Delay);
    let mut swept = Instant::now();
    loop {
        ticks.tick().await;
        if let Err(error) = erase_due(&jobs).await {
            tracing::error!(%error, "what is due cannot be erased");
        }
        jobs.wipe_deleted().await;
        jobs.mark_audit().await;
        if swept.elapsed() >= SWEEP {
            swept = Instant::now();
            forget_erased(&jobs).await;
            match jobs.sweep_old().await {
                Ok(count) => tracing::info!(count, "files swept that no job names"),
                Err(error) => tracing::error!(%error, "files cannot be swept"),
            }
        }
    }
}

/// What is erased by itself.
#[derive(Clone, Copy)]
enum What {
    Jobs,
    Results,
    Masks,
}

impl What {
    fn name(self) -> &'static str {
        match self {
            Self::Jobs => "jobs",
            Self::Results => "results",
            Self::Masks => "masks",
        }
    }

    async fn mark(self, jobs: &Jobs, before: Timestamp) -> Result<Vec<JobId>, JobsError> {
        let store = jobs.store();
        Ok(match self {
            Self::Jobs => store.expire_jobs(before, BATCH).await?,
            Self::Results => store.expire_results(before, BATCH).await?,
            Self::Masks => store.expire_masks(before, BATCH).await?,
        })
    }

    async fn erase(self, jobs: &Jobs, id: JobId) -> Result<(), JobsError> {
        let blobs = jobs.blobs();
        match self {
            Self::Jobs => blobs.erase(id).await?,
            Self::Results => blobs.erase_results(id).await?,
            Self::Masks => blobs.erase_mask(id).await?,
        }
        Ok(())
    }
}

async fn erase_due(jobs: &Jobs) -> Result<(), JobsError> {
    let Some(now) = jobs.clock().steady_for(STEADY) else { return Ok(()) };
    let keep = jobs.limits().keep;
    for (what, time) in [(What::Jobs, keep.jobs), (What::Results, keep.results), (What::Masks, keep.masks)] {
        while let Some(before) = time.and_then(|time| now.checked_sub(time).ok()) {
            let due = what.mark(jobs, before).await?;
            if !due.is_empty() {
                jobs.note_deleted();
            }
            tell(jobs, what.name(), &due).await;
            for id in &due {
                what.erase(jobs, *id).await?;
            }
            if due.len() < BATCH as usize {
                break;
            }
        }
    }
    Ok(())
}

/// What was deleted long ago stands in the audit log.
async fn forget_erased(jobs: &Jobs) {
    let Some(before) = jobs.clock().steady_for(STEADY).and_then(|now| now.checked_sub(KNOWN_ERASED).ok()) else {
        return;
    };
    if let Err(error) = jobs.store().forget_erased(before).await {
        tracing::warn!(%error, "what is known of deleted jobs cannot be forgotten");
    }
}

/// Before the files go: the rows have gone already, and who stops the server now finds it written.
async fn tell(jobs: &Jobs, what: &'static str, due: &[JobId]) {
    for id in due {
        jobs.record(&Caller::default(), Action::Expire, Some(*id), what).await;
    }
    if !due.is_empty() {
        tracing::info!(what, count = due.len(), "erased: kept long enough");
        jobs.metrics().expired(what, due.len());
    }
}
