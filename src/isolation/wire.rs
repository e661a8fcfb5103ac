//! What a process and its child say to each other: frames of MessagePack, each after its length.

use std::io::{self, Read, Write};
use std::path::PathBuf;
use std::time::Duration;

use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};

use crate::formats::InputLimits;
use crate::formats::artifacts::ARTIFACTS;
use crate::formats::dicom_object::DicomObject;
use crate::jobs::process::{Kept, ProcessError, READING, WRITING};
use crate::jobs::processed::{Processed, RECORD, StructureSummary, WrittenFile};
use crate::model::{Stage, Warning};
use crate::problem::Problem;

/// Longest frame: what is said of 65535 structures takes 20 MB.
const MOST_BYTES: u32 = 256 << 20;

/// One run.
#[derive(Debug, Serialize, Deserialize)]
pub(super) struct Request {
    pub mask: PathBuf,
    /// The parameters, as JSON.
    pub params: String,
    pub limits: InputLimits,
    pub out: PathBuf,
    pub keep: Kept,
    /// Memory that it may take.
    pub share_bytes: u64,
    /// Memory that any run may take: what is refused because it needs more does not depend on what else runs.
    pub memory_bytes: u64,
    /// Processor time that is left for it.
    pub cpu: Duration,
    /// Processor time for all tries of it.
    pub cpu_of_size: Duration,
}

/// What a child says.
#[derive(Debug, Serialize, Deserialize)]
pub(super) enum Told {
    Begun(Vec<u64>),
    Progress {
        structure: usize,
        structures: usize,
        stage: Stage,
        fraction: f64,
    },
    Repeated {
        structure: usize,
        structures: usize,
        done: usize,
        repeats: usize,
    },
    Ended {
        structure: usize,
        structures: usize,
    },
    /// The run is over. With the memory that the child keeps.
    Done {
        outcome: Outcome,
        kept_bytes: u64,
    },
}

/// How a run ended.
#[derive(Debug, Serialize, Deserialize)]
pub(super) enum Outcome {
    Processed {
        files: Vec<File>,
        warnings: Vec<Warning>,
        stages: Vec<(Stage, f64)>,
        structures: Vec<StructureSummary>,
    },
    Problem(Box<Problem>),
    Io {
        doing: Doing,
        os_error: Option<i32>,
        message: String,
    },
    OutOfTime,
    /// With the place.
    Panicked(Option<String>),
}

impl Outcome {
    pub fn of(result: Result<Processed, ProcessError>) -> Self {
        match result {
            Ok(Processed { files, warnings, stage_seconds, structures }) => {
                let files = files.into_iter().map(File::from).collect();
                Self::Processed { files, warnings, stages: stage_seconds, structures }
            }
            Err(ProcessError::Problem(problem)) => Self::Problem(problem),
            Err(ProcessError::Io { doing, error }) => {
                Self::Io { doing: Doing::of(doing), os_error: error.raw_os_error(), message: error.to_string() }
            }
            Err(ProcessError::Crashed { how }) => Self::Panicked(Some(how)),
            // A child is told to stop by its clock alone.
            Err(ProcessError::Cancelled) => Self::OutOfTime,
        }
    }
}

/// A file that was written. Its name leads to its media type.
#[derive(Debug, Serialize, Deserialize)]
pub(super) struct File {
    name: String,
    bytes: u64,
    sha256: String,
    dicom: Option<DicomObject>,
}

impl From<WrittenFile> for File {
    fn from(file: WrittenFile) -> Self {
        Self { name: file.name.to_owned(), bytes: file.bytes, sha256: file.sha256, dicom: file.dicom }
    }
}

/// What failed.
#[derive(Debug, Serialize, Deserialize)]
pub(super) enum Doing {
    Reading,
    Writing,
}

impl Doing {
    fn of(doing: &str) -> Self {
        if doing == READING { Self::Reading } else { Self::Writing }
    }

    pub fn known(&self) -> &'static str {
        match self {
            Self::Reading => READING,
            Self::Writing => WRITING,
        }
    }
}

/// Files under the names that the program has for them.
pub(super) fn written(files: Vec<File>) -> io::Result<Vec<WrittenFile>> {
    let mut known: Vec<(&str, &str)> = ARTIFACTS.iter().map(|artifact| (artifact.name, artifact.media_type)).collect();
    known.push(RECORD);
    let mut written = Vec::with_capacity(files.len());
    for File { name, bytes, sha256, dicom } in files {
        let (name, media_type) = *known
            .iter()
            .find(|(known, _)| *known == name)
            .ok_or_else(|| io::Error::new(io::ErrorKind::InvalidData, "a file of an unknown name"))?;
        written.push(WrittenFile { name, media_type, bytes, sha256, dicom });
    }
    Ok(written)
}

/// Writes a frame.
pub(super) fn send(mut out: impl Write, what: &impl Serialize) -> io::Result<()> {
    let mut frame = vec![0; 4];
    rmp_serde::encode::write_named(&mut frame, what).map_err(io::Error::other)?;
    let length = u32::try_from(frame.len() - 4).map_err(io::Error::other)?;
    frame[..4].copy_from_slice(&length.to_be_bytes());
    out.write_all(&frame)?;
    out.flush()
}

/// Reads a frame; `None` at the end.
pub(super) fn receive<T: DeserializeOwned>(mut source: impl Read) -> io::Result<Option<T>> {
    let mut length = [0; 4];
    match source.read_exact(&mut length) {
        Ok(()) => {}
        Err(error) if error.kind() == io::ErrorKind::UnexpectedEof => return Ok(None),
        Err(error) => return Err(error),
    }
    let length = u32::from_be_bytes(length);
    if length > MOST_BYTES {
        return Err(io::Error::new(io::ErrorKind::InvalidData, "a frame is too long"));
    }
    let mut frame = Vec::new();
    let read = source.take(length.into()).read_to_end(&mut frame)?;
    if read < length as usize {
        return Ok(None);
    }
    rmp_serde::from_slice(&frame).map(Some).map_err(io::Error::other)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn frames_are_read_as_they_were_written_and_a_cut_one_is_an_end() {
        let mut bytes = Vec::new();
        send(&mut bytes, &Told::Begun(vec![3, 4])).unwrap();
        send(&mut bytes, &Told::Ended { structure: 1, structures: 2 }).unwrap();
        let mut source = &bytes[..];
        assert!(matches!(receive(&mut source).unwrap(), Some(Told::Begun(voxels)) if voxels == [3, 4]));
        assert!(matches!(receive(&mut source).unwrap(), Some(Told::Ended { structure: 1, structures: 2 })));
        assert!(receive::<Told>(&mut source).unwrap().is_none());
        assert!(receive::<Told>(&bytes[..6]).unwrap().is_none());
        assert!(receive::<Told>(&[0xFF; 8][..]).is_err());
    }
}
