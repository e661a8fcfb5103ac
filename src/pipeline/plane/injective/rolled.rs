//! The plane of a sheet with one hole, a band or a washer: a strip that begins again after a length, its *period*.
//!
//! 1. One coordinate is harmonic between the rims, 0 on the one and 1 on the other; the other one is harmonic too, meets the rims
//!    at right angles, and grows by 1 round the hole: across a cut, a way of the fewest edges from rim to rim, it jumps by that.
//!    Where the cut lies changes nothing;
//! 2. both are scaled so that lengths are true on average, and are made as true as can be in steps that turn nothing over
//!    (`relax`), the period left as it is: a band keeps its lengths, a washer is drawn together on its outside and apart at its
//!    hole.
//!
//! Weights are the cotangents of the triangles' angles (Pinkall, Polthier, *Computing discrete minimal surfaces*, 1993), no less
//! than [`LEAST_WEIGHT`], with which the first coordinate has no extremes inside.

use std::collections::{BTreeMap, VecDeque};

use nalgebra::{DMatrix, Point2, Point3, Vector2};

use super::disc::Disc;
use super::places::places_of;
use super::relax::Map;
use super::{mesh_of, stretch};
use crate::cancel::{Cancel, Cancelled};
use crate::model::Stretch;
use crate::numerics::field::id;
use crate::numerics::sparse::{FactorError, Sparse, solved};
use crate::pipeline::surface::Surface;

/// Cotangent of an angle at the least.
const LEAST_WEIGHT: f64 = 0.05;
/// Weight that holds the coordinate round the hole at 0, so that the equations have one answer.
const HOLD: f64 = 1e-9;

/// A sheet with one hole, laid in a strip that begins again.
#[derive(Clone, Debug)]
pub struct Rolled {
    /// Plane coordinates of every point, voxels, the first up to the period; `None` of those that lie off the mesh.
    pub places: Vec<Option<Point2<f64>>>,
    /// Length after which the first coordinate begins again, voxels.
    pub period: f64,
    /// What the strip does to lengths.
    pub stretch: Stretch,
}

/// Lays a sheet with two sides and one hole in its strip; `None` where its mesh is no ring, or has no map.
///
/// # Errors
/// When it is cancelled.
pub fn rolled(surface: &Surface, cancel: &dyn Cancel) -> Result<Option<Rolled>, Cancelled> {
    let Some((ring, first_rim)) = Disc::ring(mesh_of(surface, cancel)?, cancel)? else { return Ok(None) };
    let Some(turns) = turns(&ring, first_rim, cancel)? else { return Ok(None) };
    let Some(first) = first_map(&ring, first_rim, &turns, cancel)? else { return Ok(None) };
    let scale = scale(&ring, &turns, &first);
    let places = first.iter().map(|place| Point2::from(place.coords.component_mul(&scale))).collect();
    let shifts = turns.into_iter().map(|turns| turns.map(|turn| turn * scale.x)).collect();
    let mut map = Map::new(&ring, places).shifted(shifts);
    if !map.relax(0.0, cancel)? {
        return Ok(None);
    }
    let stretch = stretch(&map, cancel)?;
    let corners: Vec<_> = (0..ring.triangles.len()).map(|k| map.corners(k, &map.places)).collect();
    let mut places = places_of(&surface.positions, &ring, &corners, cancel)?;
    let period = scale.x.abs();
    for place in places.iter_mut().flatten() {
        place.x = place.x.rem_euclid(period);
    }
    Ok(Some(Rolled { places, period, stretch }))
}

/// Both harmonic coordinates of all vertices, from 0 to 1 across, and 1 more each time round.
fn first_map(
    ring: &Disc,
    first_rim: usize,
    turns: &[[f64; 3]],
    cancel: &dyn Cancel,
) -> Result<Option<Vec<Point2<f64>>>, Cancelled> {
    let (weights, level) = (weights(ring), vec![[0.0; 3]; turns.len()]);
    let mut on_rims = vec![None; ring.positions.len()];
    for (k, &v) in ring.rim.iter().enumerate() {
        on_rims[v as usize] = Some(if k < first_rim { 0.0 } else { 1.0 });
    }
    let free = vec![None; ring.positions.len()];
    let across = Harmonic { ring, weights: &weights, turns: &level, fixed: on_rims }.solved(cancel)?;
    let around = Harmonic { ring, weights: &weights, turns, fixed: free }.solved(cancel)?;
    let (Some(across), Some(around)) = (across, around) else { return Ok(None) };
    Ok(Some(around.into_iter().zip(across).map(|(x, y)| Point2::new(x, y)).collect()))
}

/// How many times round the corners of all triangles lie: 1 of those on the cut that are left of it, 0 of all others. `None`
/// where there is no way from rim to rim.
fn turns(ring: &Disc, first_rim: usize, cancel: &dyn Cancel) -> Result<Option<Vec<[f64; 3]>>, Cancelled> {
    let Some(cut) = cut(ring, first_rim) else { return Ok(None) };
    let is_step = |a: u32, b: u32| cut.windows(2).any(|step| step == [a, b]);
    let at_cut: Vec<usize> =
        (0..ring.triangles.len()).filter(|&k| ring.triangles[k].iter().any(|v| cut.contains(v))).collect();
    let mut turns = vec![[0.0; 3]; ring.triangles.len()];
    let mut waiting = Vec::new();
    for &k in &at_cut {
        let [a, b, c] = ring.triangles[k];
        for [from, to] in [[a, b], [b, c], [c, a]] {
            if is_step(from, to) {
                waiting.extend([(k, from), (k, to)]);
            }
        }
    }
    // From the triangles left of its steps round their corners, up to the rim or the next step.
    while let Some((k, v)) = waiting.pop() {
        cancel.check()?;
        let triangle = ring.triangles[k];
        let corner = triangle.iter().position(|&other| other == v).unwrap_or(0);
        if std::mem::replace(&mut turns[k][corner], 1.0) == 1.0 {
            continue;
        }
        for &other in &at_cut {
            let far: Vec<u32> = triangle.into_iter().filter(|n| *n != v && ring.triangles[other].contains(n)).collect();
            if let ([b], true) = (&far[..], ring.triangles[other].contains(&v))
                && !is_step(v, *b)
                && !is_step(*b, v)
            {
                waiting.push((other, v));
            }
        }
    }
    Ok(Some(turns))
}

