//! What the DICOM reader makes of good files.

use medialrep::formats::readers::check_header;
use medialrep::formats::{InputLimits, ReadVolume, read};
use nalgebra::{Point3, Vector3};
use tempfile::NamedTempFile;

use crate::help::dicom_bytes::{
    BIG_ENDIAN, DEFLATED, DEFLATED_FRAMES, Dicom, EXPLICIT, Element, Frame, IMPLICIT, RLE, SMALL, Seg, Value, frame,
    numbers, orientation, segment_at, sequence, short, text,
};
use crate::help::nifti_bytes::gzip;

fn read_ok(bytes: &[u8]) -> ReadVolume {
    read(bytes, InputLimits::default()).unwrap()
}

fn notices(read: &ReadVolume) -> Vec<&'static str> {
    read.volume.notices().iter().map(|notice| notice.code).collect()
}

/// The label of a voxel in a layer.
fn label_at(read: &ReadVolume, layer: usize, at: [usize; 3]) -> i64 {
    let index = read.volume.layers().nth(layer).unwrap()[at];
    read.volume.label(index).map_or(0, |label| label.value)
}

/// Whether a segment has a voxel, in whichever layer it is.
fn has(read: &ReadVolume, segment: i64, at: [usize; 3]) -> bool {
    let index = read.volume.index_of(segment).unwrap();
    read.volume.layer_of(index)[at] == index
}

/// All voxels of a volume of so many.
fn voxels([nx, ny, nz]: [usize; 3]) -> impl Iterator<Item = [usize; 3]> {
    (0..nz).flat_map(move |z| (0..ny).flat_map(move |y| (0..nx).map(move |x| [x, y, z])))
}

/// Checks that a file is the two segments of [`Seg::small`], with an empty slice at both ends.
fn check_small(what: &str, read: &ReadVolume) {
    let volume = &read.volume;
    assert_eq!(volume.dims(), [SMALL[0], SMALL[1], SMALL[2] + 2], "{what}");
    assert_eq!(volume.added_slices(), Some(2), "{what}");
    for [x, y, z] in voxels(volume.dims()) {
        let stored = if (1..=SMALL[2]).contains(&z) { segment_at([x, y, z - 1]) } else { 0 };
        assert_eq!(label_at(read, 0, [x, y, z]), i64::from(stored), "{what}: {:?}", [x, y, z]);
    }
    check_place(what, read, [0.0, 0.0, 1.0], [10.0, -20.0, 30.0]);
    check_place(what, read, [1.0, 1.0, 2.0], [9.5, -20.75, 32.0]);
}

/// Checks where a voxel lies, RAS.
fn check_place(what: &str, read: &ReadVolume, voxel: [f64; 3], ras: [f64; 3]) {
    let found = read.volume.world_from_voxel().point(Point3::from(voxel)).coords;
    assert!((found - Vector3::from(ras)).norm() < 1e-9, "{what}: {found}");
}

#[test]
fn one_mask_reads_the_same_however_it_is_written() {
    let kinds = [Seg::small(), Seg::labelmap(8), Seg::labelmap(16), Seg::fractional(255), Seg::fractional(200)];
    for transfer in [EXPLICIT, IMPLICIT, BIG_ENDIAN, DEFLATED, RLE, DEFLATED_FRAMES] {
        for seg in &kinds {
            let mut dicom = seg.clone().with(transfer).dicom();
            if seg.kind == "FRACTIONAL" {
                dicom.set(short(0x0062_000e, seg.frames.iter().flat_map(|frame| frame.pixels.clone()).max().unwrap()));
            }
            for marks_ends in [false, true] {
                let what = format!("{transfer} {} {} {marks_ends}", seg.kind, seg.bits);
                let bytes = Dicom { marks_ends, ..dicom.clone() }.bytes();
                let found = read_ok(&bytes);
                check_small(&what, &found);
                assert_eq!((notices(&found), found.format), (Vec::new(), "dicom_seg"), "{what}");
                let packed = read_ok(&gzip(&bytes));
                check_small(&what, &packed);
                assert_eq!(packed.format, "dicom_seg.gz");
            }
        }
    }
}

