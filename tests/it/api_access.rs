//! Who is let in, and what they see.

use axum::http::Method;
use jiff::Timestamp;
use medialrep::jobs::token::{Scope, Token};
use serde_json::Value;

use crate::help::dicom_bytes::{Seg, text};
use crate::help::pacs::{MULTIPART, related};
use crate::help::support::{Answer, Server, id_of, mask, writes};

/// `Bearer` and a new token.
async fn token(server: &Server, tenant: &str, scopes: &[Scope]) -> String {
    let token = Token::new().unwrap();
    let stored = token.stored(tenant.to_owned(), scopes.to_vec(), None);
    server.jobs.store().insert_token(&stored).await.unwrap();
    format!("Bearer {}", token.reveal())
}

async fn call(server: &Server, token: &str, method: Method, path: &str) -> Answer {
    let body = if path == "/v1/jobs" && method == Method::POST { mask() } else { Vec::new() };
    server.with(method, path, &[("authorization", token)], body).await
}

/// Every route that touches a job.
const ROUTES: [(Method, &str); 8] = [
    (Method::GET, ""),
    (Method::GET, "/events"),
    (Method::GET, "/result"),
    (Method::GET, "/results/model.glb"),
    (Method::GET, "?wait=1"),
    (Method::POST, "/cancel"),
    (Method::POST, "/retry"),
    (Method::DELETE, ""),
];

#[tokio::test]
async fn a_tenant_sees_nothing_of_anothers_jobs() {
    let server = Server::start(writes()).await;
    let own = token(&server, "radiology", &[Scope::Read, Scope::Write]).await;
    let other = token(&server, "surgery", &[Scope::Read, Scope::Write]).await;
    let job = call(&server, &own, Method::POST, "/v1/jobs").await.header("location").to_owned();
    for (method, path) in ROUTES {
        let answer = call(&server, &other, method.clone(), &format!("{job}{path}")).await;
        answer.is_problem(404, "no_such_job");
    }
    assert_eq!(call(&server, &other, Method::GET, "/v1/jobs").await.json()["jobs"], serde_json::json!([]));
    let cursor = format!("/v1/jobs?cursor={}", "ffffffff-ffff-7fff-bfff-ffffffffffff");
    assert_eq!(call(&server, &other, Method::GET, &cursor).await.json()["jobs"], serde_json::json!([]));
    // An equal request of another tenant is computed for itself.
    let again = call(&server, &other, Method::POST, "/v1/jobs").await.json();
    assert_eq!(again["reused"], false);
    let jobs = call(&server, &own, Method::GET, "/v1/jobs").await.json();
    assert_eq!(jobs["jobs"].as_array().unwrap().len(), 1);
    assert_eq!(jobs["jobs"][0]["id"], id_of(&job));
}

#[tokio::test]
async fn from_the_first_token_on_nobody_is_let_in_without() {
    let server = Server::without_workers().await;
    let job = server.submit().await;
    let good = token(&server, "radiology", &[Scope::Read]).await;
    for (method, path) in ROUTES {
        let answer = server.call(method, &format!("{job}{path}")).await;
        answer.is_problem(401, "token_missing");
        assert_eq!(answer.header("www-authenticate"), "Bearer");
    }
    let in_lower_case = good.replacen("Bearer", "bearer", 1);
    assert_eq!(call(&server, &in_lower_case, Method::GET, "/v1/jobs").await.status, 200);
    for bad in ["Bearer", "Bearer x", "Basic dTpw", &good[..good.len() - 1], &format!("{}0", &good[..good.len() - 1])] {
        if bad != good {
            call(&server, bad, Method::GET, "/v1/jobs").await.is_problem(401, "token_invalid");
        }
    }
    server.get("/metrics").await.is_problem(401, "token_missing");
    for open in ["/", "/livez", "/openapi.yaml", "/v1/limits", "/docs/index.html"] {
        assert_eq!(server.get(open).await.status, 200, "{open}");
    }
    assert_eq!(call(&server, &good, Method::GET, "/v1/jobs").await.status, 200);
}

#[tokio::test]
async fn a_token_allows_what_its_scopes_say() {
    let server = Server::without_workers().await;
    let reader = token(&server, "t", &[Scope::Read]).await;
    let writer = token(&server, "t", &[Scope::Write]).await;
    let watcher = token(&server, "t", &[Scope::Metrics]).await;
    let job = call(&server, &writer, Method::POST, "/v1/jobs").await.header("location").to_owned();
    for (method, path) in ROUTES {
        let reads = method == Method::GET;
        let (allowed, refused) = if reads { (&reader, &writer) } else { (&writer, &reader) };
        let path = format!("{job}{path}");
        for token in [refused, &watcher] {
            call(&server, token, method.clone(), &path).await.is_problem(403, "scope_missing");
        }
        // Streams of events do not end by themselves.
        if !path.ends_with("/events") {
            let answer = call(&server, allowed, method, &path).await;
            assert!(![401, 403].contains(&answer.status.as_u16()), "{path}: {}", answer.text());
        }
    }
    assert_eq!(call(&server, &watcher, Method::GET, "/metrics").await.status, 200);
    call(&server, &reader, Method::GET, "/metrics").await.is_problem(403, "scope_missing");
}

