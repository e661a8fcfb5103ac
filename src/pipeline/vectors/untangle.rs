//! Legality by construction: spokes that cross are turned until they do not.
//!
//! 1. The directions of a cell that is turned over are averaged with those around it, again and again: only directions
//!    fold a cell (see [`spoked_lattice`](super::spoked_lattice)), so that undoes the fold.
//! 2. Where the sheet itself is folded, its nodes are moved between their neighbours too: in the plane and back onto
//!    the sheet.
//! 3. Where that is of no use, they are moved in space, but stay inside of the solid.
//!    Nodes that would run into each other are left where they are, and named.
//! 4. What is left is shortened, and then given back what it can have ([`shorten`](super::shorten)).

use std::collections::BTreeSet;

use nalgebra::{Point2, Point3, Vector2, Vector3};

use super::spoked_lattice::{SpokedLattice, Tangle};
use crate::cancel::Cancelled;
use crate::model::{LatticeSize, Links, ring};
use crate::pipeline::lattice::map::Node;

/// What is done in a round against crossing.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Means {
    /// Directions are turned.
    Turn,
    /// Nodes are moved along the sheet too.
    Slide,
    /// Nodes are moved off the sheet too: over a hole, or where it is no surface.
    Lift,
    /// Spokes are shortened too.
    Cut,
}

/// Rounds of each. Tried on 36 structures of two body scans with 12 × 20 nodes, three of which fold whatever is done;
/// of the other 33, 244 nodes are cut short. With 10 rounds of turning it is 264; without sliding 261, and half more
/// pairs of triangles run through each other; without lifting 389, and four fold; with 5 rounds of cutting three fold.
/// Twice to four times the rounds of any save three nodes at most.
pub(super) const ROUNDS: [(Means, usize); 4] =
    [(Means::Turn, 40), (Means::Slide, 10), (Means::Lift, 40), (Means::Cut, 20)];

/// How long to go on with a lattice.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Patience {
    /// Up to the last round, unless there is nothing to save.
    Whole,
    /// Until it is plain that nodes will be spoilt: another lattice may do.
    Little,
}

impl Patience {
    /// Share of nodes that have to be moved off the sheet with which it goes on.
    fn most(self) -> f64 {
        /// Of 60 lattices over 22 structures of a brain those of which no node was spoilt had 0.025 at the most.
        const FEW: f64 = 0.04;
        /// A sheet that is folded as much as this is none: that of a plate of one voxel across its stairs, which would take
        /// minutes.
        const MOST: f64 = 0.4;
        match self {
            Self::Whole => MOST,
            Self::Little => FEW,
        }
    }
}

