//! The smooth surfaces through the nodes of a figure, as a finer lattice: what a coarse lattice stands for between its nodes.
//!
//! Cubic Hermite patches (Catmull, Rom, *A class of local interpolating splines*, 1974), rows first, then columns. Slopes
//! are cut to the shorter of the steps on both sides (Fritsch, Carlson, SIAM J. Numer. Anal. 17, 1980, ask for up to three
//! of them), so that surfaces do not swing out beside a node where lines bend sharply. Where the closed surface would still
//! run through itself, as in the hollows of rims, all bends are made flatter.

use nalgebra::{Point3, Vector3};

use super::closed::closed;
use super::lattice::{LatticeSize, Links, ring};
use super::meshes::TriangleMesh;
use super::shell::{FLANK, Flanks, Shell};
use crate::cancel::{Cancel, Cancelled};
use crate::numerics::triangles::self_intersections;

/// Pieces that the longer side of a lattice is cut into at the least: bends of organs are round with them. With 36 the
/// overlap of 14 organs is 0.001 more on average, with 72 no more than that.
pub(super) const PIECES: usize = 24;
/// Pieces of one step at the most.
pub(super) const MOST: usize = 6;
/// What bends are multiplied with, in turn, until the closed surface does not run through itself.
pub(super) const BENDS: [f64; 4] = [1.0, 0.7, 0.4, 0.0];

/// A finer lattice through the nodes of another.
#[derive(Clone, Debug)]
pub struct Patches {
    size: LatticeSize,
    medial: Vec<Point3<f64>>,
    upper: Vec<Point3<f64>>,
    lower: Vec<Point3<f64>>,
    crest: Vec<Point3<f64>>,
    flanks: Vec<Flanks>,
    valid: Vec<bool>,
}

impl<'a> From<&'a Patches> for Shell<'a> {
    fn from(patches: &'a Patches) -> Self {
        Self {
            size: patches.size,
            medial: &patches.medial,
            upper: &patches.upper,
            lower: &patches.lower,
            crest: &patches.crest,
            flanks: &patches.flanks,
            valid: &patches.valid,
        }
    }
}

impl Patches {
    /// Those of a figure, and how many pairs of triangles of their closed surface run through each other; `None` without a
    /// closed surface. Its own nodes are among theirs.
    ///
    /// # Errors
    /// When it is cancelled.
    pub fn of(shell: Shell<'_>, cancel: &dyn Cancel) -> Result<(Self, Option<usize>), Cancelled> {
        least_crossing(|bend| Self::bent(shell, bend), |patches| closed(patches.into()), cancel)
    }

    /// Those with their bends as they are, whether or not they run through each other.
    #[must_use]
    pub fn unchecked(shell: Shell<'_>) -> Self {
        Self::bent(shell, BENDS[0])
    }

    fn bent(shell: Shell<'_>, bend: f64) -> Self {
        let LatticeSize { rows, cols } = shell.size;
        let steps = rows.max(cols).saturating_sub(1).max(1);
        let cuts = PIECES.div_ceil(steps).clamp(1, MOST);
        let refiner = Refiner { links: shell.links(), cuts, bend, valid: shell.valid };
        let (edge, fine) = (ring(shell.size), refiner.refined_size());
        let flank = |side: usize, k: usize| -> Vec<Point3<f64>> {
            refiner.rim(&edge, &shell.flanks.iter().map(|flanks| flanks[side][k]).collect::<Vec<_>>())
        };
        let mut flanks = vec![[[Point3::origin(); FLANK]; 2]; ring(fine).len()];
        for side in 0..2 {
            for k in 0..FLANK {
                for (flank, point) in flanks.iter_mut().zip(flank(side, k)) {
                    flank[side][k] = point;
                }
            }
        }
        Self {
            size: fine,
            medial: refiner.sheet(shell.medial),
            upper: refiner.sheet(shell.upper),
            lower: refiner.sheet(shell.lower),
            crest: refiner.rim(&edge, shell.crest),
            flanks,
            valid: refiner.valid(),
        }
    }
}

