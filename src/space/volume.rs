//! A label map in world space: what every format is read into.

use std::collections::HashMap;

use super::{AffineError, Grid, VoxelIndex, WorldFromVoxel};
use crate::cancel::{Cancel, Cancelled, Never};

/// Labels that an index of two bytes can tell apart, beside the background.
const MAX_LABELS: usize = u16::MAX as usize;
/// Voxels that are counted together where they are all alike: most of a label map is background.
const BLOCK: usize = 2048;
/// Blocks between two looks at whether to go on.
const BLOCKS: usize = 1 << 9;

/// Something about a file that is not an error but that its user should know.
#[derive(Clone, Debug, PartialEq)]
pub struct VolumeNotice {
    /// Stable code, snake case.
    pub code: &'static str,
    /// One sentence.
    pub message: String,
}

/// A label: a value of the file, and what the file says of it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Label {
    /// The value; 0 is the background and no label.
    pub value: i64,
    /// What it is called.
    pub name: Option<String>,
    /// Its colour: red, green, blue.
    pub color: Option<[u8; 3]>,
    /// What it is, by a code of a terminology.
    pub code: Option<LabelCode>,
}

/// What a structure is, by a code of a terminology: value `64033007` of scheme `SCT` means `Kidney`.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct LabelCode {
    /// The code.
    pub value: String,
    /// The terminology that it is of.
    pub scheme: String,
    /// The code in words.
    pub meaning: String,
}

impl Label {
    /// A label of which only the value is known.
    #[must_use]
    pub fn new(value: i64) -> Self {
        Self { value, name: None, color: None, code: None }
    }
}

