//! What an operator does beside a running service: tokens, check, backup.

use std::path::{Path, PathBuf};
use std::process::Output;

use serde_json::Value;
use tempfile::TempDir;

use crate::help::process::{PROGRAM, Service, run, sample};

fn text(output: &Output) -> String {
    String::from_utf8_lossy(&output.stdout).into_owned()
}

fn check(data_dir: &Path) -> (Option<i32>, String) {
    let output = run(&["check", "--min-free-mib", "0"], data_dir);
    (output.status.code(), text(&output))
}

#[test]
fn tokens_are_made_shown_once_listed_and_revoked() {
    let dir = TempDir::new().unwrap();
    let (data, mask) = (dir.path().join("data"), sample(dir.path()));
    let service = Service::start(&data, &[]);
    assert!(service.call("GET /v1/jobs", b"").0.starts_with("HTTP/1.1 200"));
    let made = run(&["token", "create", "--tenant", "radiology", "--expires-in", "1day"], &data);
    let token = text(&made).trim().to_owned();
    assert!(made.status.success() && token.starts_with("mrt_"));
    // The running service heeds it at once.
    assert!(service.call("GET /v1/jobs", b"").0.starts_with("HTTP/1.1 401"));
    let service = service.with_token(&token);
    let job = service.submit(&mask);
    assert_eq!(service.ended(&job)["state"], "succeeded");
    let (id, secret) = token["mrt_".len()..].split_once('_').unwrap();
    let list = text(&run(&["token", "list"], &data));
    assert!(list.contains(id) && list.contains("radiology") && list.contains("read,write"), "{list}");
    assert!(!list.contains(secret));
    assert!(run(&["token", "revoke", id], &data).status.success());
    assert!(service.call("GET /v1/jobs", b"").0.starts_with("HTTP/1.1 401"));
    assert_eq!(run(&["token", "revoke", id], &data).status.code(), Some(2));
    assert_eq!(run(&["token", "create", "--tenant", "a b"], &data).status.code(), Some(2));
    assert_eq!(run(&["token", "create", "--tenant", "a", "--scopes", "all"], &data).status.code(), Some(2));
    // Neither log nor audit log nor database knows the secret.
    let mut kept = service.log().into_bytes();
    for entry in ["audit/audit.jsonl", "db/jobs.sqlite", "db/jobs.sqlite-wal"] {
        kept.extend(std::fs::read(data.join(entry)).unwrap_or_default());
    }
    assert!(!kept.windows(secret.len()).any(|window| window == secret.as_bytes()));
    let audit = std::fs::read_to_string(data.join("audit/audit.jsonl")).unwrap();
    for action in ["token_created", "token_revoked", "submit"] {
        assert!(audit.contains(action), "{action}");
    }
}

#[test]
fn jobs_from_before_the_first_token_are_given_to_a_tenant() {
    let dir = TempDir::new().unwrap();
    let (data, mask) = (dir.path().join("data"), sample(dir.path()));
    let service = Service::start(&data, &[]);
    let early = service.submit(&mask);
    service.ended(&early);
    let made = run(&["token", "create", "--tenant", "radiology"], &data);
    let told = String::from_utf8_lossy(&made.stderr).into_owned();
    assert!(told.contains("token adopt --tenant radiology"), "{told}");
    let service = service.with_token(&text(&made));
    assert!(service.call(&format!("GET {early}"), b"").0.starts_with("HTTP/1.1 404"));
    let adopted = run(&["token", "adopt", "--tenant", "radiology"], &data);
    assert_eq!(text(&adopted), "1 jobs belong to radiology now\n");
    assert!(service.call(&format!("GET {early}"), b"").0.starts_with("HTTP/1.1 200"));
    assert_eq!(service.json("GET /v1/jobs")["jobs"].as_array().unwrap().len(), 1);
    assert!(std::fs::read_to_string(data.join("audit/audit.jsonl")).unwrap().contains("adopted"));
}

