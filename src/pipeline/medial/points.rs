//! Step 4: sub-voxel points of the voxels that are left.

use nalgebra::{Point3, Vector3};

use super::{MedialPoint, MedialSurface};
use crate::cancel::{Cancel, Cancelled};
use crate::numerics::field::{centre, id};
use crate::numerics::parallel::each;
use crate::numerics::topology::cube;
use crate::pipeline::solid::depth::{Depth, SKIN_REACH};

/// Steps of the refinement; each halves what is left, and half a voxel is the start: a thirtieth of a voxel is left.
/// With 1, six of 75 organs and shapes fail that did not, and 52 nodes end short, not 16; with 8 nothing is better.
const REFINE_STEPS: usize = 4;
/// How far a voxel is moved in one step at most: half of one, which is how far its centre may be off. With 0.25 the
/// overlap of a spleen is 0.88, not 0.91; with 1 nothing changes but by chance.
const MAX_STEP: f64 = 0.5;
/// Least rise of the difference of the two distances for each step along the normal, as a share of what it is between
/// two opposite feet. At rims feet are seen under small angles: with less, points would leap.
const MIN_SLOPE: f64 = 0.5;
/// How much further off than the nearest foot the second one may be, voxels: neighbouring voxels see
/// feet further off by up to twice their distance. With less, a voxel off the middle finds no foot on the other side.
const SLACK: f64 = 2.0;
/// Cosine to the normal from which a skin point is on one side: 75°. With 0, skin straight beyond a rim would
/// be on either side by chance; with much more, the foot on a slanted side would be missed.
const SIDE_COSINE: f64 = 0.25;
/// Points that one thread takes at a time; fewer are not worth handing over.
const POINTS_PER_TASK: usize = 64;
/// Voxels whose neighbours are searched together, side by side: the search begins anew with each lot.
const VOXELS_PER_LOT: usize = 4096;

/// The medial surface of the voxels that are left, which must be ascending, and none of them on the grid's edge.
pub(super) fn surface_of(left: &[usize], depth: &Depth, cancel: &dyn Cancel) -> Result<MedialSurface, Cancelled> {
    let points = each(left, POINTS_PER_TASK, |&voxel| medial_point(depth, voxel), cancel)?;
    let lots: Vec<&[usize]> = left.chunks(VOXELS_PER_LOT).collect();
    let lists = each(&lots, 1, |lot| touching(lot, left, depth.depth.dims()), cancel)?;
    Ok(MedialSurface { points, adjacency: lists.into_iter().flatten().collect() })
}

/// The 26-neighbours among `voxels` of some of them.
fn touching(some: &[usize], voxels: &[usize], [nx, ny, _]: [usize; 3]) -> Vec<Vec<u32>> {
    let mut lists = Vec::with_capacity(some.len());
    // Where each of the 27 neighbours would be: it moves on as the voxel does.
    let mut places = cube(some[0], nx, nx * ny).map(|n| voxels.partition_point(|&v| v < n));
    for &o in some {
        let mut list = Vec::new();
        for (place, n) in places.iter_mut().zip(cube(o, nx, nx * ny)) {
            while *place < voxels.len() && voxels[*place] < n {
                *place += 1;
            }
            if n != o && voxels.get(*place) == Some(&n) {
                list.push(id(*place));
            }
        }
        lists.push(list);
    }
    lists
}

/// The medial point of a voxel: its feet on two sides, and the place where they are equally far.
fn medial_point(depth: &Depth, voxel: usize) -> MedialPoint {
    let near = skin_around(depth, voxel);
    let mut position = centre(depth.depth.index(voxel));
    let mut feet = two_feet(depth, &near, position);
    let mut normal = (feet[0] - feet[1]).try_normalize(1e-9).unwrap_or_else(Vector3::z);
    for _ in 0..REFINE_STEPS {
        let sides = (foot_on_side(depth, &near, position, normal), foot_on_side(depth, &near, position, -normal));
        let (Some((a, foot_a)), Some((b, foot_b))) = sides else { break };
        feet = [foot_a, foot_b];
        normal = (foot_a - foot_b).try_normalize(1e-9).unwrap_or(normal);
        let slope = ((foot_a - foot_b).norm() / (a + b)).max(MIN_SLOPE);
        position += normal * ((a - b) / (2.0 * slope)).clamp(-MAX_STEP, MAX_STEP);
    }
    let (a, b) = (feet[0] - position, feet[1] - position);
    let radius = (a.norm() + b.norm()) / 2.0;
    let feet_cosine = a.dot(&b) / (a.norm() * b.norm()).max(1e-9);
    MedialPoint { voxel, position, feet, normal, radius, feet_cosine }
}

/// The skin points nearest to a voxel and to those around it, ascending.
fn skin_around(depth: &Depth, voxel: usize) -> Vec<u32> {
    let (nearest, below) = (depth.nearest.as_slice(), depth.depth.as_slice());
    let [nx, ny, _] = depth.depth.dims();
    let mut near = vec![nearest[voxel]];
    for n in cube(voxel, nx, nx * ny) {
        if below[n] > 0.0 {
            near.push(nearest[n]);
        }
    }
    near.sort_unstable();
    near.dedup();
    near
}

/// The nearest of some skin points, and of those nearly as near the one seen under the widest
/// angle from it.
fn two_feet(depth: &Depth, near: &[u32], p: Point3<f64>) -> [Point3<f64>; 2] {
    let (mut first, mut least) = (p, f64::INFINITY);
    for &s in near {
        let q = depth.skin[s as usize].position;
        let distance = (q - p).norm();
        if distance < least {
            (first, least) = (q, distance);
        }
    }
    let reach = (first - p).norm() + SLACK;
    let (mut second, mut least) = (first, f64::INFINITY);
    for &s in near {
        let q = depth.skin[s as usize].position;
        if (q - p).norm() > reach {
            continue;
        }
        let cosine = (q - p).normalize().dot(&(first - p).normalize());
        if cosine.total_cmp(&least).is_lt() {
            (second, least) = (q, cosine);
        }
    }
    [first, second]
}

/// Distance and place of the boundary nearest to `p` among some skin points on one side.
fn foot_on_side(depth: &Depth, near: &[u32], p: Point3<f64>, side: Vector3<f64>) -> Option<(f64, Point3<f64>)> {
    let (mut best, mut least) = (None, f64::INFINITY);
    for &s in near {
        let point = &depth.skin[s as usize];
        let to = point.position - p;
        if to.dot(&side) <= SIDE_COSINE * to.norm() {
            continue;
        }
        let distance = point.distance(p);
        if distance < least {
            (best, least) = (Some(point), distance);
        }
    }
    let best = best?;
    // The foot lies in the point's tangent plane, within the reach it speaks for.
    let v = p - best.position;
    let across = v - best.normal * v.dot(&best.normal);
    Some((least, best.position + across * (SKIN_REACH / across.norm().max(SKIN_REACH))))
}
