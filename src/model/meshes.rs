//! Surfaces as triangles, for every format that draws a figure.

use serde::{Deserialize, Serialize};

use super::figure::Sheet;
use super::lattice::ring;
use super::shell::Shell;
use super::side::Side;
use crate::numerics::field::id;
use crate::space::{WorldPoint, WorldVector};

/// A triangle mesh in world space.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct TriangleMesh {
    /// Corners, mm.
    pub positions: Vec<WorldPoint>,
    /// Corner indices, counter-clockwise seen from outside.
    pub triangles: Vec<[u32; 3]>,
}

impl TriangleMesh {
    /// Takes in another mesh.
    pub(crate) fn append(&mut self, other: Self) {
        let before = id(self.positions.len());
        self.positions.extend(other.positions);
        self.triangles.extend(other.triangles.into_iter().map(|corners| corners.map(|corner| corner + before)));
    }
}

/// A surface of a figure as triangles. Corners of no triangle are left out.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct SurfaceMesh {
    /// Corners and triangles.
    pub mesh: TriangleMesh,
    /// Unit normals, one per corner, on the outer side.
    pub normals: Vec<WorldVector>,
    /// The lattice node of each corner.
    pub nodes: Vec<usize>,
}

impl Sheet {
    /// The medial sheet as triangles that face the upper side. `None` without a quad that can be drawn.
    #[must_use]
    pub fn medial_mesh(&self) -> Option<SurfaceMesh> {
        self.lattice_mesh(&self.medial, &self.vectors(Side::Upper))
    }

    /// A side as triangles that face outward. `None` without a quad that can be drawn.
    #[must_use]
    pub fn side_mesh(&self, side: Side) -> Option<SurfaceMesh> {
        self.lattice_mesh(self.side(side), &self.vectors(side))
    }

    /// Quads as two triangles; their corners are in the order of the nodes.
    fn lattice_mesh(&self, points: &[WorldPoint], outward: &[WorldVector]) -> Option<SurfaceMesh> {
        let drawable = self.drawable();
        let shell = Shell { valid: &drawable, ..self.into() };
        let mut triangles = Vec::new();
        for quad in shell.quads() {
            let [a, b, c, d] = quad.nodes;
            triangles.extend([[a, c, b], [b, c, d]]);
        }
        let (triangles, mut normals) = outward_normals(points, triangles, outward)?;
        let links = shell.links();
        for n in 0..points.len() {
            join_normals(&mut normals, n, links.twin(n));
        }
        let mut nodes: Vec<usize> = triangles.iter().flatten().copied().collect();
        nodes.sort_unstable();
        nodes.dedup();
        let all: Vec<usize> = (0..points.len()).collect();
        Some(compact(points, &normals, &triangles, &nodes, &all))
    }

    /// The rim as triangles that face outward: the strips from the upper edge along the arcs to the lower edge.
    /// `None` without a rim that can be drawn.
    #[must_use]
    pub fn crest_mesh(&self) -> Option<SurfaceMesh> {
        let edge = ring(self.grid);
        if self.crest.len() != edge.len() || self.flanks.len() != edge.len() {
            return None;
        }
        let (mut arcs, mut points, mut outward, mut node_of) = (Vec::new(), Vec::new(), Vec::new(), Vec::new());
        for (place, &node) in edge.iter().enumerate() {
            let mut arc = Vec::new();
            for point in Shell::from(self).arc(place, node) {
                arc.push(points.len());
                points.push(point);
                outward.push(point - self.medial[node]);
                node_of.push(node);
            }
            arcs.push(arc);
        }
        let (triangles, mut normals) = outward_normals(&points, self.crest_triangles(&edge, &arcs), &outward)?;
        let links = Shell::from(self).links();
        for place in 0..edge.len() {
            if let Some(twin) = links.twin_place(place) {
                for (&own, &same) in arcs[place].iter().zip(&arcs[twin]) {
                    join_normals(&mut normals, own, Some(same));
                }
            }
        }
        // Corners in the order in which triangles name them.
        let mut order = Vec::new();
        let mut is_there = vec![false; points.len()];
        for &corner in triangles.iter().flatten() {
            if !std::mem::replace(&mut is_there[corner], true) {
                order.push(corner);
            }
        }
        Some(compact(&points, &normals, &triangles, &order, &node_of))
    }

    /// Triangles of the strips between the arcs of the edge, which are given by the numbers of their points.
    fn crest_triangles(&self, edge: &[usize], arcs: &[Vec<usize>]) -> Vec<[usize; 3]> {
        let drawable = self.drawable();
        let is_finite = |point: &WorldPoint| point.iter().all(|x| x.is_finite());
        let is_usable = |place: usize| {
            let node = edge[place];
            drawable[node] && Shell::from(self).arc(place, node).iter().all(is_finite)
        };
        let links = Shell::from(self).links();
        let mut triangles = Vec::new();
        for here in 0..edge.len() {
            let next = (here + 1) % edge.len();
            if !is_usable(here) || !is_usable(next) || links.is_along_bank([edge[here], edge[next]]) {
                continue;
            }
            for (a, b) in arcs[here].windows(2).zip(arcs[next].windows(2)) {
                triangles.extend([[a[0], a[1], b[0]], [b[0], a[1], b[1]]]);
            }
        }
        triangles
    }
}

