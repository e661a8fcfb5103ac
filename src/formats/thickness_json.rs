//! Model → `thickness.json`, schema `medialrep/thickness/1`.

use std::io::{self, Write};

use serde::Serialize;
use serde::ser::{SerializeMap, Serializer};
use serde_json::Value;

use super::evidence_json::{AutomaticJson, FrameJson, StructureAutomaticJson, UncertaintyJson};
use super::params_json::params_to_json;
use super::quality_json::{FigureQualityJson, QualityJson, figure_quality_json, quality_json};
use super::rounded::{List, Rounded};
use crate::model::{Figure, Junction, Model, PerSurface, Structure};
use crate::model::{LengthSummary, ThicknessSummary, node_areas};
use crate::model::{Stage, Warning};
use crate::params::CheckedParams;
use crate::pipeline::sheets::strength;
use crate::space::{WorldPoint, WorldVector};

/// Where the model came from. Never the file's name: it may name a patient.
#[derive(Clone, Debug)]
pub struct InputFacts {
    /// SHA-256 of the file as sent.
    pub sha256: String,
    /// `nifti1.gz` and the like.
    pub format: &'static str,
}

/// Wall milliseconds outside of the pipeline.
#[derive(Clone, Copy, Debug, Default)]
pub struct OuterTimings {
    /// Reading the file.
    pub read_ms: f64,
    /// Writing the other artifacts.
    pub write_ms: f64,
    /// All, the pipeline too.
    pub total_ms: f64,
}

/// Writes the whole document; numbers are rounded to six decimals.
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
    let document = Document {
        schema: "medialrep/thickness/1",
        program: Program { name: env!("CARGO_PKG_NAME"), version: env!("CARGO_PKG_VERSION") },
        input: Input {
            sha256: &input.sha256,
            format: input.format,
            dims: model.dims,
            spacing_mm: model.world_from_voxel.spacing_mm().map(Rounded),
            affine: model.world_from_voxel.rows().map(|row| row.map(Rounded)),
        },
        space: Space { name: "RAS", unit: "mm" },
        params: params_to_json(&model.params),
        structures: model
            .structures
            .iter()
            .enumerate()
            .map(|(index, s)| structure_json(&model.params, index, s))
            .collect(),
        warnings: warnings_json(warnings),
        timings_ms: Timings {
            read: Rounded(timings.read_ms),
            write: Rounded(timings.write_ms),
            total: Rounded(timings.total_ms),
        },
    };
    let mut out = out;
    serde_json::to_writer(&mut out, &document)?;
    out.write_all(b"\n")
}

#[derive(Serialize)]
struct Document<'a> {
    schema: &'static str,
    program: Program,
    input: Input<'a>,
    space: Space,
    params: Value,
    structures: Vec<StructureJson<'a>>,
    warnings: Vec<WarningJson<'a>>,
    timings_ms: Timings,
}

#[derive(Serialize)]
struct Program {
    name: &'static str,
    version: &'static str,
}

#[derive(Serialize)]
struct Input<'a> {
    sha256: &'a str,
    format: &'static str,
    dims: [usize; 3],
    spacing_mm: [Rounded; 3],
    affine: [[Rounded; 4]; 4],
}

#[derive(Serialize)]
struct Space {
    name: &'static str,
    unit: &'static str,
}

#[derive(Serialize)]
struct Timings {
    read: Rounded,
    write: Rounded,
    total: Rounded,
}

#[derive(Serialize)]
struct WarningJson<'a> {
    code: &'static str,
    message: &'a str,
}

#[derive(Serialize)]
struct StructureJson<'a> {
    index: usize,
    label: i64,
    name: Option<&'static str>,
    voxels: u64,
    volume_mm3: Rounded,
    working_voxel_mm: Rounded,
    resolved: ResolvedJson,
    automatic: StructureAutomaticJson,
    #[serde(skip_serializing_if = "Option::is_none")]
    refusal: Option<RefusalJson>,
    figures: Vec<FigureJson<'a>>,
    junctions: Vec<JunctionJson<'a>>,
    thickness_summary: SummaryJson,
    quality: QualityJson<'a>,
    warnings: Vec<WarningJson<'a>>,
    timings_ms: StageTimingsJson<'a>,
}

/// What `auto` became; grid, neighbours and landmarks are with the figures.
#[derive(Serialize)]
struct ResolvedJson {
    prune: Rounded,
    resolution_mm: Rounded,
}

#[derive(Serialize)]
struct RefusalJson {
    code: &'static str,
    message: String,
    hint: String,
}

#[derive(Serialize)]
struct FigureJson<'a> {
    index: usize,
    grid: GridJson,
    medial: List<'a, WorldPoint>,
    upper: List<'a, WorldPoint>,
    lower: List<'a, WorldPoint>,
    crest: List<'a, WorldPoint>,
    valid: &'a [bool],
    vectors: Sides<Vectors>,
    thickness: Thickness,
    thickness_summary: SummaryJson,
    node_area_mm2: Vec<Rounded>,
    medial_radius_mm: List<'a, f64>,
    area_distortion: List<'a, f64>,
    intrinsic: Surfaces<List<'a, crate::space::ParamPoint>>,
    neighbors: Surfaces<Option<Rounded>>,
    landmarks: Surfaces<usize>,
    frame: FrameJson,
    automatic: AutomaticJson<'a>,
    #[serde(skip_serializing_if = "Option::is_none")]
    uncertainty: Option<UncertaintyJson<'a>>,
    quality: FigureQualityJson,
}

#[derive(Serialize)]
struct GridJson {
    rows: usize,
    cols: usize,
}

#[derive(Serialize)]
struct Sides<T> {
    upper: T,
    lower: T,
}

