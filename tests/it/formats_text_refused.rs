//! What the readers of headers of text refuse, NRRD and MetaImage: one literal input per case.

use std::time::Instant;

use medialrep::formats::readers::{check_header, check_magic};
use medialrep::formats::{InputLimits, read};
use medialrep::problem::Problem;

use crate::help::nifti_bytes::gzip;
use crate::help::reading::Counting;
use crate::help::text_bytes::{TextFile, zlib};

fn refusal(bytes: &[u8]) -> Problem {
    Problem::from(&read(bytes, InputLimits::default()).unwrap_err())
}

#[track_caller]
fn check_refused(bytes: &[u8], code: &str, status: u16, location: &str) {
    let problem = refusal(bytes);
    assert_eq!((problem.code.as_str(), problem.status), (code, status), "{}", problem.detail);
    assert_eq!(problem.location.as_deref(), Some(location));
    assert!(problem.hint.is_some_and(|hint| !hint.is_empty()));
}

/// That a line is refused where it stands, and without reading further than the header.
#[track_caller]
fn check_line(file: &TextFile, field: &str, value: &str, code: &str, status: u16) {
    let file = file.clone().with(field, value);
    let line = file.line_of(field);
    check_refused(&file.bytes(), code, status, &format!("header line {line} ({field})"));
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("file");
    std::fs::write(&path, file.bytes()).unwrap();
    assert_eq!(check_header(&path, InputLimits::default()).unwrap_err().code(), code);
}

#[test]
fn voxels_in_another_file_are_refused_and_it_is_not_opened() {
    for name in ["/etc/passwd", "a.raw", "LIST", "a%03d.raw 1 9 1"] {
        check_line(&TextFile::nrrd(), "data file", name, "detached_header", 415);
        let squeezed = TextFile::nrrd().with("datafile", name);
        assert_eq!(refusal(&squeezed.bytes()).code, "detached_header");
        check_line(&TextFile::metaimage(), "ElementDataFile", name, "detached_header", 415);
    }
}

#[test]
fn lines_of_nrrd() {
    let file = TextFile::nrrd().with("endian", "little");
    for (field, value) in [
        ("type", "quark"),
        ("dimension", "three"),
        ("dimension", "-3"),
        ("dimension", "0"),
        ("sizes", "4 3"),
        ("sizes", "4 3 2 1"),
        ("sizes", "4 0 2"),
        ("sizes", "4 -3 2"),
        ("sizes", "4 3 99999999999999999999999"),
        ("sizes", "4 3 2.5"),
        ("encoding", "rot13"),
        ("space directions", "(1,0,0) (0,2,0)"),
        ("space directions", "(1,0,0) (0,2,0) (0,0)"),
        ("space directions", "(1,0,0) (0,2,0) none"),
        ("space directions", "(1,0,0) (0,2,0) (0,0,nan)"),
        ("space directions", "(1,0,0) (0,2,0) (0,0,1e300)"),
        ("space directions", "1 0 0 0 2 0 0 0 3"),
        ("space directions", "(1,0,0) (0,2,0) (0,0,3"),
        ("space origin", "(1,2,3) (4,5,6)"),
        ("space origin", "(1,2)"),
        ("space origin", "(inf,2,3)"),
        ("byte skip", "many"),
        ("byte skip", "99999999999"),
        ("line skip", "-2"),
    ] {
        check_line(&file, field, value, "bad_header_line", 400);
    }
    check_line(&file.clone().with("type", "short"), "endian", "middle", "bad_header_line", 400);
    for (field, value) in [
        ("type", "block"),
        ("dimension", "2"),
        ("dimension", "5"),
        ("encoding", "bzip2"),
        ("encoding", "hex"),
        ("encoding", "zrl"),
        ("space", "scanner-xyz"),
        ("space", "left-posterior-superior-time"),
        ("byte skip", "-1"),
        ("space units", "\"mm\" \"mm\" \"cm\""),
    ] {
        check_line(&file, field, value, "unsupported_header", 422);
    }
    for value in ["(1,0,0) (2,0,0) (0,0,3)", "(0,0,0) (0,2,0) (0,0,3)", "(1000000,0,0) (0,2,0) (0,0,3)"] {
        check_line(&file, "space directions", value, "bad_affine", 422);
    }
    check_line(&file, "sizes", "100000 100000 1000", "too_many_voxels", 413);
    check_line(&file, "sizes", "9223372036854775807 9223372036854775807 2", "too_many_voxels", 413);
}