#[test]
fn tokens_are_not_made_for_a_service_that_is_not_there() {
    let dir = TempDir::new().unwrap();
    let create = || {
        let mut command = std::process::Command::new(PROGRAM);
        command.args(["token", "create", "--tenant", "a"]).current_dir(dir.path()).env_remove("MEDIALREP_DATA_DIR");
        command.output().unwrap()
    };
    let refused = create();
    assert_eq!(refused.status.code(), Some(2));
    assert!(String::from_utf8_lossy(&refused.stderr).contains("--data-dir"), "{refused:?}");
    assert!(!dir.path().join("data").exists());
    // Named, it is made: that is how a service gets its token before its first start.
    assert!(run(&["token", "create", "--tenant", "a"], &dir.path().join("data")).status.success());
    let made = create();
    assert!(made.status.success() && String::from_utf8_lossy(&made.stderr).contains("/data"), "{made:?}");
}

#[test]
fn what_a_deleted_job_said_is_gone_from_the_database_within_seconds() {
    let dir = TempDir::new().unwrap();
    let (data, mask) = (dir.path().join("data"), sample(dir.path()));
    let service = Service::start(&data, &[]);
    let label = "%7B%22patient%22%3A%22CANARYOFALABEL%22%7D";
    let (_, body) = service.call(&format!("POST /v1/jobs?labels={label}"), &mask);
    let job = serde_json::from_str::<Value>(&body).unwrap()["links"]["self"].as_str().unwrap().to_owned();
    service.ended(&job);
    let is_there = || {
        ["db/jobs.sqlite", "db/jobs.sqlite-wal"].iter().any(|file| {
            let bytes = std::fs::read(data.join(file)).unwrap_or_default();
            bytes.windows(14).any(|window| window == b"CANARYOFALABEL")
        })
    };
    assert!(is_there());
    assert!(service.call(&format!("DELETE {job}"), b"").0.starts_with("HTTP/1.1 204"));
    let deadline = std::time::Instant::now() + std::time::Duration::from_secs(15);
    while is_there() {
        assert!(std::time::Instant::now() < deadline, "still there");
        std::thread::sleep(std::time::Duration::from_millis(100));
    }
}

/// A data directory of a service that ran, and its audit log.
fn audited(dir: &TempDir) -> (std::path::PathBuf, std::path::PathBuf) {
    let data = dir.path().join("data");
    let mut service = Service::start(&data, &[]);
    service.ended(&service.submit(&sample(dir.path())));
    service.terminate();
    let log = data.join("audit/audit.jsonl");
    assert_eq!(check(&data).0, Some(0));
    (data, log)
}

#[test]
fn an_audit_log_that_lost_something_fails_the_check() {
    let dir = TempDir::new().unwrap();
    let (data, log) = audited(&dir);
    let whole = std::fs::read_to_string(&log).unwrap();
    let lines: Vec<&str> = whole.lines().collect();
    let of = |lines: &[&str]| lines.iter().map(|line| format!("{line}\n")).collect::<String>();
    for (what, text) in
        [("emptied", String::new()), ("beheaded", of(&lines[1..])), ("without its end", of(&lines[..lines.len() - 1]))]
    {
        std::fs::write(&log, text).unwrap();
        let (code, told) = check(&data);
        assert!(code == Some(1) && told.contains("BAD   audit log"), "{what}: {told}");
    }
    std::fs::remove_file(&log).unwrap();
    assert!(check(&data).1.contains("BAD   audit log: this is not the log that was written: it is missing"));
    // What a later server writes there does not make up for it.
    drop(Service::start(&data, &[]));
    assert!(check(&data).1.contains("BAD   audit log"));
    std::fs::write(&log, &whole).unwrap();
    assert_eq!(check(&data).0, Some(0), "{}", check(&data).1);
}

