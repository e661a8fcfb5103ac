//! Masks fetched from a PACS: what is asked, what is taken, and what is said when there is none.

use std::time::{Duration, Instant};

use axum::http::Method;
use medialrep::jobs::limits::JobLimits;
use serde_json::{Value, json};

use crate::help::dicom_bytes::{Seg, text};
use crate::help::pacs::{Asked, FakePacs, INSTANCE, MULTIPART, Reply, SERIES, STUDY, related};
use crate::help::support::{Answer, CANARY, Server, limits, logged, mask, writes};

const SEGMENTATION: &str = "1.2.840.10008.5.1.4.1.1.66.4";
const IMAGE: &str = "1.2.840.10008.5.1.4.1.1.2";
const JSON: [(&str, &str); 1] = [("content-type", "application/json")];
/// Longest silence of the PACS in these tests.
const IDLE: Duration = Duration::from_millis(300);

fn bounds() -> JobLimits {
    let mut limits = limits();
    limits.upload.max_bytes = 16 << 10;
    limits.upload.total = Duration::from_secs(5);
    limits
}

/// A service that may ask a PACS, which gives these answers.
async fn asking(replies: Vec<Reply>) -> (Server, FakePacs) {
    let pacs = FakePacs::start(replies).await;
    let server = Server::with_pacs(bounds(), pacs.client(IDLE)).await;
    (server, pacs)
}

fn source(instance: Option<&str>) -> Value {
    let mut source = json!({"server": "main", "study": STUDY, "series": SERIES});
    if let Some(instance) = instance {
        source["instance"] = instance.into();
    }
    json!({"source": {"dicomweb": source}})
}

async fn submit(server: &Server, body: &Value) -> Answer {
    server.with(Method::POST, "/v1/jobs", &JSON, body.to_string().into_bytes()).await
}

/// A segmentation that says what it is, with the canary for the patient.
fn segmentation(class: &str, instance: &str) -> Vec<u8> {
    let mut dicom = Seg::small().dicom();
    dicom.set(text(0x0008_0016, "UI", class));
    dicom.set(text(0x0008_0018, "UI", instance));
    dicom.set(text(0x0010_0010, "PN", CANARY));
    dicom.bytes()
}

fn seg(number: usize) -> Vec<u8> {
    segmentation(SEGMENTATION, &format!("1.2.{number}"))
}

/// The instance that is asked for by name.
fn named() -> Vec<u8> {
    segmentation(SEGMENTATION, INSTANCE)
}

fn image() -> Vec<u8> {
    segmentation(IMAGE, "1.2.9")
}

/// The problem that the only answer of the PACS leads to; nothing is left of it, and nothing it wrote is repeated.
async fn check_problem(reply: Reply, instance: Option<&str>, status: u16, code: &str) -> (String, usize) {
    let (server, pacs) = asking(vec![reply]).await;
    let answer = submit(&server, &source(instance)).await;
    let problem = answer.is_problem(status, code);
    assert!(!answer.text().contains(CANARY), "{}", answer.text());
    assert!(!logged().contains(CANARY));
    assert!(server.files().is_empty(), "{:?}", server.files());
    (problem.detail, pacs.asked().len())
}

#[tokio::test]
async fn an_instance_is_fetched_and_worked_on() {
    let (mut server, pacs) = asking(vec![Reply::parts(&[mask()])]).await;
    let mut body = source(Some(INSTANCE));
    body["params"] = json!({"grid": {"rows": 6, "cols": 8}});
    body["labels"] = json!({"study": "liver-07"});
    let answer = submit(&server, &body).await;
    assert_eq!(answer.status, 202, "{}", answer.text());
    let job = answer.json();
    assert_eq!((&job["params"], &job["labels"]), (&body["params"], &body["labels"]));
    assert_eq!(job["mask"]["bytes"], mask().len());
    let asked = pacs.asked();
    let [Asked { address, headers, .. }] = &asked[..] else { panic!("{} times", asked.len()) };
    assert_eq!(address, &format!("/dicom-web/studies/{STUDY}/series/{SERIES}/instances/{INSTANCE}"));
    assert_eq!(headers["accept"], "multipart/related; type=\"application/dicom\"; transfer-syntax=*");
    assert!(headers["authorization"].to_str().unwrap().starts_with("Basic "));
    server.run(&writes());
    server.job_when(answer.header("location"), |now| now["state"] == "succeeded").await;
}

