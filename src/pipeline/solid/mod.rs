//! Stage 1: one label of the volume as a clean solid on an isotropic working grid.
//!
//! Work space is the working grid's voxel coordinates: isotropic and orthogonal, so that lengths
//! in it are millimetres divided by [`Solid::voxel_mm`]. Everything up to the lattice is
//! computed there.

pub mod depth;

pub mod perturb;

use nalgebra::{Matrix3, Point3, Vector3};
use rayon::prelude::*;

use crate::numerics::cancel::GoOn;
use crate::numerics::components::{Connectivity, boundary_voxels, components};
use crate::numerics::distance::nearest_seed;
use crate::numerics::field::{Field, floor_index};
use crate::numerics::smooth::gaussian;
use crate::numerics::topology::euler_number;
use crate::space::{Grid, LabelVolume, VoxelIndex, WorldFromVoxel};

use crate::model::Refusal;
use crate::model::Warning;
use crate::pipeline::PipelineError;
use crate::pipeline::observer::{Cancelled, Observer};

/// Free voxels around the solid in the working grid: room for smoothing and for steps outside.
const PADDING: usize = 4;
/// Standard deviation of the smoothing that turns voxels into a sub-voxel boundary, working
/// voxels. Below 0.7 the staircase stays; above 1.2 edges round off by more than a tenth.
const BOUNDARY_SIGMA: f64 = 1.0;
/// Relative difference of spacings, and cosine between axes, up to which a grid counts as
/// isotropic and orthogonal.
const ISOTROPY_TOLERANCE: f64 = 5e-3;
/// Voxels of a working grid: a little more than 512³. The stages take 16 bytes for each, and about a
/// kilobyte for each voxel of the surface: a structure stays near 3 GB whatever `resolution_mm` asks
/// for.
const MAX_WORKING_VOXELS: u64 = 150_000_000;
/// Voxels that one thread takes at a time where little is done with each.
const SLICE: usize = 1 << 16;
/// A second part of at least this share of the largest is not a stray.
const PART_SHARE: f64 = 0.1;

/// The box of a label in the volume, both corners included.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct LabelBox {
    /// Smallest indices.
    pub low: VoxelIndex,
    /// Largest indices.
    pub high: VoxelIndex,
}

impl LabelBox {
    /// Voxels in the box.
    #[must_use]
    pub fn voxels(&self) -> u64 {
        (0..3).map(|a| (self.high[a] - self.low[a] + 1) as u64).product()
    }
}

/// A label as a solid.
#[derive(Clone, Debug)]
pub struct Solid {
    /// Inside of the sub-voxel boundary: one 26-component without cavities.
    pub inside: Grid<bool>,
    /// The mask itself on the working grid, for the quality measures.
    pub mask: Grid<bool>,
    /// Positive inside, 0 on the sub-voxel boundary, without a unit.
    pub level: Field,
    /// World position of work space.
    pub world_from_work: WorldFromVoxel,
    /// Edge of a working voxel, mm.
    pub voxel_mm: f64,
    /// The mask on its own voxels, before any resampling.
    pub native: NativeMask,
}

/// A label as it was cut out of the volume: cleaned, with one free voxel all around, its axes in
/// the order of the world.
#[derive(Clone, Debug)]
pub struct NativeMask {
    /// The voxels.
    pub mask: Grid<bool>,
    /// Where they lie.
    pub world_from_voxel: WorldFromVoxel,
}

/// Boxes of all labels in one pass, by index into the volume's `label_values`.
///
/// # Errors
/// When the observer asks to stop.
pub fn label_boxes(volume: &LabelVolume, observer: &dyn Observer) -> Result<Vec<Option<LabelBox>>, Cancelled> {
    let [nx, ny, _] = volume.indices.dims();
    let mut boxes: Vec<Option<LabelBox>> = vec![None; volume.label_values.len()];
    for (row, values) in volume.indices.as_slice().chunks_exact(nx).enumerate() {
        observer.check()?;
        let (j, k) = (row % ny, row / ny);
        let mut i = 0;
        while i < nx {
            let label = values[i];
            let run = values[i..].iter().take_while(|v| **v == label).count();
            if label != 0 {
                let (low, high) = ([i, j, k], [i + run - 1, j, k]);
                let grown = boxes[usize::from(label)].get_or_insert(LabelBox { low, high });
                for axis in 0..3 {
                    grown.low[axis] = grown.low[axis].min(low[axis]);
                    grown.high[axis] = grown.high[axis].max(high[axis]);
                }
            }
            i += run;
        }
    }
    Ok(boxes)
}

