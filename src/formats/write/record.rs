//! A result as it is kept: everything that any artifact is made from, exactly. An artifact that was not asked for
//! when the job ran is made from it later, and has the bytes that it would have had.
//!
//! MessagePack with names, so that a later version of the program reads it when fields were added, between the version and
//! a hash of both: a bit that turned over in a number could not be told otherwise.

use std::io::{self, Read, Write};

use serde::{Deserialize, Serialize};
use sha2::{Digest, Sha256};

use super::thickness::{InputFacts, OuterTimings};
use crate::formats::dicom_origin::DicomOrigin;
use crate::formats::params_json::{self, ParamsJsonError, params_to_json};
use crate::model::{Model, Warning};

/// Version of what is written.
const VERSION: u32 = 2;
/// Version of what was written without a hash, which is read too.
const UNHASHED: u32 = 1;
/// Bytes of the hash.
const HASH_BYTES: usize = 32;

/// A model with what the artifacts say of its file and its run.
#[derive(Clone, Debug)]
pub struct Record {
    /// The result.
    pub model: Model,
    /// The file that it was made from.
    pub input: InputFacts,
    /// The reader's warnings.
    pub warnings: Vec<Warning>,
    /// How long it took.
    pub timings: OuterTimings,
    /// When the run ended, seconds since 1970 in UTC; `None` in records of before this was kept.
    pub ended_unix_s: Option<i64>,
    /// What DICOM results take over from the object that the mask came in.
    pub dicom: Option<DicomOrigin>,
}

/// Why bytes are no record.
#[derive(Debug, thiserror::Error)]
pub enum RecordError {
    /// They cannot be read, or are damaged.
    #[error("the stored record is damaged: {0}")]
    Damaged(#[from] rmp_serde::decode::Error),
    /// A version of the program wrote them whose records are not read any more.
    #[error("the stored record has version {found}, this program reads {VERSION}")]
    Version {
        /// Its version.
        found: u32,
    },
    /// Its parameters are none.
    #[error("the stored record is damaged: {0}")]
    Params(#[from] ParamsJsonError),
}

/// Hashes what is written, and keeps the error of writing: the encoder hands it on without its kind, and a full disk is
/// to be told as one.
struct Told<W> {
    out: W,
    hash: Sha256,
    error: Option<io::Error>,
}

impl<W: Write> Write for Told<W> {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        match self.out.write(bytes) {
            Ok(written) => {
                self.hash.update(&bytes[..written]);
                Ok(written)
            }
            Err(error) => {
                let kind = error.kind();
                if kind != io::ErrorKind::Interrupted {
                    self.error = Some(error);
                }
                Err(kind.into())
            }
        }
    }

    fn flush(&mut self) -> io::Result<()> {
        self.out.flush()
    }
}

#[derive(Serialize)]
struct Written<'a> {
    params: String,
    input: &'a InputFacts,
    warnings: &'a [Warning],
    timings: OuterTimings,
    ended_unix_s: Option<i64>,
    dicom: Option<&'a DicomOrigin>,
    model: &'a Model,
}

#[derive(Deserialize)]
struct Kept {
    params: String,
    input: InputFacts,
    warnings: Vec<Warning>,
    timings: OuterTimings,
    #[serde(default)]
    ended_unix_s: Option<i64>,
    #[serde(default)]
    dicom: Option<DicomOrigin>,
    model: Model,
}

impl Record {
    /// Writes it.
    ///
    /// # Errors
    /// When writing fails.
    pub fn write(&self, out: impl Write) -> io::Result<()> {
        let written = Written {
            params: params_to_json(&self.model.params).to_string(),
            input: &self.input,
            warnings: &self.warnings,
            timings: self.timings,
            ended_unix_s: self.ended_unix_s,
            dicom: self.dicom.as_ref(),
            model: &self.model,
        };
        let mut told = Told { out, hash: Sha256::new(), error: None };
        told.write_all(&VERSION.to_be_bytes())?;
        let result = rmp_serde::encode::write_named(&mut told, &written);
        match (result, told.error) {
            (Ok(()), _) => told.out.write_all(&told.hash.finalize()),
            (Err(_), Some(error)) => Err(error),
            (Err(error), None) => Err(io::Error::other(error)),
        }
    }

    /// Reads one.
    ///
    /// # Errors
    /// When it is damaged or of another version.
    pub fn read(mut source: impl Read) -> Result<Self, RecordError> {
        let mut bytes = Vec::new();
        source.read_to_end(&mut bytes).map_err(rmp_serde::decode::Error::InvalidDataRead)?;
        let kept: Kept = rmp_serde::from_slice(content(&bytes)?)?;
        let params = params_json::parse(kept.params.as_bytes())?;
        Ok(Self {
            model: Model { params, ..kept.model },
            input: kept.input,
            warnings: kept.warnings,
            timings: kept.timings,
            ended_unix_s: kept.ended_unix_s,
            dicom: kept.dicom,
        })
    }
}

/// What is said of bytes that are not those that were written.
fn damaged() -> RecordError {
    rmp_serde::decode::Error::Uncategorized("its hash is another".to_owned()).into()
}

/// What lies between the version and the hash.
fn content(bytes: &[u8]) -> Result<&[u8], RecordError> {
    let (version, rest) = bytes.split_first_chunk().ok_or_else(damaged)?;
    match u32::from_be_bytes(*version) {
        UNHASHED => Ok(rest),
        VERSION => {
            let (content, hash) = rest.split_last_chunk::<HASH_BYTES>().ok_or_else(damaged)?;
            let hashed = &bytes[..bytes.len() - HASH_BYTES];
            if Sha256::digest(hashed)[..] == hash[..] { Ok(content) } else { Err(damaged()) }
        }
        found => Err(RecordError::Version { found }),
    }
}
