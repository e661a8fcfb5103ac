//! How far a result can be trusted.

use std::borrow::Cow;

use serde::{Deserialize, Serialize};

use crate::numerics::stats::{mean, percentile};

use super::side::{PerSurface, Side};
use crate::space::WorldPoint;

/// Surface distances, mm.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct DistanceSummary {
    /// Mean.
    pub mean_mm: f64,
    /// 95th percentile.
    pub p95_mm: f64,
    /// Largest.
    pub max_mm: f64,
}

/// How well the solid of cells and crest wedges fits the mask.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Coverage {
    /// Overlap of what the smooth surfaces through the nodes enclose with the mask.
    pub dice: f64,
    /// That of the flat quads between the nodes: what a coarse lattice leaves out.
    #[serde(default)]
    pub flat_dice: f64,
    /// What fits are measured in, mm: a voxel or, of thick objects, a tenth of the median radius.
    pub grain_mm: f64,
    /// Share of the mask's surface within one grain of the model's.
    pub covered_share: f64,
    /// Share of the mask's surface further than one and a half grains from the model's.
    #[serde(default)]
    pub far_share: f64,
    /// From the mask's surface to the model's.
    pub mask_to_model: DistanceSummary,
    /// From the model's surface to the mask's.
    pub model_to_mask: DistanceSummary,
}

/// What became of the voxels of a label, as shares of those that were sent.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Kept {
    /// Voxels that the figures stand for: all but those that were dropped, refused or lost.
    pub kept: f64,
    /// Voxels in parts that are too small for figures of their own.
    pub dropped: f64,
    /// Voxels in parts without a medial representation.
    pub refused: f64,
    /// Voxels too thin for the grid, or hanging on by a corner.
    pub lost: f64,
    /// Those of them in clumps too large for noise.
    pub thin: f64,
    /// Voxels that were added by filling cavities.
    pub filled: f64,
    /// Voxels that were added by closing gaps and tunnels.
    pub closed: f64,
}

impl Default for Kept {
    /// Nothing lost, nothing added.
    fn default() -> Self {
        Self { kept: 1.0, dropped: 0.0, refused: 0.0, lost: 0.0, thin: 0.0, filled: 0.0, closed: 0.0 }
    }
}

/// Where something is.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct WorldPlace {
    /// The figure it is of, or nearest to; none where it is of the mask alone.
    pub figure: Option<usize>,
    /// Where.
    pub position: WorldPoint,
}

/// What was done to a node so that no vectors cross or run astray; of several things the last in this order.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum NodeRepair {
    /// A vector was turned, or the node was moved along the sheet.
    Turned,
    /// A vector runs past the place where the inscribed ball touches the surface, along the sheet or into another part;
    /// it ends little further from the node than that place is.
    PastFoot,
    /// A vector, or the crest vector, was cut short of the surface.
    Shortened,
    /// The node was moved off the sheet.
    OffSheet,
    /// The node would have run into its neighbour, and was left where it was.
    Merged,
}

/// What was repaired before a figure was handed out.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Repair {
    /// Nodes of the lattice; 0 when nothing can be repaired, or need be.
    pub nodes: usize,
    /// Corners and centres of cells that were bad, or nearly so, before.
    pub folds_before: usize,
    /// Nodes with a vector that was turned, or a place that was moved.
    pub moved_nodes: usize,
    /// Nodes with a vector that runs past the place where the inscribed ball touches the surface, and ends inside.
    pub past_foot_nodes: usize,
    /// Nodes with a vector, or crest vector, that was cut short of the surface.
    pub shortened_nodes: usize,
    /// Nodes that were moved off the sheet.
    pub off_sheet_nodes: usize,
    /// Nodes that would have run into a neighbour.
    pub merged_nodes: usize,
    /// Nodes that are any of the last three.
    pub marred_nodes: usize,
}

impl Repair {
    /// Share of the nodes that were cut short, moved off the sheet or would have merged.
    #[must_use]
    pub fn marred_share(&self) -> f64 {
        self.marred_nodes as f64 / self.nodes.max(1) as f64
    }
}

