//! What a DICOM mask says of a patient: in the mask and in the record that results are made from, as long as the job is
//! kept, and in DICOM results. Nowhere else, whichever way the mask came in.

use std::collections::BTreeSet;
use std::io::{Read, Write};
use std::net::TcpListener;
use std::path::Path;
use std::process::Command;
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

use crate::help::dicom_bytes::{Dicom, Frame, Seg, sequence, short, text};
use crate::help::pacs::{FakePacs, INSTANCE, MULTIPART, Reply, SERIES, STUDY, related};
use crate::help::process::{PROGRAM, Service};

/// Texts of a patient, a study and a place, some of which results take over.
const TEXTS: [(u32, &str); 24] = [
    (0x0008_0050, "SH"),
    (0x0008_0080, "LO"),
    (0x0008_0081, "ST"),
    (0x0008_0090, "PN"),
    (0x0008_1010, "SH"),
    (0x0008_1030, "LO"),
    (0x0008_103e, "LO"),
    (0x0008_1048, "PN"),
    (0x0008_1070, "PN"),
    (0x0010_0010, "PN"),
    (0x0010_0020, "LO"),
    (0x0010_0021, "LO"),
    (0x0010_1000, "LO"),
    (0x0010_1001, "PN"),
    (0x0010_1040, "LO"),
    (0x0010_2154, "SH"),
    (0x0010_21b0, "LO"),
    (0x0010_4000, "LO"),
    (0x0011_0010, "LO"),
    (0x0011_1001, "UN"),
    (0x0018_1030, "LO"),
    (0x0020_0010, "SH"),
    (0x0020_4000, "LO"),
    (0x0070_0084, "PN"),
];
/// UIDs, and which.
const UIDS: [(u32, &str); 5] = [
    (0x0008_0018, INSTANCE),
    (0x0008_1115, "1.2.840.99.1.7"),
    (0x0020_000d, STUDY),
    (0x0020_000e, SERIES),
    (0x0020_0052, "1.2.840.99.1.8"),
];
const FILE_NAME: &str = "CANARY_name";
const SEGMENT_NAME: &str = "CANARY_segment";
const DESCRIPTION: &str = "CANARY_description";
const WRONG_KIND: &str = "CANARY_kind";

fn canary(tag: u32) -> String {
    format!("CANARY_{tag:08x}")
}

/// A bar in slices, with canaries wherever there is room for text.
fn mask() -> Dicom {
    let [columns, rows] = [48, 34];
    let is_inside = |[x, y]: [usize; 2]| (4..44).contains(&x) && (4..30).contains(&y);
    let plane = (0..rows).flat_map(|y| (0..columns).map(move |x| [x, y])).map(|at| u16::from(is_inside(at)));
    let pixels: Vec<u16> = plane.collect();
    let place = |z: usize| [0.0, 0.0, z as f64];
    let frames = (0..8).map(|z| Frame { position: place(z), segment: 1, pixels: pixels.clone() }).collect();
    let seg = Seg { columns, rows, frames, spacing: [1.0; 3], segments: vec![1], ..Seg::small() };
    let mut dicom = seg.dicom();
    for (tag, kind) in TEXTS {
        dicom.set(text(tag, kind, canary(tag)));
    }
    for (tag, uid) in UIDS {
        dicom.set(text(tag, "UI", uid));
    }
    // In the file it is within a sequence.
    dicom.remove(0x0008_1115);
    dicom.set(sequence(0x0008_1115, vec![vec![text(0x0020_000e, "UI", UIDS[1].1)]]));
    let segment = vec![
        short(0x0062_0004, 1),
        text(0x0062_0005, "LO", SEGMENT_NAME),
        text(0x0062_0006, "ST", DESCRIPTION),
        text(0x0062_0020, "UT", DESCRIPTION),
    ];
    dicom.set(sequence(0x0062_0002, vec![segment]));
    dicom
}

/// A good mask, one that is cut off, and one with a word that is not known.
fn masks() -> [Vec<u8>; 3] {
    let good = mask().bytes();
    let mut wrong = mask();
    wrong.set(text(0x0062_0001, "CS", WRONG_KIND));
    [good.clone(), good[..good.len() - 100].to_vec(), wrong.bytes()]
}

/// What of the mask stands somewhere.
fn told(bytes: &[u8]) -> BTreeSet<String> {
    let mut wanted: Vec<String> = TEXTS.iter().map(|(tag, _)| canary(*tag)).collect();
    wanted.extend(UIDS.iter().map(|(_, uid)| format!("{uid}#")));
    wanted.extend([FILE_NAME, SEGMENT_NAME, DESCRIPTION, WRONG_KIND].map(str::to_owned));
    wanted.retain(|text| stands(bytes, text));
    wanted.into_iter().collect()
}

