//! A tube: a part of an organ that is represented by a centreline and the wall round it.

use nalgebra::{Point3, Vector3};
use serde::{Deserialize, Serialize};

use super::automatic::Automatic;
use super::frame::FrameFacts;
use super::lattice::LatticeSize;
use super::meshes::{SurfaceMesh, TriangleMesh, normals};
use super::quality::{FigureQuality, NodeRepair};
use super::summary::{LengthSummary, length_summary};
use crate::numerics::field::id;
use crate::numerics::polyline::{Polyline, vector_area};
use crate::numerics::triangles::volume;
use crate::space::{ParamPoint, WorldPoint, WorldVector};

/// A centreline and closed wall curves round it, `rows` nodes around by `cols` along.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub struct Tube {
    /// Nodes around (i, closed), and along (j).
    pub grid: LatticeSize,
    /// The centre of each column; those of a cap are all its end centre.
    pub centreline: Vec<WorldPoint>,
    /// Wall nodes, row-major.
    pub wall: Vec<WorldPoint>,
    /// The tips, before the first column and beyond the last.
    pub tips: [WorldPoint; 2],
    /// How many of the first and of the last columns are those of a cap.
    pub caps: [usize; 2],
    /// What was done to each node so that no vectors cross.
    pub repaired: Vec<Option<NodeRepair>>,
    /// Radius of the largest ball inside the object centred at each column's centre, mm.
    pub medial_radius_mm: Vec<f64>,
    /// Arc length along, and around, of each node, mm.
    pub intrinsic: Vec<ParamPoint>,
    /// How good it is.
    pub quality: FigureQuality,
    /// Which way it lies in the world: columns along the tube, `upper_towards` where row 0 faces.
    pub frame: FrameFacts,
    /// What was chosen for it and why.
    pub automatic: Automatic,
    /// Spread of its lengths, when asked for.
    pub uncertainty: Option<WallUncertainty>,
    /// Which part of the structure it belongs to.
    #[serde(default)]
    pub part: usize,
    /// The figure that it branches off.
    #[serde(default)]
    pub parent: Option<usize>,
}

/// Spread of the lengths of a tube over the repeats.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct WallUncertainty {
    /// Repeats that were run.
    pub repeats: usize,
    /// Repeats in which the tube was found again.
    pub matched: usize,
    /// Standard deviation of the length of the vector, one per node, mm; `None` with fewer than two matched repeats.
    pub wall_mm: Vec<Option<f64>>,
    /// The same of the vector and the one opposite together.
    pub total_mm: Vec<Option<f64>>,
}

/// A cross-section of a tube.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct TubeSection {
    /// Length along the centreline from its first end, mm.
    pub station_mm: f64,
    /// Area, mm².
    pub area_mm2: f64,
    /// Length round it, mm.
    pub perimeter_mm: f64,
    /// Radius of the circle of that area, mm.
    pub radius_mm: f64,
    /// Curvature of the centreline there, 1/mm.
    pub curvature_per_mm: f64,
}

/// A tube in a few numbers. Means are taken along the centreline between the end centres, but for lengths of vectors, which
/// are weighted by the area of the wall.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TubeSummary {
    /// Length from tip to tip, mm.
    pub length_mm: f64,
    /// That length over the distance of the tips; `None` of a ring.
    pub tortuosity: Option<f64>,
    /// Radius of sections.
    pub radius_mm: Option<LengthSummary>,
    /// Area of sections, mm².
    pub section_area_mm2: Option<LengthSummary>,
    /// Curvature of the centreline, 1/mm.
    pub curvature_per_mm: Option<LengthSummary>,
}

/// Lengths of a tube's vectors, but for nodes that repair spoilt.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct WallSummary {
    /// From the centre to the wall.
    pub wall_mm: Option<LengthSummary>,
    /// The same and that of the vector opposite.
    pub total_mm: Option<LengthSummary>,
    /// Area of the wall, mm².
    pub area_mm2: f64,
}

/// The node arrays of a tube, in any space.
#[derive(Clone, Copy, Debug)]
pub struct TubeShell<'a> {
    /// Nodes around, and along.
    pub size: LatticeSize,
    /// Centres of the columns.
    pub centres: &'a [Point3<f64>],
    /// Wall nodes, row-major.
    pub wall: &'a [Point3<f64>],
    /// The tips.
    pub tips: [Point3<f64>; 2],
}

impl<'a> From<&'a Tube> for TubeShell<'a> {
    fn from(tube: &'a Tube) -> Self {
        Self { size: tube.grid, centres: &tube.centreline, wall: &tube.wall, tips: tube.tips }
    }
}

