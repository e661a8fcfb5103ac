//! Clients that lie, dawdle and flood, a disk that is full, and text that must go nowhere: the service
//! refuses with a reason, in time, in little memory, and honest clients do not notice.

use std::io::{Read, Write};
use std::net::TcpStream;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::{Duration, Instant};

use flate2::Compression;
use flate2::write::GzEncoder;
use serde_json::Value;
use tempfile::TempDir;

use crate::help::left_out::left_out;
use crate::help::process::{Service, run, sample_of};
use crate::help::support;
use crate::soak::{is_long, tell};

/// How long a refusal may take.
const IN_TIME: Duration = Duration::from_secs(2);
/// How much the resident memory of the service may rise, KiB.
const RISE_KIB: u64 = 64 << 10;

fn gzip(bytes: &[u8]) -> Vec<u8> {
    let mut encoder = GzEncoder::new(Vec::new(), Compression::best());
    encoder.write_all(bytes).unwrap();
    encoder.finish().unwrap()
}

/// `mib` MiB of zeros: one member repeated, which is one file to gzip.
fn gzip_zeros(mib: usize) -> Vec<u8> {
    gzip(&vec![0; 16 << 20]).repeat(mib / 16)
}

/// A good header with some fields overwritten, and its voxels.
fn with(fields: &[(usize, &[u8])]) -> Vec<u8> {
    let mut file = support::mask();
    for (at, bytes) in fields {
        file[*at..*at + bytes.len()].copy_from_slice(bytes);
    }
    file
}

fn dims(sizes: [i16; 3]) -> Vec<u8> {
    sizes.iter().flat_map(|size| size.to_le_bytes()).collect()
}

/// Files that are refused, in the upload or in the job.
fn bad_files() -> Vec<(&'static str, Vec<u8>)> {
    let good = support::mask();
    let large = dims([32_767, 32_767, 32_767]);
    let whole = dims([700, 700, 700]);
    let (minus, nan, far) = ((-3_i16).to_le_bytes(), f32::NAN.to_le_bytes(), 1e30_f32.to_le_bytes());
    let mut bad_sum = gzip(&good);
    let at = bad_sum.len() - 6;
    bad_sum[at] ^= 0xff;
    vec![
        ("a header that claims 35 trillion voxels", with(&[(42, &large)])),
        ("a header that claims 343 million voxels", with(&[(42, &whole)])),
        ("a dimension of -3", with(&[(42, &minus)])),
        ("voxels at NaN", with(&[(108, &nan)])),
        ("voxels at 1e30", with(&[(108, &far)])),
        ("voxels in another file", with(&[(344, b"ni1\0")])),
        ("bits that do not fit the type", with(&[(72, &64_i16.to_le_bytes())])),
        ("a colour image", with(&[(70, &128_i16.to_le_bytes())])),
        ("a checksum that is wrong", bad_sum),
        ("gzip of gzip", gzip(&gzip(&good))),
        ("gzip of gzip of a bomb", gzip(&gzip_zeros(1024))),
        ("gzip cut short", gzip(&good)[..60].to_vec()),
        ("ten gigabytes of zeros", gzip_zeros(10 << 10)),
        ("ten gigabytes behind a mask", [gzip(&good), gzip_zeros(10 << 10)].concat()),
        ("343 million voxels of nothing", [gzip(&with(&[(42, &whole)])), gzip_zeros(336)].concat()),
        ("an image of text", vec![b'<'; 4000]),
        ("a mask without a voxel", with(&[(352 + 21, &[0])])),
    ]
}

/// Uploads a file; the problem that it ended with, and how long that took.
fn refused(service: &Service, file: &[u8]) -> (Value, Duration) {
    let begun = Instant::now();
    let (head, body) = service.call("POST /v1/jobs", file);
    let answer: Value = serde_json::from_str(&body).unwrap();
    if head.starts_with("HTTP/1.1 202") {
        let ended = service.ended(answer["links"]["self"].as_str().unwrap());
        return (ended["error"].clone(), begun.elapsed());
    }
    (answer, begun.elapsed())
}