/// Whether a text stands somewhere; one that ends in `#` is a UID, and no longer one begins with it.
fn stands(bytes: &[u8], wanted: &str) -> bool {
    let is_uid = wanted.ends_with('#');
    let text = wanted.trim_end_matches('#').as_bytes();
    let goes_on = |end: usize| bytes.get(end).is_some_and(|next| next.is_ascii_digit() || *next == b'.');
    let mut places = bytes.windows(text.len()).enumerate().filter(|(_, part)| *part == text);
    places.any(|(at, _)| !is_uid || !goes_on(at + text.len()))
}

#[track_caller]
fn check_told(place: &str, bytes: &[u8], allowed: &[&str]) {
    let found = told(bytes);
    let more: Vec<_> = found.iter().filter(|text| !allowed.contains(&text.as_str())).collect();
    assert!(more.is_empty(), "{place} tells {more:?}");
}

/// Takes what webhooks send, for ever.
fn receiver() -> (u16, Arc<Mutex<Vec<u8>>>) {
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let port = listener.local_addr().unwrap().port();
    let kept = Arc::new(Mutex::new(Vec::new()));
    let received = Arc::clone(&kept);
    std::thread::spawn(move || {
        for stream in listener.incoming() {
            let mut stream = stream.unwrap();
            let mut chunk = [0; 16 << 10];
            stream.set_read_timeout(Some(Duration::from_millis(200))).unwrap();
            // The body may come after the head.
            while let Ok(length @ 1..) = stream.read(&mut chunk) {
                received.lock().unwrap().extend_from_slice(&chunk[..length]);
            }
            let _ = stream.write_all(b"HTTP/1.1 200 OK\r\nContent-Length: 0\r\nConnection: close\r\n\r\n");
        }
    });
    (port, kept)
}

/// The same mask through every door; paths of the jobs.
fn send_everywhere(service: &Service, mask: &[u8], hook: &str) -> Vec<String> {
    let form = [
        format!("--X\r\nContent-Disposition: form-data; name=\"mask\"; filename=\"{FILE_NAME}\"\r\n\r\n").into_bytes(),
        mask.to_vec(),
        format!("\r\n--X\r\nContent-Disposition: form-data; name=\"callback_url\"\r\n\r\n{hook}\r\n--X--\r\n")
            .into_bytes(),
    ];
    let dicomweb = serde_json::json!({"server": "main", "study": STUDY, "series": SERIES, "instance": INSTANCE});
    let source = serde_json::json!({"source": {"dicomweb": dicomweb}, "callback_url": hook});
    let raw = format!("POST /v1/jobs?callback_url={}", hook.replace(':', "%3A").replace('/', "%2F"));
    let doors = [
        (raw.as_str(), "application/dicom", mask.to_vec()),
        ("POST /v1/jobs", "multipart/form-data; boundary=X", form.concat()),
        ("POST /v1/jobs", "application/json", source.to_string().into_bytes()),
        ("POST /dicom-web/studies", MULTIPART, related(&[mask.to_vec()])),
    ];
    let mut jobs = Vec::new();
    for (n, (head, kind, body)) in doors.into_iter().enumerate() {
        let fields = format!("Cache-Control: no-cache\r\nContent-Type: {kind}\r\n");
        let (head, answer) = service.call_with(head, &fields, &body);
        // The answer of STOW is about an instance.
        let named = format!("{INSTANCE}#");
        let allowed = if n == 3 { vec![named.as_str()] } else { Vec::new() };
        check_told(&format!("the answer of door {n}"), format!("{head}{answer}").as_bytes(), &allowed);
        let found = answer.match_indices("/v1/jobs/").map(|(at, _)| answer[at..].chars().take(45).collect::<String>());
        jobs.extend(found.collect::<BTreeSet<_>>());
    }
    jobs
}

/// Every file below a folder.
fn files(folder: &Path, found: &mut Vec<(String, Vec<u8>)>) {
    for entry in std::fs::read_dir(folder).into_iter().flatten().flatten() {
        let path = entry.path();
        if path.is_dir() {
            files(&path, found);
        } else if let Ok(bytes) = std::fs::read(&path) {
            found.push((path.display().to_string(), bytes));
        }
    }
}

/// What is kept of jobs: all for DICOM results, and by their study a PACS finds them.
fn check_kept(data: &Path) {
    let study = format!("{STUDY}#");
    let mut kept = Vec::new();
    files(data, &mut kept);
    assert!(kept.iter().any(|(path, bytes)| path.ends_with("/record") && stands(bytes, &canary(0x0010_0010))));
    for (path, bytes) in kept {
        let is_for_dicom = path.contains("/masks/") || path.ends_with("/record") || path.ends_with(".dcm");
        let allowed = [("thickness.json", SEGMENT_NAME), ("/db/jobs.sqlite", &study), ("/db/jobs.sqlite-wal", &study)];
        let allowed = allowed.iter().filter(|(end, _)| path.ends_with(end)).map(|(_, text)| *text);
        if !is_for_dicom {
            check_told(&path, &bytes, &allowed.collect::<Vec<_>>());
        }
    }
}

