//! Separable Gaussian smoothing.

use crate::space::Grid;

/// Where the kernel is cut, in standard deviations. At 3 what is left out is 0.3 %.
const CUT_SIGMAS: f64 = 3.0;

/// Convolves with a Gaussian of `sigma` voxels along each axis; the edge value goes on outside.
pub fn gaussian(grid: &mut Grid<f32>, sigma: [f64; 3]) {
    for (axis, sigma) in sigma.into_iter().enumerate() {
        if sigma > 0.0 {
            along(grid, axis, &kernel(sigma));
        }
    }
}

/// Half of a normalised kernel: the centre and one flank.
fn kernel(sigma: f64) -> Vec<f32> {
    let reach = super::field::floor_index((CUT_SIGMAS * sigma).ceil()).max(1);
    let raw: Vec<f64> = (0..=reach).map(|x| (-((x * x) as f64) / (2.0 * sigma * sigma)).exp()).collect();
    let sum = raw[0] + 2.0 * raw[1..].iter().sum::<f64>();
    #[expect(clippy::cast_possible_truncation, reason = "the grid is f32")]
    raw.iter().map(|w| (w / sum) as f32).collect()
}

/// One axis. Works on whole planes of the faster axes at a time, so that memory is read in order.
fn along(grid: &mut Grid<f32>, axis: usize, kernel: &[f32]) {
    let dims = grid.dims();
    let stride: usize = dims[..axis].iter().product();
    let count = dims[axis];
    let block = stride * count;
    let mut out = vec![0.0f32; block];
    for slab in grid.as_mut_slice().chunks_exact_mut(block) {
        for x in 0..count {
            let row = &mut out[x * stride..(x + 1) * stride];
            add_scaled(row, &slab[x * stride..(x + 1) * stride], kernel[0], true);
            for (k, &w) in kernel.iter().enumerate().skip(1) {
                let (a, b) = (x.saturating_sub(k), (x + k).min(count - 1));
                add_scaled(row, &slab[a * stride..(a + 1) * stride], w, false);
                add_scaled(row, &slab[b * stride..(b + 1) * stride], w, false);
            }
        }
        slab.copy_from_slice(&out);
    }
}

fn add_scaled(out: &mut [f32], values: &[f32], weight: f32, start: bool) {
    if start {
        out.iter_mut().zip(values).for_each(|(o, v)| *o = v * weight);
    } else {
        out.iter_mut().zip(values).for_each(|(o, v)| *o += v * weight);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_constant_stays_and_an_impulse_keeps_its_sum() {
        let mut flat = Grid::filled([7, 6, 5], 2.0f32);
        gaussian(&mut flat, [1.0, 0.8, 1.2]);
        assert!(flat.as_slice().iter().all(|v| (v - 2.0).abs() < 1e-5));
        let mut impulse = Grid::filled([21, 21, 21], 0.0f32);
        impulse[[10, 10, 10]] = 1.0;
        gaussian(&mut impulse, [1.0; 3]);
        assert!((impulse.as_slice().iter().sum::<f32>() - 1.0).abs() < 1e-4);
        assert!((impulse[[11, 10, 10]] - impulse[[10, 10, 9]]).abs() < 1e-7);
    }
}
