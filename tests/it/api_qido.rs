//! Searches for DICOM results.

use std::collections::BTreeMap;
use std::time::Duration;

use axum::http::Method;
use jiff::Timestamp;
use medialrep::formats::dicom_object::DicomObject;
use medialrep::jobs::job::{JobId, MaskInfo, ResultFile};
use medialrep::jobs::store::{NewJob, Reused};
use medialrep::jobs::token::{Scope, Token};
use serde_json::{Value, json};

use crate::help::dicom_read::{read, text};
use crate::help::published::{DOE, MUELLER, REPORT, STL, file, run, seg, server, values};
use crate::help::support::{Answer, Server, id_of, logged};

const STUDIES: &str = "/dicom-web/studies";
const STUDY: &str = "0020000D";
const SERIES: &str = "0020000E";
const CLASS: &str = "00080016";

/// A service with surfaces and a report of one patient, then surfaces of another.
async fn two_studies() -> Server {
    let server = server().await;
    run(&server, None, seg(MUELLER), &[STL, REPORT]).await;
    run(&server, None, seg(DOE), &[STL]).await;
    server
}

async fn search(server: &Server, path: &str) -> Answer {
    let answer = server.get(path).await;
    assert_eq!(answer.status, 200, "{path}: {}", answer.text());
    assert_eq!(answer.header("content-type"), "application/dicom+json");
    answer
}

/// The warnings of an answer.
fn warnings(answer: &Answer) -> Vec<&str> {
    answer.headers.get_all("warning").iter().map(|value| value.to_str().unwrap()).collect()
}

#[tokio::test]
async fn studies_are_found_newest_first_with_what_the_standard_asks_for() {
    let server = two_studies().await;
    let answer = search(&server, STUDIES).await;
    assert_eq!(values(&answer, STUDY), [DOE.study, MUELLER.study]);
    let expected = json!({
        "00080005": {"vr": "CS", "Value": ["ISO_IR 192"]},
        "00080020": {"vr": "DA", "Value": ["20261129"]},
        "00080030": {"vr": "TM", "Value": ["133059"]},
        "00080050": {"vr": "SH", "Value": ["A-1"]},
        "00080056": {"vr": "CS", "Value": ["ONLINE"]},
        "00080061": {"vr": "CS", "Value": ["M3D", "SR"]},
        "00080090": {"vr": "PN"},
        "00081190": {"vr": "UR", "Value": ["/dicom-web/studies/1.2.840.99.424242.1"]},
        "00100010": {"vr": "PN", "Value": [{"Alphabetic": "Müller^Jörg"}]},
        "00100020": {"vr": "LO", "Value": ["CT-7"]},
        "00100030": {"vr": "DA"},
        "00100040": {"vr": "CS"},
        "0020000D": {"vr": "UI", "Value": ["1.2.840.99.424242.1"]},
        "00200010": {"vr": "SH"},
        "00201206": {"vr": "IS", "Value": [2]},
        "00201208": {"vr": "IS", "Value": [2]},
    });
    assert_eq!(answer.json()[1], expected);
}

#[tokio::test]
async fn series_and_instances_are_found_in_all_studies_and_in_one() {
    let server = two_studies().await;
    let of_study = format!("{STUDIES}/{}", MUELLER.study);
    for (path, count) in [
        ("/dicom-web/series".to_owned(), 3),
        ("/dicom-web/instances".to_owned(), 3),
        (format!("{of_study}/series"), 2),
        (format!("{of_study}/instances"), 2),
        (format!("{STUDIES}/1.2.3/series"), 0),
    ] {
        assert_eq!(values(&search(&server, &path).await, STUDY).len(), count, "{path}");
    }
    let series = search(&server, &format!("{of_study}/series")).await;
    assert_eq!(values(&series, "00080060"), ["M3D", "SR"]);
    assert_eq!(values(&series, "00201209"), [1, 1]);
    // The patient is told where the study is not named.
    assert!(series.json()[0].get("00100020").is_none());
    assert_eq!(values(&search(&server, "/dicom-web/series").await, "00100020"), ["MR-8", "CT-7", "CT-7"]);
    let report = values(&series, SERIES)[1].as_str().unwrap().to_owned();
    let path = format!("{of_study}/series/{report}/instances");
    let instances = search(&server, &path).await;
    assert_eq!(values(&instances, CLASS), ["1.2.840.10008.5.1.4.1.1.88.34"]);
    let instance = values(&instances, "00080018")[0].as_str().unwrap().to_owned();
    assert_eq!(values(&instances, "00081190"), [format!("{path}/{instance}")]);
    assert_eq!(values(&search(&server, "/dicom-web/instances?Modality=M3D").await, "00200013"), [1, 1]);
}

