//! Extends the leases of this process's runs, and sees which runs of other processes do not go on.

use std::sync::Arc;
use std::time::Duration;

use jiff::Timestamp;
use tokio::time::{Interval, MissedTickBehavior, interval};

use super::place::OpenError;
use super::service::Jobs;
use super::store::{LEASE, Reclaim, StoreError};

/// How often leases are extended.
const HEARTBEAT: Duration = Duration::from_secs(10);
/// How often it is looked whether a run is to stop, and whether a process or a lease is gone.
const WATCH: Duration = Duration::from_millis(500);

/// Extends the leases of what runs here.
pub(super) async fn extend(jobs: Arc<Jobs>) {
    let mut ticks = every(HEARTBEAT);
    loop {
        ticks.tick().await;
        for running in jobs.running().all() {
            match jobs.store().extend(&running.lease, Timestamp::now() + LEASE).await {
                Ok(()) => {}
                Err(StoreError::StaleLease) => running.stop(),
                Err(error) => tracing::error!(job = %running.lease.id, %error, "lease cannot be extended"),
            }
        }
    }
}

/// Stops runs that take too long, or were canceled, deleted or given away by another process, and takes up those of
/// processes that are gone.
pub(super) async fn watch(jobs: Arc<Jobs>) {
    let mut ticks = every(WATCH);
    loop {
        ticks.tick().await;
        if let Err(error) = stop_unwanted(&jobs).await {
            tracing::error!(%error, "it cannot be seen which jobs are to stop");
        }
        if let Err(error) = take_up(&jobs).await {
            tracing::error!(%error, "leases cannot be checked");
        }
    }
}

async fn stop_unwanted(jobs: &Jobs) -> Result<(), StoreError> {
    // First what runs, then what may: a run that begins in between is not looked at.
    let running = jobs.running().all();
    if running.is_empty() {
        return Ok(());
    }
    for running in &running {
        running.stop_if_late();
    }
    let held = jobs.store().held_by(jobs.instance().id()).await?;
    for running in running {
        let is_wanted = held.iter().any(|held| held.lease == running.lease && !held.cancel_requested);
        if !is_wanted {
            running.stop();
        }
    }
    Ok(())
}

async fn take_up(jobs: &Jobs) -> Result<(), OpenError> {
    jobs.take_up_dead().await?;
    // After a jump of the clock every lease looks as if it had run out, until its worker has extended it.
    if let Some(now) = jobs.clock().steady_for_all_for(LEASE.unsigned_abs()) {
        jobs.reclaim(Reclaim::LeaseBefore(now)).await?;
    }
    Ok(())
}

fn every(period: Duration) -> Interval {
    let mut ticks = interval(period);
    ticks.set_missed_tick_behavior(MissedTickBehavior::Delay);
    ticks
}
