//! Segmentations that an archive stores here: each a job, and an answer as DICOMweb has it.

use axum::body::{Body, Bytes};
use axum::http::Request;
use futures_util::{StreamExt, stream};
use serde_json::Value;
use std::convert::Infallible;
use std::time::{Duration, Instant};

use crate::help::dicom_bytes::{Seg, text};
use crate::help::pacs::{MULTIPART, related};
use crate::help::support::{Answer, CANARY, Server, limits, logged, mask, writes};

const SEGMENTATION: &str = "1.2.840.10008.5.1.4.1.1.66.4";
const IMAGE: &str = "1.2.840.10008.5.1.4.1.1.2";
const STUDY: &str = "1.2.840.99.7";

async fn server() -> Server {
    let mut limits = limits();
    limits.upload.max_bytes = 16 << 10;
    limits.queue.bytes = 64 << 10;
    Server::open_with(tempfile::TempDir::new().unwrap(), limits, None).await
}

/// A segmentation that says that it is of this class.
fn file(class: &str, instance: &str) -> Vec<u8> {
    let mut dicom = Seg::small().dicom();
    dicom.set(text(0x0008_0016, "UI", class));
    dicom.set(text(0x0008_0018, "UI", instance));
    dicom.set(text(0x0020_000d, "UI", STUDY));
    dicom.bytes()
}

fn seg(instance: &str) -> Vec<u8> {
    file(SEGMENTATION, instance)
}

async fn store(server: &Server, path: &str, body: Body) -> Answer {
    let request = Request::post(path).header("content-type", MULTIPART).body(body).unwrap();
    let answer = server.send(request).await;
    assert!(!answer.text().contains(CANARY), "{}", answer.text());
    answer
}

async fn store_files(server: &Server, files: &[Vec<u8>]) -> Answer {
    store(server, "/dicom-web/studies", related(files).into()).await
}

/// The items of a sequence of the answer.
fn items(answer: &Answer, tag: &str) -> Vec<Value> {
    answer.json()[tag]["Value"].as_array().cloned().unwrap_or_default()
}

/// The first value of an element of an item.
fn value<'a>(item: &'a Value, tag: &str) -> &'a Value {
    &item[tag]["Value"][0]
}

#[tokio::test]
async fn every_segmentation_becomes_a_job() {
    let mut server = server().await;
    let answer = store_files(&server, &[seg("1.2.3"), seg("1.2.4")]).await;
    assert_eq!(answer.status, 200, "{}", answer.text());
    assert_eq!(answer.header("content-type"), "application/dicom+json");
    let accepted = items(&answer, "00081199");
    let instances: Vec<_> = accepted.iter().map(|item| value(item, "00081155").clone()).collect();
    assert_eq!(instances, ["1.2.3", "1.2.4"]);
    assert!(accepted.iter().all(|item| value(item, "00081150") == SEGMENTATION));
    let jobs: Vec<_> = accepted.iter().map(|item| value(item, "00081190").as_str().unwrap()).collect();
    let links = jobs.iter().map(|job| format!("<{job}>; rel=\"monitor\"")).collect::<Vec<_>>().join(", ");
    assert_eq!(answer.header("link"), links);
    server.run(&writes());
    for job in jobs {
        let ended = server.job_when(job, |now| now["state"] == "succeeded").await;
        assert_eq!(ended["mask"]["bytes"], seg("1.2.3").len());
    }
}

#[tokio::test]
async fn a_request_in_small_chunks_is_the_same() {
    let server = server().await;
    let body = related(&[seg("1.2.3"), file(IMAGE, "1.2.5"), seg("1.2.4")]);
    let chunks: Vec<_> = body.chunks(11).map(Bytes::copy_from_slice).map(Ok::<_, Infallible>).collect();
    let answer = store(&server, "/dicom-web/studies", Body::from_stream(stream::iter(chunks))).await;
    assert_eq!(answer.status, 202, "{}", answer.text());
    assert_eq!((items(&answer, "00081199").len(), items(&answer, "00081198").len()), (2, 1));
}