/// Cuts a label out, cleans it, and brings it to an isotropic grid with a sub-voxel boundary.
///
/// Keeps the largest 26-component and fills cavities, both with a warning. `resolution_mm` is
/// the working voxel; the finest spacing of the mask if `None`.
///
/// # Errors
/// [`Refusal::TooLarge`] when the working grid would be, [`Refusal::TooThin`] when nothing is
/// left of the object on it; when the observer asks to stop.
pub fn solid(
    volume: &LabelVolume,
    index: u16,
    bounds: LabelBox,
    resolution_mm: Option<f64>,
    warnings: &mut Vec<Warning>,
    observer: &dyn Observer,
) -> Result<Solid, PipelineError> {
    let go_on = || observer.check();
    warn_if_cut(volume, index, bounds, warnings);
    let mut native = cut_out(volume, index, bounds, &go_on)?;
    let plan = WorkingGrid::plan(&native, resolution_mm);
    plan.check_size()?;
    native.mask = clean(native.mask, warnings, &go_on)?;
    let (mask, mut soft) =
        if plan.is_native { embed(&native.mask, &plan, &go_on)? } else { resample(&native, &plan, &go_on)? };
    gaussian(&mut soft, [BOUNDARY_SIGMA; 3], &go_on)?;
    soft.as_mut_slice().par_chunks_mut(SLICE).try_for_each(|slice| {
        go_on()?;
        slice.iter_mut().for_each(|v| *v -= 0.5);
        Ok::<_, Cancelled>(())
    })?;
    let inside = keep_one_piece(&mut soft, &go_on)?;
    if !inside.as_slice().contains(&true) {
        return Err(too_thin(&mask, plan.voxel_mm, &go_on)?.into());
    }
    // One piece without cavities has one tunnel for each that its Euler number is below 1.
    let closed = euler_number(&inside, &go_on)? - euler_number(&mask, &go_on)?;
    if closed > 0 {
        let message = format!("tunnels of the mask that are too narrow for the grid were closed: {closed}");
        warnings.push(Warning { code: "tunnels_closed", message });
    }
    let WorkingGrid { world_from_work, voxel_mm, .. } = plan;
    Ok(Solid { inside, mask, level: Field(soft), world_from_work, voxel_mm, native })
}

fn too_thin(mask: &Grid<bool>, voxel_mm: f64, go_on: &GoOn<'_>) -> Result<Refusal, Cancelled> {
    let outward = nearest_seed(mask.dims(), [1.0; 3], &boundary_voxels(mask, false, go_on)?, go_on)?.squared;
    let depths = outward.as_slice().iter().zip(mask.as_slice()).filter(|(_, is_inside)| **is_inside);
    let deepest = depths.fold(0.0f32, |a, (b, _)| a.max(*b)).sqrt();
    let voxels = 2.0 * f64::from(deepest) - 1.0;
    let (thickness_mm, resolution_mm) = (voxels * voxel_mm, voxel_mm * voxels / 4.0);
    Ok(Refusal::TooThin { thickness_mm, voxels, voxel_mm, resolution_mm })
}

fn warn_if_cut(volume: &LabelVolume, index: u16, bounds: LabelBox, warnings: &mut Vec<Warning>) {
    let dims = volume.indices.dims();
    let touched = (0..3).filter(|&a| bounds.low[a] == 0 || bounds.high[a] + 1 == dims[a]);
    let mut cut = 0;
    for axis in touched {
        let (p, q) = ((axis + 1) % 3, (axis + 2) % 3);
        for face in if dims[axis] == 1 { vec![0] } else { vec![0, dims[axis] - 1] } {
            for x in 0..dims[p] {
                for y in 0..dims[q] {
                    let mut at = [0; 3];
                    (at[axis], at[p], at[q]) = (face, x, y);
                    cut += usize::from(volume.indices[at] == index);
                }
            }
        }
    }
    if cut > 0 {
        let message =
            format!("the object touches the edge of the image with {cut} voxels: what lies beyond is missing");
        warnings.push(Warning { code: "cut_by_image", message });
    }
}

