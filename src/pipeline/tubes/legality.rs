//! Which wedges of a tube are turned over: the parts between two columns and two rows, from the centreline to the wall.

use nalgebra::Point3;

use super::wall::TubeNodes;
use crate::model::TubeShell;

/// A wedge whose Jacobian has the wrong sign in a corner, by its first row and column.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct IllegalWedge {
    /// Its first row.
    pub row: usize,
    /// Its first column.
    pub col: usize,
}

/// How legal the wedges of a tube are.
#[derive(Clone, Debug, Default)]
pub struct TubeLegality {
    /// Corners looked at.
    pub corners: usize,
    /// Corners that are turned over.
    pub folds: usize,
    /// The wedges that they belong to.
    pub wedges: Vec<IllegalWedge>,
}

/// The legality of all wedges between neighbouring columns, and of those of the tips.
#[must_use]
pub fn legality(nodes: &TubeNodes) -> TubeLegality {
    let mut found = TubeLegality::default();
    for col in 0..nodes.size.cols - 1 {
        for row in 0..nodes.size.rows {
            found.note(row, col, &corners(nodes, row, col));
        }
    }
    for (tip, col) in TubeShell::from(nodes).fans() {
        let sense = if col == 0 { -1.0 } else { 1.0 };
        for row in 0..nodes.size.rows {
            let centre = nodes.centres[col];
            let [a, b] = [row, row + 1].map(|row| nodes.wall_at(row, col) - centre);
            found.note(row, col, &[sense * a.cross(&b).dot(&(tip - centre))]);
        }
    }
    found
}

impl TubeLegality {
    fn note(&mut self, row: usize, col: usize, corners: &[f64]) {
        // What is no number is turned over.
        let folds = corners.len() - corners.iter().filter(|sign| **sign > 0.0).count();
        self.corners += corners.len();
        self.folds += folds;
        if folds > 0 {
            self.wedges.push(IllegalWedge { row, col });
        }
    }
}

/// Jacobians at the corners of a wedge, positive where it is legal: the four on the wall, and, where the centre moves on,
/// the two on the centreline.
fn corners(nodes: &TubeNodes, row: usize, col: usize) -> Vec<f64> {
    let centres = [nodes.centres[col], nodes.centres[col + 1]];
    let wall = |r: usize, c: usize| nodes.wall_at(row + r, col + c);
    let mut signs = Vec::with_capacity(6);
    let along_centre = centres[1] - centres[0];
    for c in 0..2 {
        let [a, b] = [wall(0, c) - centres[c], wall(1, c) - centres[c]];
        let turn = a.cross(&b);
        for r in 0..2 {
            signs.push(turn.dot(&(wall(r, 1) - wall(r, 0))));
        }
        if !is_still(centres) {
            signs.push(turn.dot(&along_centre));
        }
    }
    signs
}

/// Whether two centres are one, as those of a cap.
fn is_still([a, b]: [Point3<f64>; 2]) -> bool {
    (b - a).norm() < 1e-9
}
