//! The smallest eigenpairs of a large sparse symmetric matrix without negative eigenvalues.
//!
//! The smallest eigenvalues of such matrices as embeddings lead to are many orders of magnitude below the
//! largest and close to each other: products with the matrix alone do not tell them apart. Its
//! inverse does, and a Cholesky factor of it is cheap, for rows are joined to few others:
//!
//! 1. A + σ I = L Lᵀ with a σ that is next to nothing;
//! 2. a basis is grown by blocks of (A + σ I)⁻¹ r, r what the vectors found so far leave over
//!    (block Lanczos, with every vector orthogonal to all before it);
//! 3. eigenpairs of the inverse within the basis (Rayleigh, Ritz), until nothing is left over;
//! 4. vectors that are found and stand far apart from the rest, as those of zeros do, are taken out of it;
//! 5. a basis that grew too long is begun anew with the best vectors (Wu, Simon, SIAM J. Matrix Anal.
//!    22, 2000).

use nalgebra::{DMatrix, DVector, Point3, SymmetricEigen};

use super::cholesky::{Cholesky, FactorError};
use super::dissection::Dissection;
use super::matrix::Sparse;
use crate::cancel::{Cancel, Cancelled};

/// Above this size the whole spectrum costs more than the part wanted.
const WHOLE_SPECTRUM_LIMIT: usize = 150;
/// Vectors more than those wanted that a round adds: a close next one would slow it down.
const SPARE: usize = 2;
/// Vectors of a basis at most.
const MOST_VECTORS: usize = 48;
/// Rounds at most. Sheets need 5 to 14.
const MAX_ROUNDS: usize = 100;
/// What a vector may leave over, as a share of its eigenvalue of the inverse. Angles between vectors
/// and the true ones are of this size, divided by the share by which the next eigenvalue is larger.
const TOLERANCE: f64 = 1e-8;
/// The shift, as a share of the mean of the diagonal. With a smaller one, what rounding makes of a zero's vector is as
/// large as the vectors that are sought; eigenvalues much smaller than it take more rounds to be told apart.
const SHIFT: f64 = 1e-10;
/// By how much the shift grows when a pivot is not positive, and how often it may.
const SHIFT_GROWTH: f64 = 30.0;
/// See [`SHIFT_GROWTH`].
const MORE_SHIFTS: usize = 3;
/// By how much eigenvalues of the inverse must differ for the larger ones to be set apart once they are found: what
/// rounding leaves of them would else hide the smaller ones.
const APART: f64 = 1e4;
/// Part of a vector that must be new to the basis; less is rounding.
const NEW_SHARE: f64 = 1e-10;

/// Why there are no eigenpairs.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum EigenError {
    /// Stopped.
    #[error(transparent)]
    Cancelled(#[from] Cancelled),
    /// Fewer rows than pairs.
    #[error("the matrix has {rows} rows, {needed} are needed")]
    TooFewRows {
        /// Rows of the matrix.
        rows: usize,
        /// Rows needed.
        needed: usize,
    },
    /// NaN or infinity.
    #[error("the matrix holds a number that is not finite")]
    NotFinite,
    /// A negative eigenvalue, as far as rounding shows.
    #[error("the matrix has a negative eigenvalue")]
    NotPositive,
    /// Too many rounds.
    #[error("after {rounds} rounds the eigenvectors are still off by {residual:.1e}")]
    NotSettled {
        /// Rounds made.
        rounds: usize,
        /// What a vector left over in the last, as a share of its eigenvalue of the inverse.
        residual: f64,
    },
}

/// The `count` smallest eigenpairs of a symmetric matrix without negative eigenvalues. An eigenvector that is
/// `known`, a unit vector, is left out. Rows lie at `places`, which changes the cost, not what is found.
///
/// An eigenvalue of several dimensions comes as often as it has dimensions, with some basis of
/// its vectors: so do the zeros of a graph in several pieces.
///
/// # Errors
/// See [`EigenError`].
pub fn smallest(
    matrix: &Sparse,
    places: &[Point3<f64>],
    count: usize,
    known: Option<&DVector<f64>>,
    cancel: &dyn Cancel,
) -> Result<DMatrix<f64>, EigenError> {
    let needed = count + usize::from(known.is_some());
    if matrix.len() < needed.max(1) {
        return Err(EigenError::TooFewRows { rows: matrix.len(), needed: needed.max(1) });
    }
    if !matrix.is_finite() {
        return Err(EigenError::NotFinite);
    }
    if matrix.len() <= WHOLE_SPECTRUM_LIMIT {
        return whole(matrix, count, known);
    }
    iterate(&factored(matrix, places, cancel)?, (matrix.len(), count), known, cancel)
}

