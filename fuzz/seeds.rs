//! What a run starts from beside the corpus: small good inputs of every kind.

use std::io::Write;
use std::path::Path;

use flate2::Compression;
use flate2::write::GzEncoder;
use medialrep::params::{Given, PARAMS, Shape};

use super::dicom_bytes::{
    BIG_ENDIAN, DEFLATED, DEFLATED_FRAMES, Dicom, EXPLICIT, IMPLICIT, RLE, Seg, frame, short, text,
};
use super::nifti_bytes::{Nifti, gzip};
use super::text_bytes::{self, TextFile, zlib};

/// Writes them to the folder that `FUZZ_SEEDS` names, if it names one; a target does so before it
/// reads its corpus.
pub fn write(seeds: &[Vec<u8>]) {
    let Some(folder) = std::env::var_os("FUZZ_SEEDS") else { return };
    for (n, seed) in seeds.iter().enumerate() {
        std::fs::write(Path::new(&folder).join(format!("seed-{n:02}")), seed).unwrap();
    }
}

/// Both versions and byte orders, every datatype, every way to say where the voxels lie.
pub fn nifti() -> Vec<Vec<u8>> {
    let mut files = Vec::new();
    for version in [1, 2] {
        for (datatype, bitpix) in [(2, 8), (4, 16), (8, 32), (16, 32), (64, 64), (256, 8), (512, 16), (1024, 64)] {
            let voxels = stored(datatype);
            let file = Nifti { datatype, bitpix, voxels, ..Nifti::small(version) };
            files.push(Nifti { big_endian: true, ..file.clone() });
            files.push(file);
        }
        let small = Nifti::small(version);
        let quaternion = Nifti { qform_code: 1, sform_code: 0, quatern: [0.0, 0.6, 0.0], ..small.clone() };
        files.push(Nifti { pixdim: [-1.0, 1.0, 2.0, 3.0, 0.0, 0.0, 0.0, 0.0], ..quaternion.clone() });
        files.push(quaternion);
        files.push(Nifti { sform_code: 0, xyzt_units: 3, ..small.clone() });
        files.push(Nifti { scl_slope: 2.0, scl_inter: -1.0, ..small.clone() });
        files.push(Nifti { dim: [5, 4, 3, 2, 1, 1, 1, 1], vox_offset: 0.0, ..small.clone() });
        files.push(Nifti { vox_offset: small.vox_offset + 16.0, extension: vec![0; 20], ..small.clone() });
        files.push(small.clone().with_extensions(&[(0, LABEL_TABLE)]));
        let big_endian = Nifti { big_endian: true, ..small };
        files.push(big_endian.with_extensions(&[(6, "a comment"), (30, LABEL_TABLE), (32, "<CIFTI/>")]));
    }
    let mut files: Vec<Vec<u8>> = files.iter().map(Nifti::bytes).collect();
    let plain = Nifti::small(1).bytes();
    files.push(gzip(&plain));
    files.push(gzip(&Nifti::small(2).bytes()));
    files.push([gzip(&plain[..100]), gzip(&plain[100..])].concat());
    files.push([gzip(&plain), vec![0; 20]].concat());
    // As many voxels as are allowed, and one row more.
    for (rows, voxels) in [(256, 256 * 256), (257, 256 * 257)] {
        let dim = [2, 256, rows, 1, 1, 1, 1, 1];
        files.push(gzip(&Nifti { dim, voxels: vec![1; voxels], ..Nifti::small(1) }.bytes()));
    }
    // One byte more than is tolerated after the voxels, and than may come out of gzip.
    files.push(with_zeros(&plain, (1 << 20) + 1));
    files.push(with_zeros(&Nifti { vox_offset: 4_194_304.0, ..Nifti::small(1) }.bytes(), 2 << 20));
    files
}

