//! `thickness.json`, schema `medialrep/thickness/1`: the types of the document, which read what they write.
//!
//! Fields may be added, never renamed; a document of an earlier version of the program is read with the fields
//! that it lacks at their defaults.

mod surfaces;

mod quality;

mod evidence;

mod figure;

mod tube;

use std::io::{self, Write};

use serde::{Deserialize, Serialize};
use serde_json::Value;

use super::colors::hex_color;
use super::ordered::Ordered;
use super::rounded::{Rounded, triples};
use crate::formats::params_json::params_to_json;
use crate::model::{Junction, Model, Refusal, Stage, StageTimings, Structure, Warning};
use crate::space::LabelCode;

pub use super::ordered::Ordered as Named;
pub use super::rounded::Rounded as Number;
pub use evidence::{
    AutomaticDoc, AutomaticGridDoc, FrameDoc, KindDoc, LandmarksDoc, NeighborsDoc, PruningDoc, StructureAutomaticDoc,
    UncertaintyDoc,
};
pub use figure::{FigureDoc, GridDoc, LengthDoc, SheetDoc, SheetKind, Sides, SummaryDoc, ThicknessDoc};
pub use quality::{
    CoverageDoc, DistanceDoc, DistortionDoc, EmbeddingDoc, FigureQualityDoc, KeptDoc, MeanDoc, PlaceDoc, QualityDoc,
    ReasonDoc, ThresholdDoc, WorldPlaceDoc,
};
pub use surfaces::Surfaces;
pub use tube::{
    CapsDoc, SectionsDoc, TubeAutomaticDoc, TubeDoc, TubeGridDoc, TubeKind, TubeSummaryDoc, WallDoc, WallSummaryDoc,
    WallThicknessDoc, WallUncertaintyDoc,
};

/// Name and version of the schema.
pub const SCHEMA: &str = "medialrep/thickness/1";

/// Where the model came from. Never the file's name: it may name a patient.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct InputFacts {
    /// SHA-256 of the file as sent.
    pub sha256: String,
    /// `nifti1.gz` and the like.
    pub format: String,
}

/// Wall milliseconds outside of the pipeline.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct OuterTimings {
    /// Reading the file.
    pub read_ms: f64,
    /// Writing the other artifacts.
    pub write_ms: f64,
    /// All, the pipeline too.
    pub total_ms: f64,
}

/// The whole document.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[allow(missing_docs, reason = "fields are those of Model")]
pub struct Document {
    pub schema: String,
    pub program: ProgramDoc,
    pub input: InputDoc,
    pub space: SpaceDoc,
    pub params: Value,
    pub structures: Vec<StructureDoc>,
    pub warnings: Vec<WarningDoc>,
    pub timings_ms: TimingsDoc,
}

/// The program that wrote it.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[allow(missing_docs, reason = "two names")]
pub struct ProgramDoc {
    pub name: String,
    pub version: String,
}

/// The file that it was made from.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[allow(missing_docs, reason = "fields are those of InputFacts and Model")]
pub struct InputDoc {
    pub sha256: String,
    pub format: String,
    pub dims: [usize; 3],
    pub spacing_mm: [Rounded; 3],
    pub affine: [[Rounded; 4]; 4],
}

/// What coordinates mean.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[allow(missing_docs, reason = "two names")]
pub struct SpaceDoc {
    pub name: String,
    pub unit: String,
}

/// Wall milliseconds of the whole run.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[allow(missing_docs, reason = "fields are those of OuterTimings")]
pub struct TimingsDoc {
    pub read: Rounded,
    pub write: Rounded,
    pub total: Rounded,
}

/// What the reader should know.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[allow(missing_docs, reason = "fields are those of Warning")]
pub struct WarningDoc {
    pub code: String,
    pub message: String,
}

