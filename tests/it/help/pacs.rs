//! A PACS of tests: answers as the test says, and keeps what it was asked.

use std::collections::VecDeque;
use std::convert::Infallible;
use std::sync::{Arc, Mutex};
use std::time::Duration;

use axum::Router;
use axum::body::{Body, Bytes};
use axum::extract::State;
use axum::http::{HeaderMap, Request, Response};
use futures_util::stream;
use medialrep::dicomweb::{Pacs, PacsConfig, PacsServer};
use tokio::net::TcpListener;

use super::support::CANARY;

pub const STUDY: &str = "1.2.840.99.1";
pub const SERIES: &str = "1.2.840.99.1.1";
pub const INSTANCE: &str = "1.2.840.99.1.1.1";
pub const MULTIPART: &str = "multipart/related; type=\"application/dicom\"; boundary=X";

/// An answer.
#[derive(Clone)]
pub struct Reply {
    pub status: u16,
    pub content_type: &'static str,
    /// Chunks with a pause before each.
    pub chunks: Vec<(Duration, Bytes)>,
    /// Whether the last chunk comes again and again.
    pub is_endless: bool,
    /// Whether the connection breaks after the last chunk.
    pub breaks: bool,
}

impl Reply {
    pub fn new(status: u16, content_type: &'static str, body: impl Into<Bytes>) -> Self {
        let chunks = vec![(Duration::ZERO, body.into())];
        Self { status, content_type, chunks, is_endless: false, breaks: false }
    }

    /// These files as parts.
    pub fn parts(files: &[Vec<u8>]) -> Self {
        Self::new(200, MULTIPART, related(files))
    }

    /// The same in chunks of this length, with a pause before each.
    pub fn in_chunks(mut self, length: usize, pause: Duration) -> Self {
        let body: Vec<u8> = self.chunks.iter().flat_map(|(_, chunk)| chunk.to_vec()).collect();
        self.chunks = body.chunks(length).map(|chunk| (pause, Bytes::copy_from_slice(chunk))).collect();
        self
    }

    fn response(self) -> Response<Body> {
        let mut response = Response::builder().status(self.status).header("content-type", self.content_type);
        response = response.header("location", format!("/{CANARY}")).header("x-patient", CANARY);
        let state = (self.chunks.into_iter().collect::<VecDeque<_>>(), self.is_endless, self.breaks);
        let body = stream::unfold(state, |(mut chunks, is_endless, breaks)| async move {
            let Some((pause, chunk)) = chunks.pop_front() else {
                let broken = std::io::Error::other("broken on purpose");
                return breaks.then_some((Err(broken), (chunks, false, false)));
            };
            tokio::time::sleep(pause).await;
            if is_endless && chunks.is_empty() {
                chunks.push_back((pause, chunk.clone()));
            }
            Some((Ok(chunk), (chunks, is_endless, breaks)))
        });
        response.body(Body::from_stream(body)).unwrap()
    }
}

/// A body of these parts, the canary in the head of each.
pub fn related(files: &[Vec<u8>]) -> Vec<u8> {
    let mut body = Vec::new();
    for file in files {
        let head = format!("--X\r\nContent-Type: application/dicom\r\nContent-Location: /{CANARY}\r\n\r\n");
        body.extend([head.as_bytes(), file, b"\r\n"].concat());
    }
    body.extend(b"--X--\r\n");
    body
}

/// A request.
#[derive(Clone, Debug)]
pub struct Asked {
    pub address: String,
    pub headers: HeaderMap,
    pub body: Bytes,
}

type AllAsked = Arc<Mutex<Vec<Asked>>>;
type Replies = Arc<Mutex<VecDeque<Reply>>>;

/// A PACS named `main`.
pub struct FakePacs {
    pub url: String,
    asked: AllAsked,
}

impl FakePacs {
    /// Gives these answers one after the other, the last for ever.
    pub async fn start(replies: Vec<Reply>) -> Self {
        let listener = TcpListener::bind("127.0.0.1:0").await.unwrap();
        let url = format!("http://{}/dicom-web", listener.local_addr().unwrap());
        let (asked, replies): (AllAsked, Replies) = (AllAsked::default(), Arc::new(Mutex::new(replies.into())));
        let router = Router::new().fallback(answer).with_state((Arc::clone(&asked), replies));
        tokio::spawn(async move { axum::serve(listener, router).await });
        Self { url, asked }
    }

    pub fn asked(&self) -> Vec<Asked> {
        self.asked.lock().unwrap().clone()
    }

    /// What asks it, with a user and a password; `idle` is the longest silence.
    pub fn client(&self, idle: Duration) -> Pacs {
        self.client_of(&self.url, idle)
    }

    /// What asks another in its place.
    pub fn client_of(&self, url: &str, idle: Duration) -> Pacs {
        let mut server: PacsServer = format!("main={url}").parse().unwrap();
        server.credentials = Some(format!("peer:{CANARY}").parse().unwrap());
        let connect = Duration::from_secs(2);
        Pacs::new(PacsConfig { servers: vec![server], extra_roots: Vec::new(), connect, idle }).unwrap()
    }
}

async fn answer(
    State((asked, replies)): State<(AllAsked, Replies)>,
    request: Request<Body>,
) -> Result<Response<Body>, Infallible> {
    let (head, body) = request.into_parts();
    // What is cut off was not asked.
    let Ok(body) = axum::body::to_bytes(body, usize::MAX).await else { return Ok(Response::default()) };
    asked.lock().unwrap().push(Asked { address: head.uri.to_string(), headers: head.headers, body });
    let reply = {
        let mut replies = replies.lock().unwrap();
        let reply = replies.pop_front().expect("an answer");
        if replies.is_empty() {
            replies.push_back(reply.clone());
        }
        reply
    };
    Ok(reply.response())
}
