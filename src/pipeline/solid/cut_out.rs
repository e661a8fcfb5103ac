//! Finds a label in the volume and cuts it out.

use nalgebra::Vector3;
use rayon::prelude::*;

use super::NativeMask;
use crate::cancel::{Cancel, Cancelled};
use crate::pipeline::context::Context;
use crate::space::{Grid, LabelVolume, VoxelIndex, WorldFromVoxel};

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

/// A label of a volume.
#[derive(Clone, Copy, Debug)]
pub struct Label {
    /// Its index into the volume's labels.
    pub index: u16,
    /// Its box.
    pub bounds: LabelBox,
}

/// Boxes of all labels in one pass, by index of the label.
///
/// # Errors
/// When it is cancelled.
pub fn label_boxes(volume: &LabelVolume, cancel: &dyn Cancel) -> Result<Vec<Option<LabelBox>>, Cancelled> {
    let [nx, ny, _] = volume.dims();
    let mut boxes: Vec<Option<LabelBox>> = vec![None; volume.labels().len() + 1];
    for (row, values) in volume.indices().as_slice().chunks_exact(nx).enumerate() {
        cancel.check()?;
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

/// Warns of a label that touches the edge of the image.
pub(super) fn warn_if_cut(volume: &LabelVolume, Label { index, bounds }: Label, context: &Context<'_>) {
    let dims = volume.dims();
    let touched = (0..3).filter(|&a| bounds.low[a] == 0 || bounds.high[a] + 1 == dims[a]);
    let mut cut = 0;
    for axis in touched {
        let (p, q) = ((axis + 1) % 3, (axis + 2) % 3);
        for face in if dims[axis] == 1 { vec![0] } else { vec![0, dims[axis] - 1] } {
            for x in 0..dims[p] {
                for y in 0..dims[q] {
                    let mut at = [0; 3];
                    (at[axis], at[p], at[q]) = (face, x, y);
                    cut += usize::from(volume.indices()[at] == index);
                }
            }
        }
    }
    if cut > 0 {
        let message =
            format!("the object touches the edge of the image with {cut} voxels: what lies beyond is missing");
        context.warn("cut_by_image", message);
    }
}

/// A label's box with one free voxel all around, its axes permuted and reversed so that they run
/// towards right, anterior and superior as nearly as they can. What follows breaks ties by the order
/// of voxels: this makes it the world's order, not that of the file.
pub(super) fn cut_out(volume: &LabelVolume, label: Label, cancel: &dyn Cancel) -> Result<NativeMask, Cancelled> {
    let Label { index, bounds } = label;
    let first = Vector3::from_fn(|a, _| bounds.low[a] as f64 - 1.0);
    let world_from_crop = volume.world_from_voxel().shifted_to(first);
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
        volume.indices().offset(from)
    };
    let inner = |n: usize, length: usize| n > 0 && n + 1 < length;
    mask.as_mut_slice().par_chunks_mut(width).enumerate().with_min_len(64).try_for_each(|(row, out)| {
        cancel.check()?;
        let (j, k) = (row % height, row / height);
        if !inner(j, height) || !inner(k, dims[2]) {
            return Ok(());
        }
        let (from, to) = (source([1, j, k]), source([width - 2, j, k]));
        let step = from.abs_diff(to) / (width - 3).max(1);
        for (n, cell) in out[1..width - 1].iter_mut().enumerate() {
            let offset = if from <= to { from + n * step } else { from - n * step };
            *cell = volume.indices().as_slice()[offset] == index;
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
