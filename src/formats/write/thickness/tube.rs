//! The tubes of `thickness.json`.

use serde::{Deserialize, Serialize};

use super::super::rounded::{Rounded, numbers, optional, pairs, triple, triples};
use super::evidence::{FrameDoc, KindDoc};
use super::figure::{GridDoc, LengthDoc, displacements};
use super::quality::FigureQualityDoc;
use crate::model::{NodeRepair, Tube, TubeSection, TubeSummary, WallSummary, WallUncertainty};

/// A centreline and its wall. Lists of nodes hold rows · cols entries, row-major: rows around, cols along.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[allow(missing_docs, reason = "fields are those of Tube")]
pub struct TubeDoc {
    pub index: usize,
    pub kind: TubeKind,
    /// Which of the structure's `parts` it belongs to.
    pub part: usize,
    /// The figure that it branches off.
    #[serde(default)]
    pub parent: Option<usize>,
    pub grid: GridDoc,
    /// One point per column; those of a cap are all its end centre.
    pub centreline: Vec<[Rounded; 3]>,
    /// The same, once for every row.
    pub medial: Vec<[Rounded; 3]>,
    pub wall: Vec<[Rounded; 3]>,
    pub caps: CapsDoc,
    pub valid: Vec<bool>,
    pub repaired: Vec<Option<NodeRepair>>,
    pub vectors: WallDoc<Vec<[Rounded; 3]>>,
    pub thickness: WallThicknessDoc,
    pub thickness_summary: WallSummaryDoc,
    pub tube_summary: TubeSummaryDoc,
    pub sections: SectionsDoc,
    pub node_area_mm2: Vec<Rounded>,
    pub medial_radius_mm: Vec<Rounded>,
    /// Arc length along, and around, mm.
    pub intrinsic: WallDoc<Vec<[Rounded; 2]>>,
    pub frame: FrameDoc,
    pub automatic: TubeAutomaticDoc,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub uncertainty: Option<WallUncertaintyDoc>,
    pub quality: FigureQualityDoc,
}

/// The kind of a tube.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum TubeKind {
    /// A tube.
    Tube,
}

/// What a tube has on its one surface.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[allow(missing_docs, reason = "one field")]
pub struct WallDoc<T> {
    pub wall: T,
}

/// The tips, before the first column and beyond the last, and how many columns at either end belong to the cap.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[allow(missing_docs, reason = "two tips")]
pub struct CapsDoc {
    pub start: [Rounded; 3],
    pub end: [Rounded; 3],
    pub columns: [usize; 2],
}

/// Lengths of the vectors at each node, and of each with the one opposite, mm.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[allow(missing_docs, reason = "two lengths")]
pub struct WallThicknessDoc {
    pub wall_mm: Vec<Rounded>,
    pub total_mm: Vec<Rounded>,
}

/// Statistics of the lengths in [`WallThicknessDoc`], weighted by the area of the wall.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[allow(missing_docs, reason = "fields are those of WallSummary")]
pub struct WallSummaryDoc {
    pub wall_mm: LengthDoc,
    pub total_mm: LengthDoc,
    pub area_mm2: Rounded,
}

/// A tube in a few numbers, means along its centreline.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[allow(missing_docs, reason = "fields are those of TubeSummary")]
pub struct TubeSummaryDoc {
    pub length_mm: Rounded,
    pub radius_mm: LengthDoc,
    pub diameter_mm: LengthDoc,
    pub section_area_mm2: LengthDoc,
    pub curvature_per_mm: LengthDoc,
    pub tortuosity: Rounded,
}

/// The cross-section of each column.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[allow(missing_docs, reason = "fields are those of TubeSection")]
pub struct SectionsDoc {
    pub station_mm: Vec<Rounded>,
    pub area_mm2: Vec<Rounded>,
    pub perimeter_mm: Vec<Rounded>,
    pub radius_mm: Vec<Rounded>,
    pub curvature_per_mm: Vec<Rounded>,
}

/// `automatic` of a tube.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[allow(missing_docs, reason = "fields are those of Automatic")]
pub struct TubeAutomaticDoc {
    pub grid: TubeGridDoc,
    pub kind: Option<KindDoc>,
}

