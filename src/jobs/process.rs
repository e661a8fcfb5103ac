//! One mask from file to artifacts: read, run the pipeline, write. Synchronous; the service's
//! workers and `medialrep run` both call it.

use std::fs::File;
use std::io::{self, BufWriter, Write};
use std::path::{Path, PathBuf};
use std::time::Instant;

use sha2::{Digest, Sha256};

use crate::cancel::Cancelled;
use crate::formats::thickness_json::{InputFacts, OuterTimings};
use crate::formats::{self, ReadError, glb, hex, tables, thickness_json};
use crate::model::{Model, Reason, Refusal, Stage, Structure, Verdict, Warning};
use crate::params::CheckedParams;
use crate::pipeline::observer::{Observer, Silent};
use crate::pipeline::{self, PipelineError};
use crate::problem::Problem;

pub use crate::formats::InputLimits;

/// Names and media types of the artifacts, in the order of the contract.
pub const ARTIFACTS: [(&str, &str); 4] = [
    ("model.glb", "model/gltf-binary"),
    ("thickness.json", "application/json"),
    ("thickness.csv", "text/csv"),
    ("points.csv", "text/csv"),
];

/// An artifact that was written.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Artifact {
    /// File name, as in the contract (`model.glb`).
    pub name: &'static str,
    /// Media type.
    pub media_type: &'static str,
    /// Size.
    pub bytes: u64,
    /// SHA-256 of the content, lower-case hex.
    pub sha256: String,
}

/// What became of a mask.
#[derive(Clone, Debug)]
pub struct Processed {
    /// The artifacts, in the order of the contract.
    pub artifacts: Vec<Artifact>,
    /// All warnings: of the reader and of every structure.
    pub warnings: Vec<Warning>,
    /// Seconds of each stage, of all structures together.
    pub stage_seconds: Vec<(Stage, f64)>,
    /// What became of each structure, in the order of the model.
    pub structures: Vec<StructureSummary>,
}

/// What became of one structure, in a few words.
#[derive(Clone, Debug, PartialEq)]
pub struct StructureSummary {
    /// Its value in the file.
    pub label: i64,
    /// What it is called, where that is known.
    pub name: Option<String>,
    /// What was measured, or why there is nothing to measure.
    pub found: Result<Measured, Refusal>,
}

/// A structure's representation, in a few words.
#[derive(Clone, Debug, PartialEq)]
pub struct Measured {
    /// Number of figures.
    pub figures: usize,
    /// How far they can be trusted.
    pub verdict: Verdict,
    /// Mean of the total thickness over the area of all sheets, mm; `None` without any area.
    pub mean_thickness_mm: Option<f64>,
    /// Why the verdict is not a pass.
    pub reasons: Vec<Reason>,
}

impl From<&Structure> for StructureSummary {
    fn from(structure: &Structure) -> Self {
        let mean_mm = structure.thickness_summary().total_mm.mean;
        let found = match &structure.refusal {
            Some(refusal) => Err(refusal.clone()),
            None => Ok(Measured {
                figures: structure.figures.len(),
                verdict: structure.quality.verdict,
                mean_thickness_mm: mean_mm.is_finite().then_some(mean_mm),
                reasons: structure.quality.reasons.clone(),
            }),
        };
        Self { label: structure.label, name: None, found }
    }
}

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
            ReadError::Io(error) => Self::Io { doing: "reading the mask", error },
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
        Self::Io { doing: "writing the results", error }
    }
}

/// Reads the mask at `mask`, runs the pipeline and writes all artifacts into the folder `out`
/// (which must exist). On an error none of the artifacts is left there, not even those of an
/// earlier run: they would be taken for the answer.
///
/// # Errors
/// When the file is refused, the shape has no medial representation, or the run is cancelled.
pub fn process(
    mask: &Path,
    params: &CheckedParams,
    limits: InputLimits,
    out: &Path,
    observer: &dyn Observer,
) -> Result<Processed, ProcessError> {
    let start = Instant::now();
    remove_artifacts(out);
    let read = formats::read_file(mask, limits, observer)?;
    let read_ms = milliseconds(start);
    let model = pipeline::run(&read.volume, params, observer)?;
    // The voxels are not needed any more, and there may be many of them.
    let notices = read.volume.into_notices();
    let warnings = notices.into_iter().map(|n| Warning { code: n.code, message: n.message }).collect();
    let input = InputFacts { sha256: read.sha256, format: read.format };
    publish(&model, &Source { input, warnings, start, read_ms }, out, observer)
}

/// What the artifacts say of the file and the run.
#[derive(Clone, Debug)]
pub struct Source {
    /// The file.
    pub input: InputFacts,
    /// The reader's warnings.
    pub warnings: Vec<Warning>,
    /// When the run began.
    pub start: Instant,
    /// Milliseconds that reading took.
    pub read_ms: f64,
}

