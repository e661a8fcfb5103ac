//! DICOM results as an archive or a viewer fetches them.

use axum::http::Method;
use serde_json::Value;

use crate::help::dicom_read::{Dataset, Element, bytes, read, text};
use crate::help::published::{DOE, MUELLER, PDF, PICTURE, REPORT, STL, file, run, seg, server};
use crate::help::support::{Answer, Server, id_of};

/// Paths of DICOMweb that lead to a file.
struct Paths {
    study: String,
    series: String,
    instance: String,
}

fn paths(file: &[u8]) -> Paths {
    let (_, set) = read(file);
    let study = format!("/dicom-web/studies/{}", text(&set, 0x0020_000d));
    let series = format!("{study}/series/{}", text(&set, 0x0020_000e));
    let instance = format!("{series}/instances/{}", text(&set, 0x0008_0018));
    Paths { study, series, instance }
}

async fn get(server: &Server, path: &str, accept: &str) -> Answer {
    server.with(Method::GET, path, &[("accept", accept)], Vec::new()).await
}

/// The body that has these files, in the boundary of an answer.
fn related(answer: &Answer, media_type: &str, part: &str, files: &[&[u8]]) -> Vec<u8> {
    let kind = format!("multipart/related; type=\"{media_type}\"; boundary=");
    let boundary = answer.header("content-type").strip_prefix(&kind).unwrap();
    let mut body = Vec::new();
    for file in files {
        let head = format!("--{boundary}\r\nContent-Type: {part}\r\n\r\n");
        body.extend([head.as_bytes(), file, b"\r\n"].concat());
    }
    [body, format!("--{boundary}--\r\n").into_bytes()].concat()
}

/// Asserts that an answer has these files as they are, and tells its length.
#[track_caller]
fn check_files(answer: &Answer, files: &[&[u8]]) {
    assert_eq!(answer.status, 200, "{}", answer.text());
    let part = "application/dicom; transfer-syntax=1.2.840.10008.1.2.1";
    assert!(answer.body == related(answer, "application/dicom", part, files));
    assert_eq!(answer.header("content-length"), answer.body.len().to_string());
}

#[tokio::test]
async fn files_are_fetched_as_they_were_made() {
    let server = server().await;
    let job = run(&server, None, seg(MUELLER), &[STL, REPORT]).await;
    run(&server, None, seg(DOE), &[STL]).await;
    let [surfaces, report] = [file(&server, &job, STL).await, file(&server, &job, REPORT).await];
    let paths = paths(&surfaces);
    let any = "multipart/related; type=\"application/dicom\"; transfer-syntax=*";
    check_files(&get(&server, &paths.study, any).await, &[&surfaces, &report]);
    check_files(&server.get(&paths.series).await, &[&surfaces]);
    check_files(&get(&server, &paths.instance, "*/*").await, &[&surfaces]);
    let alone = get(&server, &paths.instance, "application/dicom").await;
    assert_eq!((alone.header("content-type"), alone.body == surfaces), ("application/dicom", true));
}

#[tokio::test]
async fn what_is_not_there_or_not_accepted_is_told() {
    let server = server().await;
    let job = run(&server, None, seg(MUELLER), &[STL]).await;
    let paths = paths(&file(&server, &job, STL).await);
    let unknown = format!("{}/series/1.2.3", paths.study);
    for path in ["/dicom-web/studies/1.2.3", &unknown, &format!("{}/instances/1.2", paths.series)] {
        server.get(path).await.is_problem(404, "no_such_object");
        server.get(&format!("{path}/metadata")).await.is_problem(404, "no_such_object");
    }
    server.get("/dicom-web/studies/x/metadata").await.is_problem(422, "invalid_uid");
    let jpeg = "multipart/related; type=\"application/dicom\"; transfer-syntax=1.2.840.10008.1.2.4.70";
    for (path, accept) in [
        (&paths.study, "application/dicom"),
        (&paths.instance, jpeg),
        (&paths.instance, "image/png"),
        (&format!("{}/metadata", paths.study), "application/dicom+xml"),
    ] {
        get(&server, path, accept).await.is_problem(406, "not_acceptable");
    }
    assert_eq!(server.call(Method::DELETE, &job).await.status, 204);
    server.get(&paths.instance).await.is_problem(404, "no_such_object");
}

#[tokio::test]
async fn a_damaged_file_is_never_sent() {
    let server = server().await;
    let job = run(&server, None, seg(MUELLER), &[STL]).await;
    let surfaces = file(&server, &job, STL).await;
    let mut rotten = surfaces.clone();
    *rotten.last_mut().unwrap() ^= 1;
    let files = server.files();
    let path = files.iter().find(|path| path.ends_with(STL) && path.to_string_lossy().contains(id_of(&job)));
    std::fs::write(path.unwrap(), rotten).unwrap();
    let instance = paths(&surfaces).instance;
    for path in [instance.clone(), format!("{instance}/metadata"), format!("{instance}/bulkdata/00420011")] {
        server.get(&path).await.is_problem(500, "result_damaged");
    }
}

