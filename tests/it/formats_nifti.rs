//! What the NIfTI reader makes of good files.

use medialrep::formats::{InputLimits, ReadVolume, read, write};
use medialrep::samples;
use medialrep::space::Label;
use nalgebra::{Point3, Rotation3, Vector3};
use proptest::prelude::*;

use crate::help::nifti_bytes::{Nifti, gzip};

fn read_ok(bytes: &[u8]) -> ReadVolume {
    let read = read(bytes, InputLimits::default()).unwrap();
    check_invariants(&read);
    read
}

/// What holds for every volume that is read.
fn check_invariants(read: &ReadVolume) {
    let volume = &read.volume;
    let values = label_values(read);
    assert!(values.windows(2).all(|pair| pair[0] < pair[1]));
    assert!(!values.contains(&0));
    let mut counted = vec![0; values.len() + 1];
    for index in volume.indices().as_slice() {
        counted[usize::from(*index)] += 1;
    }
    assert_eq!(counted, counts(read));
    assert!(counted[1..].iter().all(|count| *count > 0));
}

/// The labels that there are.
fn label_values(read: &ReadVolume) -> Vec<i64> {
    read.volume.labels().iter().map(|label| label.value).collect()
}

/// Voxels of the background, and of each label.
fn counts(read: &ReadVolume) -> Vec<u64> {
    (0..).take(read.volume.labels().len() + 1).map(|index| read.volume.voxels_of(index)).collect()
}

/// The label of each voxel.
fn labels(read: &ReadVolume) -> Vec<i64> {
    let value = |index: &u16| read.volume.label(*index).map_or(0, |label| label.value);
    read.volume.indices().as_slice().iter().map(value).collect()
}

fn notices(read: &ReadVolume) -> Vec<&'static str> {
    read.volume.notices().iter().map(|notice| notice.code).collect()
}

fn corner(read: &ReadVolume, voxel: [f64; 3]) -> Vector3<f64> {
    read.volume.world_from_voxel().point(Point3::from(voxel)).coords
}

/// Stored bytes of `values` in a datatype; `None` where the datatype cannot hold them.
fn stored(datatype: i16, values: &[i64], big_endian: bool) -> Option<(i16, Vec<u8>)> {
    macro_rules! bytes {
        ($type:ty) => {{
            let mut all = Vec::new();
            for value in values {
                let value = <$type>::try_from(*value).ok()?;
                all.extend(if big_endian { value.to_be_bytes() } else { value.to_le_bytes() });
            }
            (i16::try_from(8 * size_of::<$type>()).unwrap(), all)
        }};
    }
    let order = |mut bytes: Vec<u8>| {
        if big_endian {
            bytes.reverse();
        }
        bytes
    };
    let real = |bits: i16, write: &dyn Fn(f64) -> Vec<u8>| {
        (bits, values.iter().flat_map(|value| order(write(*value as f64))).collect())
    };
    Some(match datatype {
        2 => bytes!(u8),
        4 => bytes!(i16),
        8 => bytes!(i32),
        #[allow(clippy::cast_possible_truncation, reason = "the values are small")]
        16 => real(32, &|x| (x as f32).to_le_bytes().to_vec()),
        64 => real(64, &|x| x.to_le_bytes().to_vec()),
        256 => bytes!(i8),
        512 => bytes!(u16),
        768 => bytes!(u32),
        1024 => bytes!(i64),
        _ => bytes!(u64),
    })
}

