//! The parts that the nodes of a figure enclose: cells, the wedges of the rim, and where the crest has
//! run into a surface.
//!
//! The rim is round: at each edge node an arc leads from its upper node over its crest point to its lower node. Its
//! points beside the crest are its *flanks*, [`FLANK`] on either side.

use nalgebra::Point3;

use super::figure::Sheet;
use super::lattice::{LatticeSize, Links, ring};
use super::side::Side;

/// Points of an arc between a surface node and the crest point. With none a wedge stands for what is round, and the overlap
/// of a kidney is 0.863; with 1 it is 0.926, with 2 0.940.
pub const FLANK: usize = 2;

/// The flanks of an arc, each from the surface node to the crest point: towards the upper node, towards the lower one.
pub type Flanks = [[Point3<f64>; FLANK]; 2];

/// A point of an arc this near to the one before it is that point, as a share of the longer of the two
/// vectors to them. Larger, a thin but open wedge would count as closed and never be looked at;
/// smaller, the sign of a wedge without volume would be that of rounding errors.
const MERGED: f64 = 1e-3;

/// The node arrays of a figure, in any right- or left-handed space.
#[derive(Clone, Copy, Debug)]
pub struct Shell<'a> {
    /// Lattice size.
    pub size: LatticeSize,
    /// Medial nodes, row-major (i slow).
    pub medial: &'a [Point3<f64>],
    /// Upper nodes.
    pub upper: &'a [Point3<f64>],
    /// Lower nodes.
    pub lower: &'a [Point3<f64>],
    /// Crest points in the order of [`ring`].
    pub crest: &'a [Point3<f64>],
    /// The flanks of the arc through each.
    pub flanks: &'a [Flanks],
    /// Whether a node lies on the sheet; parts with a node that does not are no parts.
    pub valid: &'a [bool],
}

impl<'a> From<&'a Sheet> for Shell<'a> {
    fn from(sheet: &'a Sheet) -> Self {
        Self {
            size: sheet.grid,
            medial: &sheet.medial,
            upper: &sheet.upper,
            lower: &sheet.lower,
            crest: &sheet.crest,
            flanks: &sheet.flanks,
            valid: &sheet.valid,
        }
    }
}

/// A quad of the lattice by its nodes `[(i, j), (i, j+1), (i+1, j), (i+1, j+1)]`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Quad {
    /// Row of its first node.
    pub i: usize,
    /// Column of its first node.
    pub j: usize,
    /// Its nodes.
    pub nodes: [usize; 4],
}

impl Quad {
    /// What its nodes have, of an array with an entry for each node of the lattice.
    #[must_use]
    pub fn corners<T: Copy>(&self, of: &[T]) -> [T; 4] {
        self.nodes.map(|n| of[n])
    }
}

/// A step along the edge of the lattice.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct EdgeStep {
    /// Place of the first node in the ring, and of its crest point.
    pub here: usize,
    /// Place of the second.
    pub next: usize,
    /// The two nodes.
    pub nodes: [usize; 2],
}

impl<'a> Shell<'a> {
    /// Nodes of a side.
    #[must_use]
    pub fn side(&self, side: Side) -> &'a [Point3<f64>] {
        match side {
            Side::Upper => self.upper,
            Side::Lower => self.lower,
        }
    }

    /// The quad whose first node is (i, j); `None` beyond the lattice or with an invalid node.
    #[must_use]
    pub fn quad(&self, i: usize, j: usize) -> Option<Quad> {
        let LatticeSize { rows, cols } = self.size;
        if i + 1 >= rows || j + 1 >= cols {
            return None;
        }
        let nodes = self.size.quad(i, j);
        nodes.iter().all(|&n| self.valid[n]).then_some(Quad { i, j, nodes })
    }

    /// All quads without an invalid node, row-major.
    pub fn quads(self) -> impl Iterator<Item = Quad> {
        let LatticeSize { rows, cols } = self.size;
        (0..rows).flat_map(move |i| (0..cols).filter_map(move |j| self.quad(i, j)))
    }

    /// Which nodes are neighbours. Of a ring the medial nodes of the last column are those of the first.
    #[must_use]
    pub fn links(&self) -> Links {
        let LatticeSize { rows, cols } = self.size;
        let meets = |row: usize| self.medial[row * cols] == self.medial[row * cols + cols - 1];
        Links { size: self.size, is_ring: rows > 1 && cols > 3 && (0..rows).all(meets) }
    }

    /// All steps round the edge without an invalid node. Banks of a ring are no edge.
    pub(crate) fn edge_steps(self) -> impl Iterator<Item = EdgeStep> {
        let (edge, links) = (ring(self.size), self.links());
        (0..edge.len()).filter_map(move |here| {
            let next = (here + 1) % edge.len();
            let nodes = [edge[here], edge[next]];
            let is_step = nodes.iter().all(|&n| self.valid[n]) && !links.is_along_bank(nodes);
            is_step.then_some(EdgeStep { here, next, nodes })
        })
    }

    /// The arc at a place of the edge, from the surface node of a side to the crest point.
    #[must_use]
    pub(crate) fn half_arc(&self, side: Side, place: usize, node: usize) -> [Point3<f64>; FLANK + 2] {
        let mut half = [self.side(side)[node]; FLANK + 2];
        half[1..=FLANK].copy_from_slice(&self.flanks[place][side.number()]);
        half[FLANK + 1] = self.crest[place];
        half
    }

    /// The arc at a place of the edge, from the upper node to the lower one.
    #[must_use]
    pub(crate) fn arc(&self, place: usize, node: usize) -> [Point3<f64>; 2 * FLANK + 3] {
        let [upper, lower] = Side::BOTH.map(|side| self.half_arc(side, place, node));
        let mut arc = [upper[0]; 2 * FLANK + 3];
        arc[..FLANK + 2].copy_from_slice(&upper);
        for (k, point) in lower.into_iter().enumerate() {
            arc[2 * FLANK + 2 - k] = point;
        }
        arc
    }

    /// Whether two neighbouring points of an arc at a node are one: a sharp rim.
    #[must_use]
    pub(crate) fn are_merged(&self, node: usize, a: Point3<f64>, b: Point3<f64>) -> bool {
        let medial = self.medial[node];
        (b - a).norm() <= MERGED * (a - medial).norm().max((b - medial).norm())
    }
}

/// The flanks of an arc that leads straight from the surface nodes to the crest.
#[must_use]
pub fn straight_flanks(upper: Point3<f64>, crest: Point3<f64>, lower: Point3<f64>) -> Flanks {
    let mut flanks = [[crest; FLANK]; 2];
    for (flank, skin) in flanks.iter_mut().zip([upper, lower]) {
        for (k, point) in flank.iter_mut().enumerate() {
            *point = skin + (crest - skin) * ((k + 1) as f64 / (FLANK + 1) as f64);
        }
    }
    flanks
}

/// Area of a quad `[a b; c d]`: half the cross product of its diagonals.
#[must_use]
pub(crate) fn quad_area([a, b, c, d]: [Point3<f64>; 4]) -> f64 {
    (d - a).cross(&(c - b)).norm() / 2.0
}
