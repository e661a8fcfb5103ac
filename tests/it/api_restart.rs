//! What a server that stopped leaves to the next one.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use jiff::{SignedDuration, Timestamp};
use medialrep::jobs::caller::Caller;
use medialrep::jobs::job::{JobId, JobState};
use medialrep::jobs::place::Place;
use medialrep::jobs::service::Jobs;
use medialrep::jobs::store::{Outcome, Reclaim};
use medialrep::jobs::worker::{Processor, Workers};
use medialrep::problem::Problem;
use tempfile::TempDir;

use crate::help::support::{Server, id_of, limits, mask, waits, writes};

/// A server on `dir` whose jobs run.
async fn restart(dir: TempDir, processor: &Processor) -> (Server, Workers) {
    let server = Server::open(dir).await;
    let workers = Workers::start(&server.jobs, processor, 2);
    (server, workers)
}

#[tokio::test]
async fn waiting_and_running_jobs_are_taken_up() {
    let server = Server::without_workers().await;
    let (running, waiting) = (server.submit().await, server.submit().await);
    let now = Timestamp::now();
    // As if a server had it that was killed: its lock is free, its file is there.
    std::fs::write(server.dir.path().join("instances/killed"), "").unwrap();
    server.jobs.store().claim("killed", now, now + SignedDuration::from_secs(30)).await.unwrap();
    server.job_in(&running, "running").await;
    let (server, _workers) = restart(server.stop().await, &writes()).await;
    assert_eq!(server.job_in(&running, "succeeded").await["attempt"], 2);
    assert_eq!(server.job_in(&waiting, "succeeded").await["attempt"], 1);
}

#[tokio::test]
async fn a_stopping_server_puts_its_running_jobs_back() {
    let gate = Arc::new(AtomicBool::new(false));
    let server = Server::start(waits(&gate)).await;
    let job = server.submit().await;
    server.job_when(&job, |now| now["progress"]["stage"] == "isomap").await;
    let server = Server::open(server.stop().await).await;
    let now = server.get(&job).await.json();
    assert_eq!((&now["state"], &now["attempt"]), (&"queued".into(), &0.into()));
    assert_eq!(server.files(), [server.mask_of(&job)]);
}

#[tokio::test]
async fn a_stopping_server_lets_jobs_end_that_can() {
    let gate = Arc::new(AtomicBool::new(false));
    let server = Server::without_workers().await;
    let workers = Workers::start(&server.jobs, &waits(&gate), 1);
    let (job, next) = (server.submit().await, server.submit().await);
    server.job_in(&job, "running").await;
    gate.store(true, Ordering::Relaxed);
    workers.drain(std::time::Duration::from_secs(5)).await;
    let server = Server::open(server.stop().await).await;
    assert_eq!(server.get(&job).await.json()["state"], "succeeded");
    assert!(["queued", "succeeded"].contains(&server.get(&next).await.json()["state"].as_str().unwrap()));
}

#[tokio::test]
async fn files_that_no_job_names_are_swept() {
    let server = Server::start(writes()).await;
    let (done, gone) = (server.submit().await, server.submit().await);
    for job in [&done, &gone] {
        server.job_in(job, "succeeded").await;
    }
    // Crashes between the row and the files, and before the row.
    server.jobs.store().delete(JobId::parse(id_of(&gone)).unwrap()).await.unwrap();
    let mut kept = server.files();
    kept.retain(|file| !file.to_str().unwrap().contains(id_of(&gone)));
    let dir = server.stop().await;
    std::fs::create_dir_all(dir.path().join("scratch/killed")).unwrap();
    std::fs::write(dir.path().join("scratch/killed/upload-cut-short"), mask()).unwrap();
    std::fs::write(dir.path().join("masks/no-row"), mask()).unwrap();
    // A draft of the object store, which it never lists.
    std::fs::write(dir.path().join("masks/no-row#7"), mask()).unwrap();
    let attempt = dir.path().join("results").join(id_of(&done)).join("an-attempt-that-was-fenced-off");
    std::fs::create_dir_all(&attempt).unwrap();
    std::fs::write(attempt.join("model.glb"), b"x").unwrap();
    let empty = attempt.with_file_name("an-attempt-that-had-only-begun");
    std::fs::create_dir(&empty).unwrap();
    let server = Server::open(dir).await;
    let mut left = server.files();
    left.sort();
    kept.sort();
    assert_eq!(left, kept);
    assert!(!attempt.exists() && !empty.exists());
    assert_eq!(server.get(&format!("{done}/results/model.glb")).await.status, 200);
}

