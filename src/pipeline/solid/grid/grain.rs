//! The grain of a mask: the edges of the voxels that it was drawn or computed on, which need not be those that it is
//! stored in.
//!
//! A mask that was brought to a finer grid by its nearest voxels keeps its steps where the coarse voxels met. Along each
//! axis:
//!
//! 1. the faces between neighbouring slices are counted, by the place along the axis;
//! 2. the largest factor is taken whose lattice of planes holds nearly all of them, those of every slope, and has few
//!    planes without any;
//! 3. one voxel in the middle of each block gives the mask on its own grain back.
//!
//! An axis along which no factor is found has the grain that it is stored with.

use rayon::prelude::*;

use nalgebra::{Point3, Vector3};

use crate::cancel::{Cancel, Cancelled};
use crate::numerics::field::floor_index;
use crate::pipeline::solid::NativeMask;
use crate::space::{Grid, VoxelIndex, WorldFromVoxel};

/// Share of the faces that must lie on the planes of the grain. A mask that was edited after it was brought to its grid
/// has a few elsewhere; at 0.9 smooth organs of 20 slices show factors of 1.3 that they do not have.
const CAPTURED: f64 = 0.97;
/// The same where no place counts more than the mean of all: the flat faces of a slab lie on planes of any factor by
/// chance. At 0.85 a ribbon of two flat banks shows a grain of 1.7.
const CAPTURED_EVENLY: f64 = 0.95;
/// The same, of the faces of each slope: the two sides of a box lie on planes of any factor by chance, what leans does
/// not.
const CAPTURED_OF_EACH: f64 = 0.9;
/// Share of the faces from which a slope is looked at; fewer prove nothing.
const SLOPE_SHARE: f64 = 0.03;
/// Share of the planes that must hold faces: with few of them, a larger factor than the true one would do.
const OCCUPIED: f64 = 0.7;
/// Factors that are looked for. Below, nearly all planes are allowed; above, a mask has too few blocks.
const FACTORS: (f64, f64) = (1.25, 12.0);
/// Blocks that a mask must have along an axis: fewer could lie as they do by chance.
const LEAST_BLOCKS: f64 = 4.0;
/// Planes that a factor must forbid to be told from chance.
const LEAST_FORBIDDEN: f64 = 5.0;
/// Places with faces at the least: four or five lie on the planes of some factor by chance, as those of a box with a small
/// piece beside it do. With many more, coarse masks of a few slices would not be found.
const LEAST_PLACES: usize = 6;
/// Share of a voxel by which the last plane moves from one factor to the next that is tried. A plane counts within half
/// a voxel: three factors at the least hit it.
const FACTOR_STEP: f64 = 0.15;
/// Capture that counts as the best: factors near the true one lose a plane or two at the ends.
const AS_GOOD: f64 = 0.005;
/// How far behind its plane a face may lie, voxels, and less than that before it: it is on the nearest place there is. With
/// both ends two places count for planes between them, and a ribbon of two flat banks shows a grain of 3.
const NEAR: f64 = 0.5;
/// Rows that one thread takes at a time; fewer are not worth handing over.
const ROWS_PER_TASK: usize = 64;

/// The grain along one axis, in stored voxels.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(in crate::pipeline::solid) struct AxisGrain {
    /// Voxels to a grain, 1 or more.
    pub factor: f64,
    /// Where a plane between two grains lies, in voxel coordinates.
    plane: f64,
}

impl AxisGrain {
    const STORED: Self = Self { factor: 1.0, plane: 0.5 };

    fn is_stored(&self) -> bool {
        self.factor == 1.0
    }
}

/// The grain of a mask along each of its axes.
pub(in crate::pipeline::solid) fn grain(mask: &Grid<bool>, cancel: &dyn Cancel) -> Result<[AxisGrain; 3], Cancelled> {
    let counts = faces(mask, cancel)?;
    let mut grain = [AxisGrain::STORED; 3];
    for axis in 0..3 {
        cancel.check()?;
        let steps = Steps::of(&counts[axis]);
        let candidates = steps.candidates();
        if let Some(largest) = candidates.first() {
            let slopes = faces_by_slope(mask, axis, largest.factor, cancel)?;
            grain[axis] = steps.best(&candidates, &slopes).unwrap_or(AxisGrain::STORED);
        }
    }
    Ok(grain)
}

