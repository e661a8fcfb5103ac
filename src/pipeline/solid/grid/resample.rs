//! A mask on another grid.

use nalgebra::{Point3, Vector3};

use super::bending::{ROOM, least_bending};
use super::working_grid::{WorkingGrid, at_origin};
use crate::cancel::{Cancel, Cancelled};
use crate::numerics::field::{centre, floor_index};
use crate::pipeline::solid::NativeMask;
use crate::space::{Grid, WorldFromVoxel};

/// Distance from the boundary beyond which the level stays the same, in working voxels and in the mask's, whichever are
/// longer: room for every step that is made from a voxel's centre to the boundary, for gradients there, and for smoothing.
const REACH: f64 = 4.0;
/// Level that counts as 0, working voxels: rounding is to decide nothing. It is more than f32 rounds by, and less than
/// any mask means.
const NOTHING: f32 = 1e-6;

/// The mask and its level on the working grid, in working voxels, by the shape of its boundary.
pub(in crate::pipeline::solid) fn resample(
    native: &NativeMask,
    plan: &WorkingGrid,
    cancel: &dyn Cancel,
) -> Result<(Grid<bool>, Grid<f32>), Cancelled> {
    let source = Source::of(native, plan, cancel)?;
    let level = Grid::try_of(plan.dims, |at| source.level(centre(at)), cancel)?;
    Ok((level.try_map(|value| *value > NOTHING, cancel)?, level))
}

/// What is resampled, and onto what.
struct Source<'a> {
    /// Level of the native voxels, mm.
    level_mm: Grid<f32>,
    /// Where they lie, the first voxel of the mask at the origin.
    crop_mm: WorldFromVoxel,
    plan: &'a WorkingGrid,
    /// [`REACH`] in working voxels.
    reach: f64,
}

impl<'a> Source<'a> {
    fn of(native: &NativeMask, plan: &'a WorkingGrid, cancel: &dyn Cancel) -> Result<Self, Cancelled> {
        let roomy = with_room(&native.mask, cancel)?;
        let level_mm = least_bending(&roomy, native.world_from_voxel.spacing_mm(), cancel)?;
        let (crop_mm, _) = at_origin(&native.world_from_voxel);
        let finest = native.world_from_voxel.spacing_mm().into_iter().fold(f64::INFINITY, f64::min);
        Ok(Self { level_mm, crop_mm, plan, reach: REACH * (finest / plan.voxel_mm).max(1.0) })
    }

    fn level(&self, at: Point3<f64>) -> f32 {
        let place = self.crop_mm.voxel(self.plan.centred.point(at)) + Vector3::repeat(ROOM as f64);
        let level = cubic(&self.level_mm, place) / self.plan.voxel_mm;
        #[expect(clippy::cast_possible_truncation, reason = "the grid is f32")]
        let level = level.clamp(-self.reach, self.reach) as f32;
        level
    }
}

/// A mask with more free voxels around it.
fn with_room(mask: &Grid<bool>, cancel: &dyn Cancel) -> Result<Grid<bool>, Cancelled> {
    let dims = mask.dims();
    let inner = |at: [usize; 3]| (0..3).all(|axis| at[axis] >= ROOM && at[axis] < dims[axis] + ROOM);
    let value = |at: [usize; 3]| inner(at) && mask[at.map(|x| x - ROOM)];
    Grid::try_of(dims.map(|n| n + 2 * ROOM), value, cancel)
}

/// Catmull-Rom interpolation along each axis; the edge goes on outside.
fn cubic(grid: &Grid<f32>, p: Point3<f64>) -> f64 {
    let dims = grid.dims();
    let mut index = [[0usize; 4]; 3];
    let mut weight = [[0.0f64; 4]; 3];
    for axis in 0..3 {
        let last = dims[axis] - 1;
        let x = p[axis].clamp(0.0, last as f64);
        let base = floor_index(x);
        let t = x - base as f64;
        index[axis] = [base.saturating_sub(1), base, (base + 1).min(last), (base + 2).min(last)];
        weight[axis] = [
            t * ((2.0 - t) * t - 1.0) / 2.0,
            (t * t * (3.0 * t - 5.0) + 2.0) / 2.0,
            t * ((4.0 - 3.0 * t) * t + 1.0) / 2.0,
            (t - 1.0) * t * t / 2.0,
        ];
    }
    let mut sum = 0.0;
    for (k, wk) in index[2].into_iter().zip(weight[2]) {
        for (j, wj) in index[1].into_iter().zip(weight[1]) {
            let mut line = 0.0;
            for (i, wi) in index[0].into_iter().zip(weight[0]) {
                line += wi * f64::from(grid[[i, j, k]]);
            }
            sum += wk * wj * line;
        }
    }
    sum
}
