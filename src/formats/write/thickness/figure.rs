//! The figures of `thickness.json`.

use serde::{Deserialize, Serialize};

use super::super::rounded::{Rounded, numbers, optional, pairs, triples};
use super::evidence::{AutomaticDoc, FrameDoc, UncertaintyDoc};
use super::quality::FigureQualityDoc;
use super::surfaces::Surfaces;
use super::tube::TubeDoc;
use crate::model::{Figure, LatticeSize, LengthSummary, NodeRepair, Sheet, Side, ThicknessSummary};
use crate::space::WorldVector;

/// A figure, by its `kind`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(untagged)]
pub enum FigureDoc {
    /// `kind: "sheet"`.
    Sheet(Box<SheetDoc>),
    /// `kind: "tube"`.
    Tube(Box<TubeDoc>),
}

/// A sheet and its two sides. Lists of nodes hold rows · cols entries, row-major.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[allow(missing_docs, reason = "fields are those of Sheet")]
pub struct SheetDoc {
    pub index: usize,
    #[serde(default)]
    pub kind: SheetKind,
    /// Which of the structure's `parts` it belongs to.
    #[serde(default)]
    pub part: usize,
    pub grid: GridDoc,
    pub medial: Vec<[Rounded; 3]>,
    pub upper: Vec<[Rounded; 3]>,
    pub lower: Vec<[Rounded; 3]>,
    pub crest: Vec<[Rounded; 3]>,
    #[serde(default)]
    pub crest_arcs: Vec<Vec<[Rounded; 3]>>,
    pub valid: Vec<bool>,
    #[serde(default)]
    pub repaired: Vec<Option<NodeRepair>>,
    pub vectors: Sides<Vec<[Rounded; 3]>>,
    pub thickness: ThicknessDoc,
    pub thickness_summary: SummaryDoc,
    pub node_area_mm2: Vec<Rounded>,
    pub medial_radius_mm: Vec<Rounded>,
    pub area_distortion: Vec<Option<Rounded>>,
    pub intrinsic: Surfaces<Vec<[Rounded; 2]>>,
    pub neighbors: Surfaces<Option<Rounded>>,
    pub landmarks: Surfaces<usize>,
    pub frame: FrameDoc,
    pub automatic: AutomaticDoc,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub uncertainty: Option<UncertaintyDoc>,
    pub quality: FigureQualityDoc,
}

/// The kind of a sheet.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum SheetKind {
    /// A single sheet.
    #[default]
    Sheet,
}

/// Size of a lattice.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[allow(missing_docs, reason = "fields are those of LatticeSize")]
pub struct GridDoc {
    pub rows: usize,
    pub cols: usize,
}

/// A value for each side.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[allow(missing_docs, reason = "fields are the sides")]
pub struct Sides<T> {
    pub upper: T,
    pub lower: T,
}

/// Lengths of the vectors at each node, mm.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[allow(missing_docs, reason = "fields are the sides, and their sum")]
pub struct ThicknessDoc {
    pub upper_mm: Vec<Rounded>,
    pub lower_mm: Vec<Rounded>,
    pub total_mm: Vec<Rounded>,
}

/// Area-weighted statistics of the lengths in [`ThicknessDoc`].
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[allow(missing_docs, reason = "fields are those of ThicknessSummary")]
pub struct SummaryDoc {
    pub upper_mm: LengthDoc,
    pub lower_mm: LengthDoc,
    pub total_mm: LengthDoc,
    /// Length of the vectors to the walls of tubes; `null` without any.
    #[serde(default)]
    pub wall_mm: LengthDoc,
    pub area_mm2: Rounded,
}

/// Statistics of a length, mm; `null` without any area.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[allow(missing_docs, reason = "fields are those of LengthSummary")]
pub struct LengthDoc {
    pub mean: Option<Rounded>,
    pub sd: Option<Rounded>,
    pub p5: Option<Rounded>,
    pub p50: Option<Rounded>,
    pub p95: Option<Rounded>,
    #[serde(default)]
    pub min: Option<Rounded>,
    #[serde(default)]
    pub max: Option<Rounded>,
}

impl FigureDoc {
    pub(super) fn of(index: usize, figure: &Figure) -> Self {
        match figure {
            Figure::Sheet(sheet) => Self::Sheet(Box::new(SheetDoc::of(index, sheet))),
            Figure::Tube(tube) => Self::Tube(Box::new(TubeDoc::of(index, tube))),
        }
    }
}

impl SheetDoc {
    fn of(index: usize, sheet: &Sheet) -> Self {
        let vectors = Sides { upper: sheet.vectors(Side::Upper), lower: sheet.vectors(Side::Lower) };
        Self {
            index,
            kind: SheetKind::Sheet,
            part: sheet.part,
            grid: sheet.grid.into(),
            medial: triples(&sheet.medial),
            upper: triples(&sheet.upper),
            lower: triples(&sheet.lower),
            crest: triples(&sheet.crest),
            crest_arcs: sheet.crest_arcs().iter().map(|arc| triples(arc)).collect(),
            valid: sheet.valid.clone(),
            repaired: sheet.repaired.clone(),
            vectors: Sides { upper: displacements(&vectors.upper), lower: displacements(&vectors.lower) },
            thickness: ThicknessDoc {
                upper_mm: numbers(&sheet.lengths_mm(Side::Upper)),
                lower_mm: numbers(&sheet.lengths_mm(Side::Lower)),
                total_mm: numbers(&sheet.total_mm()),
            },
            thickness_summary: sheet.thickness_summary().into(),
            node_area_mm2: numbers(&sheet.node_areas_mm2()),
            medial_radius_mm: numbers(&sheet.medial_radius_mm),
            area_distortion: optional(&sheet.area_distortion),
            intrinsic: Surfaces::of(&sheet.intrinsic, |points| pairs(points)),
            neighbors: Surfaces::of(&sheet.neighbors, |count| count.map(Rounded)),
            landmarks: Surfaces::of(&sheet.landmarks, |count| *count),
            frame: (&sheet.frame).into(),
            automatic: sheet.into(),
            uncertainty: sheet.uncertainty.as_ref().map(UncertaintyDoc::from),
            quality: (&sheet.quality).into(),
        }
    }
}

pub(super) fn displacements(vectors: &[WorldVector]) -> Vec<[Rounded; 3]> {
    vectors.iter().map(|v| super::super::rounded::triple(*v)).collect()
}

impl From<LatticeSize> for GridDoc {
    fn from(LatticeSize { rows, cols }: LatticeSize) -> Self {
        Self { rows, cols }
    }
}

impl From<ThicknessSummary> for SummaryDoc {
    fn from(summary: ThicknessSummary) -> Self {
        Self {
            upper_mm: summary.upper_mm.into(),
            lower_mm: summary.lower_mm.into(),
            total_mm: summary.total_mm.into(),
            wall_mm: summary.wall_mm.into(),
            area_mm2: Rounded(summary.area_mm2),
        }
    }
}

impl From<Option<LengthSummary>> for LengthDoc {
    fn from(summary: Option<LengthSummary>) -> Self {
        let Some(LengthSummary { mean, sd, p5, p50, p95, min, max }) = summary else { return Self::default() };
        let [mean, sd, p5, p50, p95, min, max] = [mean, sd, p5, p50, p95, min, max].map(|length| Some(Rounded(length)));
        Self { mean, sd, p5, p50, p95, min, max }
    }
}
