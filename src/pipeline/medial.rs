//! Stage 2: the medial surface.
//!
//! Distance-ordered homotopic thinning (Pudney, CVIU 72, 1998; Siddiqi et al., *Hamilton-Jacobi
//! skeletons*, IJCV 48, 2002) of the solid:
//!
//! 1. a voxel is *medial* where two skin points far apart, seen under a wide angle, are equally
//!    near (the integer medial axis of Hesselink, Roerdink, PAMI 30, 2008, on sub-voxel feet);
//! 2. all others are taken away from the skin inward as long as no topology changes;
//! 3. medial voxels that are no end of a surface are taken away where it is thicker than one voxel;
//! 4. each voxel is moved to where its two feet are equally far: the sub-voxel medial point.
//!
//! We leave the paper (Palágyi's 3-subiteration thinning) because the order of the distance
//! field centres the surface at any orientation, where subiterations favour grid directions.

use std::cmp::Reverse;
use std::collections::BinaryHeap;

use nalgebra::{Point3, Vector3};

use crate::numerics::components::{Connectivity, neighbors};
use crate::numerics::field::id;
use crate::numerics::topology::{is_simple, is_surface_end, neighborhood};
use crate::space::Grid;

use super::depth::Depth;
use super::mask::Solid;
use super::observer::{Cancelled, Observer};
use super::surface::Surface;

/// Cosine of the angle under which a medial voxel must see its two feet: 60°. Where n arms meet,
/// the middle sees feet 360°/n apart; bumps and edges are seen under small angles too, and are told
/// apart by stage 3.
const FEET_COSINE: f64 = 0.5;
/// Distance of the two feet of a medial voxel at the least, voxels: below it the staircase
/// of the grid makes feet of its own.
const MIN_CHORD: f64 = 3.0;
/// Difference of two distances that rounding can make, voxels.
const TIE: f64 = 0.05;
/// How many voxels are thinned between two looks at the observer.
const CANCEL_EVERY: usize = 1 << 14;
/// Steps of the sub-voxel refinement; each halves what is left, and half a voxel is the start.
const REFINE_STEPS: usize = 4;

/// A voxel of the medial surface with its sub-voxel centre, in work space.
#[derive(Clone, Copy, Debug)]
pub struct MedialPoint {
    /// Offset of the voxel in the working grid.
    pub voxel: usize,
    /// Sub-voxel position.
    pub position: Point3<f64>,
    /// Nearest points of the boundary on the two sides.
    pub feet: [Point3<f64>; 2],
    /// Unit normal of the sheet, towards the first foot; the sign is arbitrary.
    pub normal: Vector3<f64>,
    /// Distance to the boundary, voxels.
    pub radius: f64,
    /// Cosine of the angle between the two feet: −1 inside a sheet, towards 0 at its rim.
    pub feet_cosine: f64,
}

/// The medial surface.
#[derive(Clone, Debug)]
pub struct MedialSurface {
    /// Its voxels, ascending in offset.
    pub points: Vec<MedialPoint>,
    /// 26-neighbours of each point.
    pub adjacency: Vec<Vec<u32>>,
}

impl MedialSurface {
    /// The part made of some points (ascending).
    #[must_use]
    pub fn part(&self, members: &[u32]) -> Surface {
        let touching = |p: u32| self.adjacency[p as usize].clone();
        Surface::part(|p| self.points[p as usize].position, touching, members)
    }
}

/// Thins a solid to its medial surface.
///
/// # Errors
/// When the observer asks to stop.
pub fn medial_surface(solid: &Solid, depth: &Depth, observer: &dyn Observer) -> Result<MedialSurface, Cancelled> {
    let is_medial = medial_voxels(solid, depth);
    let thinned = thin(&solid.inside, depth, &is_medial, observer)?;
    Ok(surface_of(&thinned, depth))
}