#[tokio::test]
async fn results_are_matched_by_their_attributes() {
    let server = two_studies().await;
    for (query, found) in [
        ("PatientID=CT-7", &[MUELLER.study][..]),
        ("00100020=C*", &[MUELLER.study]),
        ("PatientID=?R-8", &[DOE.study]),
        ("PatientName=m%C3%BCller*", &[MUELLER.study]),
        ("StudyDate=20261130-", &[DOE.study]),
        ("StudyDate=20261101-20261130", &[DOE.study, MUELLER.study]),
        ("StudyTime=1330", &[DOE.study, MUELLER.study]),
        ("ModalitiesInStudy=SR", &[MUELLER.study]),
        ("StudyInstanceUID=1.2.840.99.424242.1,1.2.840.99.424242.2,1.2.3", &[DOE.study, MUELLER.study]),
        ("StudyInstanceUID=1.2.840.99.424242.1&PatientID=MR-8", &[]),
        ("PatientID=", &[DOE.study, MUELLER.study]),
        ("AccessionNumber=none", &[]),
    ] {
        let answer = search(&server, &format!("{STUDIES}?{query}")).await;
        assert_eq!(values(&answer, STUDY), found, "{query}");
        assert!(warnings(&answer).is_empty(), "{query}: {:?}", warnings(&answer));
    }
    let surfaces = search(&server, "/dicom-web/instances?SOPClassUID=1.2.840.10008.5.1.4.1.1.104.3").await;
    assert_eq!(values(&surfaces, STUDY), [DOE.study, MUELLER.study]);
    assert_eq!(values(&search(&server, "/dicom-web/series?SeriesNumber=9001").await, "00080060"), ["SR"]);
}

#[tokio::test]
async fn pages_follow_each_other() {
    let server = two_studies().await;
    for key in ["", "&PatientID=*-*"] {
        let page = async |query: &str| values(&search(&server, &format!("{STUDIES}?{query}{key}")).await, STUDY);
        assert_eq!(page("limit=1").await, [DOE.study]);
        assert_eq!(page("limit=1&offset=1").await, [MUELLER.study]);
        assert_eq!(page("offset=2").await, [""; 0]);
        assert_eq!(page("limit=0").await, [""; 0]);
    }
}

#[tokio::test]
async fn more_attributes_are_told_when_they_are_asked_for() {
    let server = two_studies().await;
    let told = async |query: &str| search(&server, &format!("/dicom-web/instances?PatientID=MR-8{query}")).await;
    assert!(told("").await.json()[0].get("00080070").is_none());
    assert_eq!(values(&told("&includefield=Manufacturer").await, "00080070"), ["medialrep"]);
    assert_eq!(values(&told("&includefield=00280301,00080070").await, "00280301"), ["NO"]);
    assert_eq!(told("&includefield=all").await.json()[0]["004008EA"]["vr"], "SQ");
}

