//! The masks to try the service on, over HTTP.

use std::process::Command;

use axum::http::Method;
use medialrep::jobs::token::{Scope, Token};
use medialrep::samples;

use crate::help::support::{Server, limits, logged};

#[tokio::test]
async fn every_sample_is_listed_with_its_place() {
    let server = Server::without_workers().await;
    let list = server.get("/v1/samples").await.json();
    let listed = list["samples"].as_array().unwrap();
    assert_eq!(listed.len(), samples::list().count());
    for ((name, about), sample) in samples::list().zip(listed) {
        assert_eq!((&sample["name"], &sample["about"]), (&name.into(), &about.into()));
        assert_eq!(sample["href"], format!("/v1/samples/{name}"));
    }
}

#[tokio::test]
async fn a_sample_is_the_file_that_the_command_writes_and_is_accepted_as_a_job() {
    let mut limits = limits();
    limits.upload.max_bytes = 1 << 20;
    let folder = tempfile::tempdir().unwrap();
    let server = Server::open_with(tempfile::TempDir::new().unwrap(), limits, None).await;
    for name in ["ellipsoid", "two"] {
        let answer = server.get(&format!("/v1/samples/{name}")).await;
        assert_eq!((answer.status.as_u16(), answer.header("content-type")), (200, "application/gzip"));
        assert_eq!(answer.header("content-disposition"), format!("attachment; filename=\"{name}.nii.gz\""));
        let out = folder.path().join(name);
        let done = Command::new(env!("CARGO_BIN_EXE_medialrep")).args(["sample", name, "--out"]).arg(&out).status();
        assert!(done.unwrap().success() && std::fs::read(&out).unwrap() == answer.body, "{name} differs");
        assert_eq!(server.post("/v1/jobs", answer.body).await.status, 202, "{name}");
    }
}

#[tokio::test]
async fn a_sample_that_the_client_has_is_not_sent_again() {
    let server = Server::without_workers().await;
    let first = server.get("/v1/samples/ball").await;
    let etag = first.header("etag").to_owned();
    assert!(etag.starts_with('"') && first.header("cache-control").starts_with("private, max-age="));
    let again = server.with(Method::GET, "/v1/samples/ball", &[("if-none-match", &etag)], Vec::new()).await;
    assert_eq!((again.status.as_u16(), again.body.len(), again.header("etag")), (304, 0, &*etag));
    let head = server.call(Method::HEAD, "/v1/samples/ball").await;
    assert_eq!((head.status.as_u16(), head.body.len(), head.header("etag")), (200, 0, &*etag));
}

#[tokio::test]
async fn a_sample_wanted_by_many_at_once_is_made_once() {
    let server = Server::without_workers().await;
    // Given up at once, as by a client that hangs up; the work goes on.
    tokio::select! {
        biased;
        _ = server.get("/v1/samples/thin") => {},
        () = tokio::task::yield_now() => {},
    }
    let answers = futures_util::future::join_all((0..8).map(|_| server.get("/v1/samples/thin"))).await;
    assert!(answers.iter().all(|answer| answer.status == 200 && answer.body == answers[0].body));
    let log = logged();
    let made = log.lines().filter(|line| line.contains("sample made") && line.contains("\"thin\"")).count();
    assert_eq!(made, 1);
}

#[tokio::test]
async fn an_unknown_sample_is_a_problem() {
    let server = Server::without_workers().await;
    for name in ["nothing", "%FF", "..%2Fellipsoid", "ellipsoid.nii.gz"] {
        let problem = server.get(&format!("/v1/samples/{name}")).await.is_problem(404, "no_such_sample");
        assert!(problem.hint.unwrap().contains("/v1/samples"));
    }
    server.call(Method::POST, "/v1/samples").await.is_problem(405, "method_not_allowed");
}

#[tokio::test]
async fn samples_ask_for_the_scope_read() {
    let server = Server::without_workers().await;
    let mut tokens = Vec::new();
    for scope in [Scope::Read, Scope::Write] {
        let token = Token::new().unwrap();
        server.jobs.store().insert_token(&token.stored("t".to_owned(), vec![scope], None)).await.unwrap();
        tokens.push(format!("Bearer {}", token.reveal()));
    }
    for path in ["/v1/samples", "/v1/samples/ball", "/v1/samples/nothing"] {
        let with = async |token: &str| server.with(Method::GET, path, &[("authorization", token)], Vec::new()).await;
        server.get(path).await.is_problem(401, "token_missing");
        with(&tokens[1]).await.is_problem(403, "scope_missing");
        assert_eq!(with(&tokens[0]).await.status, if path.ends_with("nothing") { 404 } else { 200 });
    }
}
