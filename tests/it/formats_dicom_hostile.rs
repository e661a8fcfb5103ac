//! DICOM files that are made to take memory, time or the stack. Each is answered with an error, in little time.

use std::io::Write;
use std::time::{Duration, Instant};

use flate2::Compression;
use flate2::write::DeflateEncoder;
use medialrep::formats::{InputLimits, ReadError, read};

use crate::help::dicom_bytes::{
    DEFLATED, DEFLATED_FRAMES, Dicom, Element, Frame, IMPLICIT, RLE, Seg, Value, deflated, sequence, short, text,
};

/// In which a file of any kind is answered; the machine may be busy.
const SOON: Duration = Duration::from_secs(10);

fn answer(what: &str, bytes: &[u8]) -> ReadError {
    let begun = Instant::now();
    let error = read(bytes, InputLimits::default()).expect_err(what);
    assert!(begun.elapsed() < SOON, "{what}: {:?}", begun.elapsed());
    error
}

fn check(what: &str, bytes: &[u8], code: &str) {
    let error = answer(what, bytes);
    assert_eq!(error.code(), code, "{what}: {error}");
}

/// A good file before its functional groups, then other bytes.
fn followed_by(transfer: &'static str, tail: Vec<u8>) -> Vec<u8> {
    let mut dicom = Seg::small().with(transfer).dicom();
    dicom.elements.retain(|Element(tag, ..)| *tag < 0x5200_0000);
    Dicom { tail, ..dicom }.bytes()
}

/// The head of an element of unknown length, and of an item of one.
const SEQUENCE: [u8; 12] = [0x00, 0x52, 0x30, 0x92, b'S', b'Q', 0, 0, 0xff, 0xff, 0xff, 0xff];
const FOREIGN: [u8; 12] = [0x09, 0x60, 0x10, 0x10, b'S', b'Q', 0, 0, 0xff, 0xff, 0xff, 0xff];
const UNKNOWN: [u8; 12] = [0x09, 0x60, 0x10, 0x10, b'U', b'N', 0, 0, 0xff, 0xff, 0xff, 0xff];
const IMPLICIT_FOREIGN: [u8; 8] = [0x09, 0x60, 0x10, 0x10, 0xff, 0xff, 0xff, 0xff];
const ITEM: [u8; 8] = [0xfe, 0xff, 0x00, 0xe0, 0xff, 0xff, 0xff, 0xff];

#[test]
fn nesting_is_refused_long_before_it_takes_the_stack() {
    for (transfer, head, inner) in [
        ("1.2.840.10008.1.2.1", &SEQUENCE[..], &FOREIGN[..]),
        ("1.2.840.10008.1.2.1", &FOREIGN, &FOREIGN),
        ("1.2.840.10008.1.2.1", &UNKNOWN, &IMPLICIT_FOREIGN),
        (IMPLICIT, &IMPLICIT_FOREIGN, &IMPLICIT_FOREIGN),
        (DEFLATED, &FOREIGN, &FOREIGN),
    ] {
        let mut tail = [head, &ITEM].concat();
        for _ in 0..20_000 {
            tail.extend(inner);
            tail.extend(ITEM);
        }
        check("nested", &followed_by(transfer, tail), "dicom_over_limit");
    }
    // Of known lengths: each ends where the outermost does.
    let mut tail = Vec::new();
    for depth in (0..20_000_u32).rev() {
        tail.extend([0x00, 0x52, 0x30, 0x92, b'S', b'Q', 0, 0]);
        tail.extend((20 * depth + 8).to_le_bytes());
        tail.extend([0xfe, 0xff, 0x00, 0xe0]);
        tail.extend((20 * depth).to_le_bytes());
    }
    let error = answer("nested with lengths", &followed_by("1.2.840.10008.1.2.1", tail));
    assert!((400..500).contains(&error.status()), "{error}");
}

