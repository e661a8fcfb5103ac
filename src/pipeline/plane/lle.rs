//! Modified locally linear embedding (Zhang, Wang, *MLLE: Modified Locally Linear Embedding Using Multiple Weights*,
//! NIPS 2006; the plain one is Roweis, Saul, Science 290, 2000): a surface is laid flat so that every point lies among
//! its neighbours as it does in space.
//!
//! 1. of each point the nearest neighbours along the graph, and the vectors d to them;
//! 2. weights w that make the point of its neighbours: least squares with a ridge, Σ w = 1;
//! 3. more weights, one for every direction in which the neighbours hold no more of the point: with the
//!    left singular vectors U of the vectors d that count, and the rest V of them, the columns of
//!    (1 − α) w 1ᵀ + V H, where α = ‖Vᵀ 1‖ / √s and H is the reflection that carries Vᵀ 1 to α 1;
//! 4. M sums what each set of weights misses, squared; its smallest eigenvectors but the constant one are the plane.
//!
//! In space there are only three singular vectors: V is never formed, only 1 − U Uᵀ.
//!
//! Points on a line have one vector in U, points in one place none; both are laid out as they lie. A point with no more
//! neighbours than vectors has no weights but w, and one without neighbours lies anywhere.
//!
//! We leave the paper in one point. It takes two vectors into U where the third singular value is small as compared
//! with the median point's, else three. On a smooth sheet it takes three for half of all points, which lets
//! the plane bend there: we take two wherever a neighbourhood is as flat as [`FLAT`].

use nalgebra::{DMatrix, DVector, Matrix3, Point3, Vector3};

use crate::cancel::{Cancel, Cancelled};
use crate::numerics::field::id;
use crate::numerics::graph::{Edges, keep_shortest};
use crate::numerics::moments::Axes3;
use crate::numerics::parallel::{POINTS_PER_TASK, each_number, each_number_within};
use crate::numerics::sparse::{EigenError, Memberships, RowSums, Sparse, smallest};
use crate::numerics::stats::median;

/// Neighbours of a point at most: those within 2.5 voxels. With 12 the angles of organs' sheets are off by half as
/// much again, with 8 by up to 6°; with all 50 within 4 voxels by as much, for three times the memory.
const NEIGHBORS: usize = 20;
/// Ridge of the weights, as a share of the neighbourhood's spread. A smaller one changes nothing, so long as there is
/// one; with 1e-2 angles are off by 0.4° where they were by 0.1°, with 1e-1 by 3°.
const RIDGE: f64 = 1e-3;
/// Spread along the normal, over that in the tangent plane, up to which a neighbourhood is flat. Noise of 0.2 voxels
/// makes 0.013, a bend over a radius of 6 voxels 0.01. With 0 the sides of a bent plate are turned over on 5 % of
/// their area; with 0.1 the angles of a sheet that climbs into a junction are off by 4° instead of 0.5°.
const FLAT: f64 = 0.02;
/// Singular values, squared, as a share of the largest, below which a direction has no points: a line or one point.
const NO_DIRECTION: f64 = 1e-9;
/// α below which 1 lies in U, so that no reflection is defined.
const NO_REFLECTION: f64 = 1e-6;

/// The plane coordinates that keep neighbourhoods best: two eigenvectors of M, in no scale. `lists` are the edges of a
/// connected neighbourhood graph.
///
/// # Errors
/// Those of [`smallest`].
pub fn lle(positions: &[Point3<f64>], lists: &[Edges], cancel: &dyn Cancel) -> Result<DMatrix<f64>, EigenError> {
    let matrix = matrix(positions, lists, cancel)?;
    let count = positions.len();
    let constant = DVector::repeat(count, (count.max(1) as f64).sqrt().recip());
    smallest(&matrix, positions, 2, Some(&constant), cancel)
}

