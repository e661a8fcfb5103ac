//! The isotropic grid that a structure is worked on.

use nalgebra::{Matrix3, Point3, Vector3};

use super::NativeMask;
use crate::cancel::{Cancel, Cancelled};
use crate::model::Refusal;
use crate::numerics::field::floor_index;
use crate::space::{Grid, WorldFromVoxel};

/// Free voxels around the solid in the working grid: room for smoothing and for steps outside.
const PADDING: usize = 4;
/// Relative difference of spacings, and cosine between axes, up to which a grid counts as
/// isotropic and orthogonal.
const ISOTROPY_TOLERANCE: f64 = 5e-3;
/// Voxels of a working grid: a little more than 512³. The stages take 16 bytes for each, and about a
/// kilobyte for each voxel of the surface: a structure stays near 3 GB whatever `resolution_mm` asks
/// for.
const MAX_WORKING_VOXELS: u64 = 150_000_000;

/// Where the working grid lies.
pub(super) struct WorkingGrid {
    pub dims: [usize; 3],
    pub voxel_mm: f64,
    pub world_from_work: WorldFromVoxel,
    /// The same in a world whose origin is the mask's first voxel: where the object lies in the
    /// world is to change nothing, not by rounding either.
    pub centred: WorldFromVoxel,
    pub is_native: bool,
}

impl WorkingGrid {
    pub fn plan(native: &NativeMask, resolution_mm: Option<f64>) -> Self {
        let (world_from_crop, size) = (native.world_from_voxel, native.mask.dims());
        let spacing = world_from_crop.spacing_mm();
        let voxel_mm = resolution_mm.unwrap_or(spacing.iter().copied().fold(f64::INFINITY, f64::min));
        let axes = Matrix3::from_fn(|r, c| world_from_crop.rows()[r][c] / spacing[c]);
        let skew = (0..3).map(|a| axes.column(a).dot(&axes.column((a + 1) % 3)).abs()).fold(0.0, f64::max);
        let uneven = spacing.iter().map(|s| (s / voxel_mm - 1.0).abs()).fold(0.0, f64::max);
        if skew <= ISOTROPY_TOLERANCE && uneven <= ISOTROPY_TOLERANCE {
            let extra = PADDING - 1;
            let world_from_work = world_from_crop.shifted_to(Vector3::repeat(-(extra as f64)));
            let dims = size.map(|n| n + 2 * extra);
            return Self { dims, voxel_mm, world_from_work, centred: at_origin(&world_from_work).0, is_native: true };
        }
        Self::isotropic(world_from_crop, size, &axes, voxel_mm)
    }

    /// An isotropic grid along the nearest orthogonal axes, with a box around the crop.
    fn isotropic(world_from_crop: WorldFromVoxel, size: [usize; 3], axes: &Matrix3<f64>, voxel_mm: f64) -> Self {
        let svd = axes.svd(true, true);
        let frame = match (svd.u, svd.v_t) {
            (Some(u), Some(v_t)) => u * v_t,
            _ => Matrix3::identity(),
        };
        let (centred_crop, to_world) = at_origin(&world_from_crop);
        let mut low = Vector3::repeat(f64::INFINITY);
        let mut high = Vector3::repeat(f64::NEG_INFINITY);
        for bits in 0..8 {
            let corner =
                Point3::from(Vector3::from_fn(|a, _| if bits >> a & 1 == 1 { (size[a] - 1) as f64 } else { 0.0 }));
            let local = frame.transpose() * centred_crop.point(corner).coords / voxel_mm;
            low = low.inf(&local);
            high = high.sup(&local);
        }
        // A whole number of voxels is not to become one more by rounding.
        let voxels = |extent: f64| floor_index((extent - 1e-6).ceil()) + 1;
        let dims = std::array::from_fn(|a| voxels(high[a] - low[a]) + 2 * (PADDING - 1));
        let origin = frame * (low - Vector3::repeat((PADDING - 1) as f64)) * voxel_mm;
        let rows =
            std::array::from_fn(|r| std::array::from_fn(|c| if c < 3 { frame[(r, c)] * voxel_mm } else { origin[r] }));
        let centred = WorldFromVoxel::from_rows(rows).expect("a rotation times a length spans space");
        Self { dims, voxel_mm, world_from_work: centred.translated(to_world), centred, is_native: false }
    }

    pub fn check_size(&self) -> Result<(), Refusal> {
        let voxels = self.dims.iter().map(|&n| n as u64).fold(1u64, u64::saturating_mul);
        if voxels <= MAX_WORKING_VOXELS {
            return Ok(());
        }
        let resolution_mm = self.voxel_mm * (voxels as f64 / MAX_WORKING_VOXELS as f64).cbrt();
        Err(Refusal::TooLarge { voxels, allowed: MAX_WORKING_VOXELS, resolution_mm })
    }
}

/// The same voxels with the first one at the world's origin, and the way back.
pub(super) fn at_origin(world_from_voxel: &WorldFromVoxel) -> (WorldFromVoxel, Vector3<f64>) {
    let origin = world_from_voxel.point(Point3::origin()).coords;
    (world_from_voxel.translated(-origin), origin)
}

/// The mask with more room around it, and the same as numbers.
pub(super) fn embed(
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
