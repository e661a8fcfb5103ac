//! Legality by construction: vectors that cross are turned until they do not.
//!
//! With S = M + t d the Jacobian of a cell at the surface is t · det(M_i + t d_i, M_j + t d_j, d):
//! lengths do not fold a cell, only directions that run together faster than the sheet's nodes
//! do. Averaging the directions of a folded cell with those around it therefore undoes the fold;
//! where the sheet itself is folded its nodes are moved between their neighbours; what is left
//! after that is shortened.

use std::collections::BTreeSet;

use nalgebra::{Point2, Point3, Vector2, Vector3};

use super::nodes::Nodes;
use crate::cancel::{Cancel, Cancelled};
use crate::model::LatticeSize;
use crate::model::{PerSurface, ring};
use crate::pipeline::lattice::map::Node;
use crate::pipeline::vectors::legality::{Illegal, cell_edges, determinant, legality};

/// Rounds of turning directions.
const TURNS: usize = 40;
/// Rounds in which nodes are moved along the sheet too.
const SLIDES: usize = 10;
/// Rounds in which nodes are moved off the sheet too: over a hole, or where it is no surface.
const LIFTS: usize = 40;
/// Rounds after which a crest vector is drawn straight outward as much as to its neighbours.
const OUTWARD_AFTER: f64 = 10.0;
/// Rounds in which vectors are shortened too.
const CUTS: usize = 20;
const CUTS_FROM: usize = TURNS + SLIDES + LIFTS;
/// What a vector is shortened by in a round.
const CUT: f64 = 0.85;
/// Least Jacobian of a legal corner, as a share of the volume its edges would span at right angles.
const LEAST: f64 = 0.02;

/// A lattice whose spokes are being laid.
pub struct Spread<'a> {
    /// Its size.
    pub size: LatticeSize,
    /// Plane coordinates of the nodes.
    pub flat: Vec<Point2<f64>>,
    /// The nodes.
    pub medial: Vec<Node>,
    /// Unit directions of the upper and the lower spokes.
    pub directions: [Vec<Vector3<f64>>; 2],
    /// Their lengths, voxels.
    pub lengths: [Vec<f64>; 2],
    /// Node of a place in the plane.
    pub node_at: &'a dyn Fn(Point2<f64>) -> Node,
    /// Radius at a place.
    pub radius_at: &'a dyn Fn(Point3<f64>) -> f64,
    /// Length of a spoke from a node along a direction.
    pub length: &'a dyn Fn(&Node, Vector3<f64>) -> f64,
    /// +1 when the upper spokes and (i, j) make a right-handed frame, else −1.
    pub hand: f64,
    /// Nodes with a spoke that was turned, or a place that was moved.
    pub touched: BTreeSet<usize>,
    /// Who may ask to stop.
    pub cancel: &'a dyn Cancel,
}

