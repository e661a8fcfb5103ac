//! A solid cut in two by a plane.

use std::cmp::Reverse;

use nalgebra::{Point3, Vector3};

use super::remainders::pieces;
use crate::cancel::{Cancel, Cancelled};
use crate::numerics::field::{centre, floor_index};
use crate::numerics::moments::Axes3;
use crate::pipeline::solid::Solid;
use crate::space::Grid;

/// Share of the voxels that lies on either side of the cut at the least. With 0.1 or 0.3, L3 and L4 have an overlap of 0.83, not
/// 0.88: other places than the pedicles are narrower, or lie too far out.
const EITHER_SIDE: f64 = 0.2;

/// The pieces of both halves of a solid, of `least` voxels or more each. It is cut across one of its principal axes, where its
/// section is least: a body from its arch rather than through the middle.
///
/// # Errors
/// When it is cancelled.
pub(super) fn halves(solid: &Solid, least: f64, cancel: &dyn Cancel) -> Result<Vec<Grid<bool>>, Cancelled> {
    let inside = &solid.inside;
    let mut points = Vec::new();
    for (voxel, is_inside) in inside.as_slice().iter().enumerate() {
        if *is_inside {
            points.push(centre(inside.index(voxel)));
        }
    }
    let Some((axis, at)) = narrowest(&points, solid.voxels_per_grain) else { return Ok(Vec::new()) };
    // The pieces of the larger half first: which way an axis points says nothing.
    let mut all = Vec::new();
    for is_first in [true, false] {
        cancel.check()?;
        let mut half = inside.clone();
        for voxel in 0..half.as_slice().len() {
            let along = centre(half.index(voxel)).coords.dot(&axis);
            half.as_mut_slice()[voxel] &= (along < at) == is_first;
        }
        all.push(pieces(&half, least, cancel)?);
    }
    let voxels = |pieces: &Vec<Grid<bool>>| -> usize { pieces.iter().map(marked).sum() };
    all.sort_by_key(|pieces| Reverse(voxels(pieces)));
    Ok(all.into_iter().flatten().collect())
}

/// How many voxels are marked.
fn marked(grid: &Grid<bool>) -> usize {
    grid.as_slice().iter().filter(|is_marked| **is_marked).count()
}

/// Across which direction, and where along it, some points have the least section; `None` of points in one place. `grain`:
/// thickness of a section.
fn narrowest(points: &[Point3<f64>], grain: f64) -> Option<(Vector3<f64>, f64)> {
    let (_, axes) = Axes3::of_points(points);
    let mut best: Option<(f64, Vector3<f64>, f64)> = None;
    for axis in axes.directions {
        let mut along: Vec<f64> = points.iter().map(|point| point.coords.dot(&axis)).collect();
        along.sort_by(f64::total_cmp);
        let inner = floor_index(EITHER_SIDE * points.len() as f64);
        let Some([low, high]) = along.get(inner).zip(along.get(points.len() - 1 - inner)).map(|(a, b)| [*a, *b]) else {
            continue;
        };
        let sections = floor_index(((high - low) / grain).ceil());
        let thickness = (high - low) / sections.max(1) as f64;
        let mut counts = vec![0usize; sections];
        for place in along {
            if place >= low && place < high {
                counts[floor_index((place - low) / thickness).min(sections - 1)] += 1;
            }
        }
        for (section, count) in counts.into_iter().enumerate() {
            let area = count as f64 / thickness;
            if best.is_none_or(|best| area < best.0) {
                best = Some((area, axis, low + (section as f64 + 0.5) * thickness));
            }
        }
    }
    best.map(|(_, axis, at)| (axis, at))
}
