//! How much of a figure's vectors lies outside of the label as it was sent.

use nalgebra::Point3;
use rayon::prelude::*;

use super::placed::Placed;
use crate::cancel::{Cancel, Cancelled};
use crate::numerics::field::floor_index;
use crate::space::Grid;

/// Points looked at along a vector, its ends among them. With fewer, a gap that a vector leaps over would be missed; more
/// say nothing new.
const POINTS: usize = 11;

/// Share of the points along a figure's vectors that are more than a voxel outside of the label. What lies on the
/// boundary is half a voxel from a centre inside.
///
/// # Errors
/// When it is cancelled.
pub fn outside_share(label: &Grid<bool>, figure: &Placed<'_>, cancel: &dyn Cancel) -> Result<f64, Cancelled> {
    let vectors = figure.draft.vectors();
    let of_vector = |[from, to]: &[Point3<f64>; 2]| {
        cancel.check()?;
        let mut outside = 0;
        for n in 0..POINTS {
            let at = from + (to - from) * (n as f64 / (POINTS - 1) as f64);
            outside += usize::from(!is_near(label, figure.into_label.point(at)));
        }
        Ok(outside)
    };
    let outside: Vec<usize> = vectors.par_iter().map(of_vector).collect::<Result<_, Cancelled>>()?;
    Ok(outside.iter().sum::<usize>() as f64 / (POINTS * vectors.len()).max(1) as f64)
}

/// Whether the voxel that a place is in, or one that touches it, is of the label.
fn is_near(label: &Grid<bool>, place: Point3<f64>) -> bool {
    let dims = label.dims();
    let voxel = [0, 1, 2].map(|axis| floor_index(place[axis] + 0.5));
    let low = voxel.map(|x| x.saturating_sub(1));
    let high = [0, 1, 2].map(|axis| (voxel[axis] + 1).min(dims[axis] - 1));
    for k in low[2]..=high[2] {
        for j in low[1]..=high[1] {
            for i in low[0]..=high[0] {
                if label[[i, j, k]] {
                    return true;
                }
            }
        }
    }
    false
}
