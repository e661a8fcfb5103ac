//! The two leading eigenpairs of a symmetric matrix.

use nalgebra::{DMatrix, DVector, SymmetricEigen};

use crate::cancel::{Cancel, Cancelled};

/// Above this size the whole spectrum costs more than iterating on the part wanted.
const WHOLE_SPECTRUM_LIMIT: usize = 160;
/// Vectors iterated on; more than the two wanted, so that a close third does not slow it down.
const BLOCK: usize = 8;
/// Rounds at most. The embeddings of sheets need 10 to 40.
const MAX_ROUNDS: usize = 500;
/// Relative change of the wanted eigenvalues at which iteration stops.
const TOLERANCE: f64 = 1e-10;

/// Leading eigenpairs.
#[derive(Clone, Debug)]
pub struct Leading {
    /// The two largest eigenvalues, descending.
    pub values: [f64; 2],
    /// Their unit eigenvectors.
    pub vectors: [DVector<f64>; 2],
}

/// The two algebraically largest eigenpairs of a symmetric matrix; `None` when it has fewer than
/// two rows, holds a number that is not finite, or the iteration does not settle.
///
/// # Errors
/// When it is cancelled.
pub fn leading_two(matrix: DMatrix<f64>, cancel: &dyn Cancel) -> Result<Option<Leading>, Cancelled> {
    if matrix.nrows() < 2 || matrix.iter().any(|x| !x.is_finite()) {
        return Ok(None);
    }
    if matrix.nrows() <= WHOLE_SPECTRUM_LIMIT { Ok(whole(matrix)) } else { iterate(&matrix, cancel) }
}

fn whole(matrix: DMatrix<f64>) -> Option<Leading> {
    let size = matrix.nrows();
    let eigen = SymmetricEigen::try_new(matrix, f64::EPSILON, 100 * size)?;
    let mut order: Vec<usize> = (0..size).collect();
    order.sort_by(|&a, &b| eigen.eigenvalues[b].total_cmp(&eigen.eigenvalues[a]));
    let vector = |k: usize| eigen.eigenvectors.column(order[k]).into_owned();
    Some(Leading {
        values: [eigen.eigenvalues[order[0]], eigen.eigenvalues[order[1]]],
        vectors: [vector(0), vector(1)],
    })
}

/// Block subspace iteration with Rayleigh-Ritz. The matrix is shifted by a bound of its most
/// negative eigenvalue's size only through the choice of the largest Ritz values: geodesic Gram
/// matrices have small negative parts.
fn iterate(matrix: &DMatrix<f64>, cancel: &dyn Cancel) -> Result<Option<Leading>, Cancelled> {
    let size = matrix.nrows();
    let mut block = DMatrix::from_fn(size, BLOCK, start_entry);
    let mut before = [0.0; 2];
    for _ in 0..MAX_ROUNDS {
        let basis = product(matrix, &block, cancel)?.qr().q();
        let image = product(matrix, &basis, cancel)?;
        let small = basis.transpose() * &image;
        let eigen = SymmetricEigen::try_new((&small + small.transpose()) * 0.5, f64::EPSILON, 1000);
        let Some(eigen) = eigen else { return Ok(None) };
        let mut order: Vec<usize> = (0..BLOCK).collect();
        order.sort_by(|&a, &b| eigen.eigenvalues[b].total_cmp(&eigen.eigenvalues[a]));
        let values = [eigen.eigenvalues[order[0]], eigen.eigenvalues[order[1]]];
        let settled = (0..2).all(|k| (values[k] - before[k]).abs() <= TOLERANCE * values[0].abs());
        if settled {
            let vector = |k: usize| (&basis * eigen.eigenvectors.column(order[k])).normalize();
            return Ok(Some(Leading { values, vectors: [vector(0), vector(1)] }));
        }
        before = values;
        block = basis * eigen.eigenvectors;
    }
    Ok(None)
}

/// The product of two matrices, some rows at a time.
fn product(matrix: &DMatrix<f64>, block: &DMatrix<f64>, cancel: &dyn Cancel) -> Result<DMatrix<f64>, Cancelled> {
    /// Rows of a slice.
    const ROWS: usize = 1024;
    let mut product = DMatrix::zeros(matrix.nrows(), block.ncols());
    for from in (0..matrix.nrows()).step_by(ROWS) {
        cancel.check()?;
        let count = ROWS.min(matrix.nrows() - from);
        matrix.rows(from, count).mul_to(block, &mut product.rows_mut(from, count));
    }
    Ok(product)
}

/// Deterministic entries without structure that an eigenvector could be orthogonal to.
fn start_entry(row: usize, column: usize) -> f64 {
    ((row + 1) as f64 * (12.9898 + column as f64)).sin()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cancel::Never;

    #[test]
    fn both_ways_find_planted_eigenvalues() {
        for size in [20, 300] {
            let u = DVector::from_fn(size, |i, _| (i as f64 * 0.7).sin()).normalize();
            let v = DVector::from_fn(size, |i, _| (i as f64 * 1.9).cos());
            let v = (&v - &u * u.dot(&v)).normalize();
            let matrix = &u * u.transpose() * 5.0 + &v * v.transpose() * 3.0 - DMatrix::identity(size, size) * 0.5;
            let found = leading_two(matrix, &Never).expect("not stopped").expect("settles");
            assert!((found.values[0] - 4.5).abs() < 1e-6 && (found.values[1] - 2.5).abs() < 1e-6);
            assert!((found.vectors[0].dot(&u).abs() - 1.0).abs() < 1e-6);
        }
    }

    #[test]
    fn a_zero_matrix_and_nan_are_decided() {
        let found = |matrix| leading_two(matrix, &Never).expect("not stopped");
        assert!(found(DMatrix::zeros(200, 200)).is_some_and(|l| l.values == [0.0, 0.0]));
        assert!(found(DMatrix::from_element(3, 3, f64::NAN)).is_none());
    }

    #[test]
    fn a_product_in_slices_is_that_of_the_whole_to_the_last_bit() {
        let matrix = DMatrix::from_fn(2500, 2500, |r, c| ((r * 31 + c * 17) as f64).sin());
        let block = DMatrix::from_fn(2500, BLOCK, start_entry);
        assert_eq!(product(&matrix, &block, &Never), Ok(&matrix * &block));
    }
}
