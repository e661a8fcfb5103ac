//! A part that hangs on by a neck which is too thin for the grid: smoothing would cut it off and drop it. It is a part by
//! itself.
//!
//! 1. A part that falls in two when a layer of voxels is taken off may hang so: that is quick, and few do;
//! 2. of such a part the solid is made, and what it lost looked at ([`changes`](super::changes)): a clump as large as a part
//!    has no place in the solid;
//! 3. the voxels between go to whichever is nearer.

use super::changes::lost_voxels;
use super::parts::SentPart;
use super::{Masked, masked};
use crate::cancel::{Cancel, Cancelled};
use crate::numerics::components::{Connectivity, boundary_voxels, components};
use crate::numerics::distance::nearest_seed;
use crate::pipeline::PipelineError;
use crate::pipeline::context::Context;
use crate::space::Grid;

/// Share of its voxels that a clump keeps when a layer is taken off. A ball of 300 voxels keeps 0.4, a plate of three layers
/// 0.3; lower, more parts are looked at in vain.
const KEPT_OF_CLUMP: f64 = 0.25;

/// The two parts that a part is, if a clump of at least so many voxels hangs on by a neck.
///
/// # Errors
/// When it is cancelled.
pub(super) fn apart(part: &SentPart, least: f64, context: &Context<'_>) -> Result<Option<[SentPart; 2]>, Cancelled> {
    if !may_hang(&part.native.mask, least, context)? {
        return Ok(None);
    }
    let solid = match masked(&part.native, &context.unperturbed()) {
        Ok(Masked { solid, .. }) => solid,
        // Said when it is worked on.
        Err(PipelineError::Refused(_)) => return Ok(None),
        Err(PipelineError::Cancelled(stop)) => return Err(stop),
    };
    let lost = lost_voxels(&solid, context)?;
    let clump = largest_clump(&part.native.mask, &lost, context)?;
    if (clump.len() as f64) < least {
        return Ok(None);
    }
    let is_lost = marked(&part.native.mask, &lost);
    let mut others = Vec::new();
    for (voxel, is_own) in part.native.mask.as_slice().iter().enumerate() {
        if *is_own && !is_lost.as_slice()[voxel] {
            others.push(voxel);
        }
    }
    let spacing = part.native.world_from_voxel.spacing_mm();
    let to_clump = nearest_seed(part.native.mask.dims(), spacing, &clump, context)?.squared;
    let to_others = nearest_seed(part.native.mask.dims(), spacing, &others, context)?.squared;
    let mut halves = [part.native.mask.clone(), part.native.mask.clone()];
    for voxel in 0..to_clump.as_slice().len() {
        let is_of_clump = to_clump.as_slice()[voxel] < to_others.as_slice()[voxel];
        halves[usize::from(!is_of_clump)].as_mut_slice()[voxel] = false;
    }
    let [of_clump, rest] = halves;
    match (part.within(&rest, context)?, part.within(&of_clump, context)?) {
        (Some(rest), Some(of_clump)) => Ok(Some([rest, of_clump])),
        _ => Ok(None),
    }
}

/// Whether it falls in two pieces when a layer of voxels is taken off.
fn may_hang(mask: &Grid<bool>, least: f64, cancel: &dyn Cancel) -> Result<bool, Cancelled> {
    let mut core = mask.clone();
    for voxel in boundary_voxels(mask, true, cancel)? {
        core.as_mut_slice()[voxel] = false;
    }
    let mut sizes = components(&core, true, Connectivity::Corners26, cancel)?.sizes;
    sizes.sort_unstable();
    Ok(sizes.len() > 1 && sizes[sizes.len() - 2] as f64 >= KEPT_OF_CLUMP * least)
}

/// The largest connected clump of some voxels.
fn largest_clump(mask: &Grid<bool>, voxels: &[usize], cancel: &dyn Cancel) -> Result<Vec<usize>, Cancelled> {
    let mut clump = marked(mask, voxels);
    let pieces = components(&clump, true, Connectivity::Corners26, cancel)?;
    pieces.set_all_but(pieces.largest().as_slice(), &mut clump, false);
    Ok(voxels.iter().copied().filter(|voxel| clump.as_slice()[*voxel]).collect())
}

/// A grid as large as the mask with these voxels set.
fn marked(mask: &Grid<bool>, voxels: &[usize]) -> Grid<bool> {
    let mut marked = Grid::filled(mask.dims(), false);
    for &voxel in voxels {
        marked.as_mut_slice()[voxel] = true;
    }
    marked
}
