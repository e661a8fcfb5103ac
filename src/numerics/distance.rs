//! Exact Euclidean distance transforms, separable (Felzenszwalb, Huttenlocher, *Distance
//! transforms of sampled functions*, Theory of Computing 8, 2012), with the nearest seed.

use std::ops::Range;

use rayon::prelude::*;

use crate::space::Grid;

use super::field::id;
use crate::cancel::{Cancel, Cancelled};

/// No seed anywhere.
pub const NO_SEED: u32 = u32::MAX;

/// Lines that are worked on at a time: so many lie in one cache line.
const LINES: usize = 16;

/// Nearest seed of every voxel and the squared distance to it.
#[derive(Clone, Debug)]
pub struct Nearest {
    /// Squared distance in the unit of the spacing; infinite without a seed.
    pub squared: Grid<f32>,
    /// Index of the nearest seed, or [`NO_SEED`].
    pub seed: Grid<u32>,
}

/// Distance from every voxel centre to the nearest of `seeds` (offsets of voxels).
///
/// `spacing` are the voxel's edges. Without a seed all distances are infinite.
///
/// # Errors
/// When it is cancelled.
pub fn nearest_seed(
    dims: [usize; 3],
    spacing: [f64; 3],
    seeds: &[usize],
    cancel: &dyn Cancel,
) -> Result<Nearest, Cancelled> {
    transform(dims, spacing, seeds, None, cancel)
}

/// The same for the voxels of a set only, whose boundary voxels (those with a face on the outside)
/// must all be seeds; outside of the set there is none. Edges of voxels are 1.
///
/// Any path of axis steps from a voxel to its nearest seed stays in the set, else it would meet a
/// nearer seed where it leaves it. So lines are cut where the set ends, and the cost goes with its
/// voxels.
///
/// # Errors
/// When it is cancelled.
pub fn nearest_seed_within(set: &Grid<bool>, seeds: &[usize], cancel: &dyn Cancel) -> Result<Nearest, Cancelled> {
    transform(set.dims(), [1.0; 3], seeds, Some(set), cancel)
}

fn transform(
    dims: [usize; 3],
    spacing: [f64; 3],
    seeds: &[usize],
    set: Option<&Grid<bool>>,
    cancel: &dyn Cancel,
) -> Result<Nearest, Cancelled> {
    /// Seeds that are set between two looks at whether to stop.
    const SEEDS: usize = 1 << 18;
    let mut squared = Grid::try_filled(dims, f32::INFINITY, cancel)?;
    let mut seed = Grid::try_filled(dims, NO_SEED, cancel)?;
    for (number, &offset) in seeds.iter().enumerate() {
        if number.is_multiple_of(SEEDS) {
            cancel.check()?;
        }
        squared.as_mut_slice()[offset] = 0.0;
        seed.as_mut_slice()[offset] = id(number);
    }
    let nx = dims[0];
    let rows = squared.as_mut_slice().par_chunks_mut(nx).zip(seed.as_mut_slice().par_chunks_mut(nx));
    rows.enumerate().with_min_len(64).try_for_each(|(n, (squared, seed))| {
        cancel.check()?;
        along_row(squared, seed, spacing[0], |x| set.is_none_or(|set| set.as_slice()[n * nx + x]));
        Ok(())
    })?;
    for axis in [1, 2] {
        let across = Across { axis, dims, spacing: spacing[axis], set, cancel };
        let groups = squared.rows_across(axis).into_par_iter().zip(seed.rows_across(axis));
        groups.enumerate().try_for_each(|(n, (mut squared, mut seed))| across.work_on(n, &mut squared, &mut seed))?;
    }
    Ok(Nearest { squared, seed })
}

