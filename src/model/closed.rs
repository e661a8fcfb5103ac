//! The closed surface of a figure: upper side, the arcs of the rim, lower side as one watertight mesh.

use nalgebra::Point3;

use super::lattice::{LatticeSize, Links, ring};
use super::meshes::TriangleMesh;
use super::shell::{FLANK, Shell};
use crate::numerics::field::id;
use crate::numerics::triangles::volume;

/// The closed surface in the space of the shell: upper quads, strips from the upper edge along the arcs of the rim to
/// the lower edge, lower quads. Corners are shared, every edge has
/// two triangles, the Euler characteristic is 2 (of a ring, whose banks share their corners too, 0), and triangles run
/// counter-clockwise seen from outside, whatever the handedness of the space.
///
/// Neighbouring points of an arc that have merged are one; triangles without area that
/// this leaves are dropped. `None` when a node is invalid or not finite (such a surface has
/// holes) or the lattice has fewer than 3 × 3 nodes.
#[must_use]
pub fn closed(shell: Shell<'_>) -> Option<TriangleMesh> {
    let (rows, cols) = (shell.size.rows, shell.size.cols);
    let edge = 2 * (rows + cols) - 4;
    if rows < 3 || cols < 3 || shell.crest.len() != edge || shell.flanks.len() != edge {
        return None;
    }
    if shell.valid.iter().any(|valid| !valid) {
        return None;
    }
    let corners = Corners::of(shell);
    if !corners.points.iter().flat_map(|p| p.iter()).all(|x| x.is_finite()) {
        return None;
    }
    let mut mesh = corners.mesh(&triangles(shell, &corners.arcs));
    if volume(&mesh.positions, &mesh.triangles) < 0.0 {
        mesh.triangles.iter_mut().for_each(|t| t.swap(1, 2));
    }
    Some(mesh)
}

/// The triangles by the numbers of their corners; all face outward or all inward.
fn triangles(shell: Shell<'_>, arcs: &[[usize; ARC]]) -> Vec<[usize; 3]> {
    let (LatticeSize { rows, cols }, nodes) = (shell.size, shell.medial.len());
    let mut triangles = Vec::new();
    for quad in shell.quads() {
        // Cut through the corner of the lattice: the other diagonal joins two edge nodes, and
        // would belong to four triangles where upper and lower edge have merged.
        let is_corner = (quad.i, quad.j) == (0, 0) || (quad.i + 2, quad.j + 2) == (rows, cols);
        let [a, b, c, d] = quad.nodes;
        let halves = if is_corner { [[a, c, d], [a, d, b]] } else { [[a, c, b], [b, c, d]] };
        triangles.extend(halves);
        triangles.extend(halves.map(|[x, y, z]| [nodes + x, nodes + z, nodes + y]));
    }
    for step in shell.edge_steps() {
        let [here, next] = [arcs[step.here], arcs[step.next]];
        for k in 1..ARC {
            triangles.extend([[here[k - 1], next[k - 1], here[k]], [next[k - 1], next[k], here[k]]]);
        }
    }
    triangles
}

/// Points of an arc, its ends included.
const ARC: usize = 2 * FLANK + 3;

/// The corners of the closed surface.
struct Corners {
    /// Upper nodes, lower nodes, and the points of the arcs between them.
    points: Vec<Point3<f64>>,
    /// The points of each arc by their numbers, from its upper node to its lower one.
    arcs: Vec<[usize; ARC]>,
    /// The point that each is one with.
    names: Vec<usize>,
}

impl Corners {
    fn of(shell: Shell<'_>) -> Self {
        let nodes = shell.medial.len();
        let mut corners = Self { points: [shell.upper, shell.lower].concat(), arcs: Vec::new(), names: Vec::new() };
        for (place, node) in ring(shell.size).into_iter().enumerate() {
            let mut arc = [node; ARC];
            for (k, number) in arc.iter_mut().enumerate().take(ARC - 1).skip(1) {
                *number = 2 * nodes + place * (ARC - 2) + k - 1;
            }
            arc[ARC - 1] = nodes + node;
            corners.points.extend_from_slice(&shell.arc(place, node)[1..ARC - 1]);
            corners.arcs.push(arc);
        }
        corners.names = (0..corners.points.len()).collect();
        for (place, node) in ring(shell.size).into_iter().enumerate() {
            corners.name_merged(shell, place, node);
        }
        corners.join_banks(shell.links(), nodes);
        corners
    }

    /// Gives points of an arc that have merged one name: that of a surface node among them.
    fn name_merged(&mut self, shell: Shell<'_>, place: usize, node: usize) {
        let (arc, points) = (self.arcs[place], shell.arc(place, node));
        for k in 1..ARC {
            if shell.are_merged(node, points[k - 1], points[k]) {
                self.names[arc[k]] = self.names[arc[k - 1]];
            }
        }
        let (first, last) = (self.names[arc[0]], self.names[arc[ARC - 1]]);
        for number in arc {
            if first != last && self.names[number] == last {
                self.names[number] = arc[ARC - 1];
            }
        }
    }

    /// Gives the corners at the twins of a ring the names of those at their own nodes. `nodes`: of one side.
    fn join_banks(&mut self, links: Links, nodes: usize) {
        let mut own: Vec<usize> = (0..self.points.len()).collect();
        for n in 0..nodes {
            own[n] = links.own(n);
            own[nodes + n] = nodes + links.own(n);
        }
        for place in 0..self.arcs.len() {
            for (number, same) in self.arcs[place].into_iter().zip(self.arcs[links.own_place(place)]) {
                own[number] = own[same];
            }
        }
        for name in &mut self.names {
            *name = own[*name];
        }
    }

    /// The mesh of some triangles, without those whose corners have merged and points of none.
    fn mesh(&self, triangles: &[[usize; 3]]) -> TriangleMesh {
        let mut mesh = TriangleMesh::default();
        let mut places = vec![None; self.points.len()];
        for triangle in triangles {
            let [a, b, c] = triangle.map(|n| self.names[n]);
            if a != b && b != c && c != a {
                mesh.triangles.push([a, b, c].map(|n| {
                    *places[n].get_or_insert_with(|| {
                        mesh.positions.push(self.points[n]);
                        id(mesh.positions.len() - 1)
                    })
                }));
            }
        }
        mesh
    }
}
