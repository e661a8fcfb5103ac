//! DICOM segmentation (SEG) → label map. The data set is walked once, without recursion and without a copy of it; what
//! is wanted is checked as it comes, and pixels are decoded while they are read. In the order of the file: how it is
//! written, what it says of itself, its pixels. Text of the file leaves it in names and codes of segments alone.

mod tag;

mod error;

mod source;

mod syntax;

mod values;

mod walk;

mod color;

mod segments;

mod groups;

mod geometry;

mod seg;

mod layers;

mod frames;

mod rle;

mod uid;

mod identity;

mod elements;

use self::frames::{Frames, Painter, begins_at_bytes};
use self::geometry::SLICES;
use self::layers::Layers;
use self::seg::Described;
use self::source::Source;
use self::syntax::{MAGIC, PREAMBLE_BYTES, Packing, Transfer, read_transfer};
use self::walk::Walk;
use super::answers::{Found, HeaderFacts, InputLimits, Sniffed};
use super::error::ReadError;
use super::stream::Stream;
use crate::space::LabelVolume;

pub use self::elements::{
    DataSet, Element, ElementValue, ElementsError, ElementsReader, MAX_SEQUENCE_BYTES, MAX_VALUE_BYTES, WINDOW_BYTES,
};
pub use self::error::{DicomError, DicomFault};
pub use self::identity::{IDENTITY_BYTES, Identity};
pub use self::tag::Tag;
pub use self::uid::Uid;

/// Bytes that [`sniff`] needs to see.
pub(in crate::formats) const SNIFF_BYTES: usize = PREAMBLE_BYTES;

/// Tells DICOM by its magic. Whether it is a segmentation stands further on.
pub(in crate::formats) fn sniff(head: &[u8]) -> Sniffed {
    let is_own = head.get(..PREAMBLE_BYTES).is_some_and(|head| head.ends_with(MAGIC));
    if is_own { Sniffed::Own } else { Sniffed::Other }
}

/// Reads up to the pixels.
///
/// # Errors
/// When that alone shows that [`read`] will fail.
pub(in crate::formats) fn header(stream: &mut Stream<'_>, limits: InputLimits) -> Result<HeaderFacts, ReadError> {
    let (mut walk, transfer) = begin(stream, limits)?;
    let described = Described::read(&mut walk, limits.max_voxels, &mut Vec::new())?;
    check_frames(&described, limits)?;
    if transfer.pixels == Packing::Plain {
        begins_at_bytes(described.kind, described.plane, described.frames.len(), described.pixels)?;
    }
    let voxels = described.stack.dims.iter().product::<usize>() as u64;
    let is_compressed = walk.source.stream().is_compressed() || transfer.is_compressed();
    let voxel_mm = described.stack.world_from_voxel.voxel_volume_mm3().cbrt();
    Ok(HeaderFacts { voxels, voxel_mm, is_compressed })
}

/// Reads a segmentation to its end.
///
/// # Errors
/// When it is no segmentation of a volume, is damaged, or is larger than `limits`.
pub(in crate::formats) fn read(stream: &mut Stream<'_>, limits: InputLimits) -> Result<Found, ReadError> {
    let mut notices = Vec::new();
    let cancel = stream.cancel();
    let format = if stream.is_compressed() { "dicom_seg.gz" } else { "dicom_seg" };
    let (mut walk, transfer) = begin(stream, limits)?;
    let described = Described::read(&mut walk, limits.max_voxels, &mut notices)?;
    check_frames(&described, limits)?;
    let mut layers = Layers::new(described.stack.dims, limits.max_voxels, cancel);
    let pixels = (described.pixels, walk.syntax, transfer.pixels);
    let frames = Frames {
        kind: described.kind,
        plane: described.plane,
        frames: &described.frames,
        slice_of: &described.stack.slice_of,
        segments: &described.segments,
        background: described.background,
    };
    Painter::new(&frames, &mut layers).read(&mut walk.source, pixels, &mut notices)?;
    pass_rest(&mut walk)?;
    let mut segments = described.segments;
    segments.tell(&mut notices);
    let (grids, labels) = layers.finish(&mut segments, &mut notices)?;
    let volume = LabelVolume::new_while(grids, labels, described.stack.world_from_voxel, cancel)?;
    let volume = volume.with_added_slices(SLICES).with_notices(notices);
    Ok(Found { volume, format, origin: Some(described.origin) })
}

fn begin<'s, 'f>(stream: &'s mut Stream<'f>, limits: InputLimits) -> Result<(Walk<'s, 'f>, Transfer), ReadError> {
    let mut source = Source::new(stream, limits.max_decompressed_bytes);
    let transfer = read_transfer(&mut source)?;
    if transfer.is_deflated {
        source.inflate();
    }
    Ok((Walk::new(source, transfer.elements), transfer))
}

/// Refuses frames that have more bytes together than may be decompressed: each is small where it is compressed by itself.
fn check_frames(described: &Described, limits: InputLimits) -> Result<(), ReadError> {
    let bytes = described.kind.frame_bytes(described.plane) as u64 * described.frames.len() as u64;
    let limit = limits.max_decompressed_bytes;
    if bytes > limit { Err(ReadError::DecompressedTooLarge { limit }) } else { Ok(()) }
}

/// Reads what follows the pixels: a length beyond the end of the file shows there.
fn pass_rest(walk: &mut Walk<'_, '_>) -> Result<(), ReadError> {
    while walk.next()?.is_some() {}
    Ok(())
}
