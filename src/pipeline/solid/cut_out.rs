//! Finds a label in the volume and cuts it out.

use nalgebra::Vector3;
use rayon::prelude::*;

use super::NativeMask;
use crate::cancel::{Cancel, Cancelled};
use crate::model::Refusal;
use crate::pipeline::context::Context;
use crate::space::{Grid, LabelVolume, VoxelIndex, WorldFromVoxel};

/// Rows that one thread takes at a time; fewer are not worth handing over.
const ROWS_PER_TASK: usize = 64;
/// Share of each of the six faces of the image that a background takes. An object that is cut by the image fills the
/// faces that cut it, but not all six, and one whose image was cropped to it touches them in a few voxels. With less, such
/// a one might be refused; with more, the outside of an organ that is cut on one side would pass for an object.
const BACKGROUND_SHARE: f64 = 0.5;
/// Difference of cosines that counts as none. Rounding makes 1e-15, and headers in f32 1e-7: with less, which axes
/// come first would hang on it; with more, voxels turned by less than 45° by a hair would count as turned by it.
const TIE: f64 = 1e-6;

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
        let mut voxels = 1;
        for axis in 0..3 {
            voxels *= (self.high[axis] - self.low[axis] + 1) as u64;
        }
        voxels
    }

    /// Grows to hold another box.
    fn take_in(&mut self, other: Self) {
        for axis in 0..3 {
            self.low[axis] = self.low[axis].min(other.low[axis]);
            self.high[axis] = self.high[axis].max(other.high[axis]);
        }
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
    let mut boxes: Vec<Option<LabelBox>> = vec![None; volume.labels().len() + 1];
    for layer in volume.layers() {
        add_boxes(layer, &mut boxes, cancel)?;
    }
    Ok(boxes)
}

/// Takes the voxels of a layer into the boxes of their labels.
fn add_boxes(layer: &Grid<u16>, boxes: &mut [Option<LabelBox>], cancel: &dyn Cancel) -> Result<(), Cancelled> {
    let [nx, ny, _] = layer.dims();
    for (row, values) in layer.as_slice().chunks_exact(nx).enumerate() {
        cancel.check()?;
        let (j, k) = (row % ny, row / ny);
        let mut i = 0;
        while i < nx {
            let label = values[i];
            let run = values[i..].iter().take_while(|v| **v == label).count();
            if label != 0 {
                let found = LabelBox { low: [i, j, k], high: [i + run - 1, j, k] };
                boxes[usize::from(label)].get_or_insert(found).take_in(found);
            }
            i += run;
        }
    }
    Ok(())
}

/// Refuses a label that lies all around the image: a background that is not 0, or that of an inverted mask.
pub(crate) fn refuse_background(volume: &LabelVolume, label: Label) -> Result<(), Refusal> {
    let (dims, bounds) = (volume.dims(), label.bounds);
    for (axis, length) in dims.into_iter().enumerate() {
        // Slices that were added are no slices of the image.
        let added = usize::from(volume.added_slices() == Some(axis));
        if bounds.low[axis] > added || bounds.high[axis] + 1 + added < length {
            return Ok(());
        }
        let area = (dims[(axis + 1) % 3] * dims[(axis + 2) % 3]) as f64;
        for face in [added, length - 1 - added] {
            if (voxels_on_face(volume, label.index, axis, face) as f64) < BACKGROUND_SHARE * area {
                return Ok(());
            }
        }
    }
    let share = volume.voxels_of(label.index) as f64 / volume.indices().as_slice().len() as f64;
    let value = volume.label(label.index).map_or(0, |label| label.value);
    Err(Refusal::Background { label: value, share })
}

/// Warns of a label that touches the edge of the image, or the last slices that the file has where the image may go on
/// beyond them.
pub(super) fn warn_if_cut(volume: &LabelVolume, label: Label, context: &Context<'_>) {
    if let Some(axis) = volume.added_slices() {
        warn_if_edge_is_unknown(volume, label, axis, context);
    }
    let cut = voxels_on_edge(volume, label);
    if cut > 0 {
        let message =
            format!("the object touches the edge of the image with {cut} voxels: what lies beyond is missing");
        context.warn("cut_by_image", message);
    }
}

