//! What a server that stopped leaves to the next one.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use jiff::{SignedDuration, Timestamp};
use medialrep::jobs::job::JobId;
use medialrep::jobs::queue::{Jobs, OpenError};
use medialrep::jobs::worker::{Processor, Workers};
use tempfile::TempDir;

use crate::support::{Server, id_of, limits, mask, waits, writes};

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
    // As if a worker had it: the server is killed before it can say what became of it.
    server.jobs.store().claim(now, now + SignedDuration::from_secs(30)).await.unwrap();
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
    std::fs::write(dir.path().join("incoming/cut-short"), mask()).unwrap();
    std::fs::write(dir.path().join("masks/no-row"), mask()).unwrap();
    let attempt = dir.path().join("results").join(id_of(&done)).join("an-attempt-that-was-fenced-off");
    std::fs::create_dir_all(&attempt).unwrap();
    std::fs::write(attempt.join("model.glb"), b"x").unwrap();
    let server = Server::open(dir).await;
    let mut left = server.files();
    left.sort();
    kept.sort();
    assert_eq!(left, kept);
    assert_eq!(server.get(&format!("{done}/results/model.glb")).await.status, 200);
}

#[tokio::test]
async fn two_servers_cannot_share_a_folder() {
    let server = Server::without_workers().await;
    assert!(matches!(Jobs::open(server.dir.path(), limits()).await, Err(OpenError::InUse)));
}