#[test]
fn words_with_the_high_byte_first_have_their_pixels_swapped() {
    for seg in [Seg::small(), Seg::labelmap(8)] {
        let mut dicom = seg.with(BIG_ENDIAN).dicom();
        let Some(Element(_, kind, Value::Bytes(bytes))) = dicom.elements.last_mut() else { panic!("no pixels") };
        *kind = "OW";
        bytes.resize(bytes.len().next_multiple_of(2), 0);
        bytes.as_chunks_mut::<2>().0.iter_mut().for_each(|word| word.reverse());
        check_small("words", &read_ok(&dicom.bytes()));
    }
}

#[test]
fn frames_that_begin_at_new_bytes_are_told_by_the_length() {
    // Nine bits each: with fifteen, the two lengths would be the same.
    let is_set = |[x, y, z]: [usize; 3]| (x + 2 * y + z) % 3 == 0;
    let pixels = |z| (0..3).flat_map(|y| (0..3).map(move |x| [x, y, z])).map(|at| u16::from(is_set(at))).collect();
    let frames = (0..6).map(|z| Frame { pixels: pixels(z), ..frame(1, z, |_| 0) }).collect();
    let seg = Seg { columns: 3, frames, segments: vec![1], ..Seg::small() };
    for (pads_frames, expected) in [(true, vec!["frames_padded"]), (false, vec![])] {
        let found = read_ok(&Seg { pads_frames, ..seg.clone() }.bytes());
        assert_eq!(notices(&found), expected);
        for [x, y, z] in voxels([3, 3, 6]) {
            assert_eq!(label_at(&found, 0, [x, y, z + 1]), i64::from(is_set([x, y, z])), "{:?}", [x, y, z]);
        }
    }
}

#[test]
fn bits_in_bytes_are_read_too() {
    check_small("bytes", &read_ok(&Seg { bits: 8, ..Seg::small() }.bytes()));
}

#[test]
fn shares_of_at_least_half_are_taken_with_a_word() {
    let shares = [0, 99, 100, 101, 200];
    let pixel_at = |[x, _, _]: [usize; 3]| shares[x];
    let frames = vec![frame(1, 0, pixel_at), frame(1, 1, pixel_at)];
    let mut dicom = Seg { frames, segments: vec![1], ..Seg::fractional(200) }.dicom();
    dicom.set(short(0x0062_000e, 200));
    let found = read_ok(&dicom.bytes());
    let row: Vec<i64> = (0..5).map(|x| label_at(&found, 0, [x, 0, 1])).collect();
    assert_eq!((row, notices(&found)), (vec![0, 0, 1, 1, 1], vec!["fractional_thresholded"]));
}

/// A segment with a type.
fn typed(number: u16, [value, scheme, meaning]: [&str; 3]) -> Vec<Element> {
    let code = vec![text(0x0008_0100, "SH", value), text(0x0008_0102, "SH", scheme), text(0x0008_0104, "LO", meaning)];
    vec![short(0x0062_0004, number), text(0x0062_0005, "LO", "part"), sequence(0x0062_000f, vec![code])]
}

#[test]
fn the_padding_value_and_segments_of_the_background_are_no_labels() {
    let on_nine = |at| if segment_at(at) == 0 { 9 } else { segment_at(at) };
    let seg = Seg { frames: (0..3).map(|z| frame(0, z, on_nine)).collect(), ..Seg::labelmap(8) };
    let mut padded = seg.dicom();
    padded.set(short(0x0028_0120, 9));
    check_small("a padding value", &read_ok(&padded.bytes()));
    let mut typed_so = seg.dicom();
    typed_so.items(0x0062_0002).push(typed(9, ["125040", "DCM", "Background"]));
    check_small("a segment", &read_ok(&typed_so.bytes()));
    let mut zero = Seg::labelmap(8).dicom();
    zero.items(0x0062_0002).insert(0, typed(0, ["125040", "DCM", "Background"]));
    check_small("segment 0", &read_ok(&zero.bytes()));
}

