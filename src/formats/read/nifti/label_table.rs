//! Names and colours of labels, from the XML that Connectome Workbench and TotalSegmentator write:
//!
//! ```xml
//! <LabelTable><Label Key="11" Red="0.48" Green="0.73" Blue="0.86" Alpha="1">caudate</Label></LabelTable>
//! ```
//!
//! anywhere in a document. What comes is foreign: a document is taken whole or not at all, nothing it refers to
//! is followed, and nothing it defines is expanded.

use std::collections::BTreeMap;

use quick_xml::Reader;
use quick_xml::escape::resolve_xml_entity;
use quick_xml::events::{BytesRef, BytesStart, Event};

use crate::space::Label;

/// Elements within elements: real documents have four.
const MAX_DEPTH: usize = 64;
/// Attributes of a label: real ones have five. They are compared with each other.
const MAX_ATTRIBUTES: usize = 16;
/// Characters of a name, trimmed.
const MAX_NAME_CHARS: usize = 80;
/// As many as a volume can have.
const MAX_LABELS: usize = u16::MAX as usize;

/// What a file says of its labels.
#[derive(Debug, Default, PartialEq)]
pub(super) struct LabelTable {
    /// By value, without the background.
    pub labels: BTreeMap<i64, Label>,
}

/// Why a table is passed over. Holds numbers only, as errors do.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub(super) enum TableFault {
    #[error("the list of header extensions is damaged")]
    BrokenList,
    #[error("their document is too large")]
    TooLarge,
    #[error("their text is not UTF-8")]
    NotUtf8,
    #[error("their XML has a document type declaration")]
    DocumentType,
    #[error("their XML uses an entity that XML does not have")]
    OwnEntity,
    #[error("their XML is malformed near byte {at}")]
    Malformed { at: u64 },
    #[error("their XML ends early")]
    EndsEarly,
    #[error("their XML is nested more than {MAX_DEPTH} deep")]
    TooDeep,
    #[error("an entry near byte {at} has no whole number as its key")]
    BadKey { at: u64 },
    #[error("the colour of label {key} is none")]
    BadColor { key: i64 },
    #[error("the name of label {key} has control characters or more than {MAX_NAME_CHARS}")]
    BadName { key: i64 },
    #[error("label {key} has two names")]
    TwoNames { key: i64 },
    #[error("there are more than {MAX_LABELS} labels")]
    TooManyLabels,
}

impl LabelTable {
    /// From a document; zeros after it are padding. Of several tables the first one counts, as does the first of
    /// equal entries.
    ///
    /// # Errors
    /// When anything about the document or the table is not as it should be.
    pub fn parse(document: &[u8]) -> Result<Self, TableFault> {
        let padding = document.iter().rev().take_while(|byte| **byte == 0).count();
        let text = std::str::from_utf8(&document[..document.len() - padding]).map_err(|_| TableFault::NotUtf8)?;
        let mut reader = Reader::from_str(text.trim_start_matches('\u{feff}'));
        let mut walk = Walk::default();
        loop {
            let event = reader.read_event();
            let at = reader.buffer_position();
            match event.map_err(|_| TableFault::Malformed { at })? {
                Event::Start(element) => walk.start(&element, at)?,
                Event::Empty(element) => walk.start(&element, at).and_then(|()| walk.end())?,
                Event::End(_) => walk.end()?,
                Event::Text(text) => walk.text(&text.xml10_content()),
                Event::CData(text) => walk.text(&text.xml10_content()),
                Event::GeneralRef(entity) => walk.entity(&entity, at)?,
                Event::DocType(_) => return Err(TableFault::DocumentType),
                Event::Comment(_) | Event::Decl(_) | Event::PI(_) => {}
                Event::Eof => return walk.finish(),
            }
        }
    }
}

/// An entry as it stands.
#[derive(Debug)]
struct Entry {
    key: i64,
    name: String,
    color: Option<[f64; 3]>,
}

/// Where in a document the table is.
#[derive(Debug, Default, PartialEq)]
enum Place {
    #[default]
    Before,
    /// Within it; its element has that depth.
    Within(usize),
    After,
}

/// What is known half way through a document.
#[derive(Debug, Default)]
struct Walk {
    depth: usize,
    place: Place,
    /// The entry whose end has not come.
    open: Option<Entry>,
    entries: BTreeMap<i64, Entry>,
}

