//! The attributes that searches know by name: what they answer with, and what they are matched by (PS3.18 section
//! 10.6.1.2).

use crate::formats::dicom_elements::Tag;

/// What is searched for.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Level {
    /// Studies.
    Study,
    /// Series.
    Series,
    /// Instances.
    Instance,
}

/// When an attribute stands in an answer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Told {
    /// Always, without a value where it has none.
    Always,
    /// Where the object has it.
    WherePresent,
    /// Where it is asked for.
    WhenAsked,
}

/// An attribute.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Entry {
    /// Its tag.
    pub tag: Tag,
    /// Its keyword.
    pub keyword: &'static str,
    /// The kind of its values (VR).
    pub kind: &'static str,
    /// What it is an attribute of.
    pub level: Level,
    /// When it is told.
    pub told: Told,
    /// Whether objects are found by it.
    pub is_key: bool,
}

/// Identifiers of studies, series, instances and their class.
pub const STUDY: Tag = Tag(0x0020_000d);
/// Of series.
pub const SERIES: Tag = Tag(0x0020_000e);
/// Of instances.
pub const INSTANCE: Tag = Tag(0x0008_0018);
/// Of what instances are.
pub const CLASS: Tag = Tag(0x0008_0016);
/// How the object was made: SR, DOC.
pub const MODALITY: Tag = Tag(0x0008_0060);
/// All modalities of a study.
pub const MODALITIES: Tag = Tag(0x0008_0061);
/// Content Sequence: all that a report tells.
pub const CONTENT: Tag = Tag(0x0040_a730);
/// Whether an instance can be had at once.
pub const AVAILABILITY: Tag = Tag(0x0008_0056);
/// Where it can be had.
pub const RETRIEVE_URL: Tag = Tag(0x0008_1190);
/// Series of a study.
pub const SERIES_OF_STUDY: Tag = Tag(0x0020_1206);
/// Instances of a study.
pub const INSTANCES_OF_STUDY: Tag = Tag(0x0020_1208);
/// Instances of a series.
pub const INSTANCES_OF_SERIES: Tag = Tag(0x0020_1209);

/// All of them, in the order of their tags within each level.
const ENTRIES: [Entry; 45] = [
    study(0x0008_0020, "StudyDate", "DA"),
    study(0x0008_0030, "StudyTime", "TM"),
    study(0x0008_0050, "AccessionNumber", "SH"),
    made(AVAILABILITY, "InstanceAvailability", "CS", Level::Study),
    Entry { is_key: true, ..made(MODALITIES, "ModalitiesInStudy", "CS", Level::Study) },
    study(0x0008_0090, "ReferringPhysicianName", "PN"),
    present(0x0008_0201, "TimezoneOffsetFromUTC", "SH", Level::Study),
    made(RETRIEVE_URL, "RetrieveURL", "UR", Level::Study),
    study(0x0010_0010, "PatientName", "PN"),
    study(0x0010_0020, "PatientID", "LO"),
    asked(0x0010_0021, "IssuerOfPatientID", "LO", Level::Study),
    study(0x0010_0030, "PatientBirthDate", "DA"),
    study(0x0010_0040, "PatientSex", "CS"),
    study(STUDY.0, "StudyInstanceUID", "UI"),
    study(0x0020_0010, "StudyID", "SH"),
    made(SERIES_OF_STUDY, "NumberOfStudyRelatedSeries", "IS", Level::Study),
    made(INSTANCES_OF_STUDY, "NumberOfStudyRelatedInstances", "IS", Level::Study),
    asked(0x0008_0021, "SeriesDate", "DA", Level::Series),
    asked(0x0008_0031, "SeriesTime", "TM", Level::Series),
    always(MODALITY.0, "Modality", "CS", Level::Series),
    asked(0x0008_0070, "Manufacturer", "LO", Level::Series),
    Entry { told: Told::WherePresent, ..asked(0x0008_103e, "SeriesDescription", "LO", Level::Series) },
    asked(0x0008_1090, "ManufacturerModelName", "LO", Level::Series),
    asked(0x0018_1000, "DeviceSerialNumber", "LO", Level::Series),
    asked(0x0018_1020, "SoftwareVersions", "LO", Level::Series),
    always(SERIES.0, "SeriesInstanceUID", "UI", Level::Series),
    always(0x0020_0011, "SeriesNumber", "IS", Level::Series),
    asked(0x0020_0052, "FrameOfReferenceUID", "UI", Level::Series),
    made(INSTANCES_OF_SERIES, "NumberOfSeriesRelatedInstances", "IS", Level::Series),
    asked(0x0008_0012, "InstanceCreationDate", "DA", Level::Instance),
    asked(0x0008_0013, "InstanceCreationTime", "TM", Level::Instance),
    always(CLASS.0, "SOPClassUID", "UI", Level::Instance),
    always(INSTANCE.0, "SOPInstanceUID", "UI", Level::Instance),
    asked(0x0008_0023, "ContentDate", "DA", Level::Instance),
    asked(0x0008_0033, "ContentTime", "TM", Level::Instance),
    asked(0x0008_0064, "ConversionType", "CS", Level::Instance),
    always(0x0020_0013, "InstanceNumber", "IS", Level::Instance),
    present(0x0028_0008, "NumberOfFrames", "IS", Level::Instance),
    present(0x0028_0010, "Rows", "US", Level::Instance),
    present(0x0028_0011, "Columns", "US", Level::Instance),
    present(0x0028_0100, "BitsAllocated", "US", Level::Instance),
    asked(0x0028_0301, "BurnedInAnnotation", "CS", Level::Instance),
    asked(0x0040_a491, "CompletionFlag", "CS", Level::Instance),
    asked(0x0040_a493, "VerificationFlag", "CS", Level::Instance),
    asked(0x0042_0010, "DocumentTitle", "ST", Level::Instance),
];

