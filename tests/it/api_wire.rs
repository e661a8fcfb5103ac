//! What only a real connection shows: timeouts, early answers, the end of the server.

use std::net::SocketAddr;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;
use std::time::{Duration, Instant};

use medialrep::config::{ConnectionLimits, ServeConfig};
use medialrep::http::server;
use medialrep::jobs::worker::Processor;
use tempfile::TempDir;
use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio::net::{TcpListener, TcpStream};
use tokio::task::JoinHandle;
use tokio_util::sync::CancellationToken;

use crate::help::support::{limits, mask, waits, writes};

struct Wire {
    _dir: TempDir,
    address: SocketAddr,
    stop: CancellationToken,
    server: JoinHandle<()>,
}

async fn serve(processor: Processor) -> Wire {
    let dir = TempDir::new().unwrap();
    let config = ServeConfig {
        data_dir: dir.path().to_owned(),
        workers: 1,
        drain: Duration::from_millis(300),
        jobs: limits(),
        connections: ConnectionLimits { header_read: Duration::from_millis(300), ..ConnectionLimits::default() },
        ..ServeConfig::default()
    };
    let listener = TcpListener::bind("127.0.0.1:0").await.unwrap();
    let (address, stop) = (listener.local_addr().unwrap(), CancellationToken::new());
    let stopped = stop.clone().cancelled_owned();
    let server = tokio::spawn(async move { server::run(listener, &config, &processor, stopped).await.unwrap() });
    Wire { _dir: dir, address, stop, server }
}

impl Wire {
    /// Writes and reads until the server closes the connection.
    async fn talk(&self, parts: &[&[u8]]) -> String {
        let mut stream = TcpStream::connect(self.address).await.unwrap();
        for part in parts {
            // The server may have answered and closed already.
            let _ = stream.write_all(part).await;
        }
        let mut answer = Vec::new();
        let _ = stream.read_to_end(&mut answer).await;
        String::from_utf8_lossy(&answer).into_owned()
    }

    async fn post(&self, head: &str, body: &[u8]) -> String {
        let head = format!("POST /v1/jobs HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\n{head}\r\n\r\n");
        self.talk(&[head.as_bytes(), body]).await
    }
}

#[tokio::test]
async fn a_job_goes_over_the_wire() {
    let wire = serve(writes()).await;
    let answer = wire.post(&format!("Content-Length: {}", mask().len()), &mask()).await;
    assert!(answer.starts_with("HTTP/1.1 202 "), "{answer}");
    wire.stop.cancel();
    wire.server.await.unwrap();
}

#[tokio::test]
async fn a_length_above_the_limit_is_answered_before_the_body() {
    let wire = serve(writes()).await;
    let answer = wire.post("Content-Length: 4000000000\r\nExpect: 100-continue", b"").await;
    assert!(answer.starts_with("HTTP/1.1 413 "), "{answer}");
    assert!(answer.contains("upload_too_large"));
}

#[tokio::test]
async fn endless_chunks_are_cut_off() {
    let wire = serve(writes()).await;
    let mask = mask();
    let mut chunks = format!("{:x}\r\n", mask.len()).into_bytes();
    chunks.extend(mask);
    chunks.extend(b"\r\n");
    for _ in 0..100 {
        chunks.extend(b"400\r\n");
        chunks.extend([0; 1024]);
        chunks.extend(b"\r\n");
    }
    let answer = wire.post("Transfer-Encoding: chunked", &chunks).await;
    assert!(answer.starts_with("HTTP/1.1 413 "), "{answer}");
}

#[tokio::test]
async fn headers_that_never_end_are_dropped() {
    let wire = serve(writes()).await;
    let begun = Instant::now();
    let answer = wire.talk(&[b"GET / HTTP/1.1\r\nHost: localhost\r\n"]).await;
    assert!(begun.elapsed() < Duration::from_secs(5));
    assert!(answer.is_empty() || answer.starts_with("HTTP/1.1 408 "), "{answer}");
}

#[tokio::test]
async fn headers_without_end_are_refused() {
    let wire = serve(writes()).await;
    let answer = wire.talk(&[b"GET / HTTP/1.1\r\nX: ", &[b'a'; 200_000]]).await;
    assert!(answer.is_empty() || answer.starts_with("HTTP/1.1 431 "), "{answer}");
}

#[tokio::test]
async fn a_stopping_server_does_not_wait_for_idle_clients_or_endless_jobs() {
    let wire = serve(waits(&Arc::new(AtomicBool::new(false)))).await;
    let answer = wire.post(&format!("Content-Length: {}", mask().len()), &mask()).await;
    assert!(answer.starts_with("HTTP/1.1 202 "), "{answer}");
    let _idle = TcpStream::connect(wire.address).await.unwrap();
    let begun = Instant::now();
    wire.stop.cancel();
    wire.server.await.unwrap();
    assert!(begun.elapsed() < Duration::from_secs(3));
    assert!(TcpStream::connect(wire.address).await.is_err());
}