impl SpokedLattice<'_> {
    /// Turns, moves and shortens until nothing is illegal, or the rounds are over. Returns how many
    /// places were illegal, or nearly so, before.
    ///
    /// # Errors
    /// When it is cancelled.
    pub fn untangle(&mut self, patience: Patience) -> Result<usize, Cancelled> {
        let mut tangle = self.tangle()?;
        let before = tangle.places;
        let mut cut = BTreeSet::new();
        for (means, rounds) in ROUNDS {
            let share = tangle.nodes() as f64 / self.medial.len() as f64;
            self.is_given_up |= means == Means::Lift && share > patience.most();
            if self.is_given_up {
                break;
            }
            for _ in 0..rounds {
                if tangle.places == 0 {
                    break;
                }
                self.loosen(&tangle, means)?;
                if means == Means::Cut {
                    cut.extend(tangle.long.iter().flatten());
                }
                tangle = self.tangle()?;
            }
        }
        self.lengthen(&cut)?;
        Ok(before)
    }

    /// One round.
    fn loosen(&mut self, tangle: &Tangle, means: Means) -> Result<(), Cancelled> {
        if matches!(means, Means::Slide | Means::Lift) {
            self.move_between(&tangle.folded, means)?;
        }
        for side in 0..2 {
            self.turn(side, &tangle.crossing[side]);
            for &n in &tangle.crossing[side] {
                self.cancel.check()?;
                if means == Means::Cut && tangle.long[side].contains(&n) {
                    self.shorten(side, n);
                } else {
                    self.let_reach(side, n);
                }
            }
        }
        Ok(())
    }

    /// Turns the spokes of some nodes, all at once, to the mean direction of those at and around each.
    fn turn(&mut self, side: usize, nodes: &BTreeSet<usize>) {
        let mut turned = Vec::with_capacity(nodes.len());
        for &n in nodes {
            turned.push(self.mean_direction(side, n));
        }
        for (&n, direction) in nodes.iter().zip(turned) {
            self.set_direction(side, n, direction);
        }
        self.touched.extend(nodes);
    }

    /// The mean direction of a side's spokes at a node and around it.
    fn mean_direction(&self, side: usize, n: usize) -> Vector3<f64> {
        let directions = &self.directions[side];
        let mut around = Vector3::zeros();
        for m in self.links().around(n, true) {
            around += directions[m];
        }
        (directions[n] + around).try_normalize(1e-9).unwrap_or(directions[n])
    }

    /// Moves nodes, all at once, between their neighbours: in the plane and back onto the sheet, or in space.
    fn move_between(&mut self, nodes: &BTreeSet<usize>, means: Means) -> Result<(), Cancelled> {
        let (old_flat, old) = (self.lattice.clone(), self.medial.clone());
        for &n in nodes {
            self.cancel.check()?;
            self.touched.insert(n);
            let (mut flat, mut place, mut count) = (old_flat.nodes[n].coords, old[n].position.coords, 1.0);
            for m in those_it_lies_between(self.links(), n) {
                flat += old_flat.seen_from(n, m).coords;
                place += old[m].position.coords;
                count += 1.0;
            }
            let flat = Point2::from(flat / count);
            if means == Means::Slide {
                self.put(n, flat, self.around.node(flat));
            } else {
                self.put_in_space(n, flat, Point3::from(place / count));
            }
            self.let_reach(0, n);
            self.let_reach(1, n);
        }
        Ok(())
    }

    /// Moves a node in space, as far as it stays well inside; the tangents stay.
    fn put_in_space(&mut self, n: usize, flat: Point2<f64>, to: Point3<f64>) {
        let position = self.around.held(flat, to);
        let node = Node { position, value: self.around.radius(position), ..self.medial[n] };
        self.put(n, flat, node);
    }

    /// Moves a node, unless it would run into a neighbour.
    fn put(&mut self, n: usize, flat: Point2<f64>, node: Node) {
        /// Distance from a neighbour below which a node has run into it, as a share of what it was from all of them. With
        /// none, nodes of folded sheets end in one point; with much more, nodes may not go where they are needed.
        const NEAREST: f64 = 0.1;
        for m in self.links().around(n, false) {
            let neighbor = self.medial[m].position;
            let (before, after) = ((self.medial[n].position - neighbor).norm(), (node.position - neighbor).norm());
            if after < before && after < NEAREST * self.spacing[n] {
                self.merged.insert(n);
                return;
            }
        }
        self.set_node(n, flat, node);
    }

    /// Nodes that were moved off the sheet.
    ///
    /// # Errors
    /// When it is cancelled.
    pub fn off_sheet(&self) -> Result<BTreeSet<usize>, Cancelled> {
        /// Distance from the sheet from which on a node is off it, in radii, and what is added in voxels: thickness
        /// changes by less than the one, and the sheet is not known better than to the other.
        const OFF: (f64, f64) = (0.1, 0.5);
        let mut off = BTreeSet::new();
        for &n in &self.touched {
            self.cancel.check()?;
            let own = self.around.node(self.lattice.nodes[n]);
            if (own.position - self.medial[n].position).norm() > OFF.0 * own.value + OFF.1 {
                off.insert(n);
            }
        }
        Ok(off)
    }

    /// Draws the spokes of some edge nodes towards those of the nodes around them.
    pub fn calm(&mut self, nodes: &BTreeSet<usize>) {
        for side in 0..2 {
            self.turn(side, nodes);
            for &n in nodes {
                self.let_reach(side, n);
            }
        }
    }

    /// Draws some edge nodes, all at once, to the middle between their neighbours on the edge. Their spokes are left as
    /// they are.
    pub fn even_out(&mut self, nodes: &BTreeSet<usize>) {
        let (old_flat, old, links) = (self.lattice.clone(), self.medial.clone(), self.links());
        let edge = ring(links.size);
        for (k, &n) in edge.iter().enumerate() {
            if !nodes.contains(&n) {
                continue;
            }
            let (mut flat, mut place) = (Vector2::zeros(), Vector3::zeros());
            let [before, after] = links.along_edge(k).map(|place| edge[place]);
            for m in [before, n, after] {
                flat += old_flat.seen_from(n, m).coords;
                place += old[m].position.coords;
            }
            self.put_in_space(n, Point2::from(flat / 3.0), Point3::from(place / 3.0));
            self.touched.insert(n);
        }
    }
}