/// Asserts that JSON says what a data set does, and fetches what it leaves out.
async fn check_metadata(server: &Server, json: &Value, set: &Dataset) {
    let tags: Vec<String> = set.keys().map(|tag| format!("{tag:08X}")).collect();
    assert_eq!(json.as_object().unwrap().keys().cloned().collect::<Vec<_>>(), tags);
    for (tag, element) in set {
        let told = &json[format!("{tag:08X}")];
        match element {
            Element::Items(items) => {
                assert_eq!((&told["vr"], count(&told["Value"])), (&"SQ".into(), items.len()), "{tag:08x}");
                for (json, item) in told["Value"].as_array().into_iter().flatten().zip(items) {
                    Box::pin(check_metadata(server, json, item)).await;
                }
            }
            Element::Value(vr, bytes) => {
                assert_eq!(told["vr"], **vr, "{tag:08x}");
                match told["BulkDataURI"].as_str() {
                    Some(uri) => {
                        assert!(bytes.len() > 16 << 10);
                        let answer = get(server, uri, "application/octet-stream").await;
                        assert!(answer.body == *bytes, "{tag:08x}");
                    }
                    None => check_value(*tag, told, vr, bytes),
                }
            }
        }
    }
}

fn count(list: &Value) -> usize {
    list.as_array().map_or(0, Vec::len)
}

fn check_value(tag: u32, told: &Value, vr: &str, bytes: &[u8]) {
    let latin1: String = bytes.iter().map(|byte| char::from(*byte)).collect();
    let text = latin1.trim_end_matches(['\0', ' ']);
    let values = told["Value"].as_array().cloned().unwrap_or_default();
    let said: Vec<String> = values
        .iter()
        .map(|value| match value {
            Value::Object(name) => name["Alphabetic"].as_str().unwrap().to_owned(),
            Value::String(text) => text.clone(),
            number => number.to_string(),
        })
        .collect();
    match vr {
        _ if tag == 0x0008_0005 => assert_eq!(said, ["ISO_IR 192"]),
        "US" => assert_eq!(said, [u16::from_le_bytes(bytes.try_into().unwrap()).to_string()], "{tag:08x}"),
        "UL" => assert_eq!(said, [u32::from_le_bytes(bytes.try_into().unwrap()).to_string()], "{tag:08x}"),
        "DS" | "IS" => {
            let (said, text): (f64, f64) = (said[0].parse().unwrap(), text.parse().unwrap());
            assert!((said - text).abs() < 1e-9, "{tag:08x}");
        }
        _ => assert_eq!(said.join("\\"), text, "{tag:08x}"),
    }
}

#[tokio::test]
async fn metadata_say_what_the_files_say() {
    let server = server().await;
    let names = [PICTURE, PDF, STL, REPORT];
    let job = run(&server, None, seg(MUELLER), &names).await;
    for name in names {
        let file = file(&server, &job, name).await;
        let answer = server.get(&format!("{}/metadata", paths(&file).instance)).await;
        assert_eq!(answer.header("content-type"), "application/dicom+json");
        let (_, set) = read(&file);
        check_metadata(&server, &answer.json()[0], &set).await;
    }
    let study = paths(&file(&server, &job, PICTURE).await).study;
    let all = server.get(&format!("{study}/metadata")).await.json();
    assert_eq!(count(&all), names.len());
    assert_eq!(all[0]["00100010"]["Value"][0]["Alphabetic"], "Müller^Jörg");
}

#[tokio::test]
async fn long_values_are_fetched_alone() {
    let server = server().await;
    let job = run(&server, None, seg(MUELLER), &[PDF]).await;
    let document = file(&server, &job, PDF).await;
    let (_, set) = read(&document);
    let uri = format!("{}/bulkdata/00420011", paths(&document).instance);
    let value = bytes(&set, 0x0042_0011);
    let octets = "application/octet-stream";
    let parts = get(&server, &uri, "multipart/related; type=\"application/octet-stream\"").await;
    assert!(parts.body == related(&parts, octets, octets, &[value]));
    assert_eq!(parts.header("content-length"), parts.body.len().to_string());
    // As clients ask that do not know what it is.
    let parts = get(&server, &uri, "multipart/related; type=\"*/*\"").await;
    assert!(parts.body == related(&parts, octets, octets, &[value]));
    for (accept, kind) in [("application/pdf", "application/pdf"), (octets, octets)] {
        let answer = get(&server, &uri, accept).await;
        assert_eq!((answer.header("content-type"), answer.body == value), (kind, true));
    }
    let answer = server.get(&format!("{uri}?accept=application/pdf")).await;
    assert_eq!(answer.header("content-type"), "application/pdf");
    get(&server, &uri, "image/png").await.is_problem(406, "not_acceptable");
    for tag in ["00100010", "7FE00010", "x"] {
        let path = format!("{}/bulkdata/{tag}", paths(&document).instance);
        server.get(&path).await.is_problem(404, "no_such_object");
    }
}