/// Nearest seeds of a row of which the seeds alone are set. Of two as near, the first.
fn along_row(squared: &mut [f32], seed: &mut [u32], spacing: f64, is_in: impl Fn(usize) -> bool) {
    let distance = |a: usize, b: usize| {
        let step = a.abs_diff(b) as f64 * spacing;
        #[expect(clippy::cast_possible_truncation, reason = "the grid is f32")]
        let squared = (step * step) as f32;
        squared
    };
    let mut last: Option<(usize, u32)> = None;
    for x in 0..seed.len() {
        if !is_in(x) {
            last = None;
        } else if squared[x] == 0.0 {
            last = Some((x, seed[x]));
        } else if let Some((at, number)) = last {
            (squared[x], seed[x]) = (distance(x, at), number);
        }
    }
    let mut next: Option<(usize, u32)> = None;
    for x in (0..seed.len()).rev() {
        if !is_in(x) {
            next = None;
        } else if squared[x] == 0.0 {
            next = Some((x, seed[x]));
        } else if let Some((at, number)) = next
            && distance(x, at) < squared[x]
        {
            (squared[x], seed[x]) = (distance(x, at), number);
        }
    }
}

/// The lines along an axis that is not that of the rows.
struct Across<'a> {
    axis: usize,
    dims: [usize; 3],
    spacing: f64,
    /// Where lines are cut.
    set: Option<&'a Grid<bool>>,
    cancel: &'a dyn Cancel,
}

impl Across<'_> {
    /// Works on the lines across the rows of group `n`: of a plane along the second axis, of an upright one along the third.
    fn work_on(&self, n: usize, squared: &mut [&mut [f32]], seed: &mut [&mut [u32]]) -> Result<(), Cancelled> {
        let [nx, ny, _] = self.dims;
        let mut lines = Lines::new(self.dims[self.axis], self.spacing);
        for from in (0..nx).step_by(LINES) {
            self.cancel.check()?;
            let taken = from..(from + LINES).min(nx);
            lines.work_on(squared, seed, taken, |line, x| {
                let row = if self.axis == 1 { line + ny * n } else { n + ny * line };
                self.set.is_none_or(|set| set.as_slice()[row * nx + x])
            });
        }
        Ok(())
    }
}

/// Lower envelopes of parabolas along lines, a few lines at a time.
struct Lines {
    spacing: f64,
    length: usize,
    /// Heights, seeds, and whether the place is in the set, line by line.
    height: Vec<f32>,
    seed: Vec<u32>,
    is_in: Vec<bool>,
    envelope: Envelope,
}

impl Lines {
    fn new(length: usize, spacing: f64) -> Self {
        let places = LINES * length;
        let (height, seed, is_in) = (vec![f32::INFINITY; places], vec![NO_SEED; places], vec![false; places]);
        Self { spacing, length, height, seed, is_in, envelope: Envelope::default() }
    }

    fn work_on(
        &mut self,
        squared: &mut [&mut [f32]],
        seed: &mut [&mut [u32]],
        taken: Range<usize>,
        is_in: impl Fn(usize, usize) -> bool,
    ) {
        let mut any = false;
        for line in 0..self.length {
            for (n, x) in taken.clone().enumerate() {
                let to = n * self.length + line;
                (self.height[to], self.seed[to]) = (squared[line][x], seed[line][x]);
                self.is_in[to] = is_in(line, x);
                any |= self.seed[to] != NO_SEED;
            }
        }
        if !any {
            return;
        }
        for n in 0..taken.len() {
            self.cut_and_solve(n * self.length..(n + 1) * self.length);
        }
        for line in 0..self.length {
            for (n, x) in taken.clone().enumerate() {
                let from = n * self.length + line;
                (squared[line][x], seed[line][x]) = (self.height[from], self.seed[from]);
            }
        }
    }

    /// Solves each part of a line that is in the set.
    fn cut_and_solve(&mut self, line: Range<usize>) {
        let mut at = line.start;
        while let Some(skipped) = self.is_in[at..line.end].iter().position(|v| *v) {
            let from = at + skipped;
            at = self.is_in[from..line.end].iter().position(|v| !v).map_or(line.end, |length| from + length);
            self.envelope.solve(&mut self.height[from..at], &mut self.seed[from..at], self.spacing);
        }
    }
}

/// The parabolas that are lowest somewhere, left to right, and where each starts to be.
#[derive(Default)]
struct Envelope {
    parabolas: Vec<Parabola>,
}

#[derive(Clone, Copy)]
struct Parabola {
    vertex: f64,
    height: f64,
    seed: u32,
    from: f64,
}

