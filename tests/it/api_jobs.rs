//! The life of a job: run, fail, cancel, delete, list; and what every route has in common.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use axum::http::Method;
use medialrep::jobs::worker::Processor;

use crate::help::support::{Server, id_of, mask, refuses, waits, writes};

#[tokio::test]
async fn a_job_runs_to_its_results() {
    let server = Server::start(writes()).await;
    let job = server.submit().await;
    let done = server.job_in(&job, "succeeded").await;
    assert_eq!(done["attempt"], 1);
    assert_eq!(done["warnings"], serde_json::json!([{"code": "thin", "message": "a place is thin"}]));
    assert_eq!(done["results"][0]["name"], "model.glb");
    assert_eq!(done["results"][0]["href"], format!("{job}/results/model.glb"));
    for name in ["error", "progress", "queue_position"] {
        assert!(done[name].is_null(), "{name}");
    }
    assert_eq!(done["links"]["cancel"], serde_json::Value::Null);
    for name in ["created_at", "started_at", "ended_at"] {
        done[name].as_str().unwrap().parse::<jiff::Timestamp>().unwrap();
    }
}

#[tokio::test]
async fn a_running_job_says_how_far_it_is() {
    let gate = Arc::new(AtomicBool::new(false));
    let server = Server::start(waits(&gate)).await;
    let job = server.submit().await;
    let now = server.job_when(&job, |now| now["progress"]["stage"] == "isomap").await;
    // Opened before anything is said of it: a closed gate keeps the server from ending.
    gate.store(true, Ordering::Relaxed);
    // Half of a stage of the second of two structures, and five of nine stages come before.
    let fraction = now["progress"]["fraction"].as_f64().unwrap();
    assert!((fraction - 5.5 / 9.0 / 2.0).abs() < 1e-9, "{fraction}");
    assert_eq!((&now["progress"]["structure"], &now["progress"]["structures"]), (&1.into(), &2.into()));
    server.job_in(&job, "succeeded").await;
}

#[tokio::test]
async fn a_panic_fails_its_job_only() {
    let count = std::sync::atomic::AtomicUsize::new(0);
    let good = writes();
    let processor: Processor = Arc::new(move |mask, params, limits, out, observer| {
        assert!(count.fetch_add(1, Ordering::Relaxed) != 1, "a secret of the inside");
        good(mask, params, limits, out, observer)
    });
    let server = Server::start(processor).await;
    let mut states = Vec::new();
    for _ in 0..4 {
        let job = server.submit().await;
        let ended = server.job_when(&job, |now| !now["ended_at"].is_null()).await;
        states.push(ended["state"].as_str().unwrap().to_owned());
        if ended["state"] == "failed" {
            assert_eq!((&ended["error"]["code"], &ended["error"]["status"]), (&"internal".into(), &500.into()));
            assert!(!ended.to_string().contains("secret"));
        }
    }
    assert_eq!(states, ["succeeded", "failed", "succeeded", "succeeded"]);
    assert_eq!(server.get("/readyz").await.status, 200);
}

#[tokio::test]
async fn a_refused_mask_is_erased() {
    let server = Server::start(refuses()).await;
    let job = server.submit().await;
    let failed = server.job_in(&job, "failed").await;
    assert_eq!(failed["error"]["code"], "shape_is_a_ball");
    // The row is written first, the file goes right after.
    for _ in 0..500 {
        if server.files().is_empty() {
            return;
        }
        tokio::time::sleep(Duration::from_millis(2)).await;
    }
    panic!("left: {:?}", server.files());
}

#[tokio::test]
async fn cancelling_stops_a_job_wherever_it_is() {
    let gate = Arc::new(AtomicBool::new(false));
    let server = Server::start(waits(&gate)).await;
    let running = [server.submit().await, server.submit().await];
    for job in &running {
        server.job_in(job, "running").await;
    }
    let waiting = server.submit().await;
    let answer = server.call(Method::POST, &format!("{waiting}/cancel")).await;
    assert_eq!((answer.status.as_u16(), &answer.json()["state"]), (202, &"canceled".into()));
    let answer = server.call(Method::POST, &format!("{}/cancel", running[0])).await;
    assert_eq!((answer.status.as_u16(), &answer.json()["cancel_requested"]), (202, &true.into()));
    let ended = server.job_in(&running[0], "canceled").await;
    assert!(ended["error"].is_null() && ended["results"] == serde_json::json!([]));
    gate.store(true, Ordering::Relaxed);
    server.job_in(&running[1], "succeeded").await;
    for job in [&waiting, &running[0], &running[1]] {
        server.call(Method::POST, &format!("{job}/cancel")).await.is_problem(409, "job_ended");
    }
}

#[tokio::test]
async fn deleting_erases_everything() {
    let gate = Arc::new(AtomicBool::new(true));
    let server = Server::start(waits(&gate)).await;
    let done = server.submit().await;
    server.job_in(&done, "succeeded").await;
    gate.store(false, Ordering::Relaxed);
    let running = [server.submit().await, server.submit().await];
    for job in &running {
        server.job_when(job, |now| now["progress"]["stage"] == "isomap").await;
    }
    let waiting = server.submit().await;
    for job in [&done, &running[0], &running[1], &waiting] {
        assert_eq!(server.call(Method::DELETE, job).await.status, 204);
        server.get(job).await.is_problem(404, "no_such_job");
        server.call(Method::DELETE, job).await.is_problem(404, "no_such_job");
        server.get(&format!("{job}/results/model.glb")).await.is_problem(404, "no_such_job");
    }
    assert_eq!(server.files(), Vec::<std::path::PathBuf>::new());
    gate.store(true, Ordering::Relaxed);
    let next = server.submit().await;
    server.job_in(&next, "succeeded").await;
}

