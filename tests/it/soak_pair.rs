//! Two servers on one data directory, killed at any moment while clients send, use results again, delete and
//! fetch, and while the directory is copied. Short here, long under `make soak`.

use std::collections::BTreeSet;
use std::io::Read;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::{Mutex, RwLock};
use std::time::Duration;

use flate2::read::GzDecoder;
use serde_json::Value;
use tempfile::TempDir;

use crate::help::process::{Service, run, sample_of};
use crate::soak::{Dice, count, tell};

/// Masks that differ in their header: few, so that most are sent again and their results are used again.
const MASKS: u8 = 12;
/// Jobs that are kept: with many more, a copy takes long and fills the disk.
const MOST_KEPT: usize = 100;
/// A byte of the header of NIfTI that means nothing: the description's first.
const DESCRIPTION: usize = 148;

/// What clients know, and what they disturb.
struct Pair {
    servers: [RwLock<Service>; 2],
    masks: Vec<Vec<u8>>,
    acknowledged: Mutex<BTreeSet<String>>,
    /// Deleted, or maybe so: the server was killed before it answered.
    deleted: Mutex<BTreeSet<String>>,
    used_again: AtomicUsize,
    stop: AtomicBool,
}

fn start(data: &Path) -> Service {
    // Masks go as soon as their jobs have ended: also while a copy is made.
    let server = Service::start(data, &["--workers", "2", "--max-queued", "60", "--keep-masks", "0"]);
    // It listens before its tables are made.
    assert!(server.call("GET /readyz", b"").0.starts_with("HTTP/1.1 200"));
    server
}

fn masks(dir: &Path) -> Vec<Vec<u8>> {
    let mut mask = Vec::new();
    GzDecoder::new(&sample_of(dir, &["slab", "--spacing", "2"])[..]).read_to_end(&mut mask).unwrap();
    let named = |number| {
        mask[DESCRIPTION] = b'a' + number;
        mask.clone()
    };
    (0..MASKS).map(named).collect()
}

/// One client, until told to stop.
fn ask(pair: &Pair, mut dice: Dice) {
    while !pair.stop.load(Ordering::Relaxed) {
        let server = pair.servers[usize::from(dice.below(2) == 1)].read().unwrap();
        let acknowledged = pair.acknowledged.lock().unwrap().len();
        let is_much = acknowledged - pair.deleted.lock().unwrap().len().min(acknowledged) > MOST_KEPT;
        match if is_much { 0 } else { dice.below(10) } {
            0 => delete(pair, &server, &mut dice),
            1 => fetch(pair, &server, &mut dice),
            _ => send(pair, &server, &mut dice),
        }
        drop(server);
        std::thread::sleep(Duration::from_millis(2));
    }
}

fn send(pair: &Pair, server: &Service, dice: &mut Dice) {
    let mask = &pair.masks[usize::try_from(dice.below(u64::from(MASKS))).unwrap()];
    let Some((head, body)) = server.try_call_cached("POST /v1/jobs", mask) else { return };
    let Ok(job) = serde_json::from_str::<Value>(&body) else { return };
    let Some(path) = job["links"]["self"].as_str() else { return };
    if head.starts_with("HTTP/1.1 20") {
        pair.acknowledged.lock().unwrap().insert(path.to_owned());
        pair.used_again.fetch_add(usize::from(job["reused"] == true), Ordering::Relaxed);
    }
}

/// One that nobody has asked to delete.
fn any_kept(pair: &Pair, dice: &mut Dice) -> Option<String> {
    let deleted = pair.deleted.lock().unwrap().clone();
    let kept: BTreeSet<String> = pair.acknowledged.lock().unwrap().difference(&deleted).cloned().collect();
    let place = dice.below(kept.len().max(1) as u64);
    kept.into_iter().nth(usize::try_from(place).unwrap())
}

fn delete(pair: &Pair, server: &Service, dice: &mut Dice) {
    let Some(job) = any_kept(pair, dice) else { return };
    // Before it is asked for: it may happen though nobody hears of it.
    pair.deleted.lock().unwrap().insert(job.clone());
    server.try_call(&format!("DELETE {job}"), b"");
}

