//! The quality part of `thickness.json`.

use serde::{Deserialize, Serialize};

use super::super::ordered::Ordered;
use super::super::rounded::{Rounded, triple};
use super::surfaces::Surfaces;
use crate::model::{
    Coverage, DistanceSummary, Distortion, EmbeddingQuality, FigureQuality, Kept, LatticePlace, MeanAndP95, Reason,
    Repair, Stretch, StructureQuality, Threshold, WorldPlace,
};

/// `quality` of a figure.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[allow(missing_docs, reason = "fields are those of FigureQuality; docs/quality.md says what they mean")]
pub struct FigureQualityDoc {
    pub residual_variance: Surfaces<Option<Rounded>>,
    #[serde(default)]
    pub embedding: Surfaces<Option<EmbeddingDoc>>,
    pub folds: usize,
    #[serde(flatten)]
    pub repair: RepairDoc,
    pub corners: usize,
    pub folded_cells: Vec<PlaceDoc>,
    pub folded_centres: usize,
    pub folded_wedges: Vec<PlaceDoc>,
    pub self_intersections: Option<usize>,
    #[serde(flatten)]
    pub coverage: CoverageDoc,
    pub spacing_variation: Rounded,
    pub distortion: DistortionDoc,
    pub medial_offset: MeanDoc,
    pub valid_share: Rounded,
    #[serde(default)]
    pub outside_share: Rounded,
}

/// What was repaired.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[allow(missing_docs, reason = "fields are those of Repair")]
pub struct RepairDoc {
    pub folds_before_repair: usize,
    pub repaired_nodes: usize,
    pub shortened_nodes: usize,
    #[serde(default)]
    pub past_foot_nodes: usize,
    #[serde(default)]
    pub off_sheet_nodes: usize,
    #[serde(default)]
    pub merged_nodes: usize,
}

impl From<&Repair> for RepairDoc {
    fn from(repair: &Repair) -> Self {
        Self {
            folds_before_repair: repair.folds_before,
            repaired_nodes: repair.moved_nodes,
            shortened_nodes: repair.shortened_nodes,
            past_foot_nodes: repair.past_foot_nodes,
            off_sheet_nodes: repair.off_sheet_nodes,
            merged_nodes: repair.merged_nodes,
        }
    }
}

/// How truly a surface was laid flat.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[allow(missing_docs, reason = "fields are those of EmbeddingQuality")]
pub struct EmbeddingDoc {
    pub residual_variance: Rounded,
    pub turned_over: Option<Rounded>,
    pub angle_error_deg: Option<Rounded>,
    #[serde(default)]
    pub unrolled: Option<StretchDoc>,
}

/// How a plane stretches that is not the embedding's own.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[allow(missing_docs, reason = "fields are those of Stretch")]
pub struct StretchDoc {
    pub energy: Rounded,
    pub least: Rounded,
    pub most: Rounded,
}

/// A place of the lattice.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[allow(missing_docs, reason = "fields are those of LatticePlace")]
pub struct PlaceDoc {
    pub side: String,
    pub i: usize,
    pub j: usize,
}

/// `quality` of a structure.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[allow(missing_docs, reason = "fields are those of StructureQuality; docs/quality.md says what they mean")]
pub struct QualityDoc {
    pub verdict: String,
    pub reasons: Vec<ReasonDoc>,
    pub thresholds: Ordered<ThresholdDoc>,
    pub folds: usize,
    #[serde(flatten)]
    pub repair: RepairDoc,
    pub folded_centres: usize,
    pub folded_wedges: usize,
    pub self_intersections: Option<usize>,
    #[serde(flatten)]
    pub coverage: CoverageDoc,
    pub residual_variance: Rounded,
    #[serde(default)]
    pub turned_over: Option<Rounded>,
    pub spacing_variation: Rounded,
    pub distortion: DistortionDoc,
    pub medial_offset: MeanDoc,
    pub pruned_sheets: usize,
    #[serde(default)]
    pub kept: Option<KeptDoc>,
    #[serde(default)]
    pub outside_share: Rounded,
    #[serde(default)]
    pub worst_place: Option<WorldPlaceDoc>,
}

