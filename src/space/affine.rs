//! The affine map from voxel indices to world millimetres.

use nalgebra::{Matrix3, Matrix4, Point3, Vector3};

use super::{WorldPoint, WorldVector};

/// Columns whose normalised determinant is below this are no basis of space: the grid would
/// be flattened by more than 1 : 1000.
const MIN_NORMALISED_DETERMINANT: f64 = 1e-3;

/// Why four numbers by four are no voxel-to-world map.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum AffineError {
    /// An entry is NaN or infinite.
    #[error("entry [{row}][{column}] is not a finite number")]
    NotFinite {
        /// Row of the entry.
        row: usize,
        /// Column of the entry.
        column: usize,
    },
    /// The voxel axes do not span space.
    #[error("the three voxel axes do not span space (normalised determinant {determinant:.2e})")]
    Singular {
        /// Determinant of the normalised axes, 1 for a right-handed orthogonal grid.
        determinant: f64,
    },
}

/// World millimetres (RAS+) from voxel indices; voxel centres lie at whole indices.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct WorldFromVoxel {
    axes: Matrix3<f64>,
    origin: Vector3<f64>,
    inverse: Matrix3<f64>,
}

/// Voxel coordinates of one grid from those of another. Where both lie in the world is not in it, but for rounding.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct VoxelFromVoxel {
    axes: Matrix3<f64>,
    origin: Vector3<f64>,
}

impl VoxelFromVoxel {
    /// Coordinates in the other grid.
    #[must_use]
    pub fn point(&self, voxel: Point3<f64>) -> Point3<f64> {
        Point3::from(self.axes * voxel.coords + self.origin)
    }

    /// A displacement in the other grid.
    #[must_use]
    pub fn vector(&self, voxels: Vector3<f64>) -> Vector3<f64> {
        self.axes * voxels
    }

    /// Edge of a voxel in voxels of the other grid, of grids with cubes for voxels.
    #[must_use]
    pub fn scale(&self) -> f64 {
        self.axes.determinant().abs().cbrt()
    }
}

impl WorldFromVoxel {
    /// From the upper three rows of a homogeneous matrix, `rows[r][c]`, in millimetres.
    ///
    /// # Errors
    /// When an entry is not finite or the axes do not span space.
    pub fn from_rows(rows: [[f64; 4]; 3]) -> Result<Self, AffineError> {
        for (row, entries) in rows.iter().enumerate() {
            if let Some(column) = entries.iter().position(|x| !x.is_finite()) {
                return Err(AffineError::NotFinite { row, column });
            }
        }
        let axes = Matrix3::from_fn(|r, c| rows[r][c]);
        let origin = Vector3::from_fn(|r, _| rows[r][3]);
        let lengths: f64 = (0..3).map(|c| axes.column(c).norm()).product();
        let determinant = if lengths > 0.0 { axes.determinant() / lengths } else { 0.0 };
        match axes.try_inverse() {
            Some(inverse) if determinant.abs() >= MIN_NORMALISED_DETERMINANT => Ok(Self { axes, origin, inverse }),
            _ => Err(AffineError::Singular { determinant }),
        }
    }

    /// Axis-aligned voxels of `spacing_mm` with voxel (0, 0, 0) centred at `origin_mm`.
    ///
    /// # Errors
    /// As [`Self::from_rows`].
    pub fn axis_aligned(spacing_mm: [f64; 3], origin_mm: [f64; 3]) -> Result<Self, AffineError> {
        let mut rows = [[0.0; 4]; 3];
        for axis in 0..3 {
            rows[axis][axis] = spacing_mm[axis];
            rows[axis][3] = origin_mm[axis];
        }
        Self::from_rows(rows)
    }

    /// The homogeneous 4 × 4 matrix.
    #[must_use]
    pub fn matrix(&self) -> Matrix4<f64> {
        let mut matrix = self.axes.to_homogeneous();
        matrix.fixed_view_mut::<3, 1>(0, 3).copy_from(&self.origin);
        matrix
    }

    /// The homogeneous matrix as rows, `rows[r][c]`.
    #[must_use]
    pub fn rows(&self) -> [[f64; 4]; 4] {
        let matrix = self.matrix();
        std::array::from_fn(|r| std::array::from_fn(|c| matrix[(r, c)]))
    }

    /// World position of (fractional) voxel coordinates.
    #[must_use]
    pub fn point(&self, voxel: Point3<f64>) -> WorldPoint {
        Point3::from(self.axes * voxel.coords + self.origin)
    }

    /// World displacement of a displacement in voxels.
    #[must_use]
    pub fn vector(&self, voxels: Vector3<f64>) -> WorldVector {
        self.axes * voxels
    }

    /// Fractional voxel coordinates of a world position.
    #[must_use]
    pub fn voxel(&self, world: WorldPoint) -> Point3<f64> {
        Point3::from(self.inverse * (world.coords - self.origin))
    }

    /// The way from these voxels to others.
    #[must_use]
    pub fn to(&self, other: &Self) -> VoxelFromVoxel {
        if self == other {
            return VoxelFromVoxel { axes: Matrix3::identity(), origin: Vector3::zeros() };
        }
        VoxelFromVoxel { axes: other.inverse * self.axes, origin: other.inverse * (self.origin - other.origin) }
    }

    /// Edge lengths of a voxel, mm.
    #[must_use]
    pub fn spacing_mm(&self) -> [f64; 3] {
        std::array::from_fn(|c| self.axes.column(c).norm())
    }

    /// Volume of a voxel, mm³.
    #[must_use]
    pub fn voxel_volume_mm3(&self) -> f64 {
        self.axes.determinant().abs()
    }

    /// Voxels of other edges, by a factor along each axis, with the same first centre.
    #[must_use]
    pub fn enlarged(&self, by: [f64; 3]) -> Self {
        let mut enlarged = *self;
        for (axis, by) in by.into_iter().enumerate() {
            enlarged.axes.column_mut(axis).scale_mut(by);
            enlarged.inverse.row_mut(axis).scale_mut(1.0 / by);
        }
        enlarged
    }

    /// The same voxels moved in the world.
    #[must_use]
    pub fn translated(&self, by: WorldVector) -> Self {
        Self { origin: self.origin + by, ..*self }
    }

    /// The same voxels counted from another one: `first` becomes (0, 0, 0).
    #[must_use]
    pub fn shifted_to(&self, first: Vector3<f64>) -> Self {
        Self { origin: self.axes * first + self.origin, ..*self }
    }
}
