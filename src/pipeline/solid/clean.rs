//! One piece without cavities.

use super::SLICE;
use crate::cancel::{Cancel, Cancelled};
use crate::numerics::components::{Connectivity, components};
use crate::pipeline::context::Context;
use crate::space::Grid;

/// A second part of at least this share of the largest is not a stray. It decides which of two warnings is given,
/// nothing else.
const PART_SHARE: f64 = 0.1;
/// Level given to voxels that change sides: what half a voxel of depth has. With less the boundary would pass
/// nearer to them than half-way, with more nearer to their neighbours.
const DECIDED: f32 = 0.2;

/// The largest part without cavities.
pub(super) fn clean(mut mask: Grid<bool>, context: &Context<'_>) -> Result<Grid<bool>, Cancelled> {
    let parts = components(&mask, true, Connectivity::Corners26, context)?;
    let size = parts.sizes.iter().max().copied().unwrap_or(0);
    let dropped = parts.set_all_but(parts.largest(), &mut mask, false);
    if dropped > 0 {
        let big = parts.sizes.iter().filter(|s| **s as f64 >= PART_SHARE * size as f64).count();
        let code = if big > 1 { "several_parts" } else { "stray_voxels_dropped" };
        let message = format!("kept the largest of {} parts; {dropped} voxels were dropped", parts.sizes.len());
        context.warn(code, message);
    }
    let filled = fill_cavities(&mut mask, context)?;
    if filled > 0 {
        let message = format!("filled cavities of {filled} voxels");
        context.warn("cavities_filled", message);
    }
    Ok(mask)
}

/// Fills background that is not joined by faces to the grid's first voxel, which is free.
fn fill_cavities(mask: &mut Grid<bool>, cancel: &dyn Cancel) -> Result<usize, Cancelled> {
    let background = components(mask, false, Connectivity::Faces6, cancel)?;
    Ok(background.set_all_but(background.of_first_voxel(), mask, true))
}

/// The inside of the smoothed boundary, reduced to its largest part without cavities. The level
/// is changed to agree.
pub(super) fn keep_one_piece(level: &mut Grid<f32>, cancel: &dyn Cancel) -> Result<Grid<bool>, Cancelled> {
    let mut inside = level.try_map(|v| *v > 0.0, cancel)?;
    let parts = components(&inside, true, Connectivity::Corners26, cancel)?;
    let dropped = parts.set_all_but(parts.largest(), &mut inside, false);
    if dropped + fill_cavities(&mut inside, cancel)? > 0 {
        for (level, inside) in level.as_mut_slice().chunks_mut(SLICE).zip(inside.as_slice().chunks(SLICE)) {
            cancel.check()?;
            for (v, m) in level.iter_mut().zip(inside) {
                if *m != (*v > 0.0) {
                    *v = if *m { DECIDED } else { -DECIDED };
                }
            }
        }
    }
    Ok(inside)
}
