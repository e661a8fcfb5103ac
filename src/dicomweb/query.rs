//! A search: what is looked for, by which keys, and what of it is told (QIDO-RS, PS3.18 section 10.6).

use std::collections::BTreeSet;

use super::entries::{AVAILABILITY, CLASS, Entry, INSTANCE, Level, MODALITIES, RETRIEVE_URL, SERIES, STUDY, Told};
use super::entries::{by_name, entries, level_of, tag_of};
use super::json::{Attributes, attribute, key};
use super::matching::Matcher;
use crate::formats::dicom_elements::Tag;

/// Names that a note tells, and letters of each: it stands in a header.
const MAX_NAMES: usize = 8;
const MAX_NAME: usize = 64;
/// What is told of a search that asked for names that only sound alike; the words are the standard's.
const LITERAL: &str = "The fuzzymatching parameter is not supported. Only literal matching has been performed.";
/// Character set of the texts; in JSON it is one for all.
const CHARACTER_SET: Tag = Tag(0x0008_0005);

/// Why a query is none.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{name} is not {wanted}")]
pub struct QueryError {
    /// The parameter, by a name that is known here.
    pub name: &'static str,
    /// What it should be.
    pub wanted: &'static str,
}

/// A search.
#[derive(Clone, Debug, PartialEq)]
pub struct Query {
    level: Level,
    keys: Vec<(&'static Entry, Matcher)>,
    fields: BTreeSet<Tag>,
    has_all_fields: bool,
    /// Results wanted at the most.
    pub limit: Option<usize>,
    /// Results that are passed over.
    pub offset: usize,
    notes: Vec<String>,
}

impl Query {
    /// Reads the parameters of a search for studies, series or instances. What is not known is passed over, with a
    /// note.
    ///
    /// # Errors
    /// When a parameter is malformed or given twice.
    pub fn parse(level: Level, parameters: &[(String, String)]) -> Result<Self, QueryError> {
        let mut query = Self {
            level,
            keys: Vec::new(),
            fields: BTreeSet::new(),
            has_all_fields: false,
            limit: None,
            offset: 0,
            notes: Vec::new(),
        };
        let (mut ignored, mut offset) = (Vec::new(), None);
        for (name, value) in parameters {
            match name.as_str() {
                "limit" => set_count("limit", value, &mut query.limit)?,
                "offset" => set_count("offset", value, &mut offset)?,
                "fuzzymatching" => match value.as_str() {
                    "true" => query.notes.push(LITERAL.to_owned()),
                    "false" => {}
                    _ => return Err(QueryError { name: "fuzzymatching", wanted: "true or false" }),
                },
                "includefield" => query.include(value, &mut ignored),
                // Of how the answer is written.
                "accept" => {}
                _ => query.add_key(name, value, &mut ignored)?,
            }
        }
        query.offset = offset.unwrap_or(0);
        if !ignored.is_empty() {
            query.notes.push(told(&ignored));
        }
        Ok(query)
    }

    fn include<'a>(&mut self, fields: &'a str, ignored: &mut Vec<&'a str>) {
        for field in fields.split(',').map(str::trim).filter(|field| !field.is_empty()) {
            match by_name(field).map(|entry| entry.tag).or_else(|| tag_of(field)) {
                _ if field == "all" => self.has_all_fields = true,
                Some(tag) => drop(self.fields.insert(tag)),
                None => ignored.push(field),
            }
        }
    }

    fn add_key<'a>(&mut self, name: &'a str, value: &str, ignored: &mut Vec<&'a str>) -> Result<(), QueryError> {
        // Of a series, those of its study are not known.
        let is_known = |entry: &&Entry| entry.tag != MODALITIES || self.level == Level::Study;
        let entry = by_name(name).filter(|entry| entry.is_key && entry.level <= self.level).filter(is_known);
        let Some(entry) = entry else {
            ignored.push(name);
            return Ok(());
        };
        if self.keys.iter().any(|(other, _)| other.tag == entry.tag) {
            return Err(QueryError { name: entry.keyword, wanted: "given once" });
        }
        let matcher = Matcher::of(entry, value).map_err(|wanted| QueryError { name: entry.keyword, wanted })?;
        self.keys.push((entry, matcher));
        Ok(())
    }

    /// What is looked for.
    #[must_use]
    pub fn level(&self) -> Level {
        self.level
    }

    /// What whoever asks should know of the search, in ASCII.
    #[must_use]
    pub fn notes(&self) -> &[String] {
        &self.notes
    }

    /// The identifiers at this tag that are looked for; `None` where any will do.
    #[must_use]
    pub fn uids(&self, tag: Tag) -> Option<&[String]> {
        self.keys.iter().find_map(|(entry, matcher)| match matcher {
            Matcher::Uids(uids) if entry.tag == tag => Some(uids.as_slice()),
            _ => None,
        })
    }

    /// Whether identifiers alone say what is found.
    #[must_use]
    pub fn is_of_uids_alone(&self) -> bool {
        let is_of_uids = |(entry, matcher): &(&Entry, Matcher)| {
            *matcher == Matcher::Any || [STUDY, SERIES, INSTANCE, CLASS].contains(&entry.tag)
        };
        self.keys.iter().all(is_of_uids)
    }

    /// Whether attributes match all keys.
    #[must_use]
    pub fn fits(&self, attributes: &Attributes) -> bool {
        self.keys.iter().all(|(entry, matcher)| matcher.fits(attributes.get(&key(entry.tag))))
    }

    /// What of the attributes of a result is told, where whoever asks has named the study or the series that it is of
    /// (`given`).
    #[must_use]
    pub fn select(&self, mut attributes: Attributes, given: Option<Level>) -> Attributes {
        let mut told = Attributes::new();
        for entry in entries().filter(|entry| entry.level <= self.level) {
            let found = attributes.remove(&key(entry.tag));
            if !self.wants(entry, given) {
                continue;
            }
            match found {
                Some(found) => drop(told.insert(key(entry.tag), found)),
                None if entry.told == Told::Always => {
                    told.insert(key(entry.tag), attribute(entry.kind, Vec::new()));
                }
                None => {}
            }
        }
        for (name, found) in attributes {
            let Some(tag) = tag_of(&name) else { continue };
            let is_asked = self.has_all_fields || self.fields.contains(&tag);
            if tag == CHARACTER_SET || (is_asked && level_of(tag) <= self.level) {
                told.insert(name, found);
            }
        }
        told
    }

    fn wants(&self, entry: &Entry, given: Option<Level>) -> bool {
        let is_new = given.is_none_or(|given| entry.level > given) && entry.told != Told::WhenAsked;
        let is_asked = self.has_all_fields || self.fields.contains(&entry.tag);
        let is_key = self.keys.iter().any(|(key, _)| key.tag == entry.tag);
        is_new || is_asked || is_key || [STUDY, SERIES, INSTANCE, AVAILABILITY, RETRIEVE_URL].contains(&entry.tag)
    }
}

