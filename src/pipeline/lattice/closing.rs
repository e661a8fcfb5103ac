//! A ring carried on to its two rims, and the lines that its lattices follow.
//!
//! 1. Its points come again on both sides of the strip, so that fits beside the cut are those of any other place;
//! 2. along either side of the region that they cover the sheet is walked outward to where it ends, as every other sheet is
//!    ([`rim`](super::rim));
//! 3. the strip between is the image of the square, the rims its lower and its upper side.

use nalgebra::{Point2, Point3, Vector2};

use super::map::SpaceFromPlane;
use super::rim::{PITCH, SIGMA, START, Walk, WholeSheet, outward};
use crate::cancel::{Cancel, Cancelled};
use crate::numerics::field::floor_index;
use crate::numerics::smooth::gaussian_around;
use crate::pipeline::chart::{Chart, Strip};
use crate::pipeline::plane::region::Region;
use crate::pipeline::plane::strip::SheetPoints;
use crate::pipeline::solid::Solid;
use crate::pipeline::solid::depth::Depth;

/// How far beyond its ends the strip is carried on, as a share of the period: fits are narrower than a half.
const BEYOND: f64 = 0.5;

/// A ring carried on to its rims, and its lines; `None` without room between the rims.
///
/// # Errors
/// When it is cancelled.
pub(super) fn closing(
    points: &SheetPoints,
    period: f64,
    hinge: &[Point3<f64>],
    (solid, depth): (&Solid, &Depth),
    cancel: &dyn Cancel,
) -> Result<Option<(WholeSheet, Chart)>, Cancelled> {
    let round = repeated(points, period);
    let region = Region::of(&round.flat, cancel)?;
    let map = SpaceFromPlane::of(&round);
    let stations = floor_index((period / PITCH).round()).max(8);
    let mut whole = points.clone();
    let mut rims = [Vec::new(), Vec::new()];
    for (rim, outward) in rims.iter_mut().zip([-1.0, 1.0]) {
        let Some(side) = Side::of(&region, (period, stations), outward) else { return Ok(None) };
        let mut shifts = Vec::with_capacity(stations);
        for k in 0..stations {
            cancel.check()?;
            shifts.push(side.walked(k, &map, hinge, (solid, depth), &mut whole));
        }
        *rim = side.moved(&gaussian_around(&shifts, SIGMA / PITCH));
    }
    if rims[0].iter().zip(&rims[1]).any(|(low, high)| low >= high) {
        return Ok(None);
    }
    let whole = WholeSheet { region, points: repeated(&whole, period) };
    let map = SpaceFromPlane::of(&whole.points).over_holes();
    let chart = Chart::round(&whole.region, &Strip { period, rims }, |place| map.node(place).position, cancel)?;
    Ok(Some((whole, chart)))
}

/// A side of a strip's region: its second coordinate at places equally far apart, from the beginning on.
struct Side {
    period: f64,
    /// −1 of the lower one, 1 of the upper one.
    outward: f64,
    heights: Vec<f64>,
}

impl Side {
    /// Smoothed as the outlines of other sheets are; `None` where the region has a gap.
    fn of(region: &Region, (period, stations): (f64, usize), outward: f64) -> Option<Self> {
        let mut heights = Vec::with_capacity(stations);
        for k in 0..stations {
            heights.push(region.outermost(period * k as f64 / stations as f64, outward)?);
        }
        Some(Self { period, outward, heights: gaussian_around(&heights, SIGMA / PITCH) })
    }

    fn at(&self, k: usize) -> Point2<f64> {
        Point2::new(self.period * k as f64 / self.heights.len() as f64, self.heights[k])
    }

    /// Unit direction out of the region.
    fn direction(&self, k: usize) -> Vector2<f64> {
        // Counter-clockwise, so that the region lies to the left.
        let line: Vec<Point2<f64>> = (0..5).map(|n| self.around(k, n)).collect();
        outward(&line, 2)
    }

    /// The `n`th of five points round one, on their turns.
    fn around(&self, k: usize, n: usize) -> Point2<f64> {
        let step = if self.outward < 0.0 { n as f64 - 2.0 } else { 2.0 - n as f64 };
        let count = self.heights.len() as f64;
        let at = k as f64 + step;
        Point2::new(self.period * at / count, self.heights[floor_index(at.rem_euclid(count)) % self.heights.len()])
    }

    /// How far beyond it the sheet ends, voxels of the plane. Adds the points on the way.
    fn walked(
        &self,
        k: usize,
        map: &SpaceFromPlane<'_>,
        hinge: &[Point3<f64>],
        (solid, depth): (&Solid, &Depth),
        whole: &mut SheetPoints,
    ) -> f64 {
        let (at, direction) = (self.at(k), self.direction(k));
        // Voxels of the plane in one of space.
        let scale = |place: Point2<f64>| {
            let node = map.node(place);
            (node.tangents[0] * direction.x + node.tangents[1] * direction.y).norm().max(1e-3).recip()
        };
        let start = at - direction * (START * scale(at));
        let scale = scale(start);
        let walk = Walk::from(&map.node(start), direction, hinge, solid, depth);
        for (walked, position, radius) in walk.points(depth) {
            whole.flat.push(start + direction * (walked * scale));
            whole.positions.push(position);
            whole.radii.push(radius);
        }
        (start - at).dot(&direction) + walk.length() * scale
    }

    /// The second coordinates of the side moved outward by so much.
    fn moved(&self, shifts: &[f64]) -> Vec<f64> {
        let count = self.heights.len();
        let moved: Vec<Point2<f64>> = (0..count).map(|k| self.at(k) + self.direction(k) * shifts[k]).collect();
        let mut heights = vec![f64::NEG_INFINITY; count];
        for k in 0..count {
            let (from, mut to) = (moved[k], moved[(k + 1) % count]);
            if k + 1 == count {
                to.x += self.period;
            }
            let [from, to] = if from.x <= to.x { [from, to] } else { [to, from] };
            let steps = |x: f64| x * count as f64 / self.period;
            let mut n = steps(from.x).ceil();
            while n <= steps(to.x) {
                let share = (n - steps(from.x)) / (steps(to.x) - steps(from.x)).max(1e-9);
                let height = (from.y + (to.y - from.y) * share) * self.outward;
                let seat = &mut heights[floor_index(n.rem_euclid(count as f64)) % count];
                *seat = seat.max(height);
                n += 1.0;
            }
        }
        heights.iter().map(|height| height * self.outward).collect()
    }
}

/// The points, followed by those that come again on both sides.
fn repeated(points: &SheetPoints, period: f64) -> SheetPoints {
    let mut all = points.clone();
    for turn in [-1.0, 1.0] {
        for (k, place) in points.flat.iter().enumerate() {
            let x = place.x + turn * period;
            if (-BEYOND * period..(1.0 + BEYOND) * period).contains(&x) {
                all.flat.push(Point2::new(x, place.y));
                all.positions.push(points.positions[k]);
                all.radii.push(points.radii[k]);
            }
        }
    }
    all
}