#[tokio::test]
async fn what_is_no_segmentation_is_not_stored_and_named() {
    let server = server().await;
    let damaged = {
        let mut dicom = Seg::small().dicom();
        dicom.set(text(0x0008_0018, "UI", "1.2.6"));
        dicom.remove(0x0028_0010);
        dicom.bytes()
    };
    let compressed = {
        let mut dicom = Seg::small().dicom();
        dicom.transfer = "1.2.840.10008.1.2.4.90".to_owned();
        dicom.set(text(0x0008_0018, "UI", "1.2.7"));
        dicom.bytes()
    };
    let files = [file(IMAGE, "1.2.5"), damaged, compressed, mask(), b"no file".to_vec(), Vec::new()];
    let answer = store_files(&server, &files).await;
    assert_eq!(answer.status, 409, "{}", answer.text());
    let failed = items(&answer, "00081198");
    let told: Vec<_> = failed.iter().map(|item| (value(item, "00081155"), value(item, "00081197"))).collect();
    let expected =
        [("1.2.5", 0x0122), ("1.2.6", 0xC000), ("1.2.7", 0xC122)].map(|(uid, reason)| (uid.into(), reason.into()));
    assert_eq!(told, expected.iter().map(|(uid, reason): &(Value, Value)| (uid, reason)).collect::<Vec<_>>());
    // Nothing is known of the others but that they came.
    let unknown = items(&answer, "0008119A");
    assert_eq!(unknown.iter().map(|item| value(item, "00081197")).collect::<Vec<_>>(), [0xC000; 3]);
    assert!(server.files().is_empty() && !logged().contains(CANARY));
}

#[tokio::test]
async fn a_request_that_is_sent_again_makes_no_more_jobs() {
    let server = server().await;
    let first = store_files(&server, &[seg("1.2.3")]).await;
    let again = store_files(&server, &[seg("1.2.3"), seg("1.2.4")]).await;
    assert_eq!(again.status, 200, "{}", again.text());
    let job = |answer: &Answer| value(&items(answer, "00081199")[0], "00081190").clone();
    assert_eq!(job(&first), job(&again));
    assert_eq!(server.get("/v1/jobs").await.json()["jobs"].as_array().unwrap().len(), 2);
}

#[tokio::test]
async fn an_instance_of_another_study_is_not_stored() {
    let server = server().await;
    let path = |study: &str| format!("/dicom-web/studies/{study}");
    let answer = store(&server, &path(STUDY), related(&[seg("1.2.3")]).into()).await;
    assert_eq!(answer.status, 200, "{}", answer.text());
    let answer = store(&server, &path("1.2.840.99.8"), related(&[seg("1.2.4")]).into()).await;
    assert_eq!(answer.status, 409, "{}", answer.text());
    assert_eq!(value(&items(&answer, "00081198")[0], "00081197"), 0xC000);
    let answer = store(&server, &path("1..2"), related(&[seg("1.2.4")]).into()).await;
    answer.is_problem(422, "invalid_uid");
    let answer = store(&server, "/dicom-web/studies/%FF", related(&[seg("1.2.4")]).into()).await;
    answer.is_problem(422, "invalid_uid");
}

#[tokio::test]
async fn what_there_is_no_room_for_is_refused_one_by_one() {
    let server = server().await;
    let files: Vec<_> = (0..7).map(|n| seg(&format!("1.2.{n}"))).collect();
    let answer = store_files(&server, &files).await;
    assert_eq!(answer.status, 202, "{}", answer.text());
    let failed = items(&answer, "00081198");
    assert_eq!((items(&answer, "00081199").len(), failed.len()), (5, 2));
    assert!(failed.iter().all(|item| value(item, "00081197") == 0xA700));
    // Nothing is read when nothing can be accepted.
    store_files(&server, &files).await.is_problem(503, "queue_full");
}