#[test]
fn hostile_files_are_refused_in_time_and_in_little_memory() {
    let dir = TempDir::new().unwrap();
    let mask = sample_of(dir.path(), &["slab", "--spacing", "2"]);
    let service = Service::start(&dir.path().join("data"), &["--workers", "2"]);
    for _ in 0..4 {
        assert_eq!(service.ended(&service.submit(&mask))["state"], "succeeded");
    }
    let (before, _) = service.memory_kib();
    let mut slowest = (Duration::ZERO, "");
    for (what, file) in bad_files() {
        let (problem, took) = refused(&service, &file);
        let status = problem["status"].as_u64().unwrap_or(0);
        assert!((400..500).contains(&status), "{what}: {problem}");
        // Unoptimised, inflating takes longer.
        assert!(took < IN_TIME || !is_long(), "{what} took {took:?}");
        slowest = slowest.max((took, what));
    }
    let (_, peak) = service.memory_kib();
    let rise = peak.saturating_sub(before);
    tell(&format!("hostile files: slowest {:?} ({}), memory rose by {} KiB from {before}", slowest.0, slowest.1, rise));
    assert!(rise < RISE_KIB, "{rise} KiB");
    assert_eq!(service.ended(&service.submit(&mask))["state"], "succeeded");
}

#[test]
fn deeply_nested_parameters_are_refused() {
    let dir = TempDir::new().unwrap();
    let service = Service::start(dir.path(), &[]);
    for (open, close) in [("[", "]"), ("{\"a\":", "}")] {
        let deep = format!("{}1{}", open.repeat(9000), close.repeat(9000));
        let body = format!("--X\r\nContent-Disposition: form-data; name=\"params\"\r\n\r\n{deep}\r\n--X--\r\n");
        let head = "POST /v1/jobs HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\n\
                    Content-Type: multipart/form-data; boundary=X\r\n";
        let (answer, _) = talk(&service, &[format!("{head}Content-Length: {}\r\n\r\n{body}", body.len()).as_bytes()]);
        assert!(answer.starts_with("HTTP/1.1 400") && answer.contains("malformed_params"), "{answer}");
    }
}

/// Writes pieces, then reads until the service closes the connection.
fn talk(service: &Service, pieces: &[&[u8]]) -> (String, Duration) {
    let begun = Instant::now();
    let mut stream = TcpStream::connect(service.address).unwrap();
    stream.set_read_timeout(Some(Duration::from_secs(60))).unwrap();
    for piece in pieces {
        if stream.write_all(piece).is_err() {
            break;
        }
    }
    let mut answer = Vec::new();
    let _ = stream.read_to_end(&mut answer);
    (String::from_utf8_lossy(&answer).into_owned(), begun.elapsed())
}

