//! A lattice whose nodes lie nearer to each other than the mask's grain is made fair: what changes from node to node there
//! is the voxels, not the organ.
//!
//! In a tail that narrows, rows come as near to each other as the sheet is wide, and each node's fit has its own error: nodes
//! change places, and cells fold. Of each field over the lattice (the places of the nodes, their radii and the directions of their
//! spokes) the one is taken that has the least sum of
//!
//! 1. squared distances from the fits, and
//! 2. squared second differences along rows and along columns, weighted by the fourth power of the grain over the distance
//!    of the nodes (a smoothing spline; Reinsch, *Smoothing by spline functions*, 1967): where nodes are far apart nothing
//!    changes.

use std::collections::BTreeMap;

use nalgebra::{DMatrix, Point3, Vector3};

use super::spoked_lattice::SpokedLattice;
use crate::cancel::Cancelled;
use crate::numerics::field::id;
use crate::numerics::sparse::{FactorError, Sparse, solved};

/// Length below which changes are those of the voxels, voxels. With less, tips of tails stay folded; with more, bends of
/// thin sheets are flattened.
const SCALE: f64 = 1.5;
/// Distance of nodes, in that length, below which the weight grows no more: weights of 10⁸ would leave no digits.
const NEAREST: f64 = 0.1;
/// Numbers of a node: its place, its radius and the directions of its two spokes.
const FIELDS: usize = 10;

/// Three nodes on a line, and the weight of their second difference.
struct Triple {
    nodes: [usize; 3],
    weight: f64,
}

impl SpokedLattice<'_> {
    /// Makes the lattice fair.
    ///
    /// # Errors
    /// When it is cancelled.
    pub(super) fn make_fair(&mut self) -> Result<(), Cancelled> {
        let matrix = matrix(&self.triples(), self.medial.len());
        let places: Vec<Point3<f64>> = self.lattice.nodes.iter().map(|p| Point3::new(p.x, p.y, 0.0)).collect();
        let fair = match solved(&matrix, &places, &self.fits(), self.cancel) {
            Ok(fair) => fair,
            Err(FactorError::Cancelled(stop)) => return Err(stop),
            // One more than squares is positive: some fit is no number, and nothing can be made of it.
            Err(FactorError::NotPositive) => return Ok(()),
        };
        for n in 0..self.medial.len() {
            let vector = |first: usize| Vector3::from_fn(|k, _| fair[(n, first + k)]);
            self.medial[n].position = Point3::from(vector(0));
            self.medial[n].value = fair[(n, 3)];
            for (side, first) in [(0, 4), (1, 7)] {
                self.directions[side][n] = vector(first).try_normalize(1e-9).unwrap_or(self.directions[side][n]);
            }
        }
        self.join_twins();
        Ok(())
    }

    /// A row of [`FIELDS`] for each node.
    fn fits(&self) -> DMatrix<f64> {
        let mut fits = DMatrix::zeros(self.medial.len(), FIELDS);
        for (n, node) in self.medial.iter().enumerate() {
            let (p, up, down) = (node.position, self.directions[0][n], self.directions[1][n]);
            let fields = [p.x, p.y, p.z, node.value, up.x, up.y, up.z, down.x, down.y, down.z];
            fits.row_mut(n).copy_from_slice(&fields);
        }
        fits
    }

    /// All triples along rows and columns whose nodes are near to each other in the plane.
    fn triples(&self) -> Vec<Triple> {
        let (size, links) = (self.lattice.size, self.links());
        let mut triples = Vec::new();
        for n in 0..size.rows * size.cols {
            let (i, j) = (n / size.cols, n % size.cols);
            if links.own(n) != n {
                continue;
            }
            if let Some(twin) = links.twin(n) {
                triples.push(self.triple([twin - 1, n, n + 1]));
            } else if j > 0 && j + 1 < size.cols {
                triples.push(self.triple([n - 1, n, n + 1].map(|n| links.own(n))));
            }
            if i > 0 && i + 1 < size.rows {
                triples.push(self.triple([n - size.cols, n, n + size.cols]));
            }
        }
        triples
    }

    fn triple(&self, nodes: [usize; 3]) -> Triple {
        let [a, b, c] = nodes.map(|n| self.lattice.seen_from(nodes[1], n));
        let distance = ((b - a).norm() + (c - b).norm()) / 2.0;
        Triple { nodes, weight: (distance / SCALE).max(NEAREST).powi(-4) }
    }
}

/// The matrix of the sum: that of the fits is one, that of a second difference the product of (1, −2, 1) with itself.
fn matrix(triples: &[Triple], count: usize) -> Sparse {
    const DIFFERENCE: [f64; 3] = [1.0, -2.0, 1.0];
    let mut rows: Vec<BTreeMap<u32, f64>> = (0..count).map(|n| BTreeMap::from([(id(n), 1.0)])).collect();
    for Triple { nodes, weight } in triples {
        for (a, x) in nodes.iter().zip(DIFFERENCE) {
            for (b, y) in nodes.iter().zip(DIFFERENCE) {
                *rows[*a].entry(id(*b)).or_default() += weight * x * y;
            }
        }
    }
    Sparse::from_rows(rows.into_iter().map(|row| row.into_iter().collect()).collect())
}
