//! Step 1: which medial points see the same two sides.

use crate::cancel::{Cancel, Cancelled};
use crate::numerics::field::id;
use crate::pipeline::medial::MedialSurface;

/// How far a foot may move between adjacent points of one sheet, as a share of the radius. Where
/// n equal arms meet it jumps by 2 sin(180°/n) radii: 1.7 for three, 1.4 for four, 1.2 for five. With more, arms
/// hang together; with less, a sheet that bends as sharply as it is thick comes apart.
const FOOT_JUMP: f64 = 0.75;
/// Movement that is always allowed, voxels: what the grid does to thin sheets. With less they come apart; with more,
/// thin arms hang together.
const FOOT_JUMP_FLOOR: f64 = 2.5;
/// Cosine of the angle between the feet of a point that belongs to a sheet beyond doubt: 105°. The
/// edges of a box have medial sheets of their own that see them under 90°: nearer to that they would count as sheets;
/// nearer to 180° sheets would lose their rims.
const SURE_FEET_COSINE: f64 = -0.25;

/// Whether a point belongs to a sheet beyond doubt.
pub(super) fn is_sure(surface: &MedialSurface, p: u32) -> bool {
    surface.point(p).feet_cosine < SURE_FEET_COSINE
}

/// Whether both feet move on smoothly from one point to another.
pub(super) fn is_linked(surface: &MedialSurface, from: u32, to: u32) -> bool {
    let (a, b) = (surface.point(from), surface.point(to));
    let limit = (FOOT_JUMP * a.radius.min(b.radius)).max(FOOT_JUMP_FLOOR);
    // Which foot of one goes with which of the other is open, as the first foot is arbitrary.
    let [[p, q], [r, s]] = a.feet.map(|foot| b.feet.map(|other| (foot - other).norm()));
    p.max(s).min(q.max(r)) <= limit
}

/// Steps along the surface to the nearest sure point whose foot jumps towards a sure neighbour;
/// counted up to `most`.
pub(super) fn steps_from_jumps(
    surface: &MedialSurface,
    most: usize,
    cancel: &dyn Cancel,
) -> Result<Vec<usize>, Cancelled> {
    let mut steps = vec![most; surface.points.len()];
    let mut front = Vec::new();
    for p in 0..id(steps.len()) {
        cancel.check()?;
        if is_sure(surface, p) && has_jump(surface, p) {
            front.push(p);
        }
    }
    for step in 0..most {
        cancel.check()?;
        for &p in &front {
            steps[p as usize] = step;
        }
        let mut next = Vec::new();
        for p in front {
            for &n in &surface.adjacency[p as usize] {
                if steps[n as usize] > step + 1 {
                    next.push(n);
                }
            }
        }
        next.sort_unstable();
        next.dedup();
        front = next;
    }
    Ok(steps)
}

/// Whether a foot jumps towards a sure neighbour of a point.
fn has_jump(surface: &MedialSurface, p: u32) -> bool {
    for &n in &surface.adjacency[p as usize] {
        if is_sure(surface, n) && !is_linked(surface, p, n) {
            return true;
        }
    }
    false
}
