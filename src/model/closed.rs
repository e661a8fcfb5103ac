//! The closed surface of a figure: upper side, crest, lower side as one watertight mesh.

use super::meshes::TriangleMesh;
use super::shell::Shell;
use super::side::Side;
use crate::numerics::field::id;
use crate::numerics::triangles::volume;

/// The closed surface in the space of the shell: upper quads, a strip from the upper edge to the
/// crest, one from the crest to the lower edge, lower quads. Corners are shared, every edge has
/// two triangles, the Euler characteristic is 2, and triangles run counter-clockwise seen from
/// outside, whatever the handedness of the space.
///
/// A crest point that has merged with a surface node is that node; triangles without area that
/// this leaves are dropped. `None` when a node is invalid or not finite (such a surface has
/// holes) or the lattice has fewer than 3 × 3 nodes.
#[must_use]
pub fn closed(shell: Shell<'_>) -> Option<TriangleMesh> {
    let (rows, cols) = (shell.size.rows, shell.size.cols);
    let nodes = rows * cols;
    if rows < 3 || cols < 3 || shell.crest.len() != 2 * (rows + cols) - 4 || shell.valid.iter().any(|v| !v) {
        return None;
    }
    let points: Vec<_> = [shell.upper, shell.lower, shell.crest].concat();
    if !points.iter().flat_map(|p| p.iter()).all(|x| x.is_finite()) {
        return None;
    }
    let names = names(shell);
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
        let [here, next] = step.nodes;
        let [crest_here, crest_next] = [2 * nodes + step.here, 2 * nodes + step.next];
        triangles.extend([[here, next, crest_here], [next, crest_next, crest_here]]);
        let [here, next] = [nodes + here, nodes + next];
        triangles.extend([[crest_here, crest_next, here], [crest_next, next, here]]);
    }
    let mut mesh = TriangleMesh::default();
    let mut places = vec![None; points.len()];
    for [a, b, c] in triangles.into_iter().map(|t| t.map(|n| names[n])) {
        if a != b && b != c && c != a {
            mesh.triangles.push([a, b, c].map(|n| {
                *places[n].get_or_insert_with(|| {
                    mesh.positions.push(points[n]);
                    id(mesh.positions.len() - 1)
                })
            }));
        }
    }
    if volume(&mesh.positions, &mesh.triangles) < 0.0 {
        mesh.triangles.iter_mut().for_each(|t| t.swap(1, 2));
    }
    Some(mesh)
}

/// For upper nodes, lower nodes and crest points in a row: the point that each is one with.
fn names(shell: Shell<'_>) -> Vec<usize> {
    let nodes = shell.medial.len();
    let mut names: Vec<usize> = (0..2 * nodes + shell.crest.len()).collect();
    for step in shell.edge_steps() {
        let (place, node) = (step.here, step.nodes[0]);
        let merged = Side::BOTH.map(|side| shell.is_merged(side, place, node));
        if merged[1] {
            names[2 * nodes + place] = nodes + node;
        }
        if merged[0] {
            names[2 * nodes + place] = node;
            if merged[1] {
                names[nodes + node] = node;
            }
        }
    }
    names
}
