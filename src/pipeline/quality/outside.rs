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
    let nodes = figure.nodes;
    let of_node = |node: usize| {
        cancel.check()?;
        let mut outside = 0;
        for end in [nodes.upper[node], nodes.lower[node]] {
            for n in 0..POINTS {
                let at = nodes.medial[node] + (end - nodes.medial[node]) * (n as f64 / (POINTS - 1) as f64);
                outside += usize::from(!is_near(label, figure.into_label.point(at)));
            }
        }
        Ok(if nodes.valid[node] { outside } else { 0 })
    };
    let outside: Vec<usize> = (0..nodes.medial.len()).into_par_iter().map(of_node).collect::<Result<_, Cancelled>>()?;
    let valid = nodes.valid.iter().filter(|is_valid| **is_valid).count();
    Ok(outside.iter().sum::<usize>() as f64 / (2 * POINTS * valid).max(1) as f64)
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