#[tokio::test]
async fn the_same_bytes_are_the_same_work_however_they_came() {
    let (mut server, _pacs) = asking(vec![Reply::parts(&[mask()])]).await;
    server.run(&writes());
    let job = server.post("/v1/jobs", mask()).await;
    server.job_when(job.header("location"), |now| now["state"] == "succeeded").await;
    let answer = submit(&server, &source(Some(INSTANCE))).await;
    assert_eq!(answer.json()["reused"], true, "{}", answer.text());
}

#[tokio::test]
async fn a_file_that_comes_in_small_chunks_is_whole() {
    for length in [7, 100] {
        let reply = Reply::parts(&[named()]).in_chunks(length, Duration::ZERO);
        let (server, _pacs) = asking(vec![reply]).await;
        let answer = submit(&server, &source(Some(INSTANCE))).await;
        assert_eq!(answer.status, 202, "{}", answer.text());
        assert_eq!(answer.json()["mask"]["bytes"], named().len());
    }
}

#[tokio::test]
async fn the_only_segmentation_of_a_series_needs_no_name() {
    let (server, pacs) = asking(vec![Reply::parts(&[image(), seg(1), image()])]).await;
    let answer = submit(&server, &source(None)).await;
    assert_eq!(answer.status, 202, "{}", answer.text());
    assert_eq!(answer.json()["mask"]["bytes"], seg(1).len());
    assert_eq!(pacs.asked()[0].address, format!("/dicom-web/studies/{STUDY}/series/{SERIES}"));
}

#[tokio::test]
async fn a_series_without_the_one_segmentation_is_refused() {
    let (told, _) =
        check_problem(Reply::parts(&[seg(1), seg(2), image(), seg(3)]), None, 422, "source_is_ambiguous").await;
    assert!(told.contains("3 segmentations"), "{told}");
    let (told, _) = check_problem(Reply::parts(&[image(), image()]), None, 422, "source_has_no_segmentation").await;
    assert!(told.contains("2 instances"), "{told}");
    check_problem(Reply::parts(&[]), None, 422, "source_not_found").await;
    // The reader says why it does not take one that is named.
    check_problem(Reply::parts(&[segmentation(IMAGE, INSTANCE)]), Some(INSTANCE), 422, "not_a_segmentation").await;
}

#[tokio::test]
async fn what_the_pacs_sends_in_place_of_an_instance_is_told_as_its_fault() {
    for (parts, instance, told) in [
        (vec![named(), named()], Some(INSTANCE), "2 parts for one instance"),
        (vec![seg(1)], Some(INSTANCE), "another instance"),
        (vec![Vec::new()], Some(INSTANCE), "a part is empty"),
        (vec![Vec::new()], None, "a part is empty"),
        (vec![format!("<html>{CANARY}</html>").into_bytes()], Some(INSTANCE), "a part is no mask"),
    ] {
        let (detail, asked) = check_problem(Reply::parts(&parts), instance, 502, "source_malformed").await;
        assert!(detail.contains(told), "{detail}");
        assert_eq!(asked, 1, "{told}");
    }
    // What was kept before the fault is not left.
    let broken = [related(&[named()]).strip_suffix(b"--X--\r\n").unwrap(), b"--X\r\nno field\r\n\r\n"].concat();
    check_problem(Reply::new(200, MULTIPART, broken), Some(INSTANCE), 502, "source_malformed").await;
}

