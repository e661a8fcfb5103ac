//! A solid with its boundary moved inside what the voxels leave open: one repeat of the uncertainty.
//!
//! A mask says of every voxel centre whether it is inside. A smooth boundary may lie anywhere that
//! keeps all centres on their sides. Where a face runs along the grid that is half a voxel to
//! either side, the same for the whole face; where it runs oblique, some centre nearby is always
//! close to it and little is left.
//!
//! 1. the *slack* of a place is half the gap between the outermost inside centre and the innermost
//!    outside centre near it, both measured from the boundary;
//! 2. the boundary is moved along its normal by a smooth random field times the slack, and by a
//!    small amount everywhere for what the smoothing of the mask leaves of the staircase.

use crate::cancel::{Cancel, Cancelled};
use crate::numerics::field::{centre, floor_index};
use crate::numerics::smooth::gaussian;
use crate::space::Grid;

use super::clean::keep_one_piece;
use super::level::Level;
use super::senses::Senses;
use super::{SLICE, Solid};

/// How far voxel centres hold the boundary, native voxels. A face that leans by one voxel in twice
/// this is held; a larger reach needs faces flatter than organs have.
const HELD_WITHIN: f64 = 3.0;
/// Standard deviation of the movement, as a share of the slack. A uniform error has 0.58; the rest
/// is what fitting nodes over several points of the moved boundary takes away.
const SLACK_SHARE: f64 = 0.9;
/// Standard deviation of the movement that is always there, voxels: what smoothing leaves of the staircase. Without
/// it a face whose voxel centres leave no slack would not move at all, and its nodes would count as certain.
const STAIRCASE: f64 = 0.08;
/// Standard deviation of the Gaussian that makes noise smooth, native voxels. Shorter, the fits
/// of the lattice average it away; longer, both sides of a thin sheet move as one.
const NOISE_SIGMA: f64 = 2.0;
/// Start of every random sequence. Any other is as good: it says which results a repeat of the same number gives.
const SEED: u64 = 0x6d65_6469_616c_7265;

/// The solid of one repeat, `number` from 1. The same number gives the same solid, whatever thread
/// it is made on.
///
/// # Errors
/// When it is cancelled.
pub(super) fn perturbed(solid: Solid, number: u64, cancel: &dyn Cancel) -> Result<Solid, Cancelled> {
    let native = solid.native.world_from_voxel.spacing_mm().map(|s| s / solid.working_voxel_mm);
    let slack = slack(&solid, native, cancel)?;
    let noise = noise(solid.level.field.0.dims(), native, number, cancel)?;
    let mut level = moved(&solid.level.field.0, &noise, &slack, cancel)?;
    let inside = keep_one_piece(&mut level, solid.lumens, cancel)?.inside;
    let senses = Senses::of(&inside, &solid.world_from_work, cancel)?;
    Ok(Solid { inside, level: Level::new(level), senses, ..solid })
}

/// The level with its zero moved by the noise times the slack.
fn moved(old: &Grid<f32>, noise: &Grid<f32>, slack: &Grid<f32>, cancel: &dyn Cancel) -> Result<Grid<f32>, Cancelled> {
    let [nx, ny, nz] = old.dims();
    let mut level = old.clone();
    for offset in 0..old.as_slice().len() {
        if offset.is_multiple_of(SLICE) {
            cancel.check()?;
        }
        let [i, j, k] = old.index(offset);
        if [i, j, k].contains(&0) || i + 1 == nx || j + 1 == ny || k + 1 == nz {
            continue;
        }
        let move_by = f64::from(noise.as_slice()[offset]) * f64::from(slack.as_slice()[offset]);
        #[expect(clippy::cast_possible_truncation, reason = "the grid is f32")]
        let change = (move_by * steepness(old, offset)) as f32;
        level.as_mut_slice()[offset] += change;
    }
    Ok(level)
}

/// Length of the gradient at an inner voxel, by central differences.
fn steepness(level: &Grid<f32>, offset: usize) -> f64 {
    let [nx, ny, _] = level.dims();
    let values = level.as_slice();
    let mut square = 0.0;
    for stride in [1, nx, nx * ny] {
        square += (f64::from(values[offset + stride] - values[offset - stride]) / 2.0).powi(2);
    }
    square.sqrt()
}

/// Standard deviation of the boundary's place near every voxel, working voxels.
fn slack(solid: &Solid, native: [f64; 3], cancel: &dyn Cancel) -> Result<Grid<f32>, Cancelled> {
    let [mut outer, mut inner] = gaps(solid, native, cancel)?;
    for (axis, spacing) in native.into_iter().enumerate() {
        let reach = floor_index((HELD_WITHIN * spacing).ceil());
        least_along(&mut outer, axis, reach, cancel)?;
        least_along(&mut inner, axis, reach, cancel)?;
    }
    for (outer, inner) in outer.as_mut_slice().chunks_mut(SLICE).zip(inner.as_slice().chunks(SLICE)) {
        cancel.check()?;
        for (o, i) in outer.iter_mut().zip(inner) {
            let open = SLACK_SHARE * f64::from(*o + *i) / 2.0;
            #[expect(clippy::cast_possible_truncation, reason = "the grid is f32")]
            let sd = open.hypot(STAIRCASE) as f32;
            *o = sd;
        }
    }
    Ok(outer)
}

