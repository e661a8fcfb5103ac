//! Cholesky factors of large sparse matrices by the multifrontal method (Duff, Reid, ACM TOMS 9,
//! 1983): every part of a [`Dissection`] is eliminated in a small dense matrix of its own.
//!
//! 1. the *front* of a part holds its own rows and all later ones that they reach: the matrix's entries,
//!    and what its children left over;
//! 2. its own rows are eliminated by dense blocks; their columns are columns of the factor;
//! 3. what that leaves of the later rows is handed to the parent.
//!
//! Parts that are not below one another are independent: they are eliminated side by side, each sum in
//! one order, so that the factor does not depend on the threads.

use nalgebra::{DMatrix, Point3};

use super::dissection::{Dissection, Part};
use super::matrix::Sparse;
use crate::cancel::{Cancel, Cancelled};
use crate::numerics::field::id;

/// Columns of a block: as many as stay in a core's fast memory while rows pass by.
const BLOCK: usize = 48;
/// Columns that are subtracted in one slice, so that `cancel` is asked every few milliseconds.
const SLICE: usize = 256;
/// Rows of a part below which its halves are not worth a thread each.
const ROWS_PER_TASK: usize = 1000;

/// A factor L of a symmetric positive definite matrix A + shift I = L Lᵀ, in an order of its own.
#[derive(Clone, Debug)]
pub struct Cholesky {
    order: Vec<u32>,
    fronts: Vec<Front>,
}

/// Columns of L.
#[derive(Clone, Debug)]
struct Front {
    /// Place in the order of the first column.
    from: usize,
    /// Rows: those of the columns themselves, then `beyond`.
    columns: DMatrix<f64>,
    /// Places of the later rows with an entry, ascending.
    beyond: Vec<u32>,
}

/// What an eliminated part leaves of later rows.
struct Rest {
    places: Vec<u32>,
    lower: DMatrix<f64>,
}

/// Why there is no factor.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum FactorError {
    /// Stopped.
    #[error(transparent)]
    Cancelled(#[from] Cancelled),
    /// The matrix is not positive definite, as far as rounding shows.
    #[error("the matrix is not positive definite")]
    NotPositive,
}

/// The solution of equations with a positive matrix whose rows lie at `places`; a column for each of the right side.
///
/// # Errors
/// Those of [`Cholesky::of`].
pub fn solved(
    matrix: &Sparse,
    places: &[Point3<f64>],
    right: &DMatrix<f64>,
    cancel: &dyn Cancel,
) -> Result<DMatrix<f64>, FactorError> {
    let order = Dissection::of(matrix, places, cancel)?;
    Ok(Cholesky::of(matrix, 0.0, order, cancel)?.solve(right, cancel)?)
}

impl Cholesky {
    /// The factor of `matrix` + `shift` · I.
    ///
    /// # Errors
    /// [`FactorError::NotPositive`] when a pivot is not positive or no number; those of `cancel`.
    pub fn of(matrix: &Sparse, shift: f64, order: Dissection, cancel: &dyn Cancel) -> Result<Self, FactorError> {
        let Dissection { order, root } = order;
        let mut place = vec![0; order.len()];
        order.iter().enumerate().for_each(|(at, &row)| place[row as usize] = id(at));
        let (fronts, _) = Elimination { matrix, shift, order: &order, place: &place, cancel }.part(&root)?;
        Ok(Self { order, fronts })
    }

    #[cfg(test)]
    /// Number of entries of the factor.
    #[must_use]
    pub fn entries(&self) -> usize {
        self.fronts.iter().map(|front| front.columns.len()).sum()
    }

    /// Solves for a block of right sides.
    ///
    /// # Errors
    /// Those of `cancel`.
    pub fn solve(&self, right: &DMatrix<f64>, cancel: &dyn Cancel) -> Result<DMatrix<f64>, Cancelled> {
        let mut x = DMatrix::zeros(right.nrows(), right.ncols());
        for (at, &row) in self.order.iter().enumerate() {
            x.row_mut(at).copy_from(&right.row(row as usize));
        }
        for front in &self.fronts {
            cancel.check()?;
            front.forward(&mut x);
        }
        for front in self.fronts.iter().rev() {
            cancel.check()?;
            front.backward(&mut x);
        }
        let mut solution = DMatrix::zeros(right.nrows(), right.ncols());
        for (at, &row) in self.order.iter().enumerate() {
            solution.row_mut(row as usize).copy_from(&x.row(at));
        }
        Ok(solution)
    }
}

impl Front {
    fn own(&self) -> usize {
        self.columns.ncols()
    }

    fn forward(&self, x: &mut DMatrix<f64>) {
        let own = self.own();
        let mut top = x.rows_mut(self.from, own);
        self.columns.rows(0, own).solve_lower_triangular_mut(&mut top);
        let pull = self.columns.rows(own, self.beyond.len()) * &top;
        for (k, &place) in self.beyond.iter().enumerate() {
            let mut row = x.row_mut(place as usize);
            row -= pull.row(k);
        }
    }

