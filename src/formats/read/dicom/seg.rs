//! What a data set says before its pixels, checked: how many there are, what they mean, where they lie.

use super::error::DicomFault;
use super::frames::Kind;
use super::geometry::{Frame, Stack};
use super::groups::{Groups, Plane};
use super::segments::Segments;
use super::syntax::{Head, Syntax};
use super::tag::{Tag, TagPath};
use super::values::{Charset, Item, plain, shorts, uid, whole};
use super::walk::{Met, Walk};
use crate::formats::dicom_origin::{DicomOrigin, SEGMENTED_SERIES};
use crate::formats::read::error::ReadError;
use crate::space::VolumeNotice;

/// Classes of objects that are read.
pub(super) const SEGMENTATIONS: [&str; 2] = ["1.2.840.10008.5.1.4.1.1.66.4", "1.2.840.10008.5.1.4.1.1.66.7"];
/// Frames: a torso of 117 organs in slices of 1 mm has 100 000. Each takes 32 bytes.
const MAX_FRAMES: u64 = 1 << 20;

/// A segmentation before its pixels.
#[derive(Debug, Default)]
pub(super) struct Seg {
    charset: Charset,
    is_big_endian: bool,
    has_class: bool,
    samples: Option<u16>,
    frame_count: Option<u64>,
    rows: u16,
    columns: u16,
    bits: u16,
    background: Option<u16>,
    is_tiled: bool,
    kind: Type,
    maximum_share: Option<u16>,
    /// The series that it refers to.
    series: Option<String>,
    pub segments: Segments,
    shared: Groups,
    plane: Option<Plane>,
    frames: Vec<Frame>,
    origin: DicomOrigin,
}

/// SegmentationType.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
enum Type {
    #[default]
    Unknown,
    Binary,
    Fractional,
    Labelmap,
}

/// A segmentation whose pixels come next.
pub(super) struct Described {
    pub kind: Kind,
    pub plane: usize,
    pub frames: Vec<Frame>,
    pub stack: Stack,
    pub segments: Segments,
    pub background: Option<u16>,
    /// Head of the pixels.
    pub pixels: Head,
    /// What results take over.
    pub origin: DicomOrigin,
}

impl Described {
    /// Reads up to the pixels.
    ///
    /// # Errors
    /// When it is no segmentation of a volume, is malformed, or is larger than allowed.
    pub fn read(walk: &mut Walk<'_, '_>, max_voxels: u64, notices: &mut Vec<VolumeNotice>) -> Result<Self, ReadError> {
        let mut seg = Seg::new(walk.syntax);
        loop {
            match walk.next()? {
                Some(Met::Value { tag, bytes }) => seg.value(tag, &bytes)?,
                Some(Met::Item { sequence, number, item }) => seg.item(sequence, number, &item)?,
                Some(Met::Pixels(pixels)) => return seg.finish(pixels, max_voxels, notices),
                None => return Err(missing("PixelData", Tag::PIXELS)),
            }
        }
    }
}

impl Seg {
    fn new(syntax: Syntax) -> Self {
        Self { is_big_endian: syntax.is_big_endian, ..Self::default() }
    }

    /// Takes in a value that no sequence holds.
    fn value(&mut self, tag: Tag, bytes: &[u8]) -> Result<(), ReadError> {
        self.origin.keep(tag.halves(), bytes);
        let short = shorts(bytes, self.is_big_endian).first().copied();
        match tag {
            Tag::CHARACTER_SET => self.charset = Charset::of(bytes),
            Tag::SOP_CLASS => {
                check_class(bytes)?;
                self.has_class = true;
            }
            Tag::SAMPLES => self.samples = short,
            Tag::FRAMES => self.frame_count = Some(frame_count(bytes)?),
            Tag::ROWS => self.rows = short.unwrap_or(0),
            Tag::COLUMNS => self.columns = short.unwrap_or(0),
            Tag::BITS_ALLOCATED => self.bits = short.unwrap_or(0),
            Tag::PIXEL_PADDING => self.background = short,
            Tag::TOTAL_COLUMNS => self.is_tiled = true,
            Tag::SEGMENTATION_TYPE => self.kind = Type::of(bytes)?,
            Tag::MAXIMUM_FRACTION => self.maximum_share = short,
            _ => {}
        }
        Ok(())
    }

