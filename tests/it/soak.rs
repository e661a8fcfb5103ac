//! The service's promises as processes keep them: killed, stopped, starved, attacked. Each test is short
//! here and long under `make soak`, which sets MEDIALREP_SOAK and says what it measured.

use std::collections::BTreeSet;
use std::io::{Read, Write};
use std::net::TcpStream;
use std::path::Path;
use std::sync::Mutex;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::time::{Duration, Instant};

use medialrep::jobs::job::{Job, JobId};
use medialrep::jobs::place::Place;
use serde_json::Value;
use tempfile::TempDir;

use crate::help::left_out::left_out;
use crate::help::process::{Service, sample, sample_of};

pub fn is_long() -> bool {
    std::env::var_os("MEDIALREP_SOAK").is_some()
}

/// The short form's number or the long one's.
pub fn count(short: usize, long: usize) -> usize {
    if is_long() { long } else { short }
}

/// Says a figure of the long form.
pub fn tell(what: &str) {
    if is_long() {
        println!("soak: {what}");
    }
}

/// Numbers that look random and are the same in every run.
pub struct Dice(pub u64);

impl Dice {
    pub fn below(&mut self, end: u64) -> u64 {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 33) % end
    }
}

/// A mask that takes little time.
fn small_mask(dir: &Path) -> Vec<u8> {
    sample_of(dir, &["slab", "--spacing", "2"])
}

/// All jobs as the database has them.
fn jobs_of(data: &Path, ids: &BTreeSet<String>) -> Vec<Option<Job>> {
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build().unwrap();
    runtime.block_on(async {
        let store = Place::at(data).open_store().await.unwrap();
        let mut jobs = Vec::new();
        for id in ids {
            jobs.push(store.get(JobId::parse(id.rsplit('/').next().unwrap()).unwrap()).await.unwrap());
        }
        jobs
    })
}

/// Every acknowledged job is there, has ended once, and has at most one folder of results.
fn check_ended(data: &Path, acknowledged: &BTreeSet<String>) -> usize {
    let jobs = jobs_of(data, acknowledged);
    let lost = jobs.iter().filter(|job| job.is_none()).count();
    assert_eq!(lost, 0, "of {} acknowledged jobs", acknowledged.len());
    assert!(!acknowledged.is_empty(), "nothing was sent");
    let mut given_up = 0;
    for job in jobs.into_iter().flatten() {
        let ends = job.history.iter().filter(|change| change.state.has_ended()).count();
        assert_eq!(ends, 1, "{:?}", job.history);
        let folder = data.join("results").join(job.id.to_string());
        let attempts = std::fs::read_dir(folder).map_or(0, Iterator::count);
        match job.error {
            None => assert_eq!(attempts, 1),
            Some(problem) => {
                assert_eq!((problem.code.as_str(), attempts), ("too_many_attempts", 0));
                given_up += 1;
            }
        }
    }
    given_up
}

/// Sends masks one after the other until told to stop; what the service said it has.
fn send_until(service: &Service, mask: &[u8], stop: &AtomicBool, acknowledged: &Mutex<BTreeSet<String>>) {
    while !stop.load(Ordering::Relaxed) {
        match service.try_submit(mask) {
            Some(job) => drop(acknowledged.lock().unwrap().insert(job)),
            // Killed, or its queue is full.
            None => std::thread::sleep(Duration::from_millis(2)),
        }
    }
}

#[test]
fn no_acknowledged_job_is_lost_to_a_kill() {
    let dir = TempDir::new().unwrap();
    let (data, mask) = (dir.path().join("data"), small_mask(dir.path()));
    let (cycles, mut dice) = (count(6, 200), Dice(7));
    let acknowledged = Mutex::new(BTreeSet::new());
    for _ in 0..cycles {
        let service = Service::start(&data, &["--workers", "2", "--max-queued", "40"]);
        let stop = AtomicBool::new(false);
        std::thread::scope(|scope| {
            for _ in 0..3 {
                scope.spawn(|| send_until(&service, &mask, &stop, &acknowledged));
            }
            std::thread::sleep(Duration::from_millis(20 + dice.below(500)));
            service.signal("-KILL");
            stop.store(true, Ordering::Relaxed);
        });
    }
    let acknowledged = acknowledged.into_inner().unwrap();
    let service = Service::start(&data, &["--workers", "2"]);
    for job in &acknowledged {
        service.ended(job);
    }
    let given_up = check_ended(&data, &acknowledged);
    tell(&format!("{cycles} kills: {} jobs acknowledged, all ended once, {given_up} given up", acknowledged.len()));
}