/// Routes that an archive stores to.
const STORES: [&str; 2] = ["/dicom-web/studies", "/dicom-web/studies/1.2.3"];

/// Stores an instance; the path of its job.
async fn store(server: &Server, token: &str, path: &str) -> String {
    let mut dicom = Seg::small().dicom();
    dicom.set(text(0x0008_0016, "UI", "1.2.840.10008.5.1.4.1.1.66.4"));
    dicom.set(text(0x0008_0018, "UI", "1.2.3.4"));
    dicom.set(text(0x0020_000d, "UI", "1.2.3"));
    let headers = [("authorization", token), ("content-type", MULTIPART)];
    let answer = server.with(Method::POST, path, &headers, related(&[dicom.bytes()])).await;
    assert_eq!(answer.status, 200, "{}", answer.text());
    answer.json()["00081199"]["Value"][0]["00081190"]["Value"][0].as_str().unwrap().to_owned()
}

#[tokio::test]
async fn an_archive_stores_with_the_scope_to_write_only() {
    let mut limits = crate::help::support::limits();
    limits.upload.max_bytes = 16 << 10;
    let server = Server::open_with(tempfile::TempDir::new().unwrap(), limits, None).await;
    let reader = token(&server, "t", &[Scope::Read]).await;
    let watcher = token(&server, "t", &[Scope::Metrics]).await;
    let writer = token(&server, "t", &[Scope::Write]).await;
    for path in STORES {
        server.call(Method::POST, path).await.is_problem(401, "token_missing");
        call(&server, "Bearer x", Method::POST, path).await.is_problem(401, "token_invalid");
        for token in [&reader, &watcher] {
            call(&server, token, Method::POST, path).await.is_problem(403, "scope_missing");
        }
        store(&server, &writer, path).await;
    }
}

/// Routes that results are found and fetched by.
const RETRIEVALS: [&str; 13] = [
    "/dicom-web/studies",
    "/dicom-web/series",
    "/dicom-web/instances",
    "/dicom-web/studies/1.2.3",
    "/dicom-web/studies/1.2.3/metadata",
    "/dicom-web/studies/1.2.3/series",
    "/dicom-web/studies/1.2.3/instances",
    "/dicom-web/studies/1.2.3/series/1.2.4",
    "/dicom-web/studies/1.2.3/series/1.2.4/metadata",
    "/dicom-web/studies/1.2.3/series/1.2.4/instances",
    "/dicom-web/studies/1.2.3/series/1.2.4/instances/1.2.5",
    "/dicom-web/studies/1.2.3/series/1.2.4/instances/1.2.5/metadata",
    "/dicom-web/studies/1.2.3/series/1.2.4/instances/1.2.5/bulkdata/7FE00010",
];

#[tokio::test]
async fn results_are_searched_and_fetched_with_the_scope_to_read_only() {
    let server = Server::without_workers().await;
    let reader = token(&server, "t", &[Scope::Read]).await;
    let writer = token(&server, "t", &[Scope::Write]).await;
    let watcher = token(&server, "t", &[Scope::Metrics]).await;
    for path in RETRIEVALS {
        server.get(path).await.is_problem(401, "token_missing");
        call(&server, "Bearer x", Method::GET, path).await.is_problem(401, "token_invalid");
        for token in [&writer, &watcher] {
            call(&server, token, Method::GET, path).await.is_problem(403, "scope_missing");
        }
        let answer = call(&server, &reader, Method::GET, path).await;
        assert!([200, 404].contains(&answer.status.as_u16()), "{path}: {}", answer.text());
    }
}

#[tokio::test]
async fn tenants_that_store_the_same_instance_have_a_job_each() {
    let mut limits = crate::help::support::limits();
    limits.upload.max_bytes = 16 << 10;
    let server = Server::open_with(tempfile::TempDir::new().unwrap(), limits, None).await;
    let own = token(&server, "radiology", &[Scope::Read, Scope::Write]).await;
    let other = token(&server, "surgery", &[Scope::Read, Scope::Write]).await;
    let (job, others) = (store(&server, &own, STORES[0]).await, store(&server, &other, STORES[0]).await);
    assert_ne!(job, others);
    assert_eq!(call(&server, &own, Method::GET, &job).await.status, 200);
    call(&server, &own, Method::GET, &others).await.is_problem(404, "no_such_job");
    // Sent again, it is the tenant's own job, not that which came first.
    assert_eq!(store(&server, &other, STORES[0]).await, others);
}

