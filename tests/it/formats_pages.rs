//! `picture.png`, `report.pdf` and `surfaces.stl`: what people and printers take.

use std::collections::BTreeMap;
use std::io::Read;

use flate2::read::ZlibDecoder;
use medialrep::formats::artifacts;
use medialrep::formats::write::record::Record;
use medialrep::formats::write::thickness::{InputFacts, OuterTimings};
use medialrep::model::{Model, TriangleMesh};
use medialrep::samples::by_name;
use nalgebra::Rotation3;

use crate::help::models::model;

/// A record of a model, of a run that ended at 2024-02-29 23:59:59 UTC.
pub fn record(model: Model) -> Record {
    Record {
        model,
        input: InputFacts { sha256: "ab".repeat(32), format: "nifti1.gz".to_owned() },
        warnings: Vec::new(),
        timings: OuterTimings::default(),
        ended_unix_s: Some(1_709_251_199),
        dicom: None,
    }
}

/// The bytes of an artifact.
pub fn written(name: &str, record: &Record) -> Vec<u8> {
    let mut bytes = Vec::new();
    (artifacts::by_name(name).unwrap().write)(record, &mut bytes).unwrap();
    bytes
}

/// The result of a sample, for which the numbers are known.
pub fn slab() -> Model {
    let volume = by_name("slab").unwrap().voxelise([1.0; 3], Rotation3::identity()).unwrap();
    medialrep::run(&volume, &medialrep::params::Params::default()).unwrap()
}

fn inflated(bytes: &[u8]) -> Vec<u8> {
    let mut whole = Vec::new();
    ZlibDecoder::new(bytes).read_to_end(&mut whole).unwrap();
    whole
}

/// CRC-32 bit by bit (ISO 3309).
fn crc(bytes: &[u8]) -> u32 {
    let mut crc = u32::MAX;
    for byte in bytes {
        crc ^= u32::from(*byte);
        for _ in 0..8 {
            crc = if crc & 1 == 1 { crc >> 1 ^ 0xedb8_8320 } else { crc >> 1 };
        }
    }
    !crc
}

/// Width, height and pixels of a PNG.
pub fn png(file: &[u8]) -> (usize, usize, Vec<u8>) {
    assert_eq!(&file[..8], b"\x89PNG\r\n\x1a\n");
    let (mut rest, mut kinds, mut header, mut data) = (&file[8..], Vec::new(), Vec::new(), Vec::new());
    while !rest.is_empty() {
        let length = u32::from_be_bytes(rest[..4].try_into().unwrap()) as usize;
        let (kind, content) = (&rest[4..8], &rest[8..8 + length]);
        let told = u32::from_be_bytes(rest[8 + length..12 + length].try_into().unwrap());
        assert_eq!(told, crc(&rest[4..8 + length]), "{kind:?}");
        kinds.push(String::from_utf8(kind.to_vec()).unwrap());
        match kind {
            b"IHDR" => header = content.to_vec(),
            b"IDAT" => data.extend(content),
            _ => {}
        }
        rest = &rest[12 + length..];
    }
    assert_eq!((kinds.first().unwrap().as_str(), kinds.last().unwrap().as_str()), ("IHDR", "IEND"));
    assert_eq!(header[8..], [8, 2, 0, 0, 0], "8 bits of red, green and blue");
    let [width, height] = [0, 4].map(|at| u32::from_be_bytes(header[at..at + 4].try_into().unwrap()) as usize);
    let lines = inflated(&data);
    assert_eq!(lines.len(), height * (1 + 3 * width));
    let mut pixels: Vec<u8> = Vec::new();
    for (y, line) in lines.chunks(1 + 3 * width).enumerate() {
        assert_eq!(line[0], 2, "the filter Up");
        for (n, change) in line[1..].iter().enumerate() {
            let above = if y == 0 { 0 } else { pixels[(y - 1) * 3 * width + n] };
            pixels.push(above.wrapping_add(*change));
        }
    }
    (width, height, pixels)
}