impl Spread<'_> {
    fn end(&self, side: usize, n: usize) -> Point3<f64> {
        self.medial[n].position + self.directions[side][n] * self.lengths[side][n]
    }

    /// Ends of the spokes of a side.
    #[must_use]
    pub fn ends(&self, side: usize) -> Vec<Point3<f64>> {
        (0..self.medial.len()).map(|n| self.end(side, n)).collect()
    }

    /// Places of the cell (i, j) on one side that are illegal, or nearly so: corners in the sheet; corners
    /// at the surface and the centre.
    fn illegal(&self, side: usize, i: usize, j: usize) -> [usize; 2] {
        let quad = [(0, 0), (0, 1), (1, 0), (1, 1)].map(|(di, dj)| (i + di) * self.size.cols + j + dj);
        let sign = if side == 0 { self.hand } else { -self.hand };
        let edges = cell_edges([quad.map(|n| self.medial[n].position), quad.map(|n| self.end(side, n))]);
        let is_bad = |e: &&[Vector3<f64>; 3]| {
            let volume = e.iter().map(Vector3::norm).product::<f64>();
            sign * determinant(**e) <= LEAST * volume
        };
        [&edges[..4], &edges[4..]].map(|places| places.iter().filter(is_bad).count())
    }

    /// All illegal corners, and for each node whether it is part of an illegal cell: on the upper,
    /// the lower side, in the sheet.
    fn look(&self) -> Result<(usize, Vec<[bool; 3]>), Cancelled> {
        let cols = self.size.cols;
        let mut marked = vec![[false; 3]; self.medial.len()];
        let mut count = 0;
        for side in 0..2 {
            for i in 0..self.size.rows - 1 {
                self.cancel.check()?;
                for j in 0..cols - 1 {
                    let [inner, outer] = self.illegal(side, i, j);
                    count += inner + outer;
                    for n in [i * cols + j, i * cols + j + 1, (i + 1) * cols + j, (i + 1) * cols + j + 1] {
                        marked[n][side] |= inner + outer > 0;
                        marked[n][2] |= inner > 0;
                    }
                }
            }
        }
        Ok((count, marked))
    }

    /// The mean direction of a side's spokes at a node and around it.
    fn calmed(&self, side: usize, n: usize) -> Vector3<f64> {
        let directions = &self.directions[side];
        let sum = directions[n] + around(self.size, n, true).map(|m| directions[m]).sum::<Vector3<f64>>();
        sum.try_normalize(1e-9).unwrap_or(directions[n])
    }

    /// Turns, moves and shortens until nothing is illegal, or the rounds are over. Returns how many
    /// places were illegal, or nearly so, before.
    ///
    /// # Errors
    /// When it is cancelled.
    pub fn repair(&mut self) -> Result<usize, Cancelled> {
        let mut before = 0;
        let mut cut = vec![false; self.medial.len()];
        for round in 0..CUTS_FROM + CUTS {
            let (count, marked) = self.look()?;
            if round == 0 {
                before = count;
            }
            if count == 0 {
                break;
            }
            if (TURNS..CUTS_FROM).contains(&round) {
                self.move_nodes(&marked, round < TURNS + SLIDES)?;
            }
            for side in 0..2 {
                let bad: Vec<usize> = (0..marked.len()).filter(|&n| marked[n][side]).collect();
                let calmed: Vec<Vector3<f64>> = bad.iter().map(|&n| self.calmed(side, n)).collect();
                for (n, direction) in bad.into_iter().zip(calmed) {
                    self.cancel.check()?;
                    self.directions[side][n] = direction;
                    self.touched.insert(n);
                    if round < CUTS_FROM {
                        self.lengths[side][n] = (self.length)(&self.medial[n], self.directions[side][n]);
                    } else {
                        self.lengths[side][n] *= CUT;
                        cut[n] = true;
                    }
                }
            }
        }
        self.lengthen(&cut)?;
        Ok(before)
    }

    /// Draws the spokes of some edge nodes towards those of the nodes around them; with `spread`, the
    /// nodes themselves to the middle between their neighbours on the edge.
    pub fn calm(&mut self, nodes: &[usize], spread: bool) {
        if spread {
            let edge = ring(self.size);
            let old = (self.flat.clone(), self.medial.clone());
            for k in (0..edge.len()).filter(|&k| nodes.contains(&edge[k])) {
                let three = [edge[(k + edge.len() - 1) % edge.len()], edge[k], edge[(k + 1) % edge.len()]];
                let n = edge[k];
                self.flat[n] = Point2::from(three.iter().map(|&m| old.0[m].coords).sum::<Vector2<f64>>() / 3.0);
                let place = three.iter().map(|&m| old.1[m].position.coords).sum::<Vector3<f64>>() / 3.0;
                self.medial[n].position = Point3::from(place);
                self.medial[n].value = (self.radius_at)(self.medial[n].position);
            }
        }
        self.touched.extend(nodes);
        for side in 0..2 {
            let calmed: Vec<Vector3<f64>> = nodes.iter().map(|&n| self.calmed(side, n)).collect();
            for (&n, direction) in nodes.iter().zip(calmed) {
                self.directions[side][n] = direction;
                self.lengths[side][n] = (self.length)(&self.medial[n], self.directions[side][n]);
            }
        }
    }

    /// The nodes as they are.
    #[must_use]
    pub fn nodes(&self, crest: Vec<Point3<f64>>, valid: Vec<bool>) -> Nodes {
        let flat = || self.flat.clone();
        Nodes {
            size: self.size,
            radii: self.medial.iter().map(|n| n.value).collect(),
            medial: self.medial.iter().map(|n| n.position).collect(),
            upper: self.ends(0),
            lower: self.ends(1),
            crest,
            valid,
            intrinsic: PerSurface { medial: flat(), upper: flat(), lower: flat() },
        }
    }

    /// Gives shortened vectors back what they can have.
    fn lengthen(&mut self, cut: &[bool]) -> Result<(), Cancelled> {
        /// Halvings of what was cut.
        const HALVINGS: usize = 6;
        for n in (0..cut.len()).filter(|&n| cut[n]) {
            self.cancel.check()?;
            for side in 0..2 {
                let whole = (self.length)(&self.medial[n], self.directions[side][n]);
                let (mut low, mut high) = (self.lengths[side][n], whole);
                self.lengths[side][n] = whole;
                for _ in 0..HALVINGS {
                    if self.is_legal_around(side, n) {
                        low = self.lengths[side][n];
                    } else {
                        high = self.lengths[side][n];
                    }
                    if low >= high {
                        break;
                    }
                    self.lengths[side][n] = (low + high) / 2.0;
                }
                self.lengths[side][n] = low;
            }
        }
        Ok(())
    }

    /// Whether the cells around a node are legal on a side.
    fn is_legal_around(&self, side: usize, n: usize) -> bool {
        let LatticeSize { rows, cols } = self.size;
        let (i, j) = (n / cols, n % cols);
        let rows = i.saturating_sub(1)..=i.min(rows - 2);
        rows.flat_map(|a| (j.saturating_sub(1)..=j.min(cols - 2)).map(move |b| (a, b)))
            .all(|(a, b)| self.illegal(side, a, b) == [0, 0])
    }

    /// Moves the nodes of folded quads between their neighbours: in the plane and back onto the
    /// sheet, or in space.
    fn move_nodes(&mut self, marked: &[[bool; 3]], on_sheet: bool) -> Result<(), Cancelled> {
        let old = (self.flat.clone(), self.medial.clone());
        for n in (0..marked.len()).filter(|&n| marked[n][2]) {
            self.cancel.check()?;
            let (mut flat, mut place, mut count) = (old.0[n].coords, old.1[n].position.coords, 1.0);
            for m in around(self.size, n, false) {
                flat += old.0[m].coords;
                place += old.1[m].position.coords;
                count += 1.0;
            }
            self.flat[n] = Point2::from(flat / count);
            if on_sheet {
                self.medial[n] = (self.node_at)(self.flat[n]);
            } else {
                self.medial[n].position = Point3::from(place / count);
                self.medial[n].value = (self.radius_at)(self.medial[n].position);
            }
            for side in 0..2 {
                self.lengths[side][n] = (self.length)(&self.medial[n], self.directions[side][n]);
            }
        }
        Ok(())
    }
}

