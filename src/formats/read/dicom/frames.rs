//! Pixels → voxels, frame by frame, as they come.

use flate2::{Decompress, FlushDecompress, Status};

use super::error::DicomFault;
use super::geometry::Frame;
use super::layers::Layers;
use super::rle;
use super::segments::Segments;
use super::source::Source;
use super::syntax::{Head, Packing, Syntax, UNDEFINED};
use super::tag::{Tag, TagPath};
use crate::formats::read::error::ReadError;
use crate::space::VolumeNotice;

/// What a pixel says.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Kind {
    /// Whether a voxel is of the frame's segment, by a bit.
    Bits,
    /// How much of a voxel is of the frame's segment, of so much.
    Share(u8),
    /// The segment of a voxel, in one byte or two.
    Labels8,
    Labels16,
}

impl Kind {
    /// Bytes of a frame by itself.
    pub fn frame_bytes(self, plane: usize) -> usize {
        match self {
            Self::Bits => plane.div_ceil(8),
            Self::Share(_) | Self::Labels8 => plane,
            Self::Labels16 => 2 * plane,
        }
    }
}

/// Bytes of a frame that are read before memory is taken for more.
const STEP_BYTES: usize = 1 << 20;

/// Whether frames of bits begin at new bytes, by the length of pixels that are not compressed. Where both ways have the
/// same length, it is that of the standard.
///
/// # Errors
/// When the length is neither.
pub(super) fn begins_at_bytes(kind: Kind, plane: usize, frames: usize, pixels: Head) -> Result<bool, ReadError> {
    let at_bytes = kind.frame_bytes(plane) as u64 * frames as u64;
    let needed = if kind == Kind::Bits { (plane as u64 * frames as u64).div_ceil(8) } else { at_bytes };
    let got = u64::from(pixels.length);
    // A zero pads an odd number of bytes.
    let fits = |bytes: u64| got == bytes || got == bytes.next_multiple_of(2);
    match (fits(needed), fits(at_bytes)) {
        (true, _) if pixels.length != UNDEFINED => Ok(false),
        (false, true) if pixels.length != UNDEFINED => Ok(true),
        _ => Err(DicomFault::PixelLength { got, needed }.at(TagPath::top(Tag::PIXELS))),
    }
}

/// What is known of the pixels before they come.
pub(super) struct Frames<'a> {
    pub kind: Kind,
    /// Pixels of a frame.
    pub plane: usize,
    pub frames: &'a [Frame],
    /// By frame, its slice.
    pub slice_of: &'a [usize],
    pub segments: &'a Segments,
    /// The value that is no segment, beside 0.
    pub background: Option<u16>,
}

/// Takes frames and gives their pixels to the voxels.
pub(super) struct Painter<'a, 'l, 'c> {
    frames: &'a Frames<'a>,
    layers: &'l mut Layers<'c>,
    /// Whether a share was met that is neither nothing nor all.
    has_parts: bool,
    /// Whether values of two bytes have the high one first.
    is_big_endian: bool,
}

impl<'a, 'l, 'c> Painter<'a, 'l, 'c> {
    pub fn new(frames: &'a Frames<'a>, layers: &'l mut Layers<'c>) -> Self {
        Self { frames, layers, has_parts: false, is_big_endian: false }
    }

    /// Takes all pixels from the source.
    ///
    /// # Errors
    /// When they are not as many as they should be, do not decode, or cannot be read.
    pub fn read(
        mut self,
        source: &mut Source<'_, '_>,
        (head, syntax, packing): (Head, Syntax, Packing),
        notices: &mut Vec<VolumeNotice>,
    ) -> Result<(), ReadError> {
        match packing {
            Packing::Plain => self.read_plain(source, head, syntax, notices)?,
            Packing::Rle | Packing::Deflated => self.read_fragments(source, head, syntax, packing)?,
        }
        if self.has_parts {
            let message = "the segmentation has shares of voxels: those of at least half were taken".to_owned();
            notices.push(VolumeNotice { code: "fractional_thresholded", message });
        }
        Ok(())
    }

