//! Steps 2 and 3: thinning in the order of depth, and to one voxel.

use std::cmp::Reverse;
use std::collections::BinaryHeap;

use super::peel::{peeled, state};
use crate::cancel::{Cancel, Cancelled};
use crate::numerics::field::{floor_index, id};
use crate::numerics::topology::{beside, cube, is_simple, is_surface_end, neighborhood};
use crate::pipeline::solid::depth::Depth;
use crate::space::Grid;

/// How many voxels are thinned between two looks at whether to stop: about a millisecond.
const CANCEL_EVERY: usize = 1 << 14;
/// Steps of depth per voxel that thinning tells apart. In a sheet of even thickness two layers are equally deep but
/// for rounding, and taking from both by turns would leave them corrugated: more steps would see a difference there.
/// Fewer take what lies on a slope out of order.
const STEPS: f32 = 16.0;
/// Keeps whole and half depths, which are many, off the borders of steps.
const PHASE: f32 = 0.37;
/// Rounds of thinning to one voxel at most; each takes at least one voxel away, and two or three are the rule.
const MAX_ROUNDS: usize = 64;

/// Takes simple voxels away in the order of their depth; returns those that are left, ascending.
pub(super) fn thinned(
    inside: &Grid<bool>,
    depth: &Depth,
    medial: &[usize],
    cancel: &dyn Cancel,
) -> Result<Vec<usize>, Cancelled> {
    let cells = peeled(inside, depth, medial, cancel)?;
    let [nx, ny, _] = inside.dims();
    let mut thinning = Thinning { cells, depth: depth.depth.as_slice(), strides: [nx, nx * ny] };
    let front = thinning.open_front(cancel)?;
    thinning.take_away_by_depth(front, cancel)?;
    thinning.thin_to_one_voxel(cancel)
}

/// A solid in the course of thinning.
struct Thinning<'a> {
    /// What is known of each voxel, see [`state`].
    cells: Vec<u8>,
    depth: &'a [f32],
    /// Steps from row to row and from plane to plane.
    strides: [usize; 2],
}

impl Thinning<'_> {
    /// The rank of a voxel in the order of thinning. The offset, which breaks ties, takes one whole layer first.
    fn rank(&self, o: usize) -> usize {
        floor_index(f64::from(self.depth[o] * STEPS + PHASE))
    }

    fn neighborhood(&self, o: usize) -> u32 {
        neighborhood(|n| self.cells[n], o, self.strides[0], self.strides[1])
    }

    /// The voxels that can be taken away first.
    fn open_front(&mut self, cancel: &dyn Cancel) -> Result<Front, Cancelled> {
        use state::{LEFT, MEDIAL, OPEN};
        let mut front = Front::default();
        for o in 0..self.cells.len() {
            if o.is_multiple_of(CANCEL_EVERY) {
                cancel.check()?;
            }
            let is_open = self.cells[o] & (LEFT | OPEN | MEDIAL) == LEFT | OPEN;
            if is_open && is_simple(self.neighborhood(o)) {
                self.enqueue(o, &mut front);
            }
        }
        Ok(front)
    }

    fn enqueue(&mut self, o: usize, front: &mut Front) {
        self.cells[o] |= state::QUEUED;
        front.push(self.rank(o), id(o));
    }

    /// Takes away what is simple when its turn comes, and queues what it opens, until none is left.
    fn take_away_by_depth(&mut self, mut front: Front, cancel: &dyn Cancel) -> Result<(), Cancelled> {
        use state::{LEFT, NEAR, OPEN, QUEUED};
        let [nx, nxy] = self.strides;
        let mut steps = 0usize;
        while let Some(o) = front.pop() {
            steps += 1;
            if steps.is_multiple_of(CANCEL_EVERY) {
                cancel.check()?;
            }
            self.cells[o] &= !QUEUED;
            if !is_simple(self.neighborhood(o)) {
                continue;
            }
            self.cells[o] = 0;
            for n in beside(o, nx, nxy) {
                self.cells[n] |= OPEN;
            }
            for n in cube(o, nx, nxy) {
                if self.cells[n] & !NEAR == LEFT | OPEN {
                    self.enqueue(n, &mut front);
                }
            }
        }
        Ok(())
    }

    /// Medial voxels make the surface two thick in places: what is no end of the surface is thinned,
    /// until nothing changes. What is left then, ascending.
    fn thin_to_one_voxel(&mut self, cancel: &dyn Cancel) -> Result<Vec<usize>, Cancelled> {
        let mut left = self.left(cancel)?;
        left.sort_by_key(|&o| (self.rank(o), o));
        for _ in 0..MAX_ROUNDS {
            cancel.check()?;
            let before = left.len();
            left.retain(|&o| !self.take_away_if_inner(o));
            if left.len() == before {
                break;
            }
        }
        left.sort_unstable();
        Ok(left)
    }

    /// Takes away a voxel that is simple and, if it is medial, no end of the surface.
    fn take_away_if_inner(&mut self, o: usize) -> bool {
        let bits = self.neighborhood(o);
        let is_end = self.cells[o] & state::MEDIAL != 0 && is_surface_end(bits);
        let goes = is_simple(bits) && !is_end;
        if goes {
            self.cells[o] = 0;
        }
        goes
    }

    /// Voxels not taken away, ascending.
    fn left(&self, cancel: &dyn Cancel) -> Result<Vec<usize>, Cancelled> {
        let mut left = Vec::new();
        for (o, cell) in self.cells.iter().enumerate() {
            if o.is_multiple_of(CANCEL_EVERY) {
                cancel.check()?;
            }
            if cell & state::LEFT != 0 {
                left.push(o);
            }
        }
        Ok(left)
    }
}

/// Voxels in the order of rank and offset. Ranks ahead are buckets, sorted when their turn comes.
#[derive(Default)]
struct Front {
    ahead: Vec<Vec<u32>>,
    rank: usize,
    /// The bucket of the current rank, descending.
    current: Vec<u32>,
    /// What came when its rank had already begun.
    late: BinaryHeap<Reverse<(usize, u32)>>,
}

impl Front {
    fn push(&mut self, rank: usize, voxel: u32) {
        if rank <= self.rank {
            self.late.push(Reverse((rank, voxel)));
        } else {
            if rank >= self.ahead.len() {
                self.ahead.resize_with(rank + 1, Vec::new);
            }
            self.ahead[rank].push(voxel);
        }
    }

    fn pop(&mut self) -> Option<usize> {
        while self.current.is_empty() && self.late.is_empty() {
            self.rank += 1;
            self.current = std::mem::take(self.ahead.get_mut(self.rank)?);
            self.current.sort_unstable_by_key(|o| Reverse(*o));
        }
        let late = self.late.peek().map_or((usize::MAX, u32::MAX), |Reverse(late)| *late);
        let is_late = self.current.last().is_none_or(|&next| late < (self.rank, next));
        let voxel = if is_late { self.late.pop()?.0.1 } else { self.current.pop()? };
        Some(voxel as usize)
    }
}
