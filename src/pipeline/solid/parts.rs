//! A label as it was sent, and the parts of it that are worked on.
//!
//! A pair of organs may be sent as one label, and an organ may hang together by a neck that is too thin for the grid (`necks`).
//! Each part that holds enough of it goes through the stages by itself; what
//! is dropped is counted, and everything that is said of the label is said of all its voxels.

use std::cmp::Reverse;

use nalgebra::Vector3;

use super::NativeMask;
use super::clean::NOISE_VOXELS;
use super::cut_out::{Label, cut_out, warn_if_cut};
use super::grid::grain::{grain, grain_mm, on_grain};
use super::necks::apart;
use crate::cancel::{Cancel, Cancelled};
use crate::model::Refusal;
use crate::numerics::components::{Components, Connectivity, boundary_voxels, components};
use crate::numerics::field::{centre, id};
use crate::pipeline::context::Context;
use crate::space::{Grid, LabelVolume, VoxelIndex, WorldPoint};

/// Share of the label's voxels above which a part has figures of its own. Below it, fragments would be figures that hardly
/// change a mean; with 0.05, a colon lacks a piece of 0.047, and nearly a fifth of its surface is far from the model.
const PART_SHARE: f64 = 0.02;

/// Voxels of its grain up to which a part is a fragment: three along each axis. Of the labels of two torsos
/// three have 1, 3 and 6, all others 69 and more.
const FRAGMENT: usize = NOISE_VOXELS;

/// A label as it was sent, on its own grain.
#[derive(Clone, Debug)]
pub struct Sent {
    /// All its voxels.
    pub whole: NativeMask,
    /// How many.
    pub voxels: usize,
    /// Edges of these voxels along the axes of the file, mm.
    pub grain_mm: [f64; 3],
    /// Voxels of the file to one of these.
    pub stored_voxels: f64,
    /// The parts that are worked on, the largest first.
    pub parts: Vec<SentPart>,
}

/// A part of a label: voxels that touch, with one free voxel all around.
#[derive(Clone, Debug)]
pub struct SentPart {
    /// Its voxels.
    pub native: NativeMask,
    /// How many.
    pub voxels: usize,
    /// Where its first voxel lies in the whole.
    pub first: VoxelIndex,
}

impl Sent {
    /// Cuts a label out of the volume and finds its parts. What is too small for one is dropped with a warning.
    ///
    /// # Errors
    /// When it is cancelled.
    pub fn of(volume: &LabelVolume, label: Label, context: &Context<'_>) -> Result<Self, Cancelled> {
        warn_if_cut(volume, label, context);
        let stored = cut_out(volume, label, context)?;
        let grain = grain(&stored.mask, context)?;
        let (grain_mm, voxel_mm3) = (grain_mm(&stored, &grain), stored.world_from_voxel.voxel_volume_mm3());
        let whole = on_grain(stored, &grain, context)?;
        let stored_voxels = whole.world_from_voxel.voxel_volume_mm3() / voxel_mm3;
        let pieces = components(&whole.mask, true, Connectivity::Corners26, context)?;
        let voxels = pieces.sizes.iter().sum();
        let mut order: Vec<usize> = (0..pieces.sizes.len()).collect();
        order.sort_by_key(|&piece| Reverse(pieces.sizes[piece]));
        let least = PART_SHARE * voxels as f64;
        let mut parts = Vec::new();
        for piece in order {
            if parts.is_empty() || pieces.sizes[piece] as f64 > least {
                parts.push(part(&whole, &pieces, piece));
            }
        }
        let found = parts.len();
        let parts = apart_at_necks(parts, least, context)?;
        let pieces = pieces.sizes.len() + parts.len() - found;
        let sent = Self { whole, voxels, grain_mm, stored_voxels, parts };
        sent.warn_of_parts(pieces, context);
        Ok(sent)
    }

    /// Voxels in none of the parts.
    #[must_use]
    pub fn dropped(&self) -> usize {
        self.voxels - self.parts.iter().map(|part| part.voxels).sum::<usize>()
    }

