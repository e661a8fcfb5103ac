//! What figures leave over of a solid: where that is thick enough to be seen and large enough to count.

use std::cmp::Reverse;

use crate::cancel::{Cancel, Cancelled};
use crate::model::FigurePatches;
use crate::numerics::components::{Connectivity, boundary_voxels, components};
use crate::numerics::distance::nearest_seed_within;
use crate::numerics::field::id;
use crate::pipeline::draft::AnyDraft;
use crate::pipeline::quality::fill::filled;
use crate::pipeline::solid::Solid;
use crate::space::Grid;

/// Depth, grains, that what is left over has somewhere, counted from its outermost voxels, and how far it reaches from there: along
/// the skin of what is well filled a layer of up to three voxels is left. With 0.5 or 2 the wing of a hip is no portion (overlap
/// 0.90, not 0.95), nor is the arch of an L1.
const LEFT_DEPTH: f64 = 1.0;

/// The pieces that are left over, of `least` voxels or more each, the largest first: marked on the working grid.
///
/// # Errors
/// When it is cancelled.
pub(super) fn remainders(
    solid: &Solid,
    drafts: &[AnyDraft<'_>],
    least: f64,
    cancel: &dyn Cancel,
) -> Result<Vec<Grid<bool>>, Cancelled> {
    let left = left_over(solid, drafts, cancel)?;
    let thick = thick_of(&left, LEFT_DEPTH * solid.voxels_per_grain, cancel)?;
    pieces(&thick, least, cancel)
}

/// The pieces of a set, joined by faces, that have `least` voxels or more, the largest first.
pub(super) fn pieces(set: &Grid<bool>, least: f64, cancel: &dyn Cancel) -> Result<Vec<Grid<bool>>, Cancelled> {
    let pieces = components(set, true, Connectivity::Faces6, cancel)?;
    let mut order: Vec<usize> = (0..pieces.sizes.len()).filter(|&piece| pieces.sizes[piece] as f64 >= least).collect();
    order.sort_by_key(|&piece| Reverse(pieces.sizes[piece]));
    let mut all = Vec::new();
    for piece in order {
        let mut marked = set.clone();
        pieces.set_all_but(&[id(piece)], &mut marked, false);
        all.push(marked);
    }
    Ok(all)
}

/// The voxels of a solid that figures do not fill.
fn left_over(solid: &Solid, drafts: &[AnyDraft<'_>], cancel: &dyn Cancel) -> Result<Grid<bool>, Cancelled> {
    let mut left = solid.inside.clone();
    let voxels = solid.world_from_work.enlarged([1.0 / solid.voxels_per_grain; 3]);
    let into_voxels = solid.world_from_work.to(&voxels);
    for draft in drafts {
        let patches = FigurePatches::unchecked(draft.body());
        let model = filled(left.dims(), patches.body(), &into_voxels, cancel)?;
        for (is_left, is_filled) in left.as_mut_slice().iter_mut().zip(model.as_slice()) {
            *is_left &= !is_filled;
        }
    }
    Ok(left)
}

/// What of a set lies no further than `depth` from one of its voxels that is as deep in it: the set opened by a ball.
fn thick_of(set: &Grid<bool>, depth: f64, cancel: &dyn Cancel) -> Result<Grid<bool>, Cancelled> {
    let to_edge = nearest_seed_within(set, &boundary_voxels(set, true, cancel)?, cancel)?.squared;
    #[expect(clippy::cast_possible_truncation, reason = "a few voxels, compared with rounded squares")]
    let squared = (depth * depth) as f32;
    let mut deep = Vec::new();
    for (voxel, to_edge) in to_edge.as_slice().iter().enumerate() {
        if set.as_slice()[voxel] && *to_edge >= squared {
            deep.push(voxel);
        }
    }
    let to_deep = nearest_seed_within(set, &deep, cancel)?.squared;
    to_deep.try_map(|to_deep| *to_deep <= squared, cancel)
}
