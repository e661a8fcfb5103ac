//! What the DICOM reader refuses, and what it says.

use medialrep::formats::{InputLimits, ReadError, read};

use crate::help::dicom_bytes::{
    DEFLATED, DEFLATED_FRAMES, Dicom, Element, Frame, RLE, Seg, Value, frame, orientation, sequence, short, text,
};
use crate::help::support::CANARY;

const SERIES: &str = "1.2.840.99.7";

fn refused(bytes: &[u8]) -> ReadError {
    read(bytes, InputLimits::default()).unwrap_err()
}

fn check(what: &str, dicom: &Dicom, code: &str, status: u16, location: &str) {
    let error = refused(&dicom.bytes());
    assert_eq!((error.code(), error.status(), error.location().as_str()), (code, status, location), "{what}: {error}");
    assert!(!error.hint().is_empty(), "{what}");
}

/// A good file with a change.
fn changed(change: impl FnOnce(&mut Dicom)) -> Dicom {
    let mut dicom = Seg::small().dicom();
    change(&mut dicom);
    dicom
}

/// A good file with other frames.
fn with_frames(change: impl Fn(usize, &mut Frame)) -> Dicom {
    let mut seg = Seg::small();
    seg.frames.iter_mut().enumerate().for_each(|(n, frame)| change(n, frame));
    seg.dicom()
}

#[test]
fn pixels_in_other_transfer_syntaxes_are_refused_by_name() {
    for (uid, name) in [("1.2.840.10008.1.2.4.90", "JPEG 2000"), ("1.2.840.10008.1.2.4.80", "JPEG-LS"), ("1.2.3", "")] {
        let dicom = Dicom { transfer: uid.to_owned(), ..Seg::small().dicom() };
        check(uid, &dicom, "unsupported_transfer_syntax", 422, "(0002,0010)");
        let error = refused(&dicom.bytes());
        assert!(error.to_string().contains(uid) && error.to_string().contains(name), "{error}");
        assert!(error.hint().contains("store uncompressed"));
    }
}

#[test]
fn what_is_no_segmentation_is_refused_by_name() {
    for (class, name) in [("481.3", "RTSTRUCT"), ("2", "CT image"), ("66.5", "surface segmentation")] {
        let uid = format!("1.2.840.10008.5.1.4.1.1.{class}");
        let dicom = changed(|dicom| dicom.set(text(0x0008_0016, "UI", &uid)));
        check(name, &dicom, "not_a_segmentation", 422, "(0008,0016)");
        assert!(refused(&dicom.bytes()).to_string().contains(name));
    }
}

#[test]
fn needed_elements_that_are_missing_or_senseless_are_named() {
    let without = |tag| changed(|dicom| dicom.remove(tag));
    let with = |element: Element| changed(|dicom| dicom.set(element));
    for (tag, location) in [
        (0x0008_0016, "(0008,0016)"),
        (0x0028_0010, "(0028,0010)"),
        (0x0028_0011, "(0028,0011)"),
        (0x0062_0001, "(0062,0001)"),
        (0x7fe0_0010, "(7fe0,0010)"),
    ] {
        check(location, &without(tag), "dicom_element_missing", 422, location);
    }
    for (element, location) in [
        (short(0x0028_0002, 3), "(0028,0002)"),
        (text(0x0028_0008, "IS", "six"), "(0028,0008)"),
        (text(0x0028_0008, "IS", "0"), "(0028,0008)"),
        (text(0x0062_0001, "CS", "SURFACE"), "(0062,0001)"),
        (text(0x0008_0016, "UI", CANARY), "(0008,0016)"),
        (sequence(0x0062_0002, vec![vec![short(0x0062_0004, 1)]; 2]), "(0062,0002)[2].(0062,0004)"),
        (sequence(0x0062_0002, vec![vec![short(0x0062_0004, 0)]]), "(0062,0002)[1].(0062,0004)"),
    ] {
        check(location, &with(element), "bad_dicom_value", 400, location);
    }
    check(
        "no number",
        &with(sequence(0x0062_0002, vec![vec![]])),
        "dicom_element_missing",
        422,
        "(0062,0002)[1].(0062,0004)",
    );
    check("bits", &with(short(0x0028_0100, 16)), "unsupported_segmentation", 422, "(0028,0100)");
}

