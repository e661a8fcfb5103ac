//! What became of a mask, in a few words.

pub use super::drafts::{RECORD, WrittenFile};
use serde::{Deserialize, Serialize};

use crate::model::{Reason, Refusal, Stage, Structure, Verdict, Warning};

/// What became of a mask.
#[derive(Clone, Debug)]
pub struct Processed {
    /// The files that were written: the artifacts in the order of the contract, then the record.
    pub files: Vec<WrittenFile>,
    /// All warnings: of the reader and of every structure.
    pub warnings: Vec<Warning>,
    /// Seconds of each stage, of all structures together.
    pub stage_seconds: Vec<(Stage, f64)>,
    /// What became of each structure, in the order of the model.
    pub structures: Vec<StructureSummary>,
}

/// What became of one structure, in a few words.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct StructureSummary {
    /// Its value in the file.
    pub label: i64,
    /// What it is called, where that is known.
    pub name: Option<String>,
    /// What was measured, or why there is nothing to measure.
    pub found: Result<Measured, Refusal>,
}

/// A structure's representation, in a few words.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Measured {
    /// Number of figures.
    pub figures: usize,
    /// How far they can be trusted.
    pub verdict: Verdict,
    /// Mean of the total thickness over the area of all sheets, mm; `None` without any area.
    pub mean_thickness_mm: Option<f64>,
    /// Why the verdict is not a pass.
    pub reason: Option<Reason>,
}

impl From<&Structure> for StructureSummary {
    fn from(structure: &Structure) -> Self {
        let found = match &structure.refusal {
            Some(refusal) => Err(refusal.clone()),
            None => Ok(Measured {
                figures: structure.figures.len(),
                verdict: structure.quality.verdict,
                mean_thickness_mm: structure.thickness_summary().total_mm.map(|summary| summary.mean),
                reason: structure.quality.deciding_reason().cloned(),
            }),
        };
        Self { label: structure.label, name: structure.name.clone(), found }
    }
}