#[test]
fn a_space_that_is_not_named_is_refused() {
    let bare = TextFile::nrrd().without("space");
    let directions = bare.line_of("space directions");
    let location = format!("header line {directions} (space directions)");
    check_refused(&bare.bytes(), "unsupported_header", 422, &location);
    check_line(&bare, "space dimension", "3", "unsupported_header", 422);
    check_line(&bare, "space dimension", "4", "unsupported_header", 422);
}

#[test]
fn lines_that_are_needed() {
    for field in ["type", "dimension", "sizes", "encoding", "space directions"] {
        check_refused(&TextFile::nrrd().without(field).bytes(), "missing_header_line", 400, "the header");
    }
    check_refused(&TextFile::nrrd().with("type", "short").bytes(), "missing_header_line", 400, "the header");
    let placeless = TextFile::nrrd().without("space").without("space directions");
    check_refused(&placeless.bytes(), "missing_header_line", 400, "the header");
    for field in ["ElementType", "DimSize", "ElementSpacing"] {
        check_refused(&TextFile::metaimage().without(field).bytes(), "missing_header_line", 400, "the header");
    }
}

#[test]
fn a_field_that_is_given_twice_is_refused() {
    let mut file = TextFile::nrrd();
    file.lines.push(("datafile".to_owned(), "x".to_owned()));
    file.lines.push(("data file".to_owned(), "y".to_owned()));
    check_refused(&file.bytes(), "bad_header_line", 400, "header line 11 (data file)");
    let twice = TextFile::metaimage().with("Origin", "1 2 3");
    let line = twice.line_of("Origin");
    check_refused(&twice.bytes(), "bad_header_line", 400, &format!("header line {line} (Offset)"));
}

#[test]
fn axes_that_are_neither_space_nor_layers() {
    let series = TextFile::nrrd()
        .with("dimension", "4")
        .with("kinds", "domain domain domain time")
        .with("space directions", "(1,0,0) (0,2,0) (0,0,3) none");
    check_line(&series, "sizes", "4 3 2 5", "several_volumes", 422);
    let colour = TextFile::nrrd()
        .with("dimension", "4")
        .with("sizes", "3 4 3 2")
        .with("space directions", "none (1,0,0) (0,2,0) (0,0,3)");
    for kind in ["RGB-color domain domain domain", "vector domain domain domain"] {
        check_line(&colour, "kinds", kind, "unsupported_header", 422);
    }
    // Four kinds that are not known, and no direction: a series, whichever axis it runs along.
    let series = TextFile::nrrd().without("space directions").with("dimension", "4").with("spacings", "1 1 2 1");
    let series = series.with("kinds", "??? ??? ??? ???");
    check_line(&series, "sizes", "4 3 2 5", "several_volumes", 422);
    let listed = colour.with("kinds", "list domain domain domain");
    check_line(&listed, "sizes", "1025 4 3 2", "unsupported_header", 422);
    check_line(&listed, "sizes", "1000 1000 1000 500", "too_many_voxels", 413);
}

#[test]
fn segments_that_all_overlap_are_refused_beyond_so_many_layers() {
    let file = |layers: usize| {
        TextFile::nrrd()
            .with("dimension", "4")
            .with("sizes", &format!("{layers} 4 3 2"))
            .with("kinds", "list domain domain domain")
            .with("space directions", "none (1,0,0) (0,2,0) (0,0,3)")
            .body(vec![1; layers * 24])
    };
    check_refused(&file(65).bytes(), "too_many_layers", 422, "the voxels");
    let most = read(file(64).bytes().as_slice(), InputLimits::default()).unwrap();
    assert_eq!(most.volume.layers().count(), 64);
}

