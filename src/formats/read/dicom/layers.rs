//! Voxels of segments, frame by frame. A segment that meets another one moves to a further layer, with all that it has.

use std::collections::BTreeMap;

use super::error::DicomFault;
use super::segments::Segments;
use super::tag::{Tag, TagPath};
use crate::cancel::Cancel;
use crate::formats::read::error::ReadError;
use crate::formats::read::layers::MAX_LAYERS;
use crate::space::{Grid, Label, VolumeNotice};

/// Voxels that are compared where segments move, in times of those of the volume. A dozen nested targets compare less than one
/// such time for each pair; with more, a file made for it would have its segments moved for ever.
const MAX_COMPARED: u64 = 128;
/// Voxels of all layers together, in volumes of the largest that is allowed.
const MAX_VOLUMES: u64 = 4;
/// Voxels that are looked at together.
const BLOCK: usize = 2048;

/// Layers of segment numbers, 0 where there is none.
pub(super) struct Layers<'c> {
    /// Memory of zeros takes no room until it is written to.
    layers: Vec<Vec<u16>>,
    dims: [usize; 3],
    plane: usize,
    most: usize,
    /// Of segments that have voxels.
    segments: BTreeMap<u16, Segment>,
    moved: usize,
    /// Voxels that may still be compared.
    comparable: u64,
    cancel: &'c dyn Cancel,
}

/// Where a segment has its voxels.
#[derive(Default)]
struct Segment {
    layer: usize,
    /// The slices in which it has any.
    slices: Vec<usize>,
}

impl<'c> Layers<'c> {
    /// Layers of so many voxels each, which were found to be no more than `max_voxels`.
    pub fn new(dims: [usize; 3], max_voxels: u64, cancel: &'c dyn Cancel) -> Self {
        let plane = dims[0] * dims[1];
        let total = plane * dims[2];
        let fit = max_voxels.saturating_mul(MAX_VOLUMES) / (total as u64).max(1);
        let most = usize::try_from(fit).unwrap_or(MAX_LAYERS).min(MAX_LAYERS);
        let comparable = MAX_COMPARED * total as u64;
        Self {
            layers: vec![vec![0; total]],
            dims,
            plane,
            most,
            segments: BTreeMap::new(),
            moved: 0,
            comparable,
            cancel,
        }
    }

    /// Gives a segment the voxels of a slice whose bits are set, the lowest of a byte first. The slice begins at bit
    /// `first` of the first byte; what follows it is not looked at.
    ///
    /// # Errors
    /// When segments overlap so much that there are too many layers; when it is cancelled.
    pub fn add_bits(&mut self, number: u16, slice: usize, bytes: &[u8], first: usize) -> Result<(), ReadError> {
        let mut writer = Writer::new(self, number, slice);
        let (words, rest) = bytes.as_chunks::<8>();
        let rest = {
            let mut word = [0; 8];
            word[..rest.len()].copy_from_slice(rest);
            word
        };
        for (place, word) in words.iter().chain([&rest]).enumerate() {
            let mut bits = u64::from_le_bytes(*word);
            while bits != 0 {
                let bit = 64 * place + bits.trailing_zeros() as usize;
                bits &= bits - 1;
                if bit >= first {
                    writer.set(bit - first)?;
                }
            }
        }
        Ok(())
    }

    /// Gives a segment the voxels of a slice whose value is at least `least`, which is not 0.
    ///
    /// # Errors
    /// As [`Self::add_bits`].
    pub fn add_values(&mut self, number: u16, slice: usize, values: &[u8], least: u8) -> Result<(), ReadError> {
        let mut writer = Writer::new(self, number, slice);
        for (block, first) in values.chunks(BLOCK).zip((0..).step_by(BLOCK)) {
            if block.iter().all(|value| *value < least) {
                continue;
            }
            for (value, at) in block.iter().zip(first..) {
                if *value >= least {
                    writer.set(at)?;
                }
            }
        }
        Ok(())
    }

    /// Gives the voxels of a slice to the segments that their values name; 0 is none.
    pub fn add_labels(&mut self, slice: usize, values: impl Iterator<Item = u16>) {
        let start = slice * self.plane;
        let Some(voxels) = self.layers.first_mut().and_then(|layer| layer.get_mut(start..start + self.plane)) else {
            return;
        };
        let mut last = 0;
        for (voxel, value) in voxels.iter_mut().zip(values) {
            if value != 0 {
                *voxel = value;
                if value != last {
                    self.segments.entry(value).or_default();
                    last = value;
                }
            }
        }
    }