/// Warns of a label in the first or last slice of a file that keeps no empty ones: whether it ended there or the image
/// did is not told. The slices beyond were added when the file was read.
fn warn_if_edge_is_unknown(volume: &LabelVolume, label: Label, axis: usize, context: &Context<'_>) {
    let (low, high, last) = (label.bounds.low[axis], label.bounds.high[axis], volume.dims()[axis].saturating_sub(2));
    let ends: &[usize] = match (low == 1, high == last) {
        (true, true) if last > 1 => &[1, last],
        (true, _) => &[1],
        (false, true) => &[last],
        (false, false) => return,
    };
    let mut voxels = 0;
    for slice in ends {
        voxels += voxels_on_face(volume, label.index, axis, *slice);
    }
    let message = format!(
        "the object has {voxels} voxels in the first or last slice of the file, which keeps no empty slices: \
         whether the image goes on beyond them, and the object ends there, is not known"
    );
    context.warn("edge_unknown", message);
}

/// Voxels of a label on the faces of the image; one on an edge of the image is of both faces there.
fn voxels_on_edge(volume: &LabelVolume, label: Label) -> usize {
    let (dims, bounds) = (volume.dims(), label.bounds);
    let mut count = 0;
    for (axis, length) in dims.into_iter().enumerate() {
        if bounds.low[axis] == 0 || bounds.high[axis] + 1 == length {
            count += voxels_on_face(volume, label.index, axis, 0);
            if length > 1 {
                count += voxels_on_face(volume, label.index, axis, length - 1);
            }
        }
    }
    count
}

/// Voxels of a label in the plane of the image that an axis meets at `face`.
fn voxels_on_face(volume: &LabelVolume, index: u16, axis: usize, face: usize) -> usize {
    let dims = volume.dims();
    let (p, q) = ((axis + 1) % 3, (axis + 2) % 3);
    let layer = volume.layer_of(index);
    let mut count = 0;
    for x in 0..dims[p] {
        for y in 0..dims[q] {
            let mut at = [0; 3];
            (at[axis], at[p], at[q]) = (face, x, y);
            count += usize::from(layer[at] == index);
        }
    }
    count
}

/// A label's box with one free voxel all around, its axes permuted and reversed so that they run
/// towards right, anterior and superior as nearly as they can. What follows breaks ties by the order
/// of voxels: this makes it the world's order, not that of the file.
pub(super) fn cut_out(volume: &LabelVolume, label: Label, cancel: &dyn Cancel) -> Result<NativeMask, Cancelled> {
    let bounds = label.bounds;
    let (mut first, mut size) = (Vector3::zeros(), [0; 3]);
    for axis in 0..3 {
        first[axis] = bounds.low[axis] as f64 - 1.0;
        size[axis] = bounds.high[axis] - bounds.low[axis] + 3;
    }
    let world_from_crop = volume.world_from_voxel().shifted_to(first);
    let crop = Crop { layer: volume.layer_of(label.index), label, axes: nearest_axes(&world_from_crop), size };
    let mut mask = Grid::filled(crop.dims(), false);
    let rows = mask.as_mut_slice().par_chunks_mut(crop.dims()[0]);
    rows.enumerate().with_min_len(ROWS_PER_TASK).try_for_each(|(row, out)| {
        cancel.check()?;
        crop.fill_row(row, out);
        Ok(())
    })?;
    let file_axes = crop.axes.map(|axis| axis.number);
    Ok(NativeMask { mask, world_from_voxel: crop.turned(&world_from_crop), file_axes })
}

/// The axis of the voxels that one of the mask runs along.
#[derive(Clone, Copy)]
struct Axis {
    number: usize,
    /// It runs the other way.
    is_reversed: bool,
}

/// A label on its way out of the volume.
struct Crop<'a> {
    /// The layer that the label is in.
    layer: &'a Grid<u16>,
    label: Label,
    axes: [Axis; 3],
    /// Voxels of the box and the free ones around it, along the axes of the volume.
    size: [usize; 3],
}

