//! What the NRRD reader reads, from files made here.

use medialrep::formats::{InputLimits, read};
use medialrep::space::{Label, LabelVolume};

use crate::help::nifti_bytes::gzip;
use crate::help::reading::{check_place, read_all, values};
use crate::help::text_bytes::{TextFile, stored};

fn codes(volume: &LabelVolume) -> Vec<&'static str> {
    volume.notices().iter().map(|notice| notice.code).collect()
}

#[test]
fn a_small_file_is_read_with_voxels_place_and_name_of_the_format() {
    let found = read_all(&TextFile::nrrd());
    assert_eq!((found.format, found.volume.dims()), ("nrrd", [4, 3, 2]));
    assert_eq!(values(&found.volume), (0..24).collect::<Vec<_>>());
    assert!(found.volume.notices().is_empty());
    let packed = read(gzip(&TextFile::nrrd().bytes()).as_slice(), InputLimits::default()).unwrap();
    assert_eq!((packed.format, packed.volume), ("nrrd.gz", found.volume));
}

#[test]
fn every_type_is_read_in_both_byte_orders_and_every_encoding() {
    let expected: Vec<i8> = (0..24).map(|n| n % 3).collect();
    let types = [
        "signed char",
        "int8",
        "uchar",
        "unsigned char",
        "uint8",
        "short",
        "int16",
        "ushort",
        "unsigned short",
        "uint16",
        "int",
        "int32",
        "uint",
        "uint32",
        "longlong",
        "int64",
        "unsigned long long int",
        "uint64_t",
        "float",
        "double",
    ];
    for name in types {
        for endian in ["little", "big"] {
            let body = stored(name, &expected, endian == "big");
            let raw = TextFile::nrrd().with("type", name).with("endian", endian).body(body.clone());
            let packed = raw.clone().with("encoding", "gzip").body(gzip(&body));
            for file in [raw, packed] {
                let found = values(&read_all(&file).volume);
                assert_eq!(found, expected.iter().map(|n| i64::from(*n)).collect::<Vec<_>>(), "{name}, {endian}");
            }
        }
    }
}

#[test]
fn text_is_read_as_numbers_between_spaces_lines_or_commas() {
    let text = b"0 1 2\n3,4, 5\r\n6\t7 8 9 10 11 12 13 14 15 16 17 18 19 20 21 22 23".to_vec();
    for (name, encoding) in [("uchar", "ascii"), ("int", "text"), ("double", "TXT")] {
        let file = TextFile::nrrd().with("type", name).with("encoding", encoding).body(text.clone());
        assert_eq!(values(&read_all(&file).volume), (0..24).collect::<Vec<_>>(), "{name}");
    }
    let signed = b"-7 ".repeat(24);
    let file = TextFile::nrrd().with("type", "short").with("encoding", "ascii").body(signed);
    assert_eq!(values(&read_all(&file).volume), [-7; 24]);
}

#[test]
fn names_of_fields_are_read_in_any_case_with_and_without_spaces_and_with_either_line_end() {
    let mut file = TextFile::nrrd();
    let expected = read_all(&file).volume;
    for line in &mut file.lines {
        line.0 = line.0.to_uppercase().replace(' ', "");
    }
    assert_eq!(read_all(&file).volume, expected);
    let text = String::from_utf8(TextFile::nrrd().body(Vec::new()).bytes()).unwrap();
    let crlf = [text.replace('\n', "\r\n").as_bytes(), &TextFile::nrrd().body].concat();
    assert_eq!(read(crlf.as_slice(), InputLimits::default()).unwrap().volume, expected);
    let with_comment = text.replacen('\n', "\n# a comment: with a colon\nunknown: field\n", 1);
    let commented = [with_comment.as_bytes(), &TextFile::nrrd().body].concat();
    assert_eq!(read(commented.as_slice(), InputLimits::default()).unwrap().volume, expected);
}

#[test]
fn every_version_is_read() {
    let expected = read_all(&TextFile::nrrd()).volume;
    for magic in ["NRRD00.01\n", "NRRD0001\n", "NRRD0002\n", "NRRD0003\n", "NRRD0005\n"] {
        assert_eq!(read_all(&TextFile { magic, ..TextFile::nrrd() }).volume, expected, "{magic}");
    }
}

#[test]
fn each_space_is_turned_into_ras() {
    for (names, first, last) in [
        (["left-posterior-superior", "LPS"], [-10.0, -20.0, -30.0], [-13.0, -24.0, -27.0]),
        (["left-anterior-superior", "las"], [-10.0, 20.0, -30.0], [-13.0, 24.0, -27.0]),
        (["right-anterior-superior", "RAS"], [10.0, 20.0, -30.0], [13.0, 24.0, -27.0]),
    ] {
        for name in names {
            check_place(&TextFile::nrrd().with("space", name), first, last);
        }
    }
}

