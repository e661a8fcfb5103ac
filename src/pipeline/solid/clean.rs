//! One piece without cavities, but for lumens.

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
/// Share of the object's voxels from which a cavity is a lumen, and which all that are none may hold. Above it they are not filled:
/// filling a lumen that runs all through a slab makes it thicker by this share, and the lumen of an organ holds a fifth of its wall
/// at the least. Below, marrow spaces and vessels that a segmenter left out of a solid organ would be lumens.
const HOLLOW_SHARE: f64 = 0.05;
/// Level given to voxels that change sides: what half a voxel of depth has. With less the boundary would pass
/// nearer to them than half-way, with more nearer to their neighbours.
const DECIDED: f32 = 0.2;

/// A part of a label without its cavities, but for its lumens: cavities that each hold [`HOLLOW_SHARE`] of its voxels. What is
/// filled is warned of.
///
/// # Errors
/// [`Refusal::Hollow`] when what is no lumen holds as much; when it is cancelled.
pub(super) fn without_cavities(part: &Grid<bool>, context: &Context<'_>) -> Result<Piece, PipelineError> {
    let background = components(part, false, Connectivity::Faces6, context)?;
    let kept = lumens(part, &background)?;
    let mut mask = part.clone();
    let filled = background.set_all_but(&kept, &mut mask, true);
    if filled > 0 {
        context.warn("cavities_filled", format!("filled cavities of {filled} voxels"));
    }
    if kept.len() > 1 {
        let voxels = kept[1..].iter().map(|number| background.sizes[*number as usize]).sum::<usize>();
        context.warn(
            "lumen_left_out",
            format!(
                "the object is the wall of a lumen of {voxels} voxels, which is no part of it: the wall is measured"
            ),
        );
    }
    Ok(Piece { inside: mask, lumens: kept.len() - 1 })
}

/// What lies round an object and what it encloses, of its background, whose first component holds the grid's first voxel.
fn lumens(part: &Grid<bool>, background: &Components) -> Result<Vec<u32>, Refusal> {
    let own = (part.as_slice().len() - background.sizes.iter().sum::<usize>()).max(1) as f64;
    let (mut kept, mut other) = (vec![0], 0);
    for number in background.by_size() {
        let size = background.sizes[number as usize];
        if number == 0 || size <= NOISE_VOXELS {
            continue;
        }
        if size as f64 > HOLLOW_SHARE * own {
            kept.push(number);
        } else {
            other += size;
        }
    }
    let share = other as f64 / own;
    if share > HOLLOW_SHARE { Err(Refusal::Hollow { voxels: other, share }) } else { Ok(kept) }
}

/// One piece of a solid.
pub(super) struct Piece {
    /// Its voxels.
    pub inside: Grid<bool>,
    /// How many lumens it encloses.
    pub lumens: usize,
}

/// The inside of the smoothed boundary, reduced to its largest part with at most so many lumens and no other cavities. The level
/// is changed to agree.
pub(super) fn keep_one_piece(
    level: &mut Grid<f32>,
    most_lumens: usize,
    cancel: &dyn Cancel,
) -> Result<Piece, Cancelled> {
    let mut inside = level.try_map(|v| *v > 0.0, cancel)?;
    let parts = components(&inside, true, Connectivity::Corners26, cancel)?;
    let dropped = parts.set_all_but(parts.largest().as_slice(), &mut inside, false);
    let (lumens, filled) = fill_cavities(&mut inside, most_lumens, cancel)?;
    if dropped + filled > 0 {
        for (level, inside) in level.as_mut_slice().chunks_mut(SLICE).zip(inside.as_slice().chunks(SLICE)) {
            cancel.check()?;
            for (v, m) in level.iter_mut().zip(inside) {
                if *m != (*v > 0.0) {
                    *v = if *m { DECIDED } else { -DECIDED };
                }
            }
        }
    }
    Ok(Piece { inside, lumens })
}

/// Fills background that is not joined by faces to the grid's first voxel, which is free, but for the largest cavities, at most
/// so many. How many are left, and how many voxels were filled.
fn fill_cavities(mask: &mut Grid<bool>, most_lumens: usize, cancel: &dyn Cancel) -> Result<(usize, usize), Cancelled> {
    let background = components(mask, false, Connectivity::Faces6, cancel)?;
    let mut kept: Vec<u32> = background.of_first_voxel().into_iter().collect();
    let around = kept.len();
    for number in background.by_size() {
        let is_lumen = background.sizes[number as usize] > NOISE_VOXELS && !kept.contains(&number);
        if is_lumen && kept.len() < around + most_lumens {
            kept.push(number);
        }
    }
    let filled = background.set_all_but(&kept, mask, true);
    Ok((kept.len() - around, filled))
}
