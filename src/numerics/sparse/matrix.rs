//! Sparse symmetric matrices in compressed rows.

use nalgebra::DMatrix;

use crate::numerics::field::id;

/// A sparse symmetric matrix; both halves are kept.
#[derive(Clone, Debug)]
pub struct Sparse {
    /// Where each row starts, and the end of the last.
    starts: Vec<usize>,
    columns: Vec<u32>,
    values: Vec<f64>,
}

impl Sparse {
    /// From the entries `(column, value)` of each row, ascending in the column. That they are symmetric is
    /// for the caller to see to.
    #[must_use]
    pub fn from_rows(rows: Vec<Vec<(u32, f64)>>) -> Self {
        let count = rows.iter().map(Vec::len).sum();
        let mut starts = Vec::with_capacity(rows.len() + 1);
        let (mut columns, mut values) = (Vec::with_capacity(count), Vec::with_capacity(count));
        starts.push(0);
        // Each row is freed as it is taken over.
        for row in rows {
            columns.extend(row.iter().map(|entry| entry.0));
            values.extend(row.iter().map(|entry| entry.1));
            starts.push(columns.len());
        }
        Self { starts, columns, values }
    }

    /// Number of rows.
    #[must_use]
    pub fn len(&self) -> usize {
        self.starts.len() - 1
    }

    /// Columns and values of a row.
    #[must_use]
    pub fn row(&self, row: usize) -> (&[u32], &[f64]) {
        let range = self.starts[row]..self.starts[row + 1];
        (&self.columns[range.clone()], &self.values[range])
    }

    /// Whether every entry is a number.
    #[must_use]
    pub fn is_finite(&self) -> bool {
        self.values.iter().all(|value| value.is_finite())
    }

    /// Sum of the diagonal.
    #[must_use]
    pub fn trace(&self) -> f64 {
        let mut sum = 0.0;
        for row in 0..self.len() {
            let (columns, values) = self.row(row);
            if let Ok(place) = columns.binary_search(&id(row)) {
                sum += values[place];
            }
        }
        sum
    }

    /// The largest sum of the sizes of a row's entries: no eigenvalue is larger.
    #[must_use]
    pub fn bound(&self) -> f64 {
        let size = |row: usize| self.row(row).1.iter().map(|value| value.abs()).sum::<f64>();
        (0..self.len()).map(size).fold(0.0, f64::max)
    }

    /// The same matrix with all entries.
    #[must_use]
    pub fn to_dense(&self) -> DMatrix<f64> {
        let mut dense = DMatrix::zeros(self.len(), self.len());
        for row in 0..self.len() {
            let (columns, values) = self.row(row);
            columns.iter().zip(values).for_each(|(&column, value)| dense[(row, column as usize)] = *value);
        }
        dense
    }

    /// The product with a block of column vectors: what tests hold solutions to.
    #[cfg(test)]
    pub fn product(&self, block: &DMatrix<f64>) -> DMatrix<f64> {
        DMatrix::from_fn(self.len(), block.ncols(), |row, k| {
            let (columns, values) = self.row(row);
            columns.iter().zip(values).map(|(&column, value)| value * block[(column as usize, k)]).sum()
        })
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::SymmetricEigen;

    use super::*;

    /// Joins n to n + 1 and n + 7.
    fn matrix(size: usize) -> Sparse {
        let is_joined = |a: usize, b: usize| matches!(a.abs_diff(b), 0 | 1 | 7);
        let entry = |a: usize, b: usize| (id(b), if a == b { 5.0 } else { -((a + b) as f64).sin() });
        let row = |a: usize| (0..size).filter(|&b| is_joined(a, b)).map(|b| entry(a, b)).collect();
        Sparse::from_rows((0..size).map(row).collect())
    }

    #[test]
    fn products_trace_and_bound_are_those_of_the_dense_matrix() {
        let sparse = matrix(1200);
        let dense = sparse.to_dense();
        let block = DMatrix::from_fn(1200, 3, |row, column| ((row * 3 + column) as f64).cos());
        let product = sparse.product(&block);
        assert!((product - &dense * &block).norm() < 1e-10);
        assert!((sparse.trace() - dense.trace()).abs() < 1e-9);
        let small = matrix(60);
        let largest = SymmetricEigen::new(small.to_dense()).eigenvalues.amax();
        assert!((largest..1.2 * largest).contains(&small.bound()));
    }

    #[test]
    fn an_empty_matrix_has_nothing() {
        let none = Sparse::from_rows(Vec::new());
        assert!(none.len() == 0 && none.is_finite() && none.values.is_empty());
        assert_eq!((none.trace(), none.bound()), (0.0, 0.0));
    }
}