/// A point's neighbours, and what of M its weights make: with f the values at the neighbours less that at the point,
/// all misses squared are `beside` |(1 − U Uᵀ) f|² + 2 `both` (w·f) (p·f) + `plain` (w·f)², where p = (1 − U Uᵀ) 1.
struct Patch<'a> {
    neighbors: &'a [u32],
    /// Row of U of each neighbour.
    leading: Vec<Vector3<f64>>,
    /// w.
    weights: Vec<f64>,
    /// p.
    rest: Vec<f64>,
    /// Sum of p.
    total: f64,
    beside: f64,
    both: f64,
    plain: f64,
}

/// M. Its rows hold the points that share a neighbourhood, 60 to 70 of them.
fn matrix(positions: &[Point3<f64>], lists: &[Edges], cancel: &dyn Cancel) -> Result<Sparse, Cancelled> {
    let count = positions.len();
    let near = each_number(count, POINTS_PER_TASK, |a| nearest(&lists[a]), cancel)?;
    let bents = each_number(count, POINTS_PER_TASK, |a| Spread::of(positions, a, &near[a]).bent(), cancel)?;
    let flat = median(bents).unwrap_or(0.0).max(FLAT);
    let patches = each_number(count, POINTS_PER_TASK, |a| Patch::of(positions, a, &near[a], flat), cancel)?;
    let memberships = Memberships::of(&near);
    let row = |sums: &mut RowSums, a: usize| {
        for &(centre, place) in memberships.of_point(a) {
            patches[centre as usize].add_row(place as usize, centre, sums);
        }
        patches[a].add_centre(id(a), sums);
        sums.take()
    };
    Ok(Sparse::from_rows(each_number_within(count, POINTS_PER_TASK, || RowSums::new(count), row, cancel)?))
}

/// The nearest along the graph, ascending.
fn nearest(list: &[(u32, f32)]) -> Vec<u32> {
    let mut list = list.to_vec();
    keep_shortest(&mut list, NEIGHBORS);
    let mut near: Vec<u32> = list.iter().map(|edge| edge.0).collect();
    near.sort_unstable();
    near
}

/// The vectors from a point to its neighbours.
struct Spread {
    vectors: Vec<Vector3<f64>>,
    sum: Matrix3<f64>,
    /// Right singular vectors, and the squares of the singular values, the largest first.
    axes: [Vector3<f64>; 3],
    squares: [f64; 3],
}

impl Spread {
    fn of(positions: &[Point3<f64>], a: usize, near: &[u32]) -> Self {
        let (mut vectors, mut sum) = (Vec::with_capacity(near.len()), Matrix3::zeros());
        for &b in near {
            let d = positions[b as usize] - positions[a];
            sum += d * d.transpose();
            vectors.push(d);
        }
        let axes = Axes3::of(sum);
        Self { vectors, sum, axes: axes.directions, squares: axes.values.map(|square| square.max(0.0)) }
    }

    /// Spread out of the plane over that in it; 0 for points on a line.
    fn bent(&self) -> f64 {
        let within = self.squares[0] + self.squares[1];
        if within > 0.0 { self.squares[2] / within } else { 0.0 }
    }

    /// How many axes a neighbourhood has, at most two where it is as flat as `flat`.
    fn leading(&self, flat: f64) -> usize {
        let most = if self.bent() <= flat { 2 } else { 3 };
        let mut axes = 0;
        while axes < most && self.squares[axes] > NO_DIRECTION * self.squares[0] {
            axes += 1;
        }
        axes
    }

    /// w by the ridged normal equations (D Dᵀ + δ) w ∝ 1, of which only three are coupled.
    fn weights(&self) -> Vec<f64> {
        let ridge = RIDGE * self.sum.trace();
        let all: Vector3<f64> = self.vectors.iter().sum();
        let inner = (self.sum + Matrix3::identity() * ridge).try_inverse().unwrap_or_else(Matrix3::zeros) * all;
        let mut weights: Vec<f64> = self.vectors.iter().map(|d| 1.0 - d.dot(&inner)).collect();
        // Positive: δ 1ᵀ (D Dᵀ + δ)⁻¹ 1.
        let total: f64 = weights.iter().sum();
        for weight in &mut weights {
            *weight /= total;
        }
        weights
    }

