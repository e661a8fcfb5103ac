//! Sparse symmetric matrices and their smallest eigenpairs: by shifted inverse iteration over a sparse Cholesky factor
//! in an order found by nested dissection.

mod matrix;

mod dissection;

mod cholesky;

mod smallest;

pub use matrix::Sparse;
pub use smallest::{EigenError, Smallest, smallest};