#[test]
fn every_datatype_in_both_orders_and_versions_gives_the_same_labels() {
    let signed: Vec<i64> = (0..24).map(|n| [0, 3, -2, 1, 0, 127][n % 6]).collect();
    let unsigned: Vec<i64> = signed.iter().map(|n| n.abs()).collect();
    for datatype in [2, 4, 8, 16, 64, 256, 512, 768, 1024, 1280] {
        for (version, big_endian) in [(1, false), (1, true), (2, false), (2, true)] {
            let (values, (bitpix, voxels)) = stored(datatype, &signed, big_endian)
                .map(|fit| (&signed, fit))
                .or_else(|| stored(datatype, &unsigned, big_endian).map(|fit| (&unsigned, fit)))
                .unwrap();
            let file = Nifti { datatype, bitpix, voxels, big_endian, ..Nifti::small(version) };
            let what = format!("datatype {datatype}, version {version}, big endian {big_endian}");
            let read = read_ok(&file.bytes());
            assert_eq!(&labels(&read), values, "{what}");
            assert_eq!(read.volume.dims(), [4, 3, 2], "{what}");
            assert_eq!(corner(&read, [1.0, 1.0, 1.0]), Vector3::new(-9.0, -18.0, -27.0), "{what}");
            assert!(notices(&read).is_empty(), "{what}");
            assert_eq!(read.format, ["nifti1", "nifti2"][usize::from(version) - 1]);
        }
    }
}

#[test]
fn large_labels_are_kept_exactly() {
    let values: Vec<i64> = (0..24).map(|n| [0, 2101, i64::MAX, i64::MIN][n % 4]).collect();
    let (bitpix, voxels) = stored(1024, &values, false).unwrap();
    assert_eq!(labels(&read_ok(&Nifti { datatype: 1024, bitpix, voxels, ..Nifti::small(1) }.bytes())), values);
}

#[test]
fn gzip_is_told_by_its_magic_and_may_have_several_members() {
    let bytes = Nifti::small(1).bytes();
    let plain = read_ok(&bytes);
    let mut members = gzip(&bytes[..100]);
    members.extend(gzip(&bytes[100..360]));
    members.extend(gzip(&[]));
    members.extend(gzip(&bytes[360..]));
    let mut padded = members.clone();
    padded.extend([0; 1000]);
    for packed in [gzip(&bytes), members, padded] {
        let read = read_ok(&packed);
        assert_eq!(labels(&read), labels(&plain));
        assert_eq!((read.format, read.bytes), ("nifti1.gz", packed.len() as u64));
        assert_ne!(read.sha256, plain.sha256);
    }
}

#[test]
fn bytes_after_a_whole_gzip_stream_are_left_unread_and_said() {
    let bytes = Nifti::small(1).bytes();
    for (tail, told) in
        [(&b"\n"[..], "1 bytes"), (b"\0\0\r\n--form--", "10 bytes"), (b"\x1f", "1 bytes"), (b"\x1f\x8b\0", "3 bytes")]
    {
        let mut packed = gzip(&bytes);
        packed.extend(tail);
        let read = read_ok(&packed);
        assert_eq!((labels(&read), read.bytes), ((0..24).collect(), packed.len() as u64));
        assert_eq!(notices(&read), ["bytes_after_gzip"], "{tail:?}");
        assert!(read.volume.notices()[0].message.starts_with(told), "{:?}", read.volume.notices());
    }
}

#[test]
fn the_hash_is_that_of_the_file_as_sent() {
    use sha2::{Digest, Sha256};
    let mut with_tail = gzip(&Nifti::small(1).bytes());
    with_tail.extend([b'x'; 200_000]);
    for bytes in [Nifti::small(1).bytes(), gzip(&Nifti::small(2).bytes()), with_tail] {
        let expected: String = Sha256::digest(&bytes).iter().map(|byte| format!("{byte:02x}")).collect();
        assert_eq!(read_ok(&bytes).sha256, expected);
    }
}

#[test]
fn voxels_start_where_the_header_says() {
    for (version, offset, gap) in [(1, 416.0, 68), (1, 0.0, 4), (2, 1024.0, 484), (2, 0.0, 4)] {
        let file = Nifti { vox_offset: offset, extension: vec![255; gap], ..Nifti::small(version) };
        assert_eq!(labels(&read_ok(&file.bytes())), (0..24).collect::<Vec<_>>());
    }
}