    /// The row of U of a vector, with so many axes.
    fn row(&self, d: &Vector3<f64>, axes: usize) -> Vector3<f64> {
        let mut row = Vector3::zeros();
        for k in 0..axes {
            row[k] = d.dot(&self.axes[k]) / self.squares[k].sqrt();
        }
        row
    }
}

impl<'a> Patch<'a> {
    fn of(positions: &[Point3<f64>], a: usize, neighbors: &'a [u32], flat: f64) -> Self {
        let spread = Spread::of(positions, a, neighbors);
        let axes = spread.leading(flat);
        let leading: Vec<Vector3<f64>> = spread.vectors.iter().map(|d| spread.row(d, axes)).collect();
        let along: Vector3<f64> = leading.iter().sum();
        let (mut rest, mut total, mut squares) = (Vec::with_capacity(leading.len()), 0.0, 0.0);
        for row in &leading {
            let left = 1.0 - row.dot(&along);
            rest.push(left);
            total += left;
            squares += left * left;
        }
        let sets = neighbors.len().saturating_sub(axes) as f64;
        let alpha = (squares / sets.max(1.0)).sqrt();
        let [beside, both, plain] = if sets == 0.0 {
            [0.0, 0.0, 1.0]
        } else if alpha < NO_REFLECTION {
            [1.0, 0.0, sets]
        } else {
            [1.0, (1.0 - alpha) / alpha, (1.0 - alpha).powi(2) * sets]
        };
        Self { neighbors, leading, weights: spread.weights(), rest, total, beside, both, plain }
    }

    /// Entry of M that the patch makes between two neighbours.
    fn entry(&self, a: usize, b: usize) -> f64 {
        let beside = f64::from(u8::from(a == b)) - self.leading[a].dot(&self.leading[b]);
        let both = self.weights[a] * self.rest[b] + self.rest[a] * self.weights[b];
        self.beside * beside + self.both * both + self.plain * self.weights[a] * self.weights[b]
    }

    /// Sum of the entries of a neighbour with all neighbours.
    fn sum(&self, a: usize) -> f64 {
        let both = self.weights[a] * self.total + self.rest[a];
        self.beside * self.rest[a] + self.both * both + self.plain * self.weights[a]
    }

    /// Adds the row of a neighbour.
    fn add_row(&self, a: usize, centre: u32, sums: &mut RowSums) {
        for (b, &neighbor) in self.neighbors.iter().enumerate() {
            sums.add(neighbor, self.entry(a, b));
        }
        // Constants are missed by nothing.
        sums.add(centre, -self.sum(a));
    }

    /// Adds the row of the point itself.
    fn add_centre(&self, centre: u32, sums: &mut RowSums) {
        let mut all = 0.0;
        for (b, &neighbor) in self.neighbors.iter().enumerate() {
            let sum = self.sum(b);
            sums.add(neighbor, -sum);
            all += sum;
        }
        sums.add(centre, all);
    }
}

#[cfg(test)]
mod tests {
    use std::ops::Range;

    use nalgebra::{SymmetricEigen, Vector2};

    use super::*;
    use crate::cancel::Never;

    /// Points about 1 apart on a strip, joined to those within 3.5 on it.
    fn strip(rows: usize, cols: usize) -> (Vec<Vector2<f64>>, Vec<Edges>) {
        let uneven = |n: usize, step: f64| 0.6 * ((n as f64 * step).fract() - 0.5);
        let at = |n: usize| {
            let (i, j) = (n / cols, n % cols);
            Vector2::new(j as f64 + uneven(n, 0.754_877), i as f64 + uneven(n, 0.569_84))
        };
        let flat: Vec<_> = (0..rows * cols).map(at).collect();
        let edge = |a: usize, b: usize| (id(b), format!("{}", (flat[a] - flat[b]).norm()).parse().expect("a number"));
        let is_near = |a: usize, b: usize| a != b && (flat[a] - flat[b]).norm() < 3.5;
        let list = |a: usize| (0..flat.len()).filter(|&b| is_near(a, b)).map(|b| edge(a, b)).collect();
        let lists = (0..flat.len()).map(list).collect();
        (flat, lists)
    }

