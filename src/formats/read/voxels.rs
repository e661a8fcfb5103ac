//! Voxels as stored → indices of labels, in chunks, two bytes a voxel.

use std::collections::HashMap;

use super::error::ReadError;
use super::stored::{ByteOrder, Datatype, Layers, Scaling, Stored};
use super::stream::Values;
use crate::cancel::Cancel;
use crate::space::{Label, VolumeNotice, ascending, significant};

/// Bytes decoded at a time, a multiple of every datatype's size.
const CHUNK_BYTES: usize = 1 << 18;
/// Voxels for which room is reserved at first: a header may lie about the rest.
const FIRST_RESERVATION: usize = 1 << 20;
/// Voxels that are kept or left out together: a page of memory.
const BLOCK: usize = 2048;
/// How far from a whole number a label may be after scaling: float32 volumes that went through
/// a resampler with nearest neighbours stay within it, interpolated ones do not.
const WHOLE_NUMBER_TOLERANCE: f64 = 1e-3;
/// Slope up to which labels can have been made integers by a writer that scales: the value read is off by half a step
/// at most, a quarter here. With a larger one most fractions would pass as whole, with a much smaller one an atlas of a
/// hundred labels in uint8 (0.46) would be refused.
const MAX_STEP: f64 = 0.5;
/// Stored values remembered. Label maps have few; a float image has millions, which would cost
/// more memory than its voxels.
const MAX_REMEMBERED: usize = 1 << 17;
/// A stored value that was not met yet.
const UNSEEN: u32 = u32::MAX;
/// The largest label that is looked for in the other byte order. Read in the wrong one, those up to here are below 1e-37;
/// with a larger one some small values of a map of probabilities would be taken for labels.
const MAX_SWAPPED: f64 = 65_536.0;
/// Labels named where they may be in the wrong byte order.
const NAMED: usize = 5;
/// Floats hold every whole number up to here.
const MAX_EXACT: f64 = 9_007_199_254_740_992.0;

/// A label map before it has a place in the world.
#[derive(Debug)]
pub(super) struct Voxels {
    /// Index of a label per voxel, 0 for the background; of every layer. What is missing at the end is background.
    pub layers: Vec<Vec<u16>>,
    /// Ascending; every one has a voxel in a layer.
    pub labels: Vec<Label>,
    /// Voxels that were NaN and count as background.
    pub nan_voxels: u64,
    /// How far the farthest scaled value was from its label, if farther than rounding makes it.
    pub rounded_by: Option<f64>,
    /// Labels as the other byte order would have them, the first few, where that is the likelier one.
    pub swapped_labels: Vec<i64>,
}

impl Voxels {
    /// What was odd about the values.
    pub fn tell(&self, notices: &mut Vec<VolumeNotice>) {
        let mut tell = |code, message| notices.push(VolumeNotice { code, message });
        if self.nan_voxels > 0 {
            tell("nan_voxels", format!("{} voxels are NaN; they were taken as background", self.nan_voxels));
        }
        if let Some(by) = self.rounded_by {
            let by = significant(by);
            tell(
                "labels_rounded",
                format!("the file scales its values (scl_slope): labels were rounded, by up to {by}"),
            );
        }
        if !self.swapped_labels.is_empty() {
            let message = format!(
                "every label fills the upper half of its bytes alone: header and voxels may have different byte orders; \
                 in the other one the labels are {:?}",
                self.swapped_labels
            );
            tell("byte_order_doubtful", message);
        }
    }
}

/// Reads exactly as many values as are said to be there.
///
/// # Errors
/// When they end early, cannot be read, or are no labels.
pub(super) fn read_voxels(source: &mut impl Values, stored: &Stored) -> Result<Voxels, ReadError> {
    let size = stored.datatype.bytes();
    let start = source.position();
    let mut table = Table::new(stored);
    let mut layers = Dealt::new(stored);
    let (mut buffer, mut chunk) = (vec![0; CHUNK_BYTES], Vec::with_capacity(CHUNK_BYTES / size));
    while layers.dealt < stored.values() {
        let wanted = size * layers.next_count(CHUNK_BYTES / size);
        let got = source.fill(&mut buffer[..wanted])?;
        if got < wanted {
            let before = (layers.dealt * size) as u64;
            return Err(ReadError::Truncated {
                expected: start.saturating_add(stored.bytes()),
                got: start + before + got as u64,
            });
        }
        chunk.clear();
        table.decode(&buffer[..wanted], layers.dealt, &mut chunk)?;
        layers.take(&chunk);
    }
    let kept = layers.layers.into_iter().map(|layer| layer.kept).collect();
    table.finish(kept, source.cancel())
}