/// The vertices of a way of the fewest edges from the first rim to the other. No two of them are joined but those that follow
/// one another.
fn cut(ring: &Disc, first_rim: usize) -> Option<Vec<u32>> {
    let (starts, ends) = ring.rim.split_at(first_rim);
    let mut before = vec![None; ring.positions.len()];
    for &v in starts {
        before[v as usize] = Some(v);
    }
    let mut waiting: VecDeque<u32> = starts.iter().copied().collect();
    while let Some(v) = waiting.pop_front() {
        if ends.contains(&v) {
            let mut way = vec![v];
            while let (Some(at), Some(back)) = (way.last().copied(), way.last().and_then(|v| before[*v as usize]))
                && at != back
            {
                way.push(back);
            }
            return Some(way);
        }
        for &n in &ring.joined[v as usize] {
            if before[n as usize].is_none() {
                before[n as usize] = Some(v);
                waiting.push_back(n);
            }
        }
    }
    None
}

/// Of every triangle the weights of the sides that lie opposite of its corners.
fn weights(ring: &Disc) -> Vec<[f64; 3]> {
    let mut weights = Vec::with_capacity(ring.triangles.len());
    for triangle in &ring.triangles {
        let corners = triangle.map(|v| ring.positions[v as usize]);
        weights.push([0, 1, 2].map(|k| cotangent(corners, k).max(LEAST_WEIGHT)));
    }
    weights
}

/// Of the angle at a corner of a triangle.
fn cotangent(corners: [Point3<f64>; 3], k: usize) -> f64 {
    let [on, back] = [corners[(k + 1) % 3] - corners[k], corners[(k + 2) % 3] - corners[k]];
    on.dot(&back) / on.cross(&back).norm().max(1e-9)
}

/// The equations of a harmonic function on some vertices: of each the row of its Laplacian, and its right side. `turns`: how
/// often round the corners of the triangles lie; `fixed`: values of vertices that have one.
struct Harmonic<'a> {
    ring: &'a Disc,
    weights: &'a [[f64; 3]],
    turns: &'a [[f64; 3]],
    fixed: Vec<Option<f64>>,
}

impl Harmonic<'_> {
    /// The values of all vertices; `None` where the equations have no answer.
    fn solved(&self, cancel: &dyn Cancel) -> Result<Option<Vec<f64>>, Cancelled> {
        let count = self.ring.positions.len();
        let (mut rows, mut right) = (vec![BTreeMap::new(); count], DMatrix::zeros(count, 1));
        for (v, row) in rows.iter_mut().enumerate() {
            row.insert(id(v), if self.fixed[v].is_some() { 1.0 } else { HOLD });
            right[v] = self.fixed[v].unwrap_or(0.0);
        }
        for (k, triangle) in self.ring.triangles.iter().enumerate() {
            for corner in 0..3 {
                let [a, b] = [(corner + 1) % 3, (corner + 2) % 3];
                let weight = self.weights[k][corner];
                for [a, b] in [[a, b], [b, a]] {
                    let (v, n) = (triangle[a] as usize, triangle[b] as usize);
                    if self.fixed[v].is_some() {
                        continue;
                    }
                    *rows[v].entry(triangle[a]).or_default() += weight;
                    right[v] += weight * (self.turns[k][b] - self.turns[k][a]);
                    match self.fixed[n] {
                        Some(value) => right[v] += weight * value,
                        None => *rows[v].entry(triangle[b]).or_default() -= weight,
                    }
                }
            }
        }
        let rows = rows.into_iter().map(|row| row.into_iter().collect()).collect();
        match solved(&Sparse::from_rows(rows), &self.ring.positions, &right, cancel) {
            Ok(found) => Ok(Some(found.column(0).iter().copied().collect())),
            Err(FactorError::Cancelled(stop)) => Err(stop),
            Err(FactorError::NotPositive) => Ok(None),
        }
    }
}

/// What makes lengths in the plane true on average along either of its axes, turned so that triangles are counter-clockwise.
fn scale(ring: &Disc, turns: &[[f64; 3]], places: &[Point2<f64>]) -> Vector2<f64> {
    let (mut squares, mut whole, mut sides) = (Vector2::zeros(), 0.0, 0.0);
    for (triangle, turns) in ring.triangles.iter().zip(turns) {
        let [p, q, r] = triangle.map(|v| ring.positions[v as usize]);
        let [a, b, c] = [0, 1, 2].map(|k| places[triangle[k] as usize] + Vector2::new(turns[k], 0.0));
        let (along, back, on, off) = (q - p, r - p, b - a, c - a);
        let doubled = along.cross(&back).norm().max(1e-9);
        // The slope of a coordinate that grows by these along two sides.
        for axis in 0..2 {
            squares[axis] += (back * on[axis] - along * off[axis]).norm_squared() / doubled;
        }
        whole += doubled;
        sides += on.perp(&off).signum();
    }
    let scale = squares.map(|square: f64| (square / whole).sqrt().recip());
    Vector2::new(if sides < 0.0 { -scale.x } else { scale.x }, scale.y)
}