/// A label's box with one free voxel all around, its axes permuted and reversed so that they run
/// towards right, anterior and superior as nearly as they can. What follows breaks ties by the order
/// of voxels: this makes it the world's order, not that of the file.
fn cut_out(volume: &LabelVolume, index: u16, bounds: LabelBox, go_on: &GoOn<'_>) -> Result<NativeMask, Cancelled> {
    let first = Vector3::from_fn(|a, _| bounds.low[a] as f64 - 1.0);
    let world_from_crop = volume.world_from_voxel.shifted_to(first);
    let axes = nearest_axes(&world_from_crop);
    let size: [usize; 3] = std::array::from_fn(|a| bounds.high[a] - bounds.low[a] + 3);
    let dims = axes.map(|(axis, _)| size[axis]);
    let mut mask = Grid::filled(dims, false);
    let [width, height, _] = dims;
    // The voxel of the volume at a place of the mask that is not on its edge.
    let source = |at: [usize; 3]| {
        let mut from = [0; 3];
        for ((axis, is_reversed), x) in axes.into_iter().zip(at) {
            from[axis] = bounds.low[axis] + if is_reversed { size[axis] - 2 - x } else { x - 1 };
        }
        volume.indices.offset(from)
    };
    let inner = |n: usize, length: usize| n > 0 && n + 1 < length;
    mask.as_mut_slice().par_chunks_mut(width).enumerate().with_min_len(64).try_for_each(|(row, out)| {
        go_on()?;
        let (j, k) = (row % height, row / height);
        if !inner(j, height) || !inner(k, dims[2]) {
            return Ok(());
        }
        let (from, to) = (source([1, j, k]), source([width - 2, j, k]));
        let step = from.abs_diff(to) / (width - 3).max(1);
        for (n, cell) in out[1..width - 1].iter_mut().enumerate() {
            let offset = if from <= to { from + n * step } else { from - n * step };
            *cell = volume.indices.as_slice()[offset] == index;
        }
        Ok(())
    })?;
    Ok(NativeMask { mask, world_from_voxel: permuted(&world_from_crop, axes, size) })
}

/// The map of voxels whose axes were permuted and reversed.
fn permuted(world_from_voxel: &WorldFromVoxel, axes: [(usize, bool); 3], size: [usize; 3]) -> WorldFromVoxel {
    let rows = world_from_voxel.rows();
    let rows = std::array::from_fn(|r| {
        let column = |(axis, is_reversed): (usize, bool)| if is_reversed { -rows[r][axis] } else { rows[r][axis] };
        let start = |(axis, is_reversed): (usize, bool)| if is_reversed { (size[axis] - 1) as f64 } else { 0.0 };
        let origin = axes.iter().fold(rows[r][3], |sum, &a| sum + rows[r][a.0] * start(a));
        [column(axes[0]), column(axes[1]), column(axes[2]), origin]
    });
    WorldFromVoxel::from_rows(rows).expect("permuted and reversed axes still span space")
}

/// For each axis of the world the voxel axis that follows it, and whether that one runs against it.
/// Of all pairings the one with the greatest sum of cosines; of equals (voxels turned by 45°) the
/// one whose axes come first, by their own directions.
fn nearest_axes(world_from_voxel: &WorldFromVoxel) -> [(usize, bool); 3] {
    /// Difference of two sums of cosines that rounding can make.
    const TIE: f64 = 1e-6;
    const ORDERS: [[usize; 3]; 6] = [[0, 1, 2], [0, 2, 1], [1, 0, 2], [1, 2, 0], [2, 0, 1], [2, 1, 0]];
    let (rows, spacing) = (world_from_voxel.rows(), world_from_voxel.spacing_mm());
    let cosine = |r: usize, axis: usize| rows[r][axis] / spacing[axis];
    let directed = |r: usize, axis: usize| {
        let sign = if cosine(r, axis) < 0.0 { -1.0 } else { 1.0 };
        [0, 1, 2].map(|x| sign * cosine(x, axis))
    };
    let score = |order: &[usize; 3]| order.iter().enumerate().map(|(r, &axis)| cosine(r, axis).abs()).sum::<f64>();
    let best = ORDERS.iter().map(score).fold(0.0, f64::max);
    let is_before = |a: &[usize; 3], b: &[usize; 3]| {
        let entries = |order: &[usize; 3]| [0, 1, 2].map(|r| directed(r, order[r])).concat();
        let differing = entries(a).into_iter().zip(entries(b)).find(|(x, y)| (x - y).abs() > TIE);
        differing.is_some_and(|(x, y)| x > y)
    };
    let equals = ORDERS.iter().filter(|order| score(order) > best - TIE);
    let order = equals.fold(None, |kept: Option<&[usize; 3]>, next| match kept {
        Some(kept) if !is_before(next, kept) => Some(kept),
        _ => Some(next),
    });
    let order = order.unwrap_or(&ORDERS[0]);
    [0, 1, 2].map(|r| (order[r], cosine(r, order[r]) < 0.0))
}

