//! One mask from file to artifacts: read, run the pipeline, write. Synchronous; the service's
//! workers and `medialrep run` both call it.

use std::io;
use std::path::Path;
use std::time::Instant;

use rayon::prelude::*;
use serde::{Deserialize, Serialize};

pub use super::drafts::remove_files;
use super::drafts::{Drafts, RECORD, WrittenFile};
use super::processed::{Processed, StructureSummary};
use crate::cancel::{Cancel, Cancelled};
use crate::formats::artifacts::{ARTIFACTS, Artifact};
use crate::formats::dicom_origin::DicomOrigin;
use crate::formats::write::dicom::object_of;
use crate::formats::write::record::Record;
use crate::formats::write::thickness::{InputFacts, OuterTimings};
use crate::formats::{self, ReadError};
use crate::model::{Model, Stage, Warning};
use crate::params::CheckedParams;
use crate::pipeline::observer::Observer;
use crate::pipeline::{self, PipelineError};
use crate::problem::Problem;

pub use crate::formats::InputLimits;

/// What fails when a mask cannot be read.
pub const READING: &str = "reading the mask";
/// What fails when results cannot be written.
pub const WRITING: &str = "writing the results";

/// Why a mask was not processed.
#[derive(Debug)]
pub enum ProcessError {
    /// The observer asked to stop; nothing is left in the output folder.
    Cancelled,
    /// The file or the shape cannot be processed.
    Problem(Box<Problem>),
    /// Reading the mask or writing the results failed: the disk's fault or ours.
    Io {
        /// What failed.
        doing: &'static str,
        /// Why.
        error: io::Error,
    },
    /// The run crashed: our fault.
    Crashed {
        /// What is known of it.
        how: String,
    },
}

impl From<Problem> for ProcessError {
    fn from(problem: Problem) -> Self {
        Self::Problem(Box::new(problem))
    }
}

impl From<Cancelled> for ProcessError {
    fn from(_: Cancelled) -> Self {
        Self::Cancelled
    }
}

impl From<ReadError> for ProcessError {
    fn from(error: ReadError) -> Self {
        match error {
            ReadError::Cancelled(_) => Self::Cancelled,
            ReadError::Io(error) => Self::Io { doing: READING, error },
            error => Problem::from(&error).into(),
        }
    }
}

impl From<PipelineError> for ProcessError {
    fn from(error: PipelineError) -> Self {
        match error {
            PipelineError::Cancelled(_) => Self::Cancelled,
            PipelineError::Refused(refusal) => Problem::from(&refusal).into(),
        }
    }
}

impl From<io::Error> for ProcessError {
    fn from(error: io::Error) -> Self {
        if error.get_ref().is_some_and(|inner| inner.is::<Cancelled>()) {
            return Self::Cancelled;
        }
        Self::Io { doing: WRITING, error }
    }
}

/// What is kept of a result.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Kept {
    /// The artifacts that the parameters ask for.
    Artifacts,
    /// These, and the record that the others can be made from later.
    Record,
}

/// Reads the mask at `mask`, runs the pipeline and writes the artifacts asked for into the folder `out`
/// (which must exist). On an error none of the artifacts is left there, not even those of an
/// earlier run: they would be taken for the answer.
///
/// # Errors
/// When the file is refused, the shape has no medial representation, or the run is cancelled.
pub fn process(
    mask: &Path,
    params: &CheckedParams,
    limits: InputLimits,
    (out, keep): (&Path, Kept),
    observer: &dyn Observer,
) -> Result<Processed, ProcessError> {
    let start = Instant::now();
    remove_files(out);
    let read = formats::read_file(mask, limits, observer)?;
    let read_ms = milliseconds(start);
    let model = pipeline::run(&read.volume, params, observer)?;
    // The voxels are not needed any more, and there may be many of them.
    let notices = read.volume.into_notices();
    let warnings = notices.into_iter().map(|n| Warning { code: n.code.into(), message: n.message }).collect();
    let input = InputFacts { sha256: read.sha256, format: read.format.to_owned() };
    publish(model, Source { input, warnings, dicom: read.origin, start, read_ms }, (out, keep), observer)
}