#[tokio::test]
async fn a_revoked_or_expired_token_is_refused_at_once() {
    let server = Server::without_workers().await;
    let good = token(&server, "t", &[Scope::Read]).await;
    let id = good.split('_').nth(1).unwrap();
    assert_eq!(call(&server, &good, Method::GET, "/v1/jobs").await.status, 200);
    server.jobs.store().revoke_token(id, Timestamp::now()).await.unwrap();
    call(&server, &good, Method::GET, "/v1/jobs").await.is_problem(401, "token_invalid");
    let old = Token::new().unwrap();
    let stored = old.stored("t".to_owned(), vec![Scope::Read], Some(Timestamp::now()));
    server.jobs.store().insert_token(&stored).await.unwrap();
    let old = format!("Bearer {}", old.reveal());
    call(&server, &old, Method::GET, "/v1/jobs").await.is_problem(401, "token_invalid");
}

#[tokio::test]
async fn pages_of_other_origins_and_other_names_of_this_machine_are_turned_away() {
    let server = Server::without_workers().await;
    let get = async |headers: &[(&str, &str)]| server.with(Method::GET, "/v1/jobs", headers, Vec::new()).await;
    get(&[("host", "evil.example")]).await.is_problem(403, "foreign_host");
    get(&[("host", "localhost"), ("origin", "https://evil.example")]).await.is_problem(403, "foreign_origin");
    get(&[("host", "localhost"), ("origin", "null")]).await.is_problem(403, "foreign_origin");
    assert_eq!(get(&[("host", "localhost:1"), ("origin", "http://localhost:1")]).await.status, 200);
    let allowed = get(&[("host", "localhost"), ("origin", "https://viewer.example.org")]).await;
    assert_eq!(allowed.status, 200);
    assert_eq!(allowed.header("access-control-allow-origin"), "https://viewer.example.org");
    let preflight = [
        ("origin", "https://viewer.example.org"),
        ("access-control-request-method", "POST"),
        ("access-control-request-headers", "authorization,idempotency-key"),
    ];
    let answer = server.with(Method::OPTIONS, "/v1/jobs", &preflight, Vec::new()).await;
    assert!(answer.header("access-control-allow-headers").contains("idempotency-key"));
    let evil = [("origin", "https://evil.example"), ("access-control-request-method", "POST")];
    let answer = server.with(Method::OPTIONS, "/v1/jobs", &evil, Vec::new()).await;
    assert!(!answer.headers.contains_key("access-control-allow-origin"));
}

#[tokio::test]
async fn a_tenant_may_have_so_many_requests_open() {
    let mut limits = crate::help::support::limits();
    limits.max_requests = 3;
    let server = Server::open_with(tempfile::TempDir::new().unwrap(), limits, None).await;
    let own = token(&server, "one", &[Scope::Read, Scope::Write]).await;
    let other = token(&server, "other", &[Scope::Read]).await;
    let job = call(&server, &own, Method::POST, "/v1/jobs").await.header("location").to_owned();
    let mut open = Vec::new();
    for _ in 0..3 {
        open.push(server.begin(&format!("{job}/events"), &own).await);
    }
    call(&server, &own, Method::GET, &job).await.is_problem(429, "too_many_requests");
    assert_eq!(call(&server, &other, Method::GET, "/v1/jobs").await.status, 200);
    drop(open);
    assert_eq!(call(&server, &own, Method::GET, &job).await.status, 200);
}

#[tokio::test]
async fn who_did_what_is_in_the_audit_log() {
    let server = Server::start(writes()).await;
    let own = token(&server, "radiology", &[Scope::Read, Scope::Write]).await;
    let job = call(&server, &own, Method::POST, "/v1/jobs").await.header("location").to_owned();
    while call(&server, &own, Method::GET, &job).await.json()["state"] != "succeeded" {
        tokio::time::sleep(std::time::Duration::from_millis(5)).await;
    }
    call(&server, &own, Method::GET, &format!("{job}/results/model.glb")).await;
    call(&server, &own, Method::DELETE, &job).await;
    call(&server, "Bearer wrong", Method::GET, &job).await;
    let path = server.dir.path().join("audit/audit.jsonl");
    medialrep::audit::verify(&path).unwrap();
    let text = std::fs::read_to_string(path).unwrap();
    let lines: Vec<Value> = text.lines().map(|line| serde_json::from_str(line).unwrap()).collect();
    let told: Vec<_> =
        lines.iter().map(|line| (line["action"].as_str().unwrap(), line["outcome"].as_str().unwrap())).collect();
    let expected = [("started", "ok"), ("submit", "accepted"), ("read_result", "model.glb"), ("delete", "erased")];
    assert_eq!(told[..4], expected);
    // Another test may have been turned away in the same second, which is told once.
    assert!(told.len() == 4 || told[4] == ("denied", "token_invalid"), "{told:?}");
    for line in &lines[1..4] {
        assert_eq!((&line["tenant"], &line["job"]), (&"radiology".into(), &id_of(&job).into()));
        assert_eq!(line["token"], own.split('_').nth(1).unwrap());
        assert_eq!(line["trace_id"].as_str().unwrap().len(), 32);
    }
}
