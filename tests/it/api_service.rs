//! What makes a service of the queue: waiting, events, sending again, reuse, retention, health.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::time::{Duration, Instant};

use axum::http::Method;
use futures_util::StreamExt;
use medialrep::jobs::job::JobId;
use medialrep::jobs::worker::Processor;
use tempfile::TempDir;

use crate::help::support::{Server, content, id_of, limits, mask, refuses, waits, writes};

/// A form of text fields beside the mask.
fn labels(text: &str) -> String {
    format!("/v1/jobs?labels={}", text.replace('"', "%22").replace('{', "%7B").replace('}', "%7D"))
}

#[tokio::test]
async fn a_thousand_posts_with_one_key_are_one_job() {
    let server = Arc::new(Server::without_workers().await);
    let posts = (0..1000).map(|_| {
        let server = Arc::clone(&server);
        async move { server.with(Method::POST, "/v1/jobs", &[("idempotency-key", "one")], mask()).await }
    });
    let answers: Vec<_> = futures_util::stream::iter(posts).buffer_unordered(1000).collect().await;
    let first = answers[0].json()["id"].clone();
    assert!(answers.iter().all(|answer| answer.status == 202 && answer.json()["id"] == first));
    let replayed = answers.iter().filter(|answer| answer.headers.contains_key("idempotent-replayed")).count();
    assert_eq!((replayed, server.files().len()), (999, 1));
    assert_eq!(server.get("/v1/jobs").await.json()["jobs"].as_array().unwrap().len(), 1);
    let path = "/v1/jobs?params=%7B%22margin%22:0.1%7D";
    let other = server.with(Method::POST, path, &[("idempotency-key", "one")], mask()).await;
    other.is_problem(422, "idempotency_key_reused");
    let long = "k".repeat(256);
    let bad = server.with(Method::POST, "/v1/jobs", &[("idempotency-key", &long)], mask()).await;
    bad.is_problem(400, "invalid_idempotency_key");
}

#[tokio::test]
async fn equal_work_is_answered_from_what_is_there() {
    let runs = Arc::new(AtomicUsize::new(0));
    let (count, then) = (Arc::clone(&runs), writes());
    let processor: Processor = Arc::new(move |mask, params, limits, out, observer| {
        count.fetch_add(1, Ordering::Relaxed);
        then(mask, params, limits, out, observer)
    });
    let server = Server::start(processor).await;
    let first = server.submit().await;
    server.job_in(&first, "succeeded").await;
    // The same in other words: a default written out.
    let again = server.post("/v1/jobs?params=%7B%22margin%22:0%7D", mask()).await.json();
    assert_eq!((&again["state"], &again["reused"], &again["attempt"]), (&"succeeded".into(), &true.into(), &0.into()));
    let again = again["links"]["self"].as_str().unwrap().to_owned();
    assert_ne!(again, first);
    // Each has its own files.
    assert_eq!(server.call(Method::DELETE, &first).await.status, 204);
    assert_eq!(server.get(&format!("{again}/results/model.glb")).await.body, content("model.glb"));
    let other = server.post("/v1/jobs?params=%7B%22margin%22:0.1%7D", mask()).await.json();
    assert_eq!(other["reused"], false);
    let anew = server.with(Method::POST, "/v1/jobs", &[("cache-control", "no-cache")], mask()).await.json();
    assert_eq!(anew["reused"], false);
    server.job_in(anew["links"]["self"].as_str().unwrap(), "succeeded").await;
    server.job_in(other["links"]["self"].as_str().unwrap(), "succeeded").await;
    assert_eq!(runs.load(Ordering::Relaxed), 3);
}

#[tokio::test]
async fn a_client_can_wait_for_the_end() {
    let gate = Arc::new(AtomicBool::new(false));
    let server = Arc::new(Server::start(waits(&gate)).await);
    let begun = Instant::now();
    let early = server.with(Method::POST, "/v1/jobs", &[("prefer", "wait=1")], mask()).await;
    assert!(begun.elapsed() >= Duration::from_secs(1));
    assert_eq!((early.status.as_u16(), early.header("preference-applied")), (202, "wait=1"));
    let job = early.header("location").to_owned();
    let waiting = tokio::spawn({
        let (server, path) = (Arc::clone(&server), format!("{job}?wait=30"));
        async move { server.get(&path).await }
    });
    tokio::time::sleep(Duration::from_millis(100)).await;
    gate.store(true, Ordering::Relaxed);
    let opened = Instant::now();
    assert_eq!(waiting.await.unwrap().json()["state"], "succeeded");
    assert!(opened.elapsed() < Duration::from_secs(1), "{:?}", opened.elapsed());
    let done = server.with(Method::POST, "/v1/jobs", &[("prefer", "wait=9"), ("cache-control", "no-cache")], mask());
    let done = done.await;
    assert_eq!((done.status.as_u16(), &done.json()["state"]), (200, &"succeeded".into()));
    for wait in ["51", "-1", "soon"] {
        server.get(&format!("{job}?wait={wait}")).await.is_problem(400, "invalid_query");
    }
}

