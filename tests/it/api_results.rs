//! `GET /v1/jobs/{id}/results/{name}`.

use std::sync::Arc;

use axum::body::Body;
use axum::http::Request;
use medialrep::formats::write;
use medialrep::jobs::process::{Kept, process};
use medialrep::jobs::worker::Processor;
use serde_json::Value;

use crate::help::phantoms::volume;
use crate::help::support::{Answer, Server, content, writes};

async fn done() -> (Server, String) {
    let server = Server::start(writes()).await;
    let job = server.submit().await;
    server.job_in(&job, "succeeded").await;
    (server, format!("{job}/results/thickness.json"))
}

async fn get_with(server: &Server, path: &str, headers: &[(&str, &str)]) -> Answer {
    let request = headers.iter().fold(Request::get(path), |request, (name, value)| request.header(*name, *value));
    server.send(request.body(Body::empty()).unwrap()).await
}

#[tokio::test]
async fn a_result_is_served_whole() {
    let (server, path) = done().await;
    let answer = server.get(&path).await;
    assert_eq!((answer.status.as_u16(), &answer.body), (200, &content("thickness.json")));
    assert_eq!(answer.header("content-type"), "application/json");
    assert_eq!(answer.header("content-length"), answer.body.len().to_string());
    assert_eq!(answer.header("content-disposition"), "attachment; filename=\"thickness.json\"");
    assert_eq!(answer.header("cache-control"), "private, max-age=31536000, immutable");
    let job = server.get(path.split("/results").next().unwrap()).await.json();
    assert_eq!(answer.header("etag"), format!("\"{}\"", job["results"][1]["sha256"].as_str().unwrap()));
}

#[tokio::test]
async fn a_client_that_has_it_gets_nothing() {
    let (server, path) = done().await;
    let etag = server.get(&path).await.header("etag").to_owned();
    for tag in [etag.as_str(), "*", &format!("\"other\", W/{etag}")] {
        let answer = get_with(&server, &path, &[("if-none-match", tag)]).await;
        assert_eq!((answer.status.as_u16(), answer.body.len()), (304, 0), "{tag}");
        assert_eq!(answer.header("etag"), etag);
    }
    assert_eq!(get_with(&server, &path, &[("if-none-match", "\"other\"")]).await.status, 200);
}

#[tokio::test]
async fn a_range_is_served() {
    let (server, path) = done().await;
    let all = content("thickness.json");
    let answer = get_with(&server, &path, &[("range", "bytes=3-6")]).await;
    assert_eq!((answer.status.as_u16(), &answer.body[..]), (206, &all[3..=6]));
    assert_eq!(answer.header("content-range"), format!("bytes 3-6/{}", all.len()));
    assert_eq!(answer.header("content-length"), "4");
    let tail = get_with(&server, &path, &[("range", "bytes=-5")]).await;
    assert_eq!(&tail.body[..], &all[all.len() - 5..]);
    get_with(&server, &path, &[("range", "bytes=999-")]).await.is_problem(416, "range_not_satisfiable");
    let changed = get_with(&server, &path, &[("range", "bytes=3-6"), ("if-range", "\"other\"")]).await;
    assert_eq!((changed.status.as_u16(), changed.body), (200, all));
}

#[tokio::test]
async fn only_published_names_are_served() {
    let (server, path) = done().await;
    let results = path.strip_suffix("thickness.json").unwrap();
    for name in ["points.csv", "nothing", "..", "..%2f..%2f..%2fjobs.sqlite", "%2fetc%2fpasswd"] {
        server.get(&format!("{results}{name}")).await.is_problem(404, "no_such_result");
    }
}

/// The real thing: a mask is read, run and written, and its record kept.
fn processes() -> Processor {
    Arc::new(|mask, params, limits, out, observer| process(mask, params, limits, (out, Kept::Record), observer))
}

async fn job_of_a_slab(server: &Server, params: &str) -> String {
    let slab = volume("slab");
    let mut file = Vec::new();
    write::nifti::write(&slab, &mut file).unwrap();
    let query: String = form_urlencoded::byte_serialize(params.as_bytes()).collect();
    let answer = server.post(&format!("/v1/jobs?params={query}"), file).await;
    assert_eq!(answer.status, 202, "{}", answer.text());
    let job = answer.header("location").to_owned();
    server.job_in(&job, "succeeded").await;
    job
}

fn names(job: &Value) -> Vec<&str> {
    job["results"].as_array().unwrap().iter().map(|file| file["name"].as_str().unwrap()).collect()
}

#[tokio::test]
async fn a_result_that_was_not_asked_for_is_made_when_it_is_and_kept() {
    let server = Server::start(processes()).await;
    let whole = job_of_a_slab(&server, "{}").await;
    let part = job_of_a_slab(&server, r#"{"outputs":["thickness.json"]}"#).await;
    let status = server.get(&part).await.json();
    assert_eq!(names(&status), ["thickness.json"]);
    for name in ["model.glb", "points.csv", "thickness.csv"] {
        let made = server.get(&format!("{part}/results/{name}")).await;
        assert_eq!(made.status, 200, "{name}: {}", made.text());
        assert_eq!(made.body, server.get(&format!("{whole}/results/{name}")).await.body, "{name} has other bytes");
    }
    let status = server.get(&part).await.json();
    assert_eq!(names(&status).len(), 4, "what was made is kept");
    server.get(&format!("{part}/results/record")).await.is_problem(404, "no_such_result");
    server.get(&format!("{part}/results/no.such")).await.is_problem(404, "no_such_result");
}

#[tokio::test]
async fn results_for_archives_are_made_when_somebody_asks() {
    let server = Server::start(processes()).await;
    let job = job_of_a_slab(&server, "{}").await;
    for (name, media_type) in
        [("picture.png", "image/png"), ("report.pdf", "application/pdf"), ("report.sr.dcm", "application/dicom")]
    {
        let made = server.get(&format!("{job}/results/{name}")).await;
        assert_eq!((made.status.as_u16(), made.header("content-type")), (200, media_type), "{name}");
        let again = server.get(&format!("{job}/results/{name}")).await;
        assert_eq!(again.body, made.body, "{name}: what was made is kept");
    }
}

#[tokio::test]
async fn many_who_ask_at_once_for_what_is_not_there_get_the_same() {
    let server = Server::start(processes()).await;
    let job = job_of_a_slab(&server, r#"{"outputs":["thickness.json"]}"#).await;
    let path = format!("{job}/results/model.glb");
    let answers = futures_util::future::join_all((0..4).map(|_| server.get(&path))).await;
    for answer in &answers {
        assert_eq!(answer.status, 200, "{}", answer.text());
        assert!(answer.body == answers[0].body);
    }
    let status = server.get(&job).await.json();
    assert_eq!(names(&status), ["thickness.json", "model.glb"]);
}

#[tokio::test]
async fn a_damaged_record_is_told_and_nothing_is_made_from_it() {
    let server = Server::start(processes()).await;
    let job = job_of_a_slab(&server, r#"{"outputs":["thickness.json"]}"#).await;
    // What the worker had of it may not be cleared away yet.
    let records: Vec<_> = server.files().into_iter().filter(|file| file.ends_with("record")).collect();
    assert!(!records.is_empty(), "it is kept");
    for record in records {
        let Ok(mut bytes) = std::fs::read(&record) else { continue };
        let middle = bytes.len() / 2;
        bytes[middle] ^= 1;
        std::fs::write(&record, bytes).unwrap();
    }
    server.get(&format!("{job}/results/model.glb")).await.is_problem(500, "result_damaged");
}
