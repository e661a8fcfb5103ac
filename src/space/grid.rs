//! Dense three-dimensional arrays in NIfTI order: the first index runs fastest.

use rayon::prelude::*;

/// Integer voxel coordinates `(i, j, k)`.
pub type VoxelIndex = [usize; 3];

/// A dense array over a box of voxels; `i` is the fastest index.
#[derive(Clone, Debug, PartialEq)]
pub struct Grid<T> {
    dims: [usize; 3],
    data: Vec<T>,
}

impl<T> Grid<T> {
    /// Wraps `data`, whose length must be the product of `dims`; `None` otherwise.
    #[must_use]
    pub fn from_vec(dims: [usize; 3], data: Vec<T>) -> Option<Self> {
        let count = dims[0].checked_mul(dims[1])?.checked_mul(dims[2])?;
        (count == data.len()).then_some(Self { dims, data })
    }

    /// Voxels along each axis.
    #[must_use]
    pub fn dims(&self) -> [usize; 3] {
        self.dims
    }

    /// All values, `i` fastest.
    #[must_use]
    pub fn as_slice(&self) -> &[T] {
        &self.data
    }

    /// All values, `i` fastest, to write to.
    pub fn as_mut_slice(&mut self) -> &mut [T] {
        &mut self.data
    }

    /// The rows along the first axis, to write to, in groups that can be worked on apart: lines along
    /// `axis` (1 or 2) run across the rows of one group, in order.
    pub fn rows_across(&mut self, axis: usize) -> Vec<Vec<&mut [T]>> {
        let [nx, ny, nz] = self.dims;
        let (groups, length) = if axis == 1 { (nz, ny) } else { (ny, nz) };
        let mut out: Vec<Vec<&mut [T]>> = (0..groups).map(|_| Vec::with_capacity(length)).collect();
        for (n, row) in self.data.chunks_exact_mut(nx.max(1)).enumerate() {
            out[if axis == 1 { n / ny } else { n % ny }].push(row);
        }
        out
    }

    /// Offset of a voxel in [`Self::as_slice`].
    #[must_use]
    pub fn offset(&self, [i, j, k]: VoxelIndex) -> usize {
        i + self.dims[0] * (j + self.dims[1] * k)
    }

    /// The voxel at an offset of [`Self::as_slice`].
    #[must_use]
    pub fn index(&self, offset: usize) -> VoxelIndex {
        let [nx, ny, _] = self.dims;
        [offset % nx, offset / nx % ny, offset / (nx * ny)]
    }
}

impl<T: Sync> Grid<T> {
    /// The same grid with every value changed.
    pub fn map<U: Send>(&self, change: impl Fn(&T) -> U + Send + Sync) -> Grid<U> {
        Grid { dims: self.dims, data: self.data.par_iter().with_min_len(1 << 14).map(change).collect() }
    }
}

impl<T: Send> Grid<T> {
    /// A grid of what `value` says of each voxel.
    pub fn of(dims: [usize; 3], value: impl Fn(VoxelIndex) -> T + Send + Sync) -> Self {
        let [nx, ny, nz] = dims;
        let row = |n: usize| (0..nx).map(move |i| [i, n % ny, n / ny]);
        let data = (0..ny * nz).into_par_iter().flat_map_iter(|n| row(n).map(&value)).collect();
        Self { dims, data }
    }
}

impl<T: Clone> Grid<T> {
    /// A grid with the same value everywhere.
    #[must_use]
    pub fn filled(dims: [usize; 3], value: T) -> Self {
        Self { dims, data: vec![value; dims[0] * dims[1] * dims[2]] }
    }
}

impl<T> std::ops::Index<VoxelIndex> for Grid<T> {
    type Output = T;
    fn index(&self, at: VoxelIndex) -> &T {
        &self.data[self.offset(at)]
    }
}

impl<T> std::ops::IndexMut<VoxelIndex> for Grid<T> {
    fn index_mut(&mut self, at: VoxelIndex) -> &mut T {
        let offset = self.offset(at);
        &mut self.data[offset]
    }
}