#[test]
fn lines_of_metaimage() {
    let file = TextFile::metaimage();
    for (field, value) in [
        ("NDims", "three"),
        ("DimSize", "4 3"),
        ("DimSize", "4 3 2 1"),
        ("DimSize", "4 0 2"),
        ("DimSize", "4 3 -2"),
        ("ElementType", "uchar"),
        ("BinaryData", "perhaps"),
        ("CompressedData", ""),
        ("ElementSpacing", "1 2"),
        ("ElementSpacing", "1 2 nan"),
        ("TransformMatrix", "1 0 0 0 1 0 0 0"),
        ("TransformMatrix", "1 0 0 0 1 0 0 0 1 0"),
        ("Offset", "1 2 1e300"),
    ] {
        check_line(&file, field, value, "bad_header_line", 400);
    }
    for (field, value) in [
        ("ObjectType", "Mesh"),
        ("NDims", "5"),
        ("ElementType", "MET_UCHAR_ARRAY"),
        ("ElementNumberOfChannels", "3"),
        ("HeaderSize", "-1"),
        ("DistanceUnits", "cm"),
    ] {
        check_line(&file, field, value, "unsupported_header", 422);
    }
    check_line(&file, "TransformMatrix", "1 0 0 1 0 0 0 0 1", "bad_affine", 422);
    check_line(&file.clone().without("TransformMatrix"), "ElementSpacing", "0 2 3", "bad_affine", 422);
    check_line(&file, "DimSize", "100000 100000 1000", "too_many_voxels", 413);
    check_line(&file.clone().with("NDims", "4"), "DimSize", "4 3 2 7", "several_volumes", 422);
}

#[test]
fn lines_that_are_none() {
    let location = |line: u64| format!("header line {line}");
    check_refused(b"NRRD0004\nno colon\n\n", "bad_header_line", 400, &location(2));
    check_refused(b"NRRD0009\ntype: uchar\n\n", "unsupported_header", 422, &location(1));
    check_refused(b"NDims = 3\nno sign\n", "bad_header_line", 400, &location(2));
    for text in ["NRRD", "NDims", "ObjectType of beauty", "key = value\n", "Comment = only\n"] {
        assert!(check_magic(text.as_bytes()).is_err_and(|error| error.code() == "not_nifti"), "{text}");
    }
}

#[test]
fn voxels_that_are_no_labels_or_do_not_come() {
    let reals: Vec<u8> = [1.0f32, 0.3].repeat(12).iter().flat_map(|x| x.to_le_bytes()).collect();
    let floats = TextFile::nrrd().with("type", "float").with("endian", "little").body(reals.clone());
    check_refused(&floats.bytes(), "not_a_label_map", 422, "voxel [1, 0, 0]");
    let floats = TextFile::metaimage().with("ElementType", "MET_FLOAT").body(reals);
    check_refused(&floats.bytes(), "not_a_label_map", 422, "voxel [1, 0, 0]");
    for file in [TextFile::nrrd(), TextFile::metaimage()] {
        let bytes = file.bytes();
        for missing in [1, 23, 24] {
            let kept = bytes.len() - missing;
            check_refused(&bytes[..kept], "truncated", 400, &format!("byte {kept}"));
        }
        for kept in [60, bytes.len() - 30] {
            assert!(["truncated", "bad_header_line"].contains(&refusal(&bytes[..kept]).code.as_str()), "{kept}");
        }
    }
    let text = |body: &[u8]| TextFile::nrrd().with("encoding", "ascii").body(body.to_vec()).bytes();
    assert_eq!(refusal(&text(b"1 2 3")).code, "truncated");
    for number in ["x", "256", "-1", "1.5", "0x1", &"1".repeat(1000)] {
        assert_eq!(refusal(&text(format!("0 {number} 2").as_bytes())).code, "bad_number", "{number}");
    }
}

#[test]
fn packed_voxels_that_are_damaged() {
    let voxels: Vec<u8> = (0..24).collect();
    let packed = TextFile::nrrd().with("encoding", "gzip");
    let whole = gzip(&voxels);
    for kept in [0, 5, whole.len() / 2, whole.len() - 9, whole.len() - 1] {
        assert_eq!(refusal(&packed.clone().body(whole[..kept].to_vec()).bytes()).code, "truncated", "{kept}");
    }
    let mut wrong = whole.clone();
    let at = wrong.len() - 8;
    wrong[at] ^= 1;
    assert_eq!(refusal(&packed.clone().body(wrong).bytes()).code, "bad_checksum");
    assert_eq!(refusal(&packed.clone().body(gzip(&voxels[..20])).bytes()).code, "truncated");
    assert_eq!(refusal(&packed.clone().body(voxels.clone()).bytes()).code, "corrupt_gzip");
    let long = [voxels.clone(), vec![0; (1 << 20) + 1]].concat();
    assert_eq!(refusal(&packed.body(gzip(&long)).bytes()).code, "trailing_data");
    let zlibbed = TextFile::metaimage().with("CompressedData", "True");
    let whole = zlib(&voxels);
    for kept in [0, 5, whole.len() - 1] {
        assert_eq!(refusal(&zlibbed.clone().body(whole[..kept].to_vec()).bytes()).code, "truncated", "{kept}");
    }
    let mut wrong = whole;
    let at = wrong.len() - 1;
    wrong[at] ^= 1;
    assert_eq!(refusal(&zlibbed.body(wrong).bytes()).code, "corrupt_gzip");
}

