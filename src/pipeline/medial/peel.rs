//! Step 2, before the ordered thinning: what lies far from all medial voxels is taken away, by all
//! threads together.
//!
//! It goes in bands of depth. Inside a band the order decides nothing, for in the end all of it goes;
//! what topology holds back is left to the ordered thinning. A band is gone through in eight parts, by
//! the parity of the voxel's indices: voxels of one part do not touch, so that each may go, or not,
//! whatever the others do (Bertrand, Aktouf, *A three-dimensional thinning algorithm using subfields*,
//! SPIE 2356, 1994). So the outcome does not depend on the threads either.

use std::sync::atomic::{AtomicU8, Ordering::Relaxed};

use rayon::prelude::*;

use crate::numerics::field::{floor_index, id};
use crate::numerics::topology::{beside, is_simple, neighborhood};
use crate::space::Grid;

use crate::cancel::{Cancel, Cancelled};
use crate::pipeline::solid::depth::Depth;
use state::{LEFT, MEDIAL, NEAR, OPEN};

/// What thinning knows of a voxel, as bits of a byte.
pub(super) mod state {
    /// It is not yet taken away.
    pub const LEFT: u8 = 1;
    /// It waits in the queue.
    pub const QUEUED: u8 = 2;
    /// It is medial and stays.
    pub const MEDIAL: u8 = 4;
    /// One of its faces is open. Others are not simple.
    pub const OPEN: u8 = 8;
    /// It lies near a medial voxel, where the order of thinning matters.
    pub const NEAR: u8 = 16;
}

/// Steps around a medial voxel in which the order of thinning matters, voxels. With fewer, what connects medial
/// voxels may be off the middle; with more, more is left to one thread.
const NEAR_STEPS: usize = 2;
/// Depths that are taken away together, voxels: where there is no medial voxel but topology asks for
/// something to stay, it stays in the middle to within this. Thinner bands are more rounds of less work each.
const BAND: f32 = 1.0;
/// Voxels that one thread takes at a time; fewer are not worth handing over.
const PER_TASK: usize = 512;

/// Voxels by parity: in none of the parts do two touch.
type Parts = [Vec<u32>; 8];

/// The states of all voxels once the far ones are gone. `medial` are the voxels that stay; the solid
/// must be at least three voxels from the edge of the grid.
pub(super) fn peeled(
    inside: &Grid<bool>,
    depth: &Depth,
    medial: &[usize],
    cancel: &dyn Cancel,
) -> Result<Vec<u8>, Cancelled> {
    let peel = Peel::new(inside, depth, medial, cancel)?;
    let mut bands = vec![Parts::default()];
    let far = depth.skin_voxels.par_iter().copied().filter(|&o| !peel.is_near(o));
    peel.sort(far, 0, &mut bands);
    let mut number = 0;
    while number < bands.len() {
        let Band { held, has_gone } = peel.take_band_away(number, &mut bands, cancel)?;
        number += 1;
        // What was held may go with the next band; behind the last one, as long as anything goes.
        if number < bands.len() || (has_gone && has_voxels(&held)) {
            bands.resize_with(bands.len().max(number + 1), Parts::default);
            for (part, held) in bands[number].iter_mut().zip(held) {
                part.extend(held);
            }
        }
    }
    Ok(peel.cells.into_iter().map(AtomicU8::into_inner).collect())
}

fn has_voxels(parts: &Parts) -> bool {
    parts.iter().any(|part| !part.is_empty())
}

/// What is left of a band.
struct Band {
    /// Voxels that topology holds back.
    held: Parts,
    has_gone: bool,
}

struct Peel<'a> {
    depth: &'a [f32],
    dims: [u32; 3],
    cells: Vec<AtomicU8>,
}

