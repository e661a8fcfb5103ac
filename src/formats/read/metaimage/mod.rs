//! MetaImage → label map, of single files (`.mha`). The header is text, and nothing in it makes the reader reserve
//! memory or open another file. In the order of the file.

mod header;

mod layout;

mod place;

use self::header::{looks_like_header, read_header};
use self::layout::Layout;
use self::place::world_from_voxel;
use super::answers::{Found, HeaderFacts, InputLimits, Sniffed};
use super::body::read_body;
use super::error::ReadError;
use super::layers::{Segments, label_volume};
use super::stored::Packing;
use super::stream::Stream;

/// Whether a file is one.
pub(in crate::formats) fn sniff(head: &[u8]) -> Sniffed {
    if looks_like_header(head) { Sniffed::Own } else { Sniffed::Other }
}

/// Reads no further than the header.
///
/// # Errors
/// When it alone shows that [`read`] will fail.
pub(in crate::formats) fn header(stream: &mut Stream<'_>, limits: InputLimits) -> Result<HeaderFacts, ReadError> {
    let fields = read_header(stream)?;
    let layout = Layout::check(&fields, limits.max_voxels)?;
    let voxel_mm = world_from_voxel(&fields, layout.rank, &mut Vec::new())?.voxel_volume_mm3().cbrt();
    let is_compressed = stream.is_compressed() || layout.packing == Packing::Deflated;
    Ok(HeaderFacts { voxels: layout.stored.voxels as u64, voxel_mm, is_compressed })
}

/// Reads a MetaImage file to its last voxel.
///
/// # Errors
/// When it is no single-volume label map, is damaged, is larger than `limits`, or its voxels are in another file.
pub(in crate::formats) fn read(stream: &mut Stream<'_>, limits: InputLimits) -> Result<Found, ReadError> {
    let fields = read_header(stream)?;
    let Layout { stored, packing, rank } = Layout::check(&fields, limits.max_voxels)?;
    let mut notices = Vec::new();
    let world_from_voxel = world_from_voxel(&fields, rank, &mut notices)?;
    let voxels = read_body(stream, &stored, packing, 0, limits, &mut notices)?;
    let segments = Segments::default();
    let volume = label_volume(voxels, &stored, &segments, world_from_voxel, notices, stream.cancel())?;
    let format = if stream.is_compressed() { "metaimage.gz" } else { "metaimage" };
    Ok(Found { volume, format, origin: None })
}
