//! A portion of a solid as a solid by itself, on the same grid.

use super::clean::{Piece, keep_one_piece};
use super::depth::{Depth, depth};
use super::level::Level;
use super::{BOUNDARY_SIGMA, NativeMask, Solid, tunnels};
use crate::cancel::{Cancel, Cancelled};
use crate::numerics::field::centre;
use crate::numerics::smooth::gaussian;
use crate::numerics::topology::euler_number;
use crate::pipeline::context::Context;
use crate::space::Grid;

impl Solid {
    /// The marked voxels of the solid as a solid: its skin is that of the whole where they reach it, and a smooth cut
    /// elsewhere. In working voxels, with the depth below it; `None` when nothing is left.
    ///
    /// # Errors
    /// When it is cancelled.
    pub(in crate::pipeline) fn portion(
        &self,
        marked: &Grid<bool>,
        context: &Context<'_>,
    ) -> Result<Option<(Self, Depth)>, Cancelled> {
        // The marked share of what is inside, so that the cut is not drawn in where it meets the skin.
        let sigma = [BOUNDARY_SIGMA * self.voxels_per_grain; 3];
        let mut level = marked.try_map(|is_marked| if *is_marked { 1.0f32 } else { 0.0 }, context)?;
        let mut around = self.inside.try_map(|is_inside| if *is_inside { 1.0f32 } else { 0.0 }, context)?;
        gaussian(&mut level, sigma, context)?;
        gaussian(&mut around, sigma, context)?;
        let of_whole = self.level.field.0.as_slice();
        for (voxel, value) in level.as_mut_slice().iter_mut().enumerate() {
            let share = *value / around.as_slice()[voxel].max(f32::MIN_POSITIVE);
            *value = (share - 0.5).min(of_whole[voxel]);
        }
        let Piece { inside, lumens } = keep_one_piece(&mut level, self.lumens, context)?;
        if !inside.as_slice().contains(&true) {
            return Ok(None);
        }
        let native = self.native_portion(&inside, context)?;
        if !native.mask.as_slice().contains(&true) {
            return Ok(None);
        }
        let portion = Self {
            tunnels: tunnels(lumens, euler_number(&inside, context)?),
            lumens,
            inside,
            level: Level::new(level),
            world_from_work: self.world_from_work.enlarged([1.0 / self.voxels_per_grain; 3]),
            unit_mm: self.working_voxel_mm,
            native,
            ..*self
        };
        let depth = depth(&portion, context)?;
        Ok(Some((portion, depth)))
    }

    /// The voxels of the mask whose centres lie in voxels that are `inside`.
    fn native_portion(&self, inside: &Grid<bool>, cancel: &dyn Cancel) -> Result<NativeMask, Cancelled> {
        let from_native = self.native.world_from_voxel.to(&self.world_from_work);
        let dims = inside.dims();
        let mut mask = self.native.mask.try_map(|is_in| *is_in, cancel)?;
        for voxel in 0..mask.as_slice().len() {
            if mask.as_slice()[voxel] {
                let at = from_native.point(centre(mask.index(voxel))) * self.voxels_per_grain;
                let nearest = [0, 1, 2].map(|axis| crate::numerics::field::floor_index((at[axis] + 0.5).max(0.0)));
                mask.as_mut_slice()[voxel] = (0..3).all(|axis| nearest[axis] < dims[axis]) && inside[nearest];
            }
        }
        Ok(NativeMask { mask, ..self.native })
    }
}
