//! Stage 2: the medial surface.
//!
//! Distance-ordered homotopic thinning (Pudney, CVIU 72, 1998; Siddiqi et al., *Hamilton-Jacobi
//! skeletons*, IJCV 48, 2002) of the solid:
//!
//! 1. a voxel is *medial* where two skin points far apart, seen under a wide angle, are equally
//!    near (the integer medial axis of Hesselink, Roerdink, PAMI 30, 2008, on sub-voxel feet);
//! 2. all others are taken away from the skin inward as long as no topology changes: those far from
//!    medial voxels by all threads together ([`crate::pipeline::medial::peel`]), the rest one by one, by depth;
//! 3. medial voxels that are no end of a surface are taken away where it is thicker than one voxel;
//! 4. each voxel is moved to where its two feet are equally far: the sub-voxel medial point.
//!
//! We leave the paper (Palágyi's 3-subiteration thinning) because the order of the distance
//! field centres the surface at any orientation, where subiterations favour grid directions.

mod peel;

use std::cmp::Reverse;
use std::collections::BinaryHeap;

use nalgebra::{Point3, Vector3};
use rayon::prelude::*;

use crate::numerics::components::{Connectivity, neighbors};
use crate::numerics::field::{floor_index, id};
use crate::numerics::topology::{is_simple, is_surface_end, neighborhood};
use crate::space::Grid;

use crate::cancel::{Cancel, Cancelled};
use crate::pipeline::medial::peel::{around, peeled, state};
use crate::pipeline::sheets::surface::Surface;
use crate::pipeline::solid::Solid;
use crate::pipeline::solid::depth::Depth;

/// Cosine of the angle under which a medial voxel must see its two feet: 60°. Where n arms meet,
/// the middle sees feet 360°/n apart; bumps and edges are seen under small angles too, and are told
/// apart by stage 3.
const FEET_COSINE: f64 = 0.5;
/// Distance of the two feet of a medial voxel at the least, voxels: below it the staircase
/// of the grid makes feet of its own.
const MIN_CHORD: f64 = 3.0;
/// Difference of two distances that rounding can make, voxels.
const TIE: f64 = 0.05;
/// How many voxels are thinned between two looks at whether to stop.
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
    ///
    /// # Errors
    /// When it is cancelled.
    pub fn part(&self, members: &[u32], cancel: &dyn Cancel) -> Result<Surface, Cancelled> {
        let touching = |p: u32, list: &mut Vec<u32>| list.extend_from_slice(&self.adjacency[p as usize]);
        Surface::made_of(members, self.points.len(), |p| self.points[p as usize].position, touching, cancel)
    }
}

/// Thins a solid to its medial surface.
///
/// # Errors
/// When it is cancelled.
pub fn medial_surface(solid: &Solid, depth: &Depth, cancel: &dyn Cancel) -> Result<MedialSurface, Cancelled> {
    let medial = medial_voxels(solid, depth, cancel)?;
    let left = thin(&solid.inside, depth, &medial, cancel)?;
    surface_of(&left, depth, cancel)
}

/// Voxels between two far feet.
fn medial_voxels(solid: &Solid, depth: &Depth, cancel: &dyn Cancel) -> Result<Vec<usize>, Cancelled> {
    let inside = solid.inside.as_slice();
    let [nx, ny, _] = solid.inside.dims();
    let nearest = depth.nearest.as_slice();
    let of_row = |row: usize| {
        cancel.check()?;
        let mut found = Vec::new();
        for i in 0..nx {
            let offset = row * nx + i;
            if !inside[offset] {
                continue;
            }
            for (axis, stride) in [1, nx, nx * ny].into_iter().enumerate() {
                let next = offset + stride;
                let (a, b) = (nearest[offset], nearest[next]);
                if a == b || !inside[next] {
                    continue;
                }
                let mut between = Point3::new(i as f64, (row % ny) as f64, (row / ny) as f64);
                between[axis] += 0.5;
                let a = depth.skin[a as usize].position - between;
                let b = depth.skin[b as usize].position - between;
                let wide = a.dot(&b) < FEET_COSINE * a.norm() * b.norm();
                if wide && (a - b).norm_squared() >= MIN_CHORD * MIN_CHORD {
                    // Of the two, the one nearer to the bisector of the feet; the first of equals,
                    // so that the middle of an even thickness is one layer, not a mixture of two.
                    let is_beyond = b.norm() - a.norm() > TIE;
                    found.push(if is_beyond { next } else { offset });
                }
            }
        }
        Ok(found)
    };
    let rows = (0..inside.len() / nx).into_par_iter().with_min_len(16).map(of_row);
    Ok(rows.collect::<Result<Vec<Vec<usize>>, _>>()?.concat())
}