#[test]
fn trailing_dimensions_of_zero_or_one_mean_one_volume() {
    for dim in [[4, 4, 3, 2, 0, 0, 0, 0], [5, 4, 3, 2, 1, 1, 1, 1], [7, 4, 3, 2, 1, 0, 1, 0], [3, 4, 3, 2, 9, 9, 9, 9]]
    {
        assert_eq!(read_ok(&Nifti { dim, ..Nifti::small(1) }.bytes()).volume.dims(), [4, 3, 2]);
    }
}

#[test]
fn a_plane_is_one_slice() {
    let file = Nifti { dim: [2, 6, 4, 99, 0, 0, 0, 0], ..Nifti::small(1) };
    assert_eq!(read_ok(&file.bytes()).volume.dims(), [6, 4, 1]);
}

#[test]
fn values_are_scaled() {
    let file = Nifti { scl_slope: 0.5, scl_inter: -1.0, voxels: [2, 4, 6, 84].repeat(6), ..Nifti::small(1) };
    assert_eq!(label_values(&read_ok(&file.bytes())), [1, 2, 41]);
    for slope in [0.0, f64::NAN, 1.0] {
        let file = Nifti { scl_slope: slope, ..Nifti::small(1) };
        assert_eq!(labels(&read_ok(&file.bytes())), (0..24).collect::<Vec<_>>(), "slope {slope}");
    }
}

/// The integers from `least` to `most` that a writer makes of labels, and its slope and intercept.
fn quantised(labels: &[i64], least: i64, most: i64) -> (Vec<i64>, f64, f64) {
    let (low, high) = (labels.iter().min().unwrap(), labels.iter().max().unwrap());
    let slope = (high - low) as f64 / (most - least) as f64;
    let inter = *low as f64 - slope * least as f64;
    #[allow(clippy::cast_possible_truncation, reason = "rounded, of at most two bytes")]
    let stored = labels.iter().map(|label| ((*label as f64 - inter) / slope).round() as i64).collect();
    (stored, slope, inter)
}

#[test]
fn labels_that_a_slope_has_quantised_are_read_as_they_were() {
    let few: Vec<i64> = (0..24).map(|n| [0, 1, 3, 6][n % 4]).collect();
    let many: Vec<i64> = (0..24).map(|n| [0, 2, 54, 103, 117, 11][n % 6]).collect();
    let large: Vec<i64> = (0..24).map(|n| [0, 17, 1011, 2035][n % 4]).collect();
    for (labels_meant, datatype, range, is_told) in [
        (&few, 2, (0, 255), true),
        (&many, 2, (0, 255), true),
        (&few, 4, (-32768, 32767), false),
        (&large, 4, (-32768, 32767), true),
    ] {
        let (values, scl_slope, scl_inter) = quantised(labels_meant, range.0, range.1);
        let (bitpix, voxels) = stored(datatype, &values, false).unwrap();
        let read = read_ok(&Nifti { datatype, bitpix, voxels, scl_slope, scl_inter, ..Nifti::small(1) }.bytes());
        assert_eq!(&labels(&read), labels_meant, "slope {scl_slope}");
        assert_eq!(notices(&read).contains(&"labels_rounded"), is_told, "slope {scl_slope}");
    }
}

#[test]
fn whole_numbers_in_the_other_byte_order_are_told() {
    let meant: Vec<i64> = (0..24).map(|n| [0, 1, 3, 127][n % 4]).collect();
    for datatype in [4, 8, 512, 768, 1024] {
        for big_endian in [false, true] {
            let (bitpix, voxels) = stored(datatype, &meant, !big_endian).unwrap();
            let read = read_ok(&Nifti { datatype, bitpix, voxels, big_endian, ..Nifti::small(1) }.bytes());
            assert_eq!(notices(&read), ["byte_order_doubtful"], "datatype {datatype}");
            assert!(read.volume.notices()[0].message.ends_with("[1, 3, 127]"), "{:?}", read.volume.notices());
        }
    }
    let (bitpix, voxels) = stored(4, &(0..24).map(|n| [0, 256, 3][n % 3]).collect::<Vec<_>>(), false).unwrap();
    assert!(notices(&read_ok(&Nifti { datatype: 4, bitpix, voxels, ..Nifti::small(1) }.bytes())).is_empty());
}

