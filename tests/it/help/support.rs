//! A service without a network: its routes, its workers, and a processor that a test chooses.

use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, Once};
use std::time::{Duration, Instant};

use axum::Router;
use axum::body::Body;
use axum::http::{HeaderMap, Method, Request, StatusCode};
use http_body_util::BodyExt;
use medialrep::config::ServeConfig;
use medialrep::dicomweb::Pacs;
use medialrep::formats::dicom_object::DicomObject;
use medialrep::http::auth::Access;
use medialrep::http::web::{Page, PageFile};
use medialrep::http::{router, router_with_page};
use medialrep::jobs::limits::JobLimits;
use medialrep::jobs::place::Place;
use medialrep::jobs::process::ProcessError;
use medialrep::jobs::processed::{Processed, WrittenFile};
use medialrep::jobs::service::Jobs;
use medialrep::jobs::worker::{Processor, Workers};
use medialrep::model::{Stage, Warning};
use medialrep::problem::Problem;
use medialrep::webhook::Sender;
use serde_json::Value;
use sha2::{Digest, Sha256};
use tempfile::TempDir;
use tower::ServiceExt;

/// Text that stands for a patient's name, put wherever a client can put text.
pub const CANARY: &str = "CANARY_DOE_JANE";

/// Bounds of a service in tests: small, so that they can be reached.
pub fn limits() -> JobLimits {
    let mut limits = ServeConfig::default().jobs;
    limits.queue.jobs = 5;
    limits.min_free_bytes = 0;
    limits.upload.max_bytes = 4096;
    limits.upload.idle = Duration::from_millis(200);
    limits
}

/// A service on a folder of its own.
pub struct Server {
    pub dir: TempDir,
    pub jobs: Arc<Jobs>,
    router: Router,
    workers: Option<Workers>,
}

impl Server {
    /// With two workers.
    pub async fn start(processor: Processor) -> Self {
        let mut server = Self::without_workers().await;
        server.run(&processor);
        server
    }

    /// Jobs wait for ever.
    pub async fn without_workers() -> Self {
        Self::open(TempDir::new().unwrap()).await
    }

    /// On a folder that has been used before.
    pub async fn open(dir: TempDir) -> Self {
        Self::open_with(dir, limits(), None).await
    }

    /// With other bounds, and webhooks.
    pub async fn open_with(dir: TempDir, limits: JobLimits, webhooks: Option<Sender>) -> Self {
        keep_log();
        let jobs = Arc::new(Jobs::open(&Place::at(dir.path()), limits, webhooks).await.unwrap());
        Self { router: router(Arc::clone(&jobs), access()), workers: None, jobs, dir }
    }

    /// With archives that masks may be fetched from.
    pub async fn with_pacs(limits: JobLimits, pacs: Pacs) -> Self {
        Self::open_with_pacs(TempDir::new().unwrap(), limits, pacs).await
    }

    /// The same in a folder that may have been used before.
    pub async fn open_with_pacs(dir: TempDir, limits: JobLimits, pacs: Pacs) -> Self {
        keep_log();
        let jobs = Jobs::open(&Place::at(dir.path()), limits, None).await.unwrap();
        let jobs = Arc::new(jobs.with_pacs(pacs));
        Self { router: router(Arc::clone(&jobs), access()), workers: None, jobs, dir }
    }

    /// With the files of a page that are found so.
    pub async fn with_page(files: fn(&str) -> Option<PageFile>) -> Self {
        let server = Self::without_workers().await;
        Self { router: router_with_page(Arc::clone(&server.jobs), access(), Page::of(files)), ..server }
    }

    /// Lets jobs run from now on.
    pub fn run(&mut self, processor: &Processor) {
        self.workers = Some(Workers::start(&self.jobs, processor, 2));
    }

    /// Stops as a server does that is told to, and gives the folder back.
    pub async fn stop(mut self) -> TempDir {
        if let Some(workers) = self.workers.take() {
            workers.drain(Duration::ZERO).await;
        }
        self.dir
    }

    pub async fn send(&self, request: Request<Body>) -> Answer {
        let response = self.router.clone().oneshot(request).await.unwrap();
        let (parts, body) = response.into_parts();
        let body = body.collect().await.unwrap().to_bytes().to_vec();
        Answer { status: parts.status, headers: parts.headers, body }
    }

