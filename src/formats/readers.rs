//! The formats that are read, one entry each, and how a file finds its reader.

use std::fs::File;
use std::io::Read;
use std::path::Path;

use super::dicom_origin::DicomOrigin;
use super::read::answers::{Found, Sniffed};
use super::read::sniff::{GZIP_MAGIC, guess};
use super::read::stream::Stream;
use super::read::{HeaderFacts, InputLimits, ReadError, dicom, metaimage, nifti, nrrd};
use crate::cancel::{Cancel, Never};
use crate::space::LabelVolume;

/// A format that is read. Gzip around a file is undone before a reader sees it.
pub struct Reader {
    /// What the format is called.
    pub name: &'static str,
    /// What it is called with its versions, each of which is read.
    pub versions: &'static [&'static str],
    /// What the names of its files end in.
    pub endings: &'static [&'static str],
    /// Tells it by the first [`MAGIC_BYTES`] of a file, or by all of a shorter one.
    sniff: fn(&[u8]) -> Sniffed,
    /// Reads no further than the header.
    header: fn(&mut Stream<'_>, InputLimits) -> Result<HeaderFacts, ReadError>,
    /// Reads to the last voxel.
    read: fn(&mut Stream<'_>, InputLimits) -> Result<Found, ReadError>,
}

/// All of them, in the order in which they are asked.
pub static READERS: &[Reader] = &[
    Reader {
        name: "NIfTI",
        versions: &["NIfTI-1", "NIfTI-2"],
        endings: &[".nii", ".nii.gz"],
        sniff: nifti::sniff,
        header: nifti::header,
        read: nifti::read,
    },
    Reader {
        name: "DICOM SEG",
        versions: &["DICOM SEG"],
        endings: &[".dcm"],
        sniff: dicom::sniff,
        header: dicom::header,
        read: dicom::read,
    },
    Reader {
        name: "NRRD",
        versions: &["NRRD"],
        endings: &[".nrrd", ".seg.nrrd"],
        sniff: nrrd::sniff,
        header: nrrd::header,
        read: nrrd::read,
    },
    Reader {
        name: "MetaImage",
        versions: &["MetaImage"],
        endings: &[".mha"],
        sniff: metaimage::sniff,
        header: metaimage::header,
        read: metaimage::read,
    },
];

/// Bytes of a file that [`check_magic`] needs to see: as many as the most curious reader.
pub const MAGIC_BYTES: usize = most(nifti::KIND_BYTES, dicom::SNIFF_BYTES);

const fn most(a: usize, b: usize) -> usize {
    if a > b { a } else { b }
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
    /// The format with its version and packing: `nifti1`, `nifti1.gz`, `nrrd`, `dicom_seg`, ….
    pub format: &'static str,
    /// What results take over of a DICOM file.
    pub origin: Option<DicomOrigin>,
}

/// Reads the file at `path`. `cancel` is asked every few hundred kilobytes.
///
/// # Errors
/// As [`read`], and those of `cancel`.
pub fn read_file(path: &Path, limits: InputLimits, cancel: &dyn Cancel) -> Result<ReadVolume, ReadError> {
    read_while(File::open(path).map_err(ReadError::Io)?, limits, cancel)
}

/// Reads a file of any format of [`READERS`], plain or gzip.
///
/// # Errors
/// When it is no single-volume label map, is damaged, or is larger than `limits`.
pub fn read(source: impl Read, limits: InputLimits) -> Result<ReadVolume, ReadError> {
    read_while(source, limits, &Never)
}

fn read_while(source: impl Read, limits: InputLimits, cancel: &dyn Cancel) -> Result<ReadVolume, ReadError> {
    let mut stream = Stream::open(source, limits.max_decompressed_bytes, cancel)?;
    let reader = reader_of(stream.peek(MAGIC_BYTES)?)?;
    let Found { mut volume, format, origin } =
        (reader.read)(&mut stream, limits).map_err(|error| explain(error, &stream))?;
    stream.drain()?;
    volume = volume.with_notices(stream.foreign_notice());
    let digested = stream.finish();
    Ok(ReadVolume { volume, sha256: digested.sha256, bytes: digested.bytes, format, origin })
}

/// A file that ends early where gzip gave way to something else is no shorter than it should be: it is damaged there.
fn explain(error: ReadError, stream: &Stream<'_>) -> ReadError {
    match error {
        ReadError::Truncated { got, .. } if stream.foreign() > 0 => ReadError::CorruptGzip { after: got },
        error => error,
    }
}

/// Looks at the first [`MAGIC_BYTES`] of a file, or at all of a shorter one. Gzip passes: what is
/// in it is not looked at.
///
/// # Errors
/// When no reader takes it.
pub fn check_magic(head: &[u8]) -> Result<(), ReadError> {
    if head.starts_with(&GZIP_MAGIC) { Ok(()) } else { reader_of(head).map(|_| ()) }
}

/// Reads no further than the header of the file at `path`.
///
/// # Errors
/// When the header alone shows that [`read`] will fail.
pub fn check_header(path: &Path, limits: InputLimits) -> Result<HeaderFacts, ReadError> {
    let file = File::open(path).map_err(ReadError::Io)?;
    let mut stream = Stream::open(file, limits.max_decompressed_bytes, &Never)?;
    let reader = reader_of(stream.peek(MAGIC_BYTES)?)?;
    (reader.header)(&mut stream, limits)
}

/// The reader that takes a file with these first bytes.
fn reader_of(head: &[u8]) -> Result<&'static Reader, ReadError> {
    for reader in READERS {
        match (reader.sniff)(head) {
            Sniffed::Own => return Ok(reader),
            Sniffed::Refused(error) => return Err(error),
            Sniffed::Other => {}
        }
    }
    Err(ReadError::UnknownFormat { looks_like: guess(head), read: names(), read_from: names_with_endings() })
}