/// Faces between slice `i` and the next, along each axis.
fn faces(mask: &Grid<bool>, cancel: &dyn Cancel) -> Result<[Vec<u64>; 3], Cancelled> {
    let [nx, ny, nz] = mask.dims();
    let none = || [nx, ny, nz].map(|n| vec![0u64; n]);
    (0..ny * nz)
        .into_par_iter()
        .with_min_len(ROWS_PER_TASK)
        .try_fold(none, |mut counts, row| {
            cancel.check()?;
            add_row(mask, row, &mut counts);
            Ok(counts)
        })
        .try_reduce(none, |mut a, b| {
            for (a, b) in a.iter_mut().flatten().zip(b.into_iter().flatten()) {
                *a += b;
            }
            Ok(a)
        })
}

/// Adds the faces of a row's voxels with the next along each axis.
fn add_row(mask: &Grid<bool>, row: usize, counts: &mut [Vec<u64>; 3]) {
    let [nx, ny, nz] = mask.dims();
    let (j, k) = (row % ny, row / ny);
    let values = mask.as_slice();
    let own = &values[row * nx..(row + 1) * nx];
    for (i, pair) in own.windows(2).enumerate() {
        counts[0][i] += u64::from(pair[0] != pair[1]);
    }
    if j + 1 < ny {
        counts[1][j] += differing(own, &values[(row + 1) * nx..(row + 2) * nx]);
    }
    if k + 1 < nz {
        counts[2][k] += differing(own, &values[(row + ny) * nx..(row + ny + 1) * nx]);
    }
}

fn differing(a: &[bool], b: &[bool]) -> u64 {
    a.iter().zip(b).map(|(a, b)| u64::from(a != b)).sum()
}

/// The faces along one axis: how many at which places.
struct Steps {
    /// Places that have faces, ascending.
    places: Vec<usize>,
    /// Share of all faces at each.
    shares: Vec<f64>,
    /// The same with none counted for more than the mean.
    even: Vec<f64>,
    /// Shares, from the largest on, summed up.
    largest: Vec<f64>,
}

/// A factor that may be the grain.
struct Candidate {
    factor: f64,
    phase: f64,
    captured: f64,
}

impl Steps {
    fn of(counts: &[u64]) -> Self {
        let all: u64 = counts.iter().sum();
        let (mut places, mut shares) = (Vec::new(), Vec::new());
        for (place, &count) in counts.iter().enumerate() {
            if count > 0 {
                places.push(place);
                shares.push(count as f64 / all as f64);
            }
        }
        let even = evened(&shares);
        let mut largest = shares.clone();
        largest.sort_by(|a, b| b.total_cmp(a));
        let mut sum = 0.0;
        for share in &mut largest {
            sum += *share;
            *share = sum;
        }
        Self { places, shares, even, largest }
    }

    /// Slices from the first face to the last.
    fn length(&self) -> f64 {
        (self.places[self.places.len() - 1] - self.places[0] + 1) as f64
    }

    /// Factors whose planes hold nearly all faces and leave few planes empty, from the largest on.
    fn candidates(&self) -> Vec<Candidate> {
        let mut found: Vec<Candidate> = Vec::new();
        if self.places.len() < LEAST_PLACES {
            return found;
        }
        let length = self.length();
        let mut factor = FACTORS.1.min(length / LEAST_BLOCKS);
        while factor >= FACTORS.0 && length * (1.0 - 1.0 / factor) >= LEAST_FORBIDDEN {
            if self.may_capture(factor) {
                let candidate = self.candidate(factor);
                if self.is_likely(&candidate) {
                    found.push(candidate);
                }
            }
            factor -= FACTOR_STEP * factor / length;
        }
        found
    }

    fn is_likely(&self, candidate: &Candidate) -> bool {
        let Candidate { factor, phase, captured } = *candidate;
        captured >= CAPTURED
            && self.held(&self.even, factor, phase) >= CAPTURED_EVENLY
            && self.occupied(candidate) >= OCCUPIED
    }

    /// Whether as many places as a factor has planes can hold enough faces.
    fn may_capture(&self, factor: f64) -> bool {
        // A place to a plane.
        let planes = (self.length() / factor).ceil() + 1.0;
        let places = floor_index(planes).min(self.largest.len());
        self.largest[places - 1] >= CAPTURED
    }

    /// The phase at which a factor holds the most faces: the middle of those that do.
    fn candidate(&self, factor: f64) -> Candidate {
        /// Phases to a voxel.
        const PHASES: f64 = 8.0;
        let phases = (PHASES * factor).ceil();
        let (mut captured, mut from, mut to) = (0.0, 0.0, 0.0);
        let mut n = 0.0;
        while n < phases {
            let phase = n * factor / phases;
            let held = self.held(&self.shares, factor, phase);
            if held > captured + 1e-9 {
                (captured, from, to) = (held, phase, phase);
            } else if held > captured - 1e-9 && phase - from < 1.0 {
                to = phase;
            }
            n += 1.0;
        }
        Candidate { factor, phase: f64::midpoint(from, to), captured }
    }

