//! Results that go to a PACS: which, when, how often, and what is told of it.

use std::time::Duration;

use axum::http::Method;
use jiff::{SignedDuration, Timestamp};
use medialrep::jobs::job::{JobId, SendTry};
use medialrep::jobs::store::SendNext;
use medialrep::jobs::token::{Scope, StoredToken, Token};
use medialrep::jobs::worker::Processor;
use serde_json::{Value, json};

use crate::help::dicom_bytes::{Seg, text};
use crate::help::pacs::{Asked, FakePacs, MULTIPART, Reply, related};
use crate::help::support::{CANARY, Server, content, limits, logged, mask, refuses, writes_these};

const DICOM: &str = "application/dicom";
const DICOM_JSON: &str = "application/dicom+json";
const STORED: &str = r#"{"00081199": {"vr": "SQ", "Value": [{}]}}"#;
/// The path that a job of two DICOM results is sent to.
const TWO: &str = "/v1/jobs?deliver_to=main&params=%7B%22outputs%22%3A%5B%22picture.dcm%22%2C%22report.sr.dcm%22%5D%7D";

fn segmentation() -> Vec<u8> {
    let mut dicom = Seg::small().dicom();
    dicom.set(text(0x0008_0016, "UI", "1.2.840.10008.5.1.4.1.1.66.4"));
    dicom.set(text(0x0008_0018, "UI", "1.2.3"));
    dicom.set(text(0x0010_0010, "PN", CANARY));
    dicom.set(text(0x0020_000d, "UI", "1.2.840.99.7"));
    dicom.bytes()
}

fn writes_dicom() -> Processor {
    writes_these(&[
        ("model.glb", "model/gltf-binary"),
        ("picture.dcm", DICOM),
        ("report.pdf.dcm", DICOM),
        ("surfaces.stl.dcm", DICOM),
        ("report.sr.dcm", DICOM),
    ])
}

fn stored() -> Reply {
    Reply::new(200, DICOM_JSON, STORED)
}

/// An answer that says of the instance why it was not stored.
fn failed(status: u16, reason: u16) -> Reply {
    let body = json!({"00081198": {"vr": "SQ", "Value": [{"00081197": {"vr": "US", "Value": [reason]}}]}});
    Reply::new(status, DICOM_JSON, body.to_string())
}

async fn with_pacs(replies: Vec<Reply>) -> (Server, FakePacs) {
    let pacs = FakePacs::start(replies).await;
    let server = Server::with_pacs(limits(), pacs.client(Duration::from_secs(2))).await;
    (server, pacs)
}

/// The job that the segmentation becomes when it is sent to this path.
async fn submitted(server: &Server, path: &str) -> String {
    let answer = server.post(path, segmentation()).await;
    assert_eq!(answer.status, 202, "{}", answer.text());
    assert_eq!(answer.json()["delivery"]["state"], "waiting");
    answer.header("location").to_owned()
}

/// The delivery of a job once so many tries were made.
async fn after_tries(server: &Server, job: &str, tries: u64) -> Value {
    server.job_when(job, |now| now["delivery"]["tries"] == tries).await["delivery"].clone()
}

/// Does not wait for the next try.
async fn make_due(server: &Server, job: &str) {
    hold(server, job, Timestamp::UNIX_EPOCH).await;
}

/// As if it were given to somebody until this time.
async fn hold(server: &Server, job: &str, until: Timestamp) {
    let id = JobId::parse(job.rsplit('/').next().unwrap()).unwrap();
    let now = server.jobs.store().get(id).await.unwrap().unwrap().delivery.unwrap();
    assert!(server.jobs.store().extend_delivery(id, now.next_try_at.unwrap(), until).await.unwrap());
}

/// Whether this is the request that stores one result.
fn stores(asked: &Asked, name: &str) -> bool {
    let body = String::from_utf8_lossy(&asked.body);
    let content = String::from_utf8(content(name)).unwrap();
    let (head, rest) = body.split_once("\r\n\r\n").unwrap();
    let boundary = head.lines().next().unwrap();
    head == format!("{boundary}\r\nContent-Type: application/dicom")
        && rest == format!("{content}\r\n{boundary}--\r\n")
        && asked.headers["content-type"].to_str().unwrap()
            == format!("multipart/related; type=\"application/dicom\"; boundary={}", &boundary[2..])
}

