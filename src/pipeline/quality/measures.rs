//! Stage 8, third part: how even and how well centred a lattice is.

use nalgebra::{Point2, Point3, Vector3};
use rayon::prelude::*;

use crate::cancel::{Cancel, Cancelled};
use crate::model::LatticeSize;
use crate::model::{Distortion, MeanAndP95};
use crate::model::{Quad, Shell, quad_area};
use crate::pipeline::quality::coverage::SkinSearch;
use crate::pipeline::vectors::Nodes;

/// Mean over lattice lines, rows and columns alike, of the coefficient of variation of their
/// edge lengths.
#[must_use]
pub fn spacing_variation(size: LatticeSize, nodes: &[Point3<f64>]) -> f64 {
    let line = |indices: Vec<usize>| {
        let edges: Vec<f64> = indices.windows(2).map(|p| (nodes[p[1]] - nodes[p[0]]).norm()).collect();
        let mean = edges.iter().sum::<f64>() / edges.len() as f64;
        let variance = edges.iter().map(|e| (e - mean).powi(2)).sum::<f64>() / edges.len() as f64;
        variance.sqrt() / mean.max(1e-12)
    };
    let LatticeSize { rows, cols } = size;
    let along: f64 = (0..rows).map(|i| line((0..cols).map(|j| i * cols + j).collect())).sum();
    let across: f64 = (0..cols).map(|j| line((0..rows).map(|i| i * cols + j).collect())).sum();
    (along / rows as f64 + across / cols as f64) / 2.0
}

/// The medial quads of a figure in space and in the intrinsic plane.
///
/// The area ratio of quads is their share of the sheet's area in space over their share in the
/// plane: 1 everywhere when areas are kept up to scale.
pub struct FlatQuads<'a> {
    space: &'a [Point3<f64>],
    plane: Vec<Point3<f64>>,
    quads: Vec<Quad>,
    /// Of each quad, in space and in the plane.
    areas: Vec<[f64; 2]>,
    /// Their sum.
    whole: [f64; 2],
}

impl<'a> From<&'a Nodes> for FlatQuads<'a> {
    fn from(nodes: &'a Nodes) -> Self {
        Self::of(nodes.into(), &nodes.intrinsic.medial)
    }
}

impl<'a> FlatQuads<'a> {
    /// Those of `shell`, `plane` being the plane coordinates of its medial nodes, in any unit.
    #[must_use]
    pub fn of(shell: Shell<'a>, plane: &[Point2<f64>]) -> Self {
        let (space, quads) = (shell.medial, shell.quads().collect::<Vec<Quad>>());
        let plane: Vec<Point3<f64>> = plane.iter().map(|p| Point3::new(p.x, p.y, 0.0)).collect();
        let area_in = |points: &[Point3<f64>], quad: &Quad| quad_area(quad.nodes.map(|n| points[n]));
        let areas: Vec<_> = quads.iter().map(|quad| [area_in(space, quad), area_in(&plane, quad)]).collect();
        let whole = areas.iter().fold([0.0; 2], |sum, a| [sum[0] + a[0], sum[1] + a[1]]);
        Self { space, plane, quads, areas, whole }
    }

    /// Area ratio of quads that have these areas together; no number without any.
    fn ratio(&self, [in_space, in_plane]: [f64; 2]) -> f64 {
        (in_space / self.whole[0]) / (in_plane / self.whole[1])
    }

    /// How they differ, over all quads.
    ///
    /// The angle is the one between the two lattice directions at each corner of a quad. Infinite
    /// where a quad has no area; zero without quads.
    #[must_use]
    pub fn distortion(&self) -> Distortion {
        let mut result = Distortion::default();
        let mut variance = 0.0;
        for &areas in &self.areas {
            let ratio = self.ratio(areas);
            // Weights are shares of the plane: their mean ratio is 1.
            variance += areas[1] / self.whole[1] * (ratio - 1.0).powi(2);
            result.area_max_log = worse(result.area_max_log, ratio.ln().abs());
        }
        result.area_sd = worse(0.0, variance.sqrt());
        let angles: Vec<f64> = self.quads.iter().flat_map(|q| corner_turns(self.space, &self.plane, q)).collect();
        result.angle_mean_deg = angles.iter().sum::<f64>() / angles.len().max(1) as f64;
        result.angle_max_deg = angles.iter().copied().fold(0.0, worse);
        result
    }

