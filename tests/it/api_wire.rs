//! What only a real connection shows: timeouts, early answers, the end of the server.

use std::net::SocketAddr;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use medialrep::config::{ConnectionLimits, ServeConfig};
use medialrep::http::server;
use medialrep::jobs::worker::Processor;
use tempfile::TempDir;
use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio::net::{TcpListener, TcpSocket, TcpStream};
use tokio::task::JoinHandle;
use tokio::time::{sleep, timeout};
use tokio_util::sync::CancellationToken;

use crate::help::support::{limits, mask, waits, writes};

struct Wire {
    _dir: TempDir,
    address: SocketAddr,
    stop: CancellationToken,
    server: JoinHandle<()>,
}

async fn serve(processor: Processor) -> Wire {
    let header_read = Duration::from_millis(300);
    serve_with(processor, ConnectionLimits { header_read, ..ConnectionLimits::default() }).await
}

async fn serve_with(processor: Processor, connections: ConnectionLimits) -> Wire {
    let dir = TempDir::new().unwrap();
    let config = ServeConfig {
        data_dir: dir.path().to_owned(),
        workers: 1,
        drain: Duration::from_millis(300),
        jobs: limits(),
        connections,
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

/// With so many places, and readers that may stall for a second.
async fn serve_few(places: usize) -> Wire {
    let connections = ConnectionLimits {
        max_connections: places,
        write_idle: Duration::from_secs(1),
        write_bytes_per_second: 1024,
        ..ConnectionLimits::default()
    };
    serve_with(writes(), connections).await
}

impl Wire {
    /// Asks for the longest open answer many times over and reads nothing.
    async fn ask_and_never_read(&self) -> TcpStream {
        let socket = TcpSocket::new_v4().unwrap();
        socket.set_recv_buffer_size(4096).unwrap();
        let mut stream = socket.connect(self.address).await.unwrap();
        stream
            .write_all(&b"GET /docs/swagger-ui-bundle.js HTTP/1.1\r\nHost: localhost\r\n\r\n".repeat(12))
            .await
            .unwrap();
        stream
    }

    async fn is_live(&self) -> bool {
        let head = b"GET /livez HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\n\r\n";
        timeout(Duration::from_secs(3), self.talk(&[head])).await.is_ok_and(|answer| answer.starts_with("HTTP/1.1 200"))
    }
}

#[tokio::test]
async fn clients_that_never_read_lose_their_places_to_others() {
    // Nobody is judged by pace here: the places are taken by those who wait.
    let connections = ConnectionLimits { max_connections: 4, ..ConnectionLimits::default() };
    let wire = serve_with(writes(), connections).await;
    let mut silent = Vec::new();
    for _ in 0..4 {
        silent.push(wire.ask_and_never_read().await);
    }
    for _ in 0..3 {
        assert!(wire.is_live().await);
    }
}

#[tokio::test]
async fn a_client_that_does_not_read_is_cut_off_and_one_that_reads_is_not() {
    let wire = serve_few(16).await;
    let mut silent = wire.ask_and_never_read().await;
    sleep(Duration::from_millis(2500)).await;
    let mut left = Vec::new();
    // What was under way arrives, and then the end.
    let _ = timeout(Duration::from_secs(5), silent.read_to_end(&mut left)).await.expect("cut off");
    let mut reading = wire.ask_and_never_read().await;
    let mut read = 0;
    let mut part = vec![0; 256 << 10];
    let begun = Instant::now();
    while read < 2 << 20 && begun.elapsed() < Duration::from_secs(20) {
        sleep(Duration::from_millis(20)).await;
        let count = reading.read(&mut part).await.unwrap();
        assert!(count > 0, "cut off after {read}");
        read += count;
    }
    assert!(read > left.len());
}

#[tokio::test]
async fn idle_clients_lose_their_places_and_those_whose_answer_is_made_do_not() {
    let connections = ConnectionLimits { max_connections: 2, ..ConnectionLimits::default() };
    let gate = Arc::new(AtomicBool::new(false));
    let wire = serve_with(waits(&gate), connections).await;
    let _idle = TcpStream::connect(wire.address).await.unwrap();
    let mut waiting = TcpStream::connect(wire.address).await.unwrap();
    // A long poll: the answer is being made for three seconds.
    let answer = wire.post(&format!("Content-Length: {}", mask().len()), &mask()).await;
    let id = answer.split("\"id\":\"").nth(1).and_then(|rest| rest.split('"').next()).unwrap();
    let ask = format!("GET /v1/jobs/{id}?wait=3 HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\n\r\n");
    waiting.write_all(ask.as_bytes()).await.unwrap();
    sleep(Duration::from_millis(1200)).await;
    let are_live = [wire.is_live().await, wire.is_live().await];
    let mut told = Vec::new();
    waiting.read_to_end(&mut told).await.unwrap();
    gate.store(true, Ordering::Relaxed);
    assert_eq!(are_live, [true; 2]);
    assert!(told.starts_with(b"HTTP/1.1 200"), "{}", String::from_utf8_lossy(&told));
}

#[tokio::test]
async fn a_request_that_cannot_be_read_is_answered_with_a_problem() {
    let wire = serve(writes()).await;
    let long = "a".repeat(200_000);
    for (head, code) in [
        ("GET /v1/jobs?label=\"a\" HTTP/1.1\r\nHost: localhost\r\n\r\n".to_owned(), "malformed_request"),
        ("GET /livez HTTP/1.1\r\nHost localhost\r\n\r\n".to_owned(), "malformed_request"),
        (format!("GET /livez HTTP/1.1\r\nHost: localhost\r\nX: {long}\r\n\r\n"), "headers_too_large"),
    ] {
        let answer = wire.talk(&[head.as_bytes()]).await;
        let (head, body) = answer.split_once("\r\n\r\n").unwrap();
        assert!(head.starts_with("HTTP/1.1 4") && head.contains("application/problem+json"), "{code}: {answer}");
        let problem: serde_json::Value = serde_json::from_str(body).unwrap();
        assert_eq!(problem["code"], code);
    }
}
