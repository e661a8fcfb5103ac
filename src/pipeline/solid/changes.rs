//! What a solid has lost of the label's part that it stands for, and what it has gained beside it.
//!
//! Smoothing takes corners off and fills creases: voxels next to the boundary change sides on every shape, and that is
//! the boundary's own uncertainty. What is further from it than a voxel is no rounding: a fin that vanished, a part that
//! hung on by a corner, a gap or a tunnel that closed. Both are looked at in the same way, with inside and outside
//! exchanged.

use nalgebra::Point3;

use super::clean::NOISE_VOXELS;
use super::{NativeMask, Solid};
use crate::cancel::{Cancel, Cancelled};
use crate::numerics::components::{Connectivity, components};
use crate::numerics::field::centre;
use crate::numerics::parallel::each_number;
use crate::numerics::topology::beside;
use crate::pipeline::context::Context;
use crate::space::{Grid, VoxelFromVoxel, WorldPoint};

/// Rows that one thread takes at a time; fewer are not worth handing over.
const ROWS_PER_TASK: usize = 16;
/// How far from the boundary voxels may change sides by its smoothing alone, voxels of the mask. With 0, every corner of
/// a slab would be a loss; with 2, gaps of up to three voxels could close unseen.
const REACH: usize = 1;
/// Share of the part above which a lost clump is no noise, however few its voxels are: of a part of a few hundred voxels,
/// 27 are a tenth. Smaller, the tips of an organ a few voxels thick would be losses.
const NOISE_SHARE: f64 = 0.01;
/// The level of the boundary, but for rounding: it is to decide nothing, and f32 rounds by 6e-8.
const ON_BOUNDARY: f64 = 1e-6;

/// What became of the voxels of a part.
#[derive(Clone, Debug, Default)]
pub struct Changes {
    /// Voxels in cavities that were filled.
    pub filled: Place,
    /// Voxels that are not in the solid, nor next to it.
    pub lost: Place,
    /// How many of these are in clumps too large for noise: a fin, not the tip of an organ.
    pub thin: usize,
    /// Voxels of the solid that are neither of the part nor next to its outside.
    pub closed: Place,
    /// The surface that the part has and the solid has not.
    pub surface: Vec<WorldPoint>,
}

/// The voxels of a solid's mask that are not in it, nor next to it, ascending.
///
/// # Errors
/// When it is cancelled.
pub(super) fn lost_voxels(solid: &Solid, cancel: &dyn Cancel) -> Result<Vec<usize>, Cancelled> {
    let mut lost = Vec::new();
    for row in Search::of(solid).everywhere(cancel)? {
        lost.extend(row.lost);
    }
    Ok(lost)
}

/// Some voxels, and where one of them lies.
#[derive(Clone, Copy, Debug, Default)]
pub struct Place {
    /// How many.
    pub voxels: usize,
    /// The middle one in their order.
    pub at: Option<WorldPoint>,
}

impl Changes {
    /// Those from `sent`, a part as it was sent, to its solid. What was lost or closed is told as a warning.
    ///
    /// # Errors
    /// When it is cancelled.
    pub fn of(sent: &NativeMask, solid: &Solid, context: &Context<'_>) -> Result<Self, Cancelled> {
        let found = Search::of(solid).everywhere(context)?;
        let (mut lost, mut closed, mut filled) = (Vec::new(), Vec::new(), Vec::new());
        for row in found {
            lost.extend(row.lost);
            closed.extend(row.closed);
        }
        for (voxel, is_in) in solid.native.mask.as_slice().iter().enumerate() {
            if *is_in && !sent.mask.as_slice()[voxel] {
                filled.push(voxel);
            }
        }
        let mut surface = next_to(&sent.mask, false, &lost);
        surface.extend(next_to(&sent.mask, true, &closed));
        surface.extend(next_to(&sent.mask, true, &filled));
        let changes = Self {
            filled: Place::of(sent, &filled),
            thin: in_clumps(&sent.mask, &lost, context)?,
            lost: Place::of(sent, &lost),
            closed: Place::of(sent, &closed),
            surface: sent.places(&surface),
        };
        changes.warn(context);
        Ok(changes)
    }

    fn warn(&self, context: &Context<'_>) {
        if let Place { voxels, at: Some(at) } = self.lost {
            let message = format!(
                "{voxels} voxels that are too thin for the grid, or hang on by a corner, were left out; one is at {}",
                in_words(at)
            );
            context.warn("thin_voxels_lost", message);
        }
        if let Place { voxels, at: Some(at) } = self.closed {
            let message = format!(
                "gaps or tunnels of {voxels} voxels that are too narrow for the grid were closed; one is at {}",
                in_words(at)
            );
            context.warn("gaps_closed", message);
        }
    }
}