fn whole(matrix: &Sparse, count: usize, known: Option<&DVector<f64>>) -> Result<DMatrix<f64>, EigenError> {
    let size = matrix.len();
    let mut dense = matrix.to_dense();
    if let Some(known) = known {
        // Beyond all others.
        dense += known * known.transpose() * (2.0 * matrix.bound() + 1.0);
    }
    let rounds = 100 * size;
    let eigen = SymmetricEigen::try_new(dense, f64::EPSILON, rounds);
    let eigen = eigen.ok_or(EigenError::NotSettled { rounds, residual: f64::INFINITY })?;
    let order = ranks(eigen.eigenvalues.iter().map(|value| -value));
    Ok(DMatrix::from_fn(size, count, |row, k| eigen.eigenvectors[(row, order[k])]))
}

/// Indices of values, the largest first.
fn ranks(values: impl Iterator<Item = f64>) -> Vec<usize> {
    let values: Vec<f64> = values.collect();
    let mut order: Vec<usize> = (0..values.len()).collect();
    order.sort_by(|&a, &b| values[b].total_cmp(&values[a]));
    order
}

/// The factor of the matrix with the smallest shift that makes all pivots positive.
fn factored(matrix: &Sparse, places: &[Point3<f64>], cancel: &dyn Cancel) -> Result<Cholesky, EigenError> {
    let mean = matrix.trace() / matrix.len() as f64;
    let is_zero = matrix.bound() == 0.0;
    if mean <= 0.0 && !is_zero {
        return Err(EigenError::NotPositive);
    }
    // Any shift will do for a matrix of zeros.
    let mut shift = if is_zero { 1.0 } else { SHIFT * mean };
    let order = Dissection::of(matrix, places, cancel)?;
    for _ in 0..=MORE_SHIFTS {
        match Cholesky::of(matrix, shift, order.clone(), cancel) {
            Ok(factor) => return Ok(factor),
            Err(FactorError::NotPositive) => shift *= SHIFT_GROWTH,
            Err(FactorError::Cancelled(stop)) => return Err(stop.into()),
        }
    }
    Err(EigenError::NotPositive)
}

/// The best vectors of a basis.
struct Ritz {
    values: Vec<f64>,
    vectors: DMatrix<f64>,
    /// What the inverse makes of them.
    images: DMatrix<f64>,
}

impl Ritz {
    /// The `count` vectors of a basis that the inverse stretches most.
    fn of(basis: &DMatrix<f64>, image: &DMatrix<f64>, count: usize, cancel: &dyn Cancel) -> Result<Self, Cancelled> {
        let small = across(basis, image, cancel)?;
        let eigen = SymmetricEigen::new((&small + small.transpose()) * 0.5);
        let order = ranks(eigen.eigenvalues.iter().copied());
        let count = count.min(order.len());
        let turn = DMatrix::from_fn(order.len(), count, |row, k| eigen.eigenvectors[(row, order[k])]);
        let values = order[..count].iter().map(|&k| eigen.eigenvalues[k]).collect();
        Ok(Self { values, vectors: combined(basis, &turn, cancel)?, images: combined(image, &turn, cancel)? })
    }

    /// What each vector leaves over: its image less what the basis accounts for. (Less the vector itself would
    /// be the same but for rounding, which the inverse makes large along the smallest eigenvectors.)
    fn left(&self, basis: &DMatrix<f64>, cancel: &dyn Cancel) -> Result<DMatrix<f64>, Cancelled> {
        less(self.images.clone(), basis, cancel)
    }
}

/// The products of all columns of a basis with all of a block.
fn across(basis: &DMatrix<f64>, block: &DMatrix<f64>, cancel: &dyn Cancel) -> Result<DMatrix<f64>, Cancelled> {
    let mut products = DMatrix::zeros(basis.ncols(), block.ncols());
    for (column, mut product) in block.column_iter().zip(products.column_iter_mut()) {
        cancel.check()?;
        basis.tr_mul_to(&column, &mut product);
    }
    Ok(products)
}

/// Combinations of the columns of a basis.
fn combined(basis: &DMatrix<f64>, shares: &DMatrix<f64>, cancel: &dyn Cancel) -> Result<DMatrix<f64>, Cancelled> {
    let mut all = DMatrix::zeros(basis.nrows(), shares.ncols());
    for (shares, mut one) in shares.column_iter().zip(all.column_iter_mut()) {
        cancel.check()?;
        basis.mul_to(&shares, &mut one);
    }
    Ok(all)
}

