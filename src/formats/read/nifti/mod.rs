//! NIfTI → label map. Nothing in a header makes the reader reserve memory, panic or open
//! another file: fields are checked before they are used, memory grows with what arrives, and
//! voxels are decoded while they are decompressed. In the order of the file.

mod kind;

mod header;

mod layout;

mod affine;

mod orientations;

mod extensions;

mod label_table;

use self::affine::world_from_voxel;
use self::extensions::read_extensions;
use self::header::RawHeader;
use self::kind::{Version, kind};
use self::layout::Layout;
use super::answers::{Found, HeaderFacts, InputLimits};
use super::error::ReadError;
use super::layers::{Segments, label_volume};
use super::stream::Stream;
use super::voxels::read_voxels;

pub(in crate::formats) use self::kind::{KIND_BYTES, sniff};

/// Reads no further than the header.
///
/// # Errors
/// When it alone shows that [`read`] will fail.
pub(in crate::formats) fn header(stream: &mut Stream<'_>, limits: InputLimits) -> Result<HeaderFacts, ReadError> {
    let (raw, layout, _) = read_header(stream, limits)?;
    let voxel_mm = world_from_voxel(&raw, layout.stored.dims, &mut Vec::new())?.voxel_volume_mm3().cbrt();
    Ok(HeaderFacts { voxels: layout.stored.voxels as u64, voxel_mm, is_compressed: stream.is_compressed() })
}

/// Reads a NIfTI-1 or NIfTI-2 file to its last voxel.
///
/// # Errors
/// When it is no single-volume label map, is damaged, or is larger than `limits`.
pub(in crate::formats) fn read(stream: &mut Stream<'_>, limits: InputLimits) -> Result<Found, ReadError> {
    let (raw, layout, version) = read_header(stream, limits)?;
    let mut notices = Vec::new();
    let world_from_voxel = world_from_voxel(&raw, layout.stored.dims, &mut notices)?;
    let table = read_extensions(stream, &layout, &mut notices)?;
    let voxels = read_voxels(stream, &layout.stored)?;
    let segments = Segments::of_values(table.labels);
    let volume = label_volume(voxels, &layout.stored, &segments, world_from_voxel, notices, stream.cancel())?;
    let format = format_name(version, stream.is_compressed());
    Ok(Found { volume, format, origin: None })
}

fn read_header(stream: &mut Stream<'_>, limits: InputLimits) -> Result<(RawHeader, Layout, Version), ReadError> {
    let mut bytes = [0; 540];
    let got = stream.fill(&mut bytes[..KIND_BYTES])?;
    // Of another format are only files that `sniff` did not take.
    let wrong = ReadError::Truncated { expected: KIND_BYTES as u64, got: got as u64 };
    let kind = kind(&bytes[..got])?.ok_or(wrong)?;
    let needed = kind.version.header_bytes();
    let got = got + stream.fill(&mut bytes[KIND_BYTES..needed])?;
    if got < needed {
        return Err(ReadError::Truncated { expected: needed as u64, got: got as u64 });
    }
    let raw = RawHeader::parse(&bytes[..needed], kind)?;
    let layout = Layout::check(&raw, kind, limits.max_voxels)?;
    Ok((raw, layout, kind.version))
}

fn format_name(version: Version, compressed: bool) -> &'static str {
    match (version, compressed) {
        (Version::Nifti1, false) => "nifti1",
        (Version::Nifti1, true) => "nifti1.gz",
        (Version::Nifti2, false) => "nifti2",
        (Version::Nifti2, true) => "nifti2.gz",
    }
}