/// The first of the smooth surfaces, by how much they bend, whose closed surface does not run through itself, else the one
/// that does least; and how many pairs of its triangles do, `None` without a closed surface.
///
/// # Errors
/// When it is cancelled.
pub(super) fn least_crossing<T>(
    bent: impl Fn(f64) -> T,
    closed: impl Fn(&T) -> Option<TriangleMesh>,
    cancel: &dyn Cancel,
) -> Result<(T, Option<usize>), Cancelled> {
    let mut best: Option<(T, Option<usize>)> = None;
    for bend in BENDS {
        let surface = bent(bend);
        let crossings = match closed(&surface) {
            Some(mesh) => Some(self_intersections(&mesh.positions, &mesh.triangles, cancel)?),
            None => None,
        };
        if best.as_ref().is_none_or(|best| crossings < best.1) {
            best = Some((surface, crossings));
        }
        if best.as_ref().is_some_and(|best| best.1.is_none_or(|crossings| crossings == 0)) {
            break;
        }
    }
    Ok(best.unwrap_or_else(|| (bent(BENDS[0]), None)))
}

/// A node, and whether it lies on the sheet.
pub(super) type Knot = (Point3<f64>, bool);

/// Puts nodes between those of a lattice.
struct Refiner<'a> {
    links: Links,
    /// Pieces of a step.
    cuts: usize,
    bend: f64,
    valid: &'a [bool],
}

impl Refiner<'_> {
    fn refined_size(&self) -> LatticeSize {
        let refined = |count: usize| count.saturating_sub(1) * self.cuts + usize::from(count > 0);
        LatticeSize { rows: refined(self.links.size.rows), cols: refined(self.links.size.cols) }
    }

    /// Nodes of a surface, row-major.
    fn surface(&self, nodes: &[Point3<f64>]) -> Vec<Knot> {
        let LatticeSize { rows, cols } = self.links.size;
        let fine = self.refined_size();
        let mut along = Vec::with_capacity(rows * fine.cols);
        for row in 0..rows {
            let line: Vec<Knot> = (row * cols..(row + 1) * cols).map(|n| (nodes[n], self.valid[n])).collect();
            along.extend(self.row(&line));
        }
        let mut surface = vec![(Point3::origin(), false); fine.rows * fine.cols];
        for col in 0..fine.cols {
            let line: Vec<Knot> = (0..rows).map(|row| along[row * fine.cols + col]).collect();
            for (row, knot) in self.line(&line).into_iter().enumerate() {
                surface[row * fine.cols + col] = knot;
            }
        }
        surface
    }

    fn sheet(&self, nodes: &[Point3<f64>]) -> Vec<Point3<f64>> {
        self.surface(nodes).into_iter().map(|(point, _)| point).collect()
    }

    fn valid(&self) -> Vec<bool> {
        let nowhere = vec![Point3::origin(); self.valid.len()];
        self.surface(&nowhere).into_iter().map(|(_, is_valid)| is_valid).collect()
    }

    /// Points of the rim, in the order of [`ring`]: side by side, as the nodes of the edge are.
    fn rim(&self, edge: &[usize], points: &[Point3<f64>]) -> Vec<Point3<f64>> {
        let LatticeSize { rows, cols } = self.links.size;
        if points.len() != edge.len() {
            return Vec::new();
        }
        let (mut rim, mut first) = (Vec::new(), 0);
        for (number, steps) in [cols - 1, rows - 1, cols - 1, rows - 1].into_iter().enumerate() {
            let place = |k: usize| (first + k) % edge.len();
            let side: Vec<Knot> = (0..=steps).map(|k| (points[place(k)], self.valid[edge[place(k)]])).collect();
            let mut fine = if number % 2 == 0 { self.row(&side) } else { self.line(&side) };
            fine.pop();
            rim.extend(fine.into_iter().map(|(point, _)| point));
            first += steps;
        }
        rim
    }

    /// The knots of a row and those between them; a row of a ring bends at its ends as it does elsewhere.
    fn row(&self, knots: &[Knot]) -> Vec<Knot> {
        /// Knots beyond either end that a step bends by.
        const BEYOND: usize = 2;
        let around = knots.len() - 1;
        if !self.links.is_ring || around < BEYOND {
            return self.line(knots);
        }
        let count = knots.len() + 2 * BEYOND;
        let padded: Vec<Knot> = (0..count).map(|n| knots[(n + around - BEYOND) % around]).collect();
        let fine = self.line(&padded);
        fine[BEYOND * self.cuts..=(BEYOND + around) * self.cuts].to_vec()
    }

    /// The knots of a line and those between them.
    fn line(&self, knots: &[Knot]) -> Vec<Knot> {
        refined(knots, self.cuts, self.bend)
    }
}