/// A block less its part along an orthonormal basis.
fn less(block: DMatrix<f64>, basis: &DMatrix<f64>, cancel: &dyn Cancel) -> Result<DMatrix<f64>, Cancelled> {
    let along = across(basis, &block, cancel)?;
    Ok(block - combined(basis, &along, cancel)?)
}

/// A search for the largest eigenpairs of the inverse.
struct Search<'a> {
    factor: &'a Cholesky,
    /// Vectors that are found already, and the one known from the start.
    found: DMatrix<f64>,
    basis: DMatrix<f64>,
    image: DMatrix<f64>,
    cancel: &'a dyn Cancel,
}

/// Eigenvectors of the inverse.
fn iterate(
    factor: &Cholesky,
    (size, count): (usize, usize),
    known: Option<&DVector<f64>>,
    cancel: &dyn Cancel,
) -> Result<DMatrix<f64>, EigenError> {
    let first = usize::from(known.is_some());
    let found = DMatrix::from_fn(size, first, |row, _| known.map_or(0.0, |known| known[row]));
    let none = DMatrix::zeros(size, 0);
    let mut search = Search { factor, found, basis: none.clone(), image: none, cancel };
    search.begin(&DMatrix::from_fn(size, count + SPARE, start_entry))?;
    let mut residual = f64::INFINITY;
    for _ in 0..MAX_ROUNDS {
        let wanted = first + count - search.found.ncols();
        let ritz = Ritz::of(&search.basis, &search.image, wanted + SPARE, cancel)?;
        if ritz.values.len() < wanted {
            break;
        }
        let left = ritz.left(&search.basis, cancel)?;
        let share = |k: usize| left.column(k).norm() / ritz.values[k];
        let settled = (0..wanted).take_while(|&k| share(k) <= TOLERANCE).count();
        residual = (settled..wanted).map(share).fold(0.0, f64::max);
        if settled == wanted {
            let all = beside(&search.found, &ritz.vectors.columns(0, wanted).into_owned());
            return Ok(all.columns(first, count).into_owned());
        }
        if (1..=settled).rev().any(|k| ritz.values[k - 1] > APART * ritz.values[k]) {
            search.set_apart(&ritz, settled)?;
        } else {
            search.grow(&left, wanted + SPARE)?;
        }
    }
    Err(EigenError::NotSettled { rounds: MAX_ROUNDS, residual })
}

impl Search<'_> {
    /// Begins with a basis of `start`.
    fn begin(&mut self, start: &DMatrix<f64>) -> Result<(), Cancelled> {
        self.basis = new_part(&[&self.found], start, self.cancel)?;
        self.image = self.inverse(&self.basis)?;
        Ok(())
    }

    /// Begins anew without the first vectors, which are found. They are taken through the inverse once more: what
    /// they were still off by would grow as they do.
    fn set_apart(&mut self, ritz: &Ritz, settled: usize) -> Result<(), Cancelled> {
        let image = self.inverse(&ritz.vectors.columns(0, settled).into_owned())?;
        let new = new_part(&[&self.found], &image, self.cancel)?;
        self.found = beside(&self.found, &new);
        self.begin(&ritz.vectors.columns(settled, ritz.values.len() - settled).into_owned())
    }

    /// Adds a block of new directions.
    fn grow(&mut self, new: &DMatrix<f64>, block: usize) -> Result<(), Cancelled> {
        if self.basis.ncols() + block > MOST_VECTORS {
            let best = Ritz::of(&self.basis, &self.image, 2 * block, self.cancel)?;
            (self.basis, self.image) = (best.vectors, best.images);
        }
        let new = new_part(&[&self.found, &self.basis], new, self.cancel)?;
        self.image = beside(&self.image, &self.inverse(&new)?);
        self.basis = beside(&self.basis, &new);
        Ok(())
    }

    /// What the inverse makes of a block, less what is along the vectors found already.
    fn inverse(&self, block: &DMatrix<f64>) -> Result<DMatrix<f64>, Cancelled> {
        less(self.factor.solve(block, self.cancel)?, &self.found, self.cancel)
    }
}

