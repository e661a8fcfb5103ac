//! `POST /v1/jobs`: what is accepted, what is refused, and what is left on disk.

use std::convert::Infallible;
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};

use axum::body::{Body, Bytes};
use axum::http::{Method, Request};
use futures_util::stream;
use medialrep::jobs::place::Place;

use crate::help::dicom_bytes::{Dicom, Seg};
use crate::help::support::{CANARY, Server, id_of, logged, mask, writes};

/// A form of parts: name, file name, content.
fn form(parts: &[(&str, Option<&str>, &[u8])]) -> Request<Body> {
    let mut body = Vec::new();
    for (name, file, content) in parts {
        let file = file.map(|file| format!("; filename=\"{file}\"")).unwrap_or_default();
        body.extend(format!("--XX\r\nContent-Disposition: form-data; name=\"{name}\"{file}\r\n\r\n").into_bytes());
        body.extend(*content);
        body.extend(b"\r\n");
    }
    body.extend(b"--XX--\r\n");
    Request::post("/v1/jobs").header("content-type", "multipart/form-data; boundary=XX").body(body.into()).unwrap()
}

#[tokio::test]
async fn words_of_headers_are_read_in_any_case_and_lists_on_several_lines() {
    let server = Server::start(writes()).await;
    let job = server.submit().await;
    server.job_in(&job, "succeeded").await;
    let mut request = form(&[("mask", Some("x; name=evil.nii"), &mask())]);
    request.headers_mut().insert("content-type", "Multipart/Form-Data; boundary=XX".parse().unwrap());
    request.headers_mut().append("cache-control", "no-store".parse().unwrap());
    request.headers_mut().append("cache-control", "No-Cache".parse().unwrap());
    request.headers_mut().insert("prefer", "Wait=9".parse().unwrap());
    let answer = server.send(request).await;
    assert_eq!((answer.status.as_u16(), answer.header("preference-applied")), (200, "wait=9"), "{}", answer.text());
    assert_eq!(answer.json()["reused"], false);
    let plain = server.with(Method::POST, "/v1/jobs", &[("content-encoding", "Identity")], mask()).await;
    assert!(plain.status.is_success(), "{}", plain.text());
    let range = format!("{job}/results/model.glb");
    let beyond = server.with(Method::GET, &range, &[("range", "BYTES=99999999999999999999999-")], vec![]).await;
    let length = server.get(&range).await.body.len();
    assert_eq!((beyond.status.as_u16(), beyond.header("content-range")), (416, &*format!("bytes */{length}")));
}

#[tokio::test]
async fn a_raw_mask_becomes_a_job() {
    let server = Server::without_workers().await;
    let answer = server.post("/v1/jobs", mask()).await;
    assert_eq!(answer.status, 202);
    let job = answer.json();
    assert_eq!(answer.header("location"), format!("/v1/jobs/{}", job["id"].as_str().unwrap()));
    assert_eq!(answer.header("retry-after"), "1");
    assert_eq!((&job["state"], &job["queue_position"], &job["attempt"]), (&"queued".into(), &1.into(), &0.into()));
    assert_eq!(job["mask"]["bytes"], mask().len());
    assert_eq!(job["params"], serde_json::json!({}));
    assert_eq!(server.get(answer.header("location")).await.json(), job);
}

#[tokio::test]
async fn a_form_takes_mask_and_params_in_any_order() {
    let server = Server::without_workers().await;
    let params: &[u8] = br#"{"margin": 0.1}"#;
    let (mask, name) = (mask(), Some("jane_doe.nii"));
    for parts in
        [[("mask", name, &mask[..]), ("params", None, params)], [("params", None, params), ("mask", None, &mask)]]
    {
        let answer = server.send(form(&parts)).await;
        assert_eq!(answer.status, 202, "{}", answer.text());
        assert_eq!(answer.json()["params"]["margin"], 0.1);
    }
}

#[tokio::test]
async fn params_of_a_raw_mask_come_in_the_query() {
    let server = Server::without_workers().await;
    let answer = server.post("/v1/jobs?params=%7B%22grid%22%3A%22auto%22%7D", mask()).await;
    assert_eq!(answer.status, 202, "{}", answer.text());
    assert_eq!(answer.json()["params"]["grid"], "auto");
}

#[tokio::test]
async fn what_was_accepted_is_on_disk() {
    let server = Server::without_workers().await;
    let job = server.submit().await;
    assert_eq!(std::fs::read(server.mask_of(&job)).unwrap(), mask());
    // Opened anew as another process would, without closing the first.
    let store = Place::at(server.dir.path()).open_store().await.unwrap();
    let kept = store.kept_files().await.unwrap();
    assert_eq!(kept[0].id.to_string(), id_of(&job));
}