#[test]
fn float_labels_a_hair_off_are_whole_and_nan_is_background() {
    let values = [0.0, 1.0004, 1.9996, f32::NAN, -0.0, f32::from_bits(0x7fc0_0001)];
    let voxels = values.iter().cycle().take(24).flat_map(|x| x.to_le_bytes()).collect();
    let read = read_ok(&Nifti { datatype: 16, bitpix: 32, voxels, ..Nifti::small(1) }.bytes());
    assert_eq!(label_values(&read), [1, 2]);
    assert_eq!(counts(&read), [16, 4, 4]);
    assert_eq!(notices(&read), ["nan_voxels"]);
    let message = &read.volume.notices()[0].message;
    assert!(message.starts_with("8 voxels"), "{message}");
}

#[test]
fn an_empty_mask_is_no_error_of_the_file() {
    let read = read_ok(&Nifti { voxels: vec![0; 24], ..Nifti::small(1) }.bytes());
    assert_eq!(counts(&read), [24]);
}

#[test]
fn qform_is_taken_without_sform_and_pixdim_without_both() {
    // Half a turn about x: j and k run backwards; pixdim[0] = 0 means no flip.
    let turned = Nifti { sform_code: 0, qform_code: 1, quatern: [1.0, 0.0, 0.0], ..Nifti::small(1) };
    for (qfac, k) in [(0.0, -3.0), (1.0, -3.0), (-1.0, 3.0)] {
        let mut file = Nifti { qoffset: [5.0, 6.0, 7.0], ..turned.clone() };
        file.pixdim[0] = qfac;
        let read = read_ok(&file.bytes());
        assert!((corner(&read, [1.0, 1.0, 1.0]) - Vector3::new(6.0, 4.0, 7.0 + k)).norm() < 1e-6, "qfac {qfac}");
        assert!(notices(&read).is_empty());
    }
    let read = read_ok(&Nifti { sform_code: 0, ..Nifti::small(1) }.bytes());
    assert_eq!(corner(&read, [1.0, 1.0, 1.0]), Vector3::new(1.0, 2.0, 3.0));
    assert_eq!(notices(&read), ["no_orientation"]);
}

#[test]
fn a_quaternion_a_hair_too_long_is_a_rotation() {
    let file = Nifti { sform_code: 0, qform_code: 1, quatern: [1.00001, 0.0, 0.0], ..Nifti::small(1) };
    assert!((corner(&read_ok(&file.bytes()), [0.0, 1.0, 0.0]) - Vector3::new(0.0, -2.0, 0.0)).norm() < 1e-6);
}

#[test]
fn a_broken_sform_falls_back_to_the_qform() {
    for broken in [f64::NAN, 0.0] {
        let mut file = Nifti { qform_code: 1, ..Nifti::small(1) };
        file.srow[0] = [broken; 4];
        let read = read_ok(&file.bytes());
        assert_eq!(notices(&read), ["sform_unusable"]);
        assert_eq!(corner(&read, [1.0, 1.0, 1.0]), Vector3::new(1.0, 2.0, 3.0));
    }
}

#[test]
fn metres_and_microns_become_millimetres() {
    for (unit, factor, notice) in [(0, 1.0, None), (1, 1000.0, None), (3, 0.001, None), (5, 1.0, Some("unknown_unit"))]
    {
        let mut file = Nifti { xyzt_units: unit | 8, ..Nifti::small(2) };
        for x in file.srow.iter_mut().flatten().chain(&mut file.pixdim[1..4]) {
            *x /= factor;
        }
        let read = read_ok(&file.bytes());
        assert!((corner(&read, [1.0, 1.0, 1.0]) - Vector3::new(-9.0, -18.0, -27.0)).norm() < 1e-9, "unit {unit}");
        assert_eq!(notices(&read).first().copied(), notice, "unit {unit}");
    }
}