#[tokio::test]
async fn results_are_stored_in_the_pacs_once_the_job_has_succeeded() {
    let (mut server, pacs) = with_pacs(vec![stored()]).await;
    let job = submitted(&server, TWO).await;
    server.run(&writes_dicom());
    let delivery = after_tries(&server, &job, 1).await;
    assert_eq!((&delivery["to"], &delivery["state"]), (&json!("main"), &json!("delivered")));
    assert_eq!(delivery["stored"], json!(["picture.dcm", "report.sr.dcm"]));
    assert_eq!((&delivery["last_try"]["status"], &delivery["last_try"]["error"]), (&json!(200), &Value::Null));
    assert_eq!(delivery["next_try_at"], Value::Null);
    let asked = pacs.asked();
    assert_eq!(asked.len(), 2);
    for (request, name) in asked.iter().zip(["picture.dcm", "report.sr.dcm"]) {
        assert!(stores(request, name), "{request:?}");
        assert_eq!(request.address, "/dicom-web/studies");
        assert_eq!(request.headers["accept"], DICOM_JSON);
        assert_eq!(request.headers["content-length"], request.body.len().to_string());
        assert!(request.headers["authorization"].to_str().unwrap().starts_with("Basic "));
    }
    let metrics = server.get("/metrics").await.text();
    assert!(metrics.contains("medialrep_deliveries_total{outcome=\"delivered\"} 1"), "{metrics}");
    assert!(!metrics.contains(CANARY) && !logged().contains(CANARY));
}

#[tokio::test]
async fn all_dicom_results_are_delivered_where_none_is_named() {
    let (mut server, pacs) = with_pacs(vec![stored()]).await;
    let job = submitted(&server, "/v1/jobs?deliver_to=main").await;
    server.run(&writes_dicom());
    let delivery = after_tries(&server, &job, 1).await;
    let all = ["picture.dcm", "report.pdf.dcm", "surfaces.stl.dcm", "report.sr.dcm"];
    assert_eq!((&delivery["stored"], pacs.asked().len()), (&json!(all), 4));
}

#[tokio::test]
async fn what_was_not_stored_is_tried_again_and_what_was_is_not() {
    let (mut server, pacs) = with_pacs(vec![stored(), Reply::new(503, "text/plain", CANARY), stored()]).await;
    let job = submitted(&server, TWO).await;
    server.run(&writes_dicom());
    let delivery = after_tries(&server, &job, 1).await;
    assert_eq!((&delivery["state"], &delivery["stored"]), (&json!("due"), &json!(["picture.dcm"])));
    assert_eq!(delivery["last_try"]["status"], 503);
    assert_eq!(delivery["last_try"]["error"], "refused_status");
    assert!(delivery["next_try_at"].is_string());
    assert!(!delivery.to_string().contains(CANARY) && !logged().contains(CANARY));
    make_due(&server, &job).await;
    let delivery = after_tries(&server, &job, 2).await;
    assert_eq!(delivery["state"], "delivered");
    let asked = pacs.asked();
    assert_eq!(asked.len(), 3);
    assert!(stores(&asked[2], "report.sr.dcm"));
}

#[tokio::test]
async fn what_the_pacs_never_takes_does_not_keep_the_others_back() {
    let (mut server, pacs) = with_pacs(vec![failed(409, 0x0122), stored()]).await;
    let job = submitted(&server, TWO).await;
    server.run(&writes_dicom());
    let delivery = after_tries(&server, &job, 1).await;
    assert_eq!((&delivery["state"], &delivery["stored"]), (&json!("given_up"), &json!(["report.sr.dcm"])));
    assert_eq!(delivery["last_try"]["error"], "class_not_supported");
    assert_eq!(pacs.asked().len(), 2);
    // Until somebody has seen to it that it does.
    let retry = server.get(&job).await.json()["links"]["retry"].as_str().unwrap().to_owned();
    assert_eq!(server.post(&retry, Vec::new()).await.status, 202);
    let now = server.job_when(&job, |now| now["delivery"]["state"] == "delivered").await;
    assert_eq!(now["delivery"]["stored"], json!(["report.sr.dcm", "picture.dcm"]));
    assert_eq!((&now["links"]["retry"], pacs.asked().len()), (&Value::Null, 3));
    server.post(&retry, Vec::new()).await.is_problem(409, "not_retryable");
}

#[tokio::test]
async fn an_instance_that_the_pacs_has_already_is_delivered() {
    let (mut server, _pacs) = with_pacs(vec![failed(409, 0x0111)]).await;
    let job = submitted(&server, TWO).await;
    server.run(&writes_dicom());
    assert_eq!(after_tries(&server, &job, 1).await["state"], "delivered");
}

