//! Dense three-dimensional arrays in NIfTI order: the first index runs fastest.

use rayon::prelude::*;

use crate::cancel::{Cancel, Cancelled};

/// Integer voxel coordinates `(i, j, k)`.
pub type VoxelIndex = [usize; 3];

/// Voxels between two looks at whether to go on, where each takes a nanosecond.
const SLICE: usize = 1 << 22;

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

    /// All values, `i` fastest, without the grid.
    #[must_use]
    pub fn into_vec(self) -> Vec<T> {
        self.data
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
    ///
    /// # Errors
    /// When it is cancelled.
    pub fn try_map<U: Send>(
        &self,
        change: impl Fn(&T) -> U + Send + Sync,
        cancel: &dyn Cancel,
    ) -> Result<Grid<U>, Cancelled> {
        let mut data = Vec::with_capacity(self.data.len());
        for slice in self.data.chunks(SLICE) {
            cancel.check()?;
            data.par_extend(slice.par_iter().with_min_len(1 << 14).map(&change));
        }
        Ok(Grid { dims: self.dims, data })
    }
}

impl<T: Send> Grid<T> {
    /// A grid of what `value` says of each voxel.
    ///
    /// # Errors
    /// When it is cancelled.
    pub fn try_of(
        dims: [usize; 3],
        value: impl Fn(VoxelIndex) -> T + Send + Sync,
        cancel: &dyn Cancel,
    ) -> Result<Self, Cancelled> {
        let [nx, ny, nz] = dims;
        let mut data = Vec::with_capacity(nx * ny * nz);
        for k in 0..nz {
            cancel.check()?;
            data.par_extend((0..nx * ny).into_par_iter().with_min_len(nx).map(|n| value([n % nx, n / nx, k])));
        }
        Ok(Self { dims, data })
    }
}

impl<T: Clone> Grid<T> {
    /// A grid with the same value everywhere.
    #[must_use]
    pub fn filled(dims: [usize; 3], value: T) -> Self {
        Self { dims, data: vec![value; dims[0] * dims[1] * dims[2]] }
    }

    /// The same, of a grid so large that memory takes its time to come.
    ///
    /// # Errors
    /// When it is cancelled.
    pub fn try_filled(dims: [usize; 3], value: T, cancel: &dyn Cancel) -> Result<Self, Cancelled> {
        let count = dims[0] * dims[1] * dims[2];
        let mut data = Vec::with_capacity(count);
        while data.len() < count {
            cancel.check()?;
            data.resize((data.len() + SLICE).min(count), value.clone());
        }
        Ok(Self { dims, data })
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
