//! The elements that are looked at, and how a place among them is told.

use std::fmt;

use crate::formats::dicom_origin::{self, DicomOrigin};

/// Group and element of a DICOM attribute.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Tag(pub u32);

impl Tag {
    /// Of all that is framed in items.
    pub(super) const ITEM: Self = Self(0xfffe_e000);
    pub(super) const ITEM_END: Self = Self(0xfffe_e00d);
    pub(super) const SEQUENCE_END: Self = Self(0xfffe_e0dd);

    pub(super) const META_LENGTH: Self = Self(0x0002_0000);
    pub(super) const TRANSFER_SYNTAX: Self = Self(0x0002_0010);

    pub(super) const CHARACTER_SET: Self = Self(0x0008_0005);
    pub(super) const SOP_CLASS: Self = Self(0x0008_0016);
    pub(super) const SOP_INSTANCE: Self = Self(0x0008_0018);
    pub(super) const CODE_VALUE: Self = Self(0x0008_0100);
    pub(super) const CODE_SCHEME: Self = Self(0x0008_0102);
    pub(super) const CODE_MEANING: Self = Self(0x0008_0104);
    pub(super) const LONG_CODE_VALUE: Self = Self(0x0008_0119);
    pub(super) const URN_CODE_VALUE: Self = Self(0x0008_0120);
    pub(super) const REFERENCED_SERIES: Self = Self(0x0008_1115);
    pub(super) const SLICE_THICKNESS: Self = Self(0x0018_0050);
    pub(super) const SPACING_BETWEEN_SLICES: Self = Self(0x0018_0088);
    pub(super) const STUDY: Self = Self(0x0020_000d);
    pub(super) const SERIES: Self = Self(0x0020_000e);
    pub(super) const POSITION: Self = Self(0x0020_0032);
    pub(super) const ORIENTATION: Self = Self(0x0020_0037);
    pub(super) const PLANE_POSITION: Self = Self(0x0020_9113);
    pub(super) const PLANE_ORIENTATION: Self = Self(0x0020_9116);
    pub(super) const SAMPLES: Self = Self(0x0028_0002);
    pub(super) const FRAMES: Self = Self(0x0028_0008);
    pub(super) const ROWS: Self = Self(0x0028_0010);
    pub(super) const COLUMNS: Self = Self(0x0028_0011);
    pub(super) const PIXEL_SPACING: Self = Self(0x0028_0030);
    pub(super) const BITS_ALLOCATED: Self = Self(0x0028_0100);
    pub(super) const PIXEL_PADDING: Self = Self(0x0028_0120);
    pub(super) const PIXEL_MEASURES: Self = Self(0x0028_9110);
    pub(super) const TOTAL_COLUMNS: Self = Self(0x0048_0006);
    pub(super) const SLIDE_POSITION: Self = Self(0x0048_021a);
    pub(super) const SEGMENTATION_TYPE: Self = Self(0x0062_0001);
    pub(super) const SEGMENTS: Self = Self(0x0062_0002);
    pub(super) const SEGMENT_NUMBER: Self = Self(0x0062_0004);
    pub(super) const SEGMENT_LABEL: Self = Self(0x0062_0005);
    pub(super) const SEGMENT_IDENTIFICATION: Self = Self(0x0062_000a);
    pub(super) const REFERENCED_SEGMENT: Self = Self(0x0062_000b);
    pub(super) const SEGMENT_COLOR: Self = Self(0x0062_000d);
    pub(super) const MAXIMUM_FRACTION: Self = Self(0x0062_000e);
    pub(super) const SEGMENT_TYPE: Self = Self(0x0062_000f);
    pub(super) const SHARED_GROUPS: Self = Self(0x5200_9229);
    pub(super) const FRAME_GROUPS: Self = Self(0x5200_9230);
    pub(super) const PIXELS: Self = Self(0x7fe0_0010);

    /// Group and element.
    pub(super) fn halves(self) -> dicom_origin::Tag {
        let [a, b, c, d] = self.0.to_be_bytes();
        (u16::from_be_bytes([a, b]), u16::from_be_bytes([c, d]))
    }

    /// Whether it frames others instead of holding a value.
    pub(super) fn is_frame(self) -> bool {
        self.0 >> 16 == 0xfffe
    }
}

impl fmt::Display for Tag {
    /// `(0028,0010)`
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "({:04x},{:04x})", self.0 >> 16, self.0 & 0xffff)
    }
}

/// What is done with an element.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Use {
    /// Passed over by its length.
    None,
    Value,
    Sequence,
}