/// Voxels between two far feet.
fn medial_voxels(solid: &Solid, depth: &Depth) -> Vec<bool> {
    let inside = solid.inside.as_slice();
    let [nx, ny, _] = solid.inside.dims();
    let mut is_medial = vec![false; inside.len()];
    for offset in 0..inside.len() {
        if !inside[offset] {
            continue;
        }
        let at = Point3::from(solid.inside.index(offset).map(|x| x as f64));
        for (axis, stride) in [1, nx, nx * ny].into_iter().enumerate() {
            let next = offset + stride;
            let (a, b) = (depth.nearest.as_slice()[offset], depth.nearest.as_slice()[next]);
            if !inside[next] || a == b {
                continue;
            }
            let mut between = at;
            between[axis] += 0.5;
            let a = depth.skin[a as usize].position - between;
            let b = depth.skin[b as usize].position - between;
            let wide = a.dot(&b) < FEET_COSINE * a.norm() * b.norm();
            if wide && (a - b).norm_squared() >= MIN_CHORD * MIN_CHORD {
                // Of the two, the one nearer to the bisector of the feet; the first of equals, so
                // that the middle of an even thickness is one layer, not a mixture of two.
                let is_beyond = b.norm() - a.norm() > TIE;
                is_medial[if is_beyond { next } else { offset }] = true;
            }
        }
    }
    is_medial
}

/// The rank of a depth in the order of thinning. Depths are compared in steps: in a sheet of even
/// thickness two layers are equally deep but for rounding, and taking from both by turns would
/// leave them corrugated. The offset, which breaks ties, takes one whole layer first.
fn rank(depth: f32) -> u32 {
    /// Steps per voxel, and a phase that keeps whole and half depths off the borders.
    const STEPS: f32 = 16.0;
    const PHASE: f32 = 0.37;
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "depths are small and not negative")]
    let rank = (depth * STEPS + PHASE) as u32;
    rank
}

/// Takes simple voxels away in the order of their depth.
fn thin(
    inside: &Grid<bool>,
    depth: &Depth,
    is_medial: &[bool],
    observer: &dyn Observer,
) -> Result<Grid<bool>, Cancelled> {
    let dims = inside.dims();
    let (nx, nxy) = (dims[0], dims[0] * dims[1]);
    let depth = depth.depth.as_slice();
    let mut left = inside.clone();
    let mut is_queued = vec![false; left.as_slice().len()];
    let mut heap = BinaryHeap::new();
    let entry = |o: usize| Reverse((rank(depth[o]), id(o)));
    for o in (0..left.as_slice().len()).filter(|&o| left.as_slice()[o] && !is_medial[o]) {
        if is_simple(neighborhood(left.as_slice(), o, nx, nxy)) {
            heap.push(entry(o));
            is_queued[o] = true;
        }
    }
    let mut steps = 0usize;
    while let Some(Reverse((_, offset))) = heap.pop() {
        steps += 1;
        if steps.is_multiple_of(CANCEL_EVERY) {
            observer.check()?;
        }
        let o = offset as usize;
        is_queued[o] = false;
        let bits = neighborhood(left.as_slice(), o, nx, nxy);
        if !is_simple(bits) {
            continue;
        }
        left.as_mut_slice()[o] = false;
        neighbors(dims, o, Connectivity::Corners26, |n| {
            if left.as_slice()[n] && !is_queued[n] && !is_medial[n] {
                is_queued[n] = true;
                heap.push(entry(n));
            }
        });
    }
    thin_to_one_voxel(&mut left, depth, is_medial);
    Ok(left)
}

/// Medial voxels make the surface two thick in places: what is no end of the surface is thinned,
/// until nothing changes.
fn thin_to_one_voxel(left: &mut Grid<bool>, depth: &[f32], is_medial: &[bool]) {
    /// Rounds at most; each takes at least one voxel away, and two or three are the rule.
    const MAX_ROUNDS: usize = 64;
    let dims = left.dims();
    let mut order: Vec<usize> = (0..left.as_slice().len()).filter(|&o| left.as_slice()[o]).collect();
    order.sort_by_key(|&o| (rank(depth[o]), o));
    for _ in 0..MAX_ROUNDS {
        let before = order.len();
        order.retain(|&o| {
            let bits = neighborhood(left.as_slice(), o, dims[0], dims[0] * dims[1]);
            let goes = is_simple(bits) && !(is_medial[o] && is_surface_end(bits));
            left.as_mut_slice()[o] = !goes;
            !goes
        });
        if order.len() == before {
            break;
        }
    }
}