#[tokio::test]
async fn what_is_not_known_is_ignored_with_a_warning_and_what_is_malformed_refused() {
    let server = two_studies().await;
    let answer = search(&server, &format!("{STUDIES}?BodyPartExamined=LIVER&fuzzymatching=true")).await;
    assert_eq!(values(&answer, STUDY).len(), 2);
    let told = warnings(&answer).join("\n");
    assert!(told.starts_with("299 medialrep \"") && told.contains("BodyPartExamined"), "{told}");
    assert!(told.contains("Only literal matching has been performed"), "{told}");
    for query in ["limit=x", "StudyDate=CANARY", "StudyInstanceUID=1..2", "PatientID=1&PatientID=2", "%FF=%FF&limit=-1"]
    {
        let problem = server.get(&format!("{STUDIES}?{query}")).await.is_problem(400, "invalid_query");
        assert!(!problem.detail.contains("CANARY") && problem.hint.is_some());
    }
    server.get(&format!("{STUDIES}/1..2/series")).await.is_problem(422, "invalid_uid");
    let xml = [("accept", "application/dicom+xml")];
    server.with(Method::GET, STUDIES, &xml, Vec::new()).await.is_problem(406, "not_acceptable");
}

#[tokio::test]
async fn equal_requests_give_one_result_and_what_is_made_later_is_found() {
    let server = server().await;
    let first = run(&server, None, seg(MUELLER), &[STL]).await;
    run(&server, None, seg(MUELLER), &[STL]).await;
    let instances = async || values(&search(&server, "/dicom-web/instances").await, "00080018");
    assert_eq!(instances().await.len(), 1);
    let (_, report) = read(&file(&server, &first, REPORT).await);
    assert_eq!(instances().await.len(), 2);
    assert!(instances().await.contains(&text(&report, 0x0008_0018).into()));
    // Results that are taken over are found where those that they came from are gone.
    let outputs = "%7B%22outputs%22%3A%5B%22surfaces.stl.dcm%22%5D%7D";
    let answer = server.post(&format!("/v1/jobs?params={outputs}"), seg(MUELLER)).await;
    assert_eq!(answer.json()["reused"], true);
    let jobs = server.get("/v1/jobs").await.json()["jobs"].as_array().unwrap().clone();
    for job in &jobs[1..] {
        server.call(Method::DELETE, job["links"]["self"].as_str().unwrap()).await;
    }
    assert_eq!(instances().await.len(), 1);
}

#[tokio::test]
async fn what_is_erased_is_not_found_and_named_nowhere() {
    let server = two_studies().await;
    let jobs = server.get("/v1/jobs").await.json()["jobs"].as_array().unwrap().clone();
    let id = |at: usize| JobId::parse(jobs[at]["id"].as_str().unwrap()).unwrap();
    assert_eq!(server.call(Method::DELETE, &format!("/v1/jobs/{}", id(0))).await.status, 204);
    assert_eq!(values(&search(&server, STUDIES).await, STUDY), [MUELLER.study]);
    server.jobs.store().forget_results(id(1)).await.unwrap();
    assert_eq!(search(&server, STUDIES).await.text(), "[]");
    let row = server.jobs.store().get(id(1)).await.unwrap().unwrap();
    assert!(row.results.len() == 3 && row.results.iter().all(|file| file.dicom.is_none()));
}

#[tokio::test]
async fn identifiers_of_results_are_told_to_who_searches_alone() {
    let server = two_studies().await;
    search(&server, &format!("{STUDIES}/{}/instances", MUELLER.study)).await;
    let told = [server.get("/v1/jobs").await.text(), server.get("/metrics").await.text(), logged()].concat();
    let log = std::fs::read_to_string(server.dir.path().join("audit/audit.jsonl")).unwrap();
    for hidden in [MUELLER.study, "Doe^Jane", "CT-7"] {
        assert!(!told.contains(hidden) && !log.contains(hidden), "{hidden}");
    }
    assert!(log.contains("\"action\":\"search\""));
}

/// `Bearer` and a token of a tenant that sees its jobs and sends some.
async fn token(server: &Server, tenant: &str) -> String {
    let token = Token::new().unwrap();
    let stored = token.stored(tenant.to_owned(), vec![Scope::Read, Scope::Write], None);
    server.jobs.store().insert_token(&stored).await.unwrap();
    format!("Bearer {}", token.reveal())
}