#[tokio::test]
async fn a_status_that_has_not_changed_is_not_sent_again() {
    let server = Server::start(writes()).await;
    let job = server.submit().await;
    server.job_in(&job, "succeeded").await;
    let etag = server.get(&job).await.header("etag").to_owned();
    let same = server.with(Method::GET, &job, &[("if-none-match", &etag)], vec![]).await;
    assert_eq!((same.status.as_u16(), same.body.len()), (304, 0));
    let other = server.with(Method::GET, &job, &[("if-none-match", "\"x\"")], vec![]).await;
    assert_eq!(other.status, 200);
}

/// Names and ids of the events in a stream that has ended.
fn told(text: &str) -> Vec<String> {
    let field = |event: &str, name: &str| {
        event.lines().find_map(|line| line.strip_prefix(name)).unwrap_or_default().trim().to_owned()
    };
    let events = text.split("\n\n").filter(|event| !event.trim().is_empty() && !event.starts_with(':'));
    events
        .map(|event| format!("{} {} {}", field(event, "event:"), field(event, "id:"), field(event, "data:")))
        .collect()
}

#[tokio::test]
async fn events_tell_every_state_and_what_was_missed() {
    let gate = Arc::new(AtomicBool::new(false));
    let server = Arc::new(Server::start(waits(&gate)).await);
    let job = server.submit().await;
    let following = tokio::spawn({
        let (server, path) = (Arc::clone(&server), format!("{job}/events"));
        async move { server.get(&path).await }
    });
    server.job_when(&job, |now| now["progress"]["stage"] == "isomap").await;
    tokio::time::sleep(Duration::from_millis(300)).await;
    gate.store(true, Ordering::Relaxed);
    let answer = following.await.unwrap();
    assert_eq!(answer.header("content-type"), "text/event-stream");
    assert_eq!(answer.header("x-accel-buffering"), "no");
    let events = told(&answer.text());
    let states: Vec<_> = events.iter().filter(|event| event.starts_with("state")).collect();
    for (number, (event, state)) in states.iter().zip(["queued", "running", "succeeded"]).enumerate() {
        assert!(event.starts_with(&format!("state {} ", number + 1)) && event.contains(state), "{event}");
    }
    assert_eq!(states.len(), 3);
    assert!(events.iter().any(|event| event.starts_with("progress ") && event.contains("isomap")), "{events:?}");
    // Who comes back hears the rest, and who has all is told to stay away.
    let back = server.with(Method::GET, &format!("{job}/events"), &[("last-event-id", "2")], vec![]).await;
    let rest = told(&back.text());
    assert!(rest.len() == 1 && rest[0].starts_with("state 3 "), "{rest:?}");
    let all = server.with(Method::GET, &format!("{job}/events"), &[("last-event-id", "3")], vec![]).await;
    assert_eq!(all.status, 204);
}

#[tokio::test]
async fn events_end_with_their_job_or_the_server() {
    let server = Arc::new(Server::without_workers().await);
    let (gone, left) = (server.submit().await, server.submit().await);
    let follow = |job: &str| {
        let (server, path) = (Arc::clone(&server), format!("{job}/events"));
        tokio::spawn(async move { server.get(&path).await.text() })
    };
    let (of_gone, of_left) = (follow(&gone), follow(&left));
    tokio::time::sleep(Duration::from_millis(50)).await;
    server.call(Method::DELETE, &gone).await;
    assert!(of_gone.await.unwrap().contains("event: gone"));
    server.jobs.closing().cancel();
    assert!(of_left.await.unwrap().contains("queued"));
    assert!(server.get("/readyz").await.text().contains("the server is stopping"));
}