#[tokio::test]
async fn every_bad_request_has_its_code_and_leaves_nothing() {
    let server = Server::start(writes()).await;
    let post = |path: &str, body: Vec<u8>| Request::post(path).body(Body::from(body)).unwrap();
    let header =
        |name: &str, value: &str| Request::post("/v1/jobs").header(name, value).body(Body::from(mask())).unwrap();
    let long = [mask(), vec![0; 5000]].concat();
    let with = |at: usize, bytes: [u8; 2]| {
        let mut file = mask();
        file[at..at + 2].copy_from_slice(&bytes);
        file
    };
    let good = mask();
    let cases = [
        ("empty", post("/v1/jobs", vec![]), 400, "empty_upload"),
        ("text", post("/v1/jobs", vec![b'x'; 1000]), 415, "not_nifti"),
        ("one byte", post("/v1/jobs", vec![7]), 415, "not_nifti"),
        ("header cut short", post("/v1/jobs", good[..200].to_vec()), 400, "truncated"),
        ("two files", post("/v1/jobs", with(344, *b"ni")), 415, "two_file_nifti"),
        ("negative dimension", post("/v1/jobs", with(42, [0xff, 0xff])), 400, "bad_dimensions"),
        (
            "several volumes",
            post(
                "/v1/jobs",
                with(40, [4, 0])[..48].iter().copied().chain([5, 0]).chain(good[50..].iter().copied()).collect(),
            ),
            422,
            "several_volumes",
        ),
        ("colour", post("/v1/jobs", with(70, [128, 0])), 422, "unsupported_datatype"),
        ("too long", post("/v1/jobs", long), 413, "upload_too_large"),
        ("too long, said so", header("content-length", "99999999999"), 413, "upload_too_large"),
        ("encoded", header("content-encoding", "gzip"), 415, "content_encoding"),
        ("no boundary", header("content-type", "multipart/form-data"), 400, "invalid_multipart"),
        ("misspelt query", post("/v1/jobs?param={}", mask()), 400, "invalid_query"),
        ("unknown parameter", post("/v1/jobs?params=%7B%22gird%22:1%7D", mask()), 422, "invalid_params"),
        ("parameter out of range", post("/v1/jobs?params=%7B%22margin%22:9%7D", mask()), 422, "invalid_params"),
        ("no JSON", post("/v1/jobs?params=%7B", mask()), 400, "malformed_params"),
        ("form without mask", form(&[("params", None, b"{}")]), 400, "invalid_multipart"),
        ("form with more", form(&[("mask", None, &good), ("extra", None, b"x")]), 400, "invalid_multipart"),
        ("form with two masks", form(&[("mask", None, &good), ("mask", None, &good)]), 400, "invalid_multipart"),
        ("form with bad params", form(&[("mask", None, &good), ("params", None, b"{\"k\":1}")]), 422, "invalid_params"),
        (
            "form with long params",
            form(&[("mask", None, &good), ("params", None, &[b' '; 70_000])]),
            400,
            "invalid_multipart",
        ),
        ("form with text", form(&[("mask", None, b"hello there")]), 415, "not_nifti"),
        ("form with an empty mask", form(&[("mask", None, b"")]), 400, "empty_upload"),
    ];
    for (what, request, status, code) in cases {
        let answer = server.send(request).await;
        assert_eq!(answer.status, status, "{what}: {}", answer.text());
        answer.is_problem(status, code);
        assert_eq!(server.files(), Vec::<std::path::PathBuf>::new(), "{what}");
    }
    assert_eq!(server.get("/v1/jobs").await.json()["jobs"], serde_json::json!([]));
    let job = server.submit().await;
    server.job_in(&job, "succeeded").await;
}

#[tokio::test]
async fn a_limit_holds_while_the_upload_streams() {
    let server = Server::without_workers().await;
    let chunks = [mask()].into_iter().chain(std::iter::repeat_with(|| vec![0; 1000]).take(1_000_000));
    let body = Body::from_stream(stream::iter(chunks.map(|chunk| Ok::<_, Infallible>(Bytes::from(chunk)))));
    let answer = server.send(Request::post("/v1/jobs").body(body).unwrap()).await;
    answer.is_problem(413, "upload_too_large");
    assert!(server.files().is_empty());
}

#[tokio::test]
async fn a_form_without_end_is_cut_off() {
    let server = Server::without_workers().await;
    for begin in ["", "--XX\r\nX: ", "--XX\r\nContent-Disposition: form-data; name=\"params\"\r\n\r\n"] {
        let chunks = [begin.as_bytes().to_vec()].into_iter().chain(std::iter::repeat_with(|| vec![b'a'; 64 << 10]));
        let body = Body::from_stream(stream::iter(chunks.map(|chunk| Ok::<_, Infallible>(Bytes::from(chunk)))));
        let request = Request::post("/v1/jobs").header("content-type", "multipart/form-data; boundary=XX");
        let answer = server.send(request.body(body).unwrap()).await;
        assert_eq!(answer.status, 400, "{}", answer.text());
    }
    assert!(server.files().is_empty());
}