/// A structure.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[allow(missing_docs, reason = "fields are those of Structure")]
pub struct StructureDoc {
    pub index: usize,
    pub label: i64,
    pub name: Option<String>,
    /// `#rrggbb`.
    #[serde(default)]
    pub color: Option<String>,
    /// What it is, by a code of a terminology.
    #[serde(default)]
    pub code: Option<CodeDoc>,
    pub voxels: u64,
    pub volume_mm3: Rounded,
    /// Voxels that the figures stand for, over those sent.
    #[serde(default)]
    pub kept_share: Option<Rounded>,
    /// How many parts of the label have figures.
    #[serde(default)]
    pub components: usize,
    /// The parts that were worked on.
    #[serde(default)]
    pub parts: Vec<PartDoc>,
    pub working_voxel_mm: Rounded,
    #[serde(default)]
    pub grain_mm: [Rounded; 3],
    pub resolved: ResolvedDoc,
    pub automatic: StructureAutomaticDoc,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub refusal: Option<RefusalDoc>,
    pub figures: Vec<FigureDoc>,
    pub junctions: Vec<JunctionDoc>,
    pub thickness_summary: SummaryDoc,
    pub quality: QualityDoc,
    pub warnings: Vec<WarningDoc>,
    /// Of each stage by its name, and `total`.
    pub timings_ms: Ordered<Rounded>,
}

/// A code of a terminology: `64033007` of `SCT` is `Kidney`.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[allow(missing_docs, reason = "fields are those of LabelCode")]
pub struct CodeDoc {
    pub value: String,
    pub scheme: String,
    pub meaning: String,
}

/// What `auto` became; grid, neighbours and landmarks are with the figures.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[allow(missing_docs, reason = "names of parameters")]
pub struct ResolvedDoc {
    pub prune: Rounded,
    pub resolution_mm: Rounded,
}

/// Why there is no figure.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[allow(missing_docs, reason = "fields are those of a problem object")]
pub struct RefusalDoc {
    pub code: String,
    pub message: String,
    pub hint: String,
}

/// A part of the label that touches no other.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[allow(missing_docs, reason = "fields are those of LabelPart")]
pub struct PartDoc {
    pub index: usize,
    pub voxels: u64,
    /// Indices of its figures.
    pub figures: Vec<usize>,
    pub kept_share: Rounded,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub refusal: Option<RefusalDoc>,
    pub thickness_summary: SummaryDoc,
    #[serde(flatten)]
    pub coverage: CoverageDoc,
}

/// A hinge.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[allow(missing_docs, reason = "fields are those of Junction")]
pub struct JunctionDoc {
    pub figures: Vec<usize>,
    pub points: Vec<[Rounded; 3]>,
}

/// Why bytes are no document.
#[derive(Debug, thiserror::Error)]
pub enum DocumentError {
    /// No JSON, or a field is missing or of another type.
    #[error("it is no thickness.json: {0}")]
    Json(#[from] serde_json::Error),
    /// Of a schema that this program does not know.
    #[error("its schema is {found:?}, known is {SCHEMA:?}")]
    Schema {
        /// What it says.
        found: String,
    },
}

/// Writes the document of a model; numbers are rounded to six decimals.
///
/// # Errors
/// When writing fails.
pub fn write(
    model: &Model,
    input: &InputFacts,
    warnings: &[Warning],
    timings: OuterTimings,
    out: impl Write,
) -> io::Result<()> {
    Document::of(model, input, warnings, timings).write(out)
}

impl Document {
    /// The document of a model.
    #[must_use]
    pub fn of(model: &Model, input: &InputFacts, warnings: &[Warning], timings: OuterTimings) -> Self {
        let structures = model.structures.iter().enumerate();
        Self {
            schema: SCHEMA.to_owned(),
            program: ProgramDoc {
                name: env!("CARGO_PKG_NAME").to_owned(),
                version: env!("CARGO_PKG_VERSION").to_owned(),
            },
            input: InputDoc {
                sha256: input.sha256.clone(),
                format: input.format.clone(),
                dims: model.dims,
                spacing_mm: model.world_from_voxel.spacing_mm().map(Rounded),
                affine: model.world_from_voxel.rows().map(|row| row.map(Rounded)),
            },
            space: SpaceDoc { name: "RAS".to_owned(), unit: "mm".to_owned() },
            params: params_to_json(&model.params),
            structures: structures.map(|(index, structure)| StructureDoc::of(index, structure)).collect(),
            warnings: warnings.iter().map(WarningDoc::from).collect(),
            timings_ms: TimingsDoc {
                read: Rounded(timings.read_ms),
                write: Rounded(timings.write_ms),
                total: Rounded(timings.total_ms),
            },
        }
    }