#[tokio::test]
async fn a_failed_job_runs_again_when_its_mask_is_there() {
    let is_broken = Arc::new(AtomicBool::new(true));
    let (broken, then) = (Arc::clone(&is_broken), writes());
    let processor: Processor = Arc::new(move |mask, params, limits, out, observer| {
        assert!(!broken.load(Ordering::Relaxed), "fails for now");
        then(mask, params, limits, out, observer)
    });
    let server = Server::start(processor).await;
    let job = server.submit().await;
    let failed = server.job_in(&job, "failed").await;
    assert_eq!(failed["links"]["retry"], format!("{job}/retry"));
    is_broken.store(false, Ordering::Relaxed);
    let answer = server.call(Method::POST, &format!("{job}/retry")).await;
    assert_eq!((answer.status.as_u16(), &answer.json()["attempt"]), (202, &0.into()));
    server.job_in(&job, "succeeded").await;
    server.call(Method::POST, &format!("{job}/retry")).await.is_problem(409, "not_retryable");
    let server = Server::start(refuses()).await;
    let refused = server.submit().await;
    server.job_when(&refused, |now| now["mask_erased"] == true).await;
    server.call(Method::POST, &format!("{refused}/retry")).await.is_problem(409, "mask_erased");
}

#[tokio::test]
async fn jobs_are_found_by_label() {
    let server = Server::without_workers().await;
    let one = server.post(&labels(r#"{"study":"liver:07","side":"L"}"#), mask()).await.json();
    assert_eq!(one["labels"], serde_json::json!({"side": "L", "study": "liver:07"}));
    server.submit().await;
    for (label, count) in [("study:liver:07", 1), ("side:L", 1), ("side:R", 0), ("none:x", 0)] {
        let list = server.get(&format!("/v1/jobs?label={label}")).await.json();
        assert_eq!(list["jobs"].as_array().unwrap().len(), count, "{label}");
    }
    server.get("/v1/jobs?label=study").await.is_problem(400, "invalid_query");
    let many: Vec<_> = (0..17).map(|n| format!("\"l{n}\":\"x\"")).collect();
    for bad in ["[]", r#"{"a":1}"#, r#"{"a b":"x"}"#, r#"{"":"x"}"#, "{", &format!("{{{}}}", many.join(","))] {
        server.post(&labels(&bad.replace(' ', "%20")), mask()).await.is_problem(422, "invalid_labels");
    }
}

#[tokio::test]
async fn a_damaged_result_is_never_served() {
    let server = Server::start(writes()).await;
    let job = server.submit().await;
    server.job_in(&job, "succeeded").await;
    let path = format!("{job}/results/model.glb");
    assert_eq!(server.get(&path).await.status, 200);
    let file = server.files().into_iter().find(|file| file.ends_with("model.glb")).unwrap();
    let mut bytes = std::fs::read(&file).unwrap();
    bytes[3] ^= 1;
    std::fs::write(&file, bytes).unwrap();
    server.get(&path).await.is_problem(500, "result_damaged");
    server.with(Method::GET, &path, &[("range", "bytes=5-6")], vec![]).await.is_problem(500, "result_damaged");
    assert!(server.get("/metrics").await.text().contains("medialrep_damaged_files_total 2"));
    assert_eq!(server.get(&format!("{job}/results/thickness.json")).await.status, 200);
}

#[tokio::test]
async fn a_damaged_or_lost_result_is_not_used_again_and_is_told() {
    let server = Server::start(writes()).await;
    let job = server.submit().await;
    server.job_in(&job, "succeeded").await;
    let results = server.dir.path().join("results").join(id_of(&job));
    let attempt = results.read_dir().unwrap().next().unwrap().unwrap().path();
    std::fs::remove_file(attempt.join("model.glb")).unwrap();
    server.get(&format!("{job}/results/model.glb")).await.is_problem(500, "result_damaged");
    let again = server.post("/v1/jobs", mask()).await.json();
    assert_eq!(again["reused"], false, "one of its files is lost");
    let again = again["links"]["self"].as_str().unwrap().to_owned();
    server.job_in(&again, "succeeded").await;
    assert_eq!(server.get(&format!("{again}/results/model.glb")).await.body, content("model.glb"));
    assert_eq!(server.call(Method::DELETE, &job).await.status, 204);
    let attempt = server.dir.path().join("results").join(id_of(&again)).read_dir().unwrap().next().unwrap().unwrap();
    let file = attempt.path().join("thickness.json");
    let mut bytes = std::fs::read(&file).unwrap();
    bytes[3] ^= 1;
    std::fs::remove_file(&file).unwrap();
    std::fs::write(&file, bytes).unwrap();
    let third = server.post("/v1/jobs", mask()).await.json();
    assert_eq!(third["reused"], false, "a bit of one of its files is flipped");
}

#[tokio::test]
async fn a_damaged_mask_is_never_worked_on() {
    let mut server = Server::without_workers().await;
    let job = server.submit().await;
    let mut bytes = mask();
    bytes[360] ^= 1;
    std::fs::write(server.mask_of(&job), bytes).unwrap();
    server.run(&writes());
    assert_eq!(server.job_in(&job, "failed").await["error"]["code"], "mask_damaged");
}

#[tokio::test]
async fn masks_results_and_jobs_go_when_their_time_is_over() {
    let mut limits = limits();
    limits.keep.masks = Some(Duration::ZERO);
    let server = {
        let mut server = Server::open_with(TempDir::new().unwrap(), limits, None).await;
        server.run(&writes());
        server
    };
    let job = server.submit().await;
    server.job_when(&job, |now| now["state"] == "succeeded" && now["mask_erased"] == true).await;
    for _ in 0..500 {
        if !server.mask_of(&job).exists() {
            break;
        }
        tokio::time::sleep(Duration::from_millis(2)).await;
    }
    assert!(!server.mask_of(&job).exists());
    // The next server keeps less: what is due goes soon after the start.
    limits.keep.results = Some(Duration::ZERO);
    let mut server = Server::open_with(server.stop().await, limits, None).await;
    server.run(&writes());
    let now = server.job_when(&job, |now| now["results_erased"] == true).await;
    assert_eq!(now["results"].as_array().unwrap().len(), 2);
    server.get(&format!("{job}/results/model.glb")).await.is_problem(410, "results_erased");
    server.get(&format!("{job}/result")).await.is_problem(410, "results_erased");
    limits.keep.jobs = Some(Duration::ZERO);
    let mut server = Server::open_with(server.stop().await, limits, None).await;
    server.run(&writes());
    let begun = Instant::now();
    while server.get(&job).await.status == 200 {
        assert!(begun.elapsed() < Duration::from_secs(8));
        tokio::time::sleep(Duration::from_millis(20)).await;
    }
    assert!(server.files().is_empty());
    let audit = std::fs::read_to_string(server.dir.path().join("audit/audit.jsonl")).unwrap();
    for what in ["results", "jobs"] {
        assert!(audit.contains(&format!("\"expire\",\"job\":\"{}\",\"outcome\":\"{what}\"", id_of(&job))), "{audit}");
    }
}

#[tokio::test]
async fn a_nearly_full_disk_takes_no_masks_and_says_so() {
    let mut limits = limits();
    limits.min_free_bytes = 1 << 60;
    let server = Server::open_with(TempDir::new().unwrap(), limits, None).await;
    server.post("/v1/jobs", mask()).await.is_problem(507, "storage_low");
    assert!(server.files().is_empty());
    assert_eq!(server.get("/v1/jobs").await.status, 200);
}

#[tokio::test]
async fn a_run_that_takes_too_long_is_stopped() {
    let mut limits = limits();
    limits.max_run = Duration::from_millis(100);
    let mut server = Server::open_with(TempDir::new().unwrap(), limits, None).await;
    server.run(&waits(&Arc::new(AtomicBool::new(false))));
    let job = server.submit().await;
    assert_eq!(server.job_in(&job, "failed").await["error"]["code"], "run_too_long");
}

#[tokio::test]
async fn the_result_wanted_most_is_pointed_to() {
    let server = Server::start(writes()).await;
    let job = server.submit().await;
    server.job_in(&job, "succeeded").await;
    for (accept, name) in [("model/gltf-binary", "model.glb"), ("*/*", "thickness.json")] {
        let answer = server.with(Method::GET, &format!("{job}/result"), &[("accept", accept)], vec![]).await;
        assert_eq!((answer.status.as_u16(), answer.header("location")), (303, &*format!("{job}/results/{name}")));
    }
    let answer = server.with(Method::GET, &format!("{job}/result"), &[("accept", "image/png")], vec![]).await;
    answer.is_problem(406, "not_acceptable");
}

#[tokio::test]
async fn a_trace_leads_from_the_request_to_the_job() {
    let server = Server::start(writes()).await;
    let trace = "0af7651916cd43dd8448eb211c80319c";
    let parent = format!("00-{trace}-b7ad6b7169203331-01");
    let job = server.with(Method::POST, "/v1/jobs", &[("traceparent", &parent)], mask()).await.json();
    assert_eq!(job["trace_id"], trace);
    server.job_in(job["links"]["self"].as_str().unwrap(), "succeeded").await;
    let log = crate::help::support::logged();
    for what in ["job accepted", "job begun", "job ended"] {
        assert!(log.lines().any(|line| line.contains(trace) && line.contains(what)), "{what}");
    }
    let problem = server.with(Method::GET, "/nowhere", &[("traceparent", &parent)], vec![]).await;
    assert_eq!(problem.is_problem(404, "no_such_route").trace_id.as_deref(), Some(trace));
}

#[tokio::test]
async fn metrics_tell_what_operators_alarm_on() {
    let mut server = Server::without_workers().await;
    let job = server.submit().await;
    let text = server.get("/metrics").await.text();
    for line in ["medialrep_jobs_queued 1", "medialrep_workers 0"] {
        assert!(text.lines().any(|other| other == line), "{line}\n{text}");
    }
    server.run(&writes());
    server.job_in(&job, "succeeded").await;
    let failed = server.post("/v1/jobs", vec![1; 400]).await;
    failed.is_problem(415, "not_nifti");
    // The row is written first, and counted right after.
    tokio::time::sleep(Duration::from_millis(100)).await;
    let text = server.get("/metrics").await.text();
    for line in [
        "medialrep_jobs_ended_total{state=\"succeeded\",code=\"\"} 1",
        "medialrep_jobs_accepted_total{outcome=\"queued\"} 1",
        "medialrep_stage_seconds_count{stage=\"isomap\"} 1",
        "medialrep_http_requests_total{method=\"POST\",route=\"/v1/jobs\",status=\"415\"} 1",
        "medialrep_jobs_queued 0",
        "medialrep_workers 2",
        "# EOF",
    ] {
        assert!(text.lines().any(|other| other == line), "{line}\n{text}");
    }
    assert!(text.contains("medialrep_disk_free_bytes "));
    assert!(!text.contains(id_of(&job)));
}

#[tokio::test]
async fn the_limits_are_those_that_hold() {
    let server = Server::without_workers().await;
    let told = server.get("/v1/limits").await.json();
    assert_eq!(told["max_upload_bytes"], limits().upload.max_bytes);
    assert_eq!(told["max_queued_jobs"], 5);
    assert_eq!(told["run_memory_bytes"], limits().run_memory_bytes);
    assert_eq!(told["run_cpu_seconds"], limits().run_cpu.least.as_secs_f64());
    assert_eq!(told["retention"]["masks_seconds"], 24 * 3600);
    assert_eq!(told["webhooks"], false);
}

#[tokio::test]
async fn the_documentation_needs_no_other_server() {
    let server = Server::without_workers().await;
    let page = server.get("/docs").await;
    assert_eq!((page.status.as_u16(), page.header("location")), (303, "/docs/index.html"));
    let page = server.get("/docs/index.html").await;
    assert!(page.header("content-type").starts_with("text/html"));
    let policy = page.header("content-security-policy");
    assert!(policy.contains("script-src 'self';") && !policy.contains("http"));
    for file in ["swagger-ui-bundle.js", "swagger-ui.css", "swagger-initializer.js"] {
        assert!(page.text().contains(file), "{file}");
        assert_eq!(server.get(&format!("/docs/{file}")).await.status, 200, "{file}");
    }
    assert!(server.get("/docs/swagger-initializer.js").await.text().contains("/openapi.yaml"));
    for nothing in ["/docs/nothing.js", "/docs/%FF"] {
        server.get(nothing).await.is_problem(404, "no_such_route");
    }
}

#[tokio::test]
async fn a_deleted_job_frees_its_key_and_its_files() {
    let server = Server::without_workers().await;
    let send = async || server.with(Method::POST, "/v1/jobs", &[("idempotency-key", "k")], mask()).await;
    let first = send().await.header("location").to_owned();
    assert_eq!(server.call(Method::DELETE, &first).await.status, 204);
    assert!(JobId::parse(id_of(&first)).is_some() && server.files().is_empty());
    assert_ne!(send().await.header("location"), first);
}