    /// What of the shares lies on the planes of a factor.
    fn held(&self, shares: &[f64], factor: f64, phase: f64) -> f64 {
        let mut held = 0.0;
        for (&place, share) in self.places.iter().zip(shares) {
            if is_on_plane(place, factor, phase) {
                held += share;
            }
        }
        held
    }

    /// Share of the planes between the first and the last with faces that have some.
    fn occupied(&self, candidate: &Candidate) -> f64 {
        let mut planes: Vec<f64> = Vec::new();
        for &place in &self.places {
            if is_on_plane(place, candidate.factor, candidate.phase) {
                planes.push(((place as f64 - candidate.phase) / candidate.factor).round());
            }
        }
        planes.dedup();
        match (planes.first(), planes.last()) {
            (Some(first), Some(last)) => planes.len() as f64 / (last - first + 1.0),
            _ => 0.0,
        }
    }

    /// Of the candidates that faces of every slope agree to, the largest and those as good beside it.
    fn best(&self, candidates: &[Candidate], slopes: &[Vec<u64>]) -> Option<AxisGrain> {
        let length = self.length();
        let mut best: Option<&Candidate> = None;
        let (mut sum, mut count) = (0.0, 0.0);
        for candidate in candidates {
            if !agree(slopes, candidate) {
                continue;
            }
            let top = best.get_or_insert(candidate);
            if candidate.factor < top.factor * (1.0 - 2.0 / length) {
                break;
            }
            if candidate.captured > top.captured + AS_GOOD {
                (*top, sum, count) = (candidate, 0.0, 0.0);
            }
            if candidate.captured >= top.captured - AS_GOOD {
                sum += candidate.factor;
                count += 1.0;
            }
        }
        let captured = best?.captured;
        Some(self.whole(sum / count, captured).unwrap_or_else(|| {
            let candidate = self.candidate(sum / count);
            AxisGrain { factor: candidate.factor, plane: candidate.phase + 0.5 }
        }))
    }

    /// The whole factor next to one, if it holds as many faces to the voxel.
    fn whole(&self, factor: f64, captured: f64) -> Option<AxisGrain> {
        let whole = factor.round();
        if whole < 2.0 || (factor - whole).abs() * self.length() / whole > 1.0 {
            return None;
        }
        let mut phase = 0.0;
        while phase < whole {
            let mut held = 0.0;
            for (&place, share) in self.places.iter().zip(&self.shares) {
                held += if off_plane(place, whole, phase) == 0.0 { *share } else { 0.0 };
            }
            if held >= captured - AS_GOOD {
                return Some(AxisGrain { factor: whole, plane: phase + 0.5 });
            }
            phase += 1.0;
        }
        None
    }
}

/// Shares of a whole, each cut to the mean, of a whole again.
fn evened(shares: &[f64]) -> Vec<f64> {
    let mean = 1.0 / shares.len().max(1) as f64;
    let cut: Vec<f64> = shares.iter().map(|share| share.min(mean)).collect();
    let all: f64 = cut.iter().sum();
    cut.into_iter().map(|share| share / all).collect()
}

/// How far a place lies from the nearest plane, voxels.
fn off_plane(place: usize, factor: f64, phase: f64) -> f64 {
    let beyond = (place as f64 - phase) / factor;
    (beyond - beyond.round()) * factor
}

/// Whether a place is the nearest to a plane.
fn is_on_plane(place: usize, factor: f64, phase: f64) -> bool {
    /// Rounding is not to decide for places halfway.
    const ROUNDING: f64 = 1e-6;
    let off = off_plane(place, factor, phase);
    off > -NEAR + ROUNDING && off <= NEAR + ROUNDING
}

/// Whether the planes of a factor hold the faces of every slope that has many.
fn agree(slopes: &[Vec<u64>], candidate: &Candidate) -> bool {
    let all: u64 = slopes.iter().flatten().sum();
    for counts in slopes {
        let (mut held, mut total) = (0, 0);
        for (place, &count) in counts.iter().enumerate() {
            total += count;
            held += if is_on_plane(place, candidate.factor, candidate.phase) { count } else { 0 };
        }
        if total as f64 > SLOPE_SHARE * all as f64 && (held as f64) < CAPTURED_OF_EACH * total as f64 {
            return false;
        }
    }
    true
}

