//! Any bytes as a form sent to `POST /v1/jobs`: a job or a problem object, however the bytes are cut
//! into pieces, and nothing left on disk.

use std::convert::Infallible;
use std::path::Path;
use std::sync::Arc;
use std::time::Duration;

use axum::Router;
use axum::body::Body;
use axum::http::{Method, Request, StatusCode};
use bytes::Bytes;
use futures_util::stream;
use http_body_util::BodyExt;
use medialrep::config::ServeConfig;
use medialrep::formats::InputLimits;
use medialrep::http::auth::Access;
use medialrep::jobs::place::Place;
use medialrep::jobs::service::Jobs;
use medialrep::problem::Problem;
use serde_json::Value;
use tempfile::TempDir;
use tokio::runtime::{Builder, Runtime};
use tower::ServiceExt;

/// Every form has the boundary `X`.
const CONTENT_TYPE: &str = "multipart/form-data; boundary=X";
/// Longest mask, so that inputs of a few kilobytes can be too long.
const MAX_MASK_BYTES: u64 = 2048;

/// A service without workers, for many forms.
pub struct Forms {
    runtime: Runtime,
    router: Router,
    dir: TempDir,
}

/// A status with the body, which is JSON or empty.
struct Answer {
    status: StatusCode,
    media_type: String,
    body: Value,
}

impl Forms {
    /// On a new folder.
    pub fn open() -> Self {
        let runtime = Builder::new_current_thread().enable_all().build().unwrap();
        let dir = TempDir::new().unwrap();
        let router = runtime.block_on(service(dir.path()));
        Self { runtime, router, dir }
    }

    /// What must hold of any bytes.
    pub fn check(&self, bytes: &[u8]) {
        let whole = self.runtime.block_on(self.submit(Body::from(bytes.to_vec())));
        let in_pieces = self.runtime.block_on(self.submit(pieces(bytes)));
        // A form that is both refused and cut short may be refused for either.
        assert_eq!(whole, in_pieces);
    }

    /// Mask and parameters of the job, if it is accepted.
    async fn submit(&self, form: Body) -> Option<(Value, Value)> {
        let request = Request::post("/v1/jobs").header("content-type", CONTENT_TYPE).body(form).unwrap();
        let answer = self.send(request).await;
        let mut accepted = None;
        if answer.status == StatusCode::ACCEPTED {
            let path = format!("/v1/jobs/{}", answer.body["id"].as_str().unwrap());
            let request = Request::builder().method(Method::DELETE).uri(path).body(Body::empty()).unwrap();
            assert_eq!(self.send(request).await.status, StatusCode::NO_CONTENT);
            accepted = Some((answer.body["mask"].clone(), answer.body["params"].clone()));
        } else {
            check_problem(&answer);
        }
        for folder in ["scratch", "masks", "results"] {
            assert_eq!(files(&self.dir.path().join(folder)), 0, "{folder}");
        }
        accepted
    }

    async fn send(&self, request: Request<Body>) -> Answer {
        let response = self.router.clone().oneshot(request).await.unwrap();
        let (parts, body) = response.into_parts();
        let body = body.collect().await.unwrap().to_bytes();
        let media_type = parts.headers.get("content-type").map_or("", |value| value.to_str().unwrap()).to_owned();
        Answer { status: parts.status, media_type, body: serde_json::from_slice(&body).unwrap_or_default() }
    }
}

/// Files in a folder, which may be missing.
fn files(folder: &Path) -> usize {
    let Ok(entries) = std::fs::read_dir(folder) else { return 0 };
    let paths = entries.map(|entry| entry.unwrap().path());
    paths.map(|path| if path.is_dir() { files(&path) } else { 1 }).sum()
}

async fn service(data_dir: &Path) -> Router {
    let mut limits = ServeConfig::default().jobs;
    limits.min_free_bytes = 0;
    limits.upload.max_bytes = MAX_MASK_BYTES;
    limits.upload.idle = Duration::from_secs(5);
    limits.input = InputLimits { max_voxels: 1 << 20, max_decompressed_bytes: 4 << 20 };
    let jobs = Jobs::open(&Place::at(data_dir), limits, None).await.unwrap();
    medialrep::http::router(Arc::new(jobs), Access::default())
}

/// A body that comes in short pieces; each is awaited, so that the parser sees them one by one.
fn pieces(bytes: &[u8]) -> Body {
    let length = 1 + bytes.len() % 61;
    let chunks: Vec<Bytes> = bytes.chunks(length).map(Bytes::copy_from_slice).collect();
    Body::from_stream(stream::unfold(chunks.into_iter(), |mut chunks| async {
        tokio::task::yield_now().await;
        chunks.next().map(|chunk| (Ok::<_, Infallible>(chunk), chunks))
    }))
}

fn check_problem(answer: &Answer) {
    let problem: Problem = serde_json::from_value(answer.body.clone()).unwrap();
    assert_eq!(answer.media_type, "application/problem+json", "{problem:?}");
    assert_eq!(answer.status.as_u16(), problem.status);
    // Nothing pauses, no other job waits and the disk has room, so that no other status fits.
    assert!(matches!(problem.status, 400 | 413 | 415 | 422), "{problem:?}");
}