#[tokio::test]
async fn what_a_pacs_missed_that_was_away_is_delivered_by_the_next_server() {
    let pacs = FakePacs::start(vec![stored()]).await;
    let client = pacs.client_of("http://127.0.0.1:9/dicom-web", Duration::from_secs(2));
    let mut server = Server::with_pacs(limits(), client).await;
    let job = submitted(&server, TWO).await;
    server.run(&writes_dicom());
    let delivery = after_tries(&server, &job, 1).await;
    assert_eq!(
        delivery["last_try"],
        json!({"at": delivery["last_try"]["at"], "status": null, "error": "connect_failed"})
    );
    // The job itself has ended well.
    assert_eq!(server.get(&job).await.json()["state"], "succeeded");
    let dir = server.stop().await;
    let mut server = Server::open_with_pacs(dir, limits(), pacs.client(Duration::from_secs(2))).await;
    make_due(&server, &job).await;
    server.run(&writes_dicom());
    let delivery = after_tries(&server, &job, 2).await;
    assert_eq!(delivery["state"], "delivered", "the next server goes on");
}

#[tokio::test]
async fn a_delivery_of_a_server_that_is_gone_is_taken_up_at_once() {
    let (mut server, pacs) = with_pacs(vec![Reply::new(503, "text/plain", ""), stored()]).await;
    let job = submitted(&server, TWO).await;
    server.run(&writes_dicom());
    after_tries(&server, &job, 1).await;
    // As if the server had been killed while it sent.
    hold(&server, &job, Timestamp::now() + SignedDuration::from_hours(1)).await;
    let dir = server.stop().await;
    let mut server = Server::open_with_pacs(dir, limits(), pacs.client(Duration::from_secs(2))).await;
    server.run(&writes_dicom());
    assert_eq!(after_tries(&server, &job, 2).await["state"], "delivered");
}

#[tokio::test]
async fn results_that_were_erased_are_given_up() {
    let (mut server, pacs) = with_pacs(vec![Reply::new(500, "text/plain", ""), stored()]).await;
    let job = submitted(&server, TWO).await;
    server.run(&writes_dicom());
    after_tries(&server, &job, 1).await;
    let id = JobId::parse(job.rsplit('/').next().unwrap()).unwrap();
    server.jobs.store().forget_results(id).await.unwrap();
    let delivery = server.get(&job).await.json()["delivery"].clone();
    assert_eq!((&delivery["state"], &delivery["next_try_at"]), (&json!("given_up"), &Value::Null));
    let retry = server.post(&format!("{job}/retry"), Vec::new()).await;
    retry.is_problem(409, "not_retryable");
    assert_eq!(pacs.asked().len(), 2, "both results in the first try");
}

#[tokio::test]
async fn a_try_of_who_lost_the_delivery_changes_nothing() {
    let (mut server, _pacs) = with_pacs(vec![Reply::new(503, "text/plain", "")]).await;
    let job = submitted(&server, TWO).await;
    server.run(&writes_dicom());
    after_tries(&server, &job, 1).await;
    let id = JobId::parse(job.rsplit('/').next().unwrap()).unwrap();
    let before = server.get(&job).await.json()["delivery"].clone();
    let (store, other) = (server.jobs.store(), Timestamp::now());
    assert!(!store.extend_delivery(id, other, other).await.unwrap());
    let tried = SendTry { at: other, status: None, error: None };
    store.delivery_tried(id, other, &tried, SendNext::Delivered).await.unwrap();
    assert_eq!(server.get(&job).await.json()["delivery"], before);
}

#[tokio::test]
async fn a_job_without_results_delivers_nothing() {
    let (mut server, pacs) = with_pacs(vec![stored()]).await;
    let job = submitted(&server, TWO).await;
    server.run(&refuses());
    let job = server.job_in(&job, "failed").await;
    assert_eq!((&job["delivery"]["state"], &job["delivery"]["tries"]), (&json!("waiting"), &json!(0)));
    assert!(pacs.asked().is_empty());
}

#[tokio::test]
async fn results_of_an_equal_request_are_delivered_too() {
    let (mut server, pacs) = with_pacs(vec![stored()]).await;
    server.run(&writes_dicom());
    let job = submitted(&server, TWO).await;
    after_tries(&server, &job, 1).await;
    let again = server.post(TWO, segmentation()).await;
    assert_eq!(again.json()["reused"], true, "{}", again.text());
    let delivery = after_tries(&server, again.header("location"), 1).await;
    assert_eq!(delivery["state"], "delivered");
    let bodies: Vec<bool> = pacs.asked().iter().map(|asked| stores(asked, "picture.dcm")).collect();
    assert_eq!(bodies, [true, false, true, false]);
}

