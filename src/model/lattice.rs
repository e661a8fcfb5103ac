//! The lattice of a figure: its size, and the nodes round its edge.

use serde::{Deserialize, Serialize};

/// Lattice size: `rows` across the shorter intrinsic axis, `cols` along the longer.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct LatticeSize {
    /// Nodes across (i).
    pub rows: usize,
    /// Nodes along (j).
    pub cols: usize,
}

impl LatticeSize {
    /// The nodes of a quad as row-major offsets `[(i, j), (i, j+1), (i+1, j), (i+1, j+1)]`.
    #[must_use]
    pub fn quad(self, i: usize, j: usize) -> [usize; 4] {
        let first = i * self.cols + j;
        [first, first + 1, first + self.cols, first + self.cols + 1]
    }
}

/// The nodes round the edge of a lattice as row-major offsets: (0,0)…(0,M−1), (1,M−1)…(N−1,M−1),
/// (N−1,M−2)…(N−1,0), (N−2,0)…(1,0).
#[must_use]
pub fn ring(grid: LatticeSize) -> Vec<usize> {
    let LatticeSize { rows, cols } = grid;
    let top = (0..cols).map(|j| (0, j));
    let right = (1..rows).map(|i| (i, cols - 1));
    let bottom = (0..cols - 1).rev().map(|j| (rows - 1, j));
    let left = (1..rows - 1).rev().map(|i| (i, 0));
    top.chain(right).chain(bottom).chain(left).map(|(i, j)| i * cols + j).collect()
}