/// Nodes around a node of a lattice, itself not included.
fn around(LatticeSize { rows, cols }: LatticeSize, n: usize, diagonals: bool) -> impl Iterator<Item = usize> {
    let (i, j) = (n / cols, n % cols);
    let near = (i.saturating_sub(1)..=(i + 1).min(rows - 1))
        .flat_map(move |a| (j.saturating_sub(1)..=(j + 1).min(cols - 1)).map(move |b| (a, b)));
    near.filter(move |&(a, b)| (a, b) != (i, j) && (diagonals || a == i || b == j)).map(move |(a, b)| a * cols + b)
}

/// From the nodes around an edge node to it.
fn outward(nodes: &Nodes, n: usize) -> Vector3<f64> {
    around(nodes.size, n, true).map(|m| nodes.medial[n] - nodes.medial[m]).sum()
}

/// What was done to a crest, by edge nodes (row-major).
pub struct Mended {
    /// Nodes whose crest vector was turned or cut.
    pub touched: BTreeSet<usize>,
    /// Nodes whose crest vector was cut short.
    pub cut: BTreeSet<usize>,
    /// Nodes of wedges that are still turned over.
    pub left: Vec<usize>,
}

/// Turns crest vectors that lean over their neighbours or their spokes, until no wedge is turned
/// over; what is left after that is shortened.
///
/// `reach_of` is the distance to the boundary from a place along a direction, if within a reach.
///
/// # Errors
/// When it is cancelled.
pub fn mend_crest(
    nodes: &mut Nodes,
    reach_of: impl Fn(Point3<f64>, Vector3<f64>, f64) -> Option<f64>,
    cancel: &dyn Cancel,
) -> Result<Mended, Cancelled> {
    let edge = ring(nodes.size);
    let count = edge.len();
    let mut mended = Mended { touched: BTreeSet::new(), cut: BTreeSet::new(), left: Vec::new() };
    for round in 0..=TURNS + CUTS {
        cancel.check()?;
        let bad: Vec<Illegal> = legality((&*nodes).into()).parts.into_iter().filter(|p| p.part.is_wedge()).collect();
        mended.left.clear();
        if bad.is_empty() {
            break;
        }
        let mut marked = vec![false; count];
        for wedge in bad {
            let node = wedge.i * nodes.size.cols + wedge.j;
            let here = edge.iter().position(|&n| n == node).unwrap_or(0);
            marked[here] = true;
            marked[(here + 1) % count] = true;
        }
        mended.left.extend((0..count).filter(|&k| marked[k]).map(|k| edge[k]));
        if round == TURNS + CUTS {
            break;
        }
        let way = |k: usize| nodes.crest[k] - nodes.medial[edge[k]];
        let unit = |v: Vector3<f64>| v.try_normalize(1e-9).unwrap_or_else(Vector3::zeros);
        let turned: Vec<Option<Point3<f64>>> = (0..count)
            .map(|k| {
                if !marked[k] {
                    return None;
                }
                let n = edge[k];
                let from = nodes.medial[n];
                // Half way between the two spokes is where a crest belongs.
                let spokes = unit(nodes.upper[n] - from) + unit(nodes.lower[n] - from);
                let along = unit(nodes.medial[edge[(k + 1) % count]] - nodes.medial[edge[(k + count - 1) % count]]);
                let spokes = spokes - along * spokes.dot(&along);
                let out = outward(nodes, n);
                let out = unit(out - along * out.dot(&along)) * (round as f64 / OUTWARD_AFTER);
                let sum =
                    unit(way((k + count - 1) % count)) + unit(way(k)) * 2.0 + unit(way((k + 1) % count)) + spokes + out;
                let direction = unit(sum);
                let old = way(k).norm();
                let length =
                    if round < TURNS { reach_of(from, direction, 2.0 * old + 2.0).unwrap_or(old) } else { old * CUT };
                Some(from + direction * length)
            })
            .collect();
        for (k, point) in turned.into_iter().enumerate() {
            if let Some(point) = point {
                nodes.crest[k] = point;
                mended.touched.insert(edge[k]);
                if round >= TURNS {
                    mended.cut.insert(edge[k]);
                }
            }
        }
    }
    Ok(mended)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cancel::Never;

    const SIZE: LatticeSize = LatticeSize { rows: 5, cols: 6 };

    fn node_at(p: Point2<f64>) -> Node {
        let position = Point3::new(p.x, p.y, 0.0);
        Node { position, tangents: [Vector3::x(), Vector3::y()], value: 2.0, slopes: [0.0; 2] }
    }

    /// Two planes 2 voxels from the sheet.
    fn length(_: &Node, direction: Vector3<f64>) -> f64 {
        2.0 / direction.z.abs().max(0.1)
    }

    fn flat_spread() -> Spread<'static> {
        let flat: Vec<Point2<f64>> = (0..30).map(|n| Point2::new((n % 6) as f64, (n / 6) as f64)).collect();
        Spread {
            size: SIZE,
            medial: flat.iter().map(|p| node_at(*p)).collect(),
            directions: [vec![Vector3::z(); 30], vec![-Vector3::z(); 30]],
            lengths: [vec![2.0; 30], vec![2.0; 30]],
            flat,
            node_at: &node_at,
            radius_at: &|_| 2.0,
            length: &length,
            // (i, j) = (v, u), upward: left-handed.
            hand: -1.0,
            touched: BTreeSet::new(),
            cancel: &Never,
        }
    }

    #[test]
    fn a_legal_lattice_is_left_alone() {
        let mut spread = flat_spread();
        assert_eq!((spread.repair(), spread.touched.len()), (Ok(0), 0));
        assert_eq!(spread.ends(0)[7], Point3::new(1.0, 1.0, 2.0));
    }

    #[test]
    fn crossing_vectors_are_turned_and_still_reach_the_surface() {
        let mut spread = flat_spread();
        spread.directions[0][8] = Vector3::new(-1.0, 0.0, 0.6).normalize();
        spread.lengths[0][8] = length(&node_at(Point2::origin()), spread.directions[0][8]);
        assert!(spread.repair().is_ok_and(|folds| folds > 0) && spread.touched.contains(&8));
        assert!(spread.look().is_ok_and(|(folds, _)| folds == 0));
        assert!(spread.ends(0).iter().all(|p| (p.z - 2.0).abs() < 1e-9));
        assert_eq!(spread.ends(1)[8], Point3::new(2.0, 1.0, -2.0), "the other side is not touched");
    }

    #[test]
    fn a_node_beyond_its_neighbour_is_moved_between_them() {
        let mut spread = flat_spread();
        spread.flat[8].x = 4.5;
        spread.medial[8] = node_at(spread.flat[8]);
        assert!(spread.repair().is_ok_and(|folds| folds > 0));
        assert!(spread.look().is_ok_and(|(folds, _)| folds == 0));
        assert!(spread.medial[8].position.x < 3.0);
    }
}