#[test]
fn a_restart_under_load_fails_no_client_that_tries_again() {
    let dir = TempDir::new().unwrap();
    let (data, mask) = (dir.path().join("data"), small_mask(dir.path()));
    let acknowledged = Mutex::new(BTreeSet::new());
    let restarts = count(3, 30);
    for _ in 0..restarts {
        let mut service = Service::start(&data, &["--workers", "2", "--max-queued", "40"]);
        let stop = AtomicBool::new(false);
        std::thread::scope(|scope| {
            scope.spawn(|| send_until(&service, &mask, &stop, &acknowledged));
            std::thread::sleep(Duration::from_millis(300));
            service.signal("-TERM");
            std::thread::sleep(Duration::from_millis(100));
            stop.store(true, Ordering::Relaxed);
        });
        assert_eq!(service.end(), Some(0));
    }
    let acknowledged = acknowledged.into_inner().unwrap();
    let service = Service::start(&data, &["--workers", "2"]);
    for job in &acknowledged {
        assert_eq!(service.ended(job)["state"], "succeeded");
    }
    assert_eq!(check_ended(&data, &acknowledged), 0);
    tell(&format!("{restarts} restarts: {} jobs acknowledged, all succeeded", acknowledged.len()));
}

#[test]
fn a_killed_process_is_noticed_by_another() {
    let dir = TempDir::new().unwrap();
    // Long enough to be killed in, whatever the profile.
    let spacing = if is_long() { "0.125" } else { "0.5" };
    let (data, mask) = (dir.path().join("data"), sample_of(dir.path(), &["slab", "--spacing", spacing]));
    let mut waited = Vec::new();
    for _ in 0..count(1, 30) {
        let first = Service::start(&data, &[]);
        let job = first.submit(&mask);
        first.job_when(&job, Duration::from_secs(30), |now| now["state"] == "running");
        let other = Service::start(&data, &[]);
        drop(first);
        let killed = Instant::now();
        other.job_when(&job, Duration::from_secs(60), |now| now["attempt"] == 2);
        waited.push(killed.elapsed());
        other.call(&format!("DELETE {job}"), b"");
    }
    waited.sort();
    let last = waited[waited.len() - 1];
    assert!(last < Duration::from_secs(30), "{last:?}");
    tell(&format!("a killed process was noticed {} times, in {:?} to {last:?}", waited.len(), waited[0]));
}

/// Takes the lease's 30 seconds: long form only; the short one is done within one process.
#[test]
fn a_process_stopped_past_its_lease_publishes_nothing() {
    if !is_long() {
        return left_out("takes a minute, see `make soak`; a late result is refused in api_restart");
    }
    let dir = TempDir::new().unwrap();
    let (data, mask) = (dir.path().join("data"), sample_of(dir.path(), &["slab", "--spacing", "0.25"]));
    let stopped = Service::start(&data, &["--workers", "20"]);
    let jobs: Vec<String> = (0..20).map(|_| stopped.submit(&mask)).collect();
    for job in &jobs {
        stopped.job_when(job, Duration::from_secs(30), |now| now["state"] == "running");
    }
    stopped.signal("-STOP");
    let other = Service::start(&data, &["--workers", "2"]);
    for job in &jobs {
        other.job_when(job, Duration::from_secs(120), |now| now["state"] == "succeeded");
    }
    let before: Vec<Value> = jobs.iter().map(|job| other.json(&format!("GET {job}"))["results"].clone()).collect();
    stopped.signal("-CONT");
    let refused = || stopped.log().matches("outcome dropped").count();
    let deadline = Instant::now() + Duration::from_secs(60);
    while refused() < 20 && Instant::now() < deadline {
        std::thread::sleep(Duration::from_millis(100));
    }
    assert_eq!(refused(), 20);
    let after: Vec<Value> = jobs.iter().map(|job| other.json(&format!("GET {job}"))["results"].clone()).collect();
    assert_eq!(before, after);
    let ids = jobs.into_iter().collect();
    assert_eq!(check_ended(&data, &ids), 0);
    tell("stopped past the lease and continued: 20 of 20 late results refused");
}