    /// Grids of indices of labels, and the labels.
    ///
    /// # Errors
    /// When it is cancelled.
    #[expect(clippy::type_complexity, reason = "what a volume is made of")]
    pub fn finish(
        mut self,
        segments: &mut Segments,
        notices: &mut Vec<VolumeNotice>,
    ) -> Result<((Grid<u16>, Vec<Grid<u16>>), Vec<Label>), ReadError> {
        if self.moved > 0 {
            let (moved, layers) = (self.moved, self.layers.len());
            let message = format!("{moved} segments overlap others: the volume has {layers} layers");
            notices.push(VolumeNotice { code: "segments_overlap", message });
        }
        let mut index_of = vec![0_u16; usize::from(u16::MAX) + 1];
        let mut labels = Vec::new();
        for (number, index) in self.segments.keys().zip(1..=u16::MAX) {
            index_of[usize::from(*number)] = index;
            labels.push(segments.label_of(*number));
        }
        let is_in_order = self.segments.keys().zip(1..=u16::MAX).all(|(number, index)| *number == index);
        let mut grids = Vec::new();
        for mut layer in std::mem::take(&mut self.layers) {
            if !is_in_order {
                self.renumber(&mut layer, &index_of)?;
            }
            grids.push(Grid::from_vec(self.dims, layer).expect("layers have as many voxels as the dims say"));
        }
        let first = grids.remove(0);
        Ok(((first, grids), labels))
    }

    fn renumber(&self, layer: &mut [u16], index_of: &[u16]) -> Result<(), ReadError> {
        for slice in layer.chunks_mut(self.plane.max(1)) {
            self.cancel.check()?;
            for block in slice.chunks_mut(BLOCK) {
                if block.iter().all(|number| *number == 0) {
                    continue;
                }
                for number in block {
                    *number = index_of[usize::from(*number)];
                }
            }
        }
        Ok(())
    }

    /// Moves a segment to the next layer in which its voxels and one more are free; which one that is.
    fn move_up(&mut self, number: u16, more: usize) -> Result<usize, ReadError> {
        let from = self.segments.entry(number).or_default().layer;
        let slices = self.segments.get(&number).map_or(0, |segment| segment.slices.len());
        let compared = (slices * self.plane) as u64;
        let mut to = from + 1;
        while to < self.layers.len() {
            self.cancel.check()?;
            if self.comparable >= compared && self.is_free(number, from, to, more) {
                break;
            }
            self.comparable = self.comparable.saturating_sub(compared);
            to += 1;
        }
        if to >= self.most || self.comparable < compared {
            return Err(DicomFault::Overlaps { layers: self.most }.at(TagPath::top(Tag::PIXELS)));
        }
        if to == self.layers.len() {
            self.layers.push(vec![0; self.plane * self.dims[2]]);
        }
        if from == 0 {
            self.moved += 1;
        }
        let (below, above) = self.layers.split_at_mut(to);
        let segment = self.segments.entry(number).or_default();
        for slice in &segment.slices {
            let range = slice * self.plane..(slice + 1) * self.plane;
            for (old, new) in below[from][range.clone()].iter_mut().zip(&mut above[0][range]) {
                if *old == number {
                    (*old, *new) = (0, number);
                }
            }
        }
        segment.layer = to;
        Ok(to)
    }

    /// Whether a layer has room for the voxels that a segment has in another, and for one more.
    fn is_free(&self, number: u16, from: usize, to: usize, more: usize) -> bool {
        let (from, to) = (&self.layers[from], &self.layers[to]);
        let slices = self.segments.get(&number).map_or(&[][..], |segment| &segment.slices);
        let meets = |slice: &usize| {
            let range = slice * self.plane..(slice + 1) * self.plane;
            from[range.clone()].iter().zip(&to[range]).any(|(old, new)| *old == number && *new != 0)
        };
        to[more] == 0 && !slices.iter().any(meets)
    }
}

/// Writes a segment's voxels of one slice.
struct Writer<'l, 'c> {
    layers: &'l mut Layers<'c>,
    number: u16,
    slice: usize,
    start: usize,
    /// Its layer, once the slice is known to be one of its own.
    layer: Option<usize>,
}

impl<'l, 'c> Writer<'l, 'c> {
    fn new(layers: &'l mut Layers<'c>, number: u16, slice: usize) -> Self {
        let start = slice * layers.plane;
        Self { layers, number, slice, start, layer: None }
    }

    fn set(&mut self, at: usize) -> Result<(), ReadError> {
        if at >= self.layers.plane {
            return Ok(());
        }
        let layer = match self.layer {
            Some(layer) => layer,
            None => self.begin(),
        };
        let voxel = &mut self.layers.layers[layer][self.start + at];
        if *voxel == 0 || *voxel == self.number {
            *voxel = self.number;
            return Ok(());
        }
        let layer = self.layers.move_up(self.number, self.start + at)?;
        self.layers.layers[layer][self.start + at] = self.number;
        self.layer = Some(layer);
        Ok(())
    }

    fn begin(&mut self) -> usize {
        let segment = self.layers.segments.entry(self.number).or_default();
        segment.slices.push(self.slice);
        self.layer = Some(segment.layer);
        segment.layer
    }
}