    /// The head of an answer whose body goes on until this is dropped.
    pub async fn begin(&self, path: &str, token: &str) -> axum::response::Response {
        let request = Request::get(path).header("authorization", token).body(Body::empty()).unwrap();
        self.router.clone().oneshot(request).await.unwrap()
    }

    pub async fn call(&self, method: Method, path: &str) -> Answer {
        self.send(Request::builder().method(method).uri(path).body(Body::empty()).unwrap()).await
    }

    pub async fn get(&self, path: &str) -> Answer {
        self.call(Method::GET, path).await
    }

    pub async fn post(&self, path: &str, body: Vec<u8>) -> Answer {
        self.send(Request::post(path).body(Body::from(body)).unwrap()).await
    }

    /// Sends a request with headers.
    pub async fn with(&self, method: Method, path: &str, headers: &[(&str, &str)], body: Vec<u8>) -> Answer {
        let request = Request::builder().method(method).uri(path);
        let request = headers.iter().fold(request, |request, (name, value)| request.header(*name, *value));
        self.send(request.body(Body::from(body)).unwrap()).await
    }

    /// Sends a good mask that is to be worked on anew; the path of its job.
    pub async fn submit(&self) -> String {
        let answer = self.with(Method::POST, "/v1/jobs", &[("cache-control", "no-cache")], mask()).await;
        assert_eq!(answer.status, StatusCode::ACCEPTED, "{}", answer.text());
        answer.header("location").to_owned()
    }

    /// The job once `is_wanted`.
    pub async fn job_when(&self, job: &str, is_wanted: impl Fn(&Value) -> bool) -> Value {
        let deadline = Instant::now() + Duration::from_secs(10);
        loop {
            let now = self.get(job).await.json();
            if is_wanted(&now) {
                return now;
            }
            assert!(Instant::now() < deadline, "waited in vain: {now}");
            tokio::time::sleep(Duration::from_millis(5)).await;
        }
    }

    pub async fn job_in(&self, job: &str, state: &str) -> Value {
        self.job_when(job, |now| now["state"] == state).await
    }

    /// Files of jobs, uploads and attempts under way included.
    pub fn files(&self) -> Vec<PathBuf> {
        let mut files = Vec::new();
        for folder in ["scratch", "masks", "results"] {
            collect(&self.dir.path().join(folder), &mut files);
        }
        files
    }

    pub fn mask_of(&self, job: &str) -> PathBuf {
        self.dir.path().join("masks").join(id_of(job))
    }
}

fn access() -> Access {
    Access { cors_origins: vec!["https://viewer.example.org".to_owned()], is_local: true }
}

fn collect(folder: &Path, files: &mut Vec<PathBuf>) {
    let Ok(entries) = std::fs::read_dir(folder) else { return };
    for entry in entries {
        // Files of runs under way come and go.
        let Ok(entry) = entry else { continue };
        let path = entry.path();
        if path.is_dir() { collect(&path, files) } else { files.push(path) }
    }
}

pub fn id_of(job: &str) -> &str {
    job.rsplit('/').next().unwrap()
}

/// What came back.
pub struct Answer {
    pub status: StatusCode,
    pub headers: HeaderMap,
    pub body: Vec<u8>,
}

impl Answer {
    pub fn text(&self) -> String {
        String::from_utf8_lossy(&self.body).into_owned()
    }

    pub fn json(&self) -> Value {
        serde_json::from_slice(&self.body).unwrap_or_else(|e| panic!("{e}: {}", self.text()))
    }

    pub fn header(&self, name: &str) -> &str {
        self.headers.get(name).unwrap_or_else(|| panic!("no header {name}")).to_str().unwrap()
    }

    /// Asserts a problem object of this status and code, complete and true to its status line.
    #[track_caller]
    pub fn is_problem(&self, status: u16, code: &str) -> Problem {
        assert_eq!(self.header("content-type"), "application/problem+json", "{}", self.text());
        let problem: Problem = serde_json::from_slice(&self.body).unwrap();
        assert_eq!((problem.status, problem.code.as_str()), (status, code), "{}", problem.detail);
        assert_eq!(self.status.as_u16(), status);
        assert_eq!(problem.kind, format!("urn:medialrep:problem:{code}"));
        assert!(!problem.detail.is_empty());
        assert_eq!(problem.retryable, self.headers.contains_key("retry-after"));
        problem
    }
}