/// What is done with an element in an item of the sequence `parent`, or of none.
pub(super) fn usage(parent: Option<Tag>, tag: Tag) -> Use {
    let (values, sequences): (&[Tag], &[Tag]) = match parent {
        None => (TOP_VALUES, &[Tag::REFERENCED_SERIES, Tag::SEGMENTS, Tag::SHARED_GROUPS, Tag::FRAME_GROUPS]),
        Some(Tag::REFERENCED_SERIES) => (&[Tag::SERIES], &[]),
        Some(Tag::SEGMENTS) => (&[Tag::SEGMENT_NUMBER, Tag::SEGMENT_LABEL, Tag::SEGMENT_COLOR], &[Tag::SEGMENT_TYPE]),
        Some(Tag::SEGMENT_TYPE) => (CODE_VALUES, &[]),
        Some(Tag::SHARED_GROUPS | Tag::FRAME_GROUPS) => (&[], GROUPS),
        Some(Tag::PLANE_POSITION) => (&[Tag::POSITION], &[]),
        Some(Tag::PLANE_ORIENTATION) => (&[Tag::ORIENTATION], &[]),
        Some(Tag::PIXEL_MEASURES) => (&[Tag::PIXEL_SPACING, Tag::SLICE_THICKNESS, Tag::SPACING_BETWEEN_SLICES], &[]),
        Some(Tag::SEGMENT_IDENTIFICATION) => (&[Tag::REFERENCED_SEGMENT], &[]),
        Some(_) => (&[], &[]),
    };
    if sequences.contains(&tag) {
        Use::Sequence
    } else if values.contains(&tag) || (parent.is_none() && DicomOrigin::wants(tag.halves())) {
        Use::Value
    } else {
        Use::None
    }
}

const TOP_VALUES: &[Tag] = &[
    Tag::CHARACTER_SET,
    Tag::SOP_CLASS,
    Tag::SOP_INSTANCE,
    Tag::STUDY,
    Tag::SAMPLES,
    Tag::FRAMES,
    Tag::ROWS,
    Tag::COLUMNS,
    Tag::BITS_ALLOCATED,
    Tag::PIXEL_PADDING,
    Tag::TOTAL_COLUMNS,
    Tag::SEGMENTATION_TYPE,
    Tag::MAXIMUM_FRACTION,
];

const CODE_VALUES: &[Tag] =
    &[Tag::CODE_VALUE, Tag::CODE_SCHEME, Tag::CODE_MEANING, Tag::LONG_CODE_VALUE, Tag::URN_CODE_VALUE];

const GROUPS: &[Tag] = &[
    Tag::PLANE_POSITION,
    Tag::PLANE_ORIENTATION,
    Tag::PIXEL_MEASURES,
    Tag::SEGMENT_IDENTIFICATION,
    Tag::SLIDE_POSITION,
];

/// The way to an element through the sequences that hold it: `(5200,9230)[12].(0020,9113)[1].(0020,0032)`. Items count
/// from 1.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct TagPath(Vec<(Tag, Option<u32>)>);

impl TagPath {
    /// An element that no sequence holds.
    pub(super) fn top(tag: Tag) -> Self {
        Self::default().join(tag)
    }

    /// An element in what the path leads to.
    pub(super) fn join(mut self, tag: Tag) -> Self {
        self.0.push((tag, None));
        self
    }

    /// An item of the sequence that the path leads to; 0 is none of them.
    pub(super) fn item(mut self, item: u32) -> Self {
        if let (Some((_, of)), true) = (self.0.last_mut(), item > 0) {
            *of = Some(item);
        }
        self
    }

    /// Whether no element is meant.
    pub(super) fn is_empty(&self) -> bool {
        self.0.is_empty()
    }
}

impl fmt::Display for TagPath {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for (place, (tag, item)) in self.0.iter().enumerate() {
            write!(f, "{}{tag}", if place > 0 { "." } else { "" })?;
            if let Some(item) = item {
                write!(f, "[{item}]")?;
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_path_names_the_items_on_the_way() {
        let path = TagPath::top(Tag::FRAME_GROUPS).item(12).join(Tag::PLANE_POSITION).item(1).join(Tag::POSITION);
        assert_eq!(path.to_string(), "(5200,9230)[12].(0020,9113)[1].(0020,0032)");
        assert_eq!(TagPath::top(Tag::SEGMENTS).item(3).to_string(), "(0062,0002)[3]");
    }
}