#[test]
fn slow_lying_and_idle_clients_harm_nobody() {
    let dir = TempDir::new().unwrap();
    let mask = sample_of(dir.path(), &["ellipsoid", "--spacing", "2"]);
    let seconds = if is_long() { "5" } else { "1" };
    let options = ["--upload-idle-seconds", seconds, "--header-seconds", seconds, "--upload-seconds", "6"];
    let service = Service::start(&dir.path().join("data"), &options);
    service.ended(&service.submit(&mask));
    let (before, _) = service.memory_kib();
    let idle = open_many(&service, if is_long() { 2000 } else { 300 });
    let post = "POST /v1/jobs HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\n";
    std::thread::scope(|scope| {
        let lie = scope.spawn(|| talk(&service, &[format!("{post}Content-Length: 4294967296\r\n\r\n").as_bytes()]));
        let endless = scope.spawn(|| {
            let chunk = [b"10000\r\n".to_vec(), vec![b'n'; 65_536], b"\r\n".to_vec()].concat();
            let mut pieces = vec![format!("{post}Transfer-Encoding: chunked\r\n\r\n").into_bytes()];
            pieces.resize(4000, chunk);
            talk(&service, &pieces.iter().map(Vec::as_slice).collect::<Vec<_>>())
        });
        let body = scope.spawn(|| drip(&service, &format!("{post}Content-Length: 1000\r\n\r\n")));
        let headers = scope.spawn(|| drip(&service, "GET /livez HTTP/1.1\r\nX: "));
        // Meanwhile one who means well.
        let mut slowest = Duration::ZERO;
        for _ in 0..20 {
            let begun = Instant::now();
            let job = service.submit(&mask);
            assert!(service.call(&format!("GET {job}"), b"").0.starts_with("HTTP/1.1 200"));
            slowest = slowest.max(begun.elapsed());
        }
        let (answer, took) = lie.join().unwrap();
        assert!(answer.starts_with("HTTP/1.1 413") && took < IN_TIME, "{took:?} {answer}");
        let (answer, took) = endless.join().unwrap();
        assert!((answer.is_empty() || answer.starts_with("HTTP/1.1 415")) && took < 2 * IN_TIME, "{took:?} {answer}");
        let (answer, took) = body.join().unwrap();
        assert!(answer.starts_with("HTTP/1.1 408") && took < Duration::from_secs(15), "{took:?} {answer}");
        let (_, took) = headers.join().unwrap();
        assert!(took < Duration::from_secs(15), "{took:?}");
        tell(&format!(
            "beside {} idle connections and four attacks: slowest submission with status {slowest:?}",
            idle.len()
        ));
        assert!(slowest < IN_TIME, "{slowest:?}");
    });
    let (_, peak) = service.memory_kib();
    tell(&format!("idle, slow and lying clients: memory rose by {} KiB from {before}", peak.saturating_sub(before)));
    assert!(peak.saturating_sub(before) < RISE_KIB);
}

fn open_many(service: &Service, count: usize) -> Vec<TcpStream> {
    let open = |_| TcpStream::connect(service.address).ok();
    (0..count).filter_map(open).collect()
}

/// A byte every 100 ms, until the service has had enough.
fn drip(service: &Service, head: &str) -> (String, Duration) {
    let begun = Instant::now();
    let mut stream = TcpStream::connect(service.address).unwrap();
    stream.write_all(head.as_bytes()).unwrap();
    let file = support::mask();
    for byte in &file[..150] {
        std::thread::sleep(Duration::from_millis(100));
        if stream.write_all(&[*byte]).is_err() {
            break;
        }
    }
    let mut answer = Vec::new();
    let _ = stream.read_to_end(&mut answer);
    (String::from_utf8_lossy(&answer).into_owned(), begun.elapsed())
}

/// A file system of 64 MiB, unmounted when dropped.
struct SmallDisk(PathBuf);

impl SmallDisk {
    fn mount(folder: &Path) -> Option<Self> {
        std::fs::create_dir_all(folder).unwrap();
        let mounted = Command::new("mount").args(["-t", "tmpfs", "-o", "size=64m", "tmpfs"]).arg(folder).output();
        mounted.is_ok_and(|output| output.status.success()).then(|| Self(folder.to_owned()))
    }

    /// Leaves room for so many bytes.
    fn fill(&self, left: u64) {
        let _ = std::fs::remove_file(self.0.join("filler"));
        let mut filler = std::fs::File::create(self.0.join("filler")).unwrap();
        let free = medialrep::jobs::store::blobs::room(&self.0).unwrap().free_bytes;
        let block = vec![1; 4096];
        for _ in 0..free.saturating_sub(left) / 4096 {
            if filler.write_all(&block).is_err() {
                break;
            }
        }
    }

    fn empty(&self) {
        let _ = std::fs::remove_file(self.0.join("filler"));
    }
}

impl Drop for SmallDisk {
    fn drop(&mut self) {
        let _ = Command::new("umount").arg("-l").arg(&self.0).status();
    }
}