impl Crop<'_> {
    /// Voxels of the mask.
    fn dims(&self) -> [usize; 3] {
        self.axes.map(|axis| self.size[axis.number])
    }

    /// Where the volume has the voxel at a place of the mask that is not on its edge.
    fn source(&self, at: [usize; 3]) -> usize {
        let mut from = [0; 3];
        for (Axis { number, is_reversed }, x) in self.axes.into_iter().zip(at) {
            from[number] = self.label.bounds.low[number] + if is_reversed { self.size[number] - 2 - x } else { x - 1 };
        }
        self.layer.offset(from)
    }

    /// Fills a row of the mask. Its voxels lie at equal steps in the volume, whatever axis it follows there.
    fn fill_row(&self, row: usize, out: &mut [bool]) {
        let [width, height, depth] = self.dims();
        let (j, k) = (row % height, row / height);
        if j == 0 || k == 0 || j + 1 == height || k + 1 == depth {
            return;
        }
        let (from, to) = (self.source([1, j, k]), self.source([width - 2, j, k]));
        let step = from.abs_diff(to) / (width - 3).max(1);
        for (n, cell) in out[1..width - 1].iter_mut().enumerate() {
            let offset = if from <= to { from + n * step } else { from - n * step };
            *cell = self.layer.as_slice()[offset] == self.label.index;
        }
    }

    /// The map of the mask's voxels, of that of the box along the volume's axes.
    fn turned(&self, world_from_crop: &WorldFromVoxel) -> WorldFromVoxel {
        let [x, y, z, _] = world_from_crop.rows();
        let rows = [self.turned_row(x), self.turned_row(y), self.turned_row(z)];
        WorldFromVoxel::from_rows(rows).expect("permuted and reversed axes still span space")
    }

    /// One row of the map; the origin is where a reversed axis ends.
    fn turned_row(&self, row: [f64; 4]) -> [f64; 4] {
        let mut turned = row;
        for (to, Axis { number, is_reversed }) in self.axes.into_iter().enumerate() {
            turned[to] = if is_reversed { -row[number] } else { row[number] };
            turned[3] += row[number] * if is_reversed { (self.size[number] - 1) as f64 } else { 0.0 };
        }
        turned
    }
}

/// For each axis of the world the voxel axis that follows it.
/// Of all pairings the one with the greatest sum of cosines; of equals (voxels turned by 45°) the
/// one whose axes come first, by their own directions.
fn nearest_axes(world_from_voxel: &WorldFromVoxel) -> [Axis; 3] {
    const ORDERS: [[usize; 3]; 6] = [[0, 1, 2], [0, 2, 1], [1, 0, 2], [1, 2, 0], [2, 0, 1], [2, 1, 0]];
    let cosines = Cosines::of(world_from_voxel);
    let mut most = 0.0f64;
    for order in ORDERS {
        most = most.max(cosines.sum(order));
    }
    let mut best: Option<[usize; 3]> = None;
    for order in ORDERS {
        if cosines.sum(order) > most - TIE && best.is_none_or(|best| cosines.is_before(order, best)) {
            best = Some(order);
        }
    }
    let order = best.unwrap_or(ORDERS[0]);
    [0, 1, 2].map(|r| Axis { number: order[r], is_reversed: cosines.0[r][order[r]] < 0.0 })
}

/// Cosines between the axes of the world (rows) and of the voxels (columns).
struct Cosines([[f64; 3]; 3]);

impl Cosines {
    fn of(world_from_voxel: &WorldFromVoxel) -> Self {
        let (rows, spacing) = (world_from_voxel.rows(), world_from_voxel.spacing_mm());
        Self([0, 1, 2].map(|r| [0, 1, 2].map(|axis| rows[r][axis] / spacing[axis])))
    }

    /// How nearly voxel axes, in an order, follow those of the world.
    fn sum(&self, order: [usize; 3]) -> f64 {
        let mut sum = 0.0;
        for (row, axis) in self.0.iter().zip(order) {
            sum += row[axis].abs();
        }
        sum
    }

    /// Directions in the world of voxel axes, in an order and turned to run with those of the world, one after
    /// the other.
    fn directions(&self, order: [usize; 3]) -> Vec<f64> {
        let mut entries = Vec::new();
        for (row, axis) in self.0.iter().zip(order) {
            let sign = if row[axis] < 0.0 { -1.0 } else { 1.0 };
            entries.extend(self.0.map(|row| sign * row[axis]));
        }
        entries
    }

    /// Whether the first entry in which the directions of two orders differ is the greater one in `a`.
    fn is_before(&self, a: [usize; 3], b: [usize; 3]) -> bool {
        for (x, y) in self.directions(a).into_iter().zip(self.directions(b)) {
            if (x - y).abs() > TIE {
                return x > y;
            }
        }
        false
    }
}
