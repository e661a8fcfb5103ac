//! Stage 2, before the ordered thinning: what lies far from all medial voxels is taken away, by all
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
use crate::numerics::topology::{is_simple, neighborhood};
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

/// Steps around a medial voxel in which the order of thinning matters, voxels.
const NEAR_STEPS: usize = 2;
/// Depths that are taken away together, voxels: where there is no medial voxel but topology asks for
/// something to stay, it stays in the middle to within this.
const BAND: f32 = 1.0;
/// Voxels that one thread takes at a time.
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
    let far = depth.skin_voxels.par_iter().copied().filter(|&o| peel.cells[o].load(Relaxed) & NEAR == 0);
    peel.sort(far, 0, &mut bands);
    let mut number = 0;
    while number < bands.len() {
        let (mut held, mut has_gone) = (Parts::default(), false);
        while bands[number].iter().any(|part| !part.is_empty()) {
            let open = std::mem::take(&mut bands[number]);
            for (part, held) in open.iter().zip(&mut held) {
                cancel.check()?;
                let (going, staying): (Vec<u32>, Vec<u32>) =
                    part.par_iter().with_min_len(PER_TASK).partition(|&&o| peel.is_free(o as usize));
                let opened = going.par_iter().with_min_len(PER_TASK).flat_map_iter(|&o| peel.take_away(o as usize));
                // What lies less deep than the band is of it, too.
                peel.sort(opened, number, &mut bands);
                has_gone |= !going.is_empty();
                held.extend(staying);
            }
        }
        number += 1;
        // What was held may go with the next band; behind the last one, as long as anything goes.
        if number < bands.len() || (has_gone && held.iter().any(|part| !part.is_empty())) {
            bands.resize_with(bands.len().max(number + 1), Parts::default);
            bands[number].iter_mut().zip(held).for_each(|(part, held)| part.extend(held));
        }
    }
    Ok(peel.cells.into_iter().map(AtomicU8::into_inner).collect())
}

struct Peel<'a> {
    depth: &'a [f32],
    dims: [u32; 3],
    cells: Vec<AtomicU8>,
}

impl<'a> Peel<'a> {
    fn new(inside: &Grid<bool>, depth: &'a Depth, medial: &[usize], cancel: &dyn Cancel) -> Result<Self, Cancelled> {
        let cells = inside.try_map(|is_in| AtomicU8::new(u8::from(*is_in) * LEFT), cancel)?.into_vec();
        let [nx, ny, _] = inside.dims();
        medial.par_iter().with_min_len(PER_TASK).try_for_each(|&o| {
            cancel.check()?;
            around(o, NEAR_STEPS, [nx, nx * ny]).for_each(|n| {
                cells[n].fetch_or(NEAR, Relaxed);
            });
            cells[o].fetch_or(MEDIAL, Relaxed);
            Ok(())
        })?;
        depth.skin_voxels.par_iter().with_min_len(PER_TASK).for_each(|&o| {
            cells[o].fetch_or(OPEN, Relaxed);
        });
        Ok(Self { depth: depth.depth.as_slice(), dims: inside.dims().map(id), cells })
    }

    fn strides(&self) -> [usize; 2] {
        [self.dims[0] as usize, (self.dims[0] * self.dims[1]) as usize]
    }

    fn is_free(&self, o: usize) -> bool {
        let [nx, nxy] = self.strides();
        is_simple(neighborhood(|n| self.cells[n].load(Relaxed), o, nx, nxy))
    }

    /// Takes a voxel away; the far ones beside it that had no open face before. Of several that open one
    /// it is found by the first alone.
    fn take_away(&self, o: usize) -> impl Iterator<Item = usize> + '_ {
        let [nx, nxy] = self.strides();
        self.cells[o].store(0, Relaxed);
        let beside = [o - nxy, o - nx, o - 1, o + 1, o + nx, o + nxy].into_iter();
        beside.filter(|&n| self.cells[n].fetch_or(OPEN, Relaxed) == LEFT)
    }

    /// Adds voxels to their bands, to the band of number `least` at the least.
    fn sort(&self, voxels: impl ParallelIterator<Item = usize>, least: usize, bands: &mut Vec<Parts>) {
        let place = |o: usize| {
            let band = floor_index(f64::from(self.depth[o] / BAND)).max(least);
            let o = id(o);
            let (row, i) = (o / self.dims[0], o % self.dims[0]);
            let (j, k) = (row % self.dims[1], row / self.dims[1]);
            (o, band, ((i & 1) | (j & 1) << 1 | (k & 1) << 2) as usize)
        };
        let places: Vec<(u32, usize, usize)> = voxels.map(place).collect();
        for (o, band, part) in places {
            if band >= bands.len() {
                bands.resize_with(band + 1, Parts::default);
            }
            bands[band][part].push(o);
        }
    }
}

/// The voxels within some steps of one along each axis; they must lie in the grid.
pub(super) fn around(o: usize, steps: usize, [nx, nxy]: [usize; 2]) -> impl Iterator<Item = usize> {
    let first = o - steps * (1 + nx + nxy);
    let along = move || 0..2 * steps + 1;
    along().flat_map(move |k| along().flat_map(move |j| along().map(move |i| first + i + j * nx + k * nxy)))
}
