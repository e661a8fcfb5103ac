//! What has to be seen to beside the work: jobs and files that processes left which are gone, files that no
//! job names, and what is due when a job has ended.

use std::time::Duration;

use jiff::Timestamp;

use super::blocking::on_own_thread;
use super::error::JobsError;
use super::job::{JobId, JobState};
use super::place::OpenError;
use super::service::Jobs;
use super::store::{Reclaim, StoreError};

/// How old a file must be that no job names before it is swept while others may be at work.
const SWEEP_AGE: Duration = Duration::from_secs(3600);

impl Jobs {
    /// Takes up what others left, at the start. Files are swept however young they are when nobody else can be
    /// writing them.
    pub(super) async fn take_over(&self) -> Result<(), OpenError> {
        let taken_up = self.take_up_dead().await?;
        let peers = self.instance().peers();
        let is_alone = !on_own_thread(move || peers.has_company()).await?;
        let swept = self.sweep(if is_alone { Duration::ZERO } else { SWEEP_AGE }).await?;
        tracing::info!(taken_up, swept, "data directory opened");
        Ok(())
    }

    /// Takes up what processes left that are gone: their jobs wait again, their scratch files go.
    pub(super) async fn take_up_dead(&self) -> Result<usize, OpenError> {
        let peers = self.instance().peers();
        let dead = on_own_thread(move || peers.dead()).await?;
        let mut taken_up = 0;
        for dead in dead {
            taken_up += self.reclaim(Reclaim::Instance(&dead)).await?;
            let (peers, blobs) = (self.instance().peers(), self.blobs().clone());
            on_own_thread(move || {
                blobs.sweep_scratch(&dead)?;
                peers.bury(&dead);
                Ok(())
            })
            .await?;
        }
        Ok(taken_up)
    }

    /// Takes jobs from workers that are gone. Says how many.
    pub(super) async fn reclaim(&self, which: Reclaim<'_>) -> Result<usize, StoreError> {
        let taken = self.store().reclaim(which, Timestamp::now()).await?;
        for (id, state) in &taken {
            tracing::warn!(job = %id, state = state.name(), "job taken from a worker that is gone");
            self.metrics().reclaimed();
            if state.has_ended() {
                let code = if *state == JobState::Failed { "too_many_attempts" } else { "" };
                self.metrics().ended(state.name(), code);
                self.has_ended(*id).await;
            } else {
                self.changes().state(*id);
                self.wake_one();
            }
        }
        Ok(taken.len())
    }

    /// Removes files older than `age` that no job names. Files first, rows then: what comes between
    /// is too young.
    async fn sweep(&self, age: Duration) -> Result<usize, OpenError> {
        let found = self.blobs().older_than(age).await?;
        let swept = self.blobs().sweep(found, self.store().kept_files().await?).await?;
        let blobs = self.blobs().clone();
        let drafts = on_own_thread(move || {
            if age.is_zero() {
                blobs.sweep_scratch_of_others()?;
            }
            blobs.sweep_drafts(age)
        });
        Ok(swept + drafts.await?)
    }

    pub(super) async fn sweep_old(&self) -> Result<usize, OpenError> {
        self.sweep(SWEEP_AGE).await
    }

    /// What is due at the end of every job.
    pub(super) async fn has_ended(&self, id: JobId) {
        if self.limits().keep.masks.is_some_and(|time| time.is_zero()) {
            self.forget_mask(id).await;
        }
        self.changes().state(id);
        self.wake_callbacks();
    }

    pub(super) async fn forget_mask(&self, id: JobId) {
        let erased = async {
            self.store().forget_mask(id).await?;
            Ok::<_, JobsError>(self.blobs().erase_mask(id).await?)
        };
        if let Err(error) = erased.await {
            tracing::error!(job = %id, %error, "a mask cannot be erased; it is tried again later");
        }
    }
}
