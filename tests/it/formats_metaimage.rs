//! What the MetaImage reader reads, from files made here.

use medialrep::formats::{InputLimits, read};

use crate::help::nifti_bytes::gzip;
use crate::help::reading::{check_place, read_all, values};
use crate::help::text_bytes::{TextFile, stored, zlib};

#[test]
fn a_small_file_is_read_with_voxels_place_and_name_of_the_format() {
    let found = read_all(&TextFile::metaimage());
    assert_eq!((found.format, found.volume.dims()), ("metaimage", [4, 3, 2]));
    assert_eq!(values(&found.volume), (0..24).collect::<Vec<_>>());
    check_place(&TextFile::metaimage(), [-10.0, -20.0, -30.0], [-13.0, -24.0, -27.0]);
    let packed = read(gzip(&TextFile::metaimage().bytes()).as_slice(), InputLimits::default()).unwrap();
    assert_eq!((packed.format, packed.volume), ("metaimage.gz", found.volume));
}

#[test]
fn every_type_is_read_in_both_byte_orders_packed_and_not() {
    let expected: Vec<i8> = (0..24).map(|n| n % 3).collect();
    let types = ["CHAR", "UCHAR", "SHORT", "USHORT", "INT", "UINT", "LONG", "ULONG", "LONG_LONG", "ULONG_LONG"];
    for name in types.into_iter().chain(["FLOAT", "DOUBLE"]).map(|name| format!("MET_{name}")) {
        for (field, is_big) in [("BinaryDataByteOrderMSB", false), ("ElementByteOrderMSB", true)] {
            let body = stored(&name, &expected, is_big);
            let order = if is_big { "True" } else { "False" };
            let file = TextFile::metaimage().without("BinaryDataByteOrderMSB").with(field, order);
            let file = file.with("ElementType", &name).body(body.clone());
            let packed = file.clone().with("CompressedData", "True");
            for file in [file, packed.clone().body(zlib(&body)), packed.body(gzip(&body))] {
                let found = values(&read_all(&file).volume);
                assert_eq!(found, expected.iter().map(|n| i64::from(*n)).collect::<Vec<_>>(), "{name}, big {is_big}");
            }
        }
    }
}

#[test]
fn voxels_as_text_are_read() {
    let text = (0..24).map(|n| n.to_string()).collect::<Vec<_>>().join(" ").into_bytes();
    let file = TextFile::metaimage().with("BinaryData", "False").body(text);
    assert_eq!(values(&read_all(&file).volume), (0..24).collect::<Vec<_>>());
}

#[test]
fn rows_of_the_matrix_are_the_directions_of_the_axes_by_any_of_their_names() {
    for field in ["TransformMatrix", "Orientation", "Rotation"] {
        let file = TextFile::metaimage().without("TransformMatrix").with(field, "0 1 0 -1 0 0 0 0 1");
        check_place(&file, [-10.0, -20.0, -30.0], [-6.0, -23.0, -27.0]);
    }
    for field in ["Offset", "Position", "Origin"] {
        let file = TextFile::metaimage().without("Offset").with(field, "1 2 3");
        check_place(&file, [-1.0, -2.0, 3.0], [-4.0, -6.0, 6.0]);
    }
}

#[test]
fn what_was_assumed_of_the_place_is_told() {
    let bare = read_all(&TextFile::metaimage().without("TransformMatrix").without("Offset")).volume;
    let codes: Vec<_> = bare.notices().iter().map(|notice| notice.code).collect();
    assert_eq!(codes, ["no_orientation", "no_origin"]);
}

#[test]
fn a_plane_and_a_series_of_one_are_volumes() {
    let plane = TextFile::metaimage()
        .with("NDims", "2")
        .with("DimSize", "4 6")
        .with("ElementSpacing", "1 2")
        .with("Offset", "10 20")
        .with("TransformMatrix", "1 0 0 1");
    let found = read_all(&plane).volume;
    assert_eq!((found.dims(), found.world_from_voxel().spacing_mm()), ([4, 6, 1], [1.0, 2.0, 1.0]));
    let series = TextFile::metaimage()
        .with("NDims", "4")
        .with("DimSize", "4 3 2 1")
        .with("ElementSpacing", "1 2 3 1")
        .with("Offset", "10 20 -30 0")
        .with("TransformMatrix", "1 0 0 0 0 1 0 0 0 0 1 0 0 0 0 1");
    assert_eq!(read_all(&series).volume, read_all(&TextFile::metaimage()).volume);
}

#[test]
fn fields_that_mean_nothing_here_are_passed_over() {
    let file = TextFile::metaimage().with("AnatomicalOrientation", "RAI").with("Comment", "a = b").with("ID", "-1");
    assert_eq!(read_all(&file).volume, read_all(&TextFile::metaimage()).volume);
    let mut first = TextFile::metaimage();
    first.lines.insert(0, ("Comment".to_owned(), "of the first line".to_owned()));
    assert_eq!(read_all(&first).volume, read_all(&TextFile::metaimage()).volume);
}
