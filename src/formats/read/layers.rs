//! Layers of a file → a label volume. A file with segments that overlap holds several label maps of one volume; the
//! same value is another segment in each.

use std::collections::{BTreeMap, BTreeSet};

use super::error::ReadError;
use super::stored::Stored;
use super::voxels::Voxels;
use crate::cancel::Cancel;
use crate::space::{Grid, Label, LabelVolume, VolumeNotice, WorldFromVoxel};

/// Layers that a volume has at most. Files of planned radiation with a dozen nested targets need as many; with more, each layer of
/// a file made for it would be compared with all others for ever.
pub(super) const MAX_LAYERS: usize = 64;
/// Voxels between two looks at whether to go on.
const SLICE: usize = 1 << 20;

/// What a file says of its segments, by layer and value.
#[derive(Debug, Default, PartialEq)]
pub(super) struct Segments {
    told: BTreeMap<(usize, i64), Segment>,
    /// The last number.
    last: i64,
}

#[derive(Debug, PartialEq)]
struct Segment {
    /// In the file, from 1: its label where values are not unique.
    number: i64,
    label: Label,
}

impl Segments {
    /// Of a file with one layer, by value.
    pub fn of_values(labels: BTreeMap<i64, Label>) -> Self {
        let mut segments = Self::default();
        for (number, label) in (1..).zip(labels.into_values()) {
            segments.add(number, 0, label);
        }
        segments
    }

    /// Adds one, with its number in the file from 1; of two with the same value in the same layer the first counts.
    pub fn add(&mut self, number: i64, layer: usize, label: Label) {
        self.last = self.last.max(number);
        self.told.entry((layer, label.value)).or_insert(Segment { number, label });
    }

    fn number(&self, found: Place) -> Option<i64> {
        self.told.get(&(found.layer, found.value)).map(|segment| segment.number)
    }

    /// With the name and colour of what is at a place.
    fn label(&self, found: Place, value: i64) -> Label {
        match self.told.get(&(found.layer, found.value)) {
            Some(Segment { label, .. }) => Label { value, ..label.clone() },
            None => Label::new(value),
        }
    }
}

/// Where a segment was found.
#[derive(Clone, Copy)]
struct Place {
    layer: usize,
    /// Its index there.
    index: u16,
    /// Its value there.
    value: i64,
}

/// The volume of what was read.
///
/// # Errors
/// When there are too many segments or layers, or it is cancelled.
pub(super) fn label_volume(
    voxels: Voxels,
    stored: &Stored,
    segments: &Segments,
    world_from_voxel: WorldFromVoxel,
    mut notices: Vec<VolumeNotice>,
    cancel: &dyn Cancel,
) -> Result<LabelVolume, ReadError> {
    voxels.tell(&mut notices);
    let found = places(&voxels, cancel)?;
    let numbers = numbers(&found, segments, &mut notices);
    let (labels, new_of_old) = renumbered(&found, &numbers, segments, &voxels)?;
    let (first, further) = packed(voxels.layers, &new_of_old, stored, cancel)?;
    let grid = |layer| Grid::from_vec(stored.dims, layer).expect("layers are padded to the voxels of the volume");
    let layers = (grid(first), further.into_iter().map(grid).collect());
    Ok(LabelVolume::new_while(layers, labels, world_from_voxel, cancel)?.with_notices(notices))
}

/// What is in which layer: of a single one, all that was met.
fn places(voxels: &Voxels, cancel: &dyn Cancel) -> Result<Vec<Place>, ReadError> {
    let mut found = Vec::new();
    for (layer, indices) in voxels.layers.iter().enumerate() {
        let is_met = if voxels.layers.len() == 1 {
            vec![true; voxels.labels.len() + 1]
        } else {
            met(indices, voxels.labels.len(), cancel)?
        };
        for ((index, label), is_met) in (1..=u16::MAX).zip(&voxels.labels).zip(&is_met[1..]) {
            if *is_met {
                if found.len() == usize::from(u16::MAX) {
                    return Err(ReadError::TooManyLabels { allowed: usize::from(u16::MAX) });
                }
                found.push(Place { layer, index, value: label.value });
            }
        }
    }
    Ok(found)
}

