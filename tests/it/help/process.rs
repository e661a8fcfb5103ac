//! The program as a process: started, asked, stopped, killed.

use std::io::{BufRead, BufReader, Read, Write};
use std::net::{SocketAddr, TcpStream};
use std::path::Path;
use std::process::{Child, Command, Output, Stdio};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

use serde_json::Value;

pub const PROGRAM: &str = env!("CARGO_BIN_EXE_medialrep");

/// A service that is killed when dropped.
pub struct Service {
    process: Child,
    pub address: SocketAddr,
    log: Arc<Mutex<String>>,
    token: Option<String>,
}

impl Drop for Service {
    fn drop(&mut self) {
        let _ = self.process.kill();
        let _ = self.process.wait();
    }
}

impl Service {
    /// With one worker, on a port of its own.
    pub fn start(data_dir: &Path, options: &[&str]) -> Self {
        Self::start_with(data_dir, options, &[])
    }

    /// The same, with more variables of the environment.
    pub fn start_with(data_dir: &Path, options: &[&str], variables: &[(&str, &str)]) -> Self {
        let mut process = Command::new(PROGRAM)
            .args(["serve", "--log-format", "json", "--data-dir"])
            .arg(data_dir)
            .args(options)
            .env("MEDIALREP_LISTEN", "127.0.0.1:0")
            .env("MEDIALREP_WORKERS", "1")
            // Machines that test may have little room left.
            .env("MEDIALREP_MIN_FREE_MIB", "0")
            .env("RUST_LOG", "info")
            .envs(variables.iter().copied())
            .stderr(Stdio::piped())
            .spawn()
            .unwrap();
        let mut lines = BufReader::new(process.stderr.take().unwrap()).lines();
        let first: Value = serde_json::from_str(&lines.next().unwrap().unwrap()).unwrap();
        let log = Arc::new(Mutex::new(String::new()));
        let kept = Arc::clone(&log);
        // Read to the end, so that the service never waits for a full pipe.
        std::thread::spawn(move || {
            for line in lines.map_while(Result::ok) {
                let mut kept = kept.lock().unwrap();
                kept.push_str(&line);
                kept.push('\n');
            }
        });
        Self { process, address: first["address"].as_str().unwrap().parse().unwrap(), log, token: None }
    }

    /// Shows this token from now on.
    pub fn with_token(mut self, token: &str) -> Self {
        self.token = Some(token.trim().to_owned());
        self
    }

    pub fn pid(&self) -> String {
        self.process.id().to_string()
    }

    pub fn log(&self) -> String {
        self.log.lock().unwrap().clone()
    }

    /// Status line with headers, and body; nothing when the service is gone.
    pub fn try_call(&self, head: &str, body: &[u8]) -> Option<(String, String)> {
        self.try_call_with(head, "Cache-Control: no-cache\r\n", body)
    }

    /// The same, where results of an earlier job will do.
    pub fn try_call_cached(&self, head: &str, body: &[u8]) -> Option<(String, String)> {
        self.try_call_with(head, "", body)
    }

    fn try_call_with(&self, head: &str, fields: &str, body: &[u8]) -> Option<(String, String)> {
        let mut stream = TcpStream::connect_timeout(&self.address, Duration::from_secs(5)).ok()?;
        stream.set_read_timeout(Some(Duration::from_secs(60))).ok()?;
        let (length, address) = (body.len(), self.address);
        let token = self.token.as_ref().map(|token| format!("Authorization: Bearer {token}\r\n")).unwrap_or_default();
        let head = format!(
            "{head} HTTP/1.1\r\nHost: {address}\r\nConnection: close\r\n{token}{fields}Content-Length: {length}\r\n\r\n"
        );
        stream.write_all(head.as_bytes()).ok()?;
        // A refusal may come before all is sent.
        let _ = stream.write_all(body);
        let mut answer = Vec::new();
        stream.read_to_end(&mut answer).ok()?;
        let answer = String::from_utf8_lossy(&answer);
        let (head, body) = answer.split_once("\r\n\r\n")?;
        Some((head.to_owned(), body.to_owned()))
    }