#[tokio::test]
async fn the_list_pages_from_new_to_old() {
    let server = Server::without_workers().await;
    let mut sent = Vec::new();
    for _ in 0..5 {
        sent.push(server.submit().await);
    }
    server.call(Method::POST, &format!("{}/cancel", sent[1])).await;
    let mut seen = Vec::new();
    let mut path = "/v1/jobs?limit=2&state=queued".to_owned();
    loop {
        let page = server.get(&path).await;
        let list = page.json();
        seen.extend(
            list["jobs"].as_array().unwrap().iter().map(|job| job["links"]["self"].as_str().unwrap().to_owned()),
        );
        let Some(cursor) = list["next_cursor"].as_str() else { break };
        path = format!("/v1/jobs?cursor={cursor}&limit=2&state=queued");
        assert_eq!(page.header("link"), format!("<{path}>; rel=\"next\""));
    }
    sent.remove(1);
    sent.reverse();
    assert_eq!(seen, sent);
}

#[tokio::test]
async fn a_bad_query_is_refused_by_name() {
    let server = Server::without_workers().await;
    for query in ["limit=0", "limit=201", "limit=x", "state=done", "cursor=7", "sort=up"] {
        server.get(&format!("/v1/jobs?{query}")).await.is_problem(400, "invalid_query");
    }
}

#[tokio::test]
async fn what_is_not_there_is_a_problem() {
    let server = Server::without_workers().await;
    let id = server.submit().await;
    server.get("/nowhere").await.is_problem(404, "no_such_route");
    server.get("/v1/jobs/").await.is_problem(404, "no_such_route");
    server.get(&format!("{id}/results/model.glb")).await.is_problem(404, "no_such_result");
    // Ids are taken as others print them too, in capitals, but in no other form.
    let upper = id.to_uppercase().replace("/V1/JOBS", "/v1/jobs");
    assert_eq!(server.get(&upper).await.json()["id"], id_of(&id));
    let (bare, braced) = (id_of(&id).replace('-', ""), format!("%7B{}%7D", id_of(&id)));
    for id in ["1", "%ff", "..%2f..%2fetc%2fpasswd", "00000000-0000-0000-0000-000000000000", &bare, &braced] {
        for path in [format!("/v1/jobs/{id}"), format!("/v1/jobs/{id}/results/x")] {
            server.get(&path).await.is_problem(404, "no_such_job");
        }
        server.call(Method::DELETE, &format!("/v1/jobs/{id}")).await.is_problem(404, "no_such_job");
        server.call(Method::POST, &format!("/v1/jobs/{id}/cancel")).await.is_problem(404, "no_such_job");
    }
}

#[tokio::test]
async fn a_wrong_method_is_a_problem_that_names_the_right_ones() {
    let server = Server::without_workers().await;
    for (method, path) in [(Method::PUT, "/v1/jobs"), (Method::POST, "/livez"), (Method::PATCH, "/v1/jobs/1")] {
        let answer = server.call(method, path).await;
        answer.is_problem(405, "method_not_allowed");
        assert!(answer.header("allow").contains("GET"));
    }
}

#[tokio::test]
async fn every_answer_carries_the_guards() {
    let server = Server::without_workers().await;
    for path in ["/", "/v1/jobs", "/nowhere", "/livez"] {
        let answer = server.get(path).await;
        assert_eq!(answer.header("x-content-type-options"), "nosniff", "{path}");
        assert_eq!(answer.header("cache-control"), "no-store", "{path}");
        assert!(answer.header("content-security-policy").starts_with("default-src 'none'"), "{path}");
    }
}

#[tokio::test]
async fn ready_means_that_work_can_be_done() {
    let idle = Server::without_workers().await;
    assert_eq!(idle.get("/livez").await.status, 200);
    let problem = idle.get("/readyz").await.is_problem(503, "not_ready");
    assert_eq!(problem.detail, "no worker is alive");

    let server = Server::start(writes()).await;
    assert_eq!(server.get("/readyz").await.json()["status"], "ready");
    // A folder that somebody removed is made anew; where that cannot be, nothing can be written.
    let scratch = server.dir.path().join("scratch");
    std::fs::remove_dir_all(&scratch).unwrap();
    assert_eq!(server.get("/readyz").await.json()["status"], "ready");
    let job = server.submit().await;
    server.job_in(&job, "succeeded").await;
    std::fs::remove_dir_all(&scratch).unwrap();
    std::fs::write(&scratch, "no folder").unwrap();
    // An answer is kept for a second.
    tokio::time::sleep(Duration::from_millis(1100)).await;
    let problem = server.get("/readyz").await.is_problem(503, "not_ready");
    assert_eq!(problem.detail, "the data directory cannot be written");
    server.post("/v1/jobs", mask()).await.is_problem(500, "internal");
}