#[test]
fn senseless_places_are_refused_with_their_path() {
    let position = "(5200,9230)[2].(0020,9113)[1].(0020,0032)";
    for numbers in ["1\\2", "1\\2\\nan", "1\\2\\1e9", "a\\b\\c"] {
        let dicom = changed(|dicom| {
            dicom.items(0x5200_9230)[1][0] = sequence(0x0020_9113, vec![vec![text(0x0020_0032, "DS", numbers)]]);
        });
        check(numbers, &dicom, "bad_dicom_value", 400, position);
    }
    for cosines in [[1.0, 0.0, 0.0, 1.0, 0.0, 0.0], [2.0, 0.0, 0.0, 0.0, 1.0, 0.0], [0.0; 6]] {
        let dicom = changed(|dicom| dicom.items(0x5200_9229)[0][1] = orientation(&cosines));
        check("cosines", &dicom, "bad_dicom_value", 400, "(5200,9230)[1].(0020,9116)");
    }
    for spacing in ["0\\1", "-1\\1", "1e6\\1", "1"] {
        let dicom = changed(|dicom| {
            dicom.items(0x5200_9229)[0][0] = sequence(0x0028_9110, vec![vec![text(0x0028_0030, "DS", spacing)]]);
        });
        check(spacing, &dicom, "bad_dicom_value", 400, "(5200,9229)[1].(0028,9110)[1].(0028,0030)");
    }
}

#[test]
fn frames_that_lie_on_no_grid_are_refused_by_number() {
    let position = |frame: usize| format!("(5200,9230)[{frame}].(0020,9113)[1].(0020,0032)");
    let uneven = with_frames(|n, frame| frame.position[2] += if n % 3 == 2 { 1.1 } else { 0.0 });
    check("uneven", &uneven, "uneven_slices", 422, &position(3));
    let sheared = with_frames(|n, frame| frame.position[1] += 0.3 * (n % 3) as f64);
    check("sheared", &sheared, "sheared_slices", 422, &position(2));
    let turned = changed(|dicom| dicom.items(0x5200_9230)[3].push(orientation(&[0.0, 1.0, 0.0, -1.0, 0.0, 0.0])));
    check("turned", &turned, "mixed_geometry", 422, "(5200,9230)[4]");
    let resized = changed(|dicom| {
        let measures = sequence(0x0028_9110, vec![vec![text(0x0028_0030, "DS", "1\\1")]]);
        dicom.items(0x5200_9230)[5].push(measures);
    });
    check("resized", &resized, "mixed_geometry", 422, "(5200,9230)[6]");
    let twice = with_frames(|_, frame| frame.segment = 1);
    check("twice", &twice, "repeated_frame", 422, "(5200,9230)[4]");
    let one = Seg { frames: vec![frame(1, 0, |_| 1)], spacing: [1.0, 1.0, 0.0], ..Seg::small() };
    check("one slice", &one.dicom(), "no_slice_spacing", 422, "(5200,9230)");
}

#[test]
fn slides_and_radiographs_are_refused_with_the_series_they_refer_to() {
    let referring = |change: &dyn Fn(&mut Dicom)| {
        let mut dicom = Seg::small().dicom();
        dicom.set(sequence(0x0008_1115, vec![vec![text(0x0020_000e, "UI", SERIES)]]));
        change(&mut dicom);
        dicom
    };
    let flat = referring(&|dicom| drop(dicom.items(0x5200_9230)[0].remove(0)));
    let slide = referring(&|dicom| dicom.items(0x5200_9230)[0].push(sequence(0x0048_021a, vec![vec![]])));
    let tiled = referring(&|dicom| dicom.set(Element(0x0048_0006, "UL", Value::Bytes(vec![0, 1, 0, 0]))));
    for (dicom, code) in [(flat, "no_position"), (slide, "tiled_image"), (tiled, "tiled_image")] {
        check(code, &dicom, code, 422, "(5200,9230)[1]");
        assert!(refused(&dicom.bytes()).hint().contains(SERIES));
    }
}

#[test]
fn frames_and_pixels_must_be_as_many_as_are_described() {
    for frames in ["5", "7"] {
        let dicom = changed(|dicom| dicom.set(text(0x0028_0008, "IS", frames)));
        check(frames, &dicom, "frame_count", 400, "(0028,0008)");
    }
    for bytes in [0, 8, 14, 16, 4000] {
        let dicom = changed(|dicom| dicom.set(Element(0x7fe0_0010, "OB", Value::Bytes(vec![0; bytes]))));
        check("pixels", &dicom, "pixel_data_length", 400, "(7fe0,0010)");
    }
    for transfer in [RLE, DEFLATED_FRAMES] {
        for change in [|all: &mut Vec<Vec<u8>>| drop(all.pop()), |all: &mut Vec<Vec<u8>>| all.push(all[0].clone())] {
            let mut dicom = Seg::small().with(transfer).dicom();
            let Some(Element(_, _, Value::Fragments(fragments))) = dicom.elements.last_mut() else { panic!("none") };
            change(fragments);
            check("fragments", &dicom, "dicom_malformed", 400, "(7fe0,0010)");
        }
    }
}