const fn always(tag: u32, keyword: &'static str, kind: &'static str, level: Level) -> Entry {
    Entry { tag: Tag(tag), keyword, kind, level, told: Told::Always, is_key: true }
}

const fn study(tag: u32, keyword: &'static str, kind: &'static str) -> Entry {
    always(tag, keyword, kind, Level::Study)
}

const fn asked(tag: u32, keyword: &'static str, kind: &'static str, level: Level) -> Entry {
    Entry { told: Told::WhenAsked, ..always(tag, keyword, kind, level) }
}

const fn present(tag: u32, keyword: &'static str, kind: &'static str, level: Level) -> Entry {
    Entry { told: Told::WherePresent, is_key: false, ..always(tag, keyword, kind, level) }
}

/// What no object says of itself.
const fn made(tag: Tag, keyword: &'static str, kind: &'static str, level: Level) -> Entry {
    Entry { told: Told::WherePresent, is_key: false, ..always(tag.0, keyword, kind, level) }
}

/// All of them.
pub fn entries() -> impl Iterator<Item = &'static Entry> {
    const ALL: &[Entry] = &ENTRIES;
    ALL.iter()
}

/// The entry of a keyword, or of a tag in eight hexadecimal digits.
#[must_use]
pub fn by_name(name: &str) -> Option<&'static Entry> {
    let tag = tag_of(name);
    entries().find(|entry| entry.keyword == name || Some(entry.tag) == tag)
}

/// A tag in eight hexadecimal digits.
#[must_use]
pub fn tag_of(text: &str) -> Option<Tag> {
    let is_tag = text.len() == 8 && text.bytes().all(|byte| byte.is_ascii_hexdigit());
    if is_tag { u32::from_str_radix(text, 16).ok().map(Tag) } else { None }
}

/// What an attribute is one of; those that are not known are of instances.
#[must_use]
pub fn level_of(tag: Tag) -> Level {
    entries().find(|entry| entry.tag == tag).map_or(Level::Instance, |entry| entry.level)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn no_attribute_stands_there_twice() {
        let mut tags: Vec<Tag> = entries().map(|entry| entry.tag).collect();
        tags.sort_unstable();
        tags.dedup();
        assert_eq!(tags.len(), ENTRIES.len());
    }

    #[test]
    fn attributes_have_two_names() {
        assert_eq!(by_name("PatientID"), by_name("00100020"));
        assert_eq!(by_name("0020000d").map(|entry| entry.keyword), Some("StudyInstanceUID"));
        assert_eq!([by_name("patientid"), by_name("0010002"), by_name("+0100020")], [None; 3]);
    }
}