#[test]
fn lengths_beyond_the_file_reserve_nothing() {
    let claims = |head: &[u8]| [head, &0xffff_fff0_u32.to_le_bytes()].concat();
    let explicit = |tag: [u8; 4], kind: &[u8; 2]| claims(&[&tag[..], kind, &[0, 0]].concat());
    for (what, tail) in [
        ("a foreign value", explicit([0x09, 0x60, 0x10, 0x10], b"OB")),
        ("groups", explicit([0x00, 0x52, 0x29, 0x92], b"SQ")),
        ("groups of frames", explicit([0x00, 0x52, 0x30, 0x92], b"SQ")),
    ] {
        check(what, &followed_by("1.2.840.10008.1.2.1", tail), "truncated");
    }
    let item = [&SEQUENCE[..], &claims(&ITEM[..4])].concat();
    check("an item", &followed_by("1.2.840.10008.1.2.1", item), "truncated");
    check("implicit", &followed_by(IMPLICIT, claims(&[0x09, 0x60, 0x10, 0x10])), "truncated");
    let mut value = Seg::small().dicom();
    value.elements.truncate(2);
    value.tail = explicit([0x62, 0x00, 0x01, 0x00], b"UT");
    check("a wanted value", &value.bytes(), "dicom_over_limit");
}

#[test]
fn a_length_beyond_the_right_pixels_is_refused() {
    let mut bytes = Seg::small().bytes();
    let place = bytes.windows(6).rposition(|bytes| bytes == [0xe0, 0x7f, 0x10, 0x00, b'O', b'B']).unwrap() + 8;
    bytes[place..place + 4].copy_from_slice(&0xffff_fff0_u32.to_le_bytes());
    check("4 GB of pixels", &bytes, "pixel_data_length");
    let mut after = Seg::small().dicom();
    after.tail = [&[0xfc, 0xff, 0xfc, 0xff, b'O', b'B', 0, 0][..], &0x7fff_fff0_u32.to_le_bytes()].concat();
    check("2 GB after them", &after.bytes(), "truncated");
}

#[test]
fn a_few_bytes_ask_for_no_great_volume() {
    let mut dicom = Seg::small().dicom();
    dicom.set(short(0x0028_0010, 65_535));
    dicom.set(short(0x0028_0011, 65_535));
    check("65535 × 65535", &dicom.bytes(), "too_many_voxels");
    let mut dicom = Seg::labelmap(16).dicom();
    dicom.set(short(0x0028_0010, 10_000));
    dicom.set(short(0x0028_0011, 10_000));
    check("10000 × 10000", &dicom.bytes(), "pixel_data_length");
    for frames in ["1048576", "1048577", "4294967295", "99999999999999999999"] {
        let mut dicom = Seg::small().dicom();
        dicom.set(text(0x0028_0008, "IS", frames));
        let error = answer(frames, &dicom.bytes());
        assert!(["frame_count", "dicom_over_limit", "bad_dicom_value"].contains(&error.code()), "{error}");
    }
}

#[test]
fn frames_of_no_pixels_make_no_volume() {
    let mut dicom = Seg::small().dicom();
    dicom.set(text(0x0028_0008, "IS", "1000000"));
    let groups = dicom.items(0x5200_9230).clone();
    *dicom.items(0x5200_9230) = groups.iter().cycle().take(100_000).cloned().collect();
    check("as many groups as fit", &dicom.bytes(), "frame_count");
    dicom.set(text(0x0028_0008, "IS", "100000"));
    check("the same frame for ever", &dicom.bytes(), "repeated_frame");
}

#[test]
fn run_length_bombs_are_refused() {
    let with = |fragment: Vec<u8>| {
        let mut dicom = Seg::labelmap(8).with(RLE).dicom();
        let Some(Element(_, _, Value::Fragments(fragments))) = dicom.elements.last_mut() else { panic!("none") };
        fragments[0] = fragment;
        dicom.bytes()
    };
    let head = |offset: u32| [&1_u32.to_le_bytes()[..], &offset.to_le_bytes(), &[0; 56]].concat();
    let repeats = |count: usize| [129, 1].repeat(count);
    check("repeats for ever", &with([head(64), repeats(400)].concat()), "corrupt_frame");
    check("a long fragment", &with([head(64), repeats(1 << 20)].concat()), "corrupt_frame");
    check("nothing for ever", &with([head(64), vec![128; 800]].concat()), "corrupt_frame");
    for offset in [0, 63, 66, u32::MAX] {
        check("an offset elsewhere", &with([head(offset), repeats(1)].concat()), "corrupt_frame");
    }
    let many = [&16_u32.to_le_bytes()[..], &[0xff; 60]].concat();
    check("many runs", &with(many), "corrupt_frame");
}