    /// Root mean square distance of planted coordinates from the best linear map of those found, over their own.
    fn missed(found: &DMatrix<f64>, planted: &[Vector2<f64>]) -> f64 {
        let middle = planted.iter().sum::<Vector2<f64>>() / planted.len() as f64;
        let planted = DMatrix::from_fn(planted.len(), 2, |row, k| (planted[row] - middle)[k]);
        let best = found * (found.tr_mul(found)).try_inverse().expect("two dimensions") * found.tr_mul(&planted);
        (best - &planted).norm() / planted.norm()
    }

    #[test]
    fn a_rolled_strip_is_unrolled() {
        let (flat, lists) = strip(16, 40);
        // Three quarters of a turn, with noise of 0.1 along the normal.
        let radius = 8.5;
        let noise = |n: usize| 0.35 * ((n as f64 * 0.618_034).fract() - 0.5);
        let roll = |(n, p): (usize, &Vector2<f64>)| {
            let (angle, radius) = (p.x / radius, radius + noise(n));
            Point3::new(radius * angle.sin(), p.y, radius * angle.cos())
        };
        let positions: Vec<_> = flat.iter().enumerate().map(roll).collect();
        let found = lle(&positions, &lists, &Never).expect("settles");
        let missed = missed(&found, &flat);
        assert!(missed < 0.01, "{missed:.4}");
    }

    #[test]
    fn a_flat_strip_costs_next_to_nothing_and_a_bend_of_it_costs_more() {
        let (flat, lists) = strip(12, 14);
        let positions: Vec<_> = flat.iter().map(|p| Point3::new(p.x, 0.6 * p.y, 0.8 * p.y)).collect();
        let matrix = matrix(&positions, &lists, &Never).expect("not stopped").to_dense();
        let cost = |f: &dyn Fn(&Vector2<f64>) -> f64| {
            let values = DVector::from_iterator(flat.len(), flat.iter().map(f));
            values.dot(&(&matrix * &values))
        };
        assert!(cost(&|_| 1.0).abs() < 1e-9);
        // The ridge costs a little.
        assert!(cost(&|p| p.x) < 0.01 && cost(&|p| p.y) < 0.01);
        assert!(cost(&|p| p.x * p.x) > 100.0);
        assert!((&matrix - matrix.transpose()).norm() < 1e-12 * matrix.norm());
        assert!(SymmetricEigen::new(matrix).eigenvalues.min() > -1e-9);
    }

    #[test]
    fn degenerate_neighborhoods_are_decided() {
        // Two points apart, three on a line, four in one place, and one alone.
        let positions = [0.0, 1.0, 10.0, 11.0, 12.5, 20.0, 20.0, 20.0, 20.0, 30.0].map(|x| Point3::new(x, 0.0, 0.0));
        let pieces: [Range<u32>; 4] = [0..2, 2..5, 5..9, 9..10];
        let mut lists = Vec::new();
        for piece in &pieces {
            for a in piece.clone() {
                lists.push(piece.clone().filter(|&b| b != a).map(|b| (b, 1.0f32)).collect());
            }
        }
        let matrix = matrix(&positions, &lists, &Never).expect("not stopped");
        assert!(matrix.is_finite());
        let dense = matrix.to_dense();
        let misses = |f: [f64; 10]| DVector::from_row_slice(&f).dot(&(&dense * DVector::from_row_slice(&f)));
        // Nothing is missed by constants of a piece, and next to nothing by a line.
        assert!(misses([7.0, 7.0, -3.0, -3.0, -3.0, 0.0, 0.0, 0.0, 0.0, 4.0]).abs() < 1e-9);
        assert!(misses([0.0, 0.0, 0.0, 1.0, 2.5, 0.0, 0.0, 0.0, 0.0, 0.0]) < 0.05);
        assert!(misses([0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]) > 1.0);
        assert!(misses([0.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0]) > 1.0);
    }
}