#[tokio::test]
async fn a_file_that_may_get_its_row_in_a_moment_outlives_the_start_of_another_server_however_old_it_is() {
    let server = Server::start(writes()).await;
    let job = server.submit().await;
    server.job_in(&job, "succeeded").await;
    // As a result that is used again: linked to an old file, and its row not yet written.
    let linked = server.dir.path().join("results").join(id_of(&job)).join("a-copy-whose-row-is-not-yet-written");
    std::fs::create_dir_all(&linked).unwrap();
    let file = std::fs::File::create(linked.join("model.glb")).unwrap();
    file.set_modified(std::time::SystemTime::now() - Duration::from_secs(40 * 86400)).unwrap();
    let scratch = server.dir.path().join("scratch").read_dir().unwrap().next().unwrap().unwrap();
    let upload = scratch.path().join("under-way");
    std::fs::write(&upload, mask()).unwrap();
    let second = Jobs::open(&Place::at(server.dir.path()), limits(), None).await.unwrap();
    assert!(linked.join("model.glb").exists() && upload.exists());
    drop(second);
}

#[tokio::test]
async fn servers_that_share_a_folder_share_its_jobs() {
    let gate = Arc::new(AtomicBool::new(false));
    let first = Server::start(waits(&gate)).await;
    let second = Arc::new(Jobs::open(&Place::at(first.dir.path()), limits(), None).await.unwrap());
    let caller = Caller::default();
    let job = first.submit().await;
    first.job_in(&job, "running").await;
    let id = JobId::parse(id_of(&job)).unwrap();
    // What one does not run it can cancel all the same.
    second.cancel(&caller, id).await.unwrap();
    let ended = second.status_at_end(&caller, id, Duration::from_secs(5)).await.unwrap();
    gate.store(true, Ordering::Relaxed);
    assert_eq!(ended.job.state, JobState::Canceled);
}

#[tokio::test]
async fn the_jobs_of_a_server_that_was_killed_are_taken_up_by_another_within_a_second() {
    let server = Server::without_workers().await;
    let job = server.submit().await;
    std::fs::write(server.dir.path().join("instances/killed"), "").unwrap();
    let now = Timestamp::now();
    server.jobs.store().claim("killed", now, now + SignedDuration::from_secs(30)).await.unwrap();
    let _workers = Workers::start(&server.jobs, &writes(), 1);
    let begun = Instant::now();
    assert_eq!(server.job_in(&job, "succeeded").await["attempt"], 2);
    assert!(begun.elapsed() < Duration::from_secs(5), "{:?}", begun.elapsed());
}

#[tokio::test]
async fn a_late_result_is_refused_and_swept() {
    let gate = Arc::new(AtomicBool::new(false));
    let slow = Server::start(waits(&gate)).await;
    let job = slow.submit().await;
    slow.job_when(&job, |now| now["progress"]["stage"] == "isomap").await;
    // Its lease runs out, as when the process was stopped, and another one finishes first.
    let later = Timestamp::now() + SignedDuration::from_secs(60);
    slow.jobs.store().reclaim(Reclaim::LeaseBefore(later), Timestamp::now()).await.unwrap();
    let other = Arc::new(Jobs::open(&Place::at(slow.dir.path()), limits(), None).await.unwrap());
    let until = Timestamp::now() + SignedDuration::from_secs(60);
    let claim = other.store().claim("other", Timestamp::now(), until).await.unwrap();
    gate.store(true, Ordering::Relaxed);
    let claim = claim.expect("nobody else has it");
    let problem = Box::new(Problem::new(422, "the_other_one", "was first"));
    other.store().finish(&claim.lease, &Outcome::Failed(problem), Timestamp::now()).await.unwrap();
    tokio::time::sleep(Duration::from_millis(300)).await;
    let ended = slow.get(&job).await.json();
    assert_eq!((&ended["state"], &ended["error"]["code"]), (&"failed".into(), &"the_other_one".into()));
    assert_eq!(slow.files(), [slow.mask_of(&job)]);
}