#[test]
fn bytes_after_packed_voxels_are_told() {
    let file = TextFile::nrrd().with("encoding", "gzip").body([gzip(&TextFile::nrrd().body), b"\n".to_vec()].concat());
    let found = read(file.bytes().as_slice(), InputLimits::default()).unwrap();
    assert_eq!(found.volume.notices()[0].code, "bytes_after_gzip");
    assert_eq!(found.bytes, file.bytes().len() as u64);
}

#[test]
fn hostile_headers_are_refused_in_time() {
    let start = Instant::now();
    let endless = [b"NRRD0004\ncontent: ".to_vec(), vec![b'x'; 64 << 20]].concat();
    check_refused(&endless, "bad_header_line", 400, "header line 2");
    let many = [b"NRRD0004\n".to_vec(), b"a:=b\n".repeat(4 << 20)].concat();
    assert_eq!(refusal(&many).code, "bad_header_line");
    let mut segments = b"NRRD0004\n".to_vec();
    for n in 0..700_000 {
        segments.extend(format!("Segment{n}_Name:=n\n").into_bytes());
    }
    assert_eq!(refusal(&segments).code, "truncated");
    let keys = [b"NDims = 3\n".to_vec(), b"A = b\n".repeat(4 << 20)].concat();
    assert_eq!(refusal(&keys).code, "bad_header_line");
    let claim = TextFile::nrrd().with("sizes", "800 800 800").with("encoding", "gzip").body(gzip(&[1; 300]));
    assert_eq!(refusal(&claim.bytes()).code, "truncated");
    let claim = TextFile::metaimage().with("DimSize", "800 800 800");
    assert_eq!(refusal(&claim.bytes()).code, "truncated");
    assert!(start.elapsed().as_secs() < 20, "{:?}", start.elapsed());
}

#[test]
fn a_bomb_within_the_file_is_left_unread() {
    let bomb = gzip(&[(0..24).collect(), vec![0; 64 << 20]].concat());
    let bytes = TextFile::nrrd().with("encoding", "gzip").body(bomb).bytes();
    let mut taken = 0;
    let error = read(Counting(&bytes, &mut taken), InputLimits::default()).unwrap_err();
    assert_eq!(error.code(), "trailing_data");
    assert!(taken < bytes.len() / 2, "{taken} of {} bytes were read", bytes.len());
    let dims = TextFile::nrrd().with("sizes", "1024 1024 64").with("encoding", "gzip").body(gzip(&vec![0; 64 << 20]));
    let limits = InputLimits { max_decompressed_bytes: 1 << 20, ..InputLimits::default() };
    assert_eq!(read(dims.bytes().as_slice(), limits).unwrap_err().code(), "decompressed_too_large");
}

#[test]
fn no_text_of_the_header_is_repeated() {
    let lines = TextFile::nrrd().lines;
    for (field, _) in &lines {
        let file = TextFile::nrrd().with(field, "CANARY").with("Segment0_Name", "CANARY").with("content", "CANARY");
        let problem = serde_json::to_string(&refusal(&file.with("byte skip", "CANARY").bytes())).unwrap();
        assert!(!problem.contains("CANARY"), "{field}: {problem}");
    }
    for (field, _) in &TextFile::metaimage().lines {
        let file = TextFile::metaimage().with("Comment", "CANARY").with("HeaderSize", "CANARY").with(field, "CANARY");
        let problem = serde_json::to_string(&refusal(&file.bytes())).unwrap();
        assert!(!problem.contains("CANARY"), "{field}: {problem}");
    }
}
