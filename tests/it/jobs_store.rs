//! The store's promises, whatever database is behind it.

use std::collections::BTreeSet;
use std::sync::Arc;
use std::time::Duration;

use jiff::{SignedDuration, Timestamp};
use medialrep::jobs::job::{
    Job, JobId, JobState, JobWarning, MaskInfo, RequestedParams, ResultFile, SendState, SendTry,
};
use medialrep::jobs::moves::Cause;
use medialrep::jobs::place::Place;
use medialrep::jobs::store::{
    CancelAnswer, Held, Inserted, Lease, ListQuery, MAX_ATTEMPTS, NewJob, Outcome, QueueLimits, Reclaim, RetryAnswer,
    Reused, SendNext, Store, StoreError,
};
use medialrep::jobs::token::{Scope, Token};
use medialrep::problem::Problem;
use tempfile::TempDir;

const LEASE: SignedDuration = SignedDuration::from_secs(30);

/// The one place that opens a store: all that follows holds for any.
async fn store() -> (TempDir, Arc<dyn Store>) {
    let dir = TempDir::new().unwrap();
    let store = Place::at(dir.path()).open_store().await.unwrap();
    (dir, store)
}

const LIMITS: QueueLimits = QueueLimits { jobs: 1000, bytes: 1 << 30, share_percent: 100, storage_bytes: u64::MAX };

fn new_job() -> NewJob {
    NewJob {
        id: JobId::now(),
        owner: "one".to_owned(),
        mask: MaskInfo { sha256: "ab".repeat(32), bytes: 7 },
        params_json: RequestedParams::parse(None).unwrap().json().to_owned(),
        labels: [("study".to_owned(), "liver".to_owned())].into(),
        idempotency_key: None,
        request_sha256: "request".to_owned(),
        work_sha256: "work".to_owned(),
        callback_url: None,
        deliver_to: None,
        trace_id: "trace".to_owned(),
        created_at: Timestamp::now(),
        expected: Duration::ZERO,
        reused: None,
    }
}

async fn insert(store: &dyn Store) -> JobId {
    let job = new_job();
    assert_eq!(store.insert(&job, LIMITS).await.unwrap(), Inserted::New);
    job.id
}

async fn insert_of(store: &dyn Store, owner: &str) -> JobId {
    let job = NewJob { owner: owner.to_owned(), ..new_job() };
    store.insert(&job, LIMITS).await.unwrap();
    job.id
}

async fn claim(store: &dyn Store) -> Option<Lease> {
    let now = Timestamp::now();
    store.claim("here", now, now + LEASE).await.unwrap().map(|claim| claim.lease)
}

async fn get(store: &dyn Store, id: JobId) -> Job {
    store.get(id).await.unwrap().unwrap()
}

async fn place(store: &dyn Store, id: JobId) -> u64 {
    store.positions(&[id]).await.unwrap()[&id]
}

async fn state(store: &dyn Store, id: JobId) -> JobState {
    store.get(id).await.unwrap().unwrap().state
}

fn succeeded() -> Outcome {
    let file = ResultFile { name: "a".into(), media_type: "b/c".into(), bytes: 1, sha256: "d".into(), dicom: None };
    let warnings = vec![JobWarning { code: "e".into(), message: "f".into() }];
    Outcome::Succeeded { results: vec![file], warnings, program: "1".into() }
}

fn failed() -> Outcome {
    Outcome::Failed(Box::new(Problem::internal()))
}