#[tokio::test]
async fn what_the_pacs_says_no_to_is_told_with_its_status() {
    for (theirs, ours, code, tries) in [
        (404, 422, "source_not_found", 1),
        (401, 502, "source_refused", 1),
        (406, 502, "source_refused", 1),
        (500, 503, "source_unavailable", 4),
    ] {
        let reply = Reply::new(theirs, "text/html", format!("<h1>{CANARY}</h1>"));
        let (told, asked) = check_problem(reply, Some(INSTANCE), ours, code).await;
        assert!(told.contains(&theirs.to_string()), "{told}");
        assert_eq!(asked, tries, "{theirs}");
    }
}

#[tokio::test]
async fn a_redirect_is_not_followed() {
    let (told, asked) = check_problem(Reply::new(302, "text/html", ""), Some(INSTANCE), 502, "source_refused").await;
    assert!(told.contains("redirect"), "{told}");
    assert_eq!(asked, 1);
}

#[tokio::test]
async fn a_pacs_that_fails_for_a_moment_is_asked_again() {
    let mut broken = Reply::parts(&[named()]).in_chunks(500, Duration::ZERO);
    broken.chunks.truncate(2);
    broken.breaks = true;
    let replies = vec![Reply::new(503, "text/plain", CANARY), broken, Reply::parts(&[named()])];
    let (server, pacs) = asking(replies).await;
    let answer = submit(&server, &source(Some(INSTANCE))).await;
    assert_eq!(answer.status, 202, "{}", answer.text());
    assert_eq!(answer.json()["mask"]["bytes"], named().len());
    assert_eq!(pacs.asked().len(), 3);
}

#[tokio::test]
async fn a_pacs_that_falls_silent_in_the_middle_of_a_file_is_asked_again() {
    // Longer than what is looked at before the file is kept, and an upload may be silent for less than the PACS.
    let long = [named(), vec![0; 64 << 10]].concat();
    let mut silent = Reply::parts(&[long]).in_chunks(40 << 10, Duration::ZERO);
    silent.chunks[1].0 = IDLE * 4;
    let pacs = FakePacs::start(vec![silent, Reply::parts(&[named()])]).await;
    let mut limits = bounds();
    limits.upload.max_bytes = 1 << 20;
    assert!(limits.upload.idle < IDLE);
    let server = Server::with_pacs(limits, pacs.client(IDLE)).await;
    let answer = submit(&server, &source(Some(INSTANCE))).await;
    assert_eq!(answer.status, 202, "{}", answer.text());
    assert_eq!(pacs.asked().len(), 2);
}

#[tokio::test]
async fn an_answer_that_is_cut_off_is_never_a_mask() {
    let whole = related(&[mask()]);
    // All of the file is there, the boundary behind it is not.
    let body = whole[..whole.len() - 4].to_vec();
    let (_, asked) = check_problem(Reply::new(200, MULTIPART, body), Some(INSTANCE), 503, "source_unavailable").await;
    assert_eq!(asked, 4);
}

#[tokio::test]
async fn a_pacs_that_falls_silent_is_given_up() {
    let begun = Instant::now();
    let reply = Reply::parts(&[mask()]).in_chunks(200, IDLE * 4);
    check_problem(reply, Some(INSTANCE), 503, "source_unavailable").await;
    assert!(begun.elapsed() < Duration::from_secs(8), "{:?}", begun.elapsed());
}

#[tokio::test]
async fn answers_of_another_kind_are_told_apart() {
    for content_type in [
        "text/html",
        "application/dicom",
        "multipart/related; type=\"application/dicom\"",
        "multipart/related; type=\"application/dicom+json\"; boundary=X",
        "multipart/mixed; boundary=X",
    ] {
        let reply = Reply::new(200, content_type, related(&[mask()]));
        check_problem(reply, Some(INSTANCE), 502, "source_malformed").await;
    }
    let page = format!("<html>{CANARY}</html>").repeat(300);
    check_problem(Reply::new(200, MULTIPART, page), Some(INSTANCE), 502, "source_malformed").await;
}