#[test]
fn a_picture_is_a_png_with_the_colours_of_thickness_on_white() {
    let (width, height, pixels) = png(&written("picture.png", &record(slab())));
    assert_eq!(width, 1024);
    assert!(height > 500, "{height}");
    assert_eq!(pixels[..3], [255; 3]);
    let is_colored = |pixel: &&[u8]| pixel.iter().max().unwrap() - pixel.iter().min().unwrap() > 60;
    let colored = pixels.chunks(3).filter(is_colored).count();
    assert!(colored > 20_000, "{colored} pixels of surfaces, legend and verdict");
}

#[test]
fn a_model_with_holes_and_a_refusal_is_a_picture_too() {
    let (width, height, pixels) = png(&written("picture.png", &record(model())));
    assert_eq!((width, pixels.len()), (1024, 3 * 1024 * height));
    let nothing = Model { structures: Vec::new(), ..model() };
    assert_eq!(png(&written("picture.png", &record(nothing))).0, 1024);
}

/// The objects of a PDF by the places that its table of references tells.
fn pdf_objects(file: &[u8]) -> BTreeMap<usize, Vec<u8>> {
    assert_eq!(&file[..9], b"%PDF-1.7\n");
    let tail = String::from_utf8_lossy(&file[file.len() - 60..]).into_owned();
    let start = tail.split("startxref\n").nth(1).unwrap().lines().next().unwrap().parse::<usize>().unwrap();
    let table = String::from_utf8(file[start..].to_vec()).unwrap();
    let mut lines = table.lines();
    assert_eq!(lines.next(), Some("xref"));
    let count: usize = lines.next().unwrap().split_once(' ').unwrap().1.parse().unwrap();
    let mut objects = BTreeMap::new();
    for (number, line) in lines.take(count).enumerate().skip(1) {
        assert_eq!(line.len() + 1, 20, "entries are of 20 bytes: {line:?}");
        let at: usize = line[..10].parse().unwrap();
        let head = format!("{number} 0 obj\n");
        assert!(file[at..].starts_with(head.as_bytes()), "object {number} is not at {at}");
        objects.insert(number, file[at + head.len()..].to_vec());
    }
    objects
}

/// The bytes of a stream, inflated; `None` of an object that is none.
fn stream(object: &[u8]) -> Option<Vec<u8>> {
    let text = String::from_utf8_lossy(&object[..object.len().min(600)]).into_owned();
    let dictionary = text.split("endobj").next()?.split_once("\nstream\n").map(|(head, _)| head)?;
    let length: usize = dictionary.split("/Length ").nth(1)?.split(' ').next()?.parse().ok()?;
    let begin = dictionary.len() + "\nstream\n".len();
    Some(inflated(&object[begin..begin + length]))
}

/// All words of a PDF, page after page, as the fonts' maps give them back.
fn pdf_words(file: &[u8]) -> Vec<String> {
    let streams: Vec<String> = pdf_objects(file)
        .values()
        .filter_map(|object| stream(object))
        .filter_map(|bytes| String::from_utf8(bytes).ok())
        .collect();
    let mut maps = Vec::new();
    for map in streams.iter().filter(|text| text.contains("begincmap")) {
        let pairs = map.lines().filter_map(|line| line.strip_prefix('<')?.strip_suffix('>')?.split_once("> <"));
        let pairs = pairs.map(|(glyph, unit)| (glyph.to_owned(), u32::from_str_radix(unit, 16).unwrap()));
        maps.push(pairs.collect::<BTreeMap<String, u32>>());
    }
    let mut pages = Vec::new();
    for page in streams.iter().filter(|text| text.contains(" Tj ET")) {
        let mut words = String::new();
        for line in page.lines().filter(|line| line.starts_with("BT ")) {
            let map = &maps[usize::from(line.contains("/F1 "))];
            let digits = line.split('<').nth(1).unwrap().split('>').next().unwrap();
            for glyph in digits.as_bytes().chunks(4) {
                let glyph = std::str::from_utf8(glyph).unwrap();
                words.push(char::from_u32(map[glyph]).unwrap());
            }
            words.push(' ');
        }
        pages.push(words);
    }
    pages
}