#[tokio::test]
async fn little_of_a_form_is_kept_that_is_not_understood() {
    let server = Server::without_workers().await;
    let taken = Arc::new(AtomicUsize::new(0));
    for begin in ["", "--XX\r\nX: "] {
        taken.store(0, Ordering::Relaxed);
        let counter = Arc::clone(&taken);
        let endless = std::iter::repeat_with(move || {
            counter.fetch_add(1 << 10, Ordering::Relaxed);
            vec![b'a'; 1 << 10]
        });
        let chunks = [begin.as_bytes().to_vec()].into_iter().chain(endless);
        let body = Body::from_stream(stream::iter(chunks.map(|chunk| Ok::<_, Infallible>(Bytes::from(chunk)))));
        let request = Request::post("/v1/jobs").header("content-type", "multipart/form-data; boundary=XX");
        server.send(request.body(body).unwrap()).await.is_problem(400, "upload_interrupted");
        assert!(taken.load(Ordering::Relaxed) <= 300 << 10, "{begin}: {taken:?} bytes");
    }
}

#[tokio::test]
async fn an_upload_that_pauses_or_breaks_is_refused() {
    let server = Server::without_workers().await;
    let pause = Body::from_stream(stream::unfold(Some(mask()), |next| async move {
        match next {
            Some(chunk) => Some((Ok::<_, Infallible>(Bytes::from(chunk)), None)),
            None => std::future::pending().await,
        }
    }));
    let answer = server.send(Request::post("/v1/jobs").body(pause).unwrap()).await;
    answer.is_problem(408, "upload_too_slow");
    let chunks = [Ok(Bytes::from(mask())), Err(std::io::Error::other("reset"))];
    let answer = server.send(Request::post("/v1/jobs").body(Body::from_stream(stream::iter(chunks))).unwrap()).await;
    answer.is_problem(400, "upload_interrupted");
    assert!(server.files().is_empty());
}

#[tokio::test]
async fn a_full_queue_says_so_and_still_serves_the_rest() {
    let server = Server::without_workers().await;
    let mut last = String::new();
    for _ in 0..5 {
        last = server.submit().await;
    }
    let answer = server.post("/v1/jobs", mask()).await;
    answer.is_problem(503, "queue_full");
    assert_eq!(server.files().len(), 5);
    assert_eq!(server.get(&last).await.json()["queue_position"], 5);
    assert_eq!(server.call(axum::http::Method::DELETE, &last).await.status, 204);
    server.submit().await;
}

#[tokio::test]
async fn a_segmentation_is_taken_as_any_mask() {
    let server = Server::start(writes()).await;
    let answer = server.post("/v1/jobs", Seg::small().bytes()).await;
    assert_eq!(answer.status, 202, "{}", answer.text());
    server.job_in(answer.header("location"), "succeeded").await;
    let compressed = Dicom { transfer: "1.2.840.10008.1.2.4.90".to_owned(), ..Seg::small().dicom() };
    let answer = server.post("/v1/jobs", compressed.bytes()).await;
    let problem = answer.json();
    assert_eq!((answer.status.as_u16(), &problem["code"]), (422, &"unsupported_transfer_syntax".into()));
    assert!(!problem.to_string().contains(CANARY) && !logged().contains(CANARY));
}

#[tokio::test]
async fn text_of_a_patient_goes_nowhere() {
    let server = Server::start(writes()).await;
    let mut shown = String::new();
    let broken = [&mask()[..], &[0; 5000]].concat();
    for content in [&mask()[..], &broken, CANARY.as_bytes(), &mask()[..300]] {
        let file = format!("{CANARY}.nii");
        let answer = server.send(form(&[("mask", Some(&file), content), ("params", None, b"{}")])).await;
        shown += &format!("{:?}{}", answer.headers, answer.text());
        if answer.status == 202 {
            shown += &server.job_in(answer.header("location"), "succeeded").await.to_string();
        }
        shown += &server.get(&format!("/v1/jobs/{CANARY}")).await.text();
        shown += &server.get(&format!("/{CANARY}")).await.text();
        shown += &server.send(form(&[(CANARY, Some(&file), content)])).await.text();
    }
    assert!(!shown.contains(CANARY), "{shown}");
    assert!(logged().contains("job accepted"));
    assert!(!logged().contains(CANARY));
}