#[test]
fn a_cancel_takes_effect_within_a_second_at_every_stage() {
    let dir = TempDir::new().unwrap();
    let (data, spacing) = (dir.path().join("data"), if is_long() { "0.125" } else { "0.5" });
    let mask = sample_of(dir.path(), &["slab", "--spacing", spacing]);
    let service = Service::start(&data, &[]);
    let (mut worst, mut canceled) = ((Duration::ZERO, String::new()), 0);
    for stage in ["read", "mask", "distance", "skeleton", "sheets", "sides", "isomap", "lattice", "spokes", "quality"] {
        for _ in 0..count(1, 3) {
            let job = service.submit(&mask);
            let reached = |now: &Value| now["progress"]["stage"] == stage || !now["ended_at"].is_null();
            service.job_when(&job, Duration::from_secs(120), reached);
            let begun = Instant::now();
            service.call(&format!("POST {job}/cancel"), b"");
            let now = service
                .job_when(&job, Duration::from_secs(60), |now| !now["ended_at"].is_null() || *now == Value::Null);
            let took = begun.elapsed();
            canceled += usize::from(now["state"] == "canceled");
            if now["state"] == "canceled" && took > worst.0 {
                worst = (took, stage.to_owned());
            }
            service.call(&format!("DELETE {job}"), b"");
        }
    }
    // A short stage may be over before it is seen; the run ends then.
    assert!(canceled >= count(5, 20), "only {canceled} were canceled");
    assert!(worst.0 < Duration::from_secs(if is_long() { 1 } else { 5 }), "{worst:?}");
    tell(&format!("cancel of a slab of 512 voxels: at worst {:?}, in {}", worst.0, worst.1));
}

#[test]
fn status_reads_stay_fast_beside_busy_workers() {
    let dir = TempDir::new().unwrap();
    let (data, mask) = (dir.path().join("data"), sample(dir.path()));
    let service = Service::start(&data, &["--workers", "2", "--max-queued", "10000"]);
    let jobs: Vec<String> = (0..count(10, 600)).map(|_| service.submit(&mask)).collect();
    let (time, pace) = (Duration::from_secs(count(1, 10) as u64), Duration::from_millis(2));
    let (times, sent) = (Mutex::new(Vec::new()), AtomicU64::new(0));
    let begun = Instant::now();
    // Four clients that send every two milliseconds: 2 000 a second.
    std::thread::scope(|scope| {
        for client in 0..4 {
            let (service, jobs, times, sent) = (&service, &jobs, &times, &sent);
            scope.spawn(move || {
                let mut stream = TcpStream::connect(service.address).unwrap();
                stream.set_nodelay(true).unwrap();
                let mut own = Vec::new();
                let mut due = Instant::now();
                while begun.elapsed() < time {
                    std::thread::sleep(due.saturating_duration_since(Instant::now()));
                    let job = &jobs[(own.len() + client) % jobs.len()];
                    // From when it was due: a slow answer delays those behind it.
                    read_status(&mut stream, service, job);
                    own.push(due.elapsed());
                    due += pace;
                    sent.fetch_add(1, Ordering::Relaxed);
                }
                times.lock().unwrap().extend(own);
            });
        }
    });
    let mut times = times.into_inner().unwrap();
    times.sort();
    let (median, late) = (times[times.len() / 2], times[times.len() * 99 / 100]);
    let rate = sent.load(Ordering::Relaxed) as f64 / begun.elapsed().as_secs_f64();
    let queued = service.json("GET /v1/jobs?state=queued&limit=1")["jobs"].as_array().unwrap().len();
    tell(&format!(
        "{rate:.0} status reads a second: median {median:?}, 99 % within {late:?}; jobs still waited: {queued}"
    ));
    assert!(late < Duration::from_secs(2), "{late:?}");
    assert!(!is_long() || (late < Duration::from_millis(20) && rate > 1900.0 && queued > 0), "{late:?} at {rate}");
}

fn read_status(stream: &mut TcpStream, service: &Service, job: &str) {
    write!(stream, "GET {job} HTTP/1.1\r\nHost: {}\r\n\r\n", service.address).unwrap();
    let mut answer = Vec::new();
    let mut buffer = [0; 4096];
    loop {
        let count = stream.read(&mut buffer).unwrap();
        answer.extend_from_slice(&buffer[..count]);
        let Some(end) = answer.windows(4).position(|window| window == b"\r\n\r\n") else { continue };
        let head = String::from_utf8_lossy(&answer[..end]).to_lowercase();
        assert!(head.starts_with("http/1.1 200"), "{head}");
        let length = head.lines().find_map(|line| line.strip_prefix("content-length: ")).unwrap();
        if answer.len() >= end + 4 + length.parse::<usize>().unwrap() {
            return;
        }
    }
}