impl TubeShell<'_> {
    /// The wall quads `[(i, j), (i, j+1), (i+1, j), (i+1, j+1)]` by their nodes, row-major; the last row's lead to the first.
    #[must_use]
    pub fn quads(&self) -> Vec<[usize; 4]> {
        let LatticeSize { rows, cols } = self.size;
        let mut quads = Vec::with_capacity(rows * cols);
        for i in 0..rows {
            let next = (i + 1) % rows;
            for j in 0..cols.saturating_sub(1) {
                quads.push([i * cols + j, i * cols + j + 1, next * cols + j, next * cols + j + 1]);
            }
        }
        quads
    }

    /// Whether the tube is a ring: its last column is the first again, and the tips lie at the centre that they share.
    #[must_use]
    pub fn is_ring(&self) -> bool {
        let [first, last] = self.tips;
        self.size.cols > 2 && first == last && self.centres.first() == Some(&first)
    }

    /// The tips that the first and the last column are closed by, each with its column; none of a ring.
    #[must_use]
    pub fn fans(&self) -> Vec<(Point3<f64>, usize)> {
        if self.is_ring() {
            return Vec::new();
        }
        vec![(self.tips[0], 0), (self.tips[1], self.size.cols - 1)]
    }

    /// The wall and the fans of the tips as one watertight mesh that faces outward. `None` when a node is not finite or
    /// there are fewer than three rows or one column.
    #[must_use]
    pub fn closed(&self) -> Option<TriangleMesh> {
        let LatticeSize { rows, cols } = self.size;
        let mut positions = self.wall.to_vec();
        positions.extend(self.tips);
        if rows < 3 || cols < 1 || !positions.iter().all(|p| p.iter().all(|x| x.is_finite())) {
            return None;
        }
        let is_ring = self.is_ring();
        // In a ring the last column is the first again.
        let corner = |n: usize| id(if is_ring && n % cols == cols - 1 { n + 1 - cols } else { n });
        let mut triangles = Vec::new();
        for [a, b, c, d] in self.quads() {
            triangles.extend([[a, b, c], [b, d, c]].map(|corners| corners.map(corner)));
        }
        let [first, last] = [id(self.wall.len()), id(self.wall.len() + 1)];
        for i in 0..if is_ring { 0 } else { rows } {
            let next = (i + 1) % rows;
            triangles.push([first, id(i * cols), id(next * cols)]);
            triangles.push([last, id(next * cols + cols - 1), id(i * cols + cols - 1)]);
        }
        let mut mesh = TriangleMesh { positions, triangles };
        if volume(&mesh.positions, &mesh.triangles) < 0.0 {
            mesh.triangles.iter_mut().for_each(|t| t.swap(1, 2));
        }
        Some(mesh)
    }
}

impl Tube {
    /// The centre of each node's column, one per node.
    #[must_use]
    pub fn medial(&self) -> Vec<WorldPoint> {
        (0..self.wall.len()).map(|n| self.centreline[n % self.grid.cols]).collect()
    }

    /// Vectors from the centres to the wall, one per node.
    #[must_use]
    pub fn vectors(&self) -> Vec<WorldVector> {
        self.wall.iter().zip(self.medial()).map(|(to, from)| to - from).collect()
    }

    /// Their lengths, mm.
    #[must_use]
    pub fn lengths_mm(&self) -> Vec<f64> {
        self.vectors().iter().map(WorldVector::norm).collect()
    }

    /// Length of each vector and of the one opposite, half the rows on, mm.
    #[must_use]
    pub fn total_mm(&self) -> Vec<f64> {
        opposite_sums(&self.lengths_mm(), self.grid)
    }

    /// The area of the wall round each node, mm²: a quarter of each adjacent quad.
    #[must_use]
    pub fn node_areas_mm2(&self) -> Vec<f64> {
        let mut areas = vec![0.0; self.wall.len()];
        for quad in TubeShell::from(self).quads() {
            let area = super::shell::quad_area(quad.map(|n| self.wall[n]));
            quad.iter().for_each(|&n| areas[n] += area / 4.0);
        }
        areas
    }

    /// Whether repair spoilt a node, so that its vector is no length of the organ.
    #[must_use]
    pub fn is_marred(&self, node: usize) -> bool {
        self.repaired.get(node).copied().flatten() >= Some(NodeRepair::Shortened)
    }

    /// The cross-section of each column.
    #[must_use]
    pub fn sections(&self) -> Vec<TubeSection> {
        let LatticeSize { rows, cols } = self.grid;
        let mut sections = Vec::with_capacity(cols);
        let mut station_mm = 0.0;
        for col in 0..cols {
            if col > 0 {
                station_mm += (self.centreline[col] - self.centreline[col - 1]).norm();
            }
            let ring = (0..=rows).map(|row| self.wall[row % rows * cols + col].coords).collect();
            let ring = Polyline::open(ring);
            let area_mm2 = vector_area(ring.points()).norm();
            sections.push(TubeSection {
                station_mm,
                area_mm2,
                perimeter_mm: ring.length(),
                radius_mm: (area_mm2 / std::f64::consts::PI).sqrt(),
                curvature_per_mm: self.curvature(col),
            });
        }
        sections
    }