#[tokio::test]
async fn a_tenant_finds_its_own_results_alone() {
    let server = server().await;
    run(&server, None, seg(DOE), &[STL]).await;
    let (own, other) = (token(&server, "radiology").await, token(&server, "surgery").await);
    run(&server, Some(&own), seg(MUELLER), &[STL]).await;
    let studies = async |token: &str| {
        let answer = server.with(Method::GET, STUDIES, &[("authorization", token)], Vec::new()).await;
        values(&answer, STUDY)
    };
    assert_eq!(studies(&own).await, [MUELLER.study]);
    assert_eq!(studies(&other).await, [""; 0]);
    let path = format!("{STUDIES}/{}", MUELLER.study);
    for rest in ["", "/metadata"] {
        let answer =
            server.with(Method::GET, &format!("{path}{rest}"), &[("authorization", &*other)], Vec::new()).await;
        answer.is_problem(404, "no_such_object");
    }
    // Jobs that nobody owned are somebody's later, and so are their results.
    server.jobs.store().adopt_jobs("surgery").await.unwrap();
    assert_eq!(studies(&other).await, [DOE.study]);
}

#[tokio::test]
async fn a_result_that_cannot_be_read_is_left_out_and_told() {
    let server = server().await;
    let job = run(&server, None, seg(MUELLER), &[STL, REPORT]).await;
    let files = server.files();
    let surfaces = files.iter().find(|path| path.ends_with(STL) && path.to_string_lossy().contains(id_of(&job)));
    std::fs::write(surfaces.unwrap(), b"rotten").unwrap();
    let answer = search(&server, "/dicom-web/instances").await;
    assert_eq!(values(&answer, CLASS), ["1.2.840.10008.5.1.4.1.1.88.34"]);
    assert_eq!(warnings(&answer), ["299 medialrep \"1 results could not be read\""]);
    let studies: Value = search(&server, STUDIES).await.json();
    assert_eq!(studies[0]["00080061"]["Value"], json!(["SR"]));
}

/// Four results of a job that say which objects they are, and whose files are not there.
fn lost_results(at: usize) -> Vec<ResultFile> {
    let object = |n: usize| DicomObject {
        class: "1.2.3".to_owned(),
        study: format!("1.9.{at}"),
        series: format!("1.9.{at}.{n}"),
        instance: format!("1.9.{at}.{n}.1"),
    };
    let file = |n: usize| ResultFile {
        name: format!("file{n}"),
        media_type: "application/dicom".to_owned(),
        bytes: 1000,
        sha256: String::new(),
        dicom: Some(object(n)),
    };
    (0..4).map(file).collect()
}

/// Keeps a job that has succeeded with such results.
async fn insert_lost(server: &Server, at: usize) {
    let reused = Reused {
        token: "token".to_owned(),
        results: lost_results(at),
        warnings: Vec::new(),
        program: "0.1.0".to_owned(),
    };
    let job = NewJob {
        id: JobId::now(),
        owner: String::new(),
        mask: MaskInfo { sha256: String::new(), bytes: 1 },
        params_json: "{}".to_owned(),
        labels: BTreeMap::new(),
        idempotency_key: None,
        request_sha256: String::new(),
        work_sha256: at.to_string(),
        callback_url: None,
        deliver_to: None,
        trace_id: String::new(),
        created_at: Timestamp::now(),
        expected: Duration::ZERO,
        reused: Some(reused),
    };
    server.jobs.store().insert(&job, server.jobs.limits().queue).await.unwrap();
}

#[tokio::test]
async fn a_search_reads_so_many_files_and_says_when_there_are_more() {
    let server = server().await;
    for at in 0..251 {
        insert_lost(&server, at).await;
    }
    let answer = search(&server, "/dicom-web/instances?PatientID=CT-7").await;
    let told = warnings(&answer);
    assert!(told[0].contains("Only the newest results were looked at") && told[1].contains("1000 results"), "{told:?}");
    // By its identifiers the oldest one is looked at too.
    let answer = search(&server, "/dicom-web/instances?SOPInstanceUID=1.9.0.0.1").await;
    assert_eq!(warnings(&answer), ["299 medialrep \"1 results could not be read\""]);
}