#[test]
fn numbers_of_segments_are_labels_whatever_they_are() {
    let numbers = [0, 300, 65_535];
    let frames = (0..3).map(|z| frame(0, z, |at| numbers[usize::from(segment_at(at))])).collect();
    let found = read_ok(&Seg { frames, segments: vec![300, 65_535], ..Seg::labelmap(16) }.bytes());
    let values: Vec<i64> = found.volume.labels().iter().map(|label| label.value).collect();
    assert_eq!(values, [300, 65_535]);
    assert_eq!((label_at(&found, 0, [0, 0, 1]), label_at(&found, 0, [4, 2, 3])), (300, 65_535));
}

#[test]
fn what_frames_share_counts_where_they_say_nothing_themselves() {
    let mut all_shared = Seg { frames: vec![frame(1, 0, |_| 1)], ..Seg::small() }.dicom();
    let own = all_shared.items(0x5200_9230)[0].clone();
    all_shared.items(0x5200_9229)[0].extend(own);
    all_shared.items(0x5200_9230)[0].clear();
    assert_eq!(read_ok(&all_shared.bytes()).volume.voxels_of(1), 15);
    all_shared.remove(0x5200_9230);
    assert_eq!(read_ok(&all_shared.bytes()).volume.voxels_of(1), 15);

    let mut overridden = Seg::small().dicom();
    let shared = overridden.items(0x5200_9229)[0].clone();
    for groups in overridden.items(0x5200_9230) {
        groups.extend(shared.clone());
    }
    overridden.items(0x5200_9229)[0] = vec![orientation(&[0.0, 1.0, 0.0, 1.0, 0.0, 0.0])];
    check_small("their own", &read_ok(&overridden.bytes()));
}

#[test]
fn positions_say_which_slice_a_frame_is() {
    let mut reversed = Seg::small();
    reversed.frames.reverse();
    check_small("reversed", &read_ok(&reversed.bytes()));
    let mut lying = Seg::small().dicom();
    for groups in lying.items(0x5200_9230) {
        let indices = Element(0x0020_9157, "UL", Value::Bytes(vec![1, 0, 0, 0]));
        groups.insert(0, sequence(0x0020_9111, vec![vec![indices]]));
    }
    check_small("lying indices", &read_ok(&lying.bytes()));
}

#[test]
fn a_slice_without_a_frame_is_background() {
    let mut seg = Seg::small();
    seg.frames.retain(|frame| frame.position[2] != 32.0);
    for spacing in [2.0, 0.0] {
        seg.spacing[2] = spacing;
        let has_step = spacing > 0.0;
        let found = read_ok(&seg.bytes());
        assert_eq!(found.volume.dims()[2], if has_step { 5 } else { 4 });
        assert_eq!(notices(&found), if has_step { vec!["slices_missing"] } else { vec![] });
        check_place("the last", &found, [0.0, 0.0, if has_step { 3.0 } else { 2.0 }], [10.0, -20.0, 34.0]);
    }
    let mut far = Seg::small();
    far.frames.iter_mut().filter(|frame| frame.position[2] == 34.0).for_each(|frame| frame.position[2] = 40.0);
    let found = read_ok(&far.bytes());
    assert_eq!((found.volume.dims()[2], notices(&found)), (8, vec![]));
}

#[test]
fn rows_and_columns_lie_as_the_cosines_say() {
    let (c, s) = (0.8, 0.6);
    for cosines in [[0.0, 1.0, 0.0, 0.0, 0.0, -1.0], [c, s, 0.0, -s * s, c * s, c], [-1.0, 0.0, 0.0, 0.0, -1.0, 0.0]] {
        let across = Vector3::new(cosines[0], cosines[1], cosines[2]);
        let down = Vector3::new(cosines[3], cosines[4], cosines[5]);
        let normal = across.cross(&down);
        let mut seg = Seg { orientation: cosines, ..Seg::small() };
        for frame in &mut seg.frames {
            let depth = frame.position[2] - 30.0;
            frame.position = (Vector3::new(-10.0, 20.0, 30.0) + normal * depth).into();
        }
        let mut dicom = seg.dicom();
        dicom.items(0x5200_9229)[0][1] = orientation(&cosines);
        let found = read_ok(&dicom.bytes());
        let [x, y, z] =
            (Vector3::new(-10.0, 20.0, 30.0) + across * 0.5 * 4.0 + down * 0.75 * 2.0 + normal * 2.0).into();
        check_place("a corner", &found, [4.0, 2.0, 2.0], [-x, -y, z]);
        assert!(has(&found, 2, [4, 2, 2]) && !has(&found, 1, [4, 2, 2]));
    }
}

