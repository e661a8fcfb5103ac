//! Dense three-dimensional arrays in NIfTI order: the first index runs fastest.

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