#[test]
fn permuted_left_handed_and_oblique_axes_are_kept() {
    let (sin, cos) = 0.3_f64.sin_cos();
    for srow in [
        [[0.0, 0.0, -3.0, 1.0], [1.0, 0.0, 0.0, 2.0], [0.0, 2.0, 0.0, 3.0]],
        [[-1.0, 0.0, 0.0, 1.0], [0.0, 2.0, 0.0, 2.0], [0.0, 0.0, 3.0, 3.0]],
        [[cos, -2.0 * sin, 0.0, 1.0], [sin, 2.0 * cos, 0.0, 2.0], [0.0, 0.0, 3.0, 3.0]],
    ] {
        let read = read_ok(&Nifti { srow, ..Nifti::small(2) }.bytes());
        let expected = Vector3::from_fn(|r, _| srow[r][0] + srow[r][1] + srow[r][2] + srow[r][3]);
        assert!((corner(&read, [1.0, 1.0, 1.0]) - expected).norm() < 1e-12);
        assert!(notices(&read).is_empty());
    }
}

/// A file whose qform says what its sform does, in the same space.
fn with_both() -> Nifti {
    Nifti { qform_code: 1, qoffset: [-10.0, -20.0, -30.0], ..Nifti::small(1) }
}

#[track_caller]
fn check_contradiction(file: &Nifti, told: &[&str]) {
    let read = read_ok(&file.bytes());
    assert_eq!(notices(&read), ["orientations_disagree"]);
    let message = &read.volume.notices()[0].message;
    assert!(told.iter().all(|part| message.contains(part)), "{message}");
}

#[test]
fn a_qform_that_contradicts_the_sform_is_noticed_with_the_difference() {
    assert!(notices(&read_ok(&with_both().bytes())).is_empty());
    let mut mirrored = with_both();
    mirrored.srow[0] = [-1.0, 0.0, 0.0, -7.0];
    check_contradiction(&mirrored, &["left and right are swapped", "mirror image"]);
    let mut turned = with_both();
    (turned.srow[0], turned.srow[1]) = ([-1.0, 0.0, 0.0, -7.0], [0.0, -2.0, 0.0, -16.0]);
    check_contradiction(&turned, &["left and right are swapped, front and back are swapped"]);
    let oblique = Nifti { quatern: [0.0, 0.0, 15f64.to_radians().sin()], ..with_both() };
    check_contradiction(&oblique, &["up to 30.0° apart"]);
    let moved = Nifti { qoffset: [-10.0, -20.5, -30.0], ..with_both() };
    check_contradiction(&moved, &["the image 0.500 mm apart"]);
}

#[test]
fn orientations_that_do_not_contradict_each_other_are_no_notice() {
    // Half a turn, whose quaternion is rounded the most; an offset of two decimals; no rotation at all.
    let half = Nifti {
        srow: [[-1.0, 0.0, 0.0, 10.0], [0.0, -2.0, 0.0, 20.0], [0.0, 0.0, 3.0, -30.0]],
        quatern: [0.0, 0.0, 0.999_999_9],
        qoffset: [10.0, 20.0, -30.0],
        ..with_both()
    };
    let rounded = Nifti { qoffset: [-10.004, -20.0, -30.0], ..with_both() };
    let unusable = Nifti { quatern: [1.0, 1.0, 0.0], ..with_both() };
    let in_an_atlas = Nifti { sform_code: 4, qoffset: [30.0, 0.0, 0.0], ..with_both() };
    for file in [half, rounded, unusable, in_an_atlas] {
        assert!(notices(&read_ok(&file.bytes())).is_empty(), "{file:?}");
    }
    let mut mirrored_atlas = Nifti { sform_code: 4, ..with_both() };
    mirrored_atlas.srow[0] = [-1.0, 0.0, 0.0, -7.0];
    check_contradiction(&mirrored_atlas, &["left and right are swapped"]);
}