/// A place as it is told.
pub(crate) fn in_words(at: WorldPoint) -> String {
    // Adding nothing makes a negative nought positive.
    let [x, y, z] = [at.x, at.y, at.z].map(|x| (x * 10.0).round() / 10.0 + 0.0);
    format!("({x:.1}, {y:.1}, {z:.1}) mm")
}

impl Place {
    fn of(mask: &NativeMask, voxels: &[usize]) -> Self {
        let middle = voxels.get(voxels.len() / 2).map(|voxel| mask.places(&[*voxel])[0]);
        Self { voxels: voxels.len(), at: middle }
    }
}

/// How many of some voxels of a part are in clumps too large for noise.
fn in_clumps(part: &Grid<bool>, voxels: &[usize], cancel: &dyn Cancel) -> Result<usize, Cancelled> {
    if voxels.is_empty() {
        return Ok(0);
    }
    let mut those = Grid::filled(part.dims(), false);
    for &voxel in voxels {
        those.as_mut_slice()[voxel] = true;
    }
    let whole = part.as_slice().iter().filter(|is_in| **is_in).count();
    let mut count = 0;
    for size in components(&those, true, Connectivity::Corners26, cancel)?.sizes {
        let is_noise = size <= NOISE_VOXELS && size as f64 <= NOISE_SHARE * whole as f64;
        count += if is_noise { 0 } else { size };
    }
    Ok(count)
}

/// Those of some voxels, none on the grid's edge, that share a face with one that is `value`.
fn next_to(mask: &Grid<bool>, value: bool, voxels: &[usize]) -> Vec<usize> {
    let [nx, ny, _] = mask.dims();
    let touches = |voxel: &usize| beside(*voxel, nx, nx * ny).iter().any(|&other| mask.as_slice()[other] == value);
    voxels.iter().copied().filter(touches).collect()
}

/// Voxels of a row that changed sides away from the boundary.
#[derive(Default)]
struct Found {
    lost: Vec<usize>,
    closed: Vec<usize>,
}

/// A solid and the mask that it was made of.
struct Search<'a> {
    solid: &'a Solid,
    mask: &'a Grid<bool>,
    work_from_native: VoxelFromVoxel,
}

impl<'a> Search<'a> {
    fn of(solid: &'a Solid) -> Self {
        let work_from_native = solid.native.world_from_voxel.to(&solid.world_from_work);
        Self { solid, mask: &solid.native.mask, work_from_native }
    }

    fn everywhere(&self, cancel: &dyn Cancel) -> Result<Vec<Found>, Cancelled> {
        let [_, ny, nz] = self.mask.dims();
        each_number(ny * nz, ROWS_PER_TASK, |row| self.of_row(row % ny, row / ny), cancel)
    }

    fn of_row(&self, j: usize, k: usize) -> Found {
        let [nx, ny, nz] = self.mask.dims();
        let mut found = Found::default();
        if j == 0 || k == 0 || j + 1 == ny || k + 1 == nz {
            return found;
        }
        for i in 1..nx - 1 {
            let (is_in_mask, is_in_solid) = (self.mask[[i, j, k]], self.is_in_solid([i, j, k]));
            if is_in_mask && !is_in_solid && !self.has_near([i, j, k], |at| self.is_in_solid(at)) {
                found.lost.push(self.mask.offset([i, j, k]));
            }
            let is_outside = |at: [usize; 3]| !self.mask[at] && !self.is_in_solid(at);
            if is_in_solid && !is_in_mask && !self.has_near([i, j, k], is_outside) {
                found.closed.push(self.mask.offset([i, j, k]));
            }
        }
        found
    }

    fn is_in_solid(&self, at: [usize; 3]) -> bool {
        let place: Point3<f64> = self.work_from_native.point(centre(at));
        self.solid.level.at(place) > ON_BOUNDARY
    }

    /// Whether a voxel is so, or one within reach of it.
    fn has_near(&self, at: [usize; 3], is_so: impl Fn([usize; 3]) -> bool) -> bool {
        let dims = self.mask.dims();
        let low = at.map(|x| x.saturating_sub(REACH));
        let high = [0, 1, 2].map(|axis| (at[axis] + REACH).min(dims[axis] - 1));
        for k in low[2]..=high[2] {
            for j in low[1]..=high[1] {
                for i in low[0]..=high[0] {
                    if is_so([i, j, k]) {
                        return true;
                    }
                }
            }
        }
        false
    }
}