/// What the artifacts say of the file and the run.
#[derive(Clone, Debug)]
pub struct Source {
    /// The file.
    pub input: InputFacts,
    /// The reader's warnings.
    pub warnings: Vec<Warning>,
    /// What results take over from the DICOM object that it is; `None` of other formats.
    pub dicom: Option<DicomOrigin>,
    /// When the run began.
    pub start: Instant,
    /// Milliseconds that reading took.
    pub read_ms: f64,
}

/// Writes the artifacts of `model` into the folder `out`: all of them or, on an error, none.
///
/// # Errors
/// When writing fails or the run is cancelled.
pub fn publish(
    model: Model,
    source: Source,
    (out, keep): (&Path, Kept),
    cancel: &dyn Cancel,
) -> Result<Processed, ProcessError> {
    let write_start = Instant::now();
    let drafts = Drafts::within(out, cancel);
    let timings = OuterTimings { read_ms: source.read_ms, ..OuterTimings::default() };
    let Source { input, warnings, dicom, .. } = source;
    let ended_unix_s = Some(jiff::Timestamp::now().as_second());
    let mut record = Record { model, input, warnings, timings, ended_unix_s, dicom };
    let (late, early): (Vec<&Artifact>, Vec<&Artifact>) =
        asked(&record.model.params).into_iter().partition(|artifact| artifact.tells_time);
    let early = early.par_iter().map(|artifact| write(&drafts, artifact, &record));
    let mut files = early.collect::<io::Result<Vec<WrittenFile>>>()?;
    record.timings.write_ms = milliseconds(write_start);
    record.timings.total_ms = milliseconds(source.start);
    for artifact in late {
        files.push(write(&drafts, artifact, &record)?);
    }
    files.sort_by_key(|file| ARTIFACTS.iter().position(|artifact| artifact.name == file.name));
    if keep == Kept::Record {
        files.push(drafts.write(RECORD, |out| record.write(out))?);
    }
    drafts.complete(&files)?;
    Ok(processed(&record, files))
}

/// The artifacts that parameters ask for, in the order of the contract.
fn asked(params: &CheckedParams) -> Vec<&'static Artifact> {
    const ALL: &[Artifact] = &ARTIFACTS;
    ALL.iter().filter(|artifact| params.outputs.contains(&artifact.name)).collect()
}

fn write(drafts: &Drafts<'_>, artifact: &Artifact, record: &Record) -> io::Result<WrittenFile> {
    let file = drafts.write((artifact.name, artifact.media_type), |out| (artifact.write)(record, out))?;
    Ok(WrittenFile { dicom: object_of(record, artifact.name), ..file })
}

fn processed(record: &Record, files: Vec<WrittenFile>) -> Processed {
    let structures = &record.model.structures;
    let mut warnings = record.warnings.clone();
    for structure in structures {
        warnings.extend_from_slice(&structure.warnings);
    }
    Processed {
        files,
        warnings,
        stage_seconds: stage_seconds(&record.model),
        structures: structures.iter().map(StructureSummary::from).collect(),
    }
}

fn stage_seconds(model: &Model) -> Vec<(Stage, f64)> {
    let of = |stage| model.structures.iter().map(|structure| structure.timings.of(stage)).sum::<f64>() / 1e3;
    Stage::ALL.map(|stage| (stage, of(stage))).to_vec()
}

/// Writes one more artifact of a stored result into the folder `out`.
///
/// # Errors
/// When writing fails.
pub fn make(
    record: &Record,
    artifact: &Artifact,
    out: &Path,
    cancel: &dyn Cancel,
) -> Result<WrittenFile, ProcessError> {
    let drafts = Drafts::within(out, cancel);
    let file = write(&drafts, artifact, record)?;
    drafts.complete(std::slice::from_ref(&file))?;
    Ok(file)
}

fn milliseconds(since: Instant) -> f64 {
    since.elapsed().as_secs_f64() * 1e3
}
