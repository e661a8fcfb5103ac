//! The store's promises, whatever database is behind it.

use std::collections::BTreeSet;
use std::sync::Arc;
use std::time::Duration;

use jiff::{SignedDuration, Timestamp};
use medialrep::jobs::job::{JobId, JobState, JobWarning, MaskInfo, ResultFile};
use medialrep::jobs::sqlite::SqliteStore;
use medialrep::jobs::store::{
    CancelAnswer, JobStore, Lease, ListQuery, MAX_ATTEMPTS, NewJob, Outcome, Reclaim, StoreError,
};
use medialrep::problem::Problem;
use tempfile::TempDir;

const LEASE: SignedDuration = SignedDuration::from_secs(30);

async fn store() -> (TempDir, Arc<dyn JobStore>) {
    let dir = TempDir::new().unwrap();
    let store = SqliteStore::open(&dir.path().join("jobs.sqlite")).await.unwrap();
    (dir, Arc::new(store))
}

async fn insert(store: &dyn JobStore) -> JobId {
    let id = JobId::now();
    let mask = MaskInfo { sha256: "ab".repeat(32), bytes: 7 };
    let job = NewJob { id, mask, params_json: "{}".to_owned(), created_at: Timestamp::now(), expected: Duration::ZERO };
    store.insert(&job, 1000).await.unwrap();
    id
}

async fn claim(store: &dyn JobStore) -> Option<Lease> {
    let now = Timestamp::now();
    store.claim(now, now + LEASE).await.unwrap().map(|claim| claim.lease)
}

async fn state(store: &dyn JobStore, id: JobId) -> JobState {
    store.get(id).await.unwrap().unwrap().state
}

fn succeeded() -> Outcome {
    let file = ResultFile { name: "a".into(), media_type: "b/c".into(), bytes: 1, sha256: "d".into() };
    Outcome::Succeeded { results: vec![file], warnings: vec![JobWarning { code: "e".into(), message: "f".into() }] }
}

#[tokio::test]
async fn jobs_are_claimed_in_order_of_arrival() {
    let (_dir, store) = store().await;
    let ids = [insert(&*store).await, insert(&*store).await, insert(&*store).await];
    assert_eq!(store.count_queued_before(ids[2]).await.unwrap(), 2);
    for id in ids {
        assert_eq!(claim(&*store).await.unwrap().id, id);
    }
    assert!(claim(&*store).await.is_none());
}

#[tokio::test]
async fn short_jobs_pass_long_ones_but_not_for_ever() {
    let (_dir, store) = store().await;
    let start = Timestamp::now();
    let arrives = async |after_s: i64, expected_s: u64| {
        let (id, mask) = (JobId::now(), MaskInfo { sha256: "ab".repeat(32), bytes: 7 });
        let created_at = start + SignedDuration::from_secs(after_s);
        let expected = Duration::from_secs(expected_s);
        store.insert(&NewJob { id, mask, params_json: "{}".to_owned(), created_at, expected }, 1000).await.unwrap();
        id
    };
    let long = arrives(0, 20).await;
    let short = arrives(1, 0).await;
    let middle = arrives(2, 3).await;
    let late = arrives(300, 0).await;
    for (place, id) in [short, middle, long, late].into_iter().enumerate() {
        assert_eq!(store.count_queued_before(id).await.unwrap(), place as u64);
    }
    for id in [short, middle, long, late] {
        assert_eq!(claim(&*store).await.unwrap().id, id);
    }
}

#[tokio::test(flavor = "multi_thread", worker_threads = 4)]
async fn two_workers_never_get_the_same_job() {
    let (_dir, store) = store().await;
    let mut ids = BTreeSet::new();
    for _ in 0..60 {
        ids.insert(insert(&*store).await);
    }
    let workers = (0..8).map(|_| {
        let store = Arc::clone(&store);
        tokio::spawn(async move {
            let mut claimed = Vec::new();
            while let Some(lease) = claim(&*store).await {
                claimed.push(lease.id);
            }
            claimed
        })
    });
    let mut claimed = Vec::new();
    for worker in workers.collect::<Vec<_>>() {
        claimed.extend(worker.await.unwrap());
    }
    assert_eq!(claimed.len(), 60);
    assert_eq!(claimed.into_iter().collect::<BTreeSet<_>>(), ids);
}

#[tokio::test]
async fn an_outcome_is_kept_as_written() {
    let (_dir, store) = store().await;
    let id = insert(&*store).await;
    let lease = claim(&*store).await.unwrap();
    store.finish(&lease, &succeeded(), Timestamp::now()).await.unwrap();
    let job = store.get(id).await.unwrap().unwrap();
    assert_eq!((job.state, job.results_token.as_deref()), (JobState::Succeeded, Some(lease.token.as_str())));
    assert_eq!((job.results.len(), job.warnings.len(), job.mask.bytes), (1, 1, 7));
    assert!(job.ended_at >= job.started_at && job.error.is_none());

    let id = insert(&*store).await;
    let lease = claim(&*store).await.unwrap();
    let problem = Problem::new(422, "too_thin", "thin").at("here").hint("there");
    store.finish(&lease, &Outcome::Failed(Box::new(problem.clone())), Timestamp::now()).await.unwrap();
    let job = store.get(id).await.unwrap().unwrap();
    assert_eq!((job.state, job.error, job.results_token), (JobState::Failed, Some(problem), None));
}