    /// Natural logarithm of the area ratio of the quads round each node, one per node: above 0
    /// where the plane shows the sheet too small. Not a number for a node without a quad, nor
    /// finite where its quads have no area.
    #[must_use]
    pub fn log_ratio_per_node(&self) -> Vec<f64> {
        let mut round = vec![[0.0; 2]; self.space.len()];
        for (quad, [in_space, in_plane]) in self.quads.iter().zip(&self.areas) {
            for &node in &quad.nodes {
                round[node][0] += in_space;
                round[node][1] += in_plane;
            }
        }
        round.into_iter().map(|areas| self.ratio(areas).ln()).collect()
    }
}

/// The larger of the two; what is no number is infinite.
pub(super) fn worse(a: f64, b: f64) -> f64 {
    if b.is_nan() { f64::INFINITY } else { a.max(b) }
}

/// At the four corners of a quad: by how many degrees the angle between the lattice directions
/// differs from that in the plane.
fn corner_turns(space: &[Point3<f64>], plane: &[Point3<f64>], quad: &Quad) -> [f64; 4] {
    let angle = |points: &[Point3<f64>], k: usize| {
        let at = |k: usize| points[quad.nodes[k]];
        (at(2 | (k & 1)) - at(k & 1)).angle(&(at((k & 2) | 1) - at(k & 2)))
    };
    [0, 1, 2, 3].map(|k| (angle(space, k) - angle(plane, k)).abs().to_degrees())
}

/// How far the medial nodes are from the middle: |a − b| / (a + b), with a and b the distances
/// to the nearest skin on the one and on the other side of the sheet that faces away from it
/// within 60° of its normal: a blunt rim is as near on both sides and says nothing. Zero of a perfect medial sheet, one of
/// a node on the skin or outside. The vectors are not used: they need not be the shortest way.
///
/// # Errors
/// When it is cancelled.
pub fn medial_offset(nodes: &Nodes, skin: &SkinSearch<'_>, cancel: &dyn Cancel) -> Result<MeanAndP95, Cancelled> {
    /// Cosine of 60°, the angle at which skin stops to be crest in the stage of the sides, too.
    const FACING_COSINE: f64 = 0.5;
    /// Nodes looked at; more say nothing new and cost time.
    const MOST: usize = 2000;
    let valid: Vec<usize> = (0..nodes.medial.len()).filter(|&n| nodes.valid[n]).collect();
    let step = valid.len().div_ceil(MOST).max(1);
    let offset = |node: usize| {
        let at = nodes.medial[node];
        let [up, down] = [nodes.upper[node] - at, nodes.lower[node] - at];
        let normal = normal(nodes, node).unwrap_or(up - down);
        // The surface nodes lie on the skin; the nearest that faces away is not much further off.
        let reach = 2.0 * up.norm().max(down.norm()) + 2.0;
        let mut sides = [f64::INFINITY; 2];
        for skin in skin.within(at, reach) {
            let side = usize::from((skin.position - at).dot(&normal) < 0.0);
            let facing = skin.normal.dot(&normal) / normal.norm() * [1.0, -1.0][side];
            if facing >= FACING_COSINE {
                sides[side] = sides[side].min(skin.distance(at));
            }
        }
        let has_both = sides.iter().all(|s| s.is_finite());
        // Without skin on one of the sides it is on the other.
        if has_both { (sides[0] - sides[1]).abs() / (sides[0] + sides[1]).max(1e-12) } else { 1.0 }
    };
    let offset = |&node: &usize| cancel.check().map(|()| offset(node));
    Ok(MeanAndP95::of(valid.par_iter().step_by(step).map(offset).collect::<Result<_, _>>()?))
}

/// Normal of the medial lattice at a node, of any sign and length.
fn normal(nodes: &Nodes, node: usize) -> Option<Vector3<f64>> {
    let LatticeSize { rows, cols } = nodes.size;
    let (i, j) = (node / cols, node % cols);
    let at = |i: usize, j: usize| nodes.medial[i * cols + j];
    let along_i = at((i + 1).min(rows - 1), j) - at(i.saturating_sub(1), j);
    let along_j = at(i, (j + 1).min(cols - 1)) - at(i, j.saturating_sub(1));
    let normal = along_i.cross(&along_j);
    (normal.norm() > 1e-9).then_some(normal)
}
