//! How even a lattice is, in space and against its plane.

use nalgebra::{Point2, Point3};

use crate::model::{Distortion, LatticeSize, Quad, Shell, quad_area};
use crate::pipeline::tubes::wall::TubeNodes;
use crate::pipeline::vectors::Nodes;

/// Mean over lattice lines, rows and columns alike, of the coefficient of variation of their
/// edge lengths.
#[must_use]
pub fn spacing_variation(size: LatticeSize, nodes: &[Point3<f64>]) -> f64 {
    let LatticeSize { rows, cols } = size;
    let (mut along, mut across) = (0.0, 0.0);
    for i in 0..rows {
        along += line_variation(&nodes[i * cols..], 1, cols);
    }
    for j in 0..cols {
        across += line_variation(&nodes[j..], cols, rows);
    }
    (along / rows as f64 + across / cols as f64) / 2.0
}

/// The same of a tube: of its closed wall lines around, and of its centreline between the end centres.
#[must_use]
pub fn tube_spacing(nodes: &TubeNodes) -> f64 {
    let LatticeSize { rows, cols } = nodes.size;
    let mut around = 0.0;
    for col in 0..cols {
        let mut ring = nodes.ring(col);
        ring.push(ring[0]);
        around += line_variation(&ring, 1, rows + 1);
    }
    let between = &nodes.centres[nodes.caps[0]..cols - nodes.caps[1]];
    let along = if between.len() > 2 { line_variation(between, 1, between.len()) } else { 0.0 };
    (around / cols as f64 + along) / 2.0
}

/// What rolling out does to the wall of a tube between its caps; `intrinsic`: lengths along and around of its nodes.
#[must_use]
pub fn wall_distortion(nodes: &TubeNodes, intrinsic: &[Point2<f64>]) -> Distortion {
    let LatticeSize { rows, cols } = nodes.size;
    let body = nodes.caps[0]..cols - nodes.caps[1];
    let size = LatticeSize { rows: rows + 1, cols: body.len() };
    let (mut wall, mut plane) = (Vec::new(), Vec::new());
    for row in 0..=rows {
        for col in body.clone() {
            wall.push(nodes.wall_at(row, col));
            let mut place = intrinsic[nodes.node(row, col)];
            if row == rows {
                // Round once: the last node's place and the way home from it.
                let last = intrinsic[nodes.node(rows - 1, col)];
                place.y = last.y + (nodes.wall_at(0, col) - nodes.wall_at(rows - 1, col)).norm();
            }
            plane.push(place);
        }
    }
    let valid = vec![true; wall.len()];
    let none: &[Point3<f64>] = &[];
    let shell = Shell { size, medial: &wall, upper: none, lower: none, crest: none, flanks: &[], valid: &valid };
    FlatQuads::of(shell, &plane).distortion()
}

/// Coefficient of variation of the edge lengths of a line of `count` nodes, every `step`th from the first on.
fn line_variation(nodes: &[Point3<f64>], step: usize, count: usize) -> f64 {
    let mut edges = Vec::with_capacity(count);
    for n in 1..count {
        edges.push((nodes[n * step] - nodes[(n - 1) * step]).norm());
    }
    let mean = edges.iter().sum::<f64>() / edges.len() as f64;
    let variance = edges.iter().map(|e| (e - mean).powi(2)).sum::<f64>() / edges.len() as f64;
    variance.sqrt() / mean.max(1e-12)
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
        let space = shell.medial;
        let plane: Vec<Point3<f64>> = plane.iter().map(|p| Point3::new(p.x, p.y, 0.0)).collect();
        let quads: Vec<Quad> = shell.quads().collect();
        let (mut areas, mut whole) = (Vec::with_capacity(quads.len()), [0.0; 2]);
        for quad in &quads {
            let [in_space, in_plane] = [quad_area(quad.corners(space)), quad_area(quad.corners(&plane))];
            areas.push([in_space, in_plane]);
            whole = [whole[0] + in_space, whole[1] + in_plane];
        }
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
        let mut angles = Vec::with_capacity(4 * self.quads.len());
        for quad in &self.quads {
            angles.extend(corner_turns(quad.corners(self.space), quad.corners(&self.plane)));
        }
        result.angle_mean_deg = angles.iter().sum::<f64>() / angles.len().max(1) as f64;
        result.angle_max_deg = angles.iter().copied().fold(0.0, worse);
        result
    }

    /// Natural logarithm of the area ratio of the quads round each node, one per node: above 0
    /// where the plane shows the sheet too small. `None` for a node without a quad, and where its
    /// quads have no area.
    #[must_use]
    pub fn log_ratio_per_node(&self) -> Vec<Option<f64>> {
        let mut round = vec![[0.0; 2]; self.space.len()];
        for (quad, [in_space, in_plane]) in self.quads.iter().zip(&self.areas) {
            for &node in &quad.nodes {
                round[node][0] += in_space;
                round[node][1] += in_plane;
            }
        }
        round.into_iter().map(|areas| Some(self.ratio(areas).ln()).filter(|log| log.is_finite())).collect()
    }
}

/// The larger of the two; what is no number is infinite.
pub(super) fn worse(a: f64, b: f64) -> f64 {
    if b.is_nan() { f64::INFINITY } else { a.max(b) }
}

/// At the four corners of a quad: by how many degrees the angle between the lattice directions
/// differs from that in the plane.
fn corner_turns(space: [Point3<f64>; 4], plane: [Point3<f64>; 4]) -> [f64; 4] {
    [0, 1, 2, 3].map(|k| (corner_angle(space, k) - corner_angle(plane, k)).abs().to_degrees())
}

/// The angle between the lattice directions at a corner of a quad.
fn corner_angle(quad: [Point3<f64>; 4], k: usize) -> f64 {
    let (along_i, along_j) = (quad[2 | (k & 1)] - quad[k & 1], quad[(k & 2) | 1] - quad[k & 2]);
    along_i.angle(&along_j)
}
