//! The medial representation as plain data: what the pipeline returns and the formats write.

use crate::space::{ParamPoint, WorldFromVoxel, WorldPoint, WorldVector};

use super::automatic::Automatic;
use super::frame::FrameFacts;
use super::observer::{Stage, Warning};
use super::params::{CheckedParams, LatticeSize};
use super::refusal::Refusal;
use super::uncertainty::Uncertainty;

/// A value for each of the three surfaces of a figure.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct PerSurface<T> {
    /// The medial sheet.
    pub medial: T,
    /// The side that [`Figure::upper`] lies on.
    pub upper: T,
    /// The other side.
    pub lower: T,
}

impl<T> PerSurface<T> {
    /// The three with their names, in the order medial, upper, lower.
    #[must_use]
    pub fn named(&self) -> [(&'static str, &T); 3] {
        [("medial", &self.medial), ("upper", &self.upper), ("lower", &self.lower)]
    }
}

/// The points of one surface and where ISOMAP put them.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct FlatPoints {
    /// World positions, mm.
    pub positions: Vec<WorldPoint>,
    /// Intrinsic coordinates, mm, one per position.
    pub flat: Vec<ParamPoint>,
}

/// Surface distances, mm.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct DistanceSummary {
    /// Mean.
    pub mean_mm: f64,
    /// 95th percentile.
    pub p95_mm: f64,
    /// Largest.
    pub max_mm: f64,
}

/// How well the solid of cells and crest wedges fits the mask.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Coverage {
    /// Overlap of all cells, crest wedges included, with the mask.
    pub dice: f64,
    /// What fits are measured in, mm: a voxel or, of thick objects, a tenth of the median radius.
    pub grain_mm: f64,
    /// Share of the mask's surface within one grain of the model's.
    pub covered_share: f64,
    /// From the mask's surface to the model's.
    pub mask_to_model: DistanceSummary,
    /// From the model's surface to the mask's.
    pub model_to_mask: DistanceSummary,
}

/// What was repaired before a figure was handed out.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Repair {
    /// Corners and centres of cells that were bad, or nearly so, before.
    pub folds_before: usize,
    /// Nodes with a vector that was turned, or a place that was moved.
    pub moved_nodes: usize,
    /// Nodes with a vector, or crest vector, that ends short of the surface.
    pub shortened_nodes: usize,
}

/// How the medial quads differ between space and the intrinsic plane.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
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
#[derive(Clone, Copy, Debug, Default, PartialEq)]
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
        let Some(last) = values.len().checked_sub(1) else { return Self::default() };
        Self { mean: values.iter().sum::<f64>() / values.len() as f64, p95: values[last * 95 / 100] }
    }
}

/// How good one figure is.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct FigureQuality {
    /// 1 − R² of graph against embedded distances (Tenenbaum et al. 2000).
    pub residual_variance: PerSurface<f64>,
    /// Corners of the cells between medial and surface quads whose Jacobian has the wrong sign.
    pub folds: usize,
    /// Corners looked at.
    pub corners: usize,
    /// Cells with a wrong corner or centre: (side is upper, i, j).
    pub folded_cells: Vec<(bool, usize, usize)>,
    /// Cells whose Jacobian has the wrong sign in the centre.
    pub folded_centres: usize,
    /// Crest wedges with a wrong corner or centre: (side is upper, i, j) of the edge node that
    /// comes first in the [`ring`].
    pub folded_wedges: Vec<(bool, usize, usize)>,
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
}

/// One single sheet and its two sides, sampled on an N × M lattice.
#[derive(Clone, Debug, Default)]
pub struct Figure {
    /// Lattice size; all node arrays hold rows · cols entries, row-major (i slow).
    pub grid: LatticeSize,
    /// Medial nodes.
    pub medial: Vec<WorldPoint>,
    /// Upper nodes.
    pub upper: Vec<WorldPoint>,
    /// Lower nodes.
    pub lower: Vec<WorldPoint>,
    /// Crest points, one per node of the lattice edge in the order of [`ring`].
    pub crest: Vec<WorldPoint>,
    /// Whether a node lies on the sheet (always, for the fitted lattice).
    pub valid: Vec<bool>,
    /// Radius of the largest ball inside the object centred at a medial node, mm.
    pub medial_radius_mm: Vec<f64>,
    /// Natural logarithm of (share of the medial sheet's area in space) / (share in the intrinsic
    /// plane) of the quads round each node; not a number for a node without a quad.
    pub area_distortion: Vec<f64>,
    /// Intrinsic coordinates of the nodes on each surface.
    pub intrinsic: PerSurface<Vec<ParamPoint>>,
    /// Neighbours per point of the ISOMAP graph, the mean where it varies.
    pub neighbors: PerSurface<f64>,
    /// Landmarks used on each surface.
    pub landmarks: PerSurface<usize>,
    /// All points of each surface with their flat coordinates.
    pub points: PerSurface<FlatPoints>,
    /// How good it is.
    pub quality: FigureQuality,
    /// Which way rows, columns and sides lie in the world.
    pub frame: FrameFacts,
    /// What was chosen for it and why.
    pub automatic: Automatic,
    /// Spread of its thickness, when asked for.
    pub uncertainty: Option<Uncertainty>,
}

