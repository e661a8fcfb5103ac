//! What a segmentation says of its segments: number, name, code, colour.

use std::collections::BTreeMap;

use super::color::rgb;
use super::error::DicomFault;
use super::tag::{Tag, TagPath};
use super::values::{Charset, Item};
use crate::formats::read::error::ReadError;
use crate::space::{Label, LabelCode, VolumeNotice};

/// The type of a segment that is what no other is, in the scheme of DICOM.
const BACKGROUND: (&str, &str) = ("125040", "DCM");

/// The segments by number.
#[derive(Debug, Default)]
pub(super) struct Segments {
    /// As a label; `None` of the background.
    by_number: BTreeMap<u16, Option<Label>>,
    /// Names that could not be read.
    unread_names: usize,
}

impl Segments {
    /// Takes in an item of SegmentSequence.
    ///
    /// # Errors
    /// When it has no number of its own.
    pub fn add(&mut self, item: &Item, place: u32, charset: Charset) -> Result<(), ReadError> {
        let path = || TagPath::top(Tag::SEGMENTS).item(place).join(Tag::SEGMENT_NUMBER);
        let number = item.shorts(Tag::SEGMENT_NUMBER).and_then(|numbers| numbers.first().copied());
        let Some(number) = number else { return Err(DicomFault::Missing { name: "SegmentNumber" }.at(path())) };
        let code = item.first(Tag::SEGMENT_TYPE).and_then(|code| code_of(code, charset));
        let is_background = code.as_ref().is_some_and(|code| (code.value.as_str(), code.scheme.as_str()) == BACKGROUND);
        if (number == 0 && !is_background) || self.by_number.contains_key(&number) {
            let allowed = "1 to 65535, another one for each segment";
            return Err(DicomFault::BadValue { name: "SegmentNumber", allowed }.at(path()));
        }
        let label = if is_background { None } else { Some(self.label(number, item, code, charset)) };
        self.by_number.insert(number, label);
        Ok(())
    }

    fn label(&mut self, number: u16, item: &Item, code: Option<LabelCode>, charset: Charset) -> Label {
        let stored = item.bytes(Tag::SEGMENT_LABEL);
        let name = stored.filter(|_| charset != Charset::Other).and_then(|bytes| charset.text(bytes));
        self.unread_names += usize::from(stored.is_some() && name.is_none());
        let color = item.shorts(Tag::SEGMENT_COLOR).and_then(|lab| <[u16; 3]>::try_from(lab).ok());
        Label { value: i64::from(number), name, color: color.map(rgb), code }
    }

    /// Whether a number is that of the background.
    pub fn is_background(&self, number: u16) -> bool {
        matches!(self.by_number.get(&number), Some(None))
    }

    /// What is known of a segment.
    pub fn label_of(&mut self, number: u16) -> Label {
        self.by_number.remove(&number).flatten().unwrap_or_else(|| Label::new(i64::from(number)))
    }

    /// What was odd about them.
    pub fn tell(&self, notices: &mut Vec<VolumeNotice>) {
        if self.unread_names > 0 {
            let message = format!(
                "the names of {} segments cannot be read (of ISO_IR 6, 100 and 192, up to 80 characters); these go by \
                 their numbers",
                self.unread_names
            );
            notices.push(VolumeNotice { code: "segment_names_ignored", message });
        }
    }
}

/// A code; `None` where a part of it is missing or cannot be read.
fn code_of(item: &Item, charset: Charset) -> Option<LabelCode> {
    let text = |tag| item.bytes(tag).and_then(|bytes| charset.text(bytes));
    let value = text(Tag::CODE_VALUE).or_else(|| text(Tag::LONG_CODE_VALUE)).or_else(|| text(Tag::URN_CODE_VALUE))?;
    Some(LabelCode { value, scheme: text(Tag::CODE_SCHEME)?, meaning: text(Tag::CODE_MEANING)? })
}