    pub fn call(&self, head: &str, body: &[u8]) -> (String, String) {
        self.try_call(head, body).expect("the service answers")
    }

    /// With other headers, each with its end of line.
    pub fn call_with(&self, head: &str, fields: &str, body: &[u8]) -> (String, String) {
        self.try_call_with(head, fields, body).expect("the service answers")
    }

    pub fn json(&self, head: &str) -> Value {
        let (_, body) = self.call(head, b"");
        serde_json::from_str(&body).unwrap_or_else(|_| panic!("{head}: {body}"))
    }

    /// The path of the job, when the service says that it has it.
    pub fn try_submit(&self, mask: &[u8]) -> Option<String> {
        let (head, body) = self.try_call("POST /v1/jobs", mask)?;
        // An answer cut short promises nothing.
        let job: Value = serde_json::from_str(&body).ok()?;
        head.starts_with("HTTP/1.1 202").then(|| job["links"]["self"].as_str().unwrap().to_owned())
    }

    pub fn submit(&self, mask: &[u8]) -> String {
        let (head, body) = self.call("POST /v1/jobs", mask);
        assert!(head.starts_with("HTTP/1.1 202"), "{head} {body}");
        serde_json::from_str::<Value>(&body).unwrap()["links"]["self"].as_str().unwrap().to_owned()
    }

    pub fn job_when(&self, job: &str, patience: Duration, is_wanted: impl Fn(&Value) -> bool) -> Value {
        let deadline = Instant::now() + patience;
        loop {
            let now = self.json(&format!("GET {job}"));
            if is_wanted(&now) {
                return now;
            }
            assert!(Instant::now() < deadline, "waited in vain: {now}\n{}", self.log());
            std::thread::sleep(Duration::from_millis(20));
        }
    }

    pub fn ended(&self, job: &str) -> Value {
        self.job_when(job, Duration::from_secs(120), |now| !now["ended_at"].is_null())
    }

    /// The job once it has ended, or as it is after three seconds.
    pub fn job_soon(&self, job: &str) -> Value {
        let deadline = Instant::now() + Duration::from_secs(3);
        self.job_when(job, Duration::from_secs(30), |now| !now["ended_at"].is_null() || Instant::now() > deadline)
    }

    pub fn signal(&self, signal: &str) {
        assert!(Command::new("kill").args([signal, &self.pid()]).status().unwrap().success());
    }

    /// Exit code after SIGTERM.
    pub fn terminate(&mut self) -> Option<i32> {
        self.signal("-TERM");
        self.process.wait().unwrap().code()
    }

    /// Exit code once it has ended after an earlier SIGTERM.
    pub fn end(&mut self) -> Option<i32> {
        self.process.wait().unwrap().code()
    }

    /// Resident memory and its peak, KiB.
    pub fn memory_kib(&self) -> (u64, u64) {
        let status = std::fs::read_to_string(format!("/proc/{}/status", self.pid())).unwrap();
        let of = |name: &str| {
            let line = status.lines().find(|line| line.starts_with(name)).unwrap();
            line.split_whitespace().nth(1).unwrap().parse().unwrap()
        };
        (of("VmRSS:"), of("VmHWM:"))
    }
}

/// What the program says to `arguments`.
pub fn run(arguments: &[&str], data_dir: &Path) -> Output {
    Command::new(PROGRAM).args(arguments).arg("--data-dir").arg(data_dir).output().unwrap()
}

/// A sample as the program writes it.
pub fn sample(dir: &Path) -> Vec<u8> {
    sample_of(dir, &["slab"])
}

/// A sample of this name, with options.
pub fn sample_of(dir: &Path, arguments: &[&str]) -> Vec<u8> {
    let file = dir.join("sample.nii.gz");
    let made = Command::new(PROGRAM).arg("sample").args(arguments).arg("--out").arg(&file).status().unwrap();
    assert!(made.success());
    std::fs::read(file).unwrap()
}