/// `NIfTI`, and what else there is.
fn names() -> String {
    alternatives(&READERS.iter().map(|reader| reader.name.to_owned()).collect::<Vec<_>>())
}

/// `NIfTI (.nii or .nii.gz)`, and what else there is.
fn names_with_endings() -> String {
    let each = READERS.iter().map(|reader| format!("{} ({})", reader.name, reader.endings.join(" or ")));
    alternatives(&each.collect::<Vec<_>>())
}

/// `a, b or c`.
fn alternatives(all: &[String]) -> String {
    match all {
        [first @ .., last] if !first.is_empty() => format!("{} or {last}", first.join(", ")),
        _ => all.join(""),
    }
}

/// Every version that is read: `NIfTI-1 (.nii, .nii.gz)`.
#[must_use]
pub fn versions_with_endings() -> Vec<String> {
    let mut all = Vec::new();
    for reader in READERS {
        let endings = reader.endings.join(", ");
        all.extend(reader.versions.iter().map(|version| format!("{version} ({endings})")));
    }
    all
}

/// Every version that is read, in a sentence: `NIfTI-1, NIfTI-2 or DICOM SEG`.
#[must_use]
pub fn versions() -> String {
    let all = READERS.iter().flat_map(|reader| reader.versions).map(|version| (*version).to_owned());
    alternatives(&all.collect::<Vec<_>>())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_no_reader_takes_is_refused_with_what_is_read() {
        let error = check_magic(b"{}").unwrap_err();
        assert_eq!(
            error.to_string(),
            "the file is not a NIfTI, DICOM SEG, NRRD or MetaImage image: it looks like JSON"
        );
        assert_eq!(
            error.hint(),
            "send the mask as NIfTI (.nii or .nii.gz), DICOM SEG (.dcm), NRRD (.nrrd or .seg.nrrd) or MetaImage (.mha)"
        );
        let error = check_magic(b"version https://git-lfs.github.com/spec/v1\n").unwrap_err();
        let hint = "fetch the file itself (git lfs pull), and send the mask as NIfTI";
        assert!(error.hint().starts_with(hint), "{}", error.hint());
    }
}
