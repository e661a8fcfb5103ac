//! What has to be seen to beside the work: jobs and files that processes left which are gone, files that no
//! job names, and what is due when a job has ended.

use std::collections::BTreeMap;
use std::time::Duration;

use jiff::Timestamp;
use tokio::time::Instant;

use super::blocking::on_own_thread;
use super::error::JobsError;
use super::job::{JobId, JobState};
use super::place::OpenError;
use super::service::Jobs;
use super::store::blobs::{StoredKey, lost_jobs, without_kept};
use super::store::{Reclaim, StoreError};

/// How long it must be known that no job names a file before it is swept while others may be at work. A file has its row within
/// seconds. Its own age says nothing: a result that is used again is a link to an old file, and the clock of the wall may jump.
const UNNAMED_FOR: Duration = Duration::from_secs(1800);

/// Files that no job names, and since when that is known.
#[derive(Debug, Default)]
pub(super) struct Unnamed {
    since: BTreeMap<StoredKey, Instant>,
}

impl Unnamed {
    /// Takes in what is unnamed now. Those that have been for long enough.
    fn look(&mut self, found: Vec<StoredKey>, now: Instant) -> Vec<StoredKey> {
        let before = std::mem::take(&mut self.since);
        let mut ripe = Vec::new();
        for key in found {
            let since = before.get(&key).copied().unwrap_or(now);
            if now.duration_since(since) >= UNNAMED_FOR {
                ripe.push(key.clone());
            }
            self.since.insert(key, since);
        }
        ripe
    }
}

impl Jobs {
    /// Takes up what others left, at the start. Files that no job names are swept at once when nobody else can be writing
    /// them, and deliveries are due at once when nobody else can be sending them; whoever starts meanwhile waits.
    pub(super) async fn take_over(&self) -> Result<(), OpenError> {
        let taken_up = self.take_up_dead().await?;
        let peers = self.instance().peers();
        let swept = match on_own_thread(move || peers.alone()).await? {
            Some(alone) => {
                self.store().all_deliveries_due(Timestamp::now()).await?;
                let swept = self.sweep_all().await;
                drop(alone);
                swept
            }
            None => self.sweep_old().await,
        };
        match swept {
            Ok(swept) => tracing::info!(taken_up, swept, "data directory opened"),
            // Nobody's work depends on it.
            Err(error) => tracing::error!(taken_up, %error, "files that no job names cannot be swept"),
        }
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

    /// Removes all files that no job names.
    async fn sweep_all(&self) -> Result<usize, OpenError> {
        let blobs = self.blobs().clone();
        on_own_thread(move || blobs.sweep_scratch_of_others()).await?;
        let found = self.blobs().stored().await?;
        let kept = self.store().kept_files().await?;
        let erased = self.store().erased_jobs().await?;
        let audit = self.audit();
        let (left, lost) = on_own_thread(move || {
            let lost = lost_jobs(&found, (&kept, &erased), &audit.jobs_left()?);
            let mut left = without_kept(found, kept);
            left.retain(|key| key.job().is_none_or(|job| !lost.contains(&job)));
            Ok((left, lost))
        })
        .await?;
        if let Some(first) = lost.first() {
            tracing::error!(
                jobs = lost.len(),
                first,
                "there are files of jobs that the audit log has and the database has not: it may have lost its last changes, or \
                 be an earlier one; stop the server within an hour to keep them"
            );
        }
        Ok(self.blobs().remove(&left).await)
    }

    /// Removes files of which it has been known for long enough that no job names them.
    pub(super) async fn sweep_old(&self) -> Result<usize, OpenError> {
        let mut known = self.known_unnamed().lock().await;
        let ripe = known.look(self.unnamed().await?, Instant::now());
        Ok(self.blobs().remove(&ripe).await)
    }

    /// Files that no job names now. Files first, rows then: what is stored in between is not looked at.
    async fn unnamed(&self) -> Result<Vec<StoredKey>, OpenError> {
        let found = self.blobs().stored().await?;
        let kept = self.store().kept_files().await?;
        Ok(on_own_thread(move || Ok(without_kept(found, kept))).await?)
    }

    /// What is due at the end of every job.
    pub(super) async fn has_ended(&self, id: JobId) {
        if self.limits().keep.masks.is_some_and(|time| time.is_zero()) {
            self.forget_mask(id).await;
        }
        self.changes().state(id);
        self.wake_callbacks();
        self.wake_deliveries();
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_file_is_swept_when_no_job_has_named_it_for_long_enough() {
        let [left, named_later] = ["left", "named later"].map(StoredKey::other);
        let (start, mut known) = (Instant::now(), Unnamed::default());
        let mut look = |found: &[&StoredKey], halves: u32| {
            known.look(found.iter().copied().cloned().collect(), start + UNNAMED_FOR / 2 * halves)
        };
        assert!(look(&[&left, &named_later], 0).is_empty(), "they may have their rows in a moment");
        assert!(look(&[&left], 1).is_empty());
        // Unnamed again, it is as if it had never been.
        assert_eq!(look(&[&left, &named_later], 2), [left]);
        assert!(look(&[&named_later], 3).is_empty());
    }
}