/// How the medial quads differ between space and the intrinsic plane.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Distortion {
    /// Standard deviation of the area ratio (share of the sheet's area in space over share in
    /// the plane), weighted by the latter; the mean is 1.
    pub area_sd: f64,
    /// Largest |ln| of the area ratio.
    pub area_max_log: f64,
    /// Mean difference of the angle between the lattice directions, degrees.
    pub angle_mean_deg: f64,
    /// Largest difference of that angle, degrees.
    pub angle_max_deg: f64,
}

/// A share over nodes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct MeanAndP95 {
    /// Mean.
    pub mean: f64,
    /// 95th percentile.
    pub p95: f64,
}

impl MeanAndP95 {
    /// Of these values; zero when there are none.
    #[must_use]
    pub fn of(mut values: Vec<f64>) -> Self {
        values.sort_by(f64::total_cmp);
        Self { mean: mean(&values).unwrap_or(0.0), p95: percentile(&values, 95).unwrap_or(0.0) }
    }
}

/// A place of the lattice on one side of a sheet.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
pub struct LatticePlace {
    /// The side.
    pub side: Side,
    /// Row.
    pub i: usize,
    /// Column.
    pub j: usize,
}

/// How truly a surface was laid flat.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct EmbeddingQuality {
    /// 1 − R² of graph against embedded distances (Tenenbaum et al. 2000), after the best scaling.
    pub residual_variance: f64,
    /// Share of the surface that lies turned over in the plane; `None` where nothing can be judged.
    pub turned_over: Option<f64>,
    /// Mean change of the angles of small triangles, degrees; `None` where nothing can be judged.
    pub angle_error_deg: Option<f64>,
    /// How a plane stretches that is an injective map of the surface's mesh; `None` of one that is the embedding's own.
    /// The residual variance is that of the embedding in either case.
    #[serde(default)]
    pub unrolled: Option<Stretch>,
}

/// How much lengths differ between a surface and a plane that it was unrolled to.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Stretch {
    /// Mean over the area of (s² + s⁻² + t² + t⁻²) / 4, where s and t are the stretches of a small triangle in the two
    /// directions in which they are largest and smallest: 1 where all lengths are kept.
    pub energy: f64,
    /// The smallest stretch, plane over surface, but for a fiftieth of the area.
    pub least: f64,
    /// The largest stretch, but for a fiftieth of the area.
    pub most: f64,
}

/// How good one figure is.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct FigureQuality {
    /// How truly each surface was laid flat; `None` of a side that takes its coordinates from the sheet.
    pub embedding: PerSurface<Option<EmbeddingQuality>>,
    /// Corners of the cells between medial and surface quads whose Jacobian has the wrong sign.
    pub folds: usize,
    /// Corners looked at.
    pub corners: usize,
    /// Cells with a wrong corner or centre.
    pub folded_cells: Vec<LatticePlace>,
    /// Cells whose Jacobian has the wrong sign in the centre.
    pub folded_centres: usize,
    /// Crest wedges with a wrong corner or centre, at the edge node that comes first in the [`ring`](super::ring).
    pub folded_wedges: Vec<LatticePlace>,
    /// Wedges of a tube with a wrong corner, by their first row and column.
    #[serde(default)]
    pub folded_prisms: Vec<[usize; 2]>,
    /// What was repaired.
    pub repair: Repair,
    /// Pairs of triangles of the closed surface that run through each other; none without a
    /// closed surface.
    pub self_intersections: Option<usize>,
    /// How well it fits its share of the mask: what lies nearest to its inscribed balls.
    pub coverage: Coverage,
    /// Mean over lattice lines of the coefficient of variation of their edge lengths.
    pub spacing_variation: f64,
    /// Distortion of the parameterisation.
    pub distortion: Distortion,
    /// How far medial nodes are from the middle: |a − b| / (a + b) of the distances to the skin
    /// on both sides.
    pub medial_offset: MeanAndP95,
    /// Share of nodes that lie on the sheet.
    pub valid_share: f64,
    /// Share of the points of vectors that are more than a voxel outside of the label.
    #[serde(default)]
    pub outside_share: f64,
}

impl Verdict {
    /// Its name in artifacts.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Pass => "pass",
            Self::Warn => "warn",
            Self::Fail => "fail",
        }
    }
}