impl Walk {
    fn start(&mut self, element: &BytesStart<'_>, at: u64) -> Result<(), TableFault> {
        self.depth += 1;
        if self.depth > MAX_DEPTH {
            return Err(TableFault::TooDeep);
        }
        if self.open.is_some() {
            return Err(TableFault::Malformed { at });
        }
        match (element.name().into_inner(), &self.place) {
            ("LabelTable", Place::Before) => self.place = Place::Within(self.depth),
            ("Label", Place::Within(table)) if self.depth == table + 1 => self.open = Some(entry(element, at)?),
            _ => {}
        }
        Ok(())
    }

    fn end(&mut self) -> Result<(), TableFault> {
        if let Some(entry) = self.open.take() {
            self.add(entry)?;
        }
        if self.place == Place::Within(self.depth) {
            self.place = Place::After;
        }
        self.depth -= 1;
        Ok(())
    }

    fn text(&mut self, text: &str) {
        if let Some(entry) = &mut self.open {
            entry.name.push_str(text);
        }
    }

    /// The five that XML has, and characters by number. There are no others: who defines one is refused before.
    fn entity(&mut self, entity: &BytesRef<'_>, at: u64) -> Result<(), TableFault> {
        match entity.resolve_char_ref().map_err(|_| TableFault::Malformed { at })? {
            Some(character) => self.text(character.encode_utf8(&mut [0; 4])),
            None => self.text(resolve_xml_entity(entity).ok_or(TableFault::OwnEntity)?),
        }
        Ok(())
    }

    fn add(&mut self, entry: Entry) -> Result<(), TableFault> {
        let Entry { key, name, color } = entry;
        if key == 0 {
            return Ok(());
        }
        let name = name.trim();
        if name.chars().count() > MAX_NAME_CHARS || name.chars().any(char::is_control) {
            return Err(TableFault::BadName { key });
        }
        match self.entries.get(&key) {
            Some(first) if first.name != name => return Err(TableFault::TwoNames { key }),
            Some(_) => return Ok(()),
            None if self.entries.len() == MAX_LABELS => return Err(TableFault::TooManyLabels),
            None => {}
        }
        self.entries.insert(key, Entry { key, name: name.to_owned(), color });
        Ok(())
    }

    fn finish(self) -> Result<LabelTable, TableFault> {
        if self.depth > 0 {
            return Err(TableFault::EndsEarly);
        }
        // Workbench writes shares, others bytes. One component does not tell which: 1 is in both.
        let are_bytes = self.entries.values().filter_map(|entry| entry.color).flatten().any(|part| part > 1.0);
        let scale = if are_bytes { 1.0 } else { 255.0 };
        let mut labels = BTreeMap::new();
        for (value, entry) in self.entries {
            let name = Some(entry.name).filter(|name| !name.is_empty());
            let color = entry.color.map(|parts| parts.map(|part| byte(part * scale)));
            labels.insert(value, Label { value, name, color, code: None });
        }
        Ok(LabelTable { labels })
    }
}

/// The attributes of an entry.
fn entry(element: &BytesStart<'_>, at: u64) -> Result<Entry, TableFault> {
    let (mut key, mut parts) = (None, [None; 3]);
    for (n, attribute) in element.attributes().enumerate() {
        let attribute = attribute.map_err(|_| TableFault::Malformed { at })?;
        if n == MAX_ATTRIBUTES {
            return Err(TableFault::Malformed { at });
        }
        let value = attribute.value.trim();
        match attribute.key.into_inner() {
            "Key" => key = value.parse::<i64>().ok(),
            "Red" => parts[0] = Some(part(value)),
            "Green" => parts[1] = Some(part(value)),
            "Blue" => parts[2] = Some(part(value)),
            _ => {}
        }
    }
    let key = key.ok_or(TableFault::BadKey { at })?;
    let color = match parts {
        [None, None, None] => None,
        [Some(Some(red)), Some(Some(green)), Some(Some(blue))] => Some([red, green, blue]),
        _ => return Err(TableFault::BadColor { key }),
    };
    Ok(Entry { key, name: String::new(), color })
}

/// A component of a colour, as a share or as a byte.
fn part(value: &str) -> Option<f64> {
    value.parse().ok().filter(|part| (0.0..=255.0).contains(part))
}