    /// Curvature of the centreline at a column, 1/mm: of the circle through it and those beside it; none at open ends.
    fn curvature(&self, col: usize) -> f64 {
        let last = self.grid.cols - 1;
        let beside = match (col, TubeShell::from(self).is_ring()) {
            (col, _) if 0 < col && col < last => [col - 1, col + 1],
            (_, true) => [last - 1, 1],
            _ => return 0.0,
        };
        let [before, after] = beside.map(|n| self.centreline[n]);
        let [a, b] = [self.centreline[col] - before, after - self.centreline[col]];
        let product = a.norm() * b.norm() * (a + b).norm();
        if product < 1e-12 { 0.0 } else { 2.0 * a.cross(&b).norm() / product }
    }

    /// The tube in a few numbers.
    #[must_use]
    pub fn summary(&self) -> TubeSummary {
        let sections = self.sections();
        let last = self.grid.cols - 1;
        let ends = [(self.tips[0] - self.centreline[0]).norm(), (self.tips[1] - self.centreline[last]).norm()];
        let length_mm = ends[0] + sections[last].station_mm + ends[1];
        let body = self.caps[0]..self.grid.cols - self.caps[1];
        let along = |value: fn(&TubeSection) -> f64| {
            length_summary(sections[body.clone()].iter().map(|section| (value(section), 1.0)).collect())
        };
        TubeSummary {
            length_mm,
            tortuosity: (!TubeShell::from(self).is_ring())
                .then(|| length_mm / (self.tips[1] - self.tips[0]).norm().max(1e-12)),
            radius_mm: along(|section| section.radius_mm),
            section_area_mm2: along(|section| section.area_mm2),
            curvature_per_mm: along(|section| section.curvature_per_mm),
        }
    }

    /// Lengths of its vectors, weighted by the area of the wall.
    #[must_use]
    pub fn wall_summary(&self) -> WallSummary {
        let [wall, total] = self.weighted_lengths();
        let area_mm2 = wall.iter().map(|(_, area)| area).sum();
        WallSummary { wall_mm: length_summary(wall), total_mm: length_summary(total), area_mm2 }
    }

    /// Length of each vector, and the same and of the one opposite, mm, each with the area of the wall round its node, mm²; but
    /// for nodes that repair spoilt.
    pub(super) fn weighted_lengths(&self) -> [Vec<(f64, f64)>; 2] {
        let (lengths, totals) = (self.lengths_mm(), self.total_mm());
        let mut weighted: [Vec<(f64, f64)>; 2] = Default::default();
        for (node, area) in self.node_areas_mm2().into_iter().enumerate() {
            if area > 0.0 && totals[node].is_finite() && !self.is_marred(node) {
                weighted[0].push((lengths[node], area));
                weighted[1].push((totals[node], area));
            }
        }
        weighted
    }

    /// The wall as triangles that face outward. Nodes of the first row come again after the last one's, so that a
    /// picture can be laid round it. `None` when a node is not finite.
    #[must_use]
    pub fn wall_mesh(&self) -> Option<SurfaceMesh> {
        let LatticeSize { rows, cols } = self.grid;
        if !self.wall.iter().all(|p| p.iter().all(|x| x.is_finite())) {
            return None;
        }
        let mut triangles: Vec<[usize; 3]> = Vec::new();
        for [a, b, c, d] in TubeShell::from(self).quads() {
            triangles.extend([[a, b, c], [b, d, c]]);
        }
        let vectors = self.vectors();
        let facing: f64 = triangles.iter().map(|t| triangle_area(&self.wall, *t).dot(&vectors[t[0]])).sum();
        if facing < 0.0 {
            triangles.iter_mut().for_each(|t| t.swap(1, 2));
        }
        let normals = normals(&self.wall, &triangles, Some(&vectors));
        let mut surface = SurfaceMesh::default();
        for row in 0..=rows {
            for col in 0..cols {
                let node = row % rows * cols + col;
                surface.mesh.positions.push(self.wall[node]);
                surface.normals.push(normals[node]);
                surface.nodes.push(node);
            }
        }
        // In the last row's quads the first row is the one that comes again.
        let again = |triangle: [usize; 3]| {
            let is_seam = triangle.iter().any(|n| *n >= (rows - 1) * cols) && triangle.iter().any(|n| *n < cols);
            triangle.map(|n| id(if is_seam && n < cols { n + rows * cols } else { n }))
        };
        surface.mesh.triangles = triangles.into_iter().map(again).collect();
        Some(surface)
    }
}

/// The sum of each value and of that of the node opposite, half the rows on.
#[must_use]
pub fn opposite_sums(values: &[f64], LatticeSize { rows, cols }: LatticeSize) -> Vec<f64> {
    let opposite = |n: usize| (n / cols + rows / 2) % rows * cols + n % cols;
    (0..values.len()).map(|n| values[n] + values[opposite(n)]).collect()
}

fn triangle_area(points: &[WorldPoint], [a, b, c]: [usize; 3]) -> Vector3<f64> {
    (points[b] - points[a]).cross(&(points[c] - points[a]))
}
