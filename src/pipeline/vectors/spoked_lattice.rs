//! A lattice whose spokes are being laid, and where they cross.
//!
//! With S = M + t d the Jacobian of a cell at the surface is t · det(M_i + t d_i, M_j + t d_j, d): lengths do not
//! fold a cell, only directions that run together faster than the sheet's nodes do.

use std::collections::BTreeSet;

use nalgebra::{Point2, Point3, Vector2, Vector3};

use super::legality::{cell_edges, determinant};
use super::nodes::Nodes;
use crate::cancel::{Cancel, Cancelled};
use crate::model::{Links, PerSurface};
use crate::pipeline::chart::Lattice;
use crate::pipeline::lattice::map::Node;

/// Least Jacobian of a legal place, as a share of the volume its edges would span at right angles. At 0 cells stay that
/// are nearly flat: one structure more folds, and two thirds more pairs of triangles run through each other (216 against
/// 130). At 0.1 three times as many nodes are cut short (698 against 244). What is counted: see
/// [`ROUNDS`](super::untangle::ROUNDS).
const LEAST: f64 = 0.02;

/// What nodes and spokes lie in.
pub trait Surroundings {
    /// The node at a place in the plane.
    fn node(&self, place: Point2<f64>) -> Node;

    /// Radius of the inscribed ball at a place.
    fn radius(&self, place: Point3<f64>) -> f64;

    /// Length from a node along a direction to the boundary, voxels; `None` where it is not met within [`reach`].
    fn boundary(&self, node: &Node, direction: Vector3<f64>) -> Option<f64>;

    /// Length of a spoke that is not cut short, voxels: to the boundary, but no further than [`longest`].
    fn length(&self, node: &Node, direction: Vector3<f64>) -> f64 {
        self.boundary(node, direction).unwrap_or(reach(node)).min(longest(node))
    }

    /// The place nearest to `to`, on the way there from the sheet's own at `place`, at which a node is still well inside.
    fn held(&self, place: Point2<f64>, to: Point3<f64>) -> Point3<f64> {
        /// Halvings of the way. With fewer, nodes beside a thin part go all the way back; more only take longer.
        const HALVINGS: usize = 4;
        let own = self.node(place).position;
        let mut way = to - own;
        for _ in 0..HALVINGS {
            if self.is_well_inside(own + way, own) {
                return own + way;
            }
            way /= 2.0;
        }
        own
    }

    /// Whether a place is inside of the solid, and not much less deep than one that is on the sheet.
    fn is_well_inside(&self, place: Point3<f64>, on_sheet: Point3<f64>) -> bool;
}

/// How far from a node the boundary is looked for, voxels. With half of the radii 25 nodes of 75 organs and shapes end
/// short, not 16, with 1 voxel for 4, 22; with twice of the one or four times the other two change, of which a kidney
/// has two wedges turned over.
#[must_use]
pub fn reach(node: &Node) -> f64 {
    3.0 * node.value.max(1.0) + 4.0
}

/// Length of a node's spokes at most, voxels: its ball touches the boundary at the radius, and a spoke that is longer runs
/// past that place, along the sheet or into another one. Less cuts those short that only lean, and what the radius
/// is not known to; with more, lengths are no longer those of the ball.
#[must_use]
pub fn longest(node: &Node) -> f64 {
    const LEAN: f64 = 1.15;
    const UNKNOWN: f64 = 0.4;
    LEAN * node.value + UNKNOWN
}

/// A lattice whose spokes are being laid.
pub struct SpokedLattice<'a> {
    /// The lattice in the plane.
    pub lattice: Lattice,
    /// Its nodes in space.
    pub medial: Vec<Node>,
    /// Unit directions of the upper and the lower spokes.
    pub directions: [Vec<Vector3<f64>>; 2],
    /// Their lengths, voxels.
    pub lengths: [Vec<f64>; 2],
    /// +1 when the upper spokes and (i, j) make a right-handed frame, else −1.
    pub hand: f64,
    /// Nodes with a spoke that was turned, or a place that was moved.
    pub touched: BTreeSet<usize>,
    /// Nodes that would have run into a neighbour.
    pub merged: BTreeSet<usize>,
    /// Whether too much of it is turned over to go on.
    pub is_given_up: bool,
    /// Mean distance of each node's neighbours from it before anything was moved, voxels.
    pub spacing: Vec<f64>,
    /// What they lie in.
    pub around: &'a dyn Surroundings,
    /// Who may ask to stop.
    pub cancel: &'a dyn Cancel,
}

/// Where spokes cross, or nearly so.
#[derive(Clone, Debug, Default)]
pub struct Tangle {
    /// How many corners and centres of cells are illegal, or nearly so.
    pub places: usize,
    /// Nodes of such cells, on the upper and on the lower side.
    pub crossing: [BTreeSet<usize>; 2],
    /// Nodes of such cells whose sheet is not folded: shorter spokes may mend them.
    pub long: [BTreeSet<usize>; 2],
    /// Nodes of quads that are folded in the sheet itself.
    pub folded: BTreeSet<usize>,
}

impl Tangle {
    /// How many nodes it has.
    pub fn nodes(&self) -> usize {
        let all: BTreeSet<usize> = self.crossing.iter().flatten().chain(&self.folded).copied().collect();
        all.len()
    }
}