/// Indices dealt to the layers that they belong to.
struct Dealt {
    layers: Vec<Indices>,
    order: Layers,
    voxels: usize,
    /// Of all layers.
    dealt: usize,
    /// Those of one layer.
    hand: Vec<u16>,
}

impl Dealt {
    fn new(stored: &Stored) -> Self {
        let layers = (0..stored.layers.count).map(|_| Indices::new(stored.voxels)).collect();
        Self { layers, order: stored.layers, voxels: stored.voxels, dealt: 0, hand: Vec::new() }
    }

    /// How many values to read next, of at most `most`: all layers of every voxel where they are interleaved, else
    /// no further than the end of a layer.
    fn next_count(&self, most: usize) -> usize {
        if self.order.are_interleaved {
            let voxels_left = self.voxels - self.dealt / self.order.count;
            return (most / self.order.count).clamp(1, voxels_left) * self.order.count;
        }
        most.min(self.voxels - self.dealt % self.voxels)
    }

    fn take(&mut self, chunk: &[u16]) {
        if self.order.are_interleaved && self.order.count > 1 {
            for (first, layer) in self.layers.iter_mut().enumerate() {
                self.hand.clear();
                self.hand.extend(chunk.iter().skip(first).step_by(self.order.count));
                layer.take(&self.hand);
            }
        } else if let Some(layer) = self.layers.get_mut(self.dealt / self.voxels) {
            layer.take(chunk);
        }
        self.dealt += chunk.len();
    }
}

/// Indices as they come. Memory of zeros takes no room until it is written to, and background is not
/// written: a volume of nothing, gigabytes of it in a small file, takes next to none.
struct Indices {
    kept: Vec<u16>,
    filled: usize,
    total: usize,
}

impl Indices {
    fn new(total: usize) -> Self {
        Self { kept: Vec::new(), filled: 0, total }
    }

    /// Doubles as a vector does, but never beyond what the volume needs, and not for background.
    fn take(&mut self, chunk: &[u16]) {
        let end = self.filled + chunk.len();
        if end > self.kept.len() && chunk.iter().any(|index| *index != 0) {
            let mut larger = vec![0; (2 * self.kept.len()).max(end).max(FIRST_RESERVATION).min(self.total)];
            copy_all_but_background(&self.kept, &mut larger);
            self.kept = larger;
        }
        if let Some(place) = self.kept.get_mut(self.filled..end) {
            copy_all_but_background(chunk, place);
        }
        self.filled = end;
    }
}

/// Copies to memory of zeros.
fn copy_all_but_background(from: &[u16], to: &mut [u16]) {
    for (from, to) in from.chunks(BLOCK).zip(to.chunks_mut(BLOCK)) {
        if from.iter().any(|index| *index != 0) {
            to[..from.len()].copy_from_slice(from);
        }
    }
}

/// From stored bit patterns to indices, in the order in which labels were met.
struct Table<'a> {
    stored: &'a Stored,
    /// By bit pattern, for stored values of one or two bytes.
    small: Vec<u32>,
    /// By bit pattern, for wider ones.
    wide: HashMap<u64, u16>,
    by_label: HashMap<i64, u16>,
    /// By index; NaN has one of its own until the end, with the value of the background, which it joins.
    labels: Vec<i64>,
    nan: Option<u16>,
    /// How far a value may be from a label, and the farthest was.
    tolerance: f64,
    farthest: f64,
    /// The first stored value, and its offset, that is not 0 but was taken for it.
    near_zero: Option<(u64, usize)>,
}

impl<'a> Table<'a> {
    fn new(stored: &'a Stored) -> Self {
        let small = match stored.datatype.bytes() {
            1 => 1 << 8,
            2 => 1 << 16,
            _ => 0,
        };
        Self {
            stored,
            small: vec![UNSEEN; small],
            wide: HashMap::new(),
            by_label: HashMap::from([(0, 0)]),
            labels: vec![0],
            nan: None,
            tolerance: tolerance(stored),
            farthest: 0.0,
            near_zero: None,
        }
    }

    fn decode(&mut self, bytes: &[u8], first: usize, chunk: &mut Vec<u16>) -> Result<(), ReadError> {
        match (self.stored.datatype.bytes(), self.stored.order) {
            (1, _) => self.decode_small(bytes.iter().map(|b| u16::from(*b)), first, chunk),
            (2, ByteOrder::Little) => self.decode_small(patterns(bytes).map(u16::from_le_bytes), first, chunk),
            (2, ByteOrder::Big) => self.decode_small(patterns(bytes).map(u16::from_be_bytes), first, chunk),
            (4, ByteOrder::Little) => {
                self.decode_wide(patterns(bytes).map(|b| u64::from(u32::from_le_bytes(b))), first, chunk)
            }
            (4, ByteOrder::Big) => {
                self.decode_wide(patterns(bytes).map(|b| u64::from(u32::from_be_bytes(b))), first, chunk)
            }
            (_, ByteOrder::Little) => self.decode_wide(patterns(bytes).map(u64::from_le_bytes), first, chunk),
            (_, ByteOrder::Big) => self.decode_wide(patterns(bytes).map(u64::from_be_bytes), first, chunk),
        }
    }

