//! A service whose jobs leave DICOM results: those of a model made by hand, of the patient and the study of the mask.

use std::time::Instant;

use axum::http::Method;
use medialrep::formats;
use medialrep::formats::write::thickness::InputFacts;
use medialrep::jobs::process::{Kept, Source, publish};
use medialrep::jobs::worker::Processor;
use tempfile::TempDir;

use super::dicom_bytes::{Seg, text};
use super::models::model;
use super::support::{Answer, Server, limits};

/// What a mask is of.
#[derive(Clone, Copy)]
pub struct Patient {
    pub study: &'static str,
    pub id: &'static str,
    pub name: &'static [u8],
    pub date: &'static str,
}

pub const MUELLER: Patient =
    Patient { study: "1.2.840.99.424242.1", id: "CT-7", name: b"M\xfcller^J\xf6rg", date: "20261129" };
pub const DOE: Patient = Patient { study: "1.2.840.99.424242.2", id: "MR-8", name: b"Doe^Jane", date: "20261130" };

/// A segmentation of a patient.
pub fn seg(patient: Patient) -> Vec<u8> {
    let mut dicom = Seg::small().dicom();
    for (tag, kind, value) in [
        (0x0008_0005, "CS", b"ISO_IR 100".as_slice()),
        (0x0008_0018, "UI", b"1.2.3.4"),
        (0x0008_0020, "DA", patient.date.as_bytes()),
        (0x0008_0030, "TM", b"133059"),
        (0x0008_0050, "SH", b"A-1"),
        (0x0010_0010, "PN", patient.name),
        (0x0010_0020, "LO", patient.id.as_bytes()),
        (0x0020_000d, "UI", patient.study.as_bytes()),
        (0x0020_000e, "UI", b"1.2.3.5"),
    ] {
        dicom.set(text(tag, kind, value));
    }
    dicom.bytes()
}

/// Writes what is asked for of a model of its own, as a run does.
fn publishes() -> Processor {
    std::sync::Arc::new(|mask, params, limits, out, observer| {
        let start = Instant::now();
        let read = formats::read_file(mask, limits, observer)?;
        let input = InputFacts { sha256: read.sha256, format: read.format.to_owned() };
        let mut model = model();
        model.params = params.clone();
        let source = Source { input, warnings: Vec::new(), dicom: read.origin, start, read_ms: 0.0 };
        publish(model, source, (out, Kept::Record), observer)
    })
}

/// A service with workers.
pub async fn server() -> Server {
    let mut limits = limits();
    limits.upload.max_bytes = 16 << 10;
    let mut server = Server::open_with(TempDir::new().unwrap(), limits, None).await;
    server.run(&publishes());
    server
}

/// A job of a mask that leaves these files, once it has ended; its path.
pub async fn run(server: &Server, token: Option<&str>, mask: Vec<u8>, outputs: &[&str]) -> String {
    let params = serde_json::json!({ "outputs": outputs }).to_string();
    let query: String = form_urlencoded::byte_serialize(params.as_bytes()).collect();
    let mut headers = vec![("cache-control", "no-cache")];
    headers.extend(token.map(|token| ("authorization", token)));
    let answer = server.with(Method::POST, &format!("/v1/jobs?params={query}"), &headers, mask).await;
    let job = answer.header("location").to_owned();
    // Pictures take a while where a program is not optimised.
    for _ in 0..3 {
        let ended = server.with(Method::GET, &format!("{job}?wait=50"), &headers, Vec::new()).await.json();
        match ended["state"].as_str() {
            Some("succeeded") => return job,
            Some("queued" | "running") => {}
            _ => panic!("{ended}"),
        }
    }
    panic!("waited in vain for {job}");
}

pub const PICTURE: &str = "picture.dcm";
pub const REPORT: &str = "report.sr.dcm";
pub const PDF: &str = "report.pdf.dcm";
pub const STL: &str = "surfaces.stl.dcm";

/// A file of a job.
pub async fn file(server: &Server, job: &str, name: &str) -> Vec<u8> {
    let answer = server.get(&format!("{job}/results/{name}")).await;
    assert_eq!(answer.status, 200, "{}", answer.text());
    answer.body
}

/// The values of an attribute, in each result of a search.
pub fn values(answer: &Answer, tag: &str) -> Vec<serde_json::Value> {
    assert_eq!(answer.status, 200, "{}", answer.text());
    answer.json().as_array().unwrap().iter().map(|result| result[tag]["Value"][0].clone()).collect()
}