    fn backward(&self, x: &mut DMatrix<f64>) {
        let own = self.own();
        let beyond = DMatrix::from_fn(self.beyond.len(), x.ncols(), |k, c| x[(self.beyond[k] as usize, c)]);
        let mut top = x.rows_mut(self.from, own);
        top.gemm_tr(-1.0, &self.columns.rows(own, self.beyond.len()), &beyond, 1.0);
        self.columns.rows(0, own).tr_solve_lower_triangular_mut(&mut top);
    }
}

struct Elimination<'a> {
    matrix: &'a Sparse,
    shift: f64,
    order: &'a [u32],
    place: &'a [u32],
    cancel: &'a dyn Cancel,
}

impl Elimination<'_> {
    /// The fronts of a part and of all below it, and what they leave.
    fn part(&self, part: &Part) -> Result<(Vec<Front>, Rest), FactorError> {
        self.cancel.check()?;
        let mut fronts = Vec::new();
        let mut rests = Vec::new();
        for (below, rest) in self.children(part)? {
            fronts.extend(below);
            rests.push(rest);
        }
        let own = part.to - part.from;
        let beyond = self.beyond(part, &rests);
        let mut front = self.assembled(part, &beyond);
        for rest in rests {
            add(&mut front, part, &beyond, &rest);
        }
        if !factor(&mut front, own, self.cancel)? {
            return Err(FactorError::NotPositive);
        }
        let lower = front.view((own, own), (beyond.len(), beyond.len())).into_owned();
        let columns = front.columns(0, own).into_owned();
        fronts.push(Front { from: part.from, columns, beyond: beyond.clone() });
        Ok((fronts, Rest { places: beyond, lower }))
    }

    fn children(&self, part: &Part) -> Result<Vec<(Vec<Front>, Rest)>, FactorError> {
        let Some(children) = &part.children else { return Ok(Vec::new()) };
        let [a, b] = children.as_ref();
        let (a, b) = if part.rows < ROWS_PER_TASK {
            (self.part(a), self.part(b))
        } else {
            rayon::join(|| self.part(a), || self.part(b))
        };
        Ok(vec![a?, b?])
    }

    /// Places of later rows that the part reaches, ascending.
    fn beyond(&self, part: &Part, rests: &[Rest]) -> Vec<u32> {
        let mut places: Vec<u32> = rests.iter().flat_map(|rest| rest.places.iter().copied()).collect();
        for &row in &self.order[part.from..part.to] {
            places.extend(self.matrix.row(row as usize).0.iter().map(|&column| self.place[column as usize]));
        }
        places.retain(|place| *place as usize >= part.to);
        places.sort_unstable();
        places.dedup();
        places
    }

    /// The lower half of the front, with the matrix's own entries.
    fn assembled(&self, part: &Part, beyond: &[u32]) -> DMatrix<f64> {
        let own = part.to - part.from;
        let mut front = DMatrix::zeros(own + beyond.len(), own + beyond.len());
        for (c, &row) in self.order[part.from..part.to].iter().enumerate() {
            front[(c, c)] = self.shift;
            let (columns, values) = self.matrix.row(row as usize);
            for (&column, value) in columns.iter().zip(values) {
                let place = self.place[column as usize];
                if place as usize >= part.from + c {
                    front[(row_of(place, part, beyond), c)] += value;
                }
            }
        }
        front
    }
}

/// Row in a part's front of a place in the order.
fn row_of(place: u32, part: &Part, beyond: &[u32]) -> usize {
    if (place as usize) < part.to {
        return place as usize - part.from;
    }
    part.to - part.from + beyond.partition_point(|other| *other < place)
}

/// Adds what a child left to its parent's front.
fn add(front: &mut DMatrix<f64>, part: &Part, beyond: &[u32], rest: &Rest) {
    let rows: Vec<usize> = rest.places.iter().map(|&place| row_of(place, part, beyond)).collect();
    for (c, &column) in rows.iter().enumerate() {
        for (r, &row) in rows.iter().enumerate().skip(c) {
            front[(row, column)] += rest.lower[(r, c)];
        }
    }
}

/// Eliminates the first `own` rows of a dense matrix, of which the lower half is read and written: its
/// first columns become those of the factor, the rest what is left. `false` when a pivot is not positive.
fn factor(front: &mut DMatrix<f64>, own: usize, cancel: &dyn Cancel) -> Result<bool, Cancelled> {
    for from in (0..own).step_by(BLOCK) {
        let to = (from + BLOCK).min(own);
        subtract(front, from, from..to, cancel)?;
        if !factor_block(front, from, to) {
            return Ok(false);
        }
    }
    for from in (own..front.ncols()).step_by(BLOCK) {
        let to = (from + BLOCK).min(front.ncols());
        subtract(front, own, from..to, cancel)?;
    }
    Ok(true)
}