/// Which indices a layer has.
fn met(indices: &[u16], labels: usize, cancel: &dyn Cancel) -> Result<Vec<bool>, ReadError> {
    let mut is_met = vec![false; labels + 1];
    for slice in indices.chunks(SLICE) {
        cancel.check()?;
        for index in slice {
            is_met[usize::from(*index)] = true;
        }
    }
    Ok(is_met)
}

/// The value that each is to have: its own where those of all layers differ, else its number among the segments.
fn numbers(found: &[Place], segments: &Segments, notices: &mut Vec<VolumeNotice>) -> Vec<i64> {
    let different: BTreeSet<i64> = found.iter().map(|place| place.value).collect();
    if different.len() == found.len() {
        return found.iter().map(|place| place.value).collect();
    }
    let message = "segments of different layers have the same value: labels are their numbers in the order of the \
                   file, from 1"
        .to_owned();
    notices.push(VolumeNotice { code: "labels_renumbered", message });
    let mut unnamed = segments.last.saturating_add(1)..;
    let mut number = |place: &Place| segments.number(*place).or_else(|| unnamed.next()).unwrap_or(i64::MAX);
    found.iter().map(&mut number).collect()
}

/// New index by layer and old index.
type NewOfOld = Vec<Vec<u16>>;

/// The labels, ascending by their new values.
fn renumbered(
    found: &[Place],
    numbers: &[i64],
    segments: &Segments,
    voxels: &Voxels,
) -> Result<(Vec<Label>, NewOfOld), ReadError> {
    let mut order: Vec<(i64, Place)> = numbers.iter().copied().zip(found.iter().copied()).collect();
    order.sort_by_key(|(number, _)| *number);
    let mut new_of_old = vec![vec![0; voxels.labels.len() + 1]; voxels.layers.len()];
    let mut labels = Vec::new();
    for (number, place) in order {
        labels.push(segments.label(place, number));
        let too_many = |_| ReadError::TooManyLabels { allowed: usize::from(u16::MAX) };
        new_of_old[place.layer][usize::from(place.index)] = u16::try_from(labels.len()).map_err(too_many)?;
    }
    Ok((labels, new_of_old))
}

/// Layers over the same voxels, of which no two could be one; the first one, which there always is, and the others.
type Kept = (Vec<u16>, Vec<Vec<u16>>);

/// Layers with new indices, each added to the first one in which it meets nothing.
fn packed(
    layers: Vec<Vec<u16>>,
    new_of_old: &NewOfOld,
    stored: &Stored,
    cancel: &dyn Cancel,
) -> Result<Kept, ReadError> {
    // The labels of a single one are in order already.
    let is_in_order = layers.len() == 1;
    let mut all: Vec<Vec<u16>> = Vec::new();
    for (mut layer, new) in layers.into_iter().zip(new_of_old) {
        if !is_in_order {
            renumber(&mut layer, new, cancel)?;
        }
        let mut is_added = false;
        for kept in &mut all {
            cancel.check()?;
            if !meet(kept, &layer) {
                add(kept, &layer);
                is_added = true;
                break;
            }
        }
        if is_added {
            continue;
        }
        if all.len() == MAX_LAYERS {
            return Err(ReadError::TooManyLayers { allowed: MAX_LAYERS });
        }
        all.push(padded(layer, stored.voxels));
    }
    let mut all = all.into_iter();
    Ok((all.next().unwrap_or_else(|| vec![0; stored.voxels]), all.collect()))
}

fn renumber(layer: &mut [u16], new: &[u16], cancel: &dyn Cancel) -> Result<(), ReadError> {
    for slice in layer.chunks_mut(SLICE) {
        cancel.check()?;
        for index in slice {
            // The background has none.
            *index = new[usize::from(*index)];
        }
    }
    Ok(())
}

/// A layer with the background after its last label.
fn padded(mut layer: Vec<u16>, voxels: usize) -> Vec<u16> {
    if layer.len() < voxels {
        let mut full = vec![0; voxels];
        add(&mut full, &layer);
        layer = full;
    }
    layer
}

/// Whether there is a voxel that both have.
fn meet(kept: &[u16], layer: &[u16]) -> bool {
    kept.iter().zip(layer).any(|(kept, index)| *kept != 0 && *index != 0)
}

/// Adds what is no background; memory of zeros takes no room until it is written to.
fn add(kept: &mut [u16], layer: &[u16]) {
    for (kept, index) in kept.iter_mut().zip(layer) {
        if *index != 0 {
            *kept = *index;
        }
    }
}