    fn decode_small(
        &mut self,
        values: impl Iterator<Item = u16>,
        first: usize,
        chunk: &mut Vec<u16>,
    ) -> Result<(), ReadError> {
        for pattern in values {
            let mut index = self.small[usize::from(pattern)];
            if index == UNSEEN {
                index = u32::from(self.index_of(u64::from(pattern), first + chunk.len())?);
                self.small[usize::from(pattern)] = index;
            }
            #[allow(clippy::cast_possible_truncation, reason = "every entry but UNSEEN came from a u16")]
            chunk.push(index as u16);
        }
        Ok(())
    }

    fn decode_wide(
        &mut self,
        values: impl Iterator<Item = u64>,
        first: usize,
        chunk: &mut Vec<u16>,
    ) -> Result<(), ReadError> {
        // Neighbours are mostly alike: ask the map only when the pattern changes.
        let mut last: Option<(u64, u16)> = None;
        for pattern in values {
            let index = match last {
                Some((same, index)) if same == pattern => index,
                _ => self.remembered(pattern, first + chunk.len())?,
            };
            last = Some((pattern, index));
            chunk.push(index);
        }
        Ok(())
    }

    fn remembered(&mut self, pattern: u64, offset: usize) -> Result<u16, ReadError> {
        if let Some(index) = self.wide.get(&pattern) {
            return Ok(*index);
        }
        let index = self.index_of(pattern, offset)?;
        if self.wide.len() < MAX_REMEMBERED {
            self.wide.insert(pattern, index);
        }
        Ok(index)
    }

    /// The slow way: decode, scale, check, and look the label up or add it.
    fn index_of(&mut self, pattern: u64, offset: usize) -> Result<u16, ReadError> {
        let label = match (self.number(pattern), self.stored.scaling) {
            (Number::Whole(value), None) => i64::try_from(value).map_err(|_| self.no_label(value as f64, offset))?,
            (Number::Whole(value), Some(scaling)) => self.whole(scaling.value(value as f64), offset)?,
            (Number::Real(value), _) if value.is_nan() => return self.nan_index(),
            (Number::Real(value), None) => self.whole(value, offset)?,
            (Number::Real(value), Some(scaling)) => self.whole(scaling.value(value), offset)?,
        };
        if label == 0 && self.near_zero.is_none() && !self.stored.datatype.is_whole() && self.real(pattern) != 0.0 {
            self.near_zero = Some((pattern, offset));
        }
        if let Some(index) = self.by_label.get(&label) {
            return Ok(*index);
        }
        let index = self.add(label)?;
        self.by_label.insert(label, index);
        Ok(index)
    }

    fn nan_index(&mut self) -> Result<u16, ReadError> {
        match self.nan {
            Some(index) => Ok(index),
            None => {
                let index = self.add(0)?;
                self.nan = Some(index);
                Ok(index)
            }
        }
    }

    fn add(&mut self, label: i64) -> Result<u16, ReadError> {
        let index = u16::try_from(self.labels.len())
            .map_err(|_| ReadError::TooManyLabels { allowed: usize::from(u16::MAX) })?;
        self.labels.push(label);
        Ok(index)
    }