fn set_count(name: &'static str, text: &str, count: &mut Option<usize>) -> Result<(), QueryError> {
    let is_number = text.bytes().all(|byte| byte.is_ascii_digit());
    match text.parse() {
        Ok(number) if is_number && count.is_none() => {
            *count = Some(number);
            Ok(())
        }
        _ => Err(QueryError { name, wanted: "a whole number, given once" }),
    }
}

/// Names that were passed over. Those that are no names of attributes are not repeated.
fn told(names: &[&str]) -> String {
    let is_name = |name: &str| name.len() <= MAX_NAME && name.bytes().all(|byte| byte.is_ascii_alphanumeric());
    let told: Vec<&str> = names.iter().copied().filter(|name| is_name(name)).take(MAX_NAMES).collect();
    let more = if told.len() < names.len() { " and others" } else { "" };
    format!("These attributes are not known to this search and were ignored: {}{more}", told.join(", "))
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    fn parse(level: Level, text: &str) -> Result<Query, QueryError> {
        let parameters: Vec<(String, String)> = form_urlencoded::parse(text.as_bytes()).into_owned().collect();
        Query::parse(level, &parameters)
    }

    fn object() -> Attributes {
        let attributes = [
            ("00080005", json!({"vr": "CS", "Value": ["ISO_IR 192"]})),
            ("00080060", json!({"vr": "CS", "Value": ["SR"]})),
            ("00100020", json!({"vr": "LO", "Value": ["7"]})),
            ("00181020", json!({"vr": "LO", "Value": ["0.1.0"]})),
            ("0020000D", json!({"vr": "UI", "Value": ["1.2"]})),
            ("0020000E", json!({"vr": "UI", "Value": ["1.3"]})),
            ("0040A040", json!({"vr": "CS", "Value": ["CONTAINER"]})),
        ];
        attributes.into_iter().map(|(tag, value)| (tag.to_owned(), value)).collect()
    }

    #[test]
    fn what_is_not_known_is_passed_over_with_a_note() {
        let query = parse(Level::Study, "BodyPartExamined=LIVER&Modality=SR&a%0d%0ab=1&includefield=Nothing").unwrap();
        assert!(query.keys.is_empty());
        let note = "These attributes are not known to this search and were ignored: BodyPartExamined, Modality, \
                    Nothing and others";
        assert_eq!(query.notes(), [note]);
        assert_eq!(parse(Level::Study, "fuzzymatching=true").unwrap().notes(), [LITERAL]);
        assert!(parse(Level::Study, "ModalitiesInStudy=SR").unwrap().notes().is_empty());
        let note = "These attributes are not known to this search and were ignored: ModalitiesInStudy";
        assert_eq!(parse(Level::Series, "ModalitiesInStudy=SR").unwrap().notes(), [note]);
    }

    #[test]
    fn what_is_malformed_is_refused_by_its_name() {
        for (text, name) in [
            ("limit=-1", "limit"),
            ("limit=+1", "limit"),
            ("limit=1&limit=2", "limit"),
            ("offset=x", "offset"),
            ("fuzzymatching=yes", "fuzzymatching"),
            ("StudyDate=x", "StudyDate"),
            ("PatientID=1&00100020=2", "PatientID"),
        ] {
            assert_eq!(parse(Level::Study, text).unwrap_err().name, name, "{text}");
        }
    }

    #[test]
    fn what_is_told_follows_from_the_level_and_from_what_is_asked_for() {
        let tags = |level, text: &str, given| -> Vec<String> {
            parse(level, text).unwrap().select(object(), given).into_keys().collect()
        };
        let study = tags(Level::Study, "", None);
        assert!(["00080020", "00100020", "0020000D", "00080005"].iter().all(|tag| study.iter().any(|own| own == tag)));
        assert!(!study.contains(&"00080060".to_owned()) && !study.contains(&"0020000E".to_owned()));
        let series = tags(Level::Series, "", Some(Level::Study));
        assert_eq!(series, ["00080005", "00080060", "0020000D", "0020000E", "00200011"]);
        assert!(tags(Level::Series, "", None).contains(&"00100020".to_owned()));
        let asked = tags(Level::Series, "includefield=SoftwareVersions,0040A040&PatientID=7", Some(Level::Study));
        assert!(asked.contains(&"00181020".to_owned()) && asked.contains(&"00100020".to_owned()));
        assert!(!asked.contains(&"0040A040".to_owned()), "an attribute of instances");
        assert!(tags(Level::Instance, "includefield=all", None).contains(&"0040A040".to_owned()));
    }
}