/// Sub-voxel points of the voxels that are left.
fn surface_of(left: &Grid<bool>, depth: &Depth) -> MedialSurface {
    let dims = left.dims();
    let voxels: Vec<usize> = (0..left.as_slice().len()).filter(|&o| left.as_slice()[o]).collect();
    let number = |o: usize| voxels.binary_search(&o).ok().map(id);
    let adjacency = voxels
        .iter()
        .map(|&o| {
            let mut list = Vec::new();
            neighbors(dims, o, Connectivity::Corners26, |n| {
                if left.as_slice()[n] {
                    list.extend(number(n));
                }
            });
            list
        })
        .collect();
    let points = voxels.iter().map(|&o| medial_point(left, depth, o)).collect();
    MedialSurface { points, adjacency }
}

/// The medial point of a voxel: its feet on two sides, and the place where they are equally far.
fn medial_point(left: &Grid<bool>, depth: &Depth, voxel: usize) -> MedialPoint {
    let mut near = vec![depth.nearest.as_slice()[voxel]];
    neighbors(left.dims(), voxel, Connectivity::Corners26, |n| {
        if depth.depth.as_slice()[n] > 0.0 {
            near.push(depth.nearest.as_slice()[n]);
        }
    });
    near.sort_unstable();
    near.dedup();
    let mut position = Point3::from(left.index(voxel).map(|x| x as f64));
    let (first, second) = two_feet(depth, &near, position);
    let mut normal = (first - second).try_normalize(1e-9).unwrap_or_else(Vector3::z);
    let mut feet = [first, second];
    for _ in 0..REFINE_STEPS {
        let sides = [normal, -normal].map(|n| foot_on_side(depth, &near, position, n));
        let [Some((a, foot_a)), Some((b, foot_b))] = sides else { break };
        feet = [foot_a, foot_b];
        normal = (foot_a - foot_b).try_normalize(1e-9).unwrap_or(normal);
        let slope = ((foot_a - foot_b).norm() / (a + b)).max(0.5);
        position += normal * ((a - b) / (2.0 * slope)).clamp(-0.5, 0.5);
    }
    let arms = feet.map(|f| f - position);
    let radius = (arms[0].norm() + arms[1].norm()) / 2.0;
    let feet_cosine = arms[0].dot(&arms[1]) / (arms[0].norm() * arms[1].norm()).max(1e-9);
    MedialPoint { voxel, position, feet, normal, radius, feet_cosine }
}

/// The nearest of some skin points, and of those nearly as near the one seen under the widest
/// angle from it.
fn two_feet(depth: &Depth, near: &[u32], p: Point3<f64>) -> (Point3<f64>, Point3<f64>) {
    /// Neighbouring voxels see feet further off by up to twice their distance.
    const SLACK: f64 = 2.0;
    let at = |s: &u32| depth.skin[*s as usize].position;
    let first = near.iter().map(at).min_by(|a, b| (a - p).norm().total_cmp(&(b - p).norm())).unwrap_or(p);
    let reach = (first - p).norm() + SLACK;
    let cosine = |q: &Point3<f64>| (q - p).normalize().dot(&(first - p).normalize());
    let second = near.iter().map(at).filter(|q| (q - p).norm() <= reach).min_by(|a, b| cosine(a).total_cmp(&cosine(b)));
    (first, second.unwrap_or(first))
}

/// Distance and place of the boundary nearest to `p` among some skin points on one side.
fn foot_on_side(depth: &Depth, near: &[u32], p: Point3<f64>, side: Vector3<f64>) -> Option<(f64, Point3<f64>)> {
    let points = near.iter().map(|s| &depth.skin[*s as usize]);
    let best = points
        .filter(|s| (s.position - p).dot(&side) > 0.25 * (s.position - p).norm())
        .min_by(|a, b| a.distance(p).total_cmp(&b.distance(p)))?;
    let distance = best.distance(p);
    // The foot lies in the point's tangent plane, within the reach it speaks for.
    let v = p - best.position;
    let across = v - best.normal * v.dot(&best.normal);
    let foot = best.position + across * (0.7 / across.norm().max(0.7));
    Some((distance, foot))
}