/// What is there to be fetched is whole.
fn fetch(pair: &Pair, server: &Service, dice: &mut Dice) {
    let Some(job) = any_kept(pair, dice) else { return };
    let Some((_, body)) = server.try_call(&format!("GET {job}"), b"") else { return };
    let is_done = serde_json::from_str::<Value>(&body).is_ok_and(|job| job["state"] == "succeeded");
    if is_done && let Some((head, body)) = server.try_call(&format!("GET {job}/results/thickness.json"), b"") {
        let is_deleted = pair.deleted.lock().unwrap().contains(&job);
        assert!(is_deleted || head.starts_with("HTTP/1.1 200"), "{job}: {head} {body}");
    }
}

/// Copies of the directory while all that goes on: each is whole by the program's own judgement.
fn back_up(pair: &Pair, data: &Path, dir: &Path) -> usize {
    let mut copies = 0;
    while !pair.stop.load(Ordering::Relaxed) {
        let copy: PathBuf = dir.join(format!("copy-{copies}"));
        let told = run(&["backup", "--out", copy.to_str().unwrap()], data);
        assert!(told.status.success(), "{}", String::from_utf8_lossy(&told.stderr));
        let (told, deleted) = (String::from_utf8_lossy(&told.stdout), pair.deleted.lock().unwrap().len());
        let left_out = told.split_whitespace().rev().nth(2).and_then(|count| count.parse::<usize>().ok());
        assert!(left_out.is_some_and(|count| count <= deleted), "{deleted} deleted: {told}");
        check(&copy);
        std::fs::remove_dir_all(copy).unwrap();
        copies += 1;
        std::thread::sleep(Duration::from_millis(300));
    }
    copies
}

fn check(data: &Path) {
    let told = run(&["check", "--listen", "127.0.0.1:0", "--min-free-mib", "0"], data);
    let (out, error) = (String::from_utf8_lossy(&told.stdout), String::from_utf8_lossy(&told.stderr));
    assert!(told.status.success(), "{out}{error}");
}

/// Every acknowledged job that nobody deleted has succeeded, and all files that it names can be fetched.
fn check_jobs(pair: &Pair, server: &Service) -> usize {
    let deleted = pair.deleted.lock().unwrap();
    let mut found = 0;
    for path in pair.acknowledged.lock().unwrap().difference(&deleted) {
        let job = server.ended(path);
        assert_eq!(job["state"], "succeeded", "{job}");
        for file in job["results"].as_array().unwrap() {
            let (head, _) = server.call(&format!("GET {}", file["href"].as_str().unwrap()), b"");
            assert!(head.starts_with("HTTP/1.1 200"), "{file} {head}");
        }
        found += 1;
    }
    found
}

#[test]
fn servers_killed_at_any_moment_lose_no_job_and_no_file() {
    let dir = TempDir::new().unwrap();
    let data = dir.path().join("data");
    let kills = count(6, 500);
    let mut dice = Dice(11);
    let pair = Pair {
        masks: masks(dir.path()),
        servers: [start(&data).into(), start(&data).into()],
        acknowledged: Mutex::default(),
        deleted: Mutex::default(),
        used_again: AtomicUsize::default(),
        stop: AtomicBool::default(),
    };
    let copies = std::thread::scope(|scope| {
        for client in 0..3 {
            let pair = &pair;
            scope.spawn(move || ask(pair, Dice(client)));
        }
        let copies = scope.spawn(|| back_up(&pair, &data, dir.path()));
        for _ in 0..kills {
            std::thread::sleep(Duration::from_millis(50 + dice.below(500)));
            let server = &pair.servers[usize::from(dice.below(2) == 1)];
            // Without waiting for clients: they are in the midst of their requests.
            server.read().unwrap().signal("-KILL");
            *server.write().unwrap() = start(&data);
        }
        pair.stop.store(true, Ordering::Relaxed);
        copies.join().unwrap()
    });
    let server = pair.servers[0].read().unwrap();
    let found = check_jobs(&pair, &server);
    check(&data);
    let used_again = pair.used_again.load(Ordering::Relaxed);
    assert!(found > 0 && used_again > 0 && copies > 0, "{found} {used_again} {copies}");
    let deleted = pair.deleted.lock().unwrap().len();
    tell(&format!(
        "{kills} kills of two servers: {found} jobs whole, {used_again} made of earlier results, {deleted} deleted, {copies} copies"
    ));
}