/// The rank of a depth in the order of thinning. Depths are compared in steps: in a sheet of even
/// thickness two layers are equally deep but for rounding, and taking from both by turns would
/// leave them corrugated. The offset, which breaks ties, takes one whole layer first.
fn rank(depth: f32) -> usize {
    /// Steps per voxel, and a phase that keeps whole and half depths off the borders.
    const STEPS: f32 = 16.0;
    const PHASE: f32 = 0.37;
    floor_index(f64::from(depth * STEPS + PHASE))
}

/// Voxels in the order of rank and offset. Ranks ahead are buckets, sorted when their turn comes.
#[derive(Default)]
struct Front {
    ahead: Vec<Vec<u32>>,
    rank: usize,
    /// The bucket of the current rank, descending.
    current: Vec<u32>,
    /// What came when its rank had already begun.
    late: BinaryHeap<Reverse<(usize, u32)>>,
}

impl Front {
    fn push(&mut self, rank: usize, voxel: u32) {
        if rank <= self.rank {
            self.late.push(Reverse((rank, voxel)));
        } else {
            if rank >= self.ahead.len() {
                self.ahead.resize_with(rank + 1, Vec::new);
            }
            self.ahead[rank].push(voxel);
        }
    }

    fn pop(&mut self) -> Option<usize> {
        while self.current.is_empty() && self.late.is_empty() {
            self.rank += 1;
            self.current = std::mem::take(self.ahead.get_mut(self.rank)?);
            self.current.sort_unstable_by_key(|o| Reverse(*o));
        }
        let next = self.current.last().map(|&o| (self.rank, o));
        let is_late = self.late.peek().is_some_and(|Reverse(late)| next.is_none_or(|next| *late < next));
        let voxel = if is_late { self.late.pop().map(|Reverse(late)| late.1) } else { self.current.pop() };
        voxel.map(|o| o as usize)
    }
}

/// Takes simple voxels away in the order of their depth; returns those that are left, ascending.
fn thin(inside: &Grid<bool>, depth: &Depth, medial: &[usize], cancel: &dyn Cancel) -> Result<Vec<usize>, Cancelled> {
    use state::{LEFT, MEDIAL, NEAR, OPEN, QUEUED};
    let [nx, ny, _] = inside.dims();
    let nxy = nx * ny;
    let rank_of = |o: usize| rank(depth.depth.as_slice()[o]);
    let mut cells = peeled(inside, depth, medial, cancel)?;
    let mut front = Front::default();
    for o in 0..cells.len() {
        if o.is_multiple_of(CANCEL_EVERY) {
            cancel.check()?;
        }
        let is_open = cells[o] & (LEFT | OPEN | MEDIAL) == LEFT | OPEN;
        if is_open && is_simple(neighborhood(|n| cells[n], o, nx, nxy)) {
            cells[o] |= QUEUED;
            front.push(rank_of(o), id(o));
        }
    }
    let mut steps = 0usize;
    while let Some(o) = front.pop() {
        steps += 1;
        if steps.is_multiple_of(CANCEL_EVERY) {
            cancel.check()?;
        }
        cells[o] &= !QUEUED;
        if !is_simple(neighborhood(|n| cells[n], o, nx, nxy)) {
            continue;
        }
        cells[o] = 0;
        for n in [o - nxy, o - nx, o - 1, o + 1, o + nx, o + nxy] {
            cells[n] |= OPEN;
        }
        for n in around(o, 1, [nx, nxy]) {
            if cells[n] & !NEAR == LEFT | OPEN {
                cells[n] |= QUEUED;
                front.push(rank_of(n), id(n));
            }
        }
    }
    let mut left = Vec::new();
    for (n, slice) in cells.chunks(CANCEL_EVERY).enumerate() {
        cancel.check()?;
        left.extend((0..slice.len()).filter(|&o| slice[o] & LEFT != 0).map(|o| n * CANCEL_EVERY + o));
    }
    thin_to_one_voxel(&mut cells, [nx, nxy], &mut left, rank_of, cancel)?;
    Ok(left)
}