/// Faces across an axis by slope: whether the mask begins or ends there, and to which side it rises along the other two.
fn faces_by_slope(
    mask: &Grid<bool>,
    axis: usize,
    factor: f64,
    cancel: &dyn Cancel,
) -> Result<Vec<Vec<u64>>, Cancelled> {
    let dims = mask.dims();
    let reach = floor_index(factor.ceil()) + 1;
    let mut counts = vec![vec![0; dims[axis]]; 8];
    for offset in 0..mask.as_slice().len() {
        let at = mask.index(offset);
        if at[0] == 0 {
            cancel.check()?;
        }
        let mut next = at;
        next[axis] += 1;
        if next[axis] == dims[axis] || mask[at] == mask[next] {
            continue;
        }
        let mut group = usize::from(mask[next]);
        for side in [(axis + 1) % 3, (axis + 2) % 3] {
            group = 2 * group + usize::from(rise(mask, at, side, reach) + rise(mask, next, side, reach) > 0);
        }
        counts[group][at[axis]] += 1;
    }
    Ok(counts)
}

/// Voxels of the mask ahead of one, less those behind, along an axis.
fn rise(mask: &Grid<bool>, at: VoxelIndex, axis: usize, reach: usize) -> isize {
    let mut rise = 0;
    for step in 1..=reach {
        let mut place = at;
        place[axis] = (at[axis] + step).min(mask.dims()[axis] - 1);
        rise += isize::from(mask[place]);
        place[axis] = at[axis].saturating_sub(step);
        rise -= isize::from(mask[place]);
    }
    rise
}

/// The mask on its own grain: one voxel in the middle of each block, with free ones around.
pub(in crate::pipeline::solid) fn on_grain(
    native: NativeMask,
    grain: &[AxisGrain; 3],
    cancel: &dyn Cancel,
) -> Result<NativeMask, Cancelled> {
    if grain.iter().all(AxisGrain::is_stored) {
        return Ok(native);
    }
    let dims = native.mask.dims();
    let blocks = [0, 1, 2].map(|axis| Blocks::along(dims[axis], &grain[axis]));
    let sample = |at: VoxelIndex| {
        let mut from = [0; 3];
        for axis in 0..3 {
            match blocks[axis].samples[at[axis]] {
                Some(voxel) => from[axis] = voxel,
                None => return false,
            }
        }
        native.mask[from]
    };
    let mask = Grid::try_of([0, 1, 2].map(|axis| blocks[axis].samples.len()), sample, cancel)?;
    let first = Point3::from([0, 1, 2].map(|axis| blocks[axis].first));
    Ok(NativeMask { mask, world_from_voxel: scaled(&native.world_from_voxel, grain, first), ..native })
}

/// The blocks of an axis, from the free one before the mask to the one behind it.
struct Blocks {
    /// Coordinate of the middle of the first.
    first: f64,
    /// The voxel that each is read from; none outside of the grid.
    samples: Vec<Option<usize>>,
}

impl Blocks {
    fn along(length: usize, grain: &AxisGrain) -> Self {
        if grain.is_stored() {
            return Self { first: 0.0, samples: (0..length).map(Some).collect() };
        }
        let AxisGrain { factor, plane } = *grain;
        let first = plane + factor * (((0.5 - plane) / factor).floor() - 0.5);
        let last = length as f64 - 1.5;
        let (mut samples, mut middle) = (Vec::new(), first);
        while middle - factor / 2.0 < last + factor {
            // Of two voxels beside the middle the one before it.
            let voxel = (middle + 0.5 - 1e-6).floor();
            let is_on_grid = voxel >= 0.0 && voxel < length as f64;
            samples.push(is_on_grid.then(|| floor_index(voxel)));
            middle = first + factor * samples.len() as f64;
        }
        Self { first, samples }
    }
}

/// The map of blocks, of that of voxels and the place of the first block.
fn scaled(world_from_voxel: &WorldFromVoxel, grain: &[AxisGrain; 3], first: Point3<f64>) -> WorldFromVoxel {
    let old = world_from_voxel.rows();
    let origin: Vector3<f64> = world_from_voxel.point(first).coords;
    let row = |r: usize| {
        let [x, y, z, _] = old[r];
        [x * grain[0].factor, y * grain[1].factor, z * grain[2].factor, origin[r]]
    };
    WorldFromVoxel::from_rows([row(0), row(1), row(2)]).expect("axes stay as they are but for their length")
}

/// The grain along the axes of the file, mm.
pub(in crate::pipeline::solid) fn grain_mm(stored: &NativeMask, grain: &[AxisGrain; 3]) -> [f64; 3] {
    let spacing = stored.world_from_voxel.spacing_mm();
    let mut grain_mm = spacing;
    for axis in 0..3 {
        grain_mm[stored.file_axes[axis]] = spacing[axis] * grain[axis].factor;
    }
    grain_mm
}