/// The largest part without cavities.
fn clean(mut mask: Grid<bool>, warnings: &mut Vec<Warning>, go_on: &GoOn<'_>) -> Result<Grid<bool>, Cancelled> {
    let parts = components(&mask, true, Connectivity::Corners26, go_on)?;
    let size = parts.sizes.iter().max().copied().unwrap_or(0);
    let dropped = parts.set_all_but(parts.largest(), &mut mask, false);
    if dropped > 0 {
        let big = parts.sizes.iter().filter(|s| **s as f64 >= PART_SHARE * size as f64).count();
        let code = if big > 1 { "several_parts" } else { "stray_voxels_dropped" };
        let message = format!("kept the largest of {} parts; {dropped} voxels were dropped", parts.sizes.len());
        warnings.push(Warning { code, message });
    }
    let filled = fill_cavities(&mut mask, go_on)?;
    if filled > 0 {
        let message = format!("filled cavities of {filled} voxels");
        warnings.push(Warning { code: "cavities_filled", message });
    }
    Ok(mask)
}

/// Fills background that is not joined by faces to the grid's first voxel, which is free.
fn fill_cavities(mask: &mut Grid<bool>, go_on: &GoOn<'_>) -> Result<usize, Cancelled> {
    let background = components(mask, false, Connectivity::Faces6, go_on)?;
    Ok(background.set_all_but(background.of_first_voxel(), mask, true))
}

/// The inside of the smoothed boundary, reduced to its largest part without cavities. The level
/// is changed to agree.
pub(super) fn keep_one_piece(level: &mut Grid<f32>, go_on: &GoOn<'_>) -> Result<Grid<bool>, Cancelled> {
    /// Level given to voxels that change sides: what half a voxel of depth has.
    const DECIDED: f32 = 0.2;
    let mut inside = level.try_map(|v| *v > 0.0, go_on)?;
    let parts = components(&inside, true, Connectivity::Corners26, go_on)?;
    let dropped = parts.set_all_but(parts.largest(), &mut inside, false);
    if dropped + fill_cavities(&mut inside, go_on)? > 0 {
        for (level, inside) in level.as_mut_slice().chunks_mut(SLICE).zip(inside.as_slice().chunks(SLICE)) {
            go_on()?;
            for (v, m) in level.iter_mut().zip(inside) {
                if *m != (*v > 0.0) {
                    *v = if *m { DECIDED } else { -DECIDED };
                }
            }
        }
    }
    Ok(inside)
}

/// Where the working grid lies.
struct WorkingGrid {
    dims: [usize; 3],
    voxel_mm: f64,
    world_from_work: WorldFromVoxel,
    /// The same in a world whose origin is the mask's first voxel: where the object lies in the
    /// world is to change nothing, not by rounding either.
    centred: WorldFromVoxel,
    is_native: bool,
}