/// Why voxels and labels are no label volume.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum LabelVolumeError {
    /// An axis has no voxels.
    #[error("the volume has {dims:?} voxels: every axis needs one")]
    NoVoxels {
        /// Voxels along each axis.
        dims: [usize; 3],
    },
    /// Not one value for each voxel.
    #[error("{values} values were given for {dims:?} voxels")]
    WrongCount {
        /// Voxels along each axis.
        dims: [usize; 3],
        /// Values given.
        values: usize,
    },
    /// More labels than an index can tell apart.
    #[error("the volume has more than {MAX_LABELS} labels")]
    TooManyLabels,
    /// A label with the value of the background.
    #[error("label {index} has the value 0, which is the background")]
    ZeroLabel {
        /// Its index.
        index: usize,
    },
    /// Labels out of order, or one twice.
    #[error("label {index} has the value {value}, which does not come after {previous}: labels must ascend")]
    NotAscending {
        /// Index of the later one.
        index: usize,
        /// Its value.
        value: i64,
        /// The value before it.
        previous: i64,
    },
    /// A voxel with an index that no label has.
    #[error("voxel {voxel:?} has the index {index}, the last label has {labels}")]
    NoSuchLabel {
        /// Where.
        voxel: VoxelIndex,
        /// Its index.
        index: u16,
        /// Number of labels.
        labels: usize,
    },
    /// Layers that do not lie on one another.
    #[error("layer {layer} has {dims:?} voxels, the first has {first:?}")]
    LayersDiffer {
        /// Its number, from 0.
        layer: usize,
        /// Its voxels along each axis.
        dims: [usize; 3],
        /// Those of the first layer.
        first: [usize; 3],
    },
    /// A label with voxels in more than one layer.
    #[error("label {index} has voxels in layers {layers:?}: it needs one layer of its own")]
    InTwoLayers {
        /// Its index.
        index: usize,
        /// Two of its layers, from 0.
        layers: [usize; 2],
    },
    /// A spacing that is none.
    #[error(transparent)]
    Affine(#[from] AffineError),
    /// Told to stop while a file was read; nothing is wrong with the volume.
    #[error(transparent)]
    Cancelled(#[from] Cancelled),
}

/// A label map. Voxels hold the index of a label, so that any value costs two bytes a voxel: index 0 is the
/// background, index n the n-th label.
///
/// Labels that share voxels lie in different layers, each a grid over the same voxels; nearly every volume has one.
///
/// What is checked holds: the values ascend, none is 0, every label has a voxel, all of its voxels in one layer, every
/// index a label.
#[derive(Clone, Debug, PartialEq)]
pub struct LabelVolume {
    /// The first, then the others; all over the same voxels.
    first: Grid<u16>,
    further: Vec<Grid<u16>>,
    labels: Vec<Label>,
    /// By index, the background of the first layer first.
    voxels: Vec<u64>,
    /// Number of the layer by index; that of the background is the first.
    layer: Vec<usize>,
    world_from_voxel: WorldFromVoxel,
    added_slices: Option<usize>,
    notices: Vec<VolumeNotice>,
}

impl LabelVolume {
    /// A volume whose voxels hold 0 for the background and n for `labels[n - 1]`, which must ascend by value.
    /// A label without a voxel is left out, and those after it move up: an atlas names more than a mask shows.
    ///
    /// # Errors
    /// When an axis has no voxels, the labels do not ascend or have the value 0, there are more than 65 535, or
    /// a voxel has an index that none of them has.
    pub fn new(
        indices: Grid<u16>,
        labels: Vec<Label>,
        world_from_voxel: WorldFromVoxel,
    ) -> Result<Self, LabelVolumeError> {
        Self::new_while((indices, Vec::new()), labels, world_from_voxel, &Never)
    }

    /// As [`Self::new`], of a first layer and further ones over the same voxels. An index means the same label in
    /// all layers; each label has its voxels in one of them.
    ///
    /// # Errors
    /// As [`Self::new`], and when the layers differ in size or a label has voxels in two.
    pub fn layered(
        layers: (Grid<u16>, Vec<Grid<u16>>),
        labels: Vec<Label>,
        world_from_voxel: WorldFromVoxel,
    ) -> Result<Self, LabelVolumeError> {
        Self::new_while(layers, labels, world_from_voxel, &Never)
    }

    /// As [`Self::layered`], of a volume so large that counting its voxels takes a while.
    ///
    /// # Errors
    /// As [`Self::layered`], and when it is cancelled.
    pub(crate) fn new_while(
        (first, further): (Grid<u16>, Vec<Grid<u16>>),
        labels: Vec<Label>,
        world_from_voxel: WorldFromVoxel,
        cancel: &dyn Cancel,
    ) -> Result<Self, LabelVolumeError> {
        check_dims(first.dims())?;
        check_labels(&labels)?;
        let mut voxels = count(&first, cancel)?;
        check_indices(&first, &voxels, labels.len())?;
        let mut layer = vec![0; labels.len() + 1];
        for (number, grid) in (1..).zip(&further) {
            if grid.dims() != first.dims() {
                return Err(LabelVolumeError::LayersDiffer { layer: number, dims: grid.dims(), first: first.dims() });
            }
            let own = count(grid, cancel)?;
            check_indices(grid, &own, labels.len())?;
            for index in (1..=labels.len()).filter(|index| own[*index] > 0) {
                if voxels[index] > 0 {
                    return Err(LabelVolumeError::InTwoLayers { index, layers: [layer[index], number] });
                }
                (voxels[index], layer[index]) = (own[index], number);
            }
        }
        voxels.truncate(labels.len() + 1);
        let volume =
            Self { first, further, labels, voxels, layer, world_from_voxel, added_slices: None, notices: Vec::new() };
        Ok(volume.without_empty_labels())
    }

    /// A volume of axis-aligned voxels with these values, the first axis fastest; 0 is the background. Voxel
    /// (0, 0, 0) lies at the origin of the world: [`Self::placed`] puts it elsewhere.
    ///
    /// # Errors
    /// When an axis has no voxels, there is not one value for each voxel, the spacing is none, or there are more
    /// than 65 535 labels.
    pub fn from_labels(dims: [usize; 3], spacing_mm: [f64; 3], values: &[i64]) -> Result<Self, LabelVolumeError> {
        let count = dims[0].checked_mul(dims[1]).and_then(|area| area.checked_mul(dims[2]));
        if count != Some(values.len()) {
            return Err(LabelVolumeError::WrongCount { dims, values: values.len() });
        }
        Self::collected(dims, spacing_mm, values.iter().copied())
    }

    /// As [`Self::from_labels`], with the values that `value_at` gives of voxels `[i, j, k]`.
    ///
    /// ```
    /// use medialrep::space::LabelVolume;
    ///
    /// let is_inside = |[i, j, k]: [usize; 3]| (4..60).contains(&i) && (4..40).contains(&j) && (4..12).contains(&k);
    /// let slab = LabelVolume::from_fn([64, 44, 16], [1.0, 1.0, 1.5], |voxel| i64::from(is_inside(voxel)))?;
    /// assert_eq!((slab.labels()[0].value, slab.voxels_of(1)), (1, 56 * 36 * 8));
    /// # Ok::<(), medialrep::space::LabelVolumeError>(())
    /// ```
    ///
    /// # Errors
    /// As [`Self::from_labels`].
    pub fn from_fn(
        dims: [usize; 3],
        spacing_mm: [f64; 3],
        mut value_at: impl FnMut(VoxelIndex) -> i64,
    ) -> Result<Self, LabelVolumeError> {
        let [nx, ny, nz] = dims;
        let voxels = (0..nz).flat_map(|k| (0..ny).flat_map(move |j| (0..nx).map(move |i| [i, j, k])));
        Self::collected(dims, spacing_mm, voxels.map(&mut value_at))
    }

    /// Values to indices: first in the order in which they are met, then ascending.
    fn collected(
        dims: [usize; 3],
        spacing_mm: [f64; 3],
        values: impl Iterator<Item = i64>,
    ) -> Result<Self, LabelVolumeError> {
        check_dims(dims)?;
        let world_from_voxel = WorldFromVoxel::axis_aligned(spacing_mm, [0.0; 3])?;
        let mut met = vec![0];
        let mut index_of = HashMap::from([(0, 0)]);
        let mut indices = Vec::new();
        for value in values {
            let index = match index_of.get(&value) {
                Some(index) => *index,
                None => {
                    let index = u16::try_from(met.len()).map_err(|_| LabelVolumeError::TooManyLabels)?;
                    met.push(value);
                    index_of.insert(value, index);
                    index
                }
            };
            indices.push(index);
        }
        let (new_of_old, labels) = ascending(&met);
        for index in &mut indices {
            *index = new_of_old[usize::from(*index)];
        }
        let count = indices.len();
        let indices = Grid::from_vec(dims, indices).ok_or(LabelVolumeError::WrongCount { dims, values: count })?;
        Self::new(indices, labels, world_from_voxel)
    }

    /// Leaves out labels that no voxel has.
    fn without_empty_labels(mut self) -> Self {
        if self.voxels[1..].iter().all(|count| *count > 0) {
            return self;
        }
        let mut new_of_old = vec![0];
        let (mut labels, mut voxels, mut layer) = (Vec::new(), vec![self.voxels[0]], vec![0]);
        for (label, old) in self.labels.into_iter().zip(1..) {
            if self.voxels[old] > 0 {
                labels.push(label);
                voxels.push(self.voxels[old]);
                layer.push(self.layer[old]);
            }
            new_of_old.push(u16::try_from(labels.len()).unwrap_or(u16::MAX));
        }
        for grid in std::iter::once(&mut self.first).chain(&mut self.further) {
            for index in grid.as_mut_slice().iter_mut().filter(|index| **index != 0) {
                *index = new_of_old[usize::from(*index)];
            }
        }
        Self { labels, voxels, layer, ..self }
    }

    /// The same voxels elsewhere in the world.
    #[must_use]
    pub fn placed(self, world_from_voxel: WorldFromVoxel) -> Self {
        Self { world_from_voxel, ..self }
    }

    /// With what was noticed while reading, after what was before.
    #[must_use]
    pub fn with_notices(mut self, notices: impl IntoIterator<Item = VolumeNotice>) -> Self {
        self.notices.extend(notices);
        self
    }

    /// The same, whose first and last slice along `axis` are no slices of the file: they were added empty, because the
    /// file keeps only slices in which something is, and the image may go on beyond them.
    #[must_use]
    pub fn with_added_slices(self, axis: usize) -> Self {
        Self { added_slices: Some(axis), ..self }
    }

    /// The axis whose first and last slice were added ([`Self::with_added_slices`]).
    #[must_use]
    pub fn added_slices(&self) -> Option<usize> {
        self.added_slices
    }

    /// Index of a label per voxel of the first layer, 0 for the background. Of labels that overlap others, some are in
    /// further ones.
    #[must_use]
    pub fn indices(&self) -> &Grid<u16> {
        &self.first
    }

    /// Index of a label per voxel, layer by layer.
    pub fn layers(&self) -> impl Iterator<Item = &Grid<u16>> {
        std::iter::once(&self.first).chain(&self.further)
    }

    /// The layer in which the label of an index has its voxels; the first for the background and for what is no index
    /// here.
    #[must_use]
    pub fn layer_of(&self, index: u16) -> &Grid<u16> {
        let number = self.layer.get(usize::from(index)).copied().unwrap_or(0);
        number.checked_sub(1).and_then(|number| self.further.get(number)).unwrap_or(&self.first)
    }

    /// The labels, ascending; `labels()[n - 1]` is that of index n.
    #[must_use]
    pub fn labels(&self) -> &[Label] {
        &self.labels
    }

    /// The label of an index; `None` for the background and for what is no index here.
    #[must_use]
    pub fn label(&self, index: u16) -> Option<&Label> {
        self.labels.get(usize::from(index).checked_sub(1)?)
    }

    /// The index of the label with a value.
    #[must_use]
    pub fn index_of(&self, value: i64) -> Option<u16> {
        let place = self.labels.binary_search_by_key(&value, |label| label.value).ok()?;
        u16::try_from(place + 1).ok()
    }

    /// Number of voxels with an index: of a label, or of the background of the first layer with 0.
    #[must_use]
    pub fn voxels_of(&self, index: u16) -> u64 {
        self.voxels.get(usize::from(index)).copied().unwrap_or(0)
    }

    /// Voxels along each axis.
    #[must_use]
    pub fn dims(&self) -> [usize; 3] {
        self.first.dims()
    }

    /// Where the voxels lie.
    #[must_use]
    pub fn world_from_voxel(&self) -> WorldFromVoxel {
        self.world_from_voxel
    }

    /// What was noticed while reading.
    #[must_use]
    pub fn notices(&self) -> &[VolumeNotice] {
        &self.notices
    }

    /// What was noticed while reading, without the voxels: they take memory and are not needed any more.
    #[must_use]
    pub fn into_notices(self) -> Vec<VolumeNotice> {
        self.notices
    }
}

/// For values in the order in which they were met, the background first: the index of each once they ascend, and
/// their labels in that order. A value of 0 met again is the background.
pub(crate) fn ascending(met: &[i64]) -> (Vec<u16>, Vec<Label>) {
    let mut old_of_new: Vec<usize> = (1..met.len()).filter(|old| met[*old] != 0).collect();
    old_of_new.sort_by_key(|old| met[*old]);
    let mut new_of_old = vec![0; met.len()];
    for (new, old) in (1..=u16::MAX).zip(&old_of_new) {
        new_of_old[*old] = new;
    }
    (new_of_old, old_of_new.iter().map(|old| Label::new(met[*old])).collect())
}

fn check_dims(dims: [usize; 3]) -> Result<(), LabelVolumeError> {
    if dims.contains(&0) { Err(LabelVolumeError::NoVoxels { dims }) } else { Ok(()) }
}

fn check_labels(labels: &[Label]) -> Result<(), LabelVolumeError> {
    if labels.len() > MAX_LABELS {
        return Err(LabelVolumeError::TooManyLabels);
    }
    let mut previous = None;
    for (n, label) in labels.iter().enumerate() {
        let (index, value) = (n + 1, label.value);
        match previous {
            _ if value == 0 => return Err(LabelVolumeError::ZeroLabel { index }),
            Some(previous) if previous >= value => {
                return Err(LabelVolumeError::NotAscending { index, value, previous });
            }
            _ => previous = Some(value),
        }
    }
    Ok(())
}

/// Voxels of every index that there can be.
fn count(indices: &Grid<u16>, cancel: &dyn Cancel) -> Result<Vec<u64>, Cancelled> {
    let mut voxels = vec![0; MAX_LABELS + 1];
    for blocks in indices.as_slice().chunks(BLOCKS * BLOCK) {
        cancel.check()?;
        for block in blocks.chunks(BLOCK) {
            if block.iter().all(|index| *index == block[0]) {
                voxels[usize::from(block[0])] += block.len() as u64;
            } else {
                block.iter().for_each(|index| voxels[usize::from(*index)] += 1);
            }
        }
    }
    Ok(voxels)
}

/// Refuses an index that none of so many labels has.
fn check_indices(indices: &Grid<u16>, voxels: &[u64], labels: usize) -> Result<(), LabelVolumeError> {
    match (labels + 1..voxels.len()).find(|index| voxels[*index] > 0) {
        Some(index) => Err(no_such_label(indices, index, labels)),
        None => Ok(()),
    }
}

fn no_such_label(indices: &Grid<u16>, index: usize, labels: usize) -> LabelVolumeError {
    let offset = indices.as_slice().iter().position(|found| usize::from(*found) == index).unwrap_or(0);
    let index = indices.as_slice()[offset];
    LabelVolumeError::NoSuchLabel { voxel: indices.index(offset), index, labels }
}

#[cfg(test)]
mod tests {
    use super::*;

    const UNIT: [f64; 3] = [1.0; 3];

    fn world() -> WorldFromVoxel {
        WorldFromVoxel::axis_aligned(UNIT, [0.0; 3]).unwrap()
    }

    fn volume(indices: &[u16], values: &[i64]) -> Result<LabelVolume, LabelVolumeError> {
        let indices = Grid::from_vec([indices.len(), 1, 1], indices.to_vec()).unwrap();
        LabelVolume::new(indices, values.iter().copied().map(Label::new).collect(), world())
    }

    fn values(volume: &LabelVolume) -> Vec<i64> {
        volume.labels().iter().map(|label| label.value).collect()
    }

    #[test]
    fn voxels_of_every_label_are_counted() {
        let volume = volume(&[0, 1, 2, 2, 0, 2], &[-4, 9]).unwrap();
        assert_eq!([0, 1, 2, 3].map(|index| volume.voxels_of(index)), [2, 1, 3, 0]);
        assert_eq!((volume.index_of(-4), volume.index_of(9), volume.index_of(0)), (Some(1), Some(2), None));
        assert_eq!((volume.label(0), volume.label(2).map(|label| label.value)), (None, Some(9)));
    }

    #[test]
    fn a_label_without_a_voxel_is_left_out_and_the_others_move_up() {
        let volume = volume(&[3, 1, 1], &[5, 6, 7, 8]).unwrap();
        assert_eq!(values(&volume), [5, 7]);
        assert_eq!(volume.indices().as_slice(), [2, 1, 1]);
        assert_eq!([0, 1, 2].map(|index| volume.voxels_of(index)), [0, 2, 1]);
    }

    #[test]
    fn labels_that_do_not_ascend_are_refused() {
        let refused = |values: &[i64]| volume(&[0, 1, 2], values).unwrap_err();
        assert_eq!(refused(&[3, 0]), LabelVolumeError::ZeroLabel { index: 2 });
        for values in [[3, 3], [4, 3]] {
            let previous = values[0];
            assert_eq!(refused(&values), LabelVolumeError::NotAscending { index: 2, value: 3, previous });
        }
    }

    #[test]
    fn an_index_without_a_label_is_refused_with_its_place() {
        let error = LabelVolumeError::NoSuchLabel { voxel: [1, 0, 0], index: 7, labels: 1 };
        assert_eq!(volume(&[1, 7], &[5]).unwrap_err(), error);
    }

    fn layered(layers: &[&[u16]], values: &[i64]) -> Result<LabelVolume, LabelVolumeError> {
        let mut grids: Vec<_> =
            layers.iter().map(|layer| Grid::from_vec([layer.len(), 1, 1], layer.to_vec()).unwrap()).collect();
        let first = grids.remove(0);
        LabelVolume::layered((first, grids), values.iter().copied().map(Label::new).collect(), world())
    }

    #[test]
    fn labels_that_share_voxels_lie_in_layers_of_their_own() {
        let volume = layered(&[&[3, 3, 0], &[0, 1, 1]], &[5, 6, 7]).unwrap();
        assert_eq!(values(&volume), [5, 7]);
        assert_eq!(volume.layer_of(1).as_slice(), [0, 1, 1]);
        assert_eq!(volume.layer_of(2).as_slice(), [2, 2, 0]);
        assert_eq!([1, 2].map(|index| volume.voxels_of(index)), [2, 2]);
    }

    #[test]
    fn a_label_in_two_layers_is_refused() {
        let error = LabelVolumeError::InTwoLayers { index: 1, layers: [0, 2] };
        assert_eq!(layered(&[&[1, 0], &[0, 0], &[1, 0]], &[5]).unwrap_err(), error);
    }

    #[test]
    fn layers_of_different_sizes_are_refused() {
        let error = LabelVolumeError::LayersDiffer { layer: 1, dims: [1, 1, 1], first: [2, 1, 1] };
        assert_eq!(layered(&[&[1, 0], &[1]], &[5]).unwrap_err(), error);
    }

    #[test]
    fn an_axis_without_voxels_is_refused() {
        assert_eq!(volume(&[], &[]).unwrap_err(), LabelVolumeError::NoVoxels { dims: [0, 1, 1] });
        let error = LabelVolume::from_labels([2, 0, 2], UNIT, &[]).unwrap_err();
        assert_eq!(error, LabelVolumeError::NoVoxels { dims: [2, 0, 2] });
    }

    #[test]
    fn values_become_ascending_labels() {
        let given = [7, 0, -2, 7, i64::MAX, 0];
        let volume = LabelVolume::from_labels([3, 2, 1], UNIT, &given).unwrap();
        assert_eq!(values(&volume), [-2, 7, i64::MAX]);
        assert_eq!(volume.indices().as_slice(), [2, 0, 1, 2, 3, 0]);
        let same = LabelVolume::from_fn([3, 2, 1], UNIT, |[i, j, _]| given[i + 3 * j]).unwrap();
        assert_eq!(same, volume);
    }

    #[test]
    fn one_value_is_needed_for_each_voxel() {
        for dims in [[2, 2, 2], [usize::MAX, 2, 2]] {
            let error = LabelVolume::from_labels(dims, UNIT, &[1; 7]).unwrap_err();
            assert_eq!(error, LabelVolumeError::WrongCount { dims, values: 7 });
        }
    }

    #[test]
    fn more_labels_than_indices_are_refused() {
        let of = |count: i64| {
            LabelVolume::from_labels([usize::try_from(count).unwrap(), 1, 1], UNIT, &(1..=count).collect::<Vec<_>>())
        };
        assert_eq!(of(65_535).unwrap().labels().len(), 65_535);
        assert_eq!(of(65_536).unwrap_err(), LabelVolumeError::TooManyLabels);
    }
}