#[test]
fn rounded_positions_make_even_steps() {
    let mut seg = Seg { spacing: [0.75, 0.5, 0.0], ..Seg::small() };
    seg.frames = (0..200).map(|z| frame(1, 0, |_| u16::from(z % 2 == 0))).collect();
    for (z, frame) in seg.frames.iter_mut().enumerate() {
        frame.position[2] = (z as f64 * 0.7037 * 1000.0).round() / 1000.0;
    }
    let found = read_ok(&seg.bytes());
    assert_eq!(found.volume.dims()[2], 202);
    assert!((found.volume.world_from_voxel().spacing_mm()[2] - 0.7037).abs() < 1e-5);
}

#[test]
fn a_step_that_the_positions_contradict_is_not_taken() {
    let found = read_ok(&Seg { spacing: [0.75, 0.5, 3.0], ..Seg::small() }.bytes());
    check_small("another step", &found);
    assert_eq!(notices(&found), ["spacing_disagrees"]);
}

#[test]
fn the_depth_of_one_slice_is_what_the_file_says() {
    let seg = Seg { frames: vec![frame(1, 0, |_| 1)], ..Seg::small() };
    let mut thick = Seg { spacing: [0.75, 0.5, 0.0], ..seg.clone() }.dicom();
    let measures = vec![text(0x0018_0050, "DS", "5"), text(0x0028_0030, "DS", numbers(&[0.75, 0.5]))];
    thick.items(0x5200_9229)[0][0] = sequence(0x0028_9110, vec![measures]);
    for (bytes, depth_mm) in [(seg.bytes(), 2.0), (thick.bytes(), 5.0)] {
        let found = read_ok(&bytes);
        assert_eq!((found.volume.dims(), notices(&found)), ([5, 3, 3], vec!["one_slice"]));
        assert_eq!(found.volume.world_from_voxel().spacing_mm()[2], depth_mm);
    }
}

/// Frames of segments that are blocks of columns.
fn blocks(columns: &[std::ops::Range<usize>]) -> Seg {
    let mut frames: Vec<Frame> = Vec::new();
    for z in 0..SMALL[2] {
        for (segment, columns) in (1..).zip(columns) {
            frames.push(frame(segment, z, |[x, ..]| u16::from(columns.contains(&x))));
        }
    }
    Seg { frames, segments: (1..=u16::try_from(columns.len()).unwrap()).collect(), ..Seg::small() }
}

#[test]
fn segments_that_overlap_keep_all_their_voxels() {
    for (columns, layers) in
        [(&[0..3, 2..5, 0..2][..], 2), (&[0..5, 0..5, 0..5], 3), (&[0..2, 2..4, 1..5, 4..5], 2), (&[0..2, 2..5], 1)]
    {
        let found = read_ok(&blocks(columns).bytes());
        assert_eq!(found.volume.layers().count(), layers, "{columns:?}");
        assert_eq!(notices(&found), if layers > 1 { vec!["segments_overlap"] } else { vec![] });
        for (segment, columns) in (1..).zip(columns) {
            for at in voxels(found.volume.dims()) {
                let expected = columns.contains(&at[0]) && (1..=SMALL[2]).contains(&at[2]);
                assert_eq!(has(&found, segment, at), expected, "{columns:?}: {segment} {at:?}");
            }
        }
    }
}

#[test]
fn segments_have_names_codes_and_colours() {
    let mut dicom = Seg::small().dicom();
    let mut named = typed(1, ["10200004", "SCT", "Liver"]);
    named[1] = text(0x0062_0005, "LO", "Leber <b> ÄÖ");
    named.insert(2, Element(0x0062_000d, "US", Value::Shorts(vec![35_579, 53_664, 50_858])));
    dicom.items(0x0062_0002)[0] = named;
    dicom.set(text(0x0008_0005, "CS", "ISO_IR 192"));
    let found = read_ok(&dicom.bytes());
    let [liver, other] = found.volume.labels() else { panic!("two labels") };
    assert_eq!(liver.name.as_deref(), Some("Leber <b> ÄÖ"));
    let code = liver.code.as_ref().unwrap();
    assert_eq!([&code.value, &code.scheme, &code.meaning], ["10200004", "SCT", "Liver"]);
    assert!(liver.color.is_some_and(|[r, g, b]| r > 250 && g < 5 && b < 5), "{:?}", liver.color);
    assert_eq!((other.name.as_deref(), &other.code, other.color), (Some("part 2"), &None, None));
}