/// A NIfTI-1 mask of 4 × 4 × 4 voxels, one of them 1, with the canary in its text fields.
pub fn mask() -> Vec<u8> {
    let mut file = vec![0; 352 + 64];
    let mut put = |at: usize, bytes: &[u8]| file[at..at + bytes.len()].copy_from_slice(bytes);
    put(0, &348_i32.to_le_bytes());
    put(14, CANARY.as_bytes());
    for (axis, size) in [3_i16, 4, 4, 4, 1, 1, 1, 1].into_iter().enumerate() {
        put(40 + 2 * axis, &size.to_le_bytes());
    }
    put(70, &2_i16.to_le_bytes());
    put(72, &8_i16.to_le_bytes());
    for axis in 0..8 {
        put(76 + 4 * axis, &1_f32.to_le_bytes());
    }
    put(108, &352_f32.to_le_bytes());
    put(148, CANARY.as_bytes());
    put(254, &1_i16.to_le_bytes());
    for row in 0..3 {
        put(280 + 16 * row + 4 * row, &1_f32.to_le_bytes());
    }
    put(344, b"n+1\0");
    put(352 + 21, &[1]);
    file
}

/// Content of the artifact `name` that [`writes`] writes.
pub fn content(name: &str) -> Vec<u8> {
    format!("{name}: 0123456789").into_bytes()
}

/// Leaves two files and a warning.
pub fn writes() -> Processor {
    writes_these(&[("model.glb", "model/gltf-binary"), ("thickness.json", "application/json")])
}

/// Writes artifacts of these names and media types.
pub fn writes_these(artifacts: &'static [(&'static str, &'static str)]) -> Processor {
    Arc::new(move |mask, _, _, out, observer| {
        assert!(mask.is_file());
        observer.progress(0, 1, Stage::Quality, 1.0);
        let artifacts = artifacts.iter().map(|(name, media_type)| {
            let content = content(name);
            std::fs::write(out.join(name), &content).unwrap();
            let sha256 = Sha256::digest(&content).iter().map(|byte| format!("{byte:02x}")).collect();
            let dicom = (*media_type == "application/dicom").then(|| object(name));
            WrittenFile { name, media_type, bytes: content.len() as u64, sha256, dicom }
        });
        let warning = Warning { code: "thin".into(), message: "a place is thin".to_owned() };
        Ok(Processed {
            files: artifacts.collect(),
            warnings: vec![warning],
            stage_seconds: vec![(Stage::Isomap, 0.5)],
            structures: Vec::new(),
        })
    })
}

/// The object that an artifact is said to be.
fn object(name: &str) -> DicomObject {
    let instance = format!("1.2.826.{}", name.len());
    DicomObject {
        class: "1.2.3".to_owned(),
        study: "1.2.840.99.7".to_owned(),
        series: "1.2.826.1".to_owned(),
        instance,
    }
}

/// Runs until `gate` opens or the run is cancelled, then does what [`writes`] does.
pub fn waits(gate: &Arc<AtomicBool>) -> Processor {
    let (gate, then) = (Arc::clone(gate), writes());
    Arc::new(move |mask, params, limits, out, observer| {
        std::fs::write(out.join("unfinished"), b"left by a run under way").unwrap();
        observer.progress(1, 2, Stage::Isomap, 0.5);
        while !gate.load(Ordering::Relaxed) {
            observer.check().map_err(|_| ProcessError::Cancelled)?;
            std::thread::sleep(Duration::from_millis(1));
        }
        then(mask, params, limits, out, observer)
    })
}

/// Refuses every mask.
pub fn refuses() -> Processor {
    Arc::new(|_, _, _, _, _| Err(ProcessError::Problem(Box::new(Problem::new(422, "shape_is_a_ball", "a ball")))))
}

static LOG: Mutex<Vec<u8>> = Mutex::new(Vec::new());

/// Everything that was logged by any test of this process so far.
pub fn logged() -> String {
    String::from_utf8_lossy(&LOG.lock().unwrap()).into_owned()
}

fn keep_log() {
    static ONCE: Once = Once::new();
    ONCE.call_once(|| {
        let log = tracing_subscriber::fmt().with_max_level(tracing::Level::DEBUG).with_ansi(false);
        log.with_writer(|| LogWriter).init();
    });
}

struct LogWriter;

impl std::io::Write for LogWriter {
    fn write(&mut self, bytes: &[u8]) -> std::io::Result<usize> {
        LOG.lock().unwrap().extend_from_slice(bytes);
        Ok(bytes.len())
    }

    fn flush(&mut self) -> std::io::Result<()> {
        Ok(())
    }
}