    /// Takes in an item of a sequence that no other holds.
    fn item(&mut self, sequence: Tag, number: u32, item: &Item) -> Result<(), ReadError> {
        match sequence {
            Tag::REFERENCED_SERIES => {
                if let (1, Some(series)) = (number, item.bytes(Tag::SERIES)) {
                    self.origin.keep(SEGMENTED_SERIES, series);
                }
                self.series = self.series.take().or(item.bytes(Tag::SERIES).and_then(uid));
            }
            Tag::SEGMENTS => self.segments.add(item, number, self.charset)?,
            Tag::SHARED_GROUPS => self.shared = Groups::read(item, &TagPath::top(sequence).item(number))?,
            Tag::FRAME_GROUPS => {
                let frames = self.frame_count.unwrap_or(1);
                if self.frames.len() as u64 >= frames {
                    let fault = DicomFault::FrameCount { frames, groups: u64::from(number) };
                    return Err(fault.at(TagPath::top(Tag::FRAMES)));
                }
                let path = TagPath::top(sequence).item(number);
                self.frame(Groups::read(item, &path)?)?;
            }
            _ => {}
        }
        Ok(())
    }

    /// Takes in a frame, by what it says of itself.
    fn frame(&mut self, own: Groups) -> Result<(), ReadError> {
        let number = self.frames.len() + 1;
        let path = TagPath::top(Tag::FRAME_GROUPS).item(u32::try_from(number).unwrap_or(u32::MAX));
        let groups = own.or(&self.shared);
        if self.is_tiled || groups.is_on_slide {
            return Err(DicomFault::Tiled { series: self.series.clone() }.at(path));
        }
        let (position, orientation, measures) = groups.place().map_err(|what| {
            DicomFault::NoPlace { frame: number, what, series: self.series.clone() }.at(path.clone())
        })?;
        match &self.plane {
            None => self.plane = Some(Plane::new(orientation, measures, path.clone().join(Tag::PLANE_ORIENTATION))?),
            Some(plane) => {
                if let Some(what) = plane.difference(orientation, measures) {
                    return Err(DicomFault::Mixed { frame: number, what }.at(path));
                }
            }
        }
        let segment = match (self.kind, groups.segment) {
            (Type::Labelmap, _) => 0,
            (_, Some(segment)) if segment > 0 => segment,
            _ => {
                let fault = DicomFault::Missing { name: "ReferencedSegmentNumber of a frame" };
                return Err(fault.at(path.join(Tag::SEGMENT_IDENTIFICATION)));
            }
        };
        self.frames.push(Frame { position, segment });
        Ok(())
    }

    fn finish(
        mut self,
        pixels: Head,
        max_voxels: u64,
        notices: &mut Vec<VolumeNotice>,
    ) -> Result<Described, ReadError> {
        if !self.has_class {
            return Err(missing("SOPClassUID", Tag::SOP_CLASS));
        }
        if self.samples.is_some_and(|samples| samples != 1) {
            return Err(DicomFault::BadValue { name: "SamplesPerPixel", allowed: "1" }.at(TagPath::top(Tag::SAMPLES)));
        }
        for (length, name, tag) in [(self.rows, "Rows", Tag::ROWS), (self.columns, "Columns", Tag::COLUMNS)] {
            if length == 0 {
                return Err(missing(name, tag));
            }
        }
        let kind = self.pixel_kind()?;
        let frames = self.frame_count.unwrap_or(1);
        if frames == 1 && self.frames.is_empty() {
            self.frame(Groups::default())?;
        }
        let groups = self.frames.len() as u64;
        if groups != frames {
            return Err(DicomFault::FrameCount { frames, groups }.at(TagPath::top(Tag::FRAMES)));
        }
        let plane = self.plane.ok_or_else(|| missing("NumberOfFrames", Tag::FRAMES))?;
        let lengths = [self.columns, self.rows].map(usize::from);
        let stack = Stack::of(&self.frames, &plane, lengths, max_voxels, notices)?;
        check_once(&self.frames, &stack.slice_of)?;
        let background = self.background.filter(|_| self.kind == Type::Labelmap);
        let (plane, segments) = (lengths[0] * lengths[1], self.segments);
        Ok(Described { kind, plane, frames: self.frames, stack, segments, background, pixels, origin: self.origin })
    }