/// Gives a corner and its twin, in one place, the mean of their normals.
fn join_normals(normals: &mut [WorldVector], own: usize, twin: Option<usize>) {
    if let Some(twin) = twin
        && let Some(mean) = (normals[own] + normals[twin]).try_normalize(1e-9)
    {
        (normals[own], normals[twin]) = (mean, mean);
    }
}

/// The mesh of the corners in `order` alone.
fn compact(
    points: &[WorldPoint],
    normals: &[WorldVector],
    triangles: &[[usize; 3]],
    order: &[usize],
    node_of: &[usize],
) -> SurfaceMesh {
    let mut place = vec![0; points.len()];
    let mut surface = SurfaceMesh::default();
    for &corner in order {
        place[corner] = id(surface.nodes.len());
        surface.mesh.positions.push(points[corner]);
        surface.normals.push(normals[corner]);
        surface.nodes.push(node_of[corner]);
    }
    surface.mesh.triangles = triangles.iter().map(|triangle| triangle.map(|corner| place[corner])).collect();
    surface
}

/// The triangles turned, all or none, so that they face along `outward` in the mean, with unit
/// normals per point. `None` without triangles.
fn outward_normals(
    points: &[WorldPoint],
    mut triangles: Vec<[usize; 3]>,
    outward: &[WorldVector],
) -> Option<(Vec<[usize; 3]>, Vec<WorldVector>)> {
    if triangles.is_empty() {
        return None;
    }
    let facing: f64 = triangles
        .iter()
        .map(|t| doubled_area(points, *t).dot(&t.iter().map(|node| outward[*node]).sum::<WorldVector>()))
        .sum();
    if facing < 0.0 {
        for triangle in &mut triangles {
            triangle.swap(1, 2);
        }
    }
    let normals = normals(points, &triangles, Some(outward));
    Some((triangles, normals))
}

/// Unit normals per point, the mean of the triangles round it by area; where that vanishes,
/// along `fallback`, else along z.
#[must_use]
pub fn normals(points: &[WorldPoint], triangles: &[[usize; 3]], fallback: Option<&[WorldVector]>) -> Vec<WorldVector> {
    let mut sums = vec![WorldVector::zeros(); points.len()];
    for triangle in triangles {
        let area = doubled_area(points, *triangle);
        for node in triangle {
            sums[*node] += area;
        }
    }
    let unit = |(node, sum): (usize, WorldVector)| {
        let other = fallback.and_then(|vectors| vectors[node].try_normalize(1e-12));
        sum.try_normalize(1e-12).or(other).unwrap_or_else(WorldVector::z)
    };
    sums.into_iter().enumerate().map(unit).collect()
}

fn doubled_area(points: &[WorldPoint], [a, b, c]: [usize; 3]) -> WorldVector {
    (points[b] - points[a]).cross(&(points[c] - points[a]))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::LatticeSize;

    /// A flat sheet whose sides lie `sense` above and below.
    fn slab(rows: usize, cols: usize, sense: f64) -> Sheet {
        let at = |z: f64| (0..rows * cols).map(|n| WorldPoint::new((n % cols) as f64, (n / cols) as f64, z)).collect();
        Sheet {
            grid: LatticeSize { rows, cols },
            medial: at(0.0),
            upper: at(sense),
            lower: at(-sense),
            valid: vec![true; rows * cols],
            ..Sheet::default()
        }
    }

    #[test]
    fn triangles_face_outward_whatever_the_lattice_says() {
        for sense in [1.0, -1.0] {
            for (side, out) in [(Side::Upper, sense), (Side::Lower, -sense)] {
                let found = slab(3, 4, sense).side_mesh(side).expect("quads");
                assert_eq!((found.mesh.triangles.len(), found.nodes.len()), (12, 12));
                assert!(found.normals.iter().all(|normal| (normal - WorldVector::z() * out).norm() < 1e-12));
            }
        }
    }

    #[test]
    fn an_invalid_node_takes_its_quads_along() {
        let mut sheet = slab(3, 3, 1.0);
        sheet.valid[4] = false;
        assert_eq!(sheet.medial_mesh(), None);
        sheet.valid[4] = true;
        sheet.valid[0] = false;
        let found = sheet.medial_mesh().expect("three quads");
        assert_eq!((found.mesh.triangles.len(), found.nodes), (6, (1..9).collect()));
    }
}