impl SpokedLattice<'_> {
    /// Where a spoke ends.
    fn end(&self, side: usize, n: usize) -> Point3<f64> {
        self.medial[n].position + self.directions[side][n] * self.lengths[side][n]
    }

    /// Ends of the spokes of a side.
    #[must_use]
    pub fn ends(&self, side: usize) -> Vec<Point3<f64>> {
        (0..self.medial.len()).map(|n| self.end(side, n)).collect()
    }

    /// Lets a spoke end at the boundary.
    pub fn let_reach(&mut self, side: usize, n: usize) {
        self.set_length(side, n, self.around.length(&self.medial[n], self.directions[side][n]));
    }

    /// Which nodes are neighbours.
    #[must_use]
    pub fn links(&self) -> Links {
        self.lattice.links()
    }

    /// Gives a spoke of an own node, and that of its twin, a length.
    pub fn set_length(&mut self, side: usize, n: usize, length: f64) {
        self.lengths[side][n] = length;
        if let Some(twin) = self.links().twin(n) {
            self.lengths[side][twin] = length;
        }
    }

    /// Turns a spoke of an own node, and that of its twin.
    pub fn set_direction(&mut self, side: usize, n: usize, direction: Vector3<f64>) {
        self.directions[side][n] = direction;
        if let Some(twin) = self.links().twin(n) {
            self.directions[side][twin] = direction;
        }
    }

    /// Moves an own node, and its twin, which lies a period on.
    pub fn set_node(&mut self, n: usize, flat: Point2<f64>, node: Node) {
        self.lattice.nodes[n] = flat;
        self.medial[n] = node;
        if let Some(twin) = self.links().twin(n) {
            self.lattice.nodes[twin] = flat + Vector2::new(self.lattice.period.unwrap_or(0.0), 0.0);
            self.medial[twin] = node;
        }
    }

    /// Makes all twins what their own nodes are.
    pub fn join_twins(&mut self) {
        for n in 0..self.medial.len() {
            if self.links().twin(n).is_some() {
                self.set_node(n, self.lattice.nodes[n], self.medial[n]);
                for side in 0..2 {
                    self.set_direction(side, n, self.directions[side][n]);
                    self.set_length(side, n, self.lengths[side][n]);
                }
            }
        }
    }

    /// Where spokes cross, or nearly so.
    ///
    /// # Errors
    /// When it is cancelled.
    pub fn tangle(&self) -> Result<Tangle, Cancelled> {
        let size = self.lattice.size;
        let mut tangle = Tangle::default();
        for side in 0..2 {
            for i in 0..size.rows - 1 {
                self.cancel.check()?;
                for j in 0..size.cols - 1 {
                    let [inner, outer] = self.illegal(side, i, j);
                    let own = size.quad(i, j).map(|n| self.links().own(n));
                    tangle.places += inner + outer;
                    if inner + outer > 0 {
                        tangle.crossing[side].extend(own);
                    }
                    if inner > 0 {
                        tangle.folded.extend(own);
                    } else if outer > 0 {
                        tangle.long[side].extend(own);
                    }
                }
            }
        }
        Ok(tangle)
    }

    /// Whether the cells around a node are legal on a side.
    #[must_use]
    pub fn is_legal_around(&self, side: usize, n: usize) -> bool {
        self.links().quads_at(n).into_iter().all(|[i, j]| self.illegal(side, i, j) == [0, 0])
    }

    /// How many places of the cell (i, j) on one side are illegal, or nearly so: corners in the sheet; corners
    /// at the surface and the centre.
    fn illegal(&self, side: usize, i: usize, j: usize) -> [usize; 2] {
        let quad = self.lattice.size.quad(i, j);
        let edges = cell_edges([quad.map(|n| self.medial[n].position), quad.map(|n| self.end(side, n))]);
        let hand = if side == 0 { self.hand } else { -self.hand };
        let mut count = [0; 2];
        for (place, edges) in edges.into_iter().enumerate() {
            count[usize::from(place >= 4)] += usize::from(is_illegal(edges, hand));
        }
        count
    }

    /// The nodes as they are, with their crest.
    #[must_use]
    pub fn nodes(&self, crest: Vec<Point3<f64>>) -> Nodes {
        let flat = &self.lattice.nodes;
        Nodes {
            size: self.lattice.size,
            radii: self.medial.iter().map(|n| n.value).collect(),
            medial: self.medial.iter().map(|n| n.position).collect(),
            upper: self.ends(0),
            lower: self.ends(1),
            crest,
            flanks: Vec::new(),
            valid: self.lattice.valid.clone(),
            repaired: vec![None; self.medial.len()],
            intrinsic: PerSurface { medial: flat.clone(), upper: flat.clone(), lower: flat.clone() },
        }
    }
}

/// Whether the edges at a place of a cell have not the hand they should have, or are nearly in one plane.
fn is_illegal(edges: [Vector3<f64>; 3], hand: f64) -> bool {
    let volume = edges.iter().map(Vector3::norm).product::<f64>();
    hand * determinant(edges) <= LEAST * volume
}

/// Mean distance of each node's neighbours along the lattice from it.
#[must_use]
pub fn spacing(links: Links, nodes: &[Node]) -> Vec<f64> {
    let mut spacing = Vec::with_capacity(nodes.len());
    for (n, node) in nodes.iter().enumerate() {
        let around = links.around(n, false);
        let mut sum = 0.0;
        for &m in &around {
            sum += (nodes[m].position - node.position).norm();
        }
        spacing.push(sum / around.len().max(1) as f64);
    }
    spacing
}
