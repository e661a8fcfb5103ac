//! Webhooks of jobs: asked for, sent once the job has ended, tried again, told of in the job.

use std::sync::{Arc, Mutex};
use std::time::Duration;

use axum::Router;
use axum::extract::State;
use axum::http::{HeaderMap, StatusCode};
use axum::routing::post;
use medialrep::jobs::limits::JobLimits;
use medialrep::jobs::store::QueueLimits;
use medialrep::webhook::{Secret, Sender, Targets, WebhookConfig};
use serde_json::Value;
use tempfile::TempDir;
use tokio::net::TcpListener;

use crate::help::support::{CANARY, Server, id_of, limits, mask, refuses, writes};

const SECRET: &str = "whsec_MfKQ9r8GKYqrTwjUPD8ILPZIo2LaLaSw";

/// What arrived, and how often to fail first.
#[derive(Clone, Default)]
struct Hook {
    arrived: Arc<Mutex<Vec<(HeaderMap, String)>>>,
    failures: Arc<Mutex<u32>>,
}

async fn take(State(hook): State<Hook>, headers: HeaderMap, body: String) -> StatusCode {
    let mut failures = hook.failures.lock().unwrap();
    if *failures > 0 {
        *failures -= 1;
        return StatusCode::INTERNAL_SERVER_ERROR;
    }
    hook.arrived.lock().unwrap().push((headers, body));
    StatusCode::NO_CONTENT
}

/// A receiver on this machine, and a service that may send to it.
async fn hooked(hook: &Hook) -> (Server, String) {
    let listener = TcpListener::bind("127.0.0.1:0").await.unwrap();
    let base = format!("http://{}/hooks/", listener.local_addr().unwrap());
    let router = Router::new().route("/hooks/{name}", post(take)).with_state(hook.clone());
    tokio::spawn(async move { axum::serve(listener, router).await });
    let targets = Targets::parse(&[&base], &["127.0.0.0/8"]).unwrap();
    let sender = Sender::new(WebhookConfig::new(targets, SECRET.parse().unwrap())).unwrap();
    let server = Server::open_with(TempDir::new().unwrap(), limits(), Some(sender)).await;
    (server, base)
}

async fn send(server: &Server, url: &str) -> String {
    let answer = server.post(&format!("/v1/jobs?callback_url={url}"), mask()).await;
    assert_eq!(answer.status, 202, "{}", answer.text());
    answer.header("location").to_owned()
}

#[tokio::test]
async fn the_end_of_a_job_is_told_signed_and_without_patient_data() {
    let hook = Hook::default();
    let (mut server, base) = hooked(&hook).await;
    let job = send(&server, &format!("{base}{CANARY}")).await;
    assert_eq!(server.get(&job).await.json()["callback"]["state"], "waiting");
    server.run(&writes());
    let told = server.job_when(&job, |now| now["callback"]["state"] == "delivered").await;
    let tries = told["callback"]["deliveries"].as_array().unwrap();
    assert_eq!((tries.len(), &tries[0]["status"], &tries[0]["error"]), (1, &204.into(), &Value::Null));
    let arrived = hook.arrived.lock().unwrap().clone();
    let [(headers, body)] = &arrived[..] else { panic!("{} arrived", arrived.len()) };
    let header = |name: &str| headers[name].to_str().unwrap();
    let secret: Secret = SECRET.parse().unwrap();
    let expected = secret.sign(header("webhook-id"), header("webhook-timestamp").parse().unwrap(), body.as_bytes());
    assert_eq!(header("webhook-signature"), expected);
    let body: Value = serde_json::from_str(body).unwrap();
    assert_eq!((&body["type"], &body["data"]["state"]), (&"job.ended".into(), &"succeeded".into()));
    assert_eq!(body["data"]["id"], id_of(&job));
    assert!(!body.to_string().contains(CANARY) && !crate::help::support::logged().contains(CANARY));
}

#[tokio::test]
async fn a_webhook_that_fails_is_tried_again_even_by_the_next_server() {
    let hook = Hook { failures: Arc::new(Mutex::new(1)), ..Hook::default() };
    let (mut server, base) = hooked(&hook).await;
    let job = send(&server, &format!("{base}a")).await;
    server.run(&refuses());
    let told = server.job_when(&job, |now| !now["callback"]["deliveries"].as_array().unwrap().is_empty()).await;
    assert_eq!(told["callback"]["state"], "due");
    assert_eq!(told["callback"]["deliveries"][0]["status"], 500);
    assert_eq!(told["callback"]["deliveries"][0]["error"], "refused_status");
    let targets = Targets::parse(&[&base], &["127.0.0.0/8"]).unwrap();
    let sender = Sender::new(WebhookConfig::new(targets, SECRET.parse().unwrap())).unwrap();
    let mut server = Server::open_with(server.stop().await, limits(), Some(sender)).await;
    server.run(&refuses());
    let told = server.job_when(&job, |now| now["callback"]["state"] == "delivered").await;
    assert_eq!(told["callback"]["deliveries"].as_array().unwrap().len(), 2);
    assert_eq!(hook.arrived.lock().unwrap().len(), 1);
}

#[tokio::test]
async fn receivers_that_hang_do_not_delay_another() {
    let hook = Hook::default();
    let good = TcpListener::bind("127.0.0.1:0").await.unwrap();
    // It takes connections and never answers.
    let hanging = TcpListener::bind("127.0.0.1:0").await.unwrap();
    let [good_url, hanging_url] =
        [&good, &hanging].map(|listener| format!("http://{}/hooks/", listener.local_addr().unwrap()));
    let router = Router::new().route("/hooks/{name}", post(take)).with_state(hook.clone());
    tokio::spawn(async move { axum::serve(good, router).await });
    let targets = Targets::parse(&[&good_url, &hanging_url], &["127.0.0.0/8"]).unwrap();
    let sender = Sender::new(WebhookConfig::new(targets, SECRET.parse().unwrap())).unwrap();
    let limits = JobLimits { queue: QueueLimits { jobs: 100, ..limits().queue }, ..limits() };
    let mut server = Server::open_with(TempDir::new().unwrap(), limits, Some(sender)).await;
    for n in 0..40 {
        send(&server, &format!("{hanging_url}{n}")).await;
    }
    let job = send(&server, &format!("{good_url}a")).await;
    server.run(&writes());
    // Far below the time that one try to a receiver that hangs takes.
    let told = server.job_when(&job, |now| now["callback"]["state"] == "delivered");
    tokio::time::timeout(Duration::from_secs(5), told).await.expect("told in time");
    drop(hanging);
}

#[tokio::test]
async fn only_listed_targets_are_taken() {
    let (server, base) = hooked(&Hook::default()).await;
    for url in ["http://evil.example/hooks/a", "file:///etc/passwd", "nonsense", &format!("{base}../x")] {
        let answer = server.post(&format!("/v1/jobs?callback_url={url}"), mask()).await;
        answer.is_problem(422, "callback_not_allowed");
    }
    let none = Server::without_workers().await;
    let answer = none.post(&format!("/v1/jobs?callback_url={base}a"), mask()).await;
    answer.is_problem(422, "callback_not_allowed");
    tokio::time::sleep(Duration::from_millis(1)).await;
    assert!(server.files().is_empty() && none.files().is_empty());
}
