//! The quality part of `thickness.json`.

use serde::Serialize;
use serde::ser::{SerializeMap, Serializer};

use super::rounded::Rounded;
use super::thickness_json::{Surfaces, surfaces};
use crate::model::{
    Coverage, DistanceSummary, Distortion, EmbeddingQuality, FigureQuality, MeanAndP95, Reason, StructureQuality,
    Threshold, Verdict,
};

#[derive(Serialize)]
pub(super) struct FigureQualityJson {
    residual_variance: Surfaces<Option<Rounded>>,
    embedding: Surfaces<Option<EmbeddingJson>>,
    folds: usize,
    folds_before_repair: usize,
    repaired_nodes: usize,
    shortened_nodes: usize,
    corners: usize,
    folded_cells: Vec<FoldedPart>,
    folded_centres: usize,
    folded_wedges: Vec<FoldedPart>,
    self_intersections: Option<usize>,
    #[serde(flatten)]
    coverage: CoverageJson,
    spacing_variation: Rounded,
    distortion: DistortionJson,
    medial_offset: MeanJson,
    valid_share: Rounded,
}

/// How truly a surface was laid flat.
#[derive(Serialize)]
struct EmbeddingJson {
    residual_variance: Rounded,
    turned_over: Option<Rounded>,
    angle_error_deg: Option<Rounded>,
}

#[derive(Serialize)]
struct FoldedPart {
    side: &'static str,
    i: usize,
    j: usize,
}

#[derive(Serialize)]
pub(super) struct QualityJson<'a> {
    verdict: &'static str,
    reasons: Vec<ReasonJson<'a>>,
    thresholds: Thresholds<'a>,
    folds: usize,
    folds_before_repair: usize,
    repaired_nodes: usize,
    shortened_nodes: usize,
    folded_centres: usize,
    folded_wedges: usize,
    self_intersections: Option<usize>,
    #[serde(flatten)]
    coverage: CoverageJson,
    residual_variance: Rounded,
    turned_over: Option<Rounded>,
    spacing_variation: Rounded,
    distortion: DistortionJson,
    medial_offset: MeanJson,
    pruned_sheets: usize,
}

#[derive(Serialize)]
struct ReasonJson<'a> {
    code: &'static str,
    message: &'a str,
    value: Rounded,
    threshold: Rounded,
}

#[derive(Serialize)]
struct CoverageJson {
    dice: Rounded,
    grain_mm: Rounded,
    covered_share: Rounded,
    mask_to_model: DistanceJson,
    model_to_mask: DistanceJson,
}

#[derive(Serialize)]
struct DistanceJson {
    mean_mm: Rounded,
    p95_mm: Rounded,
    max_mm: Rounded,
}

#[derive(Serialize)]
struct DistortionJson {
    area_sd: Rounded,
    area_max_log: Rounded,
    angle_mean_deg: Rounded,
    angle_max_deg: Rounded,
}

#[derive(Serialize)]
struct MeanJson {
    mean: Rounded,
    p95: Rounded,
}

/// An object with an entry per measure, by its code.
struct Thresholds<'a>(&'a [Threshold]);

#[derive(Serialize)]
struct ThresholdJson {
    value: Rounded,
    bad: &'static str,
    warn: Option<Rounded>,
    fail: Option<Rounded>,
}

impl Serialize for Thresholds<'_> {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let mut map = serializer.serialize_map(Some(self.0.len()))?;
        for threshold in self.0 {
            let entry = ThresholdJson {
                value: Rounded(threshold.value),
                bad: if threshold.is_bad_below { "below" } else { "above" },
                warn: threshold.warn.map(Rounded),
                fail: threshold.fail.map(Rounded),
            };
            map.serialize_entry(threshold.code, &entry)?;
        }
        map.end()
    }
}

