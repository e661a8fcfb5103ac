//! Thin solids are worked on on a finer grid: a skeleton of whole voxels wavers by half of one, and of a plate of three
//! that is more than can be told apart from its sides.

use super::working_grid::WorkingGrid;
use crate::cancel::{Cancel, Cancelled};
use crate::numerics::components::boundary_voxels;
use crate::numerics::distance::nearest_seed;
use crate::numerics::stats::percentile;
use crate::numerics::topology::cube;
use crate::pipeline::context::Context;
use crate::pipeline::solid::NativeMask;
use crate::space::Grid;

/// Distance from the ridge of a solid to the nearest voxel outside, in voxels of the finest spacing, up to which it is
/// thin: half a voxel more than the radius. A disk of three voxels is laid out on half of them (overlap 0.99) and not on
/// whole ones (0.76), and seven thin structures of a torso have answers without a fold that were refused; with 3, a
/// hippocampus folds.
const THIN: f64 = 2.5;
/// How much of the ridge, per cent: an object that is thin at its ends alone has its place on its own grid.
const NEARLY_ALL: usize = 90;
/// Share of the finest spacing that a thin solid's working voxel has. With 0.4 there are twice as many voxels for 0.002
/// more of the disk's overlap.
const FINER: f64 = 0.5;
/// Voxels of a finer grid at the most: the stages take seconds for as many.
const MOST_VOXELS: f64 = 20e6;

/// The grid to work on where none is asked for.
///
/// # Errors
/// When it is cancelled.
pub(in crate::pipeline::solid) fn fitting_grid(
    native: &NativeMask,
    context: &Context<'_>,
) -> Result<WorkingGrid, Cancelled> {
    let plan = WorkingGrid::plan(native, context.params.resolution_mm);
    if context.params.resolution_mm.is_some() {
        return Ok(plan);
    }
    let spacing = native.world_from_voxel.spacing_mm();
    let finest = spacing.into_iter().fold(f64::INFINITY, f64::min);
    let finer = WorkingGrid::plan(native, Some(FINER * finest));
    if finer.voxels(1.0) > MOST_VOXELS {
        return Ok(plan);
    }
    let ridge_mm = ridge_mm(&native.mask, spacing, context)?;
    Ok(if ridge_mm.is_some_and(|ridge| ridge <= THIN * finest) { finer } else { plan })
}

/// Distance of nearly all voxels that lie deepest among their neighbours from the nearest voxel outside, mm. `None` of
/// nothing.
fn ridge_mm(mask: &Grid<bool>, spacing: [f64; 3], context: &Context<'_>) -> Result<Option<f64>, Cancelled> {
    let outward = nearest_seed(mask.dims(), spacing, &boundary_voxels(mask, false, context)?, context)?.squared;
    let [nx, ny, nz] = mask.dims();
    let mut ridge = Vec::new();
    for k in 1..nz.saturating_sub(1) {
        context.check()?;
        for j in 1..ny - 1 {
            for i in 1..nx.saturating_sub(1) {
                let at = mask.offset([i, j, k]);
                let own = outward.as_slice()[at];
                let is_deepest = |other: usize| !mask.as_slice()[other] || outward.as_slice()[other] <= own;
                if mask.as_slice()[at] && cube(at, nx, nx * ny).into_iter().all(is_deepest) {
                    ridge.push(f64::from(own.sqrt()));
                }
            }
        }
    }
    ridge.sort_by(f64::total_cmp);
    Ok(percentile(&ridge, NEARLY_ALL))
}