/// Takes what the first `done` columns of the factor account for from a block of later columns.
fn subtract(
    front: &mut DMatrix<f64>,
    done: usize,
    block: std::ops::Range<usize>,
    cancel: &dyn Cancel,
) -> Result<(), Cancelled> {
    let (from, count) = (block.start, front.nrows() - block.start);
    for first in (0..done).step_by(SLICE) {
        cancel.check()?;
        let slice = first..(first + SLICE).min(done);
        let (columns, mut block) = front.columns_range_pair_mut(slice, block.clone());
        let across = columns.rows(from, block.ncols()).transpose();
        block.rows_mut(from, count).gemm(-1.0, &columns.rows(from, count), &across, 1.0);
    }
    Ok(())
}

/// Columns of the factor, from those that nothing before them is to be taken from any more.
fn factor_block(front: &mut DMatrix<f64>, from: usize, to: usize) -> bool {
    let size = front.nrows();
    for c in from..to {
        let (before, own) = front.as_mut_slice().split_at_mut(c * size);
        let own = &mut own[c..size];
        for k in from..c {
            let column = &before[k * size + c..(k + 1) * size];
            let pull = column[0];
            own.iter_mut().zip(column).for_each(|(x, y)| *x -= pull * y);
        }
        let pivot = own[0];
        // Not `pivot <= 0`: NaN is no pivot either.
        if !(pivot > 0.0 && pivot.is_finite()) {
            return false;
        }
        let root = pivot.sqrt();
        own.iter_mut().for_each(|x| *x /= root);
    }
    true
}

#[cfg(test)]
mod tests {
    use rayon::ThreadPoolBuilder;

    use super::*;
    use crate::cancel::Never;

    /// A positive matrix of points strewn over a square, each joined to those within 3.
    fn strewn(count: usize) -> (Sparse, Vec<Point3<f64>>) {
        let side = (count as f64).sqrt();
        let share = |n: usize, step: f64| (n as f64 * step).fract() * side;
        let places: Vec<_> = (0..count).map(|n| Point3::new(share(n, 0.754_877), share(n, 0.569_84), 0.0)).collect();
        let row = |a: usize| {
            let near = (0..count).filter(|&b| b != a && (places[a] - places[b]).norm() < 3.0);
            let mut row: Vec<(u32, f64)> = near.map(|b| (id(b), -1.0 / (1.0 + (a + b) as f64 % 5.0))).collect();
            row.push((id(a), 0.01 - row.iter().map(|entry| entry.1).sum::<f64>()));
            row.sort_by_key(|entry| entry.0);
            row
        };
        (Sparse::from_rows((0..count).map(row).collect()), places)
    }

    fn factor_of(matrix: &Sparse, places: &[Point3<f64>], shift: f64) -> Result<Cholesky, FactorError> {
        let order = Dissection::of(matrix, places, &Never).expect("not stopped");
        Cholesky::of(matrix, shift, order, &Never)
    }

    #[test]
    fn solutions_solve() {
        for count in [1, 30, 1300] {
            let (matrix, places) = strewn(count);
            let factor = factor_of(&matrix, &places, 0.5).expect("positive");
            let planted = DMatrix::from_fn(count, 4, |row, column| ((row + 7 * column) as f64).sin());
            let right = matrix.product(&planted) + &planted * 0.5;
            let found = factor.solve(&right, &Never).expect("not stopped");
            assert!((found - &planted).norm() < 1e-9 * planted.norm(), "{count}");
        }
    }

    #[test]
    fn a_factor_of_a_sheet_fills_in_little() {
        let (matrix, places) = strewn(2500);
        let factor = factor_of(&matrix, &places, 0.0).expect("positive");
        assert!(factor.entries() < 220 * matrix.len(), "{} a row", factor.entries() / matrix.len());
    }

    #[test]
    fn a_matrix_that_is_not_positive_is_told() {
        let (matrix, places) = strewn(300);
        assert_eq!(factor_of(&matrix, &places, -0.1).err(), Some(FactorError::NotPositive));
        assert_eq!(factor_of(&matrix, &places, f64::NAN).err(), Some(FactorError::NotPositive));
    }

    #[test]
    fn the_factor_does_not_depend_on_the_threads() {
        let (matrix, places) = strewn(3000);
        let right = DMatrix::from_fn(3000, 2, |row, column| ((row * 5 + column) as f64).cos());
        let solved = |threads: usize| {
            let pool = ThreadPoolBuilder::new().num_threads(threads).build().expect("a pool");
            pool.install(|| factor_of(&matrix, &places, 0.1).expect("positive").solve(&right, &Never))
        };
        assert_eq!(solved(1), solved(3));
    }
}
