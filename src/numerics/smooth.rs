//! Separable Gaussian smoothing.

use std::collections::VecDeque;
use std::iter::Sum;
use std::ops::{Add, Div, Mul};

use rayon::prelude::*;

use super::field::floor_index;
use crate::space::Grid;

use crate::cancel::{Cancel, Cancelled};

/// Where the kernel is cut, in standard deviations. At 3 what is left out is 0.3 %.
const CUT_SIGMAS: f64 = 3.0;

/// Convolves with a Gaussian of `sigma` voxels along each axis; the edge value goes on outside.
///
/// # Errors
/// When it is cancelled.
pub fn gaussian(grid: &mut Grid<f32>, sigma: [f64; 3], cancel: &dyn Cancel) -> Result<(), Cancelled> {
    let width = grid.dims()[0];
    if sigma[0] > 0.0 && width > 0 {
        let kernel = kernel(sigma[0]);
        let rows = grid.as_mut_slice().par_chunks_mut(width).with_min_len(64);
        rows.try_for_each_init(Vec::new, |scratch, row| {
            cancel.check()?;
            along_row(row, &kernel, scratch);
            Ok(())
        })?;
    }
    for axis in [1, 2] {
        if sigma[axis] > 0.0 {
            let kernel = kernel(sigma[axis]);
            let groups = grid.rows_across(axis).into_par_iter();
            groups.try_for_each(|mut rows| {
                cancel.check()?;
                across_rows(&mut rows, &kernel);
                Ok(())
            })?;
        }
    }
    Ok(())
}

/// Half of a normalised kernel: the centre and one flank.
fn kernel(sigma: f64) -> Vec<f32> {
    let reach = floor_index((CUT_SIGMAS * sigma).ceil()).max(1);
    let raw: Vec<f64> = (0..=reach).map(|x| (-((x * x) as f64) / (2.0 * sigma * sigma)).exp()).collect();
    let sum = raw[0] + 2.0 * raw[1..].iter().sum::<f64>();
    #[expect(clippy::cast_possible_truncation, reason = "the grid is f32")]
    raw.iter().map(|w| (w / sum) as f32).collect()
}

/// Along one row; `scratch` takes a copy of it with its edge values going on.
fn along_row(row: &mut [f32], kernel: &[f32], scratch: &mut Vec<f32>) {
    let (first, last, reach) = (row[0], row[row.len() - 1], kernel.len() - 1);
    scratch.clear();
    scratch.resize(reach, first);
    scratch.extend_from_slice(row);
    scratch.resize(row.len() + 2 * reach, last);
    let from = |place: usize| &scratch[place..];
    add_scaled(row, from(reach), kernel[0], true);
    for (k, &w) in kernel.iter().enumerate().skip(1) {
        add_scaled(row, from(reach - k), w, false);
        add_scaled(row, from(reach + k), w, false);
    }
}

/// Along the lines that run across rows. The rows behind are overwritten: the last few are kept.
fn across_rows(rows: &mut [&mut [f32]], kernel: &[f32]) {
    let (count, reach) = (rows.len(), kernel.len() - 1);
    let mut behind: VecDeque<Vec<f32>> = VecDeque::new();
    let mut spare = Vec::new();
    for x in 0..count {
        let mut own: Vec<f32> = std::mem::take(&mut spare);
        own.clear();
        own.extend_from_slice(rows[x]);
        behind.push_back(own);
        // The originals of rows x − reach to x, as far as there are such.
        let original = |row: usize| &behind[behind.len() - 1 - (x - row)];
        let (done, ahead) = rows.split_at_mut(x + 1);
        let out = &mut *done[x];
        add_scaled(out, original(x), kernel[0], true);
        for (k, &w) in kernel.iter().enumerate().skip(1) {
            add_scaled(out, original(x.saturating_sub(k)), w, false);
            let next = (x + k).min(count - 1);
            add_scaled(out, if next == x { original(x) } else { &*ahead[next - x - 1] }, w, false);
        }
        if behind.len() > reach {
            spare = behind.pop_front().unwrap_or_default();
        }
    }
}

fn add_scaled(out: &mut [f32], values: &[f32], weight: f32, start: bool) {
    if start {
        out.iter_mut().zip(values).for_each(|(o, v)| *o = v * weight);
    } else {
        out.iter_mut().zip(values).for_each(|(o, v)| *o += v * weight);
    }
}

/// Values along a closed line, smoothed by a Gaussian of `sigma` of their steps.
#[must_use]
pub fn gaussian_around<T>(values: &[T], sigma: f64) -> Vec<T>
where
    T: Copy + Add<Output = T> + Mul<f64, Output = T> + Div<f64, Output = T> + Sum,
{
    let reach = floor_index((CUT_SIGMAS * sigma).ceil());
    let weights: Vec<f64> = (0..=reach).map(|d| (-0.5 * (d as f64 / sigma).powi(2)).exp()).collect();
    let total = weights[0] + 2.0 * weights[1..].iter().sum::<f64>();
    let count = values.len();
    let mut smooth = Vec::with_capacity(count);
    for k in 0..count {
        let pair = |d: usize| values[(k + d) % count] + values[(k + count * (1 + reach) - d) % count];
        let beside: T = (1..=reach).map(|d| pair(d) * weights[d]).sum();
        smooth.push((values[k] * weights[0] + beside) / total);
    }
    smooth
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cancel::Never;

    #[test]
    fn a_constant_stays_and_an_impulse_keeps_its_sum() {
        let mut flat = Grid::filled([7, 6, 5], 2.0f32);
        gaussian(&mut flat, [1.0, 0.8, 1.2], &Never).expect("not stopped");
        assert!(flat.as_slice().iter().all(|v| (v - 2.0).abs() < 1e-5));
        let mut impulse = Grid::filled([21, 21, 21], 0.0f32);
        impulse[[10, 10, 10]] = 1.0;
        gaussian(&mut impulse, [1.0; 3], &Never).expect("not stopped");
        assert!((impulse.as_slice().iter().sum::<f32>() - 1.0).abs() < 1e-4);
        assert!((impulse[[11, 10, 10]] - impulse[[10, 10, 9]]).abs() < 1e-7);
    }

    #[test]
    fn a_closed_line_has_no_ends() {
        let mut impulse = vec![0.0; 30];
        impulse[0] = 1.0;
        let smooth = gaussian_around(&impulse, 2.0);
        assert!((smooth.iter().sum::<f64>() - 1.0).abs() < 1e-12 && smooth[29] == smooth[1]);
        assert!((smooth[2] / smooth[0] - (-0.5f64).exp()).abs() < 1e-12);
    }
}
