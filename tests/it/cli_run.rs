//! The program as a user calls it.

use std::path::Path;
use std::process::{Command, Output};

use crate::help::dicom_bytes::{self, Frame, Seg};
use crate::help::dicom_read;
use crate::help::nifti_bytes::Nifti;
use crate::help::support::CANARY;

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
fn a_segmentation_gives_the_result_of_the_same_mask() {
    let folder = tempfile::tempdir().unwrap();
    let is_inside = |[x, y, z]: [usize; 3]| (4..44).contains(&x) && (4..30).contains(&y) && (2..10).contains(&z);
    let document = |name: &str, bytes: Vec<u8>| {
        let (mask, out) = (folder.path().join(name), folder.path().join(format!("{name}-out")));
        std::fs::write(&mask, bytes).unwrap();
        let done = medialrep(&["run", text(&mask), "--out", text(&out)]);
        assert!(done.status.success(), "{}", String::from_utf8_lossy(&done.stderr));
        let json = std::fs::read(out.join("thickness.json")).unwrap();
        let mut document: serde_json::Value = serde_json::from_slice(&json).unwrap();
        for part in ["input", "timings_ms"] {
            document.as_object_mut().unwrap().remove(part);
        }
        document["structures"][0].as_object_mut().unwrap().remove("timings_ms");
        document
    };
    let [columns, rows, slices] = [48, 34, 12];
    let slice = |z| (0..rows).flat_map(move |y| (0..columns).map(move |x| [x, y, z]));
    let pixels = |z| slice(z).map(|at| u16::from(is_inside(at)));
    let place = |z: usize| [10.0, 20.0, 30.0 + z as f64];
    let frames = (2..10).map(|z| Frame { position: place(z), segment: 1, pixels: pixels(z).collect() }).collect();
    let seg = Seg { columns, rows, frames, spacing: [1.0; 3], segments: vec![1], ..Seg::small() };
    let mut from_seg = document("mask.dcm", seg.bytes());
    let warnings = from_seg["structures"][0]["warnings"].take();
    assert_eq!(warnings[0]["code"], "edge_unknown");
    assert_eq!(from_seg["structures"][0]["name"].take(), "part 1");
    let [nx, ny, nz] = [columns, rows, slices].map(|n| i64::try_from(n).unwrap());
    let mut nifti = Nifti { dim: [3, nx, ny, nz, 1, 1, 1, 1], ..Nifti::small(1) };
    nifti.srow = [[-1.0, 0.0, 0.0, -10.0], [0.0, -1.0, 0.0, -20.0], [0.0, 0.0, 1.0, 30.0]];
    nifti.pixdim = [1.0; 8];
    nifti.voxels = (0..slices).flat_map(|z| pixels(z).map(|pixel| u8::from(pixel > 0)).collect::<Vec<_>>()).collect();
    let mut from_nifti = document("mask.nii", nifti.bytes());
    from_nifti["structures"][0]["warnings"].take();
    assert_eq!(from_seg, from_nifti);
}

/// A slab of 24 × 18 × 6 mm in a segmentation.
fn slab() -> Seg {
    let [columns, rows] = [30, 24];
    let is_in = |x: usize, y: usize| (3..27).contains(&x) && (3..21).contains(&y);
    let pixels = (0..rows).flat_map(|y| (0..columns).map(move |x| u16::from(is_in(x, y))));
    let pixels: Vec<u16> = pixels.collect();
    let frame = |z: i32| Frame { position: [0.0, 0.0, z.into()], segment: 1, pixels: pixels.clone() };
    let frames = (0..6).map(frame).collect();
    Seg { columns, rows, frames, spacing: [1.0; 3], segments: vec![1], ..Seg::small() }
}