    /// Frames one after the other. Bits run on over frames; some writers begin each frame at a new byte instead, which
    /// the length tells.
    fn read_plain(
        &mut self,
        source: &mut Source<'_, '_>,
        head: Head,
        syntax: Syntax,
        notices: &mut Vec<VolumeNotice>,
    ) -> Result<(), ReadError> {
        let (kind, plane, count) = (self.frames.kind, self.frames.plane, self.frames.frames.len());
        let is_padded = begins_at_bytes(kind, plane, count, head)?;
        if is_padded {
            let message = "each frame begins at a new byte, where the standard lets bits run on".to_owned();
            notices.push(VolumeNotice { code: "frames_padded", message });
        }
        self.is_big_endian = syntax.is_big_endian;
        let swaps = syntax.is_big_endian && head.kind == Some(*b"OW") && kind != Kind::Labels16;
        let mut pixels = Pixels { source, left: u64::from(head.length), swaps, next: None };
        let step_bits = match kind {
            Kind::Bits if !is_padded => plane,
            _ => 8 * kind.frame_bytes(plane),
        };
        let mut content = Vec::new();
        let mut first_bit = 0;
        for number in 0..count {
            // The last byte of a frame may have the first pixels of the next one.
            let kept = content.len().min(usize::from(first_bit > 0));
            content.drain(..content.len() - kept);
            let pixel_bits = if kind == Kind::Bits { plane } else { step_bits };
            let wanted = (first_bit + pixel_bits).div_ceil(8);
            // Grows with what comes: a file may tell of more than it has.
            while content.len() < wanted {
                let filled = content.len();
                content.resize(wanted.min(filled + STEP_BYTES), 0);
                pixels.fill(&mut content[filled..])?;
            }
            self.paint(number, &content, first_bit)?;
            first_bit = (first_bit + step_bits) % 8;
        }
        pixels.finish()
    }

    /// Frames that are compressed, each in a fragment of its own, after a table of where they are.
    fn read_fragments(
        &mut self,
        source: &mut Source<'_, '_>,
        head: Head,
        syntax: Syntax,
        packing: Packing,
    ) -> Result<(), ReadError> {
        let (kind, plane) = (self.frames.kind, self.frames.plane);
        let malformed = |what, at| DicomFault::Malformed { what, at }.at(TagPath::top(Tag::PIXELS));
        if head.length != UNDEFINED {
            return Err(malformed("compressed pixels are not in fragments", source.position()));
        }
        let mut content = vec![0; kind.frame_bytes(plane)];
        let (mut number, mut has_table) = (0, false);
        let count = self.frames.frames.len();
        loop {
            let at = source.position();
            let Some(item) = syntax.head(source)? else {
                return Err(ReadError::Truncated { expected: at + 8, got: at });
            };
            match item.tag {
                Tag::SEQUENCE_END if number == count => return Ok(()),
                Tag::ITEM if !has_table && item.length != UNDEFINED => {
                    source.skip(u64::from(item.length))?;
                    has_table = true;
                }
                Tag::ITEM if number < count => {
                    if u64::from(item.length) > rle::most_bytes(content.len()) {
                        return Err(corrupt(number, "it is longer than it would be without compression"));
                    }
                    let encoded = source.take(u64::from(item.length))?;
                    unpack(packing, kind, &encoded, &mut content)
                        .ok_or_else(|| corrupt(number, "it has not as many bytes as its rows and columns need"))?;
                    self.paint(number, &content, 0)?;
                    number += 1;
                }
                Tag::ITEM => return Err(malformed("there are more fragments than frames", at)),
                Tag::SEQUENCE_END => return Err(malformed("there are fewer fragments than frames", at)),
                _ => return Err(malformed("something else than a fragment", at)),
            }
        }
    }