impl WorkingGrid {
    fn plan(native: &NativeMask, resolution_mm: Option<f64>) -> Self {
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

    fn check_size(&self) -> Result<(), Refusal> {
        let voxels = self.dims.iter().map(|&n| n as u64).fold(1u64, u64::saturating_mul);
        if voxels <= MAX_WORKING_VOXELS {
            return Ok(());
        }
        let resolution_mm = self.voxel_mm * (voxels as f64 / MAX_WORKING_VOXELS as f64).cbrt();
        Err(Refusal::TooLarge { voxels, allowed: MAX_WORKING_VOXELS, resolution_mm })
    }
}

/// The same voxels with the first one at the world's origin, and the way back.
fn at_origin(world_from_voxel: &WorldFromVoxel) -> (WorldFromVoxel, Vector3<f64>) {
    let origin = world_from_voxel.point(Point3::origin()).coords;
    (world_from_voxel.translated(-origin), origin)
}

/// The mask with more room around it, and the same as numbers.
fn embed(native: &Grid<bool>, plan: &WorkingGrid, go_on: &GoOn<'_>) -> Result<(Grid<bool>, Grid<f32>), Cancelled> {
    let mut mask = Grid::filled(plan.dims, false);
    let [nx, ny, nz] = native.dims();
    let shift = PADDING - 1;
    for k in 0..nz {
        go_on()?;
        for j in 0..ny {
            let (from, to) = (native.offset([0, j, k]), mask.offset([shift, j + shift, k + shift]));
            mask.as_mut_slice()[to..to + nx].copy_from_slice(&native.as_slice()[from..from + nx]);
        }
    }
    let soft = mask.try_map(|m| f32::from(u8::from(*m)), go_on)?;
    Ok((mask, soft))
}

/// Shape-based interpolation (Raya, Udupa, IEEE TMI 9, 1990): the signed distance is read between
/// the voxels and made a mask again, with soft edges.
fn resample(native: &NativeMask, plan: &WorkingGrid, go_on: &GoOn<'_>) -> Result<(Grid<bool>, Grid<f32>), Cancelled> {
    /// Half-way between two voxels the share is this but for rounding, which is to decide nothing.
    const HALF: f32 = 0.500_001;
    let signed = signed_distance_mm(&native.mask, native.world_from_voxel.spacing_mm(), go_on)?;
    let (crop_mm, _) = at_origin(&native.world_from_voxel);
    let share_of = |at: VoxelIndex| {
        let crop = crop_mm.voxel(plan.centred.point(Point3::from(at.map(|x| x as f64))));
        #[expect(clippy::cast_possible_truncation, reason = "the grid is f32")]
        let share = (0.5 + cubic(&signed, crop) / plan.voxel_mm).clamp(0.0, 1.0) as f32;
        share
    };
    let soft = Grid::try_of(plan.dims, share_of, go_on)?;
    Ok((soft.try_map(|share| *share > HALF, go_on)?, soft))
}

/// Signed distance to the voxel boundary, positive inside: half the distance to the nearest
/// outside voxel centre less that to the nearest inside one.
fn signed_distance_mm(mask: &Grid<bool>, spacing_mm: [f64; 3], go_on: &GoOn<'_>) -> Result<Grid<f32>, Cancelled> {
    let to = |value: bool| {
        let seeds = boundary_voxels(mask, value, go_on)?;
        Ok(nearest_seed(mask.dims(), spacing_mm, &seeds, go_on)?.squared)
    };
    let mut signed = to(false)?;
    let inward = to(true)?;
    let slices = inward.as_slice().par_chunks(SLICE).zip(mask.as_slice().par_chunks(SLICE));
    signed.as_mut_slice().par_chunks_mut(SLICE).zip(slices).try_for_each(|(outward, (inward, mask))| {
        go_on()?;
        for ((o, i), is_inside) in outward.iter_mut().zip(inward).zip(mask) {
            *o = if *is_inside { o.sqrt() } else { -i.sqrt() } / 2.0;
        }
        Ok(())
    })?;
    Ok(signed)
}

/// Catmull-Rom interpolation along each axis; the edge goes on outside.
fn cubic(grid: &Grid<f32>, p: Point3<f64>) -> f64 {
    let dims = grid.dims();
    let mut index = [[0usize; 4]; 3];
    let mut weight = [[0.0f64; 4]; 3];
    for axis in 0..3 {
        let last = dims[axis] - 1;
        let x = p[axis].clamp(0.0, last as f64);
        let base = floor_index(x);
        let t = x - base as f64;
        index[axis] = [base.saturating_sub(1), base, (base + 1).min(last), (base + 2).min(last)];
        weight[axis] = [
            t * ((2.0 - t) * t - 1.0) / 2.0,
            (t * t * (3.0 * t - 5.0) + 2.0) / 2.0,
            t * ((4.0 - 3.0 * t) * t + 1.0) / 2.0,
            (t - 1.0) * t * t / 2.0,
        ];
    }
    let mut sum = 0.0;
    for (k, wk) in index[2].into_iter().zip(weight[2]) {
        for (j, wj) in index[1].into_iter().zip(weight[1]) {
            let line: f64 = index[0].into_iter().zip(weight[0]).map(|(i, wi)| wi * f64::from(grid[[i, j, k]])).sum();
            sum += wk * wj * line;
        }
    }
    sum
}
