//! Voxels as stored → indices of labels, in chunks, two bytes a voxel.

use std::collections::HashMap;

use super::kind::ByteOrder;
use super::layout::{Datatype, Layout, Scaling};
use crate::cancel::Cancel;
use crate::formats::read::error::ReadError;
use crate::formats::read::stream::Stream;
use crate::space::{Label, ascending};

/// Bytes decoded at a time, a multiple of every datatype's size.
const CHUNK_BYTES: usize = 1 << 18;
/// Voxels for which room is reserved before any has come: a header may lie about the rest.
const FIRST_RESERVATION: usize = 1 << 20;
/// Voxels that are kept or left out together: a page of memory.
const BLOCK: usize = 2048;
/// How far from a whole number a label may be after scaling: float32 volumes that went through
/// a resampler with nearest neighbours stay within it, interpolated ones do not.
const WHOLE_NUMBER_TOLERANCE: f64 = 1e-3;
/// Stored values remembered. Label maps have few; a float image has millions, which would cost
/// more memory than its voxels.
const MAX_REMEMBERED: usize = 1 << 17;
/// A stored value that was not met yet.
const UNSEEN: u32 = u32::MAX;
/// Floats hold every whole number up to here.
const MAX_EXACT: f64 = 9_007_199_254_740_992.0;

/// A label map before it has a place in the world.
#[derive(Debug)]
pub(super) struct Voxels {
    /// Index of a label per voxel, 0 for the background.
    pub indices: Vec<u16>,
    /// Ascending; every one has a voxel.
    pub labels: Vec<Label>,
    /// Voxels that were NaN and count as background.
    pub nan_voxels: u64,
}

/// Reads exactly `layout.voxels` voxels.
pub(super) fn read_voxels(stream: &mut Stream<'_>, layout: &Layout) -> Result<Voxels, ReadError> {
    let size = layout.datatype.bytes();
    let mut table = Table::new(layout);
    let mut indices = Indices::new(layout.voxels);
    let (mut buffer, mut chunk) = (vec![0; CHUNK_BYTES], Vec::with_capacity(CHUNK_BYTES / size));
    while indices.filled < layout.voxels {
        let wanted = ((layout.voxels - indices.filled) * size).min(CHUNK_BYTES);
        let got = stream.fill(&mut buffer[..wanted])?;
        if got < wanted {
            let expected = layout.offset + (layout.voxels * size) as u64;
            return Err(ReadError::Truncated { expected, got: stream.position() });
        }
        chunk.clear();
        table.decode(&buffer[..wanted], indices.filled, &mut chunk)?;
        indices.take(&chunk);
    }
    table.finish(indices.kept, stream.cancel())
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
        Self { kept: vec![0; total.min(FIRST_RESERVATION)], filled: 0, total }
    }

    /// Doubles as a vector does, but never beyond what the volume needs.
    fn take(&mut self, chunk: &[u16]) {
        let end = self.filled + chunk.len();
        if end > self.kept.len() {
            let mut larger = vec![0; (2 * self.kept.len()).max(end).min(self.total)];
            copy_all_but_background(&self.kept[..self.filled], &mut larger);
            self.kept = larger;
        }
        copy_all_but_background(chunk, &mut self.kept[self.filled..end]);
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
struct Table {
    datatype: Datatype,
    order: ByteOrder,
    scaling: Option<Scaling>,
    dims: [usize; 3],
    /// By bit pattern, for stored values of one or two bytes.
    small: Vec<u32>,
    /// By bit pattern, for wider ones.
    wide: HashMap<u64, u16>,
    by_label: HashMap<i64, u16>,
    /// By index; NaN has one of its own until the end, with the value of the background, which it joins.
    labels: Vec<i64>,
    nan: Option<u16>,
}

impl Table {
    fn new(layout: &Layout) -> Self {
        let small = match layout.datatype.bytes() {
            1 => 1 << 8,
            2 => 1 << 16,
            _ => 0,
        };
        Self {
            datatype: layout.datatype,
            order: layout.order,
            scaling: layout.scaling,
            dims: layout.dims,
            small: vec![UNSEEN; small],
            wide: HashMap::new(),
            by_label: HashMap::from([(0, 0)]),
            labels: vec![0],
            nan: None,
        }
    }

    fn decode(&mut self, bytes: &[u8], first: usize, chunk: &mut Vec<u16>) -> Result<(), ReadError> {
        match (self.datatype.bytes(), self.order) {
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
        let label = match (self.stored(pattern), self.scaling) {
            (Stored::Whole(value), None) => i64::try_from(value).map_err(|_| self.no_label(value as f64, offset))?,
            (Stored::Whole(value), Some(scaling)) => self.whole(scaled(value as f64, scaling), offset)?,
            (Stored::Real(value), _) if value.is_nan() => return self.nan_index(),
            (Stored::Real(value), None) => self.whole(value, offset)?,
            (Stored::Real(value), Some(scaling)) => self.whole(scaled(value, scaling), offset)?,
        };
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
    fn stored(&self, pattern: u64) -> Stored {
        match self.datatype {
            Datatype::Uint8 | Datatype::Uint16 | Datatype::Uint32 | Datatype::Uint64 => {
                Stored::Whole(i128::from(pattern))
            }
            Datatype::Int8 => Stored::Whole(i128::from((pattern as u8).cast_signed())),
            Datatype::Int16 => Stored::Whole(i128::from((pattern as u16).cast_signed())),
            Datatype::Int32 => Stored::Whole(i128::from((pattern as u32).cast_signed())),
            Datatype::Int64 => Stored::Whole(i128::from(pattern.cast_signed())),
            Datatype::Float32 => Stored::Real(f64::from(f32::from_bits(pattern as u32))),
            Datatype::Float64 => Stored::Real(f64::from_bits(pattern)),
        }
    }

    fn whole(&self, value: f64, offset: usize) -> Result<i64, ReadError> {
        let rounded = value.round();
        // Also false for infinities.
        if (value - rounded).abs() <= WHOLE_NUMBER_TOLERANCE && rounded.abs() <= MAX_EXACT {
            #[allow(clippy::cast_possible_truncation, reason = "whole and below 2^53")]
            return Ok(rounded as i64);
        }
        Err(self.no_label(value, offset))
    }

    fn no_label(&self, value: f64, offset: usize) -> ReadError {
        let [nx, ny, _] = self.dims;
        let voxel = [offset % nx, offset / nx % ny, offset / (nx * ny)].map(|n| n as u64);
        ReadError::NotALabelMap { voxel, value }
    }

    /// Sorts the labels, and joins NaN to the background.
    fn finish(self, mut indices: Vec<u16>, cancel: &dyn Cancel) -> Result<Voxels, ReadError> {
        let (new_of_old, labels) = ascending(&self.labels);
        let is_in_order = (0..=u16::MAX).zip(&new_of_old).all(|(old, new)| old == *new);
        let nan_voxels = if is_in_order { 0 } else { renumber(&mut indices, &new_of_old, self.nan, cancel)? };
        Ok(Voxels { indices, labels, nan_voxels })
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

enum Stored {
    Whole(i128),
    Real(f64),
}

fn scaled(value: f64, scaling: Scaling) -> f64 {
    value * scaling.slope + scaling.intercept
}

fn patterns<const N: usize>(bytes: &[u8]) -> impl Iterator<Item = [u8; N]> + '_ {
    bytes.as_chunks::<N>().0.iter().copied()
}