/// What became of the label's voxels, as shares of those that were sent.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[allow(missing_docs, reason = "fields are those of Kept")]
pub struct KeptDoc {
    pub kept_share: Rounded,
    pub dropped_share: Rounded,
    pub refused_share: Rounded,
    pub lost_share: Rounded,
    pub thin_share: Rounded,
    pub filled_share: Rounded,
    pub closed_share: Rounded,
}

/// Where something is, in the world.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[allow(missing_docs, reason = "fields are those of WorldPlace")]
pub struct WorldPlaceDoc {
    pub figure: Option<usize>,
    pub position: [Rounded; 3],
}

/// Why the verdict is not a pass.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[allow(missing_docs, reason = "fields are those of Reason")]
pub struct ReasonDoc {
    pub code: String,
    pub message: String,
    pub value: Rounded,
    pub threshold: Rounded,
    #[serde(default)]
    pub place: Option<WorldPlaceDoc>,
}

/// The fit to the mask.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[allow(missing_docs, reason = "fields are those of Coverage")]
pub struct CoverageDoc {
    pub dice: Rounded,
    #[serde(default)]
    pub flat_dice: Rounded,
    pub grain_mm: Rounded,
    pub covered_share: Rounded,
    #[serde(default)]
    pub far_share: Rounded,
    pub mask_to_model: DistanceDoc,
    pub model_to_mask: DistanceDoc,
}

/// Distances between surfaces.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[allow(missing_docs, reason = "fields are those of DistanceSummary")]
pub struct DistanceDoc {
    pub mean_mm: Rounded,
    pub p95_mm: Rounded,
    pub max_mm: Rounded,
}

/// Distortion of the lattice.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[allow(missing_docs, reason = "fields are those of Distortion")]
pub struct DistortionDoc {
    pub area_sd: Rounded,
    pub area_max_log: Rounded,
    pub angle_mean_deg: Rounded,
    pub angle_max_deg: Rounded,
}

/// A share over nodes.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[allow(missing_docs, reason = "fields are those of MeanAndP95")]
pub struct MeanDoc {
    pub mean: Rounded,
    pub p95: Rounded,
}

/// A measure that the verdict looks at.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[allow(missing_docs, reason = "fields are those of Threshold")]
pub struct ThresholdDoc {
    pub value: Rounded,
    pub bad: String,
    pub warn: Option<Rounded>,
    pub fail: Option<Rounded>,
}

impl From<&FigureQuality> for FigureQualityDoc {
    fn from(quality: &FigureQuality) -> Self {
        Self {
            residual_variance: Surfaces::of(&quality.residual_variance(), |share| share.map(Rounded)),
            embedding: Surfaces::of(&quality.embedding, |plane| plane.as_ref().map(EmbeddingDoc::from)),
            folds: quality.folds,
            repair: (&quality.repair).into(),
            corners: quality.corners,
            folded_cells: folded_cells(quality),
            folded_centres: quality.folded_centres,
            folded_wedges: quality.folded_wedges.iter().map(PlaceDoc::from).collect(),
            self_intersections: quality.self_intersections,
            coverage: quality.coverage.into(),
            spacing_variation: Rounded(quality.spacing_variation),
            distortion: quality.distortion.into(),
            medial_offset: quality.medial_offset.into(),
            valid_share: Rounded(quality.valid_share),
            outside_share: Rounded(quality.outside_share),
        }
    }
}

/// Cells of a sheet, or wedges of a tube, that are turned over.
fn folded_cells(quality: &FigureQuality) -> Vec<PlaceDoc> {
    let mut cells: Vec<PlaceDoc> = quality.folded_cells.iter().map(PlaceDoc::from).collect();
    for &[i, j] in &quality.folded_prisms {
        cells.push(PlaceDoc { side: "wall".to_owned(), i, j });
    }
    cells
}

impl From<&EmbeddingQuality> for EmbeddingDoc {
    fn from(plane: &EmbeddingQuality) -> Self {
        Self {
            residual_variance: Rounded(plane.residual_variance),
            turned_over: plane.turned_over.map(Rounded),
            angle_error_deg: plane.angle_error_deg.map(Rounded),
            unrolled: plane.unrolled.map(StretchDoc::from),
        }
    }
}

