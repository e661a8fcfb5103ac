//! One piece without cavities.

use super::SLICE;
use crate::cancel::{Cancel, Cancelled};
use crate::model::Refusal;
use crate::numerics::components::{Components, Connectivity, components};
use crate::pipeline::PipelineError;
use crate::pipeline::context::Context;
use crate::space::Grid;

/// Voxels up to which a cavity, or a clump that was lost, may be noise: three along each axis. Smaller, two specks in a
/// thin mask would make it hollow; larger, the lumen of a small organ would be filled, and a fin would be no loss.
pub(super) const NOISE_VOXELS: usize = 27;
/// Share of the object's voxels that its larger cavities may hold. Above it the object is hollow: filling a lumen that
/// runs all through a slab makes it thicker by this share, and the lumen of an organ holds a fifth of its wall at the
/// least. Below, marrow spaces and vessels that a segmenter left out of a solid organ would be refused.
const HOLLOW_SHARE: f64 = 0.05;
/// Level given to voxels that change sides: what half a voxel of depth has. With less the boundary would pass
/// nearer to them than half-way, with more nearer to their neighbours.
const DECIDED: f32 = 0.2;

/// A part of a label without its cavities, which are filled with a warning.
///
/// # Errors
/// [`Refusal::Hollow`] when they are large: then it is a wall round something else; when it is cancelled.
pub(super) fn without_cavities(part: &Grid<bool>, context: &Context<'_>) -> Result<Grid<bool>, PipelineError> {
    let background = components(part, false, Connectivity::Faces6, context)?;
    refuse_if_hollow(part, &background)?;
    let mut mask = part.clone();
    let filled = background.set_all_but(background.of_first_voxel(), &mut mask, true);
    if filled > 0 {
        context.warn("cavities_filled", format!("filled cavities of {filled} voxels"));
    }
    Ok(mask)
}

/// Refuses an object with large cavities. The first component of its background, which holds the grid's first voxel, is
/// what lies round it.
fn refuse_if_hollow(part: &Grid<bool>, background: &Components) -> Result<(), Refusal> {
    let mut cavities = 0;
    for size in background.sizes.iter().skip(1) {
        cavities += if *size > NOISE_VOXELS { *size } else { 0 };
    }
    let own = part.as_slice().len() - background.sizes.iter().sum::<usize>();
    let share = cavities as f64 / own.max(1) as f64;
    if share > HOLLOW_SHARE { Err(Refusal::Hollow { voxels: cavities, share }) } else { Ok(()) }
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

/// Fills background that is not joined by faces to the grid's first voxel, which is free.
fn fill_cavities(mask: &mut Grid<bool>, cancel: &dyn Cancel) -> Result<usize, Cancelled> {
    let background = components(mask, false, Connectivity::Faces6, cancel)?;
    Ok(background.set_all_but(background.of_first_voxel(), mask, true))
}