impl Envelope {
    fn solve(&mut self, height: &mut [f32], seed: &mut [u32], spacing: f64) {
        self.parabolas.clear();
        let unit = spacing * spacing;
        for q in (0..height.len()).filter(|&q| seed[q] != NO_SEED) {
            let (vertex, height) = (q as f64, f64::from(height[q]));
            let mut from = f64::NEG_INFINITY;
            while let Some(last) = self.parabolas.last() {
                let rise = (height - last.height) / unit + vertex * vertex - last.vertex * last.vertex;
                from = rise / (2.0 * (vertex - last.vertex));
                if from > last.from {
                    break;
                }
                self.parabolas.pop();
                from = f64::NEG_INFINITY;
            }
            self.parabolas.push(Parabola { vertex, height, seed: seed[q], from });
        }
        if self.parabolas.is_empty() {
            return;
        }
        let mut k = 0;
        for x in 0..height.len() {
            let place = x as f64;
            while k + 1 < self.parabolas.len() && self.parabolas[k + 1].from < place {
                k += 1;
            }
            let lowest = self.parabolas[k];
            let step = (place - lowest.vertex) * spacing;
            #[expect(clippy::cast_possible_truncation, reason = "the grid is f32")]
            let squared = (step * step + lowest.height) as f32;
            (height[x], seed[x]) = (squared, lowest.seed);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::components::{Connectivity, neighbors};
    use super::*;
    use crate::cancel::Never;

    fn brute_force(dims: [usize; 3], spacing: [f64; 3], seeds: &[usize], offset: usize) -> f64 {
        let grid = Grid::filled(dims, ());
        let a = grid.index(offset);
        let squared = |s: &usize| -> f64 {
            let b = grid.index(*s);
            (0..3).map(|x| ((a[x] as f64 - b[x] as f64) * spacing[x]).powi(2)).sum()
        };
        seeds.iter().map(squared).fold(f64::INFINITY, f64::min)
    }

    #[test]
    fn agrees_with_brute_force_on_anisotropic_voxels() {
        let (dims, spacing) = ([19, 7, 8], [1.0, 2.5, 0.7]);
        let seeds: Vec<usize> = (0..19 * 7 * 8usize).filter(|o| (o * 7919 + 13).is_multiple_of(97)).collect();
        let found = nearest_seed(dims, spacing, &seeds, &Never).expect("not stopped");
        for o in 0..19 * 7 * 8 {
            let best = brute_force(dims, spacing, &seeds, o);
            let seed = seeds[found.seed.as_slice()[o] as usize];
            assert!((f64::from(found.squared.as_slice()[o]) - best).abs() < 1e-4);
            assert!((brute_force(dims, spacing, &[seed], o) - best).abs() < 1e-9);
        }
    }

    #[test]
    fn inside_a_set_agrees_with_brute_force() {
        let dims = [21, 17, 13];
        let mut set = Grid::filled(dims, false);
        for o in 0..set.as_slice().len() {
            // Two balls that overlap, and a hole in one of them.
            let p = set.index(o).map(|x| x as f64);
            let ball = |c: [f64; 3], r: f64| (0..3).map(|a| (p[a] - c[a]).powi(2)).sum::<f64>() < r * r;
            set.as_mut_slice()[o] = (ball([7.0, 8.0, 6.0], 5.5) || ball([13.0, 9.0, 6.0], 4.5)) && !ball([8.0; 3], 1.5);
        }
        let on_boundary = |o: &usize| {
            let mut open = false;
            neighbors(dims, *o, Connectivity::Faces6, |n| open |= !set.as_slice()[n]);
            set.as_slice()[*o] && open
        };
        let seeds: Vec<usize> = (0..set.as_slice().len()).filter(on_boundary).collect();
        let found = nearest_seed_within(&set, &seeds, &Never).expect("not stopped");
        for o in 0..set.as_slice().len() {
            let squared = f64::from(found.squared.as_slice()[o]);
            if set.as_slice()[o] {
                assert!((squared - brute_force(dims, [1.0; 3], &seeds, o)).abs() < 1e-4);
            } else {
                assert!(squared.is_infinite() && found.seed.as_slice()[o] == NO_SEED);
            }
        }
    }

    #[test]
    fn without_a_seed_everything_is_infinitely_far() {
        let found = nearest_seed([3, 3, 3], [1.0; 3], &[], &Never).expect("not stopped");
        assert!(found.squared.as_slice().iter().all(|d| d.is_infinite()));
    }
}