#[test]
fn a_report_says_what_was_measured_how_sure_and_from_what() {
    let mut model = model();
    model.structures[0].name = Some("Nucleus caudatus, Größe Ω".to_owned());
    let words = pdf_words(&written("report.pdf", &record(model)));
    assert_eq!(words.len(), 3, "both together, and each of the two structures");
    let page = &words[1];
    for wanted in [
        "Nucleus caudatus, Größe Ω",
        "NOT FOR DIAGNOSIS",
        "WARN",
        "Few nodes. (few_nodes: 0.3, threshold –)",
        "a \"quoted\" warning (a_warning)",
        "overlap (Dice) 0.960",
        "figure 1, sheet",
        "run 2024-02-29 23:59 UTC",
        "abababababababababababababababababababababababababababababababab",
        "\"prune\":",
        "90 × 80 × 70 voxels of 1.00 × 1.00 × 2.00 mm",
        env!("CARGO_PKG_VERSION"),
    ] {
        assert!(page.contains(wanted), "{wanted} in {page}");
    }
    assert!(words[2].contains("REFUSED") && words[2].contains("has only 3 points"), "{}", words[2]);
}

#[test]
fn the_numbers_of_a_report_are_those_of_the_summary() {
    let model = slab();
    let total = model.structures[0].thickness_summary().total_mm.unwrap();
    let words = pdf_words(&written("report.pdf", &record(model)));
    for length in [total.mean, total.sd, total.min, total.p5, total.p50, total.p95, total.max] {
        assert!(words[0].contains(&format!("{length:.2}")), "{length} in {}", words[0]);
    }
    assert!(total.min <= total.p5 && total.p95 <= total.max);
}

/// The triangles of a binary STL by the bits of their corners.
pub fn stl(file: &[u8]) -> Vec<[[u32; 3]; 3]> {
    assert!(!file.starts_with(b"solid"));
    let count = u32::from_le_bytes(file[80..84].try_into().unwrap()) as usize;
    assert_eq!(file.len(), 84 + 50 * count);
    let mut triangles = Vec::new();
    for triangle in file[84..].chunks(50) {
        let number = |n: usize| u32::from_le_bytes(triangle[4 * n..4 * n + 4].try_into().unwrap());
        triangles.push([3, 6, 9].map(|corner| [0, 1, 2].map(|axis| number(corner + axis))));
    }
    triangles
}

#[test]
fn surfaces_are_closed_face_outward_and_lie_in_lps() {
    let model = slab();
    let object: &TriangleMesh = &model.structures[0].object;
    let middle =
        object.positions.iter().map(|at| at.coords).sum::<nalgebra::Vector3<f64>>() / object.positions.len() as f64;
    let volume_mm3 = model.structures[0].volume_mm3;
    let file = written("surfaces.stl", &record(model));
    assert!(file.starts_with(b"medialrep SPACE=LPS UNIT=mm"));
    let (mut edges, mut volume, mut sum, mut corners) = (BTreeMap::new(), 0.0, nalgebra::Vector3::zeros(), 0.0);
    for triangle in stl(&file) {
        let points = triangle.map(|corner| nalgebra::Vector3::from(corner.map(|bits| f64::from(f32::from_bits(bits)))));
        volume += points[0].dot(&points[1].cross(&points[2])) / 6.0;
        sum += points.iter().sum::<nalgebra::Vector3<f64>>();
        corners += 3.0;
        for n in 0..3 {
            *edges.entry((triangle[n], triangle[(n + 1) % 3])).or_insert(0) += 1;
        }
    }
    assert!(edges.iter().all(|((a, b), count)| *count == 1 && edges.get(&(*b, *a)) == Some(&1)), "it has a hole");
    assert!((volume / volume_mm3 - 1.0).abs() < 0.1, "{volume} of {volume_mm3}");
    let lps = sum / corners;
    assert!((lps.x + middle.x).abs() < 3.0 && (lps.y + middle.y).abs() < 3.0 && (lps.z - middle.z).abs() < 3.0);
}

#[test]
fn equal_records_give_equal_bytes() {
    for artifact in &artifacts::ARTIFACTS {
        let [once, again] = [(); 2].map(|()| written(artifact.name, &record(model())));
        assert!(once == again, "{}", artifact.name);
    }
}
