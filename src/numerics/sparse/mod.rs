//! Sparse symmetric matrices, equations with them, and their smallest eigenpairs: by shifted inverse iteration over a sparse Cholesky factor
//! in an order found by nested dissection.

mod matrix;

mod rows;

mod dissection;

mod cholesky;

mod smallest;

pub use cholesky::{FactorError, solved};
pub use matrix::Sparse;
pub use rows::{Memberships, RowSums};
pub use smallest::{EigenError, smallest};