#[tokio::test]
async fn jobs_are_claimed_in_order_of_arrival() {
    let (_dir, store) = store().await;
    let ids = [insert(&*store).await, insert(&*store).await, insert(&*store).await];
    assert_eq!(place(&*store, ids[2]).await, 3);
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
        let created_at = start + SignedDuration::from_secs(after_s);
        let job = NewJob { created_at, expected: Duration::from_secs(expected_s), ..new_job() };
        store.insert(&job, LIMITS).await.unwrap();
        job.id
    };
    let long = arrives(0, 20).await;
    let short = arrives(1, 0).await;
    let middle = arrives(2, 3).await;
    let late = arrives(300, 0).await;
    for (before, id) in [short, middle, long, late].into_iter().enumerate() {
        assert_eq!(place(&*store, id).await, before as u64 + 1);
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
    assert_eq!(store.reclaim(Reclaim::LeaseBefore(Timestamp::now()), Timestamp::now()).await.unwrap(), []);
    let later = Timestamp::now() + LEASE + LEASE;
    assert_eq!(store.reclaim(Reclaim::LeaseBefore(later), later).await.unwrap(), [(id, JobState::Queued)]);
    let current = claim(&*store).await.unwrap();
    assert_eq!((current.id, current.token == late.token), (id, false));
    let now = Timestamp::now();
    assert!(matches!(store.finish(&late, &succeeded(), now).await, Err(StoreError::StaleLease)));
    assert!(matches!(store.extend(&late, now + LEASE).await, Err(StoreError::StaleLease)));
    assert!(matches!(store.release(&late, now).await, Err(StoreError::StaleLease)));
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
        let state = if attempt < MAX_ATTEMPTS { JobState::Queued } else { JobState::Failed };
        assert_eq!(store.reclaim(Reclaim::Instance("there"), Timestamp::now()).await.unwrap(), []);
        assert_eq!(store.reclaim(Reclaim::Instance("here"), Timestamp::now()).await.unwrap(), [(id, state)]);
    }
    let job = store.get(id).await.unwrap().unwrap();
    assert_eq!((job.state, job.error.unwrap().code.as_str()), (JobState::Failed, "too_many_attempts"));
    assert!(job.ended_at.is_some());
}

#[tokio::test]
async fn suspects_of_a_crash_run_alone_and_only_the_one_that_crashes_is_given_up() {
    let (_dir, store) = store().await;
    let (poison, innocent) = (insert(&*store).await, insert(&*store).await);
    let later = insert(&*store).await;
    for _ in [poison, innocent] {
        store.claim("crashing", Timestamp::now(), Timestamp::now() + LEASE).await.unwrap().unwrap();
    }
    store.reclaim(Reclaim::Instance("crashing"), Timestamp::now()).await.unwrap();
    for id in [poison, innocent] {
        let job = get(&*store, id).await;
        assert_eq!((job.state, job.attempt), (JobState::Queued, 0), "nobody knows which it was");
    }
    // Each is alone now, so they cannot crash together again but in two processes.
    let alone = claim(&*store).await.unwrap();
    assert_eq!(alone.id, poison);
    assert!(claim(&*store).await.is_none(), "nothing runs beside it");
    let elsewhere = store.claim("there", Timestamp::now(), Timestamp::now() + LEASE).await.unwrap().unwrap();
    assert_eq!(elsewhere.lease.id, innocent);
    assert!(store.claim("there", Timestamp::now(), Timestamp::now() + LEASE).await.unwrap().is_none());
    for lease in [&alone, &elsewhere.lease] {
        store.release(lease, Timestamp::now()).await.unwrap();
    }
    for attempt in 1..=MAX_ATTEMPTS {
        let lease = claim(&*store).await.unwrap();
        assert_eq!((lease.id, get(&*store, poison).await.attempt), (poison, attempt));
        store.reclaim(Reclaim::Instance("here"), Timestamp::now()).await.unwrap();
    }
    assert_eq!(state(&*store, poison).await, JobState::Failed);
    for id in [innocent, later] {
        let lease = claim(&*store).await.unwrap();
        assert_eq!((lease.id, get(&*store, id).await.attempt), (id, 1));
        store.finish(&lease, &succeeded(), Timestamp::now()).await.unwrap();
    }
}

#[tokio::test]
async fn a_suspect_waits_for_what_runs_already() {
    let (_dir, store) = store().await;
    let first = insert(&*store).await;
    let running = claim(&*store).await.unwrap();
    assert_eq!(running.id, first);
    let (one, _two) = (insert(&*store).await, insert(&*store).await);
    for _ in 0..2 {
        store.claim("crashing", Timestamp::now(), Timestamp::now() + LEASE).await.unwrap().unwrap();
    }
    store.reclaim(Reclaim::Instance("crashing"), Timestamp::now()).await.unwrap();
    assert!(claim(&*store).await.is_none(), "it is not alone yet");
    store.finish(&running, &succeeded(), Timestamp::now()).await.unwrap();
    assert_eq!(claim(&*store).await.unwrap().id, one);
}

