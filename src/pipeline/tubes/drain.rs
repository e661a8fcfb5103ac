//! The function whose level sets are the cross-sections of a tube.
//!
//! Every part of the solid is a source, and all flows off at one end, the *drain*: −Δf = 1 outside of it, −Δf + c f = 1 in
//! it, no flow through the wall. So f grows along every branch up to its tip, whatever its length and bends; its level sets
//! meet the wall at right angles, and two of them never cross. Where a branch leaves, those behind it are f's of the branch
//! alone: a tree needs no other function. The first eigenfunction of the Laplacian, which does the same for a single tube,
//! is flat in side branches, and its two signs meet in the middle; a harmonic function between two ends is flat in all
//! branches but one.
//!
//! Finite volumes over the cells, the flow between two through the smaller of their shares; solved by conjugate gradients
//! (Hestenes, Stiefel, 1952) with the diagonal as preconditioner.

use nalgebra::{Matrix4, Point3, Vector3, Vector4};

use super::cells::Cells;
use crate::cancel::{Cancel, Cancelled};

/// How much of f the drain takes up: f grows by the factor cosh of this from the tip to where the drain ends. With 0.5 f is
/// nearly the same all over the drain, with 4 it is nothing at the tip; in between sections change by chance only.
const DRAINED: f64 = 1.5;
/// What is left of the equation where the solver ends, as a share: far below what the cells tell.
const SETTLED: f64 = 1e-7;
/// Rounds at most. A tube of 500 cells takes about as many.
const MOST_ROUNDS: usize = 6000;
/// Cells on either side of a place that f is fitted to.
const FIT_REACH: usize = 2;

/// A function on the cells of a solid.
pub struct Drain<'a> {
    cells: &'a Cells,
    /// Its value in each cell.
    pub values: Vec<f64>,
}

impl<'a> Drain<'a> {
    /// With these cells as the drain, which reaches so far.
    ///
    /// # Errors
    /// When it is cancelled.
    pub fn into(cells: &'a Cells, drain: &[bool], reach: f64, cancel: &dyn Cancel) -> Result<Self, Cancelled> {
        let sink = (DRAINED * cells.edge / reach.max(cells.edge)).powi(2);
        let mut equation = Equation { rows: Vec::with_capacity(cells.len()), diagonal: Vec::new() };
        for (cell, is_drain) in drain.iter().enumerate() {
            let mut row = Row::default();
            let mut own = if *is_drain { sink * cells.shares[cell] } else { 0.0 };
            for next in cells.beside(cell) {
                let flow = cells.shares[cell].min(cells.shares[next]);
                row.add(next, flow);
                own += flow;
            }
            equation.rows.push(row);
            equation.diagonal.push(own.max(1e-12));
        }
        // In units in which values are neither large nor small.
        let whole: f64 = cells.shares.iter().sum();
        let sources: Vec<f64> = cells.shares.iter().map(|share| share / whole).collect();
        Ok(Self { cells, values: equation.solved(&sources, cancel)? })
    }

    /// Its value at a place, by a plane fitted to the cells around; `None` far from all cells.
    pub fn at(&self, place: Point3<f64>) -> Option<f64> {
        let (mut normal, mut right) = (Matrix4::zeros(), Vector4::zeros());
        let (mut sum, mut total) = (0.0, 0.0);
        self.cells.near(place, FIT_REACH, |cell| {
            let offset: Vector3<f64> = (self.cells.places[cell] - place) / self.cells.edge;
            let weight = self.cells.shares[cell] * (-offset.norm_squared()).exp();
            let row = Vector4::new(1.0, offset.x, offset.y, offset.z);
            normal += row * row.transpose() * weight;
            right += row * (self.values[cell] * weight);
            sum += self.values[cell] * weight;
            total += weight;
        });
        if total <= 0.0 {
            return None;
        }
        // Cells in a plane or a line have no slope across it: it is held near none.
        for axis in 1..4 {
            normal[(axis, axis)] += 1e-3 * total;
        }
        let mean = sum / total;
        normal.cholesky().map_or(Some(mean), |factor| Some(factor.solve(&right)[0]))
    }
}

/// Flows from a cell to those beside it.
#[derive(Clone, Copy, Default)]
struct Row {
    count: usize,
    next: [u32; 6],
    flows: [f64; 6],
}

impl Row {
    fn add(&mut self, next: usize, flow: f64) {
        self.next[self.count] = crate::numerics::field::id(next);
        self.flows[self.count] = flow;
        self.count += 1;
    }
}

/// A symmetric positive equation: what a cell loses to those beside it and to the drain.
struct Equation {
    rows: Vec<Row>,
    diagonal: Vec<f64>,
}

impl Equation {
    fn applied(&self, x: &[f64], out: &mut [f64]) {
        for (cell, row) in self.rows.iter().enumerate() {
            let mut sum = self.diagonal[cell] * x[cell];
            for n in 0..row.count {
                sum -= row.flows[n] * x[row.next[n] as usize];
            }
            out[cell] = sum;
        }
    }

    /// The x whose losses are `right`.
    fn solved(&self, right: &[f64], cancel: &dyn Cancel) -> Result<Vec<f64>, Cancelled> {
        let count = right.len();
        let (mut x, mut left, mut applied) = (vec![0.0; count], right.to_vec(), vec![0.0; count]);
        let weighted = |left: &[f64]| -> Vec<f64> { left.iter().zip(&self.diagonal).map(|(r, d)| r / d).collect() };
        let mut scaled = weighted(&left);
        let mut direction = scaled.clone();
        let mut size = dot(&left, &scaled);
        let enough = size * SETTLED * SETTLED;
        for _ in 0..MOST_ROUNDS {
            cancel.check()?;
            if size <= enough {
                break;
            }
            self.applied(&direction, &mut applied);
            let step = size / dot(&direction, &applied).max(f64::MIN_POSITIVE);
            for n in 0..count {
                x[n] += step * direction[n];
                left[n] -= step * applied[n];
            }
            scaled = weighted(&left);
            let next = dot(&left, &scaled);
            let turn = next / size;
            for n in 0..count {
                direction[n] = scaled[n] + turn * direction[n];
            }
            size = next;
        }
        Ok(x)
    }
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}
