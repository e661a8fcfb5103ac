//! The program as a user calls it.

use std::path::Path;
use std::process::{Command, Output};

use crate::nifti_bytes::Nifti;

fn medialrep(arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_medialrep")).args(arguments).output().unwrap()
}

fn text(path: &Path) -> &str {
    path.to_str().unwrap()
}

#[test]
fn a_refused_file_ends_with_3_and_one_line() {
    let folder = tempfile::tempdir().unwrap();
    let (mask, out) = (folder.path().join("m.nii"), folder.path().join("out"));
    std::fs::write(&mask, Nifti { dim: [4, 4, 3, 2, 5, 1, 1, 1], ..Nifti::small(1) }.bytes()).unwrap();
    let done = medialrep(&["run", text(&mask), "--out", text(&out)]);
    assert_eq!(done.status.code(), Some(3));
    let line = String::from_utf8(done.stderr).unwrap();
    assert_eq!(line.lines().count(), 1, "{line}");
    for part in ["5 volumes", "header.dim[4]", "send one volume", "[several_volumes]"] {
        assert!(line.contains(part), "{line}");
    }
    assert!(done.stdout.is_empty());
    assert_eq!(std::fs::read_dir(out).unwrap().count(), 0);
}

#[test]
fn json_gives_the_problem_object() {
    let folder = tempfile::tempdir().unwrap();
    let mask = folder.path().join("m.nii");
    std::fs::write(&mask, b"no mask").unwrap();
    let done = medialrep(&["run", text(&mask), "--out", text(folder.path()), "--json"]);
    assert_eq!(done.status.code(), Some(3));
    let problem: serde_json::Value = serde_json::from_slice(&done.stderr).unwrap();
    assert_eq!((&problem["code"], &problem["status"]), (&"not_nifti".into(), &415.into()));
}

#[test]
fn wrong_usage_ends_with_2() {
    let folder = tempfile::tempdir().unwrap();
    let (mask, out) = (folder.path().join("m.nii"), folder.path().join("out"));
    std::fs::write(&mask, Nifti::small(1).bytes()).unwrap();
    let (mask, out) = (text(&mask), text(&out));
    for arguments in [
        vec!["run"],
        vec!["run", "/nowhere/at/all.nii", "--out", out],
        vec!["run", mask, "--out", out, "--params", "{\"gird\": 1}"],
        vec!["run", mask, "--out", out, "--params", "@/nowhere/at/all.json"],
        vec!["run", mask, "--out", out, "--threads", "0"],
        vec!["run", mask, "--out", &format!("{mask}/below-a-file")],
        vec!["sample", "nothing", "--out", out],
        vec!["sample", "slab", "--out", out, "--spacing", "1,2"],
        vec!["sample", "slab", "--out", out, "--spacing", "0"],
        vec!["sample", "slab", "--out", out, "--spacing", "0.0001"],
    ] {
        let done = medialrep(&arguments);
        assert_eq!(done.status.code(), Some(2), "{arguments:?}: {}", String::from_utf8_lossy(&done.stderr));
    }
}

#[test]
fn parameters_may_come_from_a_file() {
    let folder = tempfile::tempdir().unwrap();
    let (mask, params) = (folder.path().join("m.nii"), folder.path().join("p.json"));
    std::fs::write(&mask, Nifti::small(1).bytes()).unwrap();
    std::fs::write(&params, "{\"margin\": 7}").unwrap();
    let argument = format!("@{}", text(&params));
    let done = medialrep(&["run", text(&mask), "--out", text(folder.path()), "--params", &argument]);
    assert_eq!(done.status.code(), Some(2));
    assert!(String::from_utf8(done.stderr).unwrap().contains("params.margin"));
}

#[test]
fn sample_lists_and_writes() {
    let listed = String::from_utf8(medialrep(&["sample", "--list"]).stdout).unwrap();
    assert!(listed.lines().any(|line| line.starts_with("leaf ")), "{listed}");
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("leaf.nii.gz");
    let done = medialrep(&["sample", "leaf", "--out", text(&file), "--spacing", "1,1,2", "--rotate-deg", "-20"]);
    assert!(done.status.success());
    let read =
        medialrep::formats::read_file(&file, medialrep::formats::InputLimits::default(), &medialrep::cancel::Never)
            .unwrap();
    let spacing = read.volume.world_from_voxel.spacing_mm();
    assert!((spacing[2] - 2.0).abs() < 1e-5 && read.volume.label_voxels[1] > 1000);
}
