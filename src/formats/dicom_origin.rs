//! What results take over from the DICOM object that a mask came in: so much that an archive files them with the patient
//! and the study, and no more.
//!
//! It is kept in the record of a job, which nobody takes away, and goes into DICOM results alone: never into other files,
//! logs or messages.

use std::collections::BTreeMap;
use std::fmt;

use serde::{Deserialize, Serialize};

use super::read::Uid;

/// Group and element of an attribute.
pub type Tag = (u16, u16);

/// Character set of the texts.
pub const SPECIFIC_CHARACTER_SET: Tag = (0x0008, 0x0005);
/// The study.
pub const STUDY_INSTANCE_UID: Tag = (0x0020, 0x000d);
/// Class of the object itself.
pub const SOP_CLASS_UID: Tag = (0x0008, 0x0016);
/// The object itself.
pub const SOP_INSTANCE_UID: Tag = (0x0008, 0x0018);
/// Its series.
pub const SERIES_INSTANCE_UID: Tag = (0x0020, 0x000e);
/// The space that it lies in.
pub const FRAME_OF_REFERENCE_UID: Tag = (0x0020, 0x0052);
/// The series of the images that were segmented; taken from the item of the Referenced Series Sequence.
pub const SEGMENTED_SERIES: Tag = (0x0008, 0x1115);

/// Patient and study attributes that are written into results as the bytes that they were.
pub(super) const COPIED: [(Tag, [u8; 2]); 11] = [
    ((0x0008, 0x0020), *b"DA"),
    ((0x0008, 0x0030), *b"TM"),
    ((0x0008, 0x0050), *b"SH"),
    ((0x0008, 0x0090), *b"PN"),
    ((0x0010, 0x0010), *b"PN"),
    ((0x0010, 0x0020), *b"LO"),
    ((0x0010, 0x0021), *b"LO"),
    ((0x0010, 0x0030), *b"DA"),
    ((0x0010, 0x0040), *b"CS"),
    ((0x0020, 0x0010), *b"SH"),
    (STUDY_INSTANCE_UID, *b"UI"),
];

/// What else is kept, for references and texts.
const REFERENCES: [Tag; 6] = [
    SPECIFIC_CHARACTER_SET,
    SOP_CLASS_UID,
    SOP_INSTANCE_UID,
    SERIES_INSTANCE_UID,
    FRAME_OF_REFERENCE_UID,
    SEGMENTED_SERIES,
];

/// Bytes of an attribute at the most: five components of 64 characters of four bytes are a name with all its parts.
const MOST_BYTES: usize = 1280;

/// Attributes of the object that a mask came in.
#[derive(Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct DicomOrigin {
    attributes: BTreeMap<Tag, Vec<u8>>,
}

/// Tells how many attributes there are and none of them: they name a patient.
impl fmt::Debug for DicomOrigin {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(formatter, "DicomOrigin({} attributes)", self.attributes.len())
    }
}

impl DicomOrigin {
    /// Whether a value of this tag is taken over.
    #[must_use]
    pub fn wants(tag: Tag) -> bool {
        REFERENCES.contains(&tag) || COPIED.iter().any(|(copied, _)| *copied == tag)
    }

    /// Keeps a value as the bytes that it is stored in; one of another tag, or longer than any such value may be, is
    /// passed over.
    pub fn keep(&mut self, tag: Tag, bytes: &[u8]) {
        if Self::wants(tag) && bytes.len() <= MOST_BYTES {
            self.attributes.insert(tag, bytes.to_vec());
        }
    }

    /// A value as it was stored; nothing of what was not there.
    #[must_use]
    pub fn bytes(&self, tag: Tag) -> &[u8] {
        self.attributes.get(&tag).map_or(&[], Vec::as_slice)
    }

    /// A UID without its padding; `None` of what is none.
    #[must_use]
    pub fn uid(&self, tag: Tag) -> Option<&str> {
        let uid = std::str::from_utf8(self.bytes(tag)).ok()?.trim_end_matches(['\0', ' ']);
        Uid::parse(uid).map(|_| uid)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_results_need_is_kept_and_nothing_else_and_no_message_tells_it() {
        let mut origin = DicomOrigin::default();
        origin.keep((0x0010, 0x0010), b"Canary^Name");
        origin.keep((0x0010, 0x1040), b"Canary Street 1");
        origin.keep((0x0010, 0x0020), &[b'7'; MOST_BYTES + 1]);
        origin.keep(SOP_INSTANCE_UID, b"1.2.3\0");
        origin.keep(SERIES_INSTANCE_UID, b"1.2/../3");
        assert_eq!(origin.bytes((0x0010, 0x0010)), b"Canary^Name");
        assert!(origin.bytes((0x0010, 0x1040)).is_empty() && origin.bytes((0x0010, 0x0020)).is_empty());
        assert_eq!([origin.uid(SOP_INSTANCE_UID), origin.uid(SERIES_INSTANCE_UID)], [Some("1.2.3"), None]);
        assert_eq!(format!("{origin:?}"), "DicomOrigin(3 attributes)");
    }
}