/// The size of the lattice, and what it follows from.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[allow(missing_docs, reason = "fields are those of Automatic")]
pub struct TubeGridDoc {
    pub rows: usize,
    pub cols: usize,
    pub from: String,
    pub length_mm: Rounded,
    pub width_mm: Rounded,
}

/// `uncertainty` of a tube: standard deviations at each node, mm.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[allow(missing_docs, reason = "fields are those of WallUncertainty")]
pub struct WallUncertaintyDoc {
    pub repeats: usize,
    pub matched: usize,
    pub wall_mm: Vec<Option<Rounded>>,
    pub total_mm: Vec<Option<Rounded>>,
}

impl TubeDoc {
    pub(super) fn of(index: usize, tube: &Tube) -> Self {
        let medial = tube.medial();
        let radius = |n: usize| Rounded(tube.medial_radius_mm[n % tube.grid.cols]);
        Self {
            index,
            kind: TubeKind::Tube,
            part: tube.part,
            parent: tube.parent,
            grid: tube.grid.into(),
            centreline: triples(&tube.centreline),
            medial: triples(&medial),
            wall: triples(&tube.wall),
            caps: CapsDoc { start: triple(tube.tips[0].coords), end: triple(tube.tips[1].coords), columns: tube.caps },
            valid: vec![true; tube.wall.len()],
            repaired: tube.repaired.clone(),
            vectors: WallDoc { wall: displacements(&tube.vectors()) },
            thickness: WallThicknessDoc { wall_mm: numbers(&tube.lengths_mm()), total_mm: numbers(&tube.total_mm()) },
            thickness_summary: tube.wall_summary().into(),
            tube_summary: tube.summary().into(),
            sections: SectionsDoc::of(&tube.sections()),
            node_area_mm2: numbers(&tube.node_areas_mm2()),
            medial_radius_mm: (0..medial.len()).map(radius).collect(),
            intrinsic: WallDoc { wall: pairs(&tube.intrinsic) },
            frame: (&tube.frame).into(),
            automatic: tube.into(),
            uncertainty: tube.uncertainty.as_ref().map(WallUncertaintyDoc::from),
            quality: (&tube.quality).into(),
        }
    }
}

impl From<&Tube> for TubeAutomaticDoc {
    fn from(tube: &Tube) -> Self {
        let facts = &tube.automatic;
        let grid = TubeGridDoc {
            rows: tube.grid.rows,
            cols: tube.grid.cols,
            from: facts.grid_from.name().to_owned(),
            length_mm: Rounded(facts.length_mm),
            width_mm: Rounded(facts.width_mm),
        };
        Self { grid, kind: facts.kind.map(KindDoc::from) }
    }
}

impl From<WallSummary> for WallSummaryDoc {
    fn from(summary: WallSummary) -> Self {
        Self { wall_mm: summary.wall_mm.into(), total_mm: summary.total_mm.into(), area_mm2: Rounded(summary.area_mm2) }
    }
}

impl From<TubeSummary> for TubeSummaryDoc {
    fn from(summary: TubeSummary) -> Self {
        Self {
            length_mm: Rounded(summary.length_mm),
            radius_mm: summary.radius_mm.into(),
            diameter_mm: summary.radius_mm.map(|radius| radius.scaled(2.0)).into(),
            section_area_mm2: summary.section_area_mm2.into(),
            curvature_per_mm: summary.curvature_per_mm.into(),
            tortuosity: Rounded(summary.tortuosity.unwrap_or(f64::NAN)),
        }
    }
}

impl SectionsDoc {
    fn of(sections: &[TubeSection]) -> Self {
        let all = |value: fn(&TubeSection) -> f64| sections.iter().map(|section| Rounded(value(section))).collect();
        Self {
            station_mm: all(|section| section.station_mm),
            area_mm2: all(|section| section.area_mm2),
            perimeter_mm: all(|section| section.perimeter_mm),
            radius_mm: all(|section| section.radius_mm),
            curvature_per_mm: all(|section| section.curvature_per_mm),
        }
    }
}

impl From<&WallUncertainty> for WallUncertaintyDoc {
    fn from(found: &WallUncertainty) -> Self {
        Self {
            repeats: found.repeats,
            matched: found.matched,
            wall_mm: optional(&found.wall_mm),
            total_mm: optional(&found.total_mm),
        }
    }
}