#[test]
fn a_full_disk_is_told_at_every_write_and_harms_nothing() {
    let dir = TempDir::new().unwrap();
    let Some(disk) = SmallDisk::mount(&dir.path().join("disk")) else {
        return left_out("a small file system cannot be mounted here");
    };
    let mask = sample_of(dir.path(), &["slab", "--spacing", "2"]);
    let data = disk.0.join("data");
    let service = Service::start(&data, &[]);
    let good = service.submit(&mask);
    let results: u64 =
        service.ended(&good)["results"].as_array().unwrap().iter().map(|r| r["bytes"].as_u64().unwrap()).sum();
    // From no room at all to room for the results twice, as files of the run and as stored, and as much for the record
    // that is kept beside them. Small ones are looked at more closely: a small lattice fills little.
    let steps = if is_long() { 48 } else { 12 };
    let (mut refused, mut failed, mut waited, mut done) = (0, 0, 0, 0);
    for step in 0..=steps {
        disk.fill((4 * results + (2 << 20)) * step * step / (steps * steps));
        let (head, body) = service.call("POST /v1/jobs", &mask);
        let answer: Value = serde_json::from_str(&body).unwrap();
        if head.starts_with("HTTP/1.1 202") {
            let job = answer["links"]["self"].as_str().unwrap().to_owned();
            let now = service.job_soon(&job);
            match now["state"].as_str().unwrap() {
                "succeeded" => done += 1,
                "failed" => {
                    assert_eq!(now["error"]["code"], "storage_full", "{now}");
                    failed += 1;
                }
                // Not even that can be written: it goes on when there is room.
                _ => {
                    disk.empty();
                    service.ended(&job);
                    waited += 1;
                }
            }
        } else {
            let is_told = answer["code"] == "storage_full" || answer["code"] == "storage_low";
            assert!(head.starts_with("HTTP/1.1 507") && is_told, "{step}: {head} {body}");
            refused += 1;
        }
        // What is there can be read.
        assert!(service.call(&format!("GET {good}/results/model.glb"), b"").0.starts_with("HTTP/1.1 200"));
        disk.empty();
        let now = service.submit(&mask);
        assert_eq!(service.ended(&now)["state"], "succeeded", "with room again");
        for job in service.json("GET /v1/jobs")["jobs"].as_array().unwrap() {
            let path = job["links"]["self"].as_str().unwrap();
            if path != good {
                assert!(service.call(&format!("DELETE {path}"), b"").0.starts_with("HTTP/1.1 204"));
            }
        }
    }
    tell(&format!(
        "full disk at {} levels: {refused} refused with 507, {failed} failed, {waited} waited, {done} had room",
        steps + 1
    ));
    assert!(refused > 0 && failed + waited > 0 && done > 0, "{refused} {failed} {waited} {done}");
    let checked = run(&["check", "--min-free-mib", "0"], &data);
    assert_eq!(checked.status.code(), Some(0), "{}", String::from_utf8_lossy(&checked.stdout));
}

#[test]
fn a_job_can_be_deleted_when_nothing_of_the_disk_is_left() {
    let dir = TempDir::new().unwrap();
    let Some(disk) = SmallDisk::mount(&dir.path().join("disk")) else {
        return left_out("a small file system cannot be mounted here");
    };
    let mask = sample_of(dir.path(), &["slab", "--spacing", "2"]);
    let data = disk.0.join("data");
    let service = Service::start(&data, &[]);
    let jobs = [service.submit(&mask), service.submit(&mask)];
    for job in &jobs {
        service.ended(job);
    }
    let deadline = Instant::now() + Duration::from_secs(15);
    while !data.join("reserve").exists() {
        assert!(Instant::now() < deadline, "no room is kept back");
        std::thread::sleep(Duration::from_millis(50));
    }
    disk.fill(0);
    for job in &jobs {
        let (head, body) = service.call(&format!("DELETE {job}"), b"");
        assert!(head.starts_with("HTTP/1.1 204"), "{head} {body}");
    }
}