#[tokio::test]
async fn a_released_job_keeps_its_attempts() {
    let (_dir, store) = store().await;
    let id = insert(&*store).await;
    for _ in 0..2 * MAX_ATTEMPTS {
        let lease = claim(&*store).await.unwrap();
        store.release(&lease, Timestamp::now()).await.unwrap();
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
    let held = |cancel_requested| [Held { lease: lease.clone(), cancel_requested }];
    assert_eq!(store.held_by("here").await.unwrap(), held(false));
    assert_eq!(store.cancel(running, now).await.unwrap(), CancelAnswer::Requested);
    assert_eq!(store.held_by("here").await.unwrap(), held(true));
    assert_eq!(store.held_by("there").await.unwrap(), []);
    assert_eq!(store.cancel(JobId::now(), now).await.unwrap(), CancelAnswer::NotFound);
    // Its worker dies before it notices.
    store.reclaim(Reclaim::Instance("here"), now).await.unwrap();
    assert_eq!(state(&*store, running).await, JobState::Canceled);
    assert!(claim(&*store).await.is_none());
}

#[tokio::test]
async fn the_queue_is_bounded_under_parallel_inserts() {
    let (_dir, store) = store().await;
    let inserts = (0..20).map(|_| {
        let store = Arc::clone(&store);
        tokio::spawn(async move { store.insert(&new_job(), QueueLimits { jobs: 7, ..LIMITS }).await.is_ok() })
    });
    let mut kept = 0;
    for insert in inserts.collect::<Vec<_>>() {
        kept += u64::from(insert.await.unwrap());
    }
    assert_eq!((kept, store.load("one").await.unwrap().jobs), (7, 7));
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
    assert!(
        store.list(&ListQuery { owner: "one".to_owned(), limit: 9, ..ListQuery::default() }).await.unwrap().is_empty()
    );
}

#[tokio::test]
async fn a_tenant_gets_its_share_of_the_queue_and_no_more() {
    let (_dir, store) = store().await;
    let limits = QueueLimits { jobs: 10, bytes: 100, share_percent: 30, storage_bytes: u64::MAX };
    for _ in 0..3 {
        store.insert(&new_job(), limits).await.unwrap();
    }
    assert!(matches!(store.insert(&new_job(), limits).await, Err(StoreError::ShareFull)));
    let other = |bytes| {
        let mask = MaskInfo { sha256: String::new(), bytes };
        NewJob { owner: "other".to_owned(), mask, ..new_job() }
    };
    assert!(matches!(store.insert(&other(31), limits).await, Err(StoreError::ShareFull)));
    store.insert(&other(30), limits).await.unwrap();
    let all = QueueLimits { share_percent: 100, ..limits };
    assert!(matches!(store.insert(&other(50), all).await, Err(StoreError::QueueFull)));
    let load = store.load("other").await.unwrap();
    assert_eq!((load.jobs, load.bytes, load.own_jobs, load.own_bytes), (4, 51, 1, 30));
}

#[tokio::test]
async fn a_flood_of_one_tenant_does_not_hold_up_the_others() {
    let (_dir, store) = store().await;
    let begun = Timestamp::now();
    let arrives = async |owner: &str, after_s: i64, expected_s: u64| {
        let created_at = begun + SignedDuration::from_secs(after_s);
        let expected = Duration::from_secs(expected_s);
        let job = NewJob { owner: owner.to_owned(), created_at, expected, ..new_job() };
        store.insert(&job, LIMITS).await.unwrap();
        job.id
    };
    // Their turns are 20 s apart, and those of the other lanes of the same tenant do not wait for them.
    let flood = [arrives("one", 0, 2).await, arrives("one", 0, 2).await, arrives("one", 0, 2).await];
    let other = arrives("other", 1, 2).await;
    let short = arrives("one", 25, 0).await;
    let order = [flood[0], other, short, flood[1], flood[2]];
    let positions = store.positions(&order).await.unwrap();
    for (at, id) in order.into_iter().enumerate() {
        assert_eq!(positions[&id], at as u64 + 1);
        assert_eq!(claim(&*store).await.unwrap().id, id);
    }
    assert!(store.positions(&order).await.unwrap().is_empty());
}

#[tokio::test]
async fn an_idempotency_key_stands_for_one_request_of_one_tenant() {
    let (_dir, store) = store().await;
    let keyed = |owner: &str, request: &str| NewJob {
        owner: owner.to_owned(),
        request_sha256: request.to_owned(),
        idempotency_key: Some("key".to_owned()),
        ..new_job()
    };
    let first = keyed("one", "a");
    assert_eq!(store.insert(&first, LIMITS).await.unwrap(), Inserted::New);
    // Known although the queue is full.
    let full = QueueLimits { jobs: 0, ..LIMITS };
    assert_eq!(store.insert(&keyed("one", "a"), full).await.unwrap(), Inserted::Known(first.id));
    assert!(matches!(store.insert(&keyed("one", "b"), LIMITS).await, Err(StoreError::KeyReused)));
    assert_eq!(store.insert(&keyed("two", "b"), LIMITS).await.unwrap(), Inserted::New);
    assert_eq!(store.find_key("one", "key").await.unwrap(), Some(first.id));
    store.delete(first.id).await.unwrap();
    assert_eq!(store.insert(&keyed("one", "b"), LIMITS).await.unwrap(), Inserted::New);
}

#[tokio::test]
async fn only_kept_results_of_the_same_tenant_and_program_are_reused() {
    let (_dir, store) = store().await;
    let id = insert(&*store).await;
    assert!(store.find_equal("one", "work", "1").await.unwrap().is_none());
    let lease = claim(&*store).await.unwrap();
    store.finish(&lease, &succeeded(), Timestamp::now()).await.unwrap();
    assert_eq!(store.find_equal("one", "work", "1").await.unwrap().unwrap().id, id);
    for (owner, work, program) in [("two", "work", "1"), ("one", "other", "1"), ("one", "work", "2")] {
        assert!(store.find_equal(owner, work, program).await.unwrap().is_none(), "{owner} {work} {program}");
    }
    let reused = Reused { token: "t".into(), results: vec![], warnings: vec![], program: "1".into() };
    let job = NewJob { reused: Some(reused), ..new_job() };
    store.insert(&job, QueueLimits { jobs: 0, ..LIMITS }).await.unwrap();
    let job = get(&*store, job.id).await;
    assert_eq!((job.state, job.reused, job.results_token.as_deref()), (JobState::Succeeded, true, Some("t")));
    assert!(job.ended_at.is_some() && claim(&*store).await.is_none());
    let later = Timestamp::now() + LEASE;
    assert_eq!(store.expire_results(later, 100).await.unwrap().len(), 2);
    assert!(store.find_equal("one", "work", "1").await.unwrap().is_none());
}

#[tokio::test]
async fn a_result_is_added_once_and_only_while_results_are_kept() {
    let (_dir, store) = store().await;
    let id = insert(&*store).await;
    let lease = claim(&*store).await.expect("it waits");
    let file = ResultFile {
        name: "more".to_owned(),
        media_type: "text/csv".to_owned(),
        bytes: 3,
        sha256: "cd".repeat(32),
        dicom: None,
    };
    assert!(!store.add_result(id, &lease.token, &file).await.unwrap(), "it runs");
    store.finish(&lease, &succeeded(), Timestamp::now()).await.unwrap();
    let before = get(&*store, id).await.results.len();
    assert!(!store.add_result(id, "another", &file).await.unwrap(), "the folder is another run's");
    for _ in 0..2 {
        assert!(store.add_result(id, &lease.token, &file).await.unwrap());
        let results = get(&*store, id).await.results;
        assert_eq!((results.len(), results.last()), (before + 1, Some(&file)));
    }
    store.expire_results(Timestamp::now() + LEASE, 10).await.unwrap();
    assert!(!store.add_result(id, &lease.token, &file).await.unwrap(), "the results are erased");
}

#[tokio::test]
async fn a_job_tells_its_history() {
    let (_dir, store) = store().await;
    let id = insert(&*store).await;
    let lease = claim(&*store).await.unwrap();
    store.release(&lease, Timestamp::now()).await.unwrap();
    claim(&*store).await.unwrap();
    store.reclaim(Reclaim::Instance("here"), Timestamp::now()).await.unwrap();
    store.cancel(id, Timestamp::now()).await.unwrap();
    store.retry(id, Timestamp::now(), LIMITS).await.unwrap();
    let lease = claim(&*store).await.unwrap();
    store.finish(&lease, &succeeded(), Timestamp::now()).await.unwrap();
    let history = get(&*store, id).await.history;
    let states: Vec<_> = history.iter().map(|change| change.state.name()).collect();
    let expected = ["queued", "running", "queued", "running", "queued", "canceled", "queued", "running", "succeeded"];
    assert_eq!(states, expected);
    assert!(history.is_sorted_by_key(|change| change.at));
}

#[tokio::test]
async fn what_failed_or_was_canceled_can_be_run_again() {
    let (_dir, store) = store().await;
    let now = Timestamp::now();
    let id = insert(&*store).await;
    assert_eq!(store.retry(id, now, LIMITS).await.unwrap(), RetryAnswer::NotRetryable(JobState::Queued));
    let lease = claim(&*store).await.unwrap();
    store.finish(&lease, &failed(), now).await.unwrap();
    assert!(matches!(store.retry(id, now, QueueLimits { jobs: 0, ..LIMITS }).await, Err(StoreError::QueueFull)));
    assert_eq!(store.retry(id, now, LIMITS).await.unwrap(), RetryAnswer::Queued);
    let job = get(&*store, id).await;
    assert_eq!((job.state, job.attempt, job.error, job.ended_at), (JobState::Queued, 0, None, None));
    store.cancel(id, now).await.unwrap();
    store.forget_mask(id).await.unwrap();
    assert_eq!(store.retry(id, now, LIMITS).await.unwrap(), RetryAnswer::MaskErased);
    assert_eq!(store.retry(JobId::now(), now, LIMITS).await.unwrap(), RetryAnswer::NotFound);
}

/// A new job, brought to this state, and the lease of its last run.
async fn job_in(store: &dyn Store, state: JobState) -> (JobId, Lease) {
    let id = insert(store).await;
    let mut lease = Lease { id, token: "none".to_owned() };
    if !matches!(state, JobState::Queued | JobState::Canceled) {
        lease = claim(store).await.unwrap();
    }
    let now = Timestamp::now();
    match state {
        JobState::Queued | JobState::Running => {}
        JobState::Succeeded => store.finish(&lease, &succeeded(), now).await.unwrap(),
        JobState::Failed => store.finish(&lease, &failed(), now).await.unwrap(),
        JobState::Canceled => assert_eq!(store.cancel(id, now).await.unwrap(), CancelAnswer::Canceled),
    }
    (id, lease)
}

/// Does what is the cause of a move, whether it is legal or not.
async fn bring_about(store: &dyn Store, cause: Cause, lease: &Lease) {
    let now = Timestamp::now();
    match cause {
        Cause::Claim => drop(claim(store).await),
        Cause::Cancel => drop(store.cancel(lease.id, now).await.unwrap()),
        Cause::Succeed => drop(store.finish(lease, &succeeded(), now).await),
        Cause::Fail => drop(store.finish(lease, &failed(), now).await),
        Cause::Stop => drop(store.finish(lease, &Outcome::Canceled, now).await),
        Cause::Release => drop(store.release(lease, now).await),
        Cause::Lose => drop(store.reclaim(Reclaim::Instance("here"), now).await.unwrap()),
        Cause::LoseOften | Cause::LoseUnwanted | Cause::Reuse => unreachable!("brought about below"),
        Cause::Retry => drop(store.retry(lease.id, now, LIMITS).await.unwrap()),
    }
}

#[tokio::test]
async fn jobs_move_as_the_table_says_and_not_otherwise() {
    let (_dir, store) = store().await;
    for cause in Cause::ALL {
        if matches!(cause, Cause::LoseOften | Cause::LoseUnwanted | Cause::Reuse) {
            continue;
        }
        for before in JobState::ALL {
            let (id, lease) = job_in(&*store, before).await;
            bring_about(&*store, cause, &lease).await;
            let job = get(&*store, id).await;
            assert_eq!(job.state, before.after(cause).unwrap_or(before), "{cause:?} of a job that was {before:?}");
            assert_eq!(job.history.last().unwrap().state, job.state, "{cause:?} of a job that was {before:?}");
            assert_eq!(job.ended_at.is_some(), job.state.has_ended(), "{cause:?} of a job that was {before:?}");
            store.delete(id).await.unwrap();
        }
    }
}

#[tokio::test]
async fn a_job_whose_worker_is_lost_moves_as_the_table_says() {
    let (_dir, store) = store().await;
    let often = insert(&*store).await;
    for _ in 0..MAX_ATTEMPTS {
        claim(&*store).await.unwrap();
        store.reclaim(Reclaim::Instance("here"), Timestamp::now()).await.unwrap();
    }
    assert_eq!(Some(state(&*store, often).await), JobState::Running.after(Cause::LoseOften));
    let unwanted = insert(&*store).await;
    claim(&*store).await.unwrap();
    store.cancel(unwanted, Timestamp::now()).await.unwrap();
    store.reclaim(Reclaim::Instance("here"), Timestamp::now()).await.unwrap();
    assert_eq!(Some(state(&*store, unwanted).await), JobState::Running.after(Cause::LoseUnwanted));
}

#[tokio::test(flavor = "multi_thread", worker_threads = 4)]
async fn of_many_retries_at_once_one_queues_the_job_and_none_takes_it_from_its_worker() {
    let (_dir, store) = store().await;
    for round in 0..20 {
        let (id, _) = job_in(&*store, JobState::Failed).await;
        let mut retries = Vec::new();
        for _ in 0..4 {
            let store = Arc::clone(&store);
            retries.push(tokio::spawn(async move { store.retry(id, Timestamp::now(), LIMITS).await.unwrap() }));
        }
        while claim(&*store).await.is_none() {
            tokio::task::yield_now().await;
        }
        let mut queued = 0;
        for retry in retries {
            queued += usize::from(retry.await.unwrap() == RetryAnswer::Queued);
        }
        let job = get(&*store, id).await;
        assert_eq!((queued, job.state, job.attempt), (1, JobState::Running, 1), "round {round}");
        assert!(claim(&*store).await.is_none(), "round {round}");
        store.delete(id).await.unwrap();
    }
}

#[tokio::test]
async fn a_job_that_is_retried_needs_room_for_itself_only() {
    let (_dir, store) = store().await;
    let (id, _) = job_in(&*store, JobState::Failed).await;
    insert(&*store).await;
    let (full, room) = (QueueLimits { jobs: 1, ..LIMITS }, QueueLimits { jobs: 2, bytes: 14, ..LIMITS });
    assert!(matches!(store.retry(id, Timestamp::now(), full).await, Err(StoreError::QueueFull)));
    assert_eq!(state(&*store, id).await, JobState::Failed);
    assert_eq!(store.retry(id, Timestamp::now(), room).await.unwrap(), RetryAnswer::Queued);
}

#[tokio::test]
async fn jobs_are_listed_by_tenant_state_and_label() {
    let (_dir, store) = store().await;
    let (first, second) = (insert(&*store).await, insert(&*store).await);
    insert_of(&*store, "two").await;
    store.cancel(first, Timestamp::now()).await.unwrap();
    let list = async |state, label: Option<(&str, &str)>| {
        let label = label.map(|(name, value)| (name.to_owned(), value.to_owned()));
        let query = ListQuery { owner: "one".to_owned(), state, label, before: None, limit: 9 };
        let jobs = store.list(&query).await.unwrap();
        jobs.into_iter().map(|job| job.id).collect::<Vec<_>>()
    };
    assert_eq!(list(None, None).await, [second, first]);
    assert_eq!(list(Some(JobState::Canceled), None).await, [first]);
    assert_eq!(list(None, Some(("study", "liver"))).await, [second, first]);
    assert_eq!(list(None, Some(("study", "kidney"))).await, []);
    store.delete(second).await.unwrap();
    assert_eq!(list(None, Some(("study", "liver"))).await, [first]);
}

#[tokio::test]
async fn what_is_old_is_given_out_to_be_erased_once() {
    let (_dir, store) = store().await;
    let (done, waiting) = (insert(&*store).await, insert(&*store).await);
    let lease = claim(&*store).await.unwrap();
    store.finish(&lease, &succeeded(), Timestamp::now()).await.unwrap();
    let (early, late) = (Timestamp::now() - LEASE, Timestamp::now() + LEASE);
    assert_eq!(store.expire_masks(early, 9).await.unwrap(), []);
    let kept = store.kept_files().await.unwrap();
    assert!(kept.iter().all(|files| files.mask));
    assert_eq!(kept.iter().find(|files| files.id == done).unwrap().tokens, std::slice::from_ref(&lease.token));
    assert_eq!(store.expire_masks(late, 9).await.unwrap(), [done]);
    assert_eq!(store.expire_masks(late, 9).await.unwrap(), []);
    assert_eq!(store.expire_results(late, 9).await.unwrap(), [done]);
    assert_eq!(store.expire_results(late, 9).await.unwrap(), []);
    let kept = store.kept_files().await.unwrap();
    let of_done = kept.iter().find(|files| files.id == done).unwrap();
    assert!(!of_done.mask && of_done.tokens.is_empty());
    assert_eq!(store.expire_jobs(late, 9).await.unwrap(), [done]);
    assert!(store.get(done).await.unwrap().is_none() && store.get(waiting).await.unwrap().is_some());
}

#[tokio::test]
async fn a_webhook_is_due_from_the_end_of_its_job_until_it_arrives() {
    let (_dir, store) = store().await;
    let job = NewJob { callback_url: Some("https://hook.example/".to_owned()), ..new_job() };
    store.insert(&job, LIMITS).await.unwrap();
    let soon = || Timestamp::now() + SignedDuration::from_secs(1);
    let callback = async || get(&*store, job.id).await.callback.unwrap();
    assert_eq!(callback().await.state, SendState::Waiting);
    assert!(store.claim_callback(soon(), soon() + LEASE, &|_, _| false).await.unwrap().is_none());
    let lease = claim(&*store).await.unwrap();
    store.finish(&lease, &succeeded(), Timestamp::now()).await.unwrap();
    let due = store.claim_callback(soon(), soon() + LEASE, &|_, _| false).await.unwrap().unwrap();
    assert_eq!((due.job.id, due.tries, due.url.as_str()), (job.id, 0, "https://hook.example/"));
    // Given away until its time is over.
    assert!(store.claim_callback(soon(), soon() + LEASE, &|_, _| false).await.unwrap().is_none());
    let tried = |status| SendTry { at: Timestamp::now(), status, error: None };
    store.callback_tried(job.id, &tried(None), SendNext::TryAt(Timestamp::now())).await.unwrap();
    assert_eq!(store.claim_callback(soon(), soon() + LEASE, &|_, _| false).await.unwrap().unwrap().tries, 1);
    store.callback_tried(job.id, &tried(Some(204)), SendNext::Delivered).await.unwrap();
    let told = callback().await;
    assert_eq!((told.state, told.log.len(), told.log[1].status), (SendState::Delivered, 2, Some(204)));
    assert!(store.claim_callback(soon() + LEASE + LEASE, soon() + LEASE, &|_, _| false).await.unwrap().is_none());
}

#[tokio::test]
async fn what_is_kept_of_a_tenant_counts_and_is_bounded_reused_results_too() {
    let (_dir, store) = store().await;
    let kept = async |owner: &str| store.load(owner).await.unwrap().kept_bytes;
    let mask = new_job().mask.bytes;
    let id = insert_of(&*store, "one").await;
    assert_eq!(kept("one").await, mask);
    let lease = claim(&*store).await.unwrap();
    store.finish(&lease, &succeeded(), Timestamp::now()).await.unwrap();
    let Outcome::Succeeded { results, warnings, program } = succeeded() else { unreachable!() };
    let made: u64 = results.iter().map(|file| file.bytes).sum();
    assert_eq!(kept("one").await, mask + made);
    let reused = Reused { token: "token".to_owned(), results, warnings, program };
    let again = || NewJob { owner: "one".to_owned(), reused: Some(reused.clone()), ..new_job() };
    let room_for = |bytes| QueueLimits { storage_bytes: bytes, ..LIMITS };
    let full = store.insert(&again(), room_for(2 * (mask + made) - 1)).await;
    assert!(matches!(full, Err(StoreError::StorageShareFull)));
    store.insert(&again(), room_for(2 * (mask + made))).await.unwrap();
    assert_eq!((kept("one").await, kept("other").await), (2 * (mask + made), 0));
    let later = Timestamp::now() + SignedDuration::from_secs(1);
    store.expire_masks(later, 10).await.unwrap();
    assert_eq!(kept("one").await, 2 * made);
    store.delete(id).await.unwrap();
    assert_eq!(kept("one").await, made);
    store.expire_jobs(later, 10).await.unwrap();
    assert_eq!(kept("one").await, 0);
}

#[tokio::test]
async fn webhooks_of_a_busy_host_or_tenant_hold_up_no_others() {
    let (_dir, store) = store().await;
    let mut ids = Vec::new();
    for (owner, url) in [
        ("one", "https://hangs.example/a"),
        ("one", "https://hangs.example/b"),
        ("other", "https://hangs.example:8443/c"),
        ("one", "https://good.example/d?x=1"),
    ] {
        let job = NewJob { owner: owner.to_owned(), callback_url: Some(url.to_owned()), ..new_job() };
        store.insert(&job, LIMITS).await.unwrap();
        let lease = claim(&*store).await.unwrap();
        store.finish(&lease, &succeeded(), Timestamp::now()).await.unwrap();
        ids.push(job.id);
    }
    let now = Timestamp::now() + SignedDuration::from_secs(1);
    let claimed = async |is_busy: &(dyn for<'a> Fn(&'a str, &'a str) -> bool + Sync)| {
        let due = store.claim_callback(now, now + LEASE, is_busy).await.unwrap();
        due.map(|due| due.job.id)
    };
    assert_eq!(claimed(&|_, host| host.starts_with("hangs")).await, Some(ids[3]));
    assert_eq!(claimed(&|owner, _| owner == "one").await, Some(ids[2]));
    assert_eq!(claimed(&|_, host| host == "hangs.example").await, None);
    assert_eq!(claimed(&|_, _| false).await, Some(ids[0]));
    assert_eq!(claimed(&|_, _| false).await, Some(ids[1]));
    assert_eq!(claimed(&|_, _| false).await, None);
}

#[tokio::test]
async fn tokens_are_kept_without_their_secret_until_revoked() {
    let (_dir, store) = store().await;
    assert!(!store.has_tokens().await.unwrap());
    let token = Token::new().unwrap();
    let stored = token.stored("radiology".to_owned(), vec![Scope::Read, Scope::Metrics], None);
    store.insert_token(&stored).await.unwrap();
    let found = store.get_token(&token.id).await.unwrap().unwrap();
    assert!(found.is_secret(token.secret()) && found.is_valid_at(Timestamp::now()));
    assert_eq!((&found.tenant, &found.scopes), (&stored.tenant, &stored.scopes));
    assert!(store.revoke_token(&token.id, Timestamp::now()).await.unwrap());
    assert!(!store.revoke_token(&token.id, Timestamp::now()).await.unwrap());
    assert!(!store.list_tokens().await.unwrap()[0].is_valid_at(Timestamp::now()));
    assert!(store.has_tokens().await.unwrap() && store.get_token("other").await.unwrap().is_none());
}