/// Writes the artifacts of `model` into the folder `out`: all of them or, on an error, none.
///
/// # Errors
/// When writing fails or the run is cancelled.
pub fn publish(model: &Model, source: &Source, out: &Path, observer: &dyn Observer) -> Result<Processed, ProcessError> {
    let write_start = Instant::now();
    let draft = Draft { folder: out, observer, is_complete: false };
    let write = |index: usize| {
        observer.check()?;
        let (name, media_type) = ARTIFACTS[index];
        let (bytes, sha256) = draft.write(name, |file| match name {
            "model.glb" => glb::write(model, file),
            "thickness.csv" => tables::write_thickness(model, file),
            "points.csv" => tables::write_points(model, file),
            _ => {
                let (write_ms, total_ms) = (milliseconds(write_start), milliseconds(source.start));
                let timings = OuterTimings { read_ms: source.read_ms, write_ms, total_ms };
                thickness_json::write(model, &source.input, &source.warnings, timings, file)
            }
        })?;
        Ok::<_, ProcessError>(Artifact { name, media_type, bytes, sha256 })
    };
    let (meshes, tables) = rayon::join(|| write(0), || rayon::join(|| write(2), || write(3)));
    // thickness.json comes last: it tells how long the others took.
    let artifacts = vec![meshes?, write(1)?, tables.0?, tables.1?];
    observer.check()?;
    draft.complete()?;
    let of_structures = model.structures.iter().flat_map(|structure| &structure.warnings);
    let warnings = source.warnings.iter().chain(of_structures).cloned().collect();
    let structures = model.structures.iter().map(StructureSummary::from).collect();
    Ok(Processed { artifacts, warnings, stage_seconds: stage_seconds(model), structures })
}

fn stage_seconds(model: &Model) -> Vec<(Stage, f64)> {
    let of = |stage| model.structures.iter().map(|structure| structure.timings.of(stage)).sum::<f64>() / 1e3;
    Stage::ALL.map(|stage| (stage, of(stage))).to_vec()
}

/// SHA-256 of a file's content, lower-case hex.
///
/// # Errors
/// When it cannot be read.
pub fn sha256_of_file(path: &Path) -> io::Result<String> {
    let mut hash = Hashed { inner: io::sink(), observer: &Silent, hash: Sha256::new(), bytes: 0 };
    io::copy(&mut File::open(path)?, &mut hash)?;
    Ok(hex(&hash.hash.finalize()))
}

fn milliseconds(since: Instant) -> f64 {
    since.elapsed().as_secs_f64() * 1e3
}

/// Files under temporary names until all are there; dropped before that, it removes them.
struct Draft<'a> {
    folder: &'a Path,
    observer: &'a dyn Observer,
    is_complete: bool,
}

impl Draft<'_> {
    /// Size and hash of what `write` wrote.
    fn write(&self, name: &str, write: impl FnOnce(&mut dyn Write) -> io::Result<()>) -> io::Result<(u64, String)> {
        let file = File::create(partial(self.folder, name))?;
        let mut hashed = Hashed { inner: file, observer: self.observer, hash: Sha256::new(), bytes: 0 };
        let mut buffered = BufWriter::with_capacity(1 << 16, &mut hashed);
        write(&mut buffered)?;
        buffered.flush()?;
        drop(buffered);
        Ok((hashed.bytes, hex(&hashed.hash.finalize())))
    }

    fn complete(mut self) -> io::Result<()> {
        for (name, _) in ARTIFACTS {
            std::fs::rename(partial(self.folder, name), self.folder.join(name))?;
        }
        self.is_complete = true;
        Ok(())
    }
}

impl Drop for Draft<'_> {
    fn drop(&mut self) {
        if !self.is_complete {
            remove_artifacts(self.folder);
        }
    }
}

fn partial(folder: &Path, name: &str) -> PathBuf {
    folder.join(format!(".{name}.partial"))
}

/// What cannot be removed is not there.
fn remove_artifacts(folder: &Path) {
    for (name, _) in ARTIFACTS {
        let _ = std::fs::remove_file(partial(folder, name));
        let _ = std::fs::remove_file(folder.join(name));
    }
}

struct Hashed<'a, W> {
    inner: W,
    observer: &'a dyn Observer,
    hash: Sha256,
    bytes: u64,
}

impl<W: Write> Write for Hashed<'_, W> {
    /// Ends with [`Cancelled`] once the observer asks to stop.
    fn write(&mut self, buffer: &[u8]) -> io::Result<usize> {
        self.observer.check().map_err(io::Error::other)?;
        let count = self.inner.write(buffer)?;
        self.hash.update(&buffer[..count]);
        self.bytes += count as u64;
        Ok(count)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.inner.flush()
    }
}