#[test]
fn names_in_other_charsets_give_way_to_numbers_with_a_word() {
    for (charset, name, read_as) in [
        ("", &b"Leber"[..], Some("Leber")),
        ("ISO_IR 100", b"Geh\xf6r", Some("Gehör")),
        ("\\ISO 2022 IR 87", b"\x1b$B4N\x1b(B", None),
        ("ISO_IR 144", b"\xbf\xd5\xe7\xd5\xdd\xec", None),
        ("", b"Geh\xf6r", None),
    ] {
        let mut dicom = Seg::small().dicom();
        dicom.set(text(0x0008_0005, "CS", charset));
        dicom.items(0x0062_0002)[0][1] = text(0x0062_0005, "LO", name);
        let found = read_ok(&dicom.bytes());
        assert_eq!(found.volume.labels()[0].name.as_deref(), read_as, "{charset}");
        assert_eq!(notices(&found).is_empty(), read_as.is_some(), "{charset}");
    }
}

/// What no reader of segmentations needs, before and within what it does.
fn with_foreign_elements(dicom: &mut Dicom) {
    let nested =
        (0..3).fold(vec![text(0x0040_a160, "UT", "deep")], |inner, _| vec![sequence(0x0040_a730, vec![inner])]);
    dicom.set(sequence(0x0009_1010, vec![nested.clone()]));
    dicom.set(Element(0x0009_1011, "UN", Value::Items(vec![nested.clone(), nested.clone()])));
    dicom.set(Element(0x0088_0200, "OB", Value::Fragments(vec![b"not an item".to_vec()])));
    dicom.set(Element(0xfffc_fffc, "OB", Value::Bytes(vec![0; 300])));
    for groups in dicom.items(0x5200_9230) {
        groups.insert(0, sequence(0x0008_9124, vec![nested.clone()]));
    }
}

#[test]
fn what_is_not_needed_is_passed_over() {
    for transfer in [EXPLICIT, DEFLATED, BIG_ENDIAN] {
        for marks_ends in [false, true] {
            let mut dicom = Dicom { marks_ends, ..Seg::small().with(transfer).dicom() };
            with_foreign_elements(&mut dicom);
            check_small("foreign elements", &read_ok(&dicom.bytes()));
        }
    }
}

#[test]
fn zeros_after_the_end_fill_a_file_up() {
    for (transfer, zeros) in [(EXPLICIT, 1), (EXPLICIT, 4000), (IMPLICIT, 6), (DEFLATED, 3), (RLE, 512)] {
        let dicom = Dicom { tail: vec![0; zeros], ..Seg::small().with(transfer).dicom() };
        check_small("zeros", &read_ok(&dicom.bytes()));
        let mut bytes = Seg::small().with(transfer).bytes();
        bytes.extend(vec![0; zeros]);
        check_small("zeros", &read_ok(&bytes));
    }
}

#[test]
fn the_header_tells_the_voxels_of_the_volume() {
    use std::io::Write;
    for (transfer, is_compressed) in [(EXPLICIT, false), (RLE, true), (DEFLATED, true)] {
        let mut file = NamedTempFile::new().unwrap();
        file.write_all(&Seg::small().with(transfer).bytes()).unwrap();
        let facts = check_header(file.path(), InputLimits::default()).unwrap();
        assert_eq!((facts.voxels, facts.is_compressed), (5 * 3 * 5, is_compressed));
    }
}

#[test]
fn a_segment_without_a_voxel_is_left_out() {
    let found = read_ok(&Seg { segments: vec![1, 2, 3], ..Seg::small() }.bytes());
    assert_eq!(found.volume.labels().len(), 2);
}