/// Distance from the boundary of the outside and of the inside voxel centres in every working voxel, half a native
/// voxel where there are none.
fn gaps(solid: &Solid, native: [f64; 3], cancel: &dyn Cancel) -> Result<[Grid<f32>; 2], Cancelled> {
    let dims = solid.level.field.0.dims();
    #[expect(clippy::cast_possible_truncation, reason = "the grid is f32")]
    let most = (native.into_iter().fold(0.0, f64::max) / 2.0) as f32;
    let mut gaps = [Grid::try_filled(dims, most, cancel)?, Grid::try_filled(dims, most, cancel)?];
    let voxels = &solid.native;
    for (offset, &is_inside) in voxels.mask.as_slice().iter().enumerate() {
        if offset.is_multiple_of(SLICE) {
            cancel.check()?;
        }
        let centre = centre(voxels.mask.index(offset));
        let at = solid.world_from_work.voxel(voxels.world_from_voxel.point(centre));
        let cell = [0, 1, 2].map(|a| floor_index(at[a] + 0.5).min(dims[a] - 1));
        let level = solid.level.at(at);
        let steep = solid.level.gradient(at).norm();
        #[expect(clippy::cast_possible_truncation, reason = "the grid is f32")]
        let depth = (if is_inside { level } else { -level } / steep.max(1e-6)).clamp(0.0, f64::from(most)) as f32;
        let gap = &mut gaps[usize::from(is_inside)][cell];
        *gap = gap.min(depth);
    }
    Ok(gaps)
}

/// Every value becomes the least within `reach` voxels along an axis.
fn least_along(grid: &mut Grid<f32>, axis: usize, reach: usize, cancel: &dyn Cancel) -> Result<(), Cancelled> {
    let dims = grid.dims();
    let stride: usize = dims[..axis].iter().product();
    let old = grid.clone();
    for (offset, least) in grid.as_mut_slice().iter_mut().enumerate() {
        if offset.is_multiple_of(SLICE) {
            cancel.check()?;
        }
        let x = old.index(offset)[axis];
        let (back, ahead) = (x.min(reach), (dims[axis] - 1 - x).min(reach));
        let start = offset - back * stride;
        for n in 0..=back + ahead {
            *least = least.min(old.as_slice()[start + n * stride]);
        }
    }
    Ok(())
}

/// Smooth noise of mean 0 and standard deviation 1.
fn noise(dims: [usize; 3], native: [f64; 3], number: u64, cancel: &dyn Cancel) -> Result<Grid<f32>, Cancelled> {
    let [nx, ny, _] = dims;
    let mut noise = Grid::try_of(dims, |[i, j, k]| white(number, (i + nx * (j + ny * k)) as u64), cancel)?;
    gaussian(&mut noise, native.map(|spacing| NOISE_SIGMA * spacing), cancel)?;
    let mut square = 0.0;
    for slice in noise.as_slice().chunks(SLICE) {
        cancel.check()?;
        for x in slice {
            square += f64::from(*x).powi(2);
        }
    }
    #[expect(clippy::cast_possible_truncation, reason = "the grid is f32")]
    let scale = (1.0 / (square / noise.as_slice().len() as f64).sqrt().max(1e-12)) as f32;
    for slice in noise.as_mut_slice().chunks_mut(SLICE) {
        cancel.check()?;
        for x in slice {
            *x *= scale;
        }
    }
    Ok(noise)
}

/// A number between −0.5 and 0.5 that depends on its two counters only (SplitMix64; Steele, Lea,
/// Flood, OOPSLA 2014, as a hash).
fn white(number: u64, voxel: u64) -> f32 {
    /// 2⁶⁴ divided by the golden ratio: its multiples lie evenly in 64 bits.
    const GOLDEN: u64 = 0x9e37_79b9_7f4a_7c15;
    let start = mixed(SEED.wrapping_add(number.wrapping_mul(GOLDEN)));
    let bits = mixed(start.wrapping_add(voxel.wrapping_add(1).wrapping_mul(GOLDEN)));
    #[expect(clippy::cast_possible_truncation, reason = "24 bits fill an f32")]
    let share = ((bits >> 40) as f64 / f64::from(1u32 << 24)) as f32;
    share - 0.5
}

/// The bits of a number mixed so that each depends on all.
fn mixed(mut x: u64) -> u64 {
    x = (x ^ (x >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    x = (x ^ (x >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    x ^ (x >> 31)
}