/// What is left of deleted jobs: nothing, what rows left within seconds.
fn check_gone(data: &Path) {
    let study = format!("{STUDY}#");
    let deadline = Instant::now() + Duration::from_secs(30);
    let mut left = Vec::new();
    loop {
        left.clear();
        files(data, &mut left);
        if Instant::now() > deadline || left.iter().all(|(_, bytes)| !stands(bytes, &study)) {
            break;
        }
        std::thread::sleep(Duration::from_millis(200));
    }
    left.iter().for_each(|(path, bytes)| check_told(path, bytes, &[]));
}

#[tokio::test(flavor = "multi_thread")]
async fn text_of_a_patient_goes_nowhere_but_into_dicom_results() {
    let folder = tempfile::tempdir().unwrap();
    let [data, secret] = ["data", "secret"].map(|name| folder.path().join(name));
    std::fs::write(&secret, "whsec_MfKQ9r8GKYqrTwjUPD8ILPZIo2LaLaSw").unwrap();
    let masks = masks();
    let pacs = FakePacs::start(masks.iter().map(|mask| Reply::parts(std::slice::from_ref(mask))).collect()).await;
    let (port, hooks) = receiver();
    let hook = format!("http://127.0.0.1:{port}/hook");
    let pacs = format!("main={}", pacs.url);
    let options = [
        "--pacs",
        &pacs,
        "--webhook-targets",
        &hook,
        "--webhook-networks",
        "127.0.0.0/8",
        "--webhook-secret-file",
        secret.to_str().unwrap(),
    ];
    let service = Service::start_with(&data, &options, &[("RUST_LOG", "trace")]);
    let jobs: Vec<String> = masks.iter().flat_map(|mask| send_everywhere(&service, mask, &hook)).collect();
    // That a file is cut off in its pixels is found when it is read.
    assert!(jobs.len() >= 8, "{jobs:?}");
    for (n, job) in jobs.iter().enumerate() {
        let ended = service.ended(job);
        assert_eq!(ended["state"], if n < 4 { "succeeded" } else { "failed" }, "{ended}");
        for path in [job.clone(), format!("{job}/events")] {
            let (head, body) = service.call(&format!("GET {path}"), b"");
            check_told(&path, format!("{head}{body}").as_bytes(), &[]);
        }
    }
    for path in ["/v1/jobs", "/metrics", "/readyz", "/v1/limits"] {
        check_told(path, service.call(&format!("GET {path}"), b"").1.as_bytes(), &[]);
    }
    // What results are for: the first names the patient, the second has no more than names of structures.
    for (name, is_named) in [("report.sr.dcm", true), ("thickness.json", false), ("thickness.csv", false)] {
        let (_, body) = service.call(&format!("GET {}/results/{name}", jobs[0]), b"");
        assert_eq!(stands(body.as_bytes(), &canary(0x0010_0010)), is_named, "{name}");
        if !is_named {
            check_told(name, body.as_bytes(), &[SEGMENT_NAME]);
        }
    }
    let deadline = Instant::now() + Duration::from_secs(20);
    while hooks.lock().unwrap().windows(9).filter(|part| part == b"job.ended").count() < 6 {
        assert!(Instant::now() < deadline, "webhooks: {}", String::from_utf8_lossy(&hooks.lock().unwrap()));
        std::thread::sleep(Duration::from_millis(20));
    }
    check_told("a webhook", &hooks.lock().unwrap(), &[]);
    check_told("the log", service.log().as_bytes(), &[]);
    check_kept(&data);
    // With the job all of it goes.
    jobs.iter().for_each(|job| assert!(service.call(&format!("DELETE {job}"), b"").0.contains(" 204 ")));
    check_gone(&data);
}

#[test]
fn the_command_line_tells_nothing_of_a_patient() {
    let folder = tempfile::tempdir().unwrap();
    let [file, out] = ["mask.dcm", "out"].map(|name| folder.path().join(name));
    let mut results = Vec::new();
    for mask in masks() {
        std::fs::write(&file, mask).unwrap();
        let mut command = Command::new(PROGRAM);
        let command = command.arg("run").arg(&file).arg("--out").arg(&out).arg("--json").env("RUST_LOG", "trace");
        let done = command.output().unwrap();
        assert!(matches!(done.status.code(), Some(0 | 3)), "{done:?}");
        check_told("the command line", &[done.stdout, done.stderr].concat(), &[SEGMENT_NAME]);
        files(&out, &mut results);
    }
    assert!(results.len() >= 4);
    results.iter().for_each(|(path, bytes)| check_told(path, bytes, &[SEGMENT_NAME]));
}
