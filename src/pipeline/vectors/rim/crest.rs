//! The crest: where the sheet, carried on outward past its rim, meets the boundary.

use nalgebra::{Point3, Vector2, Vector3};

use crate::model::{LatticeSize, Links, ring};
use crate::pipeline::chart::Lattice;
use crate::pipeline::lattice::map::{Node, SpaceFromPlane};
use crate::pipeline::solid::level::Level;

/// What lies ahead of a node of the lattice's edge.
#[derive(Clone, Copy, Debug)]
pub struct Ahead {
    /// The sheet's rim.
    pub rim: Point3<f64>,
    /// Unit direction outward there, in the sheet.
    pub outward: Vector3<f64>,
    /// Whether other sheets are met there.
    pub is_hinge: bool,
}

/// What lies ahead of the nodes of the edge, in the order of [`ring`]. `hinge`: the medial points
/// where other sheets are met.
#[must_use]
pub fn look_ahead(lattice: &Lattice, map: &SpaceFromPlane<'_>, hinge: &[Point3<f64>]) -> Vec<Ahead> {
    /// A rim this near to a point of a hinge lies on it, voxels: hinge points lie on both sides. At 0.5 many are missed,
    /// and twice as many crests run through other parts of the surface; at 4 free rims beside a hinge get no crest, and
    /// the overlap with the mask is less by 0.01.
    const AT_HINGE: f64 = 1.5;
    let mut all = Vec::with_capacity(lattice.rim.len());
    for (n, rim) in ring(lattice.size).into_iter().zip(&lattice.rim) {
        let flat = outward(lattice, n) + (rim - lattice.nodes[n]);
        let at_rim = map.node(*rim);
        let direction = at_rim.tangents[0] * flat.x + at_rim.tangents[1] * flat.y;
        all.push(Ahead {
            rim: at_rim.position,
            outward: direction.try_normalize(1e-9).unwrap_or_else(Vector3::x),
            is_hinge: lattice.links().is_on_rim(n) && hinge.iter().any(|h| (h - at_rim.position).norm() < AT_HINGE),
        });
    }
    all
}

/// Of each node at a hinge the unit direction out of the sheet; of all others none.
#[must_use]
pub fn beyond_hinges(lattice: &Lattice, map: &SpaceFromPlane<'_>, hinge: &[Point3<f64>]) -> Vec<Vector3<f64>> {
    let mut beyond = vec![Vector3::zeros(); lattice.nodes.len()];
    for (n, ahead) in ring(lattice.size).into_iter().zip(look_ahead(lattice, map, hinge)) {
        if ahead.is_hinge {
            beyond[n] = ahead.outward;
        }
    }
    beyond
}

/// The crest point of every node of the lattice's edge, in the order of [`ring`]. Nodes of the banks of a ring have none: the
/// node itself stands for it.
#[must_use]
pub fn crest(level: &Level, links: Links, medial: &[Node], ahead: &[Ahead]) -> Vec<Point3<f64>> {
    let mut crest = Vec::with_capacity(ahead.len());
    for (n, ahead) in ring(links.size).into_iter().zip(ahead) {
        crest.push(if links.is_on_rim(n) { crest_point(level, &medial[n], ahead) } else { medial[n].position });
    }
    for place in 0..crest.len() {
        crest[place] = crest[links.own_place(place)];
    }
    crest
}

/// Where the sheet, carried on outward past its rim in its own plane, meets the boundary. Where it meets other sheets
/// instead, the crest is the rim itself.
fn crest_point(level: &Level, node: &Node, ahead: &Ahead) -> Point3<f64> {
    /// How far a crest at a hinge lies outside of its node at the least, voxels: a wedge must have a volume. Nothing else
    /// hangs on it from 0.02 to 1.
    const LEAST: f64 = 0.25;
    let way = ahead.rim - node.position;
    if ahead.is_hinge {
        return node.position + if way.norm() > LEAST { way } else { ahead.outward * LEAST };
    }
    if level.at(ahead.rim) <= 0.0 {
        // A rim that lies outside of a thin edge: the crest is on the way to it.
        let direction = way.try_normalize(1e-9).unwrap_or_else(Vector3::x);
        return node.position + direction * level.first_zero(node.position, direction, way.norm()).unwrap_or(0.0);
    }
    // With 1 radius for 4, crests of flat ends stay at the rim: the overlap of a psoas is 0.83, not 0.87. More changes
    // four of 75 organs and shapes, by 0.005 in overlap at most; without the voxels added it is seven, by 0.008.
    let reach = 4.0 * node.value.max(1.0) + 4.0;
    ahead.rim + ahead.outward * level.first_zero(ahead.rim, ahead.outward, reach).unwrap_or(0.0)
}

/// The direction in the plane that leads from the inner neighbours of an edge node to it.
fn outward(lattice: &Lattice, n: usize) -> Vector2<f64> {
    let mut direction = Vector2::zeros();
    for m in inner_neighbors(lattice.links(), n) {
        direction += (lattice.nodes[n] - lattice.nodes[m]).try_normalize(1e-9).unwrap_or_default();
    }
    direction
}

/// The nodes next to an edge node across the edges it lies on: two of a corner, else one; none of a bank of a ring.
fn inner_neighbors(Links { size: LatticeSize { rows, cols }, is_ring }: Links, n: usize) -> Vec<usize> {
    let (i, j) = (n / cols, n % cols);
    let mut inner = Vec::with_capacity(2);
    if i == 0 {
        inner.push(n + cols);
    }
    if i + 1 == rows {
        inner.push(n - cols);
    }
    if !is_ring && j == 0 {
        inner.push(n + 1);
    }
    if !is_ring && j + 1 == cols {
        inner.push(n - 1);
    }
    inner
}