#[test]
fn an_sform_that_contradicts_pixdim_is_noticed() {
    let file = Nifti { pixdim: [1.0, 1.0, 1.0, 1.0, 0.0, 0.0, 0.0, 0.0], ..Nifti::small(1) };
    assert_eq!(notices(&read_ok(&file.bytes())), ["spacing_disagrees"]);
}

#[test]
fn a_written_sample_is_read_back_the_same() {
    let turn = Rotation3::from_euler_angles(0.2, -0.4, 0.9);
    for (name, spacing_mm) in [("two", [1.0, 1.5, 2.0]), ("leaf", [0.9; 3])] {
        let volume = samples::by_name(name).unwrap().voxelise(spacing_mm, turn).unwrap();
        let mut bytes = Vec::new();
        write::nifti::write(&volume, &mut bytes).unwrap();
        let read = read_ok(&bytes).volume;
        assert_eq!((read.indices(), read.labels()), (volume.indices(), volume.labels()));
        let gap = read.world_from_voxel().matrix() - volume.world_from_voxel().matrix();
        assert!(gap.abs().max() < 1e-5, "float32 rounds to {}", gap.abs().max());
    }
}

/// A document round a table, as TotalSegmentator writes it.
fn table(labels: &str) -> String {
    format!(
        "<?xml version=\"1.0\" encoding=\"UTF-8\"?> <CaretExtension> <VolumeInformation Index=\"0\"> \
         <LabelTable>{labels}</LabelTable> </VolumeInformation></CaretExtension>"
    )
}

const CAUDATE: &str = "<Label Key=\"3\" Red=\"0\" Green=\"0.6\" Blue=\"1\" Alpha=\"1\">left caudate</Label>";

/// A file with records between header and voxels.
fn extended(version: u8, big_endian: bool, records: &[(i32, &str)]) -> Nifti {
    Nifti { big_endian, ..Nifti::small(version) }.with_extensions(records)
}

#[track_caller]
fn check_passed_over(what: &str, file: &Nifti) {
    let read = read_ok(&file.bytes());
    assert_eq!(labels(&read), (0..24).collect::<Vec<_>>(), "{what}");
    assert_eq!(notices(&read), ["label_table_ignored"], "{what}");
    assert!(read.volume.labels().iter().all(|label| *label == Label::new(label.value)), "{what}");
}

#[test]
fn labels_have_the_names_and_colours_of_a_table_in_the_header() {
    let labels = format!("<Label Key=\"0\">none</Label>{CAUDATE}<Label Key=\"99\">not in the mask</Label>");
    let table = table(&labels);
    for (version, big_endian) in [(1, false), (1, true), (2, false), (2, true)] {
        for records in [vec![(0, &*table)], vec![(6, "a comment"), (30, &table), (32, "<a/>")]] {
            let read = read_ok(&extended(version, big_endian, &records).bytes());
            let named =
                Label { value: 3, name: Some("left caudate".to_owned()), color: Some([0, 153, 255]), code: None };
            assert_eq!(read.volume.labels()[2], named);
            assert_eq!(read.volume.labels()[3], Label::new(4));
            assert_eq!((read.volume.labels().len(), notices(&read)), (23, Vec::new()));
        }
    }
}

#[test]
fn a_hostile_table_is_passed_over_and_the_voxels_are_read() {
    let table = table(CAUDATE);
    let laughs = format!("<!DOCTYPE a [<!ENTITY a \"ha\"><!ENTITY b \"&a;&a;\">]>{}", table.replace("left", "&b;"));
    let outside = format!("<!DOCTYPE a [<!ENTITY b SYSTEM \"file:///etc/passwd\">]>{}", table.replace("left", "&b;"));
    let deep = format!("{}{table}", "<a>".repeat(100_000));
    for (what, document) in
        [("laughs", &*laughs), ("outside", &outside), ("deep", &deep), ("cut", &table[..table.len() / 2])]
    {
        check_passed_over(what, &extended(1, false, &[(0, document)]));
    }
    let mut latin_1 = extended(1, false, &[(0, &table)]);
    let at = latin_1.extension.windows(4).position(|bytes| bytes == b"left").unwrap();
    latin_1.extension[at] = 0xe9;
    check_passed_over("latin-1", &latin_1);
}