#[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "between 0 and 255, and rounded")]
fn byte(part: f64) -> u8 {
    part.round() as u8
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Within what Workbench writes round a table.
    fn caret(labels: &str) -> String {
        format!(
            "<?xml version=\"1.0\" encoding=\"UTF-8\"?> <CaretExtension> <Date><![CDATA[2013-07-14T05:45:09]]></Date> \
             <VolumeInformation Index=\"0\"> <LabelTable>\n{labels}</LabelTable> <StudyMetaDataLinkSet/> \
             <VolumeType><![CDATA[Label]]></VolumeType> </VolumeInformation></CaretExtension>"
        )
    }

    fn told(value: i64, name: &str, color: [u8; 3]) -> (i64, Label) {
        (value, Label { value, name: Some(name.to_owned()), color: Some(color), code: None })
    }

    #[track_caller]
    fn check(labels: &str, expected: &[(i64, Label)]) {
        let table = LabelTable::parse(caret(labels).as_bytes()).unwrap();
        assert_eq!(table.labels, expected.iter().cloned().collect());
    }

    #[track_caller]
    fn check_fault(labels: &str, fault: TableFault) {
        assert_eq!(LabelTable::parse(caret(labels).as_bytes()), Err(fault));
    }

    #[track_caller]
    fn check_malformed(document: &str) {
        let parsed = LabelTable::parse(document.as_bytes());
        assert!(matches!(parsed, Err(TableFault::Malformed { .. } | TableFault::EndsEarly)), "{parsed:?}");
    }

    #[test]
    fn names_and_colours_are_read() {
        check(
            "<Label Key=\"0\" Red=\"1\" Green=\"1\" Blue=\"1\" Alpha=\"0\">???</Label>\n\
             <Label Key=\"1\" Red=\"0.2\" Green=\"1\" Blue=\"0\" Alpha=\"1\"><![CDATA[spleen]]></Label>\n\
             <Label Key='-7' Red='0' Green='0.5' Blue='1'>\n  left &amp; right&#32;&lt;r&#xe9;n&gt;\t</Label>",
            &[told(1, "spleen", [51, 255, 0]), told(-7, "left & right <rén>", [0, 128, 255])],
        );
    }

    #[test]
    fn colours_above_one_are_bytes_in_the_whole_table() {
        check(
            "<Label Key=\"1\" Red=\"1\" Green=\"0\" Blue=\"1\">a</Label>\
             <Label Key=\"2\" Red=\"255\" Green=\"7\" Blue=\"0\">b</Label>",
            &[told(1, "a", [1, 0, 1]), told(2, "b", [255, 7, 0])],
        );
    }

    #[test]
    fn a_label_may_have_neither_name_nor_colour() {
        check("<Label Key=\"3\"/><Label Key=\"4\"> </Label>", &[(3, Label::new(3)), (4, Label::new(4))]);
    }

    #[test]
    fn a_name_may_be_given_twice_but_not_two_names() {
        let twice = "<Label Key=\"3\" Red=\"0\" Green=\"0\" Blue=\"0\">a</Label><Label Key=\"3\">a</Label>";
        check(twice, &[told(3, "a", [0; 3])]);
        check_fault("<Label Key=\"3\">a</Label><Label Key=\"3\">b</Label>", TableFault::TwoNames { key: 3 });
    }

    #[test]
    fn only_the_first_table_counts_and_only_labels_within_it() {
        let document = "<a><Label Key=\"1\">no</Label><LabelTable><Other><Label Key=\"2\">no</Label></Other>\
                        <Label Key=\"3\">yes</Label></LabelTable>\
                        <LabelTable><Label Key=\"4\">no</Label></LabelTable></a>";
        let table = LabelTable::parse(document.as_bytes()).unwrap();
        assert_eq!(table.labels.into_keys().collect::<Vec<_>>(), [3]);
    }

    #[test]
    fn keys_and_colours_must_be_numbers() {
        for key in ["", "Key=\"\"", "Key=\"1.5\"", "Key=\"99999999999999999999\"", "Key=\"&one;\""] {
            let parsed = LabelTable::parse(caret(&format!("<Label {key}>a</Label>")).as_bytes());
            assert!(matches!(parsed, Err(TableFault::BadKey { .. })), "{key}: {parsed:?}");
        }
        for red in ["", "Red=\"\"", "Red=\"red\"", "Red=\"NaN\"", "Red=\"inf\"", "Red=\"-1\"", "Red=\"256\""] {
            let label = format!("<Label Key=\"5\" {red} Green=\"0\" Blue=\"0\">a</Label>");
            check_fault(&label, TableFault::BadColor { key: 5 });
        }
    }

    #[test]
    fn names_are_short_and_plain() {
        let named = |name: &str| format!("<Label Key=\"5\">{name}</Label>");
        check(
            &named(&format!("  {}\n", "é".repeat(80))),
            &[(5, Label { name: Some("é".repeat(80)), ..Label::new(5) })],
        );
        for name in [&"é".repeat(81), "a\nb", "a\u{1b}[31m", "a&#9;b", "a\u{0}b"] {
            check_fault(&named(name), TableFault::BadName { key: 5 });
        }
    }

    #[test]
    fn a_volume_has_no_more_labels_than_are_taken() {
        let labels = |count: usize| (1..=count).map(|n| format!("<Label Key=\"{n}\"/>")).collect::<String>();
        assert_eq!(LabelTable::parse(caret(&labels(MAX_LABELS)).as_bytes()).unwrap().labels.len(), MAX_LABELS);
        check_fault(&labels(MAX_LABELS + 1), TableFault::TooManyLabels);
    }

    #[test]
    fn entities_that_grow_are_refused_where_they_are_declared() {
        let laughs: String =
            (1..10).map(|n| format!("<!ENTITY l{n} \"{}\">", format!("&l{};", n - 1).repeat(10))).collect();
        let document = format!(
            "<!DOCTYPE LabelTable [<!ENTITY l0 \"ha\">{laughs}]><LabelTable><Label Key=\"1\">&l9;</Label></LabelTable>"
        );
        assert_eq!(LabelTable::parse(document.as_bytes()), Err(TableFault::DocumentType));
    }

    #[test]
    fn nothing_outside_of_the_document_is_asked_for() {
        for declaration in [
            "<!DOCTYPE a [<!ENTITY x SYSTEM \"file:///etc/passwd\">]>",
            "<!DOCTYPE a SYSTEM \"http://127.0.0.1/a.dtd\">",
            "<!doctype a>",
        ] {
            let document = format!("{declaration}<LabelTable><Label Key=\"1\">&x;</Label></LabelTable>");
            assert_eq!(LabelTable::parse(document.as_bytes()), Err(TableFault::DocumentType), "{declaration}");
        }
        check_fault("<Label Key=\"1\">&x;</Label>", TableFault::OwnEntity);
        check_fault("&nbsp;", TableFault::OwnEntity);
    }

    #[test]
    fn depth_is_bounded() {
        let nested = |depth: usize| format!("{}<LabelTable/>{}", "<a>".repeat(depth - 1), "</a>".repeat(depth - 1));
        assert_eq!(LabelTable::parse(nested(64).as_bytes()), Ok(LabelTable::default()));
        for depth in [65, 200_000] {
            assert_eq!(LabelTable::parse(nested(depth).as_bytes()), Err(TableFault::TooDeep));
        }
        assert_eq!(LabelTable::parse("<LabelTable>".repeat(300_000).as_bytes()), Err(TableFault::TooDeep));
    }

    #[test]
    fn a_document_cut_anywhere_is_refused() {
        let whole = caret("<Label Key=\"1\" Red=\"1\" Green=\"0\" Blue=\"0\">a&amp;b</Label>");
        let first = whole.find("<Caret").unwrap() + 1;
        for end in first..whole.len() {
            check_malformed(&whole[..end]);
        }
    }

    #[test]
    fn malformed_xml_is_refused() {
        for labels in [
            "<Label Key=\"1\">a</LabelTable>",
            "</a>",
            "<Label Key=\"1\" Key=\"2\">a</Label>",
            "<Label Key=1>a</Label>",
            "<Label Key=\"1\"><b>a</b></Label>",
            "<Label Key=\"1\">&#0;</Label>",
            "<Label Key=\"1\">&amp</Label>",
            "<![CDATA[",
        ] {
            check_malformed(&caret(labels));
        }
    }

    #[test]
    fn attributes_without_end_are_refused_in_no_time() {
        let many: String = (0..200_000).map(|n| format!(" a{n}=\"\"")).collect();
        check_malformed(&caret(&format!("<Label{many}/>")));
    }

    #[test]
    fn text_must_be_utf_8_and_may_be_padded() {
        let table = caret("<Label Key=\"1\">caud\u{e9}</Label>");
        let latin_1: Vec<u8> = table.chars().map(|c| u8::try_from(u32::from(c)).unwrap()).collect();
        assert_eq!(LabelTable::parse(&latin_1), Err(TableFault::NotUtf8));
        let utf_16: Vec<u8> = table.encode_utf16().flat_map(u16::to_le_bytes).collect();
        assert!(LabelTable::parse(&utf_16).is_err());
        for padded in [format!("{table}\0\0\0"), format!("\u{feff}{table}\n")] {
            assert_eq!(LabelTable::parse(padded.as_bytes()).unwrap().labels.len(), 1);
        }
    }
}