#[test]
fn an_audit_log_that_is_rotated_passes_the_check() {
    let dir = TempDir::new().unwrap();
    let (data, log) = audited(&dir);
    // While nobody writes: the file stays beside the new one.
    std::fs::rename(&log, log.with_extension("jsonl.1")).unwrap();
    // Whoever is the first to write goes on in the new one.
    assert!(run(&["token", "adopt", "--tenant", "a"], &data).status.success());
    assert_eq!(check(&data).0, Some(0), "{}", check(&data).1);
    let service = Service::start(&data, &[]);
    let mask = sample(dir.path());
    service.ended(&service.submit(&mask));
    assert_eq!(check(&data).0, Some(0), "{}", check(&data).1);
    // Under a writer: the file may go elsewhere, once the server has gone on in the new one.
    std::fs::rename(&log, dir.path().join("elsewhere")).unwrap();
    service.ended(&service.submit(&mask));
    let deadline = std::time::Instant::now() + std::time::Duration::from_secs(20);
    while check(&data).0 != Some(0) {
        assert!(std::time::Instant::now() < deadline, "{}", check(&data).1);
        std::thread::sleep(std::time::Duration::from_millis(200));
    }
}

#[test]
fn with_a_token_the_service_listens_beyond_the_loopback() {
    let dir = TempDir::new().unwrap();
    run(&["token", "create", "--tenant", "radiology"], dir.path());
    let service = Service::start(dir.path(), &["--listen", "0.0.0.0:0"]);
    let address = std::net::SocketAddr::from(([127, 0, 0, 1], service.address.port()));
    assert!(std::net::TcpStream::connect(address).is_ok());
}

#[test]
fn check_tells_what_is_wrong() {
    let dir = TempDir::new().unwrap();
    let (data, mask) = (dir.path().join("data"), sample(dir.path()));
    assert_eq!(check(&data).0, Some(1), "there is no folder");
    let service = Service::start(&data, &[]);
    let job = service.submit(&mask);
    service.ended(&job);
    let (code, told) = check(&data);
    assert_eq!(code, Some(0), "{told}");
    for what in ["settings", "data directory", "disk", "database", "access", "files", "audit log"] {
        assert!(told.lines().any(|line| line.starts_with(&format!("ok    {what}"))), "{what}: {told}");
    }
    let low = run(&["check", "--min-free-mib", "999999999"], &data);
    assert!(low.status.code() == Some(1) && text(&low).contains("BAD   disk"));
    let strangers = run(&["check", "--min-free-mib", "0", "--listen", "0.0.0.0:80"], &data);
    assert!(strangers.status.code() == Some(1) && text(&strangers).contains("BAD   access"));
    let settings = run(&["check", "--webhook-targets", "https://a.example/"], &data);
    assert!(settings.status.code() == Some(2) && text(&settings).contains("--webhook-secret-file"));

    let id = job.rsplit('/').next().unwrap();
    let stored = data.join("masks").join(id);
    let mut bytes = std::fs::read(&stored).unwrap();
    bytes[20] ^= 1;
    std::fs::write(&stored, bytes).unwrap();
    let (code, told) = check(&data);
    assert!(code == Some(1) && told.contains(&format!("BAD   files: 1 missing or damaged, the first mask of {id}")));
    // What comes after an entry vouches for it.
    run(&["token", "create", "--tenant", "one"], &data);
    let audit = data.join("audit/audit.jsonl");
    let lines = std::fs::read_to_string(&audit).unwrap().replace("\"accepted\"", "\"reused\"");
    std::fs::write(&audit, lines).unwrap();
    assert!(check(&data).1.contains("BAD   audit log"));
}

#[test]
fn a_backup_of_a_running_service_restores_the_same_jobs() {
    let dir = TempDir::new().unwrap();
    let (data, copy, mask) = (dir.path().join("data"), dir.path().join("copy"), sample(dir.path()));
    let service = Service::start(&data, &[]);
    let jobs: Vec<String> = (0..4).map(|_| service.submit(&mask)).collect();
    service.ended(&jobs[0]);
    let out = ["backup", "--out", copy.to_str().unwrap()];
    let made = run(&out, &data);
    assert!(made.status.success(), "{}", String::from_utf8_lossy(&made.stderr));
    assert!(!run(&out, &data).status.success(), "a folder that is not empty is left alone");
    for job in &jobs {
        service.ended(job);
    }
    let restored = Service::start(&copy, &[]);
    let list = |service: &Service| service.json("GET /v1/jobs")["jobs"].clone();
    let ids = |list: &Value| list.as_array().unwrap().iter().map(|job| job["id"].clone()).collect::<Vec<_>>();
    assert_eq!(ids(&list(&restored)), ids(&list(&service)));
    for job in &jobs {
        let (old, new) = (service.ended(job), restored.ended(job));
        assert_eq!((&new["state"], &new["mask"]), (&"succeeded".into(), &old["mask"]));
        // All but the times in thickness.json is the same, computed before or after.
        assert_eq!(new["results"][0]["sha256"], old["results"][0]["sha256"]);
        let (head, _) = restored.call(&format!("GET {job}/results/points.csv"), b"");
        assert!(head.starts_with("HTTP/1.1 200"), "{head}");
    }
    assert_eq!(check(&copy).0, Some(0));
}