    fn pixel_kind(&self) -> Result<Kind, ReadError> {
        match (self.kind, self.bits) {
            (Type::Binary, 1) => Ok(Kind::Bits),
            // Against the standard, but met.
            (Type::Binary, 8) => Ok(Kind::Share(1)),
            (Type::Fractional, 8) => match u8::try_from(self.maximum_share.unwrap_or(255)) {
                Ok(most @ 1..) => Ok(Kind::Share(most)),
                _ => {
                    let fault = DicomFault::BadValue { name: "MaximumFractionalValue", allowed: "1 to 255" };
                    Err(fault.at(TagPath::top(Tag::MAXIMUM_FRACTION)))
                }
            },
            (Type::Labelmap, 8) => Ok(Kind::Labels8),
            (Type::Labelmap, 16) => Ok(Kind::Labels16),
            (Type::Unknown, _) => Err(missing("SegmentationType", Tag::SEGMENTATION_TYPE)),
            (kind, bits) => Err(DicomFault::Encoding { kind: kind.name(), bits }.at(TagPath::top(Tag::BITS_ALLOCATED))),
        }
    }
}

impl Type {
    fn of(bytes: &[u8]) -> Result<Self, ReadError> {
        for kind in [Self::Binary, Self::Fractional, Self::Labelmap] {
            if plain(bytes) == Some(kind.name()) {
                return Ok(kind);
            }
        }
        let allowed = "BINARY, FRACTIONAL or LABELMAP";
        Err(DicomFault::BadValue { name: "SegmentationType", allowed }.at(TagPath::top(Tag::SEGMENTATION_TYPE)))
    }

    fn name(self) -> &'static str {
        match self {
            Self::Unknown => "",
            Self::Binary => "BINARY",
            Self::Fractional => "FRACTIONAL",
            Self::Labelmap => "LABELMAP",
        }
    }
}

fn missing(name: &'static str, tag: Tag) -> ReadError {
    DicomFault::Missing { name }.at(TagPath::top(tag))
}

fn frame_count(bytes: &[u8]) -> Result<u64, ReadError> {
    let path = || TagPath::top(Tag::FRAMES);
    match whole(bytes) {
        Some(1..=MAX_FRAMES) => {}
        Some(more) if more > 0 => {
            let fault = DicomFault::OverLimit { what: "more frames than a segmentation has", allowed: MAX_FRAMES };
            return Err(fault.at(path()));
        }
        _ => return Err(DicomFault::BadValue { name: "NumberOfFrames", allowed: "a whole number from 1" }.at(path())),
    }
    Ok(whole(bytes).unwrap_or(1))
}

/// Refuses what is no segmentation.
fn check_class(bytes: &[u8]) -> Result<(), ReadError> {
    let path = || TagPath::top(Tag::SOP_CLASS);
    let allowed = "a UID";
    let uid = uid(bytes).ok_or_else(|| DicomFault::BadValue { name: "SOPClassUID", allowed }.at(path()))?;
    if SEGMENTATIONS.contains(&uid.as_str()) {
        return Ok(());
    }
    Err(DicomFault::NotSegmentation { name: name_of(&uid), uid }.at(path()))
}

/// What others are called that are met.
fn name_of(class: &str) -> Option<&'static str> {
    Some(match class.strip_prefix("1.2.840.10008.5.1.4.1.1.")? {
        "2" | "2.1" => "a CT image",
        "4" | "4.1" => "an MR image",
        "128" | "130" => "a PET image",
        "7" | "7.1" | "7.2" | "7.3" | "7.4" => "a secondary capture",
        "11.1" => "a presentation state",
        "30" => "a parametric map",
        "66" => "raw data",
        "66.5" => "a surface segmentation",
        "77.1.6" => "a slide",
        "88.11" | "88.22" | "88.33" | "88.34" => "a structured report",
        "104.1" => "a PDF document",
        "104.3" => "an STL surface",
        "481.2" => "a radiotherapy dose",
        "481.3" => "a radiotherapy structure set (RTSTRUCT)",
        "481.5" => "a radiotherapy plan",
        _ => return None,
    })
}

/// Refuses two frames of one segment in one slice: a series in time.
fn check_once(frames: &[Frame], slice_of: &[usize]) -> Result<(), ReadError> {
    let mut places: Vec<(usize, u16, usize)> = Vec::new();
    for ((frame, slice), number) in frames.iter().zip(slice_of).zip(1..) {
        places.push((*slice, frame.segment, number));
    }
    places.sort_unstable();
    for pair in places.windows(2) {
        if let [(slice, segment, earlier), (same_slice, same_segment, frame)] = pair
            && (slice, segment) == (same_slice, same_segment)
        {
            let item = u32::try_from(*frame).unwrap_or(u32::MAX);
            let fault = DicomFault::Repeated { frame: *frame, earlier: *earlier };
            return Err(fault.at(TagPath::top(Tag::FRAME_GROUPS).item(item)));
        }
    }
    Ok(())
}