#[tokio::test]
async fn a_disk_that_fills_during_a_request_is_looked_at_for_each_instance() {
    /// Room above what is to be left free; others write to the same disk.
    const ROOM_BYTES: u64 = 128 << 20;
    let dir = tempfile::TempDir::new().unwrap();
    let disk = rustix::fs::statvfs(dir.path()).unwrap();
    let mut limits = limits();
    limits.min_free_bytes = disk.f_bavail * disk.f_frsize - ROOM_BYTES;
    let file = std::fs::File::create(dir.path().join("of_somebody_else")).unwrap();
    let server = Server::open_with(dir, limits, None).await;
    let [first, second] = ["1.2.3", "1.2.4"].map(|instance| related(&[seg(instance)]));
    // The boundary that ends the first one comes with it.
    let first = Bytes::from([first.strip_suffix(b"--\r\n").unwrap(), b"\r\n"].concat());
    let second = Bytes::from(second.strip_prefix(b"--X\r\n").unwrap().to_vec());
    let body = stream::unfold(0, move |sent| {
        let (chunk, file) = ([first.clone(), second.clone()].get(sent).cloned(), file.try_clone().unwrap());
        async move {
            if sent == 1 {
                rustix::fs::fallocate(&file, rustix::fs::FallocateFlags::empty(), 0, 2 * ROOM_BYTES).unwrap();
            }
            chunk.map(|chunk| (Ok::<_, Infallible>(chunk), sent + 1))
        }
    });
    let answer = store(&server, "/dicom-web/studies", Body::from_stream(body)).await;
    assert_eq!(answer.status, 202, "{}", answer.text());
    assert_eq!(value(&items(&answer, "00081199")[0], "00081155"), "1.2.3");
    assert_eq!(value(&items(&answer, "00081198")[0], "00081197"), 0xA700);
    assert_eq!(server.files().len(), 1);
}

#[tokio::test]
async fn an_instance_that_is_too_large_does_not_stop_the_next() {
    let server = server().await;
    let large = [seg("1.2.3"), vec![0; 20 << 10]].concat();
    let answer = store_files(&server, &[large, seg("1.2.4")]).await;
    assert_eq!(answer.status, 202, "{}", answer.text());
    assert_eq!(value(&items(&answer, "00081198")[0], "00081197"), 0xA700);
    assert_eq!(value(&items(&answer, "00081199")[0], "00081155"), "1.2.4");
}

#[tokio::test]
async fn requests_that_are_no_stow_are_told_so() {
    let server = server().await;
    let request = Request::post("/dicom-web/studies").body(Body::from(seg("1.2.3"))).unwrap();
    server.send(request).await.is_problem(415, "not_multipart_dicom");
    let whole = related(&[seg("1.2.3")]);
    let cut = whole[..whole.len() - 4].to_vec();
    store(&server, "/dicom-web/studies", cut.into()).await.is_problem(400, "upload_interrupted");
    let large = [b"--X\r\n\r\n", seg("1.2.3").as_slice(), &[0; 20 << 10]].concat();
    store(&server, "/dicom-web/studies", large.into()).await.is_problem(400, "upload_interrupted");
    store_files(&server, &[]).await.is_problem(400, "empty_upload");
    let text = "no boundary".repeat(1000);
    store(&server, "/dicom-web/studies", text.into()).await.is_problem(400, "invalid_multipart");
    let endless = related(&vec![file(IMAGE, "1.2.3"); 100]);
    store(&server, "/dicom-web/studies", endless.into()).await.is_problem(413, "upload_too_large");
    assert!(server.files().is_empty());
}

#[tokio::test]
async fn a_client_that_falls_silent_is_cut_off() {
    let server = server().await;
    let whole = related(&[seg("1.2.3")]);
    for length in [3, 200, 1000] {
        let first = Bytes::copy_from_slice(&whole[..length]);
        let silent = stream::unfold(Some(first), |first| async {
            let Some(first) = first else { return std::future::pending().await };
            Some((Ok::<_, Infallible>(first), None))
        });
        let answer = store(&server, "/dicom-web/studies", Body::from_stream(silent)).await;
        answer.is_problem(408, "upload_too_slow");
    }
}

#[tokio::test]
async fn a_client_that_drips_is_cut_off_when_the_time_of_the_request_is_over() {
    let mut limits = limits();
    limits.upload.total = Duration::from_millis(500);
    let server = Server::open_with(tempfile::TempDir::new().unwrap(), limits, None).await;
    let body = related(&vec![file(IMAGE, "1.2.3"); 20]);
    // Each chunk ends one part and begins the next, so that nobody ever waits for the beginning of one.
    let (first, rest) = body.split_at(body.len() / 40);
    let chunks: Vec<_> = [first].into_iter().chain(rest.chunks(body.len() / 20)).map(Bytes::copy_from_slice).collect();
    let dripping = stream::iter(chunks).then(|chunk| async {
        tokio::time::sleep(Duration::from_millis(100)).await;
        Ok::<_, Infallible>(chunk)
    });
    let begun = Instant::now();
    let answer = store(&server, "/dicom-web/studies", Body::from_stream(dripping)).await;
    answer.is_problem(408, "upload_too_slow");
    assert!(begun.elapsed() < Duration::from_millis(1500), "{:?}", begun.elapsed());
}
