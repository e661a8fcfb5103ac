//! What a result rests on, as parts of `thickness.json`: the frame, the automatic choices, the
//! uncertainty.

use serde::Serialize;

use super::rounded::{List, Rounded};
use super::thickness_json::{Surfaces, surfaces};
use crate::model::FrameFacts;
use crate::model::Uncertainty;
use crate::model::{Figure, Structure};
use crate::params::CheckedParams;
use crate::pipeline::sheets::{loss_needed, strength};
use crate::space::WorldVector;

/// `frame` of a figure.
#[derive(Serialize)]
pub(super) struct FrameJson {
    rule: &'static str,
    cols_along: [Rounded; 3],
    rows_along: [Rounded; 3],
    upper_towards: [Rounded; 3],
    aspect: Rounded,
    ambiguous: bool,
    reason: Option<String>,
}

impl FrameJson {
    pub(super) fn of(frame: &FrameFacts) -> Self {
        let list = |v: WorldVector| [Rounded(v.x), Rounded(v.y), Rounded(v.z)];
        Self {
            rule: frame.rule.name(),
            cols_along: list(frame.cols_along),
            rows_along: list(frame.rows_along),
            upper_towards: list(frame.upper_towards),
            aspect: Rounded(frame.aspect),
            ambiguous: !frame.ambiguities.is_empty(),
            reason: (!frame.ambiguities.is_empty()).then(|| frame.ambiguities.join("; ")),
        }
    }
}

/// `automatic` of a figure.
#[derive(Serialize)]
pub(super) struct AutomaticJson<'a> {
    neighbors: NeighborsJson<'a>,
    landmarks: LandmarksJson,
    grid: AutomaticGridJson,
}

#[derive(Serialize)]
struct NeighborsJson<'a> {
    chosen: &'a str,
    radius_mm: Option<Rounded>,
    graph_pieces: Surfaces<usize>,
}

#[derive(Serialize)]
struct LandmarksJson {
    chosen: Surfaces<usize>,
    of_points: Surfaces<usize>,
    residual_variance: Surfaces<Option<Rounded>>,
}

#[derive(Serialize)]
struct AutomaticGridJson {
    rows: usize,
    cols: usize,
    from: &'static str,
    length_mm: Rounded,
    width_mm: Rounded,
}

impl<'a> AutomaticJson<'a> {
    pub(super) fn of(figure: &'a Figure) -> Self {
        let facts = &figure.automatic;
        Self {
            neighbors: NeighborsJson {
                chosen: &facts.neighborhood,
                radius_mm: facts.neighborhood_mm.map(Rounded),
                graph_pieces: surfaces(&facts.graph_pieces, |pieces| *pieces),
            },
            landmarks: LandmarksJson {
                chosen: surfaces(&figure.landmarks, |count| *count),
                of_points: surfaces(&figure.points, |points| points.positions.len()),
                residual_variance: surfaces(&figure.quality.embedding, |plane| {
                    plane.map(|plane| Rounded(plane.residual_variance))
                }),
            },
            grid: AutomaticGridJson {
                rows: figure.grid.rows,
                cols: figure.grid.cols,
                from: facts.grid_from.name(),
                length_mm: Rounded(facts.length_mm),
                width_mm: Rounded(facts.width_mm),
            },
        }
    }
}

/// `automatic` of a structure.
#[derive(Serialize)]
pub(super) struct StructureAutomaticJson {
    pruning: PruningJson,
}

/// Sheets are pruned that account for less than `loss_needed` of the object's volume.
#[derive(Serialize)]
struct PruningJson {
    strength: Rounded,
    loss_needed: Rounded,
    pruned: usize,
    kept: usize,
}

impl StructureAutomaticJson {
    pub(super) fn of(params: &CheckedParams, structure: &Structure) -> Self {
        Self {
            pruning: PruningJson {
                strength: Rounded(strength(params.prune)),
                loss_needed: Rounded(loss_needed(params.prune)),
                pruned: structure.pruned,
                kept: structure.figures.len(),
            },
        }
    }
}

/// `uncertainty` of a figure.
#[derive(Serialize)]
pub(super) struct UncertaintyJson<'a> {
    repeats: usize,
    matched: usize,
    upper_mm: List<'a, f64>,
    lower_mm: List<'a, f64>,
    total_mm: List<'a, f64>,
}

impl<'a> UncertaintyJson<'a> {
    pub(super) fn of(found: &'a Uncertainty) -> Self {
        Self {
            repeats: found.repeats,
            matched: found.matched,
            upper_mm: List(&found.upper_mm),
            lower_mm: List(&found.lower_mm),
            total_mm: List(&found.total_mm),
        }
    }
}