#[test]
fn a_frame_that_does_not_decode_is_refused() {
    for (transfer, damaged) in [(RLE, vec![0; 64]), (RLE, vec![1; 10]), (DEFLATED_FRAMES, vec![0xff; 10])] {
        let mut dicom = Seg::small().with(transfer).dicom();
        let Some(Element(_, _, Value::Fragments(fragments))) = dicom.elements.last_mut() else { panic!("none") };
        fragments[2] = damaged;
        check(transfer, &dicom, "corrupt_frame", 400, "(7fe0,0010)");
        assert!(refused(&dicom.bytes()).to_string().contains("frame 3"));
    }
}

#[test]
fn a_damaged_deflated_data_set_is_refused() {
    let mut bytes = Seg::small().with(DEFLATED).bytes();
    let short = bytes[..bytes.len() - 20].to_vec();
    assert_eq!(refused(&short).code(), "truncated");
    let start = bytes.len() - 60;
    bytes[start..].fill(0xff);
    assert!(["corrupt_deflate", "truncated", "dicom_malformed"].contains(&refused(&bytes).code()));
}

#[test]
fn more_voxels_than_allowed_are_refused_before_they_are_reserved() {
    let limits = InputLimits { max_voxels: 5 * 3 * 5 - 1, ..InputLimits::default() };
    let error = read(&Seg::small().bytes()[..], limits).unwrap_err();
    assert_eq!((error.code(), error.status()), ("too_many_voxels", 413));
    let far = with_frames(|n, frame| frame.position[2] += if n % 3 == 2 { 9e6 } else { 0.0 });
    let limits = InputLimits { max_voxels: 1 << 24, ..limits };
    let error = read(&far.bytes()[..], limits).expect_err("far");
    assert_eq!((error.code(), error.location().as_str()), ("too_many_voxels", "(0028,0010)"));
}

#[test]
fn segments_that_overlap_too_much_are_refused() {
    let of = |segments: u16| {
        let frames = (1..=segments).map(|segment| frame(segment, 0, |_| 1)).collect();
        Seg { frames, segments: (1..=segments).collect(), ..Seg::small() }
    };
    let limits = InputLimits { max_voxels: 45, ..InputLimits::default() };
    assert_eq!(read(&of(4).bytes()[..], limits).unwrap().volume.layers().count(), 4);
    assert_eq!(read(&of(5).bytes()[..], limits).unwrap_err().code(), "too_many_overlaps");
    check("all", &of(70).dicom(), "too_many_overlaps", 413, "(7fe0,0010)");
}

/// Every text of a file stands for a patient's name, and every way of being wrong is tried.
#[test]
fn text_of_a_file_is_in_no_error() {
    let mut dicom = Seg::small().dicom();
    for (tag, kind) in [
        (0x0008_0005, "CS"),
        (0x0008_0020, "DA"),
        (0x0008_0050, "SH"),
        (0x0008_0080, "LO"),
        (0x0008_1030, "LO"),
        (0x0010_0010, "PN"),
        (0x0010_4000, "LT"),
        (0x0020_4000, "LT"),
        (0x0040_a160, "UT"),
    ] {
        dicom.set(text(tag, kind, CANARY));
    }
    dicom.items(0x0062_0002)[0][1] = text(0x0062_0005, "LO", CANARY);
    let good = dicom.bytes();
    let mut shown = String::new();
    let mut show = |bytes: &[u8]| {
        if let Err(error) = read(bytes, InputLimits::default()) {
            shown += &format!("{error} {} {} {error:?}\n", error.location(), error.hint());
        }
    };
    for place in 128..good.len() {
        for value in [0, 0xff, good[place] ^ 1] {
            let mut bytes = good.clone();
            bytes[place] = value;
            show(&bytes);
        }
        show(&good[..place]);
    }
    for tag in [0x0002_0010, 0x0008_0016, 0x0028_0008, 0x0062_0001, 0x5200_9230] {
        let mut dicom = dicom.clone();
        match tag {
            0x0002_0010 => dicom.transfer = CANARY.to_owned(),
            _ => dicom.set(text(tag, "LO", CANARY)),
        }
        show(&dicom.bytes());
    }
    assert!(shown.lines().count() > 1000);
    assert!(!shown.contains(CANARY) && !shown.contains("CANARY"));
}