impl From<Stretch> for StretchDoc {
    fn from(stretch: Stretch) -> Self {
        Self { energy: Rounded(stretch.energy), least: Rounded(stretch.least), most: Rounded(stretch.most) }
    }
}

impl From<&LatticePlace> for PlaceDoc {
    fn from(place: &LatticePlace) -> Self {
        Self { side: place.side.name().to_owned(), i: place.i, j: place.j }
    }
}

impl From<&StructureQuality> for QualityDoc {
    fn from(quality: &StructureQuality) -> Self {
        let thresholds = quality.thresholds.iter().map(|own| (own.code.to_string(), own.into())).collect();
        Self {
            verdict: quality.verdict.name().to_owned(),
            reasons: quality.reasons.iter().map(ReasonDoc::from).collect(),
            thresholds: Ordered(thresholds),
            folds: quality.folds,
            repair: (&quality.repair).into(),
            folded_centres: quality.folded_centres,
            folded_wedges: quality.folded_wedges,
            self_intersections: quality.self_intersections,
            coverage: quality.coverage.into(),
            residual_variance: Rounded(quality.residual_variance),
            turned_over: quality.turned_over.map(Rounded),
            spacing_variation: Rounded(quality.spacing_variation),
            distortion: quality.distortion.into(),
            medial_offset: quality.medial_offset.into(),
            pruned_sheets: quality.pruned_sheets,
            kept: (!quality.thresholds.is_empty()).then_some((&quality.kept).into()),
            outside_share: Rounded(quality.outside_share),
            worst_place: quality.worst_place.as_ref().map(WorldPlaceDoc::from),
        }
    }
}

impl From<&Reason> for ReasonDoc {
    fn from(reason: &Reason) -> Self {
        Self {
            code: reason.code.to_string(),
            message: reason.message.clone(),
            value: Rounded(reason.value),
            threshold: Rounded(reason.threshold),
            place: reason.place.as_ref().map(WorldPlaceDoc::from),
        }
    }
}

impl From<&WorldPlace> for WorldPlaceDoc {
    fn from(place: &WorldPlace) -> Self {
        Self { figure: place.figure, position: triple(place.position.coords) }
    }
}

impl From<&Kept> for KeptDoc {
    fn from(kept: &Kept) -> Self {
        Self {
            kept_share: Rounded(kept.kept),
            dropped_share: Rounded(kept.dropped),
            refused_share: Rounded(kept.refused),
            lost_share: Rounded(kept.lost),
            thin_share: Rounded(kept.thin),
            filled_share: Rounded(kept.filled),
            closed_share: Rounded(kept.closed),
        }
    }
}

impl From<&Threshold> for ThresholdDoc {
    fn from(threshold: &Threshold) -> Self {
        Self {
            value: Rounded(threshold.value),
            bad: if threshold.is_bad_below { "below" } else { "above" }.to_owned(),
            warn: threshold.warn.map(Rounded),
            fail: threshold.fail.map(Rounded),
        }
    }
}

impl From<Coverage> for CoverageDoc {
    fn from(coverage: Coverage) -> Self {
        Self {
            dice: Rounded(coverage.dice),
            flat_dice: Rounded(coverage.flat_dice),
            grain_mm: Rounded(coverage.grain_mm),
            covered_share: Rounded(coverage.covered_share),
            far_share: Rounded(coverage.far_share),
            mask_to_model: coverage.mask_to_model.into(),
            model_to_mask: coverage.model_to_mask.into(),
        }
    }
}

impl From<DistanceSummary> for DistanceDoc {
    fn from(distance: DistanceSummary) -> Self {
        Self { mean_mm: Rounded(distance.mean_mm), p95_mm: Rounded(distance.p95_mm), max_mm: Rounded(distance.max_mm) }
    }
}

impl From<Distortion> for DistortionDoc {
    fn from(distortion: Distortion) -> Self {
        Self {
            area_sd: Rounded(distortion.area_sd),
            area_max_log: Rounded(distortion.area_max_log),
            angle_mean_deg: Rounded(distortion.angle_mean_deg),
            angle_max_deg: Rounded(distortion.angle_max_deg),
        }
    }
}

impl From<MeanAndP95> for MeanDoc {
    fn from(share: MeanAndP95) -> Self {
        Self { mean: Rounded(share.mean), p95: Rounded(share.p95) }
    }
}
