//! NIfTI → label map. Nothing in a header makes the reader reserve memory, panic or open
//! another file: fields are checked before they are used, memory grows with what arrives, and
//! voxels are decoded while they are decompressed.

use std::fs::File;
use std::io::Read;
use std::path::Path;

use super::nifti_affine::world_from_voxel;
use super::nifti_header::{Layout, RawHeader};
use super::nifti_voxels::{Voxels, read_voxels};
use super::read_error::ReadError;
use super::sniff::{GZIP_MAGIC, SNIFF_BYTES, Version, sniff};
use super::stream::Stream;
use crate::cancel::{Cancel, Never};
use crate::space::{Grid, LabelVolume, VolumeNotice};

/// Bytes tolerated after the last voxel: some tools pad or append. More means that the header
/// does not describe the file.
const MAX_TAIL_BYTES: u64 = 1 << 20;

/// Bounds on what a file may ask of the machine.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct InputLimits {
    /// Voxels of the volume.
    pub max_voxels: u64,
    /// Bytes after decompression.
    pub max_decompressed_bytes: u64,
}

impl Default for InputLimits {
    fn default() -> Self {
        Self { max_voxels: 1 << 29, max_decompressed_bytes: 4 << 30 }
    }
}

/// A file that was read.
#[derive(Clone, Debug)]
pub struct ReadVolume {
    /// The label map.
    pub volume: LabelVolume,
    /// SHA-256 of the file's bytes as they were sent, lower-case hex.
    pub sha256: String,
    /// Bytes of the file as sent.
    pub bytes: u64,
    /// `nifti1`, `nifti1.gz`, `nifti2` or `nifti2.gz`.
    pub format: &'static str,
}

/// Reads the file at `path`. `cancel` is asked every few hundred kilobytes.
///
/// # Errors
/// As [`read`], and those of `cancel`.
pub fn read_file(path: &Path, limits: InputLimits, cancel: &dyn Cancel) -> Result<ReadVolume, ReadError> {
    read_while(File::open(path).map_err(ReadError::Io)?, limits, cancel)
}

/// Reads a NIfTI-1 or NIfTI-2 file, plain or gzip.
///
/// # Errors
/// When it is no single-volume label map, is damaged, or is larger than `limits`.
pub fn read(source: impl Read, limits: InputLimits) -> Result<ReadVolume, ReadError> {
    read_while(source, limits, &Never)
}

fn read_while(source: impl Read, limits: InputLimits, cancel: &dyn Cancel) -> Result<ReadVolume, ReadError> {
    let mut stream = Stream::open(source, limits.max_decompressed_bytes, cancel)?;
    let (raw, layout, version) = read_header(&mut stream, limits)?;
    let mut notices = Vec::new();
    let world_from_voxel = world_from_voxel(&raw, layout.dims, &mut notices)?;
    skip_to_voxels(&mut stream, &layout)?;
    let voxels = read_voxels(&mut stream, &layout)?;
    drain(&mut stream)?;
    let format = format_name(version, stream.is_compressed());
    let digested = stream.finish();
    let Voxels { indices, label_values, label_voxels, nan_voxels } = voxels;
    if nan_voxels > 0 {
        let message = format!("{nan_voxels} voxels are NaN; they were taken as background");
        notices.push(VolumeNotice { code: "nan_voxels", message });
    }
    let indices = Grid::from_vec(layout.dims, indices).expect("exactly that many voxels were read");
    let volume = LabelVolume { indices, label_values, label_voxels, world_from_voxel, notices };
    Ok(ReadVolume { volume, sha256: digested.sha256, bytes: digested.bytes, format })
}

/// Bytes of a file that [`check_magic`] needs to see.
pub const MAGIC_BYTES: usize = SNIFF_BYTES;

/// Looks at the first [`MAGIC_BYTES`] of a file, or at all of a shorter one. Gzip passes: what is
/// in it is not looked at.
///
/// # Errors
/// When it is no NIfTI file.
pub fn check_magic(head: &[u8]) -> Result<(), ReadError> {
    if head.starts_with(&GZIP_MAGIC) { Ok(()) } else { sniff(head).map(|_| ()) }
}

/// What a header says of the work that a file is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct HeaderFacts {
    /// Voxels of the volume.
    pub voxels: u64,
    /// Whether the file is gzip.
    pub is_compressed: bool,
}

/// Reads no further than the header of the file at `path`.
///
/// # Errors
/// When the header alone shows that [`read`] will fail.
pub fn check_header(path: &Path, limits: InputLimits) -> Result<HeaderFacts, ReadError> {
    let file = File::open(path).map_err(ReadError::Io)?;
    let mut stream = Stream::open(file, limits.max_decompressed_bytes, &Never)?;
    let (raw, layout, _) = read_header(&mut stream, limits)?;
    world_from_voxel(&raw, layout.dims, &mut Vec::new())?;
    Ok(HeaderFacts { voxels: layout.voxels as u64, is_compressed: stream.is_compressed() })
}

fn read_header<R: Read>(
    stream: &mut Stream<'_, R>,
    limits: InputLimits,
) -> Result<(RawHeader, Layout, Version), ReadError> {
    let mut bytes = [0; 540];
    let got = stream.fill(&mut bytes[..SNIFF_BYTES])?;
    let kind = sniff(&bytes[..got])?;
    let needed = kind.version.header_bytes();
    let got = got + stream.fill(&mut bytes[SNIFF_BYTES..needed])?;
    if got < needed {
        return Err(ReadError::Truncated { expected: needed as u64, got: got as u64 });
    }
    let raw = RawHeader::parse(&bytes[..needed], kind)?;
    let layout = Layout::check(&raw, kind, limits.max_voxels)?;
    Ok((raw, layout, kind.version))
}

fn skip_to_voxels<R: Read>(stream: &mut Stream<'_, R>, layout: &Layout) -> Result<(), ReadError> {
    let gap = layout.offset - stream.position();
    if stream.skip(gap)? < gap {
        let expected = layout.offset + (layout.voxels * layout.datatype.bytes()) as u64;
        return Err(ReadError::Truncated { expected, got: stream.position() });
    }
    Ok(())
}

/// Reads to the end: only then has gzip compared its checksum, and is the hash that of the
/// whole file.
fn drain<R: Read>(stream: &mut Stream<'_, R>) -> Result<(), ReadError> {
    let expected = stream.position();
    if stream.skip(MAX_TAIL_BYTES + 1)? > MAX_TAIL_BYTES {
        return Err(ReadError::TrailingData { expected, allowed: MAX_TAIL_BYTES });
    }
    Ok(())
}

fn format_name(version: Version, compressed: bool) -> &'static str {
    match (version, compressed) {
        (Version::Nifti1, false) => "nifti1",
        (Version::Nifti1, true) => "nifti1.gz",
        (Version::Nifti2, false) => "nifti2",
        (Version::Nifti2, true) => "nifti2.gz",
    }
}
