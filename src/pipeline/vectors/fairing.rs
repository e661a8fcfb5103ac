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

use nalgebra::{Point3, SVector, Vector3};

use super::spoked_lattice::SpokedLattice;
use crate::cancel::Cancelled;

/// Length below which changes are those of the voxels, voxels. With less, tips of tails stay folded; with more, bends of
/// thin sheets are flattened.
const SCALE: f64 = 1.5;
/// Distance of nodes, in that length, below which the weight grows no more: weights of 10⁸ would leave no digits.
const NEAREST: f64 = 0.1;
/// Steps of the solver at most, and the residual, as a share of the first, at which it ends.
const MAX_STEPS: usize = 2000;
/// See [`MAX_STEPS`].
const SETTLED: f64 = 1e-8;

/// A node's place, radius and the directions of its two spokes.
type Fields = SVector<f64, 10>;

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
        let triples = self.triples();
        let fits: Vec<Fields> = (0..self.medial.len()).map(|n| self.fields(n)).collect();
        let fair = least(&triples, &fits, &mut || self.cancel.check())?;
        for (n, fields) in fair.into_iter().enumerate() {
            let vector = |first: usize| Vector3::new(fields[first], fields[first + 1], fields[first + 2]);
            self.medial[n].position = Point3::from(vector(0));
            self.medial[n].value = fields[3];
            for (side, first) in [(0, 4), (1, 7)] {
                self.directions[side][n] = vector(first).try_normalize(1e-9).unwrap_or(self.directions[side][n]);
            }
        }
        Ok(())
    }

    fn fields(&self, n: usize) -> Fields {
        let (node, up, down) = (&self.medial[n], self.directions[0][n], self.directions[1][n]);
        let p = node.position;
        Fields::from([p.x, p.y, p.z, node.value, up.x, up.y, up.z, down.x, down.y, down.z])
    }

    /// All triples along rows and columns whose nodes are near to each other in the plane.
    fn triples(&self) -> Vec<Triple> {
        let size = self.lattice.size;
        let mut triples = Vec::new();
        for n in 0..size.rows * size.cols {
            let (i, j) = (n / size.cols, n % size.cols);
            if j > 0 && j + 1 < size.cols {
                triples.push(self.triple([n - 1, n, n + 1]));
            }
            if i > 0 && i + 1 < size.rows {
                triples.push(self.triple([n - size.cols, n, n + size.cols]));
            }
        }
        triples
    }

    fn triple(&self, nodes: [usize; 3]) -> Triple {
        let [a, b, c] = nodes.map(|n| self.lattice.nodes[n]);
        let distance = ((b - a).norm() + (c - b).norm()) / 2.0;
        Triple { nodes, weight: (distance / SCALE).max(NEAREST).powi(-4) }
    }
}

/// The fields with the least sum, by conjugate gradients from the fits on.
fn least(
    triples: &[Triple],
    fits: &[Fields],
    check: &mut dyn FnMut() -> Result<(), Cancelled>,
) -> Result<Vec<Fields>, Cancelled> {
    let diagonal = diagonal(triples, fits.len());
    let mut fair = fits.to_vec();
    let mut residual: Vec<Fields> = applied(triples, &fair).iter().zip(fits).map(|(a, f)| f - a).collect();
    let mut scaled = preconditioned(&residual, &diagonal);
    let mut direction = scaled.clone();
    let mut energy = dot(&residual, &scaled);
    let first = energy;
    for _ in 0..MAX_STEPS {
        check()?;
        let pushed = applied(triples, &direction);
        let curvature = dot(&direction, &pushed);
        let step = ratio(&energy, &curvature);
        for n in 0..fair.len() {
            fair[n] += direction[n].component_mul(&step);
            residual[n] -= pushed[n].component_mul(&step);
        }
        scaled = preconditioned(&residual, &diagonal);
        let next = dot(&residual, &scaled);
        if next.iter().zip(first.iter()).all(|(left, first)| *left <= SETTLED * SETTLED * first) {
            break;
        }
        let carry = ratio(&next, &energy);
        for n in 0..direction.len() {
            direction[n] = scaled[n] + direction[n].component_mul(&carry);
        }
        energy = next;
    }
    Ok(fair)
}

/// What the sum's matrix makes of some fields.
fn applied(triples: &[Triple], fields: &[Fields]) -> Vec<Fields> {
    let mut out = fields.to_vec();
    for Triple { nodes: [a, b, c], weight } in triples {
        let bend = (fields[*a] - fields[*b] * 2.0 + fields[*c]) * *weight;
        out[*a] += bend;
        out[*b] -= bend * 2.0;
        out[*c] += bend;
    }
    out
}

/// The matrix's diagonal.
fn diagonal(triples: &[Triple], count: usize) -> Vec<f64> {
    let mut diagonal = vec![1.0; count];
    for Triple { nodes, weight } in triples {
        for (n, share) in nodes.iter().zip([1.0, 4.0, 1.0]) {
            diagonal[*n] += share * weight;
        }
    }
    diagonal
}

fn preconditioned(residual: &[Fields], diagonal: &[f64]) -> Vec<Fields> {
    residual.iter().zip(diagonal).map(|(r, d)| r / *d).collect()
}

/// The products of two, field by field.
fn dot(a: &[Fields], b: &[Fields]) -> Fields {
    let mut sum = Fields::zeros();
    for (a, b) in a.iter().zip(b) {
        sum += a.component_mul(b);
    }
    sum
}

/// A share of each, none of none.
fn ratio(a: &Fields, b: &Fields) -> Fields {
    a.zip_map(b, |a, b| if b > 0.0 { a / b } else { 0.0 })
}
