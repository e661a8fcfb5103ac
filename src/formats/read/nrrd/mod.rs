//! NRRD → label map, with the segments that 3D Slicer describes in it (`.seg.nrrd`). The header is text, and nothing in
//! it makes the reader reserve memory or open another file. In the order of the file.

mod header;

mod segments;

mod layout;

mod vectors;

mod place;

use self::header::{Header, is_magic};
use self::layout::Layout;
use self::place::world_from_voxel;
use super::answers::{Found, HeaderFacts, InputLimits, Sniffed};
use super::body::read_body;
use super::error::ReadError;
use super::layers::label_volume;
use super::lines::LineFault;
use super::stored::Packing;
use super::stream::Stream;

/// Whether a file is one.
pub(in crate::formats) fn sniff(head: &[u8]) -> Sniffed {
    let first = head.split(|byte| *byte == b'\n').next().unwrap_or_default();
    if is_magic(first) {
        return Sniffed::Own;
    }
    if !first.starts_with(b"NRRD00") {
        return Sniffed::Other;
    }
    let hint = "save it as NRRD0005 or earlier";
    let fault = LineFault::Unsupported { what: "a version of NRRD other than 1 to 5", hint };
    Sniffed::Refused(ReadError::HeaderLine { line: 1, field: "", fault })
}

/// Reads no further than the header.
///
/// # Errors
/// When it alone shows that [`read`] will fail.
pub(in crate::formats) fn header(stream: &mut Stream<'_>, limits: InputLimits) -> Result<HeaderFacts, ReadError> {
    let header = Header::read(stream)?;
    let layout = Layout::check(&header, limits.max_voxels)?;
    let voxel_mm = world_from_voxel(&header, &layout, &mut Vec::new())?.voxel_volume_mm3().cbrt();
    let is_compressed = stream.is_compressed() || layout.packing == Packing::Deflated;
    Ok(HeaderFacts { voxels: layout.stored.voxels as u64, voxel_mm, is_compressed })
}

/// Reads a NRRD file to its last voxel.
///
/// # Errors
/// When it is no label map, is damaged, is larger than `limits`, or its voxels are in another file.
pub(in crate::formats) fn read(stream: &mut Stream<'_>, limits: InputLimits) -> Result<Found, ReadError> {
    let header = Header::read(stream)?;
    let layout = Layout::check(&header, limits.max_voxels)?;
    let mut notices = Vec::new();
    let world_from_voxel = world_from_voxel(&header, &layout, &mut notices)?;
    layout.skip_lines(stream)?;
    let Layout { stored, packing, skipped_bytes, .. } = layout;
    let voxels = read_body(stream, &stored, packing, skipped_bytes, limits, &mut notices)?;
    let segments = header.segments.of_layers(stored.layers.count, &mut notices);
    let volume = label_volume(voxels, &stored, &segments, world_from_voxel, notices, stream.cancel())?;
    let format = if stream.is_compressed() { "nrrd.gz" } else { "nrrd" };
    Ok(Found { volume, format, origin: None })
}