/// So many bytes of one value, deflated.
fn bomb(start: &[u8], byte: u8, count: usize) -> Vec<u8> {
    let mut encoder = DeflateEncoder::new(Vec::new(), Compression::best());
    encoder.write_all(start).unwrap();
    let block = vec![byte; 1 << 20];
    for _ in 0..count >> 20 {
        encoder.write_all(&block).unwrap();
    }
    encoder.finish().unwrap()
}

#[test]
fn deflate_bombs_are_refused() {
    let begin = Seg::small().with(DEFLATED).bytes();
    let empty = Dicom { elements: Vec::new(), ..Seg::small().with(DEFLATED).dicom() }.bytes();
    let meta = &begin[..empty.len() - deflated(&[]).len()];
    let claimed = |count: u32, head: &[u8]| [head, &count.to_le_bytes()].concat();
    let value = claimed(0x3fff_fff0, &[0x09, 0x00, 0x10, 0x10, b'O', b'B', 0, 0]);
    let limits = InputLimits { max_decompressed_bytes: 256 << 20, ..InputLimits::default() };
    let error = read(&[meta, &bomb(&value, 0, 512 << 20)].concat()[..], limits).unwrap_err();
    assert_eq!(error.code(), "decompressed_too_large");
    check("zeros", &[meta, &bomb(&[], 0, 64 << 20)].concat(), "dicom_element_missing");
    let items = [0xfe, 0xff, 0x00, 0xe0, 0, 0, 0, 0].repeat(1 << 20);
    let sequence = [&FOREIGN[..], &items.repeat(24)].concat();
    check("items for ever", &[meta, &deflated(&sequence)].concat(), "dicom_over_limit");

    let mut frames = Seg::labelmap(8).with(DEFLATED_FRAMES).dicom();
    let Some(Element(_, _, Value::Fragments(fragments))) = frames.elements.last_mut() else { panic!("none") };
    fragments[1] = bomb(&[], 1, 1 << 20);
    check("a frame", &frames.bytes(), "corrupt_frame");
}

#[test]
fn segments_and_values_for_ever_are_refused() {
    let segment = |number: u16| vec![short(0x0062_0004, number), text(0x0062_0005, "LO", "x".repeat(64))];
    let mut dicom = Seg::small().dicom();
    dicom.set(sequence(0x0062_0002, (1..=u16::MAX).chain(1..5000).map(segment).collect()));
    check("segments", &dicom.bytes(), "bad_dicom_value");
    let mut dicom = Seg::small().dicom();
    dicom.set(text(0x0062_0001, "UT", vec![b' '; (1 << 20) + 2]));
    check("a value", &dicom.bytes(), "dicom_over_limit");
}

#[test]
fn every_cut_and_every_changed_byte_of_a_file_is_answered() {
    for seg in
        [Seg::small(), Seg::labelmap(16).with(RLE), Seg::labelmap(8).with(DEFLATED_FRAMES), Seg::small().with(DEFLATED)]
    {
        for marks_ends in [false, true] {
            let good = Dicom { marks_ends, ..seg.dicom() }.bytes();
            for place in 128..good.len() {
                assert!(read(&good[..place], InputLimits::default()).is_err(), "cut at {place}");
                for value in [0, 1, 0x7f, 0x80, 0xff] {
                    let mut bytes = good.clone();
                    bytes[place] = value;
                    if let Err(error) = read(&bytes[..], InputLimits { max_voxels: 1 << 16, ..InputLimits::default() })
                    {
                        assert!((400..500).contains(&error.status()), "{error}");
                    }
                }
            }
        }
    }
}

#[test]
fn frames_that_are_small_one_by_one_count_together() {
    let pixels = vec![1; 200 * 200];
    let frame = |z: i32| Frame { position: [0.0, 0.0, z.into()], segment: 0, pixels: pixels.clone() };
    let frames: Vec<Frame> = (0..5).map(frame).collect();
    for transfer in [RLE, DEFLATED_FRAMES] {
        let frames = frames.clone();
        let seg = Seg { columns: 200, rows: 200, frames, spacing: [1.0; 3], segments: vec![1], ..Seg::labelmap(8) };
        let bytes = seg.with(transfer).bytes();
        let error = read(&bytes[..], InputLimits { max_decompressed_bytes: 100_000, ..InputLimits::default() });
        assert_eq!(error.unwrap_err().code(), "decompressed_too_large");
        assert_eq!(read(&bytes[..], InputLimits::default()).unwrap().volume.labels().len(), 1);
    }
}