/// The knots of a line and those between them, `cuts` pieces to a step.
pub(super) fn refined(knots: &[Knot], cuts: usize, bend: f64) -> Vec<Knot> {
    let slopes = slopes(knots);
    let mut fine = Vec::with_capacity(knots.len() * cuts);
    for n in 1..knots.len() {
        let [(from, here), (to, next)] = [knots[n - 1], knots[n]];
        fine.push((from, here));
        for cut in 1..cuts {
            let share = cut as f64 / cuts as f64;
            fine.push((hermite([from, to], [slopes[n - 1], slopes[n]], share, bend), here && next));
        }
    }
    fine.extend(knots.last());
    fine
}

/// Slopes of a line at its knots, per step.
fn slopes(knots: &[Knot]) -> Vec<Vector3<f64>> {
    let step = |n: usize| {
        let (from, to) = (knots.get(n)?, knots.get(n + 1)?);
        (from.1 && to.1).then(|| to.0 - from.0)
    };
    let mut slopes = Vec::with_capacity(knots.len());
    for n in 0..knots.len() {
        let (before, after) = (n.checked_sub(1).and_then(step), step(n));
        slopes.push(match (before, after) {
            (Some(before), Some(after)) => cut_to((before + after) / 2.0, before.norm().min(after.norm())),
            // At an end, that of the parabola through it and the two next ones.
            (Some(own), None) => at_end(own, n.checked_sub(2).and_then(step)),
            (None, Some(own)) => at_end(own, step(n + 1)),
            (None, None) => Vector3::zeros(),
        });
    }
    slopes
}

/// The slope at the end of a line, whose last step is `own`.
fn at_end(own: Vector3<f64>, next: Option<Vector3<f64>>) -> Vector3<f64> {
    next.map_or(own, |next| cut_to(own * 1.5 - next * 0.5, own.norm()))
}

/// A vector, no longer than `longest`.
fn cut_to(vector: Vector3<f64>, longest: f64) -> Vector3<f64> {
    let norm = vector.norm();
    if norm > longest { vector * (longest / norm) } else { vector }
}

/// A point of a cubic step between two points with these slopes, its bend multiplied.
fn hermite([from, to]: [Point3<f64>; 2], slopes: [Vector3<f64>; 2], share: f64, factor: f64) -> Point3<f64> {
    let rest = 1.0 - share;
    let bend = slopes[0] * rest - slopes[1] * share + (to - from) * (share - rest);
    from + (to - from) * share + bend * (share * rest * factor)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A quarter of a pipe, 10 round its axis, from five nodes across.
    fn arch(angle: f64) -> Point3<f64> {
        Point3::new(10.0 * angle.cos(), 10.0 * angle.sin(), 0.0)
    }

    #[test]
    fn patches_pass_through_the_nodes_and_follow_a_circle_between() {
        let knots: Vec<Knot> = (0..5).map(|n| (arch(f64::from(n) * std::f64::consts::FRAC_PI_8), true)).collect();
        let refiner = Refiner {
            links: Links { size: LatticeSize { rows: 5, cols: 5 }, is_ring: false },
            cuts: 4,
            bend: 1.0,
            valid: &[true; 25],
        };
        let fine = refiner.line(&knots);
        assert_eq!(fine.len(), 17);
        for (n, (point, _)) in fine.iter().enumerate() {
            if n % 4 == 0 {
                assert_eq!(*point, knots[n / 4].0);
            }
            // Chords lie 0.19 inside of the circle.
            assert!((point.coords.norm() - 10.0).abs() < 0.06, "{n}: {}", point.coords.norm());
        }
    }

    #[test]
    fn nothing_is_read_from_nodes_that_are_not_on_the_sheet() {
        let far = Point3::new(1e6, 0.0, 0.0);
        let knots = [(arch(0.0), true), (arch(0.3), true), (arch(0.6), true), (far, false)];
        let refiner = Refiner {
            links: Links { size: LatticeSize { rows: 4, cols: 4 }, is_ring: false },
            cuts: 3,
            bend: 1.0,
            valid: &[true; 16],
        };
        let fine = refiner.line(&knots);
        assert!(fine[..7].iter().all(|(point, is_valid)| *is_valid && (point.coords.norm() - 10.0).abs() < 0.1));
        assert!(fine[7..9].iter().all(|(_, is_valid)| !is_valid));
    }
}