    #[allow(
        clippy::cast_possible_truncation,
        reason = "a pattern of n bytes has zeros above them; each arm takes its n bytes back"
    )]
    fn number(&self, pattern: u64) -> Number {
        match self.stored.datatype {
            Datatype::Uint8 | Datatype::Uint16 | Datatype::Uint32 | Datatype::Uint64 => {
                Number::Whole(i128::from(pattern))
            }
            Datatype::Int8 => Number::Whole(i128::from((pattern as u8).cast_signed())),
            Datatype::Int16 => Number::Whole(i128::from((pattern as u16).cast_signed())),
            Datatype::Int32 => Number::Whole(i128::from((pattern as u32).cast_signed())),
            Datatype::Int64 => Number::Whole(i128::from(pattern.cast_signed())),
            Datatype::Float32 => Number::Real(f64::from(f32::from_bits(pattern as u32))),
            Datatype::Float64 => Number::Real(f64::from_bits(pattern)),
        }
    }

    fn whole(&mut self, value: f64, offset: usize) -> Result<i64, ReadError> {
        let rounded = value.round();
        let off = (value - rounded).abs();
        // Also false for infinities.
        if off <= self.tolerance && rounded.abs() <= MAX_EXACT {
            self.farthest = self.farthest.max(off);
            #[allow(clippy::cast_possible_truncation, reason = "whole and below 2^53")]
            return Ok(rounded as i64);
        }
        Err(self.no_label(value, offset))
    }

    fn no_label(&self, value: f64, offset: usize) -> ReadError {
        ReadError::NotALabelMap { voxel: self.stored.voxel(offset), value, is_scaled: self.stored.scaling.is_some() }
    }

    /// Sorts the labels, and joins NaN to the background.
    fn finish(self, mut layers: Vec<Vec<u16>>, cancel: &dyn Cancel) -> Result<Voxels, ReadError> {
        let (new_of_old, labels) = ascending(&self.labels);
        if let (Some((pattern, offset)), true) = (self.near_zero, labels.is_empty()) {
            return Err(self.nothing_but_near_zero(pattern, offset));
        }
        let swapped_labels = self.swapped(&labels);
        let rounded_by = (self.farthest > WHOLE_NUMBER_TOLERANCE).then_some(self.farthest);
        let is_in_order = (0..=u16::MAX).zip(&new_of_old).all(|(old, new)| old == *new);
        let mut nan_voxels = 0;
        if !is_in_order {
            for layer in &mut layers {
                nan_voxels += renumber(layer, &new_of_old, self.nan, cancel)?;
            }
        }
        Ok(Voxels { layers, labels, nan_voxels, rounded_by, swapped_labels })
    }

    /// Why a volume has no label although it is not all 0: its bytes are reversed, or its values are too small.
    fn nothing_but_near_zero(&self, pattern: u64, offset: usize) -> ReadError {
        let (value, swapped) = (self.real(pattern), self.real(self.reversed(pattern)));
        if swapped != 0.0 && swapped.fract() == 0.0 && swapped.abs() <= MAX_SWAPPED {
            return ReadError::WrongByteOrder { voxel: self.stored.voxel(offset), value, swapped };
        }
        self.no_label(self.stored.scaling.map_or(value, |scaling| scaling.value(value)), offset)
    }

    /// Small whole numbers in the wrong byte order fill the upper half of their bytes alone: 1 is read as 256 or
    /// 16777216. Where all labels do, what they are in the other order; else nothing.
    fn swapped(&self, labels: &[Label]) -> Vec<i64> {
        let mut swapped = Vec::new();
        if !self.stored.datatype.is_whole() || self.stored.datatype.bytes() == 1 || self.stored.scaling.is_some() {
            return swapped;
        }
        let half = 4 * self.stored.datatype.bytes();
        for label in labels {
            if (label.value.trailing_zeros() as usize) < half {
                return Vec::new();
            }
            swapped.push(self.reversed(label.value.cast_unsigned()).cast_signed());
        }
        swapped.truncate(NAMED);
        swapped
    }

    /// A stored value as a real number.
    fn real(&self, pattern: u64) -> f64 {
        match self.number(pattern) {
            Number::Whole(value) => value as f64,
            Number::Real(value) => value,
        }
    }

    /// A pattern with its bytes in the other order.
    fn reversed(&self, pattern: u64) -> u64 {
        pattern.swap_bytes() >> (64 - 8 * self.stored.datatype.bytes())
    }
}

/// Gives every voxel the new index of its label; how many voxels were NaN.
fn renumber(indices: &mut [u16], new_of_old: &[u16], nan: Option<u16>, cancel: &dyn Cancel) -> Result<u64, ReadError> {
    /// Voxels between two looks at whether to go on.
    const SLICE: usize = 1 << 20;
    let mut nan_voxels = 0;
    for slice in indices.chunks_mut(SLICE) {
        cancel.check()?;
        for run in slice.chunk_by_mut(|a, b| a == b) {
            let (old, new) = (run[0], new_of_old[usize::from(run[0])]);
            if nan == Some(old) {
                nan_voxels += run.len() as u64;
            }
            if new != old {
                run.fill(new);
            }
        }
    }
    Ok(nan_voxels)
}

enum Number {
    Whole(i128),
    Real(f64),
}

/// How far from a whole number a label may be. A writer that scaled labels to fit them into integers left every one half
/// a step away at most.
fn tolerance(stored: &Stored) -> f64 {
    match stored.scaling {
        Some(Scaling { slope, .. }) if stored.datatype.is_whole() && slope.abs() <= MAX_STEP => {
            // The slope itself is rounded.
            WHOLE_NUMBER_TOLERANCE + 0.5 * slope.abs()
        }
        _ => WHOLE_NUMBER_TOLERANCE,
    }
}

fn patterns<const N: usize>(bytes: &[u8]) -> impl Iterator<Item = [u8; N]> + '_ {
    bytes.as_chunks::<N>().0.iter().copied()
}
