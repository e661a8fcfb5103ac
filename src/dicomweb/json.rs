//! Attributes as `application/dicom+json` (PS3.18 annex F).

use std::collections::BTreeMap;

use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use serde_json::{Map, Number, Value, json};

use super::charset::Charset;
use crate::formats::dicom_elements::{DataSet, Element, ElementValue, Tag};

/// Media type of what is made here.
pub const DICOM_JSON: &str = "application/dicom+json";

/// How JSON is encoded, as a value of SpecificCharacterSet.
const UNICODE: &str = "ISO_IR 192";
const CHARACTER_SET: Tag = Tag(0x0008_0005);

/// Attributes by the eight digits of their tag, tags ascending.
pub type Attributes = BTreeMap<String, Value>;

/// The name of a tag in JSON: `00100010`.
#[must_use]
pub fn key(tag: Tag) -> String {
    format!("{:08X}", tag.0)
}

/// An attribute of these values.
#[must_use]
pub fn attribute(kind: &str, values: Vec<Value>) -> Value {
    if values.is_empty() { json!({"vr": kind}) } else { json!({"vr": kind, "Value": values}) }
}

/// All attributes. Of values that are too long to stand here it is told by `bulk_uri` where they are to be had; without
/// one, and of sequences, they are left out.
pub fn attributes(set: &DataSet, bulk_uri: Option<&dyn Fn(Tag) -> String>) -> Attributes {
    let mut found = Attributes::new();
    let charset = charset_of(set, Charset::default());
    for element in set.elements() {
        let value = match &element.value {
            ElementValue::Long { .. } if element.kind == *b"SQ" => None,
            ElementValue::Long { .. } => {
                bulk_uri.map(|uri| json!({"vr": kind_of(element), "BulkDataURI": uri(element.tag)}))
            }
            _ => Some(element_to_json(element, charset)),
        };
        if let Some(value) = value {
            found.insert(key(element.tag), value);
        }
    }
    found
}

/// An item of a sequence. Nothing in it is long.
fn item_to_json(set: &DataSet, charset: Charset) -> Value {
    let charset = charset_of(set, charset);
    let elements = set.elements().iter();
    Value::Object(elements.map(|element| (key(element.tag), element_to_json(element, charset))).collect())
}

fn charset_of(set: &DataSet, outer: Charset) -> Charset {
    match set.get(CHARACTER_SET).map(|element| &element.value) {
        Some(ElementValue::Bytes(bytes)) => Charset::of(bytes),
        _ => outer,
    }
}

fn kind_of(element: &Element) -> String {
    String::from_utf8_lossy(&element.kind).into_owned()
}

fn element_to_json(element: &Element, charset: Charset) -> Value {
    let kind = kind_of(element);
    match &element.value {
        ElementValue::Items(items) => attribute(&kind, items.iter().map(|item| item_to_json(item, charset)).collect()),
        // The text here is Unicode, whatever the file's is.
        ElementValue::Bytes(_) if element.tag == CHARACTER_SET => attribute(&kind, vec![UNICODE.into()]),
        ElementValue::Bytes(bytes) if is_binary(&kind) && !bytes.is_empty() => {
            json!({"vr": kind, "InlineBinary": STANDARD.encode(bytes)})
        }
        ElementValue::Bytes(bytes) => attribute(&kind, values(&kind, bytes, charset)),
        ElementValue::Long { .. } => attribute(&kind, Vec::new()),
    }
}

fn is_binary(kind: &str) -> bool {
    matches!(kind, "OB" | "OD" | "OF" | "OL" | "OV" | "OW" | "UN")
}

/// The values of an element; none of an empty one.
fn values(kind: &str, bytes: &[u8], charset: Charset) -> Vec<Value> {
    match kind {
        "AT" => chunks(bytes, |[a, b, c, d]: [u8; 4]| format!("{:02X}{:02X}{:02X}{:02X}", b, a, d, c).into()),
        "US" => chunks(bytes, |own| u16::from_le_bytes(own).into()),
        "SS" => chunks(bytes, |own| i16::from_le_bytes(own).into()),
        "UL" => chunks(bytes, |own| u32::from_le_bytes(own).into()),
        "SL" => chunks(bytes, |own| i32::from_le_bytes(own).into()),
        "UV" => chunks(bytes, |own| u64::from_le_bytes(own).into()),
        "SV" => chunks(bytes, |own| i64::from_le_bytes(own).into()),
        "FL" => chunks(bytes, |own| float(f32::from_le_bytes(own).into())),
        "FD" => chunks(bytes, |own| float(f64::from_le_bytes(own))),
        _ => texts(kind, &charset.text(bytes)),
    }
}

fn chunks<const N: usize>(bytes: &[u8], value: impl Fn([u8; N]) -> Value) -> Vec<Value> {
    bytes.as_chunks::<N>().0.iter().map(|chunk| value(*chunk)).collect()
}

/// A number; what is none is told in words, as the standard has it.
fn float(number: f64) -> Value {
    match Number::from_f64(number) {
        Some(number) => number.into(),
        None if number.is_nan() => "NaN".into(),
        None if number > 0.0 => "inf".into(),
        None => "-inf".into(),
    }
}

fn texts(kind: &str, text: &str) -> Vec<Value> {
    let text = text.trim_end_matches([' ', '\0']);
    if text.is_empty() {
        return Vec::new();
    }
    // A backslash is a letter in these.
    if matches!(kind, "LT" | "ST" | "UT" | "UR") {
        return vec![text.into()];
    }
    text.split('\\').map(|value| one_text(kind, value.trim_matches(' '))).collect()
}

fn one_text(kind: &str, text: &str) -> Value {
    match kind {
        _ if text.is_empty() => Value::Null,
        "PN" => name(text),
        "IS" => text.parse::<i64>().map_or_else(|_| text.into(), Value::from),
        "DS" => text.parse::<f64>().ok().and_then(Number::from_f64).map_or_else(|| text.into(), Value::from),
        _ => text.into(),
    }
}

/// A name by the ways to write it, which an equals sign parts.
fn name(text: &str) -> Value {
    let groups = ["Alphabetic", "Ideographic", "Phonetic"].into_iter().zip(text.split('='));
    let written = groups.filter(|(_, group)| !group.is_empty());
    Value::Object(written.map(|(group, text)| (group.to_owned(), text.into())).collect::<Map<_, _>>())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values_are_what_the_standard_makes_of_their_kinds() {
        let latin1 = Charset::of(b"ISO_IR 100");
        for (kind, bytes, expected) in [
            (
                "PN",
                &b"M\xfcller^J=\xfc=p "[..],
                json!([{"Alphabetic": "Müller^J", "Ideographic": "ü", "Phonetic": "p"}]),
            ),
            ("PN", b"=a", json!([{"Ideographic": "a"}])),
            ("CS", b"A\\\\B ", json!(["A", null, "B"])),
            ("UI", b"1.2.3\0", json!(["1.2.3"])),
            ("IS", b"12\\ -3 ", json!([12, -3])),
            ("DS", b"0.300000\\x ", json!([0.3, "x"])),
            ("ST", b" a\\b ", json!([" a\\b"])),
            ("US", b"\x01\x02\xff\xff", json!([513, 65535])),
            ("FD", &f64::NAN.to_le_bytes(), json!(["NaN"])),
            ("FL", &(-f32::INFINITY).to_le_bytes(), json!(["-inf"])),
            ("AT", b"\x10\x00\x20\x00", json!(["00100020"])),
            ("LO", b"  ", json!([])),
        ] {
            assert_eq!(Value::from(values(kind, bytes, latin1)), expected, "{kind}");
        }
    }
}
