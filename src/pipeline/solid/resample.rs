//! A mask on another grid.

use nalgebra::Point3;
use rayon::prelude::*;

use super::working_grid::{WorkingGrid, at_origin};
use super::{NativeMask, SLICE};
use crate::cancel::{Cancel, Cancelled};
use crate::numerics::components::boundary_voxels;
use crate::numerics::distance::nearest_seed;
use crate::numerics::field::{centre, floor_index};
use crate::space::{Grid, VoxelIndex, WorldFromVoxel};

/// Half-way between two voxels the share is 0.5 but for rounding, which is to decide nothing: it must be past it by
/// more than f32 rounds by, 6e-8, and by less than any mask means.
const HALF: f32 = 0.500_001;

/// Shape-based interpolation (Raya, Udupa, IEEE TMI 9, 1990): the signed distance is read between
/// the voxels and made a mask again, with soft edges.
pub(super) fn resample(
    native: &NativeMask,
    plan: &WorkingGrid,
    cancel: &dyn Cancel,
) -> Result<(Grid<bool>, Grid<f32>), Cancelled> {
    let signed = signed_distance_mm(&native.mask, native.world_from_voxel.spacing_mm(), cancel)?;
    let (crop_mm, _) = at_origin(&native.world_from_voxel);
    let source = Source { signed, crop_mm, plan };
    let soft = Grid::try_of(plan.dims, |at| source.share(at), cancel)?;
    Ok((soft.try_map(|share| *share > HALF, cancel)?, soft))
}

/// What is resampled, and onto what.
struct Source<'a> {
    /// Signed distance of the native voxels, mm.
    signed: Grid<f32>,
    /// Where they lie, the first one at the origin.
    crop_mm: WorldFromVoxel,
    plan: &'a WorkingGrid,
}

impl Source<'_> {
    /// How much of a working voxel is inside, if the boundary is a plane there: its distance, over the width of a
    /// voxel.
    fn share(&self, at: VoxelIndex) -> f32 {
        let place = self.plan.centred.point(centre(at));
        let distance_mm = cubic(&self.signed, self.crop_mm.voxel(place));
        #[expect(clippy::cast_possible_truncation, reason = "the grid is f32")]
        let share = (0.5 + distance_mm / self.plan.voxel_mm).clamp(0.0, 1.0) as f32;
        share
    }
}

/// Signed distance to the voxel boundary, positive inside: half the distance to the nearest
/// outside voxel centre less that to the nearest inside one.
fn signed_distance_mm(mask: &Grid<bool>, spacing_mm: [f64; 3], cancel: &dyn Cancel) -> Result<Grid<f32>, Cancelled> {
    let mut signed = squared_distance(mask, false, spacing_mm, cancel)?;
    let inward = squared_distance(mask, true, spacing_mm, cancel)?;
    let slices = inward.as_slice().par_chunks(SLICE).zip(mask.as_slice().par_chunks(SLICE));
    signed.as_mut_slice().par_chunks_mut(SLICE).zip(slices).try_for_each(|(outward, (inward, mask))| {
        cancel.check()?;
        for ((o, i), is_inside) in outward.iter_mut().zip(inward).zip(mask) {
            *o = if *is_inside { o.sqrt() } else { -i.sqrt() } / 2.0;
        }
        Ok(())
    })?;
    Ok(signed)
}

/// Squared distance to the nearest voxel that is `value`, mm².
fn squared_distance(
    mask: &Grid<bool>,
    value: bool,
    spacing_mm: [f64; 3],
    cancel: &dyn Cancel,
) -> Result<Grid<f32>, Cancelled> {
    let seeds = boundary_voxels(mask, value, cancel)?;
    Ok(nearest_seed(mask.dims(), spacing_mm, &seeds, cancel)?.squared)
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
