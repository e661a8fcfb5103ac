//! All artifacts or none.

use std::path::Path;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::Instant;

use medialrep::cancel::Cancel;
use medialrep::formats::artifacts::ARTIFACTS;
use medialrep::formats::write::thickness::InputFacts;
use medialrep::jobs::process::{InputLimits, Kept, ProcessError, Source, process, publish};
use medialrep::model::{Stage, Warning};
use medialrep::params::Params;
use medialrep::pipeline::observer::{Observer, Silent};
use sha2::{Digest, Sha256};

use crate::help::models::model;
use crate::help::nifti_bytes::Nifti;

fn source() -> Source {
    Source {
        input: InputFacts { sha256: "00".repeat(32), format: "nifti1".to_owned() },
        warnings: vec![Warning { code: "no_orientation".into(), message: "none".to_owned() }],
        dicom: None,
        start: Instant::now(),
        read_ms: 1.0,
    }
}

fn files(folder: &Path) -> Vec<String> {
    let mut names: Vec<String> =
        std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().file_name().into_string().unwrap()).collect();
    names.sort();
    names
}

/// Cancels when it is asked for the `n`th time.
struct CancelAt(usize, AtomicUsize);

impl Observer for CancelAt {
    fn progress(&self, _: usize, _: usize, _: Stage, _: f64) {}
}

impl Cancel for CancelAt {
    fn is_cancelled(&self) -> bool {
        self.1.fetch_add(1, Ordering::Relaxed) >= self.0
    }
}

#[test]
fn what_is_reported_is_what_is_there() {
    let folder = tempfile::tempdir().unwrap();
    let processed = publish(model(), source(), (folder.path(), Kept::Artifacts), &Silent).unwrap();
    assert_eq!(files(folder.path()), ["model.glb", "points.csv", "thickness.csv", "thickness.json"]);
    let reported: Vec<_> = processed.files.iter().map(|artifact| (artifact.name, artifact.media_type)).collect();
    let default: Vec<_> = ARTIFACTS.iter().filter(|artifact| artifact.is_default).collect();
    assert_eq!(reported, default.iter().map(|artifact| (artifact.name, artifact.media_type)).collect::<Vec<_>>());
    for artifact in &processed.files {
        let bytes = std::fs::read(folder.path().join(artifact.name)).unwrap();
        let sha256: String = Sha256::digest(&bytes).iter().map(|byte| format!("{byte:02x}")).collect();
        assert_eq!((artifact.bytes, &artifact.sha256), (bytes.len() as u64, &sha256), "{}", artifact.name);
    }
    let codes: Vec<_> = processed.warnings.iter().map(|warning| &*warning.code).collect();
    assert_eq!(codes, ["no_orientation", "a_warning", "a_warning"]);
}

#[test]
fn a_cancelled_run_leaves_nothing_wherever_it_is_stopped() {
    for asked in 0..5 {
        let folder = tempfile::tempdir().unwrap();
        let outcome =
            publish(model(), source(), (folder.path(), Kept::Artifacts), &CancelAt(asked, AtomicUsize::new(0)));
        assert!(matches!(outcome, Err(ProcessError::Cancelled)), "stopped at {asked}");
        assert!(files(folder.path()).is_empty(), "stopped at {asked}: {:?}", files(folder.path()));
    }
}

#[test]
fn a_folder_that_cannot_be_written_is_our_fault() {
    match publish(model(), source(), (Path::new("/nowhere/at/all"), Kept::Artifacts), &Silent) {
        Err(ProcessError::Io { doing: "writing the results", .. }) => {}
        other => panic!("{other:?}"),
    }
}

#[test]
fn a_refused_file_leaves_nothing_not_even_an_older_answer() {
    let folder = tempfile::tempdir().unwrap();
    publish(model(), source(), (folder.path(), Kept::Artifacts), &Silent).unwrap();
    std::fs::write(folder.path().join("notes.txt"), "mine").unwrap();
    let mask = tempfile::NamedTempFile::new().unwrap();
    std::fs::write(mask.path(), Nifti { datatype: 128, ..Nifti::small(1) }.bytes()).unwrap();
    let params = Params::default().check().unwrap();
    match process(mask.path(), &params, InputLimits::default(), (folder.path(), Kept::Artifacts), &Silent) {
        Err(ProcessError::Problem(problem)) => assert_eq!(problem.code, "unsupported_datatype"),
        other => panic!("{other:?}"),
    }
    assert_eq!(files(folder.path()), ["notes.txt"]);
}