#[test]
fn patient_and_study_of_a_dicom_mask_are_in_its_dicom_results_and_nowhere_else() {
    let folder = tempfile::tempdir().unwrap();
    let (file, out) = (folder.path().join("seg.dcm"), folder.path().join("out"));
    let mut dicom = slab().dicom();
    dicom.set(dicom_bytes::text(0x0008_0005, "CS", "ISO_IR 100"));
    dicom.set(dicom_bytes::text(0x0010_0010, "PN", CANARY));
    dicom.set(dicom_bytes::text(0x0020_000d, "UI", "1.2.3.4"));
    dicom.set(dicom_bytes::text(0x0020_0052, "UI", "1.2.3.5"));
    let code = [(0x0008_0100, "SH", "64033007"), (0x0008_0102, "SH", "SCT"), (0x0008_0104, "LO", "Kidney")];
    let code = code.map(|(tag, kind, value)| dicom_bytes::text(tag, kind, value)).to_vec();
    let segment = &mut dicom.items(0x0062_0002)[0];
    segment.retain(|element| element.0 != 0x0062_000f);
    segment.push(dicom_bytes::sequence(0x0062_000f, vec![code]));
    std::fs::write(&file, dicom.bytes()).unwrap();
    let params = r#"{"outputs": ["thickness.json", "model.glb", "report.sr.dcm", "picture.dcm"]}"#;
    let done = medialrep(&["run", text(&file), "--out", text(&out), "--params", params]);
    assert_eq!(done.status.code(), Some(0), "{}", String::from_utf8_lossy(&done.stderr));
    for name in ["report.sr.dcm", "picture.dcm"] {
        let (_, set) = dicom_read::read(&std::fs::read(out.join(name)).unwrap());
        assert_eq!(dicom_read::text(&set, 0x0010_0010), CANARY, "{name}");
        assert_eq!(dicom_read::text(&set, 0x0020_000d), "1.2.3.4", "{name}");
    }
    let (_, report) = dicom_read::read(&std::fs::read(out.join("report.sr.dcm")).unwrap());
    let groups = dicom_read::sequence(dicom_read::sequence(&report, 0x0040_a730).last().unwrap(), 0x0040_a730);
    let finding = dicom_read::sequence(&groups[0], 0x0040_a730).iter();
    let findings: Vec<_> = finding.filter(|item| dicom_read::code(item, 0x0040_a043) == "121071").collect();
    assert_eq!(dicom_read::code(findings[0], 0x0040_a168), "64033007");
    for name in ["thickness.json", "model.glb"] {
        let bytes = std::fs::read(out.join(name)).unwrap();
        assert!(!bytes.windows(CANARY.len()).any(|window| window == CANARY.as_bytes()), "{name}");
    }
    let told = [done.stdout, done.stderr].concat();
    assert!(!String::from_utf8_lossy(&told).contains(CANARY));
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
fn the_only_mask_in_a_folder_is_found_among_other_files() {
    let folder = tempfile::tempdir().unwrap();
    let series = folder.path().join("study/series");
    std::fs::create_dir_all(&series).unwrap();
    std::fs::write(folder.path().join("DICOMDIR"), b"nothing of ours").unwrap();
    let out = folder.path().join("out");
    let run = || medialrep(&["run", text(folder.path()), "--out", text(&out)]);
    let none = run();
    assert_eq!(none.status.code(), Some(2));
    assert!(String::from_utf8_lossy(&none.stderr).contains("none of the 1 files"));
    std::fs::write(series.join("mask.dcm"), Nifti::small(1).bytes()).unwrap();
    // Too small to be represented, but read.
    assert_eq!(run().status.code(), Some(4));
}

#[test]
fn each_of_several_masks_has_a_folder_and_a_refused_one_holds_up_no_other() {
    let folder = tempfile::tempdir().unwrap();
    let [series, out] = ["series", "out"].map(|name| folder.path().join(name));
    std::fs::create_dir(&series).unwrap();
    std::fs::write(series.join("a.dcm"), Nifti::small(1).bytes()).unwrap();
    std::fs::write(series.join("readme"), b"nothing of ours").unwrap();
    for file in [series.join("b.nii.gz"), folder.path().join("b.nii.gz")] {
        assert!(medialrep(&["sample", "slab", "--out", text(&file), "--spacing", "2"]).status.success());
    }
    let alone = folder.path().join("b.nii.gz");
    let run = |option: &str| medialrep(&["run", text(&series), text(&alone), "--out", text(&out), option]);
    let done = run("--json");
    assert_eq!(done.status.code(), Some(4), "that of the first that is refused");
    let lines = |bytes: &[u8]| -> Vec<serde_json::Value> {
        String::from_utf8_lossy(bytes).lines().map(|line| serde_json::from_str(line).unwrap()).collect()
    };
    let (told, refused) = (lines(&done.stdout), lines(&done.stderr));
    let masks: Vec<&serde_json::Value> = told.iter().chain(&refused).map(|line| &line["mask"]).collect();
    assert_eq!(masks, ["b", "b-2", "a"]);
    for (name, count) in [("a", 0), ("b", 4), ("b-2", 4)] {
        assert_eq!(std::fs::read_dir(out.join(name)).unwrap().count(), count, "{name}");
    }
    let (told, refused) = (run("--threads=1"), run("--quiet"));
    let [told, refused] = [told.stdout, refused.stderr].map(|bytes| String::from_utf8(bytes).unwrap());
    assert!(told.starts_with("b\n") && told.contains("\nb-2\n"), "{told}");
    assert!(refused.starts_with("medialrep: a: ") && refused.lines().count() == 1, "{refused}");
}

#[test]
fn what_goes_wrong_in_the_first_minutes_is_told_in_one_line() {
    let folder = tempfile::tempdir().unwrap();
    let file = |name: &str, bytes: &[u8]| {
        std::fs::write(folder.path().join(name), bytes).unwrap();
        text(&folder.path().join(name)).to_owned()
    };
    let nothing = Nifti { voxels: vec![0; 24], ..Nifti::small(1) };
    let (mask, empty) = (file("m.nii", &Nifti::small(1).bytes()), file("e.nii", &nothing.bytes()));
    let (picture, params) = (file("p.png", b"\x89PNG\r\n\x1a\n"), file("p.json", b"{}"));
    let (dir, out) = (text(folder.path()), text(&folder.path().join("out")).to_owned());
    let run = |mask: &str, out: &str, params: &str| ["run", mask, "--out", out, "--params", params].map(str::to_owned);
    for (arguments, code, words) in [
        (run("/nowhere.nii", &out, "{}"), 2, vec!["/nowhere.nii", "No such file", "check the path"]),
        (run(&mask, &params, "{}"), 2, vec![&params, "is a file", "name another folder"]),
        (run(&mask, "/proc", "{}"), 2, vec!["cannot write into the folder /proc", "make it writable"]),
        (run(&mask, "/proc/results", "{}"), 2, vec!["cannot make the folder /proc/results", "name another folder"]),
        (run(&picture, &out, "{}"), 3, vec!["it looks like a PNG picture", "NIfTI"]),
        (run(&empty, &out, "{}"), 3, vec!["the mask is empty", "at least one non-zero voxel"]),
        (run(&mask, &out, "{grid: 6}"), 2, vec!["not valid JSON", "line 1 column 2", "such as"]),
        (run(&mask, &out, &params), 2, vec!["not valid JSON", "--params @"]),
        (run(&mask, &out, "@/nowhere.json"), 2, vec!["/nowhere.json", "No such file", "check the path"]),
        (run(&mask, &out, "{\"gird\": 6}"), 2, vec!["gird", "unknown name", "labels, grid, "]),
        (["sample", "leafs", "--out", &out, "--spacing", "1"].map(str::to_owned), 2, vec!["no sample", "leaf, "]),
        (["sample", "leaf", "--out", dir, "--spacing", "1"].map(str::to_owned), 2, vec!["cannot write", dir, "--out"]),
        (["run", &mask, "--params", "{}", "--threads", "2"].map(str::to_owned), 2, vec!["--out <DIR>", "run --help"]),
    ] {
        let done = medialrep(&arguments.each_ref().map(String::as_str));
        let line = String::from_utf8(done.stderr).unwrap();
        assert_eq!((done.status.code(), line.lines().count()), (Some(code), 1), "{arguments:?}: {line}");
        assert!(line.starts_with("medialrep: ") && done.stdout.is_empty(), "{line}");
        for word in words {
            assert!(line.contains(word), "{word}: {line}");
        }
    }
}

#[test]
fn a_run_ends_with_what_became_of_each_structure() {
    let folder = tempfile::tempdir().unwrap();
    let mask = folder.path().join("m.nii.gz");
    assert!(medialrep(&["sample", "slab", "--out", text(&mask), "--spacing", "2"]).status.success());
    let run = |option: &[&str]| {
        let done = medialrep(&[&["run", text(&mask), "--out", text(folder.path())], option].concat());
        assert!(done.status.success() && done.stderr.is_empty(), "{}", String::from_utf8_lossy(&done.stderr));
        String::from_utf8(done.stdout).unwrap()
    };
    let table = run(&[]);
    let lines: Vec<Vec<&str>> = table.lines().map(|line| line.split_whitespace().collect()).collect();
    assert_eq!(lines[0].join(" "), "label figures verdict mean thickness first reason", "{table}");
    let written: serde_json::Value =
        serde_json::from_slice(&std::fs::read(folder.path().join("thickness.json")).unwrap()).unwrap();
    let structure = &written["structures"][0];
    let (mean, verdict) = (&structure["thickness_summary"]["total_mm"]["mean"], &structure["quality"]["verdict"]);
    let shown = format!("{:.2}", mean.as_f64().unwrap());
    assert_eq!(lines[1][..5], ["1", "1", verdict.as_str().unwrap(), &shown, "mm"], "{table}");

    let line: serde_json::Value = serde_json::from_str(&run(&["--json"])).unwrap();
    assert_eq!((&line["mean_thickness_mm"], &line["verdict"]), (mean, verdict));
    assert_eq!((&line["label"], &line["figures"], &line["name"]), (&1.into(), &1.into(), &serde_json::Value::Null));
    assert_eq!(run(&["--quiet"]), "");
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
    let spacing = read.volume.world_from_voxel().spacing_mm();
    assert!((spacing[2] - 2.0).abs() < 1e-5 && read.volume.voxels_of(1) > 1000);
}
