//! What all our objects have in common: patient and study of the mask's object, series and equipment of ours.

use super::dataset::{Dataset, Text};
use super::uid;
use crate::formats::dicom_object::DicomObject;
use crate::formats::dicom_origin::{COPIED, DicomOrigin, SPECIFIC_CHARACTER_SET, STUDY_INSTANCE_UID, Tag};
use crate::formats::write::dates::Utc;
use crate::formats::write::record::Record;

/// Kinds of object.
#[derive(Clone, Copy, Debug)]
pub(super) struct Kind {
    /// SOP class.
    pub class: &'static str,
    /// What sort of equipment makes it.
    pub modality: &'static str,
    /// Number of its series in the study; of a range that scanners do not use.
    pub series: u16,
    /// What the series is called.
    pub description: &'static str,
    /// The name of the file: its UIDs follow from it.
    pub artifact: &'static str,
}

/// An object on its way.
pub(super) struct Instance {
    pub dataset: Dataset,
    object: DicomObject,
    /// Whether texts may have any letters.
    is_unicode: bool,
}

const UNICODE: &str = "ISO_IR 192";

/// Which object of this kind is made of a record.
pub(super) fn object(record: &Record, kind: Kind) -> DicomObject {
    let study = record.dicom.as_ref().and_then(|origin| origin.uid(STUDY_INSTANCE_UID));
    DicomObject {
        class: kind.class.to_owned(),
        study: study.map_or_else(|| uid::of_mask(record, "study"), str::to_owned),
        series: uid::of(record, &format!("series of {}", kind.artifact)),
        instance: uid::of(record, kind.artifact),
    }
}

/// Whether text means the same in every character set: after an escape, bytes of ASCII are letters of another one (ISO 2022).
fn is_the_same_everywhere(text: &[u8]) -> bool {
    const ESCAPE: u8 = 0x1b;
    text.is_ascii() && !text.contains(&ESCAPE)
}

impl Instance {
    /// With everything but the content.
    pub fn new(record: &Record, kind: Kind) -> Self {
        let nothing = DicomOrigin::default();
        let origin = record.dicom.as_ref().unwrap_or(&nothing);
        let is_plain = COPIED.iter().all(|(tag, _)| is_the_same_everywhere(origin.bytes(*tag)));
        let is_unicode = is_plain || origin.bytes(SPECIFIC_CHARACTER_SET).trim_ascii_end() == UNICODE.as_bytes();
        let mut own = Self { dataset: Dataset::default(), object: object(record, kind), is_unicode };
        own.add_patient_and_study(record, origin);
        own.add_series(record, kind);
        own.add_equipment();
        own
    }

    fn add_patient_and_study(&mut self, record: &Record, origin: &DicomOrigin) {
        const PATIENT_ID_ISSUER: Tag = (0x0010, 0x0021);
        let set = &mut self.dataset;
        if self.is_unicode {
            set.text(SPECIFIC_CHARACTER_SET, Text::Cs, UNICODE);
        } else {
            set.bytes(SPECIFIC_CHARACTER_SET, *b"CS", origin.bytes(SPECIFIC_CHARACTER_SET));
        }
        for (tag, vr) in COPIED {
            if tag != PATIENT_ID_ISSUER || !origin.bytes(tag).is_empty() {
                set.bytes(tag, vr, origin.bytes(tag));
            }
        }
        if origin.uid(STUDY_INSTANCE_UID).is_none() {
            set.text(STUDY_INSTANCE_UID, Text::Ui, &self.object.study);
        }
        if record.dicom.is_none() {
            // Said of all times of an object: those of another's study may be of another zone.
            set.text((0x0008, 0x0201), Text::Sh, "+0000");
        }
    }

    fn add_series(&mut self, record: &Record, kind: Kind) {
        // A record of before times were kept tells the first second that there is.
        let ended = Utc::of(record.ended_unix_s.unwrap_or(0));
        let set = &mut self.dataset;
        set.text((0x0008, 0x0016), Text::Ui, &self.object.class);
        set.text((0x0008, 0x0018), Text::Ui, &self.object.instance);
        for tag in [(0x0008, 0x0012), (0x0008, 0x0021), (0x0008, 0x0023)] {
            set.text(tag, Text::Da, &ended.date());
        }
        for tag in [(0x0008, 0x0013), (0x0008, 0x0031), (0x0008, 0x0033)] {
            set.text(tag, Text::Tm, &ended.time());
        }
        set.text((0x0008, 0x0060), Text::Cs, kind.modality);
        set.text((0x0008, 0x103e), Text::Lo, kind.description);
        set.text((0x0020, 0x000e), Text::Ui, &self.object.series);
        set.text((0x0020, 0x0011), Text::Is, &kind.series.to_string());
        set.text((0x0020, 0x0013), Text::Is, "1");
    }

    fn add_equipment(&mut self) {
        let set = &mut self.dataset;
        set.text((0x0008, 0x0070), Text::Lo, "medialrep");
        set.text((0x0008, 0x1090), Text::Lo, "medialrep");
        // A program has no serial number; an enhanced object must have one.
        set.text((0x0018, 0x1000), Text::Lo, "0");
        set.text((0x0018, 0x1020), Text::Lo, env!("CARGO_PKG_VERSION"));
    }

    /// A text that may have letters that the character set of a patient's name has not.
    pub fn words(&self, set: &mut Dataset, tag: Tag, kind: Text, text: &str) {
        if self.is_unicode { set.text(tag, kind, text) } else { set.ascii(tag, kind, text) }
    }

    /// The file.
    pub fn file(&self) -> Vec<u8> {
        self.dataset.file((&self.object.class, &self.object.instance))
    }
}