impl Figure {
    /// Thickness vectors to the upper side.
    #[must_use]
    pub fn upper_vectors(&self) -> Vec<WorldVector> {
        vectors(&self.medial, &self.upper)
    }

    /// Thickness vectors to the lower side.
    #[must_use]
    pub fn lower_vectors(&self) -> Vec<WorldVector> {
        vectors(&self.medial, &self.lower)
    }
}

fn vectors(from: &[WorldPoint], to: &[WorldPoint]) -> Vec<WorldVector> {
    from.iter().zip(to).map(|(a, b)| b - a).collect()
}

/// The nodes round the edge of a lattice as row-major offsets: (0,0)…(0,M−1), (1,M−1)…(N−1,M−1),
/// (N−1,M−2)…(N−1,0), (N−2,0)…(1,0).
#[must_use]
pub fn ring(grid: LatticeSize) -> Vec<usize> {
    let LatticeSize { rows, cols } = grid;
    let top = (0..cols).map(|j| (0, j));
    let right = (1..rows).map(|i| (i, cols - 1));
    let bottom = (0..cols - 1).rev().map(|j| (rows - 1, j));
    let left = (1..rows - 1).rev().map(|i| (i, 0));
    top.chain(right).chain(bottom).chain(left).map(|(i, j)| i * cols + j).collect()
}

/// Where sheets meet (a hinge).
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Junction {
    /// Indices of the figures that meet.
    pub figures: Vec<usize>,
    /// Points of the hinge.
    pub points: Vec<WorldPoint>,
}

/// How far a result can be trusted.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
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
#[derive(Clone, Debug, PartialEq)]
pub struct Reason {
    /// Stable code, snake case.
    pub code: &'static str,
    /// One sentence.
    pub message: String,
    /// The measure.
    pub value: f64,
    /// Its threshold.
    pub threshold: f64,
}

/// A measure that the verdict looks at.
#[derive(Clone, Debug, PartialEq)]
pub struct Threshold {
    /// Stable code, snake case; that of the reason it gives.
    pub code: &'static str,
    /// The measure, of the worst figure where it is one of figures.
    pub value: f64,
    /// Whether small values are the bad ones.
    pub is_bad_below: bool,
    /// Beyond this, and where it is no number, the verdict is at best a warning.
    pub warn: Option<f64>,
    /// Beyond this, and where it is no number, the verdict is a failure.
    pub fail: Option<f64>,
}

/// How good a structure is.
#[derive(Clone, Debug, Default, PartialEq)]
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
    /// The largest residual variance of any surface.
    pub residual_variance: f64,
    /// The largest spacing variation of a figure.
    pub spacing_variation: f64,
    /// The largest of each distortion of a figure.
    pub distortion: Distortion,
    /// The largest of each of a figure.
    pub medial_offset: MeanAndP95,
    /// Sheets of the medial surface that were pruned.
    pub pruned_sheets: usize,
}

/// A triangle mesh in world space.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct TriangleMesh {
    /// Corners, mm.
    pub positions: Vec<WorldPoint>,
    /// Corner indices, counter-clockwise seen from outside.
    pub triangles: Vec<[u32; 3]>,
}

/// One label's result.
#[derive(Clone, Debug)]
pub struct Structure {
    /// Its value in the file.
    pub label: i64,
    /// Voxels with that value.
    pub voxels: u64,
    /// Their volume.
    pub volume_mm3: f64,
    /// Edge of the isotropic working voxel, mm.
    pub working_voxel_mm: f64,
    /// The sheets, the largest first; empty when refused.
    pub figures: Vec<Figure>,
    /// Where they meet.
    pub junctions: Vec<Junction>,
    /// Sheets of the skeleton that were pruned.
    pub pruned: usize,
    /// How good it is.
    pub quality: StructureQuality,
    /// What its reader should know.
    pub warnings: Vec<Warning>,
    /// Why there is no medial representation.
    pub refusal: Option<Refusal>,
    /// The smooth outer surface of the mask.
    pub object: TriangleMesh,
    /// Wall time of each stage.
    pub timings: StageTimings,
}

/// Wall milliseconds of each stage, in the order of [`Stage::ALL`].
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct StageTimings(pub [f64; Stage::ALL.len()]);

impl StageTimings {
    /// Milliseconds of one stage.
    #[must_use]
    pub fn of(&self, stage: Stage) -> f64 {
        self.0[stage as usize]
    }

    /// Milliseconds of all stages.
    #[must_use]
    pub fn total(&self) -> f64 {
        self.0.iter().sum()
    }
}

/// A whole result: one structure per label.
#[derive(Clone, Debug)]
pub struct Model {
    /// The parameters used.
    pub params: CheckedParams,
    /// Where the input's voxels lie.
    pub world_from_voxel: WorldFromVoxel,
    /// Voxels of the input along each axis.
    pub dims: [usize; 3],
    /// One per label, ascending, or in the order asked for.
    pub structures: Vec<Structure>,
}