/// The neighbours that a node lies between: four, of one on the edge those along it, of a corner none. Drawn inward, the
/// edge would shrink, and with it the whole sheet.
fn those_it_lies_between(links: Links, n: usize) -> Vec<usize> {
    let LatticeSize { rows, cols } = links.size;
    let (i, j) = (n / cols, n % cols);
    let (is_at_end, is_at_side) = (i == 0 || i + 1 == rows, !links.is_ring && (j == 0 || j + 1 == cols));
    let around = links.around(n, false).into_iter();
    match (is_at_end, is_at_side) {
        (true, true) => Vec::new(),
        (true, false) => around.filter(|m| m / cols == i).collect(),
        (false, true) => around.filter(|m| m % cols == j).collect(),
        (false, false) => around.collect(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cancel::Never;
    use crate::pipeline::chart::Lattice;
    use crate::pipeline::vectors::spoked_lattice::Surroundings;

    const SIZE: LatticeSize = LatticeSize { rows: 5, cols: 6 };

    /// A flat sheet between two planes, each 2 voxels from it.
    struct TwoPlanes;

    impl Surroundings for TwoPlanes {
        fn node(&self, p: Point2<f64>) -> Node {
            let position = Point3::new(p.x, p.y, 0.0);
            Node { position, tangents: [Vector3::x(), Vector3::y()], value: 2.0, slopes: [0.0; 2] }
        }

        fn radius(&self, _: Point3<f64>) -> f64 {
            2.0
        }

        fn is_well_inside(&self, place: Point3<f64>, _: Point3<f64>) -> bool {
            place.z.abs() < 1.0
        }

        fn boundary(&self, _: &Node, direction: Vector3<f64>) -> Option<f64> {
            Some(2.0 / direction.z.abs().max(0.1))
        }
    }

    fn flat_lattice() -> SpokedLattice<'static> {
        let flat: Vec<Point2<f64>> = (0..30).map(|n| Point2::new((n % 6) as f64, (n / 6) as f64)).collect();
        SpokedLattice {
            medial: flat.iter().map(|p| TwoPlanes.node(*p)).collect(),
            lattice: Lattice { size: SIZE, nodes: flat, valid: vec![true; 30], rim: Vec::new(), period: None },
            directions: [vec![Vector3::z(); 30], vec![-Vector3::z(); 30]],
            lengths: [vec![2.0; 30], vec![2.0; 30]],
            // (i, j) = (v, u), upward: left-handed.
            hand: -1.0,
            touched: BTreeSet::new(),
            merged: BTreeSet::new(),
            is_given_up: false,
            spacing: vec![1.0; 30],
            around: &TwoPlanes,
            cancel: &Never,
        }
    }

    #[test]
    fn a_legal_lattice_is_left_alone() {
        let mut spoked = flat_lattice();
        assert_eq!((spoked.untangle(Patience::Whole), spoked.touched.len()), (Ok(0), 0));
        assert_eq!(spoked.ends(0)[7], Point3::new(1.0, 1.0, 2.0));
    }

    #[test]
    fn crossing_vectors_are_turned_and_still_reach_the_surface() {
        let mut spoked = flat_lattice();
        spoked.directions[0][8] = Vector3::new(-1.0, 0.0, 0.6).normalize();
        spoked.let_reach(0, 8);
        assert!(spoked.untangle(Patience::Whole).is_ok_and(|folds| folds > 0) && spoked.touched.contains(&8));
        assert!(spoked.tangle().is_ok_and(|tangle| tangle.places == 0));
        assert!(spoked.ends(0).iter().all(|p| (p.z - 2.0).abs() < 1e-9));
        assert_eq!(spoked.ends(1)[8], Point3::new(2.0, 1.0, -2.0), "the other side is not touched");
    }

    #[test]
    fn a_node_beyond_its_neighbour_is_moved_between_them() {
        let mut spoked = flat_lattice();
        spoked.lattice.nodes[8].x = 4.5;
        spoked.medial[8] = TwoPlanes.node(spoked.lattice.nodes[8]);
        assert!(spoked.untangle(Patience::Whole).is_ok_and(|folds| folds > 0));
        assert!(spoked.tangle().is_ok_and(|tangle| tangle.places == 0));
        assert!(spoked.medial[8].position.x < 3.0);
    }
}