#[test]
fn directions_turn_shear_and_scale_the_voxels() {
    let turned = TextFile::nrrd().with("space", "RAS").with("space directions", "(0, 1, 0)(-2,0,0) ( 0,1e0,3)");
    check_place(&turned, [10.0, 20.0, -30.0], [6.0, 24.0, -27.0]);
    let centimetres = TextFile::nrrd().with("space", "RAS").with("space units", r#""cm" "cm" "cm""#);
    check_place(&centimetres, [100.0, 200.0, -300.0], [130.0, 240.0, -270.0]);
}

#[test]
fn what_was_assumed_of_the_place_is_told() {
    let bare = TextFile::nrrd().without("space").without("space directions").without("space origin");
    let spaced = bare.with("spacings", "1 2 3");
    check_place(&spaced, [0.0; 3], [3.0, 4.0, 3.0]);
    assert_eq!(codes(&read_all(&spaced).volume), ["no_orientation"]);
    assert_eq!(codes(&read_all(&TextFile::nrrd().without("space origin")).volume), ["no_origin"]);
    let parsecs = TextFile::nrrd().with("space units", r#""pc" "pc" "pc""#);
    assert_eq!(codes(&read_all(&parsecs).volume), ["unknown_unit"]);
}

#[test]
fn skipped_lines_and_bytes_are_no_voxels() {
    let voxels: Vec<u8> = (0..24).collect();
    let after_lines = TextFile::nrrd().with("line skip", "2").body([b"one\ntwo\n", voxels.as_slice()].concat());
    let after_bytes = TextFile::nrrd().with("byte skip", "3").body([b"abc", voxels.as_slice()].concat());
    let packed = gzip(&[b"abc", voxels.as_slice()].concat());
    let within = TextFile::nrrd().with("encoding", "gz").with("byte skip", "3").body(packed);
    for file in [after_lines, after_bytes, within] {
        assert_eq!(values(&read_all(&file).volume), (0..24).collect::<Vec<_>>());
    }
}

/// Two layers of 4 × 3 × 2 voxels: 1 and 2 in the first, 1 in the second, the last three voxels of each row of 12.
fn layered() -> TextFile {
    let mut body = Vec::new();
    for voxel in 0..24 {
        body.extend(match voxel % 12 {
            0..=3 => [1, 0],
            4..=7 => [2, 0],
            9.. => [0, 1],
            _ => [0, 0],
        });
    }
    TextFile::nrrd()
        .with("dimension", "4")
        .with("sizes", "2 4 3 2")
        .with("kinds", "list domain domain domain")
        .with("space directions", "none (1,0,0) (0,2,0) (0,0,3)")
        .body(body)
}

fn with_segment(file: TextFile, number: usize, name: &str, color: &str, value: &str, layer: &str) -> TextFile {
    let key = |what| format!("Segment{number}_{what}");
    file.with(&key("Name"), name)
        .with(&key("Color"), color)
        .with(&key("LabelValue"), value)
        .with(&key("Layer"), layer)
        .with(&key("Extent"), "0 3 0 2 0 1")
}

fn told(value: i64, name: &str, color: [u8; 3]) -> Label {
    Label { value, name: Some(name.to_owned()), color: Some(color), code: None }
}

#[test]
fn segments_give_labels_their_names_and_colours() {
    let file = TextFile::nrrd().body([0, 5, 7].repeat(8));
    let file = with_segment(file, 0, "liver", "0.8 0.2 0", "5", "0");
    let file = with_segment(file, 1, "Milz ÄÖ", "0 0 1", "7", "0");
    let found = read_all(&with_segment(file, 2, "nowhere", "1 1 1", "9", "0"));
    assert_eq!(found.volume.labels(), [told(5, "liver", [204, 51, 0]), told(7, "Milz ÄÖ", [0, 0, 255])]);
    assert!(found.volume.notices().is_empty());
}

#[test]
fn layers_that_share_no_voxel_become_one_label_map_with_the_numbers_of_the_segments() {
    let file = with_segment(layered(), 0, "a", "1 0 0", "1", "0");
    let file = with_segment(file, 1, "b", "0 1 0", "2", "0");
    let found = read_all(&with_segment(file, 2, "c", "0 0 1", "1", "1"));
    let labels = [told(1, "a", [255, 0, 0]), told(2, "b", [0, 255, 0]), told(3, "c", [0, 0, 255])];
    assert_eq!(found.volume.labels(), labels);
    assert_eq!(values(&found.volume), [1, 1, 1, 1, 2, 2, 2, 2, 0, 3, 3, 3].repeat(2));
    assert_eq!(codes(&found.volume), ["labels_renumbered"]);
}

#[test]
fn layers_whose_values_differ_keep_them() {
    let body = layered().body.chunks(2).flat_map(|pair| [pair[0], 9 * pair[1]]).collect();
    let found = read_all(&layered().body(body));
    assert_eq!(values(&found.volume), [1, 1, 1, 1, 2, 2, 2, 2, 0, 9, 9, 9].repeat(2));
    assert!(codes(&found.volume).is_empty());
}

#[test]
fn a_segment_without_a_layer_is_the_value_1_of_a_layer_of_its_own() {
    let body = layered().body.iter().map(|value| u8::from(*value == 1)).collect();
    let file = layered().body(body).with("Segment0_Name", "first").with("Segment1_Name", "second");
    let names: Vec<_> = read_all(&file).volume.labels().iter().map(|label| label.name.clone().unwrap()).collect();
    assert_eq!(names, ["first", "second"]);
}

#[test]
fn slicer_4_placed_the_kept_part_by_its_extent_in_ras() {
    let file = TextFile::nrrd()
        .without("space")
        .with("dimension", "4")
        .with("space dimension", "4")
        .with("sizes", "4 3 2 1")
        .with("kinds", "domain domain domain domain")
        .with("space directions", "(-1,0,0,0) (0,-2,0,0) (0,0,3,0) (0,0,0,1)")
        .with("space origin", "(250,250,-120,0)")
        .with("Segmentation_Extent", "100 103 50 52 -2 -1")
        .with("Segment0_DefaultColor", "0.5 0.5 0.5")
        .with("Segment0_Name", "bladder")
        .body(vec![1; 24]);
    check_place(&file, [150.0, 150.0, -126.0], [147.0, 146.0, -123.0]);
    assert_eq!(read_all(&file).volume.labels(), [told(1, "bladder", [128, 128, 128])]);
    let second: Vec<u8> = (0..48).map(|n| u8::from((n < 24) != (n % 24 < 12))).collect();
    let two = file.with("sizes", "4 3 2 2").with("Segment1_Name", "rectum").body(second);
    let found = read_all(&two).volume;
    assert_eq!(values(&found), [[2; 12], [1; 12]].concat());
    assert_eq!(found.labels()[1].name.as_deref(), Some("rectum"));
}

#[test]
fn what_is_wrong_with_a_segment_is_told_and_the_voxels_are_read() {
    let long = "x".repeat(81);
    let keys = [
        ("Segment0_Name", long.as_str()),
        ("Segment0_Name", "a\\nb"),
        ("Segment0_Color", "1 2"),
        ("Segment0_Color", "2 0 0"),
        ("Segment0_LabelValue", "one"),
        ("Segment0_LabelValue", "0"),
        ("Segment0_Layer", "1"),
    ];
    for (key, value) in keys {
        let found = read_all(&TextFile::nrrd().with(key, value));
        assert_eq!(codes(&found.volume), ["label_table_ignored"], "{key} {value}");
        assert!(found.volume.labels().iter().all(|label| label.name.is_none() && label.color.is_none()));
    }
    for key in ["Segment_Name", "Segmentx_Name", "Segment99999999999_Name", "Segment0_Tags"] {
        assert!(read_all(&TextFile::nrrd().with(key, "x")).volume.notices().is_empty(), "{key}");
    }
}

#[test]
fn a_series_of_one_volume_is_a_volume() {
    let expected = read_all(&TextFile::nrrd()).volume;
    let last = TextFile::nrrd()
        .with("dimension", "4")
        .with("sizes", "4 3 2 1")
        .with("kinds", "domain domain domain time")
        .with("space directions", "(1,0,0) (0,2,0) (0,0,3) none");
    let first = TextFile::nrrd()
        .with("dimension", "4")
        .with("sizes", "1 4 3 2")
        .with("kinds", "vector domain domain domain")
        .with("space directions", "none (1,0,0) (0,2,0) (0,0,3)");
    for file in [last, first] {
        assert_eq!(read_all(&file).volume, expected);
    }
}

#[test]
fn segments_that_share_a_voxel_are_read_whole() {
    let body = (0..24).flat_map(|voxel| [1, u8::from(voxel == 6)]).collect();
    let file = TextFile::nrrd()
        .with("dimension", "4")
        .with("sizes", "2 4 3 2")
        .with("kinds", "list domain domain domain")
        .with("space directions", "none (1,0,0) (0,2,0) (0,0,3)")
        .with("Segment0_Layer", "0")
        .with("Segment7_Layer", "1")
        .body(body);
    let volume = read_all(&file).volume;
    let found: Vec<_> =
        (1..).zip(volume.labels()).map(|(index, label)| (label.value, volume.voxels_of(index))).collect();
    assert_eq!(found, [(1, 24), (8, 1)]);
    assert_eq!(volume.layers().count(), 2);
}