impl<'a> Peel<'a> {
    fn new(inside: &Grid<bool>, depth: &'a Depth, medial: &[usize], cancel: &dyn Cancel) -> Result<Self, Cancelled> {
        let cells = inside.try_map(|is_in| AtomicU8::new(u8::from(*is_in) * LEFT), cancel)?.into_vec();
        let peel = Self { depth: depth.depth.as_slice(), dims: inside.dims().map(id), cells };
        medial.par_iter().with_min_len(PER_TASK).try_for_each(|&o| {
            cancel.check()?;
            peel.mark_medial(o);
            Ok(())
        })?;
        depth.skin_voxels.par_iter().with_min_len(PER_TASK).for_each(|&o| peel.mark(o, OPEN));
        Ok(peel)
    }

    fn mark(&self, o: usize, state: u8) {
        self.cells[o].fetch_or(state, Relaxed);
    }

    /// Marks a voxel that is medial, and those near it.
    fn mark_medial(&self, o: usize) {
        let [nx, nxy] = self.strides();
        let first = o - NEAR_STEPS * (1 + nx + nxy);
        for k in 0..=2 * NEAR_STEPS {
            for j in 0..=2 * NEAR_STEPS {
                for i in 0..=2 * NEAR_STEPS {
                    self.mark(first + i + j * nx + k * nxy, NEAR);
                }
            }
        }
        self.mark(o, MEDIAL);
    }

    fn strides(&self) -> [usize; 2] {
        [self.dims[0] as usize, (self.dims[0] * self.dims[1]) as usize]
    }

    fn is_near(&self, o: usize) -> bool {
        self.cells[o].load(Relaxed) & NEAR != 0
    }

    /// Whether topology lets a voxel go.
    fn is_free(&self, o: usize) -> bool {
        let [nx, nxy] = self.strides();
        is_simple(neighborhood(|n| self.cells[n].load(Relaxed), o, nx, nxy))
    }

    /// Takes a voxel away; the far ones beside it that had no open face before. Of several that open one
    /// it is found by the first alone.
    fn take_away(&self, o: usize) -> impl Iterator<Item = usize> + '_ {
        let [nx, nxy] = self.strides();
        self.cells[o].store(0, Relaxed);
        beside(o, nx, nxy).into_iter().filter(|&n| self.cells[n].fetch_or(OPEN, Relaxed) == LEFT)
    }

    /// Takes away what can go of a band, and of what that opens in it.
    fn take_band_away(&self, number: usize, bands: &mut Vec<Parts>, cancel: &dyn Cancel) -> Result<Band, Cancelled> {
        let mut band = Band { held: Parts::default(), has_gone: false };
        while has_voxels(&bands[number]) {
            let open = std::mem::take(&mut bands[number]);
            for (part, held) in open.iter().zip(&mut band.held) {
                cancel.check()?;
                let (going, staying): (Vec<u32>, Vec<u32>) =
                    part.par_iter().with_min_len(PER_TASK).partition(|&&o| self.is_free(o as usize));
                let opened = going.par_iter().with_min_len(PER_TASK).flat_map_iter(|&o| self.take_away(o as usize));
                // What lies less deep than the band is of it, too.
                self.sort(opened, number, bands);
                band.has_gone |= !going.is_empty();
                held.extend(staying);
            }
        }
        Ok(band)
    }

    /// Adds voxels to their bands, to the band of number `least` at the least.
    fn sort(&self, voxels: impl ParallelIterator<Item = usize>, least: usize, bands: &mut Vec<Parts>) {
        let places: Vec<(u32, usize, usize)> = voxels.map(|o| self.place(o)).collect();
        for (o, band, part) in places {
            let band = band.max(least);
            if band >= bands.len() {
                bands.resize_with(band + 1, Parts::default);
            }
            bands[band][part].push(o);
        }
    }

    /// A voxel with its band and its part of it.
    fn place(&self, o: usize) -> (u32, usize, usize) {
        let band = floor_index(f64::from(self.depth[o] / BAND));
        let o = id(o);
        let (row, i) = (o / self.dims[0], o % self.dims[0]);
        let (j, k) = (row % self.dims[1], row / self.dims[1]);
        (o, band, ((i & 1) | (j & 1) << 1 | (k & 1) << 2) as usize)
    }
}