/// Medial voxels make the surface two thick in places: what is no end of the surface is thinned,
/// until nothing changes.
fn thin_to_one_voxel(
    cells: &mut [u8],
    [nx, nxy]: [usize; 2],
    left: &mut Vec<usize>,
    rank_of: impl Fn(usize) -> usize,
    cancel: &dyn Cancel,
) -> Result<(), Cancelled> {
    /// Rounds at most; each takes at least one voxel away, and two or three are the rule.
    const MAX_ROUNDS: usize = 64;
    left.sort_by_key(|&o| (rank_of(o), o));
    for _ in 0..MAX_ROUNDS {
        cancel.check()?;
        let before = left.len();
        left.retain(|&o| {
            let bits = neighborhood(|n| cells[n], o, nx, nxy);
            let goes = is_simple(bits) && !(cells[o] & state::MEDIAL != 0 && is_surface_end(bits));
            cells[o] &= if goes { 0 } else { u8::MAX };
            !goes
        });
        if left.len() == before {
            break;
        }
    }
    left.sort_unstable();
    Ok(())
}

/// Sub-voxel points of the voxels that are left.
fn surface_of(left: &[usize], depth: &Depth, cancel: &dyn Cancel) -> Result<MedialSurface, Cancelled> {
    let point = |&o: &usize| cancel.check().map(|()| medial_point(depth, o));
    let points = left.par_iter().with_min_len(64).map(point).collect::<Result<_, _>>()?;
    Ok(MedialSurface { points, adjacency: touching(left, depth.depth.dims(), cancel)? })
}

/// The 26-neighbours of each of some voxels (ascending, none on the grid's edge) among them.
fn touching(voxels: &[usize], [nx, ny, _]: [usize; 3], cancel: &dyn Cancel) -> Result<Vec<Vec<u32>>, Cancelled> {
    /// Voxels that are worked on together.
    const CHUNK: usize = 4096;
    let steps = |o: usize| around(o, 1, [nx, nx * ny]);
    let of_chunk = |chunk: &[usize]| {
        cancel.check()?;
        // Where each of the 27 neighbours would be: it moves on as the voxel does.
        let mut place: Vec<usize> = steps(chunk[0]).map(|n| voxels.partition_point(|&v| v < n)).collect();
        let mut of_voxel = |o: usize| {
            let mut list = Vec::new();
            for (at, n) in place.iter_mut().zip(steps(o)) {
                while voxels.get(*at).is_some_and(|&v| v < n) {
                    *at += 1;
                }
                if n != o && voxels.get(*at) == Some(&n) {
                    list.push(id(*at));
                }
            }
            list
        };
        Ok(chunk.iter().map(|&o| of_voxel(o)).collect::<Vec<_>>())
    };
    let lists = voxels.par_chunks(CHUNK).map(of_chunk).collect::<Result<Vec<_>, _>>()?;
    Ok(lists.into_iter().flatten().collect())
}

/// The medial point of a voxel: its feet on two sides, and the place where they are equally far.
fn medial_point(depth: &Depth, voxel: usize) -> MedialPoint {
    let mut near = vec![depth.nearest.as_slice()[voxel]];
    neighbors(depth.depth.dims(), voxel, Connectivity::Corners26, |n| {
        if depth.depth.as_slice()[n] > 0.0 {
            near.push(depth.nearest.as_slice()[n]);
        }
    });
    near.sort_unstable();
    near.dedup();
    let mut position = Point3::from(depth.depth.index(voxel).map(|x| x as f64));
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