#[test]
fn a_table_in_a_document_of_megabytes_is_passed_over() {
    let table = table(CAUDATE);
    for spaces in [(4 << 20) - table.len() - 16, 4 << 20] {
        let file = extended(2, false, &[(0, &format!("{table}{}", " ".repeat(spaces)))]);
        let read = read_ok(&file.bytes());
        let is_small = spaces < 4 << 20;
        assert_eq!((read.volume.labels()[2].name.is_some(), notices(&read).is_empty()), (is_small, is_small));
    }
}

#[test]
fn a_broken_list_of_extensions_is_passed_over() {
    let whole = extended(1, false, &[(6, "no table"), (0, &table(CAUDATE))]);
    for size in [0, 7, -1, -16, i32::MIN, i32::MAX, 1 << 20] {
        let mut file = whole.clone();
        file.extension[4..8].copy_from_slice(&i32::to_le_bytes(size));
        check_passed_over(&format!("a size of {size}"), &file);
    }
}

#[test]
fn zeros_after_the_last_extension_are_padding() {
    let mut file = extended(1, false, &[(0, &table(CAUDATE).replace("LabelTable", "Nothing"))]);
    file.extension.extend([0; 40]);
    file.vox_offset += 40.0;
    assert!(notices(&read_ok(&file.bytes())).is_empty());
}

#[test]
fn a_file_that_ends_within_an_extension_is_truncated() {
    let file = extended(1, false, &[(0, &table(CAUDATE))]).bytes();
    for end in [350, 352, 356, 360, 500] {
        let error = read(&file[..end], InputLimits::default()).unwrap_err();
        assert_eq!((error.code(), error.location()), ("truncated", format!("byte {end}")));
    }
}

/// The nifti crate reads the same header fields from what the tests write.
#[test]
fn the_test_files_mean_what_the_nifti_crate_reads() {
    for big_endian in [false, true] {
        let file = Nifti { big_endian, ..Nifti::small(1) };
        let header = nifti::NiftiHeader::from_reader(file.bytes().as_slice()).unwrap();
        assert_eq!(header.dim().unwrap(), [4, 3, 2]);
        assert_eq!((header.datatype, header.bitpix, header.sform_code, header.xyzt_units), (2, 8, 1, 2));
        assert_eq!(header.srow_z, [0.0, 0.0, 3.0, -30.0]);
    }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 300, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn random_bytes_never_panic(bytes in proptest::collection::vec(any::<u8>(), 0..2000)) {
        let _ = read(bytes.as_slice(), LIMITS);
        let _ = read(gzip(&bytes).as_slice(), LIMITS);
    }

    #[test]
    fn a_mutated_header_never_panics(
        version in 1_u8..=2,
        big_endian in any::<bool>(),
        changes in proptest::collection::vec((0_usize..560, any::<u8>()), 1..12),
        cut in 0_usize..600,
    ) {
        let mut bytes = Nifti { big_endian, ..Nifti::small(version) }.bytes();
        for (offset, value) in changes {
            if let Some(byte) = bytes.get_mut(offset) {
                *byte = value;
            }
        }
        if let Ok(volume) = read(bytes.as_slice(), LIMITS) {
            check_invariants(&volume);
        }
        let mut packed = gzip(&bytes);
        packed.truncate(packed.len().saturating_sub(cut % 40));
        let _ = read(packed.as_slice(), LIMITS);
    }
}

const LIMITS: InputLimits = InputLimits { max_voxels: 1 << 20, max_decompressed_bytes: 1 << 20 };
