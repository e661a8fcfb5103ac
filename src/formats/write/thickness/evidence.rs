//! What a result rests on, as parts of `thickness.json`: the frame, the automatic choices, the
//! uncertainty.

use serde::{Deserialize, Serialize};

use super::super::rounded::{Rounded, optional, triple};
use super::surfaces::Surfaces;
use crate::model::{FrameFacts, KindEvidence, Sheet, Structure, Uncertainty};

/// `frame` of a sheet.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[allow(missing_docs, reason = "fields are those of FrameFacts")]
pub struct FrameDoc {
    pub rule: String,
    pub cols_along: [Rounded; 3],
    pub rows_along: [Rounded; 3],
    pub upper_towards: [Rounded; 3],
    pub aspect: Rounded,
    /// Whether another frame would be as good.
    pub ambiguous: bool,
    /// Why.
    pub reason: Option<String>,
}

impl From<&FrameFacts> for FrameDoc {
    fn from(frame: &FrameFacts) -> Self {
        Self {
            rule: frame.rule.name().to_owned(),
            cols_along: triple(frame.cols_along),
            rows_along: triple(frame.rows_along),
            upper_towards: triple(frame.upper_towards),
            aspect: Rounded(frame.aspect),
            ambiguous: !frame.ambiguities.is_empty(),
            reason: (!frame.ambiguities.is_empty()).then(|| frame.ambiguities.join("; ")),
        }
    }
}

/// `automatic` of a sheet: what was chosen, and from what.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[allow(missing_docs, reason = "fields are those of Automatic")]
pub struct AutomaticDoc {
    pub neighbors: NeighborsDoc,
    pub landmarks: LandmarksDoc,
    pub grid: AutomaticGridDoc,
    pub kind: Option<KindDoc>,
}

/// What speaks for the kind of a figure.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[allow(missing_docs, reason = "fields are those of KindEvidence")]
pub struct KindDoc {
    pub width_in_radii: Option<Rounded>,
    pub flatness: Option<Rounded>,
    pub split_share: Option<Rounded>,
    pub elongation: Option<Rounded>,
    pub sheet_overlap: Option<Rounded>,
    pub tube_overlap: Option<Rounded>,
}

impl From<KindEvidence> for KindDoc {
    fn from(evidence: KindEvidence) -> Self {
        Self {
            width_in_radii: evidence.width_in_radii.map(Rounded),
            flatness: evidence.flatness.map(Rounded),
            split_share: evidence.split_share.map(Rounded),
            elongation: evidence.elongation.map(Rounded),
            sheet_overlap: evidence.sheet_overlap.map(Rounded),
            tube_overlap: evidence.tube_overlap.map(Rounded),
        }
    }
}

/// The neighbourhood.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[allow(missing_docs, reason = "fields are those of Automatic")]
pub struct NeighborsDoc {
    pub chosen: String,
    pub radius_mm: Option<Rounded>,
    pub graph_pieces: Surfaces<usize>,
}

/// The landmarks.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[allow(missing_docs, reason = "fields are those of Automatic")]
pub struct LandmarksDoc {
    pub chosen: Surfaces<usize>,
    pub of_points: Surfaces<usize>,
    pub residual_variance: Surfaces<Option<Rounded>>,
}

/// The size of the lattice.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[allow(missing_docs, reason = "fields are those of Automatic")]
pub struct AutomaticGridDoc {
    pub rows: usize,
    pub cols: usize,
    pub from: String,
    pub length_mm: Rounded,
    pub width_mm: Rounded,
}

impl From<&Sheet> for AutomaticDoc {
    fn from(sheet: &Sheet) -> Self {
        let facts = &sheet.automatic;
        Self {
            neighbors: NeighborsDoc {
                chosen: facts.neighborhood.clone(),
                radius_mm: facts.neighborhood_mm.map(Rounded),
                graph_pieces: Surfaces::of(&facts.graph_pieces, |pieces| *pieces),
            },
            landmarks: LandmarksDoc {
                chosen: Surfaces::of(&sheet.landmarks, |count| *count),
                of_points: Surfaces::of(&sheet.points, |points| points.positions.len()),
                residual_variance: Surfaces::of(&sheet.quality.residual_variance(), |share| share.map(Rounded)),
            },
            grid: AutomaticGridDoc {
                rows: sheet.grid.rows,
                cols: sheet.grid.cols,
                from: facts.grid_from.name().to_owned(),
                length_mm: Rounded(facts.length_mm),
                width_mm: Rounded(facts.width_mm),
            },
            kind: facts.kind.map(KindDoc::from),
        }
    }
}

/// `automatic` of a structure.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[allow(missing_docs, reason = "one field")]
pub struct StructureAutomaticDoc {
    pub pruning: PruningDoc,
}

/// Sheets are pruned that account for less than `loss_needed` of the object's volume.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[allow(missing_docs, reason = "fields are those of Pruning")]
pub struct PruningDoc {
    pub strength: Rounded,
    pub loss_needed: Rounded,
    pub pruned: usize,
    pub kept: usize,
}

impl From<&Structure> for StructureAutomaticDoc {
    fn from(structure: &Structure) -> Self {
        let pruning = PruningDoc {
            strength: Rounded(structure.pruning.strength),
            loss_needed: Rounded(structure.pruning.loss_needed),
            pruned: structure.pruning.pruned,
            kept: structure.figures.len(),
        };
        Self { pruning }
    }
}

/// `uncertainty` of a sheet: standard deviations of the thickness at each node, mm.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[allow(missing_docs, reason = "fields are those of Uncertainty")]
pub struct UncertaintyDoc {
    pub repeats: usize,
    pub matched: usize,
    pub upper_mm: Vec<Option<Rounded>>,
    pub lower_mm: Vec<Option<Rounded>>,
    pub total_mm: Vec<Option<Rounded>>,
}

impl From<&Uncertainty> for UncertaintyDoc {
    fn from(found: &Uncertainty) -> Self {
        Self {
            repeats: found.repeats,
            matched: found.matched,
            upper_mm: optional(&found.upper_mm),
            lower_mm: optional(&found.lower_mm),
            total_mm: optional(&found.total_mm),
        }
    }
}