#[tokio::test]
async fn it_is_checked_at_once_whether_anything_can_be_delivered() {
    let (server, _pacs) = with_pacs(vec![stored()]).await;
    let answer = server.post("/v1/jobs?deliver_to=nobody", segmentation()).await;
    let problem = answer.is_problem(422, "unknown_pacs");
    assert_eq!((problem.location.as_deref(), problem.hint.as_deref()), (Some("deliver_to"), Some("there are main")));
    let answer = server.post("/v1/jobs?deliver_to=main", mask()).await;
    assert_eq!(answer.is_problem(422, "nothing_to_deliver").location.as_deref(), Some("deliver_to"));
    let none = Server::without_workers().await;
    none.post("/v1/jobs?deliver_to=main", segmentation()).await.is_problem(422, "unknown_pacs");
    assert!(server.files().is_empty() && none.files().is_empty());
    let answer = server.post("/v1/jobs?deliver_to=main&deliver_to=main", segmentation()).await;
    assert_eq!(answer.status, 400, "{}", answer.text());
}

#[tokio::test]
async fn a_key_that_is_used_again_for_another_archive_is_another_request() {
    let (server, _pacs) = with_pacs(vec![stored()]).await;
    let key = [("idempotency-key", "k")];
    let send = |path| server.with(Method::POST, path, &key, segmentation());
    assert_eq!(send("/v1/jobs?deliver_to=main").await.status, 202);
    assert_eq!(send("/v1/jobs?deliver_to=main").await.header("idempotent-replayed"), "true");
    send("/v1/jobs").await.is_problem(422, "idempotency_key_reused");
}

#[tokio::test]
async fn what_a_pacs_stores_is_delivered_as_the_request_or_its_token_says() {
    let (server, _pacs) = with_pacs(vec![stored()]).await;
    let token = |tenant: &str, deliver_to: Option<&str>| {
        let token = Token::new().unwrap();
        let stored = token.stored(tenant.to_owned(), vec![Scope::Read, Scope::Write], None);
        (format!("Bearer {}", token.reveal()), StoredToken { deliver_to: deliver_to.map(str::to_owned), ..stored })
    };
    for (tenant, deliver_to, path, expected) in [
        ("a", Some("main"), "/dicom-web/studies", json!("main")),
        ("b", None, "/dicom-web/studies", Value::Null),
        ("c", None, "/dicom-web/studies?deliver_to=main", json!("main")),
    ] {
        let (bearer, stored) = token(tenant, deliver_to);
        server.jobs.store().insert_token(&stored).await.unwrap();
        let headers = [("authorization", &*bearer), ("content-type", MULTIPART)];
        let answer = server.with(Method::POST, path, &headers, related(&[segmentation()])).await;
        assert_eq!(answer.status, 200, "{}", answer.text());
        let jobs = server.with(Method::GET, "/v1/jobs", &headers[..1], Vec::new()).await.json();
        assert_eq!(jobs["jobs"][0]["delivery"]["to"], expected);
    }
    let (bearer, stored) = token("d", Some("gone"));
    server.jobs.store().insert_token(&stored).await.unwrap();
    let headers = [("authorization", &*bearer), ("content-type", MULTIPART)];
    let answer = server.with(Method::POST, "/dicom-web/studies", &headers, related(&[segmentation()])).await;
    assert_eq!(answer.is_problem(422, "unknown_pacs").location.as_deref(), Some("the token"));
}

#[tokio::test]
async fn a_form_and_json_name_the_archive_too() {
    let (server, _pacs) = with_pacs(vec![Reply::parts(&[segmentation()])]).await;
    let part = |name: &str, body: &[u8]| {
        let head = format!("--X\r\nContent-Disposition: form-data; name=\"{name}\"; filename=\"f\"\r\n\r\n");
        [head.as_bytes(), body, b"\r\n"].concat()
    };
    let form = [part("deliver_to", b"main"), part("mask", &segmentation()), b"--X--\r\n".to_vec()].concat();
    let kind = [("content-type", "multipart/form-data; boundary=X")];
    let answer = server.with(Method::POST, "/v1/jobs", &kind, form).await;
    assert_eq!(answer.json()["delivery"]["to"], "main", "{}", answer.text());
    let source = json!({"dicomweb": {"server": "main", "study": "1.2", "series": "1.2.3"}});
    let body = json!({"source": source, "deliver_to": "main"}).to_string();
    let kind = [("content-type", "application/json")];
    let answer = server.with(Method::POST, "/v1/jobs", &kind, body.into_bytes()).await;
    assert_eq!(answer.json()["delivery"]["to"], "main", "{}", answer.text());
}
