//! Exact Euclidean distance transforms, separable (Felzenszwalb, Huttenlocher, *Distance
//! transforms of sampled functions*, Theory of Computing 8, 2012), with the nearest seed.

use crate::space::Grid;

/// No seed anywhere.
pub const NO_SEED: u32 = u32::MAX;

/// Nearest seed of every voxel and the squared distance to it.
#[derive(Clone, Debug)]
pub struct Nearest {
    /// Squared distance in the unit of the spacing; infinite without seeds.
    pub squared: Grid<f32>,
    /// Offset of the nearest seed voxel, or [`NO_SEED`].
    pub seed: Grid<u32>,
}

/// Distance from every voxel centre to the nearest voxel centre where `is_seed` holds.
///
/// `spacing` are the voxel's edges. Without a seed all distances are infinite.
pub fn nearest_seed(dims: [usize; 3], spacing: [f64; 3], is_seed: impl Fn(usize) -> bool) -> Nearest {
    let mut squared = Grid::filled(dims, f32::INFINITY);
    let mut seed = Grid::filled(dims, NO_SEED);
    for offset in 0..squared.as_slice().len() {
        if is_seed(offset) {
            squared.as_mut_slice()[offset] = 0.0;
            seed.as_mut_slice()[offset] = super::field::id(offset);
        }
    }
    for (axis, &spacing) in spacing.iter().enumerate() {
        sweep(&mut squared, &mut seed, axis, spacing);
    }
    Nearest { squared, seed }
}

/// Lower envelope of parabolas along every line of one axis.
fn sweep(squared: &mut Grid<f32>, seed: &mut Grid<u32>, axis: usize, spacing: f64) {
    let dims = squared.dims();
    let stride: usize = dims[..axis].iter().product();
    let count = dims[axis];
    let block = stride * count;
    let mut line = Line::new(count, spacing);
    for start in (0..squared.as_slice().len()).step_by(block) {
        for inner in 0..stride {
            let at = |x: usize| start + inner + x * stride;
            line.load((0..count).map(|x| (squared.as_slice()[at(x)], seed.as_slice()[at(x)])));
            if line.any {
                line.envelope();
                line.store(|x, d, s| {
                    squared.as_mut_slice()[at(x)] = d;
                    seed.as_mut_slice()[at(x)] = s;
                });
            }
        }
    }
}

/// Scratch of one line.
struct Line {
    spacing: f64,
    height: Vec<f64>,
    seed: Vec<u32>,
    any: bool,
    vertex: Vec<usize>,
    from: Vec<f64>,
}

impl Line {
    fn new(count: usize, spacing: f64) -> Self {
        let capacity = Vec::with_capacity(count);
        Self { spacing, height: capacity, seed: vec![], any: false, vertex: vec![], from: vec![] }
    }

    fn load(&mut self, values: impl Iterator<Item = (f32, u32)>) {
        self.height.clear();
        self.seed.clear();
        for (h, s) in values {
            self.height.push(f64::from(h));
            self.seed.push(s);
        }
        self.any = self.seed.iter().any(|&s| s != NO_SEED);
    }

    /// Keeps the parabolas that are lowest somewhere, left to right, and where each starts to be.
    fn envelope(&mut self) {
        self.vertex.clear();
        self.from.clear();
        let unit = self.spacing * self.spacing;
        for q in 0..self.height.len() {
            if self.seed[q] == NO_SEED {
                continue;
            }
            let mut start = f64::NEG_INFINITY;
            while let Some(&v) = self.vertex.last() {
                let (qf, vf) = (q as f64, v as f64);
                start = ((self.height[q] - self.height[v]) / unit + qf * qf - vf * vf) / (2.0 * (qf - vf));
                if start > self.from[self.from.len() - 1] {
                    break;
                }
                self.vertex.pop();
                self.from.pop();
                start = f64::NEG_INFINITY;
            }
            self.vertex.push(q);
            self.from.push(start);
        }
    }

    fn store(&self, mut put: impl FnMut(usize, f32, u32)) {
        let mut k = 0;
        for x in 0..self.height.len() {
            while k + 1 < self.vertex.len() && self.from[k + 1] < x as f64 {
                k += 1;
            }
            let v = self.vertex[k];
            let step = (x as f64 - v as f64) * self.spacing;
            #[expect(clippy::cast_possible_truncation, reason = "the grid is f32")]
            let squared = (step * step + self.height[v]) as f32;
            put(x, squared, self.seed[v]);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn agrees_with_brute_force_on_anisotropic_voxels() {
        let (dims, spacing) = ([9, 7, 8], [1.0, 2.5, 0.7]);
        let is_seed = |o: usize| (o * 7919 + 13).is_multiple_of(97);
        let found = nearest_seed(dims, spacing, is_seed);
        let count: usize = dims.iter().product();
        let squared = |a: usize, b: usize| -> f64 {
            let (a, b) = (found.seed.index(a), found.seed.index(b));
            (0..3).map(|x| ((a[x] as f64 - b[x] as f64) * spacing[x]).powi(2)).sum()
        };
        for o in 0..count {
            let best = (0..count).filter(|&s| is_seed(s)).map(|s| squared(o, s)).fold(f64::INFINITY, f64::min);
            assert!((f64::from(found.squared.as_slice()[o]) - best).abs() < 1e-4);
            assert!((squared(o, found.seed.as_slice()[o] as usize) - best).abs() < 1e-9);
        }
    }

    #[test]
    fn without_a_seed_everything_is_infinitely_far() {
        let found = nearest_seed([3, 3, 3], [1.0; 3], |_| false);
        assert!(found.squared.as_slice().iter().all(|d| d.is_infinite()));
    }
}