/// Orthonormal columns that a block adds to orthonormal ones; fewer where it adds nothing new.
fn new_part(known: &[&DMatrix<f64>], block: &DMatrix<f64>, cancel: &dyn Cancel) -> Result<DMatrix<f64>, Cancelled> {
    let size = block.nrows();
    let mut new = DMatrix::zeros(size, 0);
    for column in block.column_iter() {
        let mut vector = DMatrix::from_column_slice(size, 1, column.as_slice());
        // The second time takes what rounding left in the first.
        for _ in 0..2 {
            for basis in known {
                vector = less(vector, basis, cancel)?;
            }
            vector = less(vector, &new, cancel)?;
        }
        let norm = vector.norm();
        if norm > NEW_SHARE * column.norm() {
            new = beside(&new, &(vector / norm));
        }
    }
    Ok(new)
}

fn beside(left: &DMatrix<f64>, right: &DMatrix<f64>) -> DMatrix<f64> {
    let mut both = left.clone().resize_horizontally(left.ncols() + right.ncols(), 0.0);
    both.columns_mut(left.ncols(), right.ncols()).copy_from(right);
    both
}

/// Deterministic entries without structure that an eigenvector could be orthogonal to.
fn start_entry(row: usize, column: usize) -> f64 {
    ((row + 1) as f64 * (12.9898 + column as f64)).sin()
}

#[cfg(test)]
mod tests {
    use std::f64::consts::PI;

    use super::*;
    use crate::cancel::{Never, Stopped};
    use crate::numerics::field::id;

    /// The Laplacian of a grid of points that are joined along rows and columns.
    fn grid(rows: usize, cols: usize) -> (Sparse, Vec<Point3<f64>>) {
        let at = |n: usize| (n / cols, n % cols);
        let list = |n: usize| {
            let (i, j) = at(n);
            let near = (0..rows * cols).filter(|&m| at(m).0.abs_diff(i) + at(m).1.abs_diff(j) == 1);
            let mut row: Vec<(u32, f64)> = near.map(|m| (id(m), -1.0)).collect();
            row.push((id(n), row.len() as f64));
            row.sort_by_key(|entry| entry.0);
            row
        };
        let places = (0..rows * cols).map(|n| Point3::new(at(n).0 as f64, at(n).1 as f64, 0.0)).collect();
        (Sparse::from_rows((0..rows * cols).map(list).collect()), places)
    }

    /// Eigenvalues of such a grid, ascending.
    fn planted(rows: usize, cols: usize) -> Vec<f64> {
        let path = |k: usize, n: usize| 2.0 - 2.0 * (PI * k as f64 / n as f64).cos();
        let mut all: Vec<f64> = (0..rows * cols).map(|n| path(n / cols, rows) + path(n % cols, cols)).collect();
        all.sort_by(f64::total_cmp);
        all
    }

    /// Eigenvalues of unit eigenvectors, and the largest ‖A v − λ v‖, as a share of a bound of the largest eigenvalue.
    fn values_of(matrix: &Sparse, vectors: &DMatrix<f64>) -> (Vec<f64>, f64) {
        let image = matrix.product(vectors);
        let values: Vec<f64> = (0..vectors.ncols()).map(|k| vectors.column(k).dot(&image.column(k))).collect();
        let left = |k: usize| (image.column(k) - vectors.column(k) * values[k]).norm();
        let most = (0..values.len()).map(left).fold(0.0, f64::max);
        (values.clone(), most / matrix.bound().max(f64::MIN_POSITIVE))
    }

    fn check(matrix: &Sparse, places: &[Point3<f64>], known: Option<&DVector<f64>>, expected: &[f64]) {
        let found = smallest(matrix, places, expected.len(), known, &Never).expect("settles");
        let (values, left) = values_of(matrix, &found);
        for (value, expected) in values.iter().zip(expected) {
            assert!((value - expected).abs() < 1e-9 * matrix.bound(), "{values:?}");
        }
        assert!(left < 1e-7, "{left:.1e}");
        let right = DMatrix::identity(expected.len(), expected.len());
        assert!((found.tr_mul(&found) - right).norm() < 1e-9);
    }

    #[test]
    fn paths_and_grids_have_their_closed_forms() {
        for (rows, cols) in [(1, 12), (1, 150), (1, 400), (9, 11), (20, 31), (24, 24)] {
            let (matrix, places) = grid(rows, cols);
            check(&matrix, &places, None, &planted(rows, cols)[..4]);
            let flat = DVector::repeat(matrix.len(), 1.0 / (matrix.len() as f64).sqrt());
            check(&matrix, &places, Some(&flat), &planted(rows, cols)[1..4]);
        }
    }

