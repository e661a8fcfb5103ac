//! The isotropic grid that a structure is worked on.

use nalgebra::{Matrix3, Point3, Vector3};

use crate::cancel::{Cancel, Cancelled};
use crate::model::Refusal;
use crate::numerics::field::floor_index;
use crate::pipeline::solid::NativeMask;
use crate::space::{Grid, WorldFromVoxel, rounded_up};

/// Free voxels around the solid in the working grid: room for smoothing, which reaches 3 voxels, and for steps
/// outside. With less the boundary would feel the edge of the grid; each more costs a layer of voxels on every side.
const PADDING: usize = 4;
/// Relative difference of spacings, and cosine between axes, up to which a grid counts as
/// isotropic and orthogonal: over a hundred voxels what it leaves out is half of one. Smaller, headers with rounded
/// numbers would be resampled, which blurs; larger, lengths would be wrong by as much.
const ISOTROPY_TOLERANCE: f64 = 5e-3;
/// Voxels of a working grid: a little more than 512³. The stages take 16 bytes for each, and about a
/// kilobyte for each voxel of the surface: a structure stays near 3 GB whatever `resolution_mm` asks
/// for.
const MAX_WORKING_VOXELS: u64 = 150_000_000;
/// Bytes of a run's memory for each voxel of the working grid: what the stages take for it, and as much for the rest of them.
const MEMORY_PER_VOXEL: u64 = 28;

/// Where the working grid lies.
pub(in crate::pipeline::solid) struct WorkingGrid {
    pub dims: [usize; 3],
    pub voxel_mm: f64,
    pub world_from_work: WorldFromVoxel,
    /// The same in a world whose origin is the mask's first voxel: where the object lies in the
    /// world is to change nothing, not by rounding either.
    pub centred: WorldFromVoxel,
    pub is_native: bool,
}

impl WorkingGrid {
    /// The grid of the mask itself where it is isotropic, else one that is; with room around.
    pub fn plan(native: &NativeMask, resolution_mm: Option<f64>) -> Self {
        let (world_from_crop, size) = (native.world_from_voxel, native.mask.dims());
        let spacing = world_from_crop.spacing_mm();
        let voxel_mm = resolution_mm.unwrap_or(spacing.iter().copied().fold(f64::INFINITY, f64::min));
        let axes = Matrix3::from_fn(|r, c| world_from_crop.rows()[r][c] / spacing[c]);
        if is_isotropic(&axes, spacing.map(|s| s / voxel_mm)) {
            let extra = PADDING - 1;
            let world_from_work = world_from_crop.shifted_to(Vector3::repeat(-(extra as f64)));
            let dims = size.map(|n| n + 2 * extra);
            return Self { dims, voxel_mm, world_from_work, centred: at_origin(&world_from_work).0, is_native: true };
        }
        Self::isotropic(world_from_crop, size, &axes, voxel_mm)
    }

    /// An isotropic grid along the nearest orthogonal axes, with a box around the crop.
    fn isotropic(world_from_crop: WorldFromVoxel, size: [usize; 3], axes: &Matrix3<f64>, voxel_mm: f64) -> Self {
        let frame = nearest_rotation(axes);
        let (centred_crop, to_world) = at_origin(&world_from_crop);
        let (low, high) = extent(&centred_crop, size, &frame, voxel_mm);
        let room = PADDING - 1;
        let dims = [0, 1, 2].map(|a| whole_voxels(high[a] - low[a]) + 2 * room);
        let origin = frame * (low - Vector3::repeat(room as f64)) * voxel_mm;
        let axes_mm = frame * voxel_mm;
        let rows = [0, 1, 2].map(|r| [axes_mm[(r, 0)], axes_mm[(r, 1)], axes_mm[(r, 2)], origin[r]]);
        let centred = WorldFromVoxel::from_rows(rows).expect("a rotation times a length spans space");
        Self { dims, voxel_mm, world_from_work: centred.translated(to_world), centred, is_native: false }
    }

    /// Refuses a grid of too many voxels for a run that may take so much memory.
    pub fn check_size(&self, memory_bytes: u64) -> Result<(), Refusal> {
        let allowed = MAX_WORKING_VOXELS.min(memory_bytes / MEMORY_PER_VOXEL);
        let voxels = self.voxels(1.0);
        if voxels <= allowed as f64 {
            return Ok(());
        }
        #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a count; what is beyond saturates")]
        Err(Refusal::TooLarge { voxels: voxels as u64, allowed, resolution_mm: self.that_fits_mm(allowed) })
    }