#[test]
fn every_option_has_its_environment_variable() {
    let help = std::process::Command::new(PROGRAM).args(["serve", "--help"]).output().unwrap();
    let help = text(&help);
    let options: Vec<_> = help
        .split_whitespace()
        .filter(|word| word.starts_with("--") && word.len() > 2)
        .map(|word| word.trim_matches(|c: char| !c.is_ascii_alphanumeric() && c != '-'))
        .collect();
    assert!(options.len() > 20, "{options:?}");
    for option in options.iter().filter(|option| **option != "--help") {
        let variable = format!("MEDIALREP_{}", option.trim_start_matches('-').replace('-', "_").to_uppercase());
        assert!(help.contains(&format!("env: {variable}=")), "{option}");
    }
}

/// The database of a data directory, put aside and back.
fn database(data: &Path) -> PathBuf {
    data.join("db/jobs.sqlite")
}

fn without_log(data: &Path) {
    for name in ["db/jobs.sqlite-wal", "db/jobs.sqlite-shm"] {
        let _ = std::fs::remove_file(data.join(name));
    }
}

#[test]
fn a_server_does_not_start_beside_files_whose_database_is_lost() {
    let dir = TempDir::new().unwrap();
    let data = dir.path().join("data");
    let mut service = Service::start(&data, &[]);
    let job = service.submit(&sample(dir.path()));
    service.ended(&job);
    service.terminate();
    for lost in [None, Some(b"")] {
        std::fs::remove_file(database(&data)).unwrap();
        without_log(&data);
        if let Some(content) = lost {
            std::fs::write(database(&data), content).unwrap();
        }
        let started = run(&["serve", "--listen", "127.0.0.1:0"], &data);
        let told = String::from_utf8_lossy(&started.stderr).into_owned();
        assert!(started.status.code() == Some(1) && told.contains("put db/ back"), "{told}");
        let (code, told) = check(&data);
        assert!(code == Some(1) && told.contains("BAD   database"), "{told}");
        let results = data.join("results").join(job.rsplit('/').next().unwrap());
        assert!(results.is_dir(), "nothing was swept");
        std::fs::write(database(&data), b"").unwrap();
    }
}

#[test]
fn files_of_jobs_that_the_database_lost_are_told_and_not_swept_at_once() {
    let dir = TempDir::new().unwrap();
    let (data, aside) = (dir.path().join("data"), dir.path().join("aside.sqlite"));
    Service::start(&data, &[]).terminate();
    std::fs::copy(database(&data), &aside).unwrap();
    let mut service = Service::start(&data, &[]);
    let job = service.submit(&sample(dir.path()));
    let deleted = service.submit(&sample(dir.path()));
    for job in [&job, &deleted] {
        service.ended(job);
    }
    service.call(&format!("DELETE {deleted}"), b"");
    service.terminate();
    without_log(&data);
    std::fs::copy(&aside, database(&data)).unwrap();
    let (code, told) = check(&data);
    assert!(code == Some(1) && told.contains("BAD   rows: 1 jobs are in the audit log"), "{told}");
    let service = Service::start(&data, &[]);
    service.call("GET /readyz", b"");
    assert!(service.log().contains("it may have lost its last changes"), "{}", service.log());
    assert!(data.join("results").join(job.rsplit('/').next().unwrap()).is_dir());
}