#[tokio::test]
async fn a_worker_that_lost_its_lease_changes_nothing() {
    let (_dir, store) = store().await;
    let id = insert(&*store).await;
    let late = claim(&*store).await.unwrap();
    assert_eq!(store.reclaim(Reclaim::LeaseBefore(Timestamp::now()), Timestamp::now()).await.unwrap(), 0);
    let later = Timestamp::now() + LEASE + LEASE;
    assert_eq!(store.reclaim(Reclaim::LeaseBefore(later), later).await.unwrap(), 1);
    let current = claim(&*store).await.unwrap();
    assert_eq!((current.id, current.token == late.token), (id, false));
    let now = Timestamp::now();
    assert!(matches!(store.finish(&late, &succeeded(), now).await, Err(StoreError::StaleLease)));
    assert!(matches!(store.extend(&late, now + LEASE).await, Err(StoreError::StaleLease)));
    assert!(matches!(store.release(&late).await, Err(StoreError::StaleLease)));
    assert_eq!(state(&*store, id).await, JobState::Running);
    store.finish(&current, &succeeded(), now).await.unwrap();
    assert!(matches!(store.finish(&current, &Outcome::Canceled, now).await, Err(StoreError::StaleLease)));
    assert_eq!(state(&*store, id).await, JobState::Succeeded);
}

#[tokio::test]
async fn a_job_that_takes_its_server_down_is_given_up() {
    let (_dir, store) = store().await;
    let id = insert(&*store).await;
    for attempt in 1..=MAX_ATTEMPTS {
        claim(&*store).await.unwrap();
        assert_eq!(store.get(id).await.unwrap().unwrap().attempt, attempt);
        assert_eq!(store.reclaim(Reclaim::All, Timestamp::now()).await.unwrap(), 1);
    }
    let job = store.get(id).await.unwrap().unwrap();
    assert_eq!((job.state, job.error.unwrap().code.as_str()), (JobState::Failed, "too_many_attempts"));
    assert!(job.ended_at.is_some());
}

#[tokio::test]
async fn a_released_job_keeps_its_attempts() {
    let (_dir, store) = store().await;
    let id = insert(&*store).await;
    for _ in 0..2 * MAX_ATTEMPTS {
        let lease = claim(&*store).await.unwrap();
        store.release(&lease).await.unwrap();
    }
    let job = store.get(id).await.unwrap().unwrap();
    assert_eq!((job.state, job.attempt, job.started_at), (JobState::Queued, 0, None));
}

#[tokio::test]
async fn cancelling_ends_what_waits_and_marks_what_runs() {
    let (_dir, store) = store().await;
    let now = Timestamp::now();
    let (running, waiting) = (insert(&*store).await, insert(&*store).await);
    let lease = claim(&*store).await.unwrap();
    assert_eq!(store.cancel(waiting, now).await.unwrap(), CancelAnswer::Canceled);
    assert_eq!(store.cancel(waiting, now).await.unwrap(), CancelAnswer::AlreadyEnded(JobState::Canceled));
    assert!(!store.extend(&lease, now + LEASE).await.unwrap());
    assert_eq!(store.cancel(running, now).await.unwrap(), CancelAnswer::Requested);
    assert!(store.extend(&lease, now + LEASE).await.unwrap());
    assert_eq!(store.cancel(JobId::now(), now).await.unwrap(), CancelAnswer::NotFound);
    // Its worker dies before it notices.
    store.reclaim(Reclaim::All, now).await.unwrap();
    assert_eq!(state(&*store, running).await, JobState::Canceled);
    assert!(claim(&*store).await.is_none());
}

#[tokio::test]
async fn the_queue_is_bounded_under_parallel_inserts() {
    let (_dir, store) = store().await;
    let inserts = (0..20).map(|_| {
        let store = Arc::clone(&store);
        tokio::spawn(async move {
            let mask = MaskInfo { sha256: String::new(), bytes: 0 };
            let id = JobId::now();
            let job = NewJob {
                id,
                mask,
                params_json: "{}".to_owned(),
                created_at: Timestamp::now(),
                expected: Duration::ZERO,
            };
            store.insert(&job, 7).await.is_ok()
        })
    });
    let mut kept = 0;
    for insert in inserts.collect::<Vec<_>>() {
        kept += u64::from(insert.await.unwrap());
    }
    assert_eq!((kept, store.count_queued().await.unwrap()), (7, 7));
}

#[tokio::test]
async fn a_deleted_job_is_gone_for_its_worker_too() {
    let (_dir, store) = store().await;
    let id = insert(&*store).await;
    let lease = claim(&*store).await.unwrap();
    assert!(store.delete(id).await.unwrap());
    assert!(!store.delete(id).await.unwrap());
    assert!(store.get(id).await.unwrap().is_none());
    assert!(matches!(store.finish(&lease, &succeeded(), Timestamp::now()).await, Err(StoreError::StaleLease)));
    assert!(store.list(ListQuery { limit: 9, ..ListQuery::default() }).await.unwrap().is_empty());
}