    /// Writes it as a line of JSON.
    ///
    /// # Errors
    /// When writing fails.
    pub fn write(&self, mut out: impl Write) -> io::Result<()> {
        serde_json::to_writer(&mut out, self)?;
        out.write_all(b"\n")
    }

    /// Reads a document.
    ///
    /// # Errors
    /// When it is none, or of another schema.
    pub fn read(bytes: &[u8]) -> Result<Self, DocumentError> {
        #[derive(Deserialize)]
        struct Head {
            schema: String,
        }
        let Head { schema } = serde_json::from_slice(bytes)?;
        if schema != SCHEMA {
            return Err(DocumentError::Schema { found: schema });
        }
        Ok(serde_json::from_slice(bytes)?)
    }
}

impl StructureDoc {
    fn of(index: usize, structure: &Structure) -> Self {
        let figures = structure.figures.iter().enumerate();
        Self {
            index,
            label: structure.label,
            name: structure.name.clone(),
            color: structure.color.map(hex_color),
            code: structure.code.as_ref().map(CodeDoc::from),
            voxels: structure.voxels,
            volume_mm3: Rounded(structure.volume_mm3),
            kept_share: structure.refusal.is_none().then_some(Rounded(structure.quality.kept.kept)),
            components: structure.components(),
            parts: structure.parts.iter().enumerate().map(|(n, _)| PartDoc::of(structure, n)).collect(),
            working_voxel_mm: Rounded(structure.working_voxel_mm),
            grain_mm: structure.grain_mm.map(Rounded),
            resolved: ResolvedDoc {
                prune: Rounded(structure.pruning.strength),
                resolution_mm: Rounded(structure.working_voxel_mm),
            },
            automatic: structure.into(),
            refusal: structure.refusal.as_ref().map(RefusalDoc::from),
            figures: figures.map(|(index, figure)| FigureDoc::of(index, figure)).collect(),
            junctions: structure.junctions.iter().map(JunctionDoc::from).collect(),
            thickness_summary: structure.thickness_summary().into(),
            quality: (&structure.quality).into(),
            warnings: structure.warnings.iter().map(WarningDoc::from).collect(),
            timings_ms: timings(&structure.timings),
        }
    }
}

impl PartDoc {
    fn of(structure: &Structure, index: usize) -> Self {
        let part = &structure.parts[index];
        Self {
            index,
            voxels: part.voxels,
            figures: part.figures.clone(),
            kept_share: Rounded(part.kept_share),
            refusal: part.refusal.as_ref().map(RefusalDoc::from),
            thickness_summary: structure.part_thickness(index).into(),
            coverage: part.coverage.into(),
        }
    }
}

impl From<&LabelCode> for CodeDoc {
    fn from(code: &LabelCode) -> Self {
        Self { value: code.value.clone(), scheme: code.scheme.clone(), meaning: code.meaning.clone() }
    }
}

impl From<&Refusal> for RefusalDoc {
    fn from(refusal: &Refusal) -> Self {
        Self { code: refusal.code().to_owned(), message: refusal.to_string(), hint: refusal.hint() }
    }
}

/// The stages by name, in order, and their sum.
fn timings(timings: &StageTimings) -> Ordered<Rounded> {
    let mut all: Vec<(String, Rounded)> = Vec::new();
    for stage in Stage::ALL {
        all.push((stage.name().to_owned(), Rounded(timings.of(stage))));
    }
    all.push(("total".to_owned(), Rounded(timings.total())));
    Ordered(all)
}

impl From<&Junction> for JunctionDoc {
    fn from(junction: &Junction) -> Self {
        Self { figures: junction.figures.clone(), points: triples(&junction.points) }
    }
}

impl From<&Warning> for WarningDoc {
    fn from(warning: &Warning) -> Self {
        Self { code: warning.code.to_string(), message: warning.message.clone() }
    }
}
