//! Files of a result on their way to disk: all of them or none.

use std::fs::File;
use std::io::{self, BufWriter, Write};
use std::path::{Path, PathBuf};

use sha2::{Digest, Sha256};

use crate::cancel::{Cancel, Never};
use crate::formats::artifacts::ARTIFACTS;
use crate::formats::dicom_object::DicomObject;
use crate::formats::hex;

/// Name and media type of the record that further artifacts are made from. It is no artifact: nobody takes it away.
pub const RECORD: (&str, &str) = ("record", "application/msgpack");

/// A file that was written.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct WrittenFile {
    /// File name.
    pub name: &'static str,
    /// Media type.
    pub media_type: &'static str,
    /// Size.
    pub bytes: u64,
    /// SHA-256 of the content, lower-case hex.
    pub sha256: String,
    /// Which object it is, where it is DICOM.
    pub dicom: Option<DicomObject>,
}

/// Files under temporary names until all are there; dropped before that, it removes them.
pub(super) struct Drafts<'a> {
    folder: &'a Path,
    cancel: &'a dyn Cancel,
    is_complete: bool,
}

impl<'a> Drafts<'a> {
    /// In a folder, which is there.
    pub fn within(folder: &'a Path, cancel: &'a dyn Cancel) -> Self {
        Self { folder, cancel, is_complete: false }
    }

    /// Writes a file of this name and media type.
    ///
    /// # Errors
    /// When writing fails; when it is cancelled.
    pub fn write(
        &self,
        (name, media_type): (&'static str, &'static str),
        write: impl FnOnce(&mut dyn Write) -> io::Result<()>,
    ) -> io::Result<WrittenFile> {
        self.cancel.check().map_err(io::Error::other)?;
        let file = File::create(partial(self.folder, name))?;
        let mut hashed = Hashed { inner: file, cancel: self.cancel, hash: Sha256::new(), bytes: 0 };
        let mut buffered = BufWriter::with_capacity(1 << 16, &mut hashed);
        write(&mut buffered)?;
        buffered.flush()?;
        drop(buffered);
        Ok(WrittenFile { name, media_type, bytes: hashed.bytes, sha256: hex(&hashed.hash.finalize()), dicom: None })
    }

    /// Gives the files their names.
    ///
    /// # Errors
    /// When one cannot be renamed; when it is cancelled.
    pub fn complete(mut self, files: &[WrittenFile]) -> io::Result<()> {
        self.cancel.check().map_err(io::Error::other)?;
        for file in files {
            std::fs::rename(partial(self.folder, file.name), self.folder.join(file.name))?;
        }
        self.is_complete = true;
        Ok(())
    }
}

impl Drop for Drafts<'_> {
    fn drop(&mut self) {
        if !self.is_complete {
            remove_files(self.folder);
        }
    }
}

fn partial(folder: &Path, name: &str) -> PathBuf {
    folder.join(format!(".{name}.partial"))
}

/// Removes every artifact and record from a folder. What cannot be removed is not there.
pub fn remove_files(folder: &Path) {
    for name in ARTIFACTS.iter().map(|artifact| artifact.name).chain([RECORD.0]) {
        let _ = std::fs::remove_file(partial(folder, name));
        let _ = std::fs::remove_file(folder.join(name));
    }
}

struct Hashed<'a, W> {
    inner: W,
    cancel: &'a dyn Cancel,
    hash: Sha256,
    bytes: u64,
}

impl<W: Write> Write for Hashed<'_, W> {
    /// Ends with [`Cancelled`] once it is to stop.
    fn write(&mut self, buffer: &[u8]) -> io::Result<usize> {
        self.cancel.check().map_err(io::Error::other)?;
        let count = self.inner.write(buffer)?;
        self.hash.update(&buffer[..count]);
        self.bytes += count as u64;
        Ok(count)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.inner.flush()
    }
}

/// SHA-256 of a file's content, lower-case hex.
///
/// # Errors
/// When it cannot be read.
pub fn sha256_of_file(path: &Path) -> io::Result<String> {
    let mut hash = Hashed { inner: io::sink(), cancel: &Never, hash: Sha256::new(), bytes: 0 };
    io::copy(&mut File::open(path)?, &mut hash)?;
    Ok(hex(&hash.hash.finalize()))
}