    /// A working voxel with which there are few enough, told with three digits.
    fn that_fits_mm(&self, allowed: u64) -> f64 {
        let mut factor = (self.voxels(1.0) / allowed as f64).cbrt();
        while self.voxels(factor) > allowed as f64 {
            factor *= 1.01;
        }
        rounded_up(factor * self.voxel_mm)
    }

    /// Voxels of a grid of the same box with voxels larger by a factor. The room around does not shrink with them.
    pub fn voxels(&self, factor: f64) -> f64 {
        let room = (2 * PADDING) as f64;
        self.dims.iter().map(|n| ((*n as f64 - room) / factor).ceil() + room).product()
    }
}

/// Whether unit axes stand at right angles, and voxels have edges of 1, as nearly as a header says it.
fn is_isotropic(axes: &Matrix3<f64>, edges: [f64; 3]) -> bool {
    for (a, edge) in edges.into_iter().enumerate() {
        let skew = axes.column(a).dot(&axes.column((a + 1) % 3)).abs();
        if skew > ISOTROPY_TOLERANCE || (edge - 1.0).abs() > ISOTROPY_TOLERANCE {
            return false;
        }
    }
    true
}

/// The orthogonal axes nearest to some (polar decomposition).
fn nearest_rotation(axes: &Matrix3<f64>) -> Matrix3<f64> {
    let svd = axes.svd(true, true);
    match (svd.u, svd.v_t) {
        (Some(u), Some(v_t)) => u * v_t,
        _ => Matrix3::identity(),
    }
}

/// Least and greatest coordinates along a frame of a box of `size` voxels, in working voxels.
fn extent(
    mm_from_crop: &WorldFromVoxel,
    size: [usize; 3],
    frame: &Matrix3<f64>,
    voxel_mm: f64,
) -> (Vector3<f64>, Vector3<f64>) {
    let mut low = Vector3::repeat(f64::INFINITY);
    let mut high = Vector3::repeat(f64::NEG_INFINITY);
    for bits in 0..8 {
        let corner = [0, 1, 2].map(|a| if bits >> a & 1 == 1 { (size[a] - 1) as f64 } else { 0.0 });
        let local = frame.transpose() * mm_from_crop.point(Point3::from(corner)).coords / voxel_mm;
        low = low.inf(&local);
        high = high.sup(&local);
    }
    (low, high)
}

/// Voxels that cover a length, one on both of its ends. A whole number is not to become one more by rounding, which
/// makes less than a millionth.
fn whole_voxels(extent: f64) -> usize {
    floor_index((extent - 1e-6).ceil()) + 1
}

/// The same voxels with the first one at the world's origin, and the way back.
pub(in crate::pipeline::solid) fn at_origin(world_from_voxel: &WorldFromVoxel) -> (WorldFromVoxel, Vector3<f64>) {
    let origin = world_from_voxel.point(Point3::origin()).coords;
    (world_from_voxel.translated(-origin), origin)
}

/// The mask with more room around it, and the same as numbers.
pub(in crate::pipeline::solid) fn embed(
    native: &Grid<bool>,
    plan: &WorkingGrid,
    cancel: &dyn Cancel,
) -> Result<(Grid<bool>, Grid<f32>), Cancelled> {
    let mut mask = Grid::filled(plan.dims, false);
    let [nx, ny, nz] = native.dims();
    let shift = PADDING - 1;
    for k in 0..nz {
        cancel.check()?;
        for j in 0..ny {
            let (from, to) = (native.offset([0, j, k]), mask.offset([shift, j + shift, k + shift]));
            mask.as_mut_slice()[to..to + nx].copy_from_slice(&native.as_slice()[from..from + nx]);
        }
    }
    let soft = mask.try_map(|m| f32::from(u8::from(*m)), cancel)?;
    Ok((mask, soft))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_working_voxel_of_the_hint_fits() {
        let world_from_voxel = WorldFromVoxel::axis_aligned([0.7, 0.9, 3.1], [0.0; 3]).unwrap();
        for dims in [[90, 60, 20], [400, 3, 3], [30, 30, 30]] {
            let native = NativeMask { mask: Grid::filled(dims, false), world_from_voxel, file_axes: [0, 1, 2] };
            for memory_bytes in [u64::MAX, 1 << 30] {
                let too_large = WorkingGrid::plan(&native, Some(1e-3)).check_size(memory_bytes);
                let Err(Refusal::TooLarge { resolution_mm, .. }) = too_large else { panic!("{dims:?}: {too_large:?}") };
                let of = |voxel_mm| WorkingGrid::plan(&native, Some(voxel_mm)).check_size(memory_bytes);
                assert_eq!(of(resolution_mm), Ok(()), "{dims:?}");
                assert!(of(0.9 * resolution_mm).is_err(), "{dims:?}");
            }
        }
    }
}
