//! A little reader of DICOM files, explicit VR little endian, that knows nothing of the writer.

use std::collections::BTreeMap;

/// Elements by tag as one number: group and element.
pub type Dataset = BTreeMap<u32, Element>;

/// An element.
#[derive(Clone, Debug, PartialEq)]
pub enum Element {
    /// Bytes with their VR.
    Value(String, Vec<u8>),
    /// The items of a sequence.
    Items(Vec<Dataset>),
}

/// The file meta information and the data set of a file; panics where the file is not as the standard asks.
pub fn read(file: &[u8]) -> (Dataset, Dataset) {
    assert!(file[..128].iter().all(|byte| *byte == 0) && &file[128..132] == b"DICM", "preamble");
    let mut meta = elements(&file[132..144]);
    let Some(Element::Value(vr, length)) = meta.remove(&0x0002_0000) else { panic!("no length of the group") };
    assert_eq!(vr, "UL");
    let length = u32::from_le_bytes(length.try_into().unwrap()) as usize;
    meta.append(&mut elements(&file[144..144 + length]));
    assert_eq!(text(&meta, 0x0002_0010), "1.2.840.10008.1.2.1");
    (meta, elements(&file[144 + length..]))
}

fn elements(mut bytes: &[u8]) -> Dataset {
    let mut found = Dataset::new();
    let mut last = 0;
    while !bytes.is_empty() {
        let tag = u32::from(u16::from_le_bytes([bytes[0], bytes[1]])) << 16
            | u32::from(u16::from_le_bytes([bytes[2], bytes[3]]));
        assert!(found.is_empty() || tag > last, "{tag:08x} after {last:08x}");
        last = tag;
        let vr = String::from_utf8(bytes[4..6].to_vec()).unwrap();
        let is_long = ["OB", "OW", "SQ", "UT", "UN"].contains(&vr.as_str());
        let (head, length) = if is_long {
            (12, u32::from_le_bytes(bytes[8..12].try_into().unwrap()) as usize)
        } else {
            (8, usize::from(u16::from_le_bytes([bytes[6], bytes[7]])))
        };
        assert_eq!(length % 2, 0, "{tag:08x} has an odd length");
        let value = &bytes[head..head + length];
        let element = if vr == "SQ" { Element::Items(items(value)) } else { Element::Value(vr, value.to_vec()) };
        found.insert(tag, element);
        bytes = &bytes[head + length..];
    }
    found
}

fn items(mut bytes: &[u8]) -> Vec<Dataset> {
    let mut found = Vec::new();
    while !bytes.is_empty() {
        assert_eq!(bytes[..4], [0xfe, 0xff, 0x00, 0xe0], "an item");
        let length = u32::from_le_bytes(bytes[4..8].try_into().unwrap()) as usize;
        found.push(elements(&bytes[8..8 + length]));
        bytes = &bytes[8 + length..];
    }
    found
}

/// The bytes of a value.
pub fn bytes(set: &Dataset, tag: u32) -> &[u8] {
    match set.get(&tag) {
        Some(Element::Value(_, bytes)) => bytes,
        other => panic!("{tag:08x} is {other:?}"),
    }
}

/// A text without what fills it up.
pub fn text(set: &Dataset, tag: u32) -> String {
    String::from_utf8(bytes(set, tag).to_vec()).unwrap().trim_end_matches(['\0', ' ']).to_owned()
}

/// A whole number of two or four bytes.
pub fn number(set: &Dataset, tag: u32) -> usize {
    bytes(set, tag).iter().rev().fold(0, |number, byte| number << 8 | usize::from(*byte))
}

/// The items of a sequence; none where it is not there.
pub fn sequence(set: &Dataset, tag: u32) -> &[Dataset] {
    match set.get(&tag) {
        Some(Element::Items(items)) => items,
        None => &[],
        other => panic!("{tag:08x} is {other:?}"),
    }
}

/// The value of the code in a sequence.
pub fn code(set: &Dataset, tag: u32) -> String {
    text(&sequence(set, tag)[0], 0x0008_0100)
}
