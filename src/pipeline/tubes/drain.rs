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
use crate::numerics::field::id;

/// How far the drain reaches, inscribed radii at the tip.
const DRAIN_RADII: f64 = 2.0;
/// How much of f the drain takes up: f grows by the factor cosh of this from the tip to where the drain ends. With 0.5 f is
/// nearly the same all over the drain, with 4 it is nothing at the tip; in between sections change by chance only.
const DRAINED: f64 = 1.5;
/// How firmly the value on a bank is held, in flows through a whole face.
const HELD: f64 = 1e4;
/// What is left of the equation where the solver ends, as a share: far below what the cells tell.
const SETTLED: f64 = 1e-7;
/// Rounds at most. A tube of 500 cells takes about as many.
const MOST_ROUNDS: usize = 6000;
/// Cells on either side of a place that f is fitted to.
const FIT_REACH: usize = 2;

/// A function on the cells of a solid.
pub struct Drain<'a> {
    /// The cells.
    pub cells: &'a Cells,
    /// Its value in each cell.
    pub values: Vec<f64>,
}

impl<'a> Drain<'a> {
    /// The one that flows off at a tip; `lengths`: of the ways from there to the cells. `held`: cells at forks and the value that
    /// they are to have, so that one level set is where all that meet there do.
    ///
    /// # Errors
    /// When it is cancelled.
    pub fn at_tip(
        cells: &'a Cells,
        lengths: &[f32],
        held: &[(usize, f64)],
        cancel: &dyn Cancel,
    ) -> Result<Self, Cancelled> {
        let mut order: Vec<usize> = (0..cells.len()).collect();
        order.sort_by(|&a, &b| lengths[a].total_cmp(&lengths[b]));
        // Up to where it has gone as many radii as the way there is deep.
        let (mut deepest, mut reach) = (0.0f64, 0.0);
        for &cell in &order {
            deepest = deepest.max(cells.depths[cell]);
            reach = f64::from(lengths[cell]);
            if reach >= DRAIN_RADII * deepest.max(cells.edge) {
                break;
            }
        }
        let sink = (DRAINED * cells.edge / reach.max(cells.edge)).powi(2);
        let is_drain = |cell: usize| f64::from(lengths[cell]) <= reach;
        let mut sinks: Vec<f64> =
            (0..cells.len()).map(|cell| if is_drain(cell) { sink * cells.shares[cell] } else { 0.0 }).collect();
        // In units in which values are neither large nor small.
        let whole: f64 = cells.shares.iter().sum();
        let mut sources: Vec<f64> = cells.shares.iter().map(|share| share / whole).collect();
        for (cell, value) in held {
            sinks[*cell] += HELD;
            sources[*cell] += HELD * value;
        }
        Self::solved(cells, &sinks, &sources, cancel)
    }

    /// The one that grows evenly from 0 on one bank of a cut to 1 on the other, without sources between.
    ///
    /// # Errors
    /// When it is cancelled.
    pub fn between(cells: &'a Cells, banks: &[Vec<usize>; 2], cancel: &dyn Cancel) -> Result<Self, Cancelled> {
        let (mut sinks, mut sources) = (vec![0.0; cells.len()], vec![0.0; cells.len()]);
        for (value, bank) in [0.0, 1.0].into_iter().zip(banks) {
            for &cell in bank {
                sinks[cell] = HELD;
                sources[cell] = HELD * value;
            }
        }
        Self::solved(cells, &sinks, &sources, cancel)
    }

    /// With what every cell loses for each unit of its value, and what it gains.
    fn solved(cells: &'a Cells, sinks: &[f64], sources: &[f64], cancel: &dyn Cancel) -> Result<Self, Cancelled> {
        let mut equation = Equation { rows: Vec::with_capacity(cells.len()), diagonal: Vec::new() };
        for (cell, sink) in sinks.iter().enumerate() {
            let mut row = Row::default();
            let mut own = *sink;
            for next in cells.beside(cell) {
                let flow = cells.shares[cell].min(cells.shares[next]);
                row.add(next, flow);
                own += flow;
            }
            equation.rows.push(row);
            equation.diagonal.push(own.max(1e-12));
        }
        Ok(Self { cells, values: equation.solved(sources, cancel)? })
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
        self.next[self.count] = id(next);
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
