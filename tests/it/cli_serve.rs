//! `medialrep serve` as a process: what it refuses, how it dies, what it leaves.

use std::process::Command;

use tempfile::TempDir;

use crate::help::process::{PROGRAM, Service, sample};

#[test]
fn a_service_without_authentication_stays_on_the_loopback() {
    for listen in ["0.0.0.0:0", "[::]:0", "192.0.2.1:80"] {
        let output = Command::new(PROGRAM).args(["serve", "--listen", listen]).output().unwrap();
        assert_eq!(output.status.code(), Some(2), "{listen}");
        assert!(String::from_utf8_lossy(&output.stderr).contains("medialrep token create"));
    }
}

#[test]
fn a_mask_becomes_files_and_sigterm_ends_well() {
    let dir = TempDir::new().unwrap();
    let mask = sample(dir.path());
    let mut service = Service::start(&dir.path().join("data"), &[]);
    let job = service.submit(&mask);
    let ended = service.ended(&job);
    assert_eq!(ended["state"], "succeeded", "{ended}");
    for result in ended["results"].as_array().unwrap() {
        let file = dir.path().join("data/results").join(job.rsplit('/').next().unwrap());
        let folder = std::fs::read_dir(file).unwrap().next().unwrap().unwrap().path();
        let size = std::fs::metadata(folder.join(result["name"].as_str().unwrap())).unwrap().len();
        assert_eq!(result["bytes"], size);
    }
    let probe = |listen: &str| Command::new(PROGRAM).args(["probe", "--listen", listen]).status().unwrap().code();
    let address = service.address.to_string();
    assert_eq!(probe(&address), Some(0));
    assert_eq!(service.terminate(), Some(0));
    assert_eq!(probe(&address), Some(1));
}

#[test]
fn a_killed_service_keeps_what_it_accepted() {
    let dir = TempDir::new().unwrap();
    let mask = sample(dir.path());
    let mut jobs = Vec::new();
    // A third time would give up a job that was running each time: by design.
    for _ in 0..2 {
        let service = Service::start(&dir.path().join("data"), &[]);
        jobs.extend((0..4).map(|_| service.submit(&mask)));
        // Dropped: SIGKILL.
    }
    let service = Service::start(&dir.path().join("data"), &[]);
    for job in &jobs {
        let ended = service.ended(job);
        assert_eq!(ended["state"], "succeeded", "{ended}");
    }
}