    /// Gives the pixels of a frame to its slice. Its first pixel is at a bit of the first byte.
    fn paint(&mut self, number: usize, content: &[u8], first_bit: usize) -> Result<(), ReadError> {
        let (Some(frame), Some(slice)) = (self.frames.frames.get(number), self.frames.slice_of.get(number)) else {
            return Ok(());
        };
        if self.frames.segments.is_background(frame.segment) && frame.segment != 0 {
            return Ok(());
        }
        match self.frames.kind {
            Kind::Bits => self.layers.add_bits(frame.segment, *slice, content, first_bit),
            Kind::Share(most) => {
                self.has_parts |= most > 1 && content.iter().any(|share| *share != 0 && *share != most);
                self.layers.add_values(frame.segment, *slice, content, most.div_ceil(2).max(1))
            }
            Kind::Labels8 => self.paint_labels(*slice, content.iter().map(|value| u16::from(*value))),
            Kind::Labels16 if self.is_big_endian => {
                self.paint_labels(*slice, content.as_chunks::<2>().0.iter().map(|value| u16::from_be_bytes(*value)))
            }
            Kind::Labels16 => {
                self.paint_labels(*slice, content.as_chunks::<2>().0.iter().map(|value| u16::from_le_bytes(*value)))
            }
        }
    }

    fn paint_labels(&mut self, slice: usize, values: impl Iterator<Item = u16>) -> Result<(), ReadError> {
        let frames = self.frames;
        let (mut last, mut is_last_background) = (0, true);
        let values = values.map(|value| {
            if value != last {
                last = value;
                is_last_background = frames.background == Some(value) || frames.segments.is_background(value);
            }
            if is_last_background { 0 } else { value }
        });
        self.layers.add_labels(slice, values);
        Ok(())
    }
}

/// Decodes a frame; `None` where it has not as many bytes as `out`.
fn unpack(packing: Packing, kind: Kind, encoded: &[u8], out: &mut [u8]) -> Option<()> {
    match packing {
        Packing::Deflated => inflate(encoded, out),
        Packing::Rle => rle::unpack(encoded, if kind == Kind::Labels16 { 2 } else { 1 }, out),
        Packing::Plain => None,
    }
}

/// Inflates a frame. What follows it pads it.
fn inflate(encoded: &[u8], out: &mut [u8]) -> Option<()> {
    let mut state = Decompress::new(false);
    if state.decompress(encoded, out, FlushDecompress::Finish).ok()? != Status::StreamEnd {
        // With all bytes out, its end may be still to come; a byte more would be one too many.
        let rest = encoded.get(usize::try_from(state.total_in()).ok()?..)?;
        state.decompress(rest, &mut [0], FlushDecompress::Finish).ok()?;
    }
    (state.total_out() == out.len() as u64).then_some(())
}

/// A frame that does not decode, from 0.
fn corrupt(number: usize, what: &'static str) -> ReadError {
    DicomFault::CorruptFrame { frame: number + 1, what }.at(TagPath::top(Tag::PIXELS))
}

/// The bytes of pixels that are not compressed. In words of two bytes with the high one first, the pixels of a word's
/// low byte come first: bytes are swapped.
struct Pixels<'s, 'a, 'f> {
    source: &'s mut Source<'a, 'f>,
    left: u64,
    swaps: bool,
    /// The second byte of a word whose first one was taken.
    next: Option<u8>,
}

impl Pixels<'_, '_, '_> {
    fn fill(&mut self, out: &mut [u8]) -> Result<(), ReadError> {
        if !self.swaps {
            self.left = self.left.saturating_sub(out.len() as u64);
            return self.source.exact(out);
        }
        for byte in out {
            *byte = match self.next.take() {
                Some(next) => next,
                None if self.left < 2 => 0,
                None => {
                    let [second, first] = self.source.array()?;
                    self.left -= 2;
                    self.next = Some(second);
                    first
                }
            };
        }
        Ok(())
    }

    /// Passes over what pads the last frame.
    fn finish(self) -> Result<(), ReadError> {
        self.source.skip(self.left)
    }
}
