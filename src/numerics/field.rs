//! A scalar field sampled on an isotropic grid, read between the samples.

use nalgebra::{Point3, Vector3};

use crate::space::{Grid, VoxelIndex};

/// Step of the central differences, voxels. Smaller shows the kinks of the trilinear
/// interpolation, larger blurs the normals of thin parts.
const GRADIENT_STEP: f64 = 0.5;

/// A scalar field; positions are in voxels of its grid.
#[derive(Clone, Debug)]
pub struct Field(pub Grid<f32>);

impl Field {
    /// Trilinear interpolation; positions outside the grid read its edge.
    #[must_use]
    pub fn at(&self, p: Point3<f64>) -> f64 {
        let dims = self.0.dims();
        let data = self.0.as_slice();
        let mut base = [0usize; 3];
        let mut part = [0.0f64; 3];
        for axis in 0..3 {
            let last = dims[axis].saturating_sub(2);
            let x = p[axis].clamp(0.0, (dims[axis] - 1) as f64);
            base[axis] = floor_index(x).min(last);
            part[axis] = x - base[axis] as f64;
        }
        let [nx, ny, _] = dims;
        let step = [usize::from(nx > 1), if ny > 1 { nx } else { 0 }, if dims[2] > 1 { nx * ny } else { 0 }];
        let o = base[0] + nx * (base[1] + ny * base[2]);
        let line = |o: usize| {
            let (a, b) = (f64::from(data[o]), f64::from(data[o + step[0]]));
            a + (b - a) * part[0]
        };
        let plane = |o: usize| {
            let (a, b) = (line(o), line(o + step[1]));
            a + (b - a) * part[1]
        };
        let (a, b) = (plane(o), plane(o + step[2]));
        a + (b - a) * part[2]
    }

    /// Gradient per voxel, by central differences.
    #[must_use]
    pub(crate) fn gradient(&self, p: Point3<f64>) -> Vector3<f64> {
        Vector3::from_fn(|axis, _| {
            let mut step = Vector3::zeros();
            step[axis] = GRADIENT_STEP;
            (self.at(p + step) - self.at(p - step)) / (2.0 * GRADIENT_STEP)
        })
    }

    /// First zero of the field along `direction` (unit) from `from`, where it is positive:
    /// the distance, at most `reach`; `None` when the field stays positive that far.
    #[must_use]
    pub(crate) fn first_zero(&self, from: Point3<f64>, direction: Vector3<f64>, reach: f64) -> Option<f64> {
        /// Step of the march, voxels. The field is smooth over a voxel; half of one cannot
        /// jump over a wall that a mask can hold.
        const STEP: f64 = 0.5;
        let mut before = self.at(from);
        if before <= 0.0 {
            return Some(0.0);
        }
        let mut t = 0.0;
        while t < reach {
            let next = (t + STEP).min(reach);
            let value = self.at(from + direction * next);
            if value <= 0.0 {
                return Some(self.refine_zero(from, direction, (t, before), (next, value)));
            }
            (t, before) = (next, value);
        }
        None
    }

    /// Regula falsi between a positive and a non-positive sample.
    fn refine_zero(
        &self,
        from: Point3<f64>,
        direction: Vector3<f64>,
        (mut a, mut fa): (f64, f64),
        (mut b, mut fb): (f64, f64),
    ) -> f64 {
        for _ in 0..4 {
            let t = a + (b - a) * fa / (fa - fb).max(1e-12);
            let f = self.at(from + direction * t);
            if f > 0.0 {
                (a, fa) = (t, f);
            } else {
                (b, fb) = (t, f);
            }
        }
        a + (b - a) * fa / (fa - fb).max(1e-12)
    }
}

/// The centre of a voxel.
#[must_use]
pub fn centre(voxel: VoxelIndex) -> Point3<f64> {
    Point3::from(voxel.map(|x| x as f64))
}

/// Floor of a non-negative coordinate as an index.
#[must_use]
pub(crate) fn floor_index(x: f64) -> usize {
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "grid coordinates are clamped to the grid before they come here"
    )]
    let index = x.max(0.0) as usize;
    index
}

/// An index into a point list as stored in grids and graphs.
///
/// # Panics
/// When a list has more than 2³² entries; working grids are capped far below.
#[must_use]
pub fn id(index: usize) -> u32 {
    u32::try_from(index).expect("working grids are capped far below 2^32 voxels")
}
