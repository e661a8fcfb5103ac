//! The level of a solid in work space, which counts in grains of the mask: a working voxel may be finer.

use nalgebra::{Point3, Vector3};

use crate::numerics::field::Field;
use crate::space::Grid;

/// A field on the working grid, positive inside of the solid and 0 on its boundary.
#[derive(Clone, Debug)]
pub struct Level {
    /// By working voxels.
    pub(super) field: Field,
    /// Working voxels to a unit of work space.
    voxels_per_unit: f64,
}

impl Level {
    /// On a grid whose voxels are the unit.
    #[must_use]
    pub fn new(grid: Grid<f32>) -> Self {
        Self { field: Field(grid), voxels_per_unit: 1.0 }
    }

    /// The same in a unit of so many voxels.
    #[must_use]
    pub(super) fn in_units(self, voxels_per_unit: f64) -> Self {
        Self { voxels_per_unit, ..self }
    }

    /// The level at a place.
    #[must_use]
    pub fn at(&self, p: Point3<f64>) -> f64 {
        self.field.at(p * self.voxels_per_unit)
    }

    /// Gradient per unit.
    #[must_use]
    pub(crate) fn gradient(&self, p: Point3<f64>) -> Vector3<f64> {
        self.field.gradient(p * self.voxels_per_unit) * self.voxels_per_unit
    }

    /// [`Field::first_zero`], in units.
    #[must_use]
    pub(crate) fn first_zero(&self, from: Point3<f64>, direction: Vector3<f64>, reach: f64) -> Option<f64> {
        let k = self.voxels_per_unit;
        self.field.first_zero(from * k, direction, reach * k).map(|length| length / k)
    }
}