impl FigureQuality {
    /// Residual variance of each surface.
    #[must_use]
    pub fn residual_variance(&self) -> PerSurface<Option<f64>> {
        self.embedding.map(|embedding| embedding.map(|embedding| embedding.residual_variance))
    }
}

/// How far a result can be trusted.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
pub enum Verdict {
    /// Every measure is inside its threshold.
    #[default]
    Pass,
    /// Usable; read the reasons.
    Warn,
    /// Not to be used for measurements.
    Fail,
}

/// A measure outside its threshold.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Reason {
    /// Stable code, snake case.
    pub code: Cow<'static, str>,
    /// One sentence.
    pub message: String,
    /// The measure.
    pub value: f64,
    /// Its threshold.
    pub threshold: f64,
    /// The worst place, where there is one.
    #[serde(default)]
    pub place: Option<WorldPlace>,
}

/// A measure that the verdict looks at.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Threshold {
    /// Stable code, snake case; that of the reason it gives.
    pub code: Cow<'static, str>,
    /// The measure, of the worst figure where it is one of figures.
    pub value: f64,
    /// Whether small values are the bad ones.
    pub is_bad_below: bool,
    /// Beyond this, and where it is no number, the verdict is at best a warning.
    pub warn: Option<f64>,
    /// Beyond this, and where it is no number, the verdict is a failure.
    pub fail: Option<f64>,
}

impl Threshold {
    /// What this measure alone says.
    #[must_use]
    pub fn verdict(&self) -> Verdict {
        if self.is_beyond(self.fail) {
            Verdict::Fail
        } else if self.is_beyond(self.warn) {
            Verdict::Warn
        } else {
            Verdict::Pass
        }
    }

    /// Whether the measure is not on the good side of a limit, if there is one. What is no number is on none.
    fn is_beyond(&self, limit: Option<f64>) -> bool {
        let Some(limit) = limit else { return false };
        let is_good = if self.is_bad_below { self.value >= limit } else { self.value <= limit };
        !is_good
    }
}

/// How good a structure is.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct StructureQuality {
    /// The worst of the reasons.
    pub verdict: Verdict,
    /// Why the verdict is not a pass.
    pub reasons: Vec<Reason>,
    /// All that the verdict follows from.
    pub thresholds: Vec<Threshold>,
    /// How well all figures together fit the mask.
    pub coverage: Coverage,
    /// Folds of all figures.
    pub folds: usize,
    /// Cells with a folded centre, of all figures.
    pub folded_centres: usize,
    /// Folded crest wedges of all figures.
    pub folded_wedges: usize,
    /// Repairs of all figures.
    pub repair: Repair,
    /// Self-intersections of all figures that have a closed surface.
    pub self_intersections: Option<usize>,
    /// The largest residual variance of any surface whose plane is the embedding's own.
    pub residual_variance: f64,
    /// The largest share of any surface that lies turned over in its plane; `None` where nothing can be judged.
    pub turned_over: Option<f64>,
    /// The largest spacing variation of a figure.
    pub spacing_variation: f64,
    /// The largest of each distortion of a figure.
    pub distortion: Distortion,
    /// The largest of each of a figure.
    pub medial_offset: MeanAndP95,
    /// Sheets of the medial surface that were pruned.
    pub pruned_sheets: usize,
    /// What became of the label's voxels.
    #[serde(default)]
    pub kept: Kept,
    /// The largest share of a figure's vectors that is outside of the label.
    #[serde(default)]
    pub outside_share: f64,
    /// Where the label's surface is furthest from the model: by `coverage.mask_to_model.max_mm`.
    #[serde(default)]
    pub worst_place: Option<WorldPlace>,
}

impl StructureQuality {
    /// The first of the reasons that are as bad as the verdict; `None` for a pass. A failure is not told by what is
    /// only a warning.
    #[must_use]
    pub fn deciding_reason(&self) -> Option<&Reason> {
        let mut deciding = self.thresholds.iter().filter(|threshold| threshold.verdict() == self.verdict);
        let code = &deciding.next()?.code;
        self.reasons.iter().find(|reason| reason.code == *code)
    }
}