#[derive(Serialize)]
pub(super) struct Surfaces<T> {
    medial: T,
    upper: T,
    lower: T,
}

pub(super) fn surfaces<'a, T, U>(of: &'a PerSurface<T>, write: impl Fn(&'a T) -> U) -> Surfaces<U> {
    Surfaces { medial: write(&of.medial), upper: write(&of.upper), lower: write(&of.lower) }
}

struct Vectors(Vec<WorldVector>);

impl Serialize for Vectors {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        List(&self.0).serialize(serializer)
    }
}

#[derive(Serialize)]
struct Thickness {
    upper_mm: Vec<Rounded>,
    lower_mm: Vec<Rounded>,
    total_mm: Vec<Rounded>,
}

/// Area-weighted statistics of the lengths in [`Thickness`].
#[derive(Serialize)]
struct SummaryJson {
    upper_mm: LengthJson,
    lower_mm: LengthJson,
    total_mm: LengthJson,
    area_mm2: Rounded,
}

#[derive(Serialize)]
struct LengthJson {
    mean: Rounded,
    sd: Rounded,
    p5: Rounded,
    p50: Rounded,
    p95: Rounded,
}

#[derive(Serialize)]
struct JunctionJson<'a> {
    figures: &'a [usize],
    points: List<'a, WorldPoint>,
}

/// The eight stages by name, in order, and their sum.
struct StageTimingsJson<'a>(&'a Structure);

impl Serialize for StageTimingsJson<'_> {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let timings = &self.0.timings;
        let mut map = serializer.serialize_map(Some(Stage::ALL.len() + 1))?;
        for stage in Stage::ALL {
            map.serialize_entry(stage.name(), &Rounded(timings.of(stage)))?;
        }
        map.serialize_entry("total", &Rounded(timings.total()))?;
        map.end()
    }
}

fn structure_json<'a>(params: &CheckedParams, index: usize, structure: &'a Structure) -> StructureJson<'a> {
    StructureJson {
        index,
        label: structure.label,
        name: None,
        voxels: structure.voxels,
        volume_mm3: Rounded(structure.volume_mm3),
        working_voxel_mm: Rounded(structure.working_voxel_mm),
        resolved: ResolvedJson {
            prune: Rounded(strength(params.prune)),
            resolution_mm: Rounded(structure.working_voxel_mm),
        },
        automatic: StructureAutomaticJson::of(params, structure),
        refusal: structure.refusal.as_ref().map(|refusal| RefusalJson {
            code: refusal.code(),
            message: refusal.to_string(),
            hint: refusal.hint(),
        }),
        figures: structure.figures.iter().enumerate().map(figure_json).collect(),
        junctions: structure.junctions.iter().map(junction_json).collect(),
        thickness_summary: summary_json(structure.thickness_summary()),
        quality: quality_json(&structure.quality),
        warnings: warnings_json(&structure.warnings),
        timings_ms: StageTimingsJson(structure),
    }
}

fn figure_json((index, figure): (usize, &Figure)) -> FigureJson<'_> {
    let vectors = Sides { upper: figure.upper_vectors(), lower: figure.lower_vectors() };
    FigureJson {
        index,
        grid: GridJson { rows: figure.grid.rows, cols: figure.grid.cols },
        medial: List(&figure.medial),
        upper: List(&figure.upper),
        lower: List(&figure.lower),
        crest: List(&figure.crest),
        valid: &figure.valid,
        thickness: thickness(&vectors),
        thickness_summary: summary_json(figure.thickness_summary()),
        node_area_mm2: node_areas(figure.into()).into_iter().map(Rounded).collect(),
        vectors: Sides { upper: Vectors(vectors.upper), lower: Vectors(vectors.lower) },
        medial_radius_mm: List(&figure.medial_radius_mm),
        area_distortion: List(&figure.area_distortion),
        intrinsic: surfaces(&figure.intrinsic, |points| List(points)),
        neighbors: surfaces(&figure.neighbors, |count| count.map(Rounded)),
        landmarks: surfaces(&figure.landmarks, |count| *count),
        frame: FrameJson::of(&figure.frame),
        automatic: AutomaticJson::of(figure),
        uncertainty: figure.uncertainty.as_ref().map(UncertaintyJson::of),
        quality: figure_quality_json(&figure.quality),
    }
}

fn thickness(vectors: &Sides<Vec<WorldVector>>) -> Thickness {
    let lengths = |side: &[WorldVector]| side.iter().map(|vector| Rounded(vector.norm())).collect();
    let both = vectors.upper.iter().zip(&vectors.lower);
    Thickness {
        upper_mm: lengths(&vectors.upper),
        lower_mm: lengths(&vectors.lower),
        total_mm: both.map(|(upper, lower)| Rounded(upper.norm() + lower.norm())).collect(),
    }
}

fn summary_json(summary: ThicknessSummary) -> SummaryJson {
    let length = |LengthSummary { mean, sd, p5, p50, p95 }: LengthSummary| LengthJson {
        mean: Rounded(mean),
        sd: Rounded(sd),
        p5: Rounded(p5),
        p50: Rounded(p50),
        p95: Rounded(p95),
    };
    SummaryJson {
        upper_mm: length(summary.upper_mm),
        lower_mm: length(summary.lower_mm),
        total_mm: length(summary.total_mm),
        area_mm2: Rounded(summary.area_mm2),
    }
}

fn junction_json(junction: &Junction) -> JunctionJson<'_> {
    JunctionJson { figures: &junction.figures, points: List(&junction.points) }
}

fn warnings_json(warnings: &[Warning]) -> Vec<WarningJson<'_>> {
    warnings.iter().map(|warning| WarningJson { code: warning.code, message: &warning.message }).collect()
}
