//! Values after a header of text, as they are written into the file.

use super::answers::InputLimits;
use super::error::ReadError;
use super::stored::{ByteOrder, Packing, Stored};
use super::stream::Stream;
use super::text::TextValues;
use super::voxels::{Voxels, read_voxels};
use crate::space::VolumeNotice;

/// Reads all values, after `skipped` bytes that are none of them; where they are packed, of what is unpacked.
///
/// # Errors
/// When they end early, are damaged or are no labels, or when too much follows them.
pub(super) fn read_body(
    stream: &mut Stream<'_>,
    stored: &Stored,
    packing: Packing,
    skipped: u64,
    limits: InputLimits,
    notices: &mut Vec<VolumeNotice>,
) -> Result<Voxels, ReadError> {
    match packing {
        Packing::Raw => {
            skip(stream, skipped, stored)?;
            read_voxels(stream, stored)
        }
        Packing::Text => {
            skip(stream, skipped, stored)?;
            let stored = Stored { order: ByteOrder::Little, ..stored.clone() };
            read_voxels(&mut TextValues::of(stream, stored.datatype), &stored)
        }
        Packing::Deflated => {
            let mut unpacked = stream.unpacked(limits.max_decompressed_bytes)?;
            skip(&mut unpacked, skipped, stored)?;
            let voxels = read_voxels(&mut unpacked, stored)?;
            unpacked.drain()?;
            notices.extend(unpacked.foreign_notice());
            Ok(voxels)
        }
    }
}

fn skip(stream: &mut Stream<'_>, bytes: u64, stored: &Stored) -> Result<(), ReadError> {
    if stream.skip(bytes)? < bytes {
        return Err(ReadError::Truncated { expected: bytes.saturating_add(stored.bytes()), got: stream.position() });
    }
    Ok(())
}