/// Every kind of segmentation in every transfer syntax, with lengths told and ends marked; segments that overlap, one
/// slice, frames of bits that begin at new bytes.
pub fn dicom() -> Vec<Vec<u8>> {
    let mut files = Vec::new();
    for transfer in [EXPLICIT, IMPLICIT, BIG_ENDIAN, DEFLATED, RLE, DEFLATED_FRAMES] {
        for seg in [Seg::small(), Seg::labelmap(8), Seg::labelmap(16), Seg::fractional(255)] {
            let dicom = seg.with(transfer).dicom();
            files.push(Dicom { marks_ends: true, ..dicom.clone() });
            files.push(dicom);
        }
    }
    let small = Seg::small();
    files.push(Seg { pads_frames: true, ..small.clone() }.dicom());
    files.push(Seg { frames: (1..4).map(|segment| frame(segment, 0, |_| 1)).collect(), ..small.clone() }.dicom());
    let mut named = small.dicom();
    named.set(text(0x0008_0005, "CS", "ISO_IR 192"));
    named.set(short(0x0062_000e, 200));
    files.push(named);
    let mut files: Vec<Vec<u8>> = files.iter().map(Dicom::bytes).collect();
    files.push(gzip(&files[0]));
    files
}

/// Types, byte orders, encodings, spaces, layers and segments.
pub fn nrrd() -> Vec<Vec<u8>> {
    let small = TextFile::nrrd();
    let mut files = vec![small.clone()];
    let values: Vec<i8> = (0..24).map(|n| n % 3).collect();
    for name in ["int8", "uint8", "short", "ushort", "int", "uint", "longlong", "ulonglong", "float", "double"] {
        for (n, endian) in ["little", "big"].into_iter().enumerate() {
            let body = text_bytes::stored(name, &values, n == 1);
            let file = small.clone().with("type", name).with("endian", endian).body(body.clone());
            files.push(file.clone().with("encoding", "gzip").body(gzip(&body)));
            files.push(file);
        }
    }
    files.push(small.clone().with("encoding", "ascii").body(b"1 0 2 ".repeat(8)));
    files.push(small.clone().with("type", "double").with("encoding", "txt").body(b"1e0,0\n-2 ".repeat(8)));
    files.push(small.clone().with("space", "RAS").with("space units", r#""um" "um" "um""#));
    files.push(small.clone().without("space").without("space directions").with("spacings", "1 2 nan"));
    files.push(small.clone().without("space").without("space directions").with("spacings", "1 2 3"));
    files.push(small.clone().with("line skip", "1").with("byte skip", "2").body([b'\n'; 27].to_vec()));
    files.push(small.clone().with("data file", "x.raw"));
    let layers = small
        .with("dimension", "4")
        .with("sizes", "2 4 3 2")
        .with("kinds", "list domain domain domain")
        .with("space directions", "none (1,0,0) (0,2,0) (0,0,3)")
        .with("Segment0_Name", "liver")
        .with("Segment0_Color", "0.8 0.2 0")
        .with("Segment0_LabelValue", "1")
        .with("Segment0_Layer", "0")
        .with("Segment1_Name", "two\\nlines")
        .with("Segment1_LabelValue", "1")
        .with("Segment1_Layer", "1");
    files.push(layers.clone().body([1, 0, 0, 1].repeat(12)));
    files.push(layers.clone().with("encoding", "gz").body(gzip(&[1, 1, 0, 1].repeat(12))));
    let slicer_4 = layers
        .without("space")
        .with("space dimension", "4")
        .with("sizes", "4 3 2 2")
        .with("space directions", "(-1,0,0,0) (0,-2,0,0) (0,0,3,0) (0,0,0,1)")
        .with("space origin", "(250,250,-120,0)")
        .with("Segmentation_Extent", "100 103 50 52 -2 -1");
    files.push(slicer_4.body([[1; 24], [0; 24]].concat()));
    packed_too(&files)
}

/// Types, byte orders, encodings, names of the place, ranks.
pub fn metaimage() -> Vec<Vec<u8>> {
    let small = TextFile::metaimage();
    let mut files = vec![small.clone()];
    let values: Vec<i8> = (0..24).map(|n| n % 3).collect();
    for name in ["CHAR", "UCHAR", "SHORT", "USHORT", "INT", "ULONG", "LONG_LONG", "ULONG_LONG", "FLOAT", "DOUBLE"] {
        for (n, is_big) in ["False", "True"].into_iter().enumerate() {
            let name = format!("MET_{name}");
            let body = text_bytes::stored(&name, &values, n == 1);
            let file = small.clone().with("ElementType", &name).with("BinaryDataByteOrderMSB", is_big);
            files.push(file.clone().with("CompressedData", "True").body(zlib(&body)));
            files.push(file.body(body));
        }
    }
    files.push(small.clone().with("BinaryData", "False").body(b"1 0 2 ".repeat(8)));
    files.push(small.clone().without("TransformMatrix").with("Rotation", "0 1 0 -1 0 0 0 0 1"));
    files.push(small.clone().without("Offset").with("Position", "1 2 3"));
    files.push(small.clone().without("ElementSpacing").with("ElementSize", "1 2 3").without("TransformMatrix"));
    files.push(small.clone().with("ElementDataFile", "x.raw"));
    let plane = small.with("NDims", "2").with("DimSize", "4 6").with("ElementSpacing", "1 2").with("Offset", "1 2");
    files.push(plane.with("TransformMatrix", "1 0 0 1"));
    packed_too(&files)
}

/// The files, and the first and the last in gzip.
fn packed_too(files: &[TextFile]) -> Vec<Vec<u8>> {
    let mut all: Vec<Vec<u8>> = files.iter().map(TextFile::bytes).collect();
    let packed: Vec<_> = [all.first(), all.last()].into_iter().flatten().map(|file| gzip(file)).collect();
    all.extend(packed);
    all
}

/// Names and colours of labels as tools write them into a header extension.
const LABEL_TABLE: &str = r#"<?xml version="1.0" encoding="UTF-8"?>
<CaretExtension><VolumeInformation Index="0"><LabelTable>
<Label Key="0" Red="1" Green="1" Blue="1" Alpha="0">???</Label>
<Label Key="1" Red="0.25" Green="0.5" Blue="0" Alpha="1"><![CDATA[spleen]]></Label>
<Label Key="2" Red="0" Green="0" Blue="1" Alpha="1">left &amp; right &#233;</Label>
</LabelTable><VolumeType><![CDATA[Label]]></VolumeType></VolumeInformation></CaretExtension>"#;

/// With zeros after it, in few bytes.
fn with_zeros(file: &[u8], zeros: usize) -> Vec<u8> {
    let mut encoder = GzEncoder::new(Vec::new(), Compression::best());
    encoder.write_all(&[file, &vec![0; zeros]].concat()).unwrap();
    encoder.finish().unwrap()
}

/// 24 voxels with two labels.
fn stored(datatype: i16) -> Vec<u8> {
    let labels = (0..24_i8).map(|n| n % 3);
    match datatype {
        4 | 512 => labels.flat_map(|n| i16::from(n).to_le_bytes()).collect(),
        8 => labels.flat_map(|n| i32::from(n).to_le_bytes()).collect(),
        16 => labels.flat_map(|n| f32::from(n).to_le_bytes()).collect(),
        64 => labels.flat_map(|n| f64::from(n).to_le_bytes()).collect(),
        1024 => labels.flat_map(|n| i64::from(n).to_le_bytes()).collect(),
        _ => labels.flat_map(i8::to_le_bytes).collect(),
    }
}

/// Every parameter in every form, and all at once.
pub fn params() -> Vec<Vec<u8>> {
    let mut texts = vec!["{}".to_owned(), r#"{"margin":"\u00e9\n","labels":[[true,false,null]]}"#.to_owned()];
    let mut all = Vec::new();
    for param in PARAMS {
        let values: Vec<String> = param.shapes.iter().flat_map(values).collect();
        for value in &values {
            texts.push(format!("{{\"{}\":{value}}}", param.name));
        }
        if param.default_value() == Given::Nothing {
            texts.push(format!("{{\"{}\":null}}", param.name));
        }
        // The last: a spacing goes with the automatic grid only.
        all.push(format!("\"{}\":{}", param.name, values.last().unwrap()));
    }
    texts.push(format!("{{{}}}", all.join(",")));
    texts.into_iter().map(String::into_bytes).collect()
}

/// The words and the ends of a shape, as JSON.
fn values(shape: &Shape) -> Vec<String> {
    match shape {
        Shape::Words(words) => words.iter().map(|word| format!("\"{word}\"")).collect(),
        Shape::Count(range) => vec![range.start().to_string(), range.end().to_string()],
        Shape::Number(range) => vec![format!("{:e}", range.start()), range.end().to_string()],
        Shape::Label => vec!["11".to_owned(), "-3".to_owned()],
        Shape::Fields(fields) => {
            let low = fields.iter().map(|(name, part)| format!("\"{name}\":{}", values(part)[0]));
            vec![format!("{{{}}}", low.collect::<Vec<_>>().join(","))]
        }
        Shape::List { of, .. } => vec![format!("[{}]", values(of).join(","))],
        Shape::Texts { .. } => vec![r#"{"11":"left caudate","-3":" \u00e9"}"#.to_owned()],
    }
}

/// Forms with the boundary `X`, good and nearly so.
pub fn multipart() -> Vec<Vec<u8>> {
    let plain = Nifti::small(1).bytes();
    let packed = gzip(&plain);
    let json: &[u8] = br#"{"margin":0.1,"grid":"auto"}"#;
    vec![
        form(&[("mask", "; filename=\"a.nii\"", &plain)]),
        form(&[
            ("mask", "; filename*=UTF-8''%e2%82%ac", &packed),
            ("params", "\r\nContent-Type: application/json", json),
        ]),
        form(&[("params", "", json), ("mask", "", &packed)]),
        form(&[("mask", "", &packed), ("mask", "", &packed)]),
        form(&[("params", "", json)]),
        form(&[("mask", "", &Nifti::small(2).bytes())]),
        [b"preamble\r\n".to_vec(), form(&[("mask", "", &packed)]), b"epilogue".to_vec()].concat(),
        b"--X--\r\n".to_vec(),
    ]
}

fn form(parts: &[(&str, &str, &[u8])]) -> Vec<u8> {
    let mut body = Vec::new();
    for (name, more, content) in parts {
        body.extend(format!("--X\r\nContent-Disposition: form-data; name=\"{name}\"{more}\r\n\r\n").into_bytes());
        body.extend(*content);
        body.extend(b"\r\n");
    }
    body.extend(b"--X--\r\n");
    body
}

/// Content types, a line break, and bodies of DICOMweb, good and nearly so.
pub fn related() -> Vec<Vec<u8>> {
    let instance = Seg::small().dicom().bytes();
    let plain = br#"multipart/related; type="application/dicom"; boundary=X"#;
    let quoted = br#"Multipart/Related;boundary="a b;c";type=application/dicom;transfer-syntax=*"#;
    let dicom = "Content-Type: application/dicom\r\n";
    vec![
        related_body(plain, "X", &[(dicom, &instance)]),
        related_body(plain, "X", &[(dicom, b"one"), ("", b""), ("Content-Location: /a\r\n b\r\n", b"\r\n--Y\r\n--X")]),
        related_body(quoted, "a b;c", &[("Content-Transfer-Encoding: binary\r\n", b"\r\n\r\n--a b;c-\r")]),
        related_body(plain, "X", &[("Content-Transfer-Encoding: base64\r\n", b"b25l")]),
        related_body(plain, "X", &[("no field\r\n", b"one")]),
        related_body(plain, "X", &[("", b"one"), ("", b"two"), ("", b"three"), ("", b"four"), ("", b"five")]),
        related_body(plain, "Y", &[(dicom, b"one")]),
        related_body(b"multipart/mixed; boundary=X", "X", &[(dicom, b"one")]),
        [plain, &b"\nbefore\r\n--X \t\r\n\r\ndata\r\n--X--behind"[..]].concat(),
        [plain, &b"\n--X--"[..]].concat(),
    ]
}

fn related_body(content_type: &[u8], boundary: &str, parts: &[(&str, &[u8])]) -> Vec<u8> {
    let mut body = [content_type, b"\n"].concat();
    for (head, data) in parts {
        body.extend(format!("--{boundary}\r\n{head}\r\n").into_bytes());
        body.extend(*data);
        body.extend(b"\r\n");
    }
    body.extend(format!("--{boundary}--\r\n").into_bytes());
    body
}