#[test]
fn uploads_whose_length_is_not_told_stop_at_the_watermark() {
    let dir = TempDir::new().unwrap();
    let Some(disk) = SmallDisk::mount(&dir.path().join("disk")) else {
        return left_out("a small file system cannot be mounted here");
    };
    let service = Service::start(&disk.0.join("data"), &["--min-free-mib", "24"]);
    // A gzip head, so that it is taken for a mask, and noise.
    let mut noise: u32 = 1;
    let mut chunk = vec![0; 1 << 20];
    for byte in &mut chunk {
        noise = noise.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        *byte = noise.to_be_bytes()[0];
    }
    let upload = || {
        let mut stream = TcpStream::connect(service.address).unwrap();
        let _ = stream.write_all(
            b"POST /v1/jobs HTTP/1.1\r\nHost: localhost\r\nTransfer-Encoding: chunked\r\n\r\n2\r\n\x1f\x8b\r\n",
        );
        for _ in 0..32 {
            let head = format!("{:x}\r\n", chunk.len());
            let sent = [head.as_bytes(), &chunk[..], b"\r\n"].into_iter().try_for_each(|part| stream.write_all(part));
            if sent.is_err() {
                break;
            }
        }
        let mut answer = [0; 512];
        let count = stream.read(&mut answer).unwrap_or(0);
        String::from_utf8_lossy(&answer[..count]).into_owned()
    };
    let least = std::thread::scope(|scope| {
        let uploads: Vec<_> = (0..4).map(|_| scope.spawn(upload)).collect();
        let mut least = u64::MAX;
        while uploads.iter().any(|upload| !upload.is_finished()) {
            least = least.min(medialrep::jobs::store::blobs::room(&disk.0).unwrap().free_bytes);
            std::thread::sleep(Duration::from_millis(2));
        }
        let answers: Vec<String> = uploads.into_iter().map(|upload| upload.join().unwrap()).collect();
        assert!(answers.iter().any(|answer| answer.starts_with("HTTP/1.1 507")), "{answers:?}");
        least
    });
    // Each may have written a mebibyte since it looked, and what it holds in its hands.
    assert!(least >= 16 << 20, "{} MiB were left", least >> 20);
    assert!(service.call("GET /livez", b"").0.starts_with("HTTP/1.1 200"));
}

#[test]
fn text_of_a_patient_leaves_by_no_door() {
    let canary = support::CANARY;
    let dir = TempDir::new().unwrap();
    let data = dir.path().join("data");
    let service = Service::start(&data, &[]);
    // In the header's text, in a label, in the key, in the file's name, in paths and queries.
    let mask = support::mask();
    let form = |content: &[u8]| {
        let label = format!("{{\"{canary}\":\"{canary}\"}}");
        let mut body = format!(
            "--X\r\nContent-Disposition: form-data; name=\"labels\"\r\n\r\n{label}\r\n\
             --X\r\nContent-Disposition: form-data; name=\"mask\"; filename=\"{canary}.nii\"\r\n\r\n"
        )
        .into_bytes();
        body.extend(content);
        body.extend(b"\r\n--X--\r\n");
        body
    };
    let mut errors = String::new();
    for content in [&mask[..], &mask[..300], canary.as_bytes()] {
        let body = form(content);
        let head = format!(
            "POST /v1/jobs HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\nIdempotency-Key: {canary}{}\r\n\
             Content-Type: multipart/form-data; boundary=X\r\nContent-Length: {}\r\n\r\n",
            content.len(),
            body.len()
        );
        let (answer, _) = talk(&service, &[head.as_bytes(), &body]);
        if answer.starts_with("HTTP/1.1 202") {
            let job: Value = serde_json::from_str(answer.split("\r\n\r\n").nth(1).unwrap()).unwrap();
            errors += &service.ended(job["links"]["self"].as_str().unwrap())["error"].to_string();
        } else {
            errors += &answer;
        }
    }
    for path in [format!("/v1/jobs/{canary}"), format!("/v1/jobs?x={canary}"), format!("/{canary}")] {
        errors += &service.call(&format!("GET {path}"), b"").1;
    }
    errors += &service.call(&format!("POST /v1/jobs?params={canary}"), &mask).1;
    errors += &service.call(&format!("POST /v1/jobs?labels={canary}"), &mask).1;
    errors += &service.call(&format!("POST /v1/jobs?callback_url={canary}"), &mask).1;
    let metrics = service.call("GET /metrics", b"").1;
    let audit = std::fs::read_to_string(data.join("audit/audit.jsonl")).unwrap();
    for (what, text) in [("errors", &errors), ("metrics", &metrics), ("audit", &audit), ("log", &service.log())] {
        assert!(!text.is_empty() && !text.contains(canary), "{what}: {text}");
    }
    assert!(errors.contains("not_nifti"));
}