    #[test]
    fn eigenvectors_of_a_path_are_cosines() {
        let size = 300;
        let (matrix, places) = grid(1, size);
        let found = smallest(&matrix, &places, 3, None, &Never).expect("settles");
        for k in 0..3 {
            let wave = DVector::from_fn(size, |n, _| (PI * k as f64 * (n as f64 + 0.5) / size as f64).cos());
            assert!((found.column(k).dot(&wave.normalize()).abs() - 1.0).abs() < 1e-9);
        }
    }

    #[test]
    fn eigenvalues_ten_orders_below_the_largest_are_told_apart() {
        // The square of a path's Laplacian: its smallest are about 1e-8 of its largest.
        let (path, places) = grid(1, 600);
        let dense = path.to_dense();
        let square = &dense * &dense;
        let row = |r: usize| (0..600).filter(|&c| square[(r, c)] != 0.0).map(|c| (id(c), square[(r, c)])).collect();
        let matrix = Sparse::from_rows((0..600).map(row).collect());
        let found = smallest(&matrix, &places, 4, None, &Never).expect("settles");
        for (value, root) in values_of(&matrix, &found).0.iter().zip(planted(1, 600)).skip(1) {
            assert!((value / (root * root) - 1.0).abs() < 1e-4, "{value:e} for {:e}", root * root);
        }
    }

    #[test]
    fn a_graph_in_three_pieces_has_three_zeros() {
        let (one, _) = grid(8, 13);
        let row = |n: usize| {
            let (columns, values) = one.row(n % one.len());
            let shift = id(n - n % one.len());
            columns.iter().zip(values).map(|(column, value)| (column + shift, *value)).collect()
        };
        let matrix = Sparse::from_rows((0..3 * one.len()).map(row).collect());
        let places: Vec<_> = (0..matrix.len()).map(|n| Point3::new(n as f64, 0.0, 0.0)).collect();
        let expected = planted(8, 13);
        check(&matrix, &places, None, &[0.0, 0.0, 0.0, expected[1]]);
    }

    #[test]
    fn zeros_far_below_all_other_eigenvalues_do_not_drown_them() {
        // Two graphs of 300 nodes in which each is joined to 20 from all over: few steps lead anywhere.
        let joined = |a: usize, b: usize| a / 300 == b / 300 && a != b && (a * b + (a + b) * 37) % 331 < 22;
        let row = |a: usize| {
            let mut row: Vec<(u32, f64)> = (0..600).filter(|&b| joined(a, b)).map(|b| (id(b), -1.0)).collect();
            row.push((id(a), row.len() as f64));
            row.sort_by_key(|entry| entry.0);
            row
        };
        let matrix = Sparse::from_rows((0..600).map(row).collect());
        let places: Vec<_> = (0..600).map(|n| Point3::new(n as f64, 0.0, 0.0)).collect();
        let mut whole: Vec<f64> = SymmetricEigen::new(matrix.to_dense()).eigenvalues.iter().copied().collect();
        whole.sort_by(f64::total_cmp);
        assert!(whole[2] < 1e-9 && whole[3] > 5.0, "{:?}", &whole[..5]);
        check(&matrix, &places, None, &whole[..5]);
    }

    #[test]
    fn degenerate_matrices_are_decided() {
        let diagonal = |value: f64, size: usize| {
            let places = (0..size).map(|n| Point3::new(n as f64, 0.0, 0.0)).collect::<Vec<_>>();
            (Sparse::from_rows((0..size).map(|n| vec![(id(n), value)]).collect()), places)
        };
        let found = |value: f64, size: usize| {
            let (matrix, places) = diagonal(value, size);
            smallest(&matrix, &places, 2, None, &Never).map(|vectors| values_of(&matrix, &vectors).0)
        };
        for size in [3, 400] {
            assert_eq!(found(0.0, size).expect("settles"), [0.0, 0.0]);
            assert_eq!(found(f64::NAN, size).err(), Some(EigenError::NotFinite));
        }
        assert_eq!(found(1.0, 1).err(), Some(EigenError::TooFewRows { rows: 1, needed: 2 }));
        assert_eq!(found(-1.0, 400).err(), Some(EigenError::NotPositive));
    }

    #[test]
    fn a_stop_is_heeded() {
        let (matrix, places) = grid(20, 20);
        let found = smallest(&matrix, &places, 2, None, &Stopped);
        assert_eq!(found.err(), Some(EigenError::Cancelled(Cancelled)));
    }
}