    fn warn_of_parts(&self, pieces: usize, context: &Context<'_>) {
        let (parts, dropped) = (self.parts.len(), self.dropped());
        if parts > 1 {
            let sizes: Vec<String> = self.parts.iter().map(|part| part.voxels.to_string()).collect();
            let message =
                format!("the label is in {parts} parts, of {} voxels: each has its own figures", sizes.join(", "));
            context.warn("several_parts", message);
        }
        if dropped > 0 {
            let percent = 100.0 * dropped as f64 / self.voxels as f64;
            let message = format!(
                "{parts} of {pieces} parts of the label were kept; {dropped} voxels, {percent:.2} % of it, were dropped"
            );
            context.warn("stray_voxels_dropped", message);
        }
    }

    /// What is on the label's surface but in none of these parts.
    ///
    /// # Errors
    /// When it is cancelled.
    pub fn surface_outside(&self, parts: &[usize], cancel: &dyn Cancel) -> Result<Vec<WorldPoint>, Cancelled> {
        if self.voxels == parts.iter().map(|&part| self.parts[part].voxels).sum::<usize>() {
            return Ok(Vec::new());
        }
        let mut rest = self.whole.mask.clone();
        for &part in parts {
            self.parts[part].take_out_of(&mut rest);
        }
        Ok(self.whole.places(&boundary_voxels(&rest, true, cancel)?))
    }
}

/// The parts with those by themselves that hang on by a neck, the largest first.
fn apart_at_necks(mut parts: Vec<SentPart>, least: f64, context: &Context<'_>) -> Result<Vec<SentPart>, Cancelled> {
    let mut done = 0;
    while done < parts.len() {
        match apart(&parts[done], least, context)? {
            Some([rest, clump]) => {
                parts[done] = rest;
                parts.push(clump);
            }
            None => done += 1,
        }
    }
    parts.sort_by_key(|part| Reverse(part.voxels));
    Ok(parts)
}

impl SentPart {
    /// The largest connected piece of some of its voxels, as a part of the same whole; `None` of no voxels.
    ///
    /// # Errors
    /// When it is cancelled.
    pub(super) fn within(&self, some: &Grid<bool>, cancel: &dyn Cancel) -> Result<Option<Self>, Cancelled> {
        let pieces = components(some, true, Connectivity::Corners26, cancel)?;
        let Some(largest) = pieces.largest() else { return Ok(None) };
        let own = NativeMask { mask: some.clone(), ..self.native };
        let within = part(&own, &pieces, largest as usize);
        Ok(Some(Self { first: [0, 1, 2].map(|axis| self.first[axis] + within.first[axis]), ..within }))
    }

    /// Refuses a part that is a fragment.
    ///
    /// # Errors
    /// [`Refusal::Fragment`].
    pub fn refuse_fragment(&self) -> Result<(), Refusal> {
        if self.voxels > FRAGMENT { Ok(()) } else { Err(Refusal::Fragment { voxels: self.voxels }) }
    }

    /// Clears its voxels in a grid of the whole.
    fn take_out_of(&self, whole: &mut Grid<bool>) {
        let own = &self.native.mask;
        for (offset, is_own) in own.as_slice().iter().enumerate() {
            if *is_own {
                let at = own.index(offset);
                whole[[0, 1, 2].map(|axis| at[axis] + self.first[axis])] = false;
            }
        }
    }
}

fn part(whole: &NativeMask, pieces: &Components, piece: usize) -> SentPart {
    let (mask, first) = pieces.cut_out(id(piece), whole.mask.dims()[1]);
    let shift = Vector3::from(first.map(|x| x as f64));
    let native = NativeMask { mask, world_from_voxel: whole.world_from_voxel.shifted_to(shift), ..*whole };
    SentPart { native, voxels: pieces.sizes[piece], first }
}

impl NativeMask {
    /// Where voxels lie in the world, by their offsets.
    pub(super) fn places(&self, voxels: &[usize]) -> Vec<WorldPoint> {
        voxels.iter().map(|&voxel| self.world_from_voxel.point(centre(self.mask.index(voxel)))).collect()
    }
}
