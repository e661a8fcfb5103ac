//! `medialrep serve` as a process: what it refuses, how it dies, what it leaves.

use std::io::{BufRead, BufReader, Read, Write};
use std::net::{SocketAddr, TcpStream};
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use serde_json::Value;
use tempfile::TempDir;

const PROGRAM: &str = env!("CARGO_BIN_EXE_medialrep");

/// A service that is killed when dropped.
struct Service {
    process: Child,
    address: SocketAddr,
}

impl Drop for Service {
    fn drop(&mut self) {
        let _ = self.process.kill();
        let _ = self.process.wait();
    }
}

impl Service {
    fn start(data_dir: &Path) -> Self {
        let mut process = Command::new(PROGRAM)
            .args(["serve", "--listen", "127.0.0.1:0", "--workers", "1", "--log-format", "json", "--data-dir"])
            .arg(data_dir)
            .env("RUST_LOG", "info")
            .stderr(Stdio::piped())
            .spawn()
            .unwrap();
        let mut log = BufReader::new(process.stderr.take().unwrap()).lines();
        let first: Value = serde_json::from_str(&log.next().unwrap().unwrap()).unwrap();
        // Read to the end, so that the service never waits for a full pipe.
        std::thread::spawn(move || log.for_each(drop));
        Self { process, address: first["address"].as_str().unwrap().parse().unwrap() }
    }

    /// Status line with headers, and body.
    fn call(&self, head: &str, body: &[u8]) -> (String, String) {
        let mut stream = TcpStream::connect(self.address).unwrap();
        let length = body.len();
        write!(stream, "{head} HTTP/1.1\r\nHost: x\r\nConnection: close\r\nContent-Length: {length}\r\n\r\n").unwrap();
        stream.write_all(body).unwrap();
        let mut answer = String::new();
        stream.read_to_string(&mut answer).unwrap();
        let (head, body) = answer.split_once("\r\n\r\n").unwrap();
        (head.to_owned(), body.to_owned())
    }

    fn submit(&self, mask: &[u8]) -> String {
        let (head, body) = self.call("POST /v1/jobs", mask);
        assert!(head.starts_with("HTTP/1.1 202"), "{head} {body}");
        serde_json::from_str::<Value>(&body).unwrap()["links"]["self"].as_str().unwrap().to_owned()
    }

    fn ended(&self, job: &str) -> Value {
        let deadline = Instant::now() + Duration::from_secs(60);
        loop {
            let (_, body) = self.call(&format!("GET {job}"), b"");
            let job: Value = serde_json::from_str(&body).unwrap();
            if !job["ended_at"].is_null() {
                return job;
            }
            assert!(Instant::now() < deadline, "{job}");
            std::thread::sleep(Duration::from_millis(10));
        }
    }

    fn terminate(&mut self) -> Option<i32> {
        let pid = self.process.id().to_string();
        assert!(Command::new("kill").args(["-TERM", &pid]).status().unwrap().success());
        self.process.wait().unwrap().code()
    }
}

fn sample(dir: &Path) -> Vec<u8> {
    let file = dir.join("sample.nii.gz");
    let made = Command::new(PROGRAM).args(["sample", "slab", "--out"]).arg(&file).status().unwrap();
    assert!(made.success());
    std::fs::read(file).unwrap()
}

#[test]
fn a_service_without_authentication_stays_on_the_loopback() {
    for listen in ["0.0.0.0:0", "[::]:0", "192.0.2.1:80"] {
        let output = Command::new(PROGRAM).args(["serve", "--listen", listen]).output().unwrap();
        assert_eq!(output.status.code(), Some(2), "{listen}");
        assert!(String::from_utf8_lossy(&output.stderr).contains("--allow-unauthenticated"));
    }
}

#[test]
fn a_mask_becomes_files_and_sigterm_ends_well() {
    let dir = TempDir::new().unwrap();
    let mask = sample(dir.path());
    let mut service = Service::start(&dir.path().join("data"));
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
        let service = Service::start(&dir.path().join("data"));
        jobs.extend((0..4).map(|_| service.submit(&mask)));
        // Dropped: SIGKILL.
    }
    let service = Service::start(&dir.path().join("data"));
    for job in &jobs {
        let ended = service.ended(job);
        assert_eq!(ended["state"], "succeeded", "{ended}");
    }
}