pub(super) fn figure_quality_json(quality: &FigureQuality) -> FigureQualityJson {
    let named = |&(is_upper, i, j): &(bool, usize, usize)| {
        let side = if is_upper { "upper" } else { "lower" };
        FoldedPart { side, i, j }
    };
    FigureQualityJson {
        residual_variance: surfaces(&quality.embedding, |plane| plane.map(|plane| Rounded(plane.residual_variance))),
        embedding: surfaces(&quality.embedding, |plane| plane.as_ref().map(embedding_json)),
        folds: quality.folds,
        folds_before_repair: quality.repair.folds_before,
        repaired_nodes: quality.repair.moved_nodes,
        shortened_nodes: quality.repair.shortened_nodes,
        corners: quality.corners,
        folded_cells: quality.folded_cells.iter().map(named).collect(),
        folded_centres: quality.folded_centres,
        folded_wedges: quality.folded_wedges.iter().map(named).collect(),
        self_intersections: quality.self_intersections,
        coverage: coverage_json(&quality.coverage),
        spacing_variation: Rounded(quality.spacing_variation),
        distortion: distortion_json(quality.distortion),
        medial_offset: mean_json(quality.medial_offset),
        valid_share: Rounded(quality.valid_share),
    }
}

pub(super) fn quality_json(quality: &StructureQuality) -> QualityJson<'_> {
    QualityJson {
        verdict: match quality.verdict {
            Verdict::Pass => "pass",
            Verdict::Warn => "warn",
            Verdict::Fail => "fail",
        },
        reasons: quality.reasons.iter().map(reason_json).collect(),
        thresholds: Thresholds(&quality.thresholds),
        folds: quality.folds,
        folds_before_repair: quality.repair.folds_before,
        repaired_nodes: quality.repair.moved_nodes,
        shortened_nodes: quality.repair.shortened_nodes,
        folded_centres: quality.folded_centres,
        folded_wedges: quality.folded_wedges,
        self_intersections: quality.self_intersections,
        coverage: coverage_json(&quality.coverage),
        residual_variance: Rounded(quality.residual_variance),
        turned_over: quality.turned_over.map(Rounded),
        spacing_variation: Rounded(quality.spacing_variation),
        distortion: distortion_json(quality.distortion),
        medial_offset: mean_json(quality.medial_offset),
        pruned_sheets: quality.pruned_sheets,
    }
}

fn embedding_json(plane: &EmbeddingQuality) -> EmbeddingJson {
    EmbeddingJson {
        residual_variance: Rounded(plane.residual_variance),
        turned_over: plane.turned_over.map(Rounded),
        angle_error_deg: plane.angle_error_deg.map(Rounded),
    }
}

fn reason_json(reason: &Reason) -> ReasonJson<'_> {
    ReasonJson {
        code: reason.code,
        message: &reason.message,
        value: Rounded(reason.value),
        threshold: Rounded(reason.threshold),
    }
}

fn coverage_json(coverage: &Coverage) -> CoverageJson {
    CoverageJson {
        dice: Rounded(coverage.dice),
        grain_mm: Rounded(coverage.grain_mm),
        covered_share: Rounded(coverage.covered_share),
        mask_to_model: distance_json(coverage.mask_to_model),
        model_to_mask: distance_json(coverage.model_to_mask),
    }
}

fn distance_json(summary: DistanceSummary) -> DistanceJson {
    DistanceJson { mean_mm: Rounded(summary.mean_mm), p95_mm: Rounded(summary.p95_mm), max_mm: Rounded(summary.max_mm) }
}

fn distortion_json(distortion: Distortion) -> DistortionJson {
    DistortionJson {
        area_sd: Rounded(distortion.area_sd),
        area_max_log: Rounded(distortion.area_max_log),
        angle_mean_deg: Rounded(distortion.angle_mean_deg),
        angle_max_deg: Rounded(distortion.angle_max_deg),
    }
}

fn mean_json(share: MeanAndP95) -> MeanJson {
    MeanJson { mean: Rounded(share.mean), p95: Rounded(share.p95) }
}