#[tokio::test]
async fn an_answer_without_an_end_is_bounded() {
    let mut endless = Reply::new(200, MULTIPART, [b"--X\r\n\r\n", mask().as_slice()].concat());
    endless.chunks.push((Duration::ZERO, vec![0; 1 << 10].into()));
    endless.is_endless = true;
    let (told, asked) = check_problem(endless, Some(INSTANCE), 413, "source_too_large").await;
    assert!(told.contains("16384"), "{told}");
    assert_eq!(asked, 1);
    let mut parts = Reply::new(200, MULTIPART, "--X\r\n\r\n\r\n".repeat(100));
    parts.is_endless = true;
    check_problem(parts, None, 502, "source_malformed").await;
    let images = [related(&[image()]).strip_suffix(b"--X--\r\n").unwrap().to_vec()].concat();
    let mut series = Reply::new(200, MULTIPART, images);
    series.is_endless = true;
    check_problem(series, None, 413, "source_too_large").await;
}

#[tokio::test]
async fn a_series_of_too_many_instances_is_given_up() {
    let mut image = Seg::small().dicom();
    image.elements = vec![text(0x0008_0016, "UI", IMAGE)];
    let part = [b"--X\r\n\r\n", image.bytes().as_slice(), b"\r\n"].concat();
    let mut endless = Reply::new(200, MULTIPART, part.repeat(50));
    endless.is_endless = true;
    let pacs = FakePacs::start(vec![endless]).await;
    let mut limits = bounds();
    limits.upload.max_bytes = 64 << 20;
    limits.upload.total = Duration::from_secs(60);
    let server = Server::with_pacs(limits, pacs.client(IDLE)).await;
    let problem = submit(&server, &source(None)).await.is_problem(502, "source_malformed");
    assert!(problem.detail.contains("more than 10000 parts"), "{}", problem.detail);
}

#[tokio::test]
async fn a_source_is_checked_before_anybody_is_asked() {
    let (server, pacs) = asking(vec![Reply::parts(&[mask()])]).await;
    let with = |name: &str, value: Value| {
        let mut body = source(Some(INSTANCE));
        body["source"]["dicomweb"][name] = value;
        body
    };
    for name in ["study", "series", "instance"] {
        for bad in ["../../instances", "1.2/3", "", "1..2"] {
            let problem = submit(&server, &with(name, bad.into())).await.is_problem(422, "invalid_uid");
            assert_eq!(problem.location, Some(format!("source.dicomweb.{name}")));
        }
    }
    let problem = submit(&server, &with("server", "other".into())).await.is_problem(422, "unknown_pacs");
    assert!(problem.hint.unwrap().contains("main"));
    let mut body = source(None);
    body["params"] = json!({"grid": 3});
    submit(&server, &body).await.is_problem(422, "invalid_params");
    for body in
        [json!({}), json!({"source": {"url": "http://h"}}), with("instnace", CANARY.into()), with("study", 1.into())]
    {
        let answer = submit(&server, &body).await;
        answer.is_problem(400, "invalid_submission");
        assert!(!answer.text().contains(CANARY));
    }
    let twice = server.with(Method::POST, "/v1/jobs?params=%7B%7D", &JSON, {
        let mut body = source(None);
        body["params"] = json!({});
        body.to_string().into_bytes()
    });
    twice.await.is_problem(400, "invalid_multipart");
    assert!(pacs.asked().is_empty());
}

#[tokio::test]
async fn a_server_that_knows_no_pacs_says_so() {
    let server = Server::without_workers().await;
    let problem = submit(&server, &source(None)).await.is_problem(422, "unknown_pacs");
    assert!(problem.hint.unwrap().contains("--pacs"));
}

#[tokio::test]
async fn a_pacs_that_is_not_there_is_unavailable() {
    let mut pacs = FakePacs::start(Vec::new()).await;
    pacs.url = "http://127.0.0.1:1/dicom-web".to_owned();
    let server = Server::with_pacs(bounds(), pacs.client(IDLE)).await;
    let problem = submit(&server, &source(None)).await.is_problem(503, "source_unavailable");
    assert!(!problem.detail.contains("127.0.0.1"), "{}", problem.detail);
}
