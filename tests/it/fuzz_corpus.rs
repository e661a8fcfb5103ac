//! Every input that fuzzing kept (`make fuzz`), replayed without a fuzzer.

use std::path::Path;

use crate::help::{dicom_bytes, nifti_bytes, text_bytes};

#[path = "../../fuzz/bodies/mask.rs"]
mod mask;
#[path = "../../fuzz/bodies/multipart.rs"]
mod multipart;
#[path = "../../fuzz/bodies/params.rs"]
mod params;
#[path = "../../fuzz/bodies/related.rs"]
mod related;
#[allow(dead_code, reason = "the targets write them to a folder")]
#[path = "../../fuzz/seeds.rs"]
mod seeds;

/// Runs `check` on each file of a corpus; a failure names its file.
fn replay(target: &str, check: impl Fn(&[u8])) {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("fuzz/corpus").join(target);
    let mut files: Vec<_> = std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path()).collect();
    files.sort();
    assert!(files.len() >= 20, "{target}: {} files", files.len());
    for file in files {
        let bytes = std::fs::read(&file).unwrap();
        let checked = std::panic::catch_unwind(std::panic::AssertUnwindSafe(|| check(&bytes)));
        assert!(checked.is_ok(), "{}", file.display());
    }
}

#[test]
fn every_fuzzed_input_is_answered_by_the_reader() {
    for target in ["nifti", "dicom", "nrrd", "metaimage"] {
        replay(target, |bytes| {
            mask::check(bytes);
            mask::check_in_gzip(bytes);
        });
    }
}

#[test]
fn every_fuzzed_input_is_answered_as_parameters() {
    replay("params", params::check);
}

#[test]
fn a_seed_of_every_parameter_in_every_form_is_accepted() {
    let seeds = seeds::params();
    let refused = |seed: &&Vec<u8>| medialrep::formats::params_json::parse(seed).is_err();
    let refused: Vec<_> = seeds.iter().filter(refused).map(|seed| String::from_utf8_lossy(seed)).collect();
    // The one that is wrong on purpose.
    assert_eq!(refused.len(), 1, "{refused:?}");
    seeds.iter().for_each(|seed| params::check(seed));
}

#[test]
fn every_fuzzed_input_is_answered_as_a_form() {
    let forms = multipart::Forms::open();
    replay("multipart", |bytes| forms.check(bytes));
}

#[test]
fn every_fuzzed_input_is_answered_as_a_body_of_dicomweb() {
    replay("related", related::check);
}
