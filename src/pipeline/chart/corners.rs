//! The four corners of a region: where the sides of its lattice begin and end.
//!
//! Corners are the places farthest out along the diagonals of the rectangle that has the region's
//! second moments, along and across its bent axis: those of a rectangle are its corners, an
//! ellipse has them where both axes have the same share.
//!
//! 1. A parabola is fitted to the area: the bent axis;
//! 2. the outline is straightened along it and scaled to the rectangle;
//! 3. the corners are the places farthest out along the diagonals;
//! 4. corners of an end that is a point are moved apart.

use nalgebra::{Matrix3, Point2, Vector2, Vector3};

use super::arc::Arc;
use crate::numerics::field::floor_index;
use crate::numerics::polyline::Polyline;
use crate::pipeline::plane::region::{PITCH, Region};

/// Where the ends of a region are.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Ends {
    /// A tail is followed up to its tip.
    OfTails,
    /// Wide ones: three surfaces that are laid out apart have tips of their own, and their lattices must pair.
    Wide,
}

impl Ends {
    /// Length of an end at the least, mean widths.
    fn least(self) -> f64 {
        match self {
            Self::OfTails => LEAST_END,
            Self::Wide => LEAST_WIDE_END,
        }
    }
}

/// See [`LEAST_END`]: of wide ends.
const LEAST_WIDE_END: f64 = 0.4;
/// Length of the outline at an end at the least, as a share of the mean width: pointed ends would
/// squeeze all rows into a point. The ends of ten organs and shapes are wide enough for 0.1 to do as well; with 0.9, the mask
/// of a spleen lies 1.18 mm from the model on average, not 1.12.
const LEAST_END: f64 = 0.1;
/// Directions of the corners, counter-clockwise from the one that is first along and right of the axis.
const DIAGONALS: [[f64; 2]; 4] = [[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]];

/// The pieces of a region's outline between its corners, counter-clockwise, the short sides across the two ends. `None`
/// for an empty region.
#[must_use]
pub fn sides(region: &Region, ends: Ends) -> Option<[Arc; 4]> {
    let outline = region.outline();
    if outline.len() < 8 {
        return None;
    }
    let outline = Polyline::closed(outline.iter().map(|p| p.coords).collect());
    let corners = Axis::of(region).corners(region, &outline, ends);
    Some([0, 1, 2, 3].map(|k| Arc::between(&outline, corners[k], corners[(k + 1) % 4])))
}

/// The long axis of a region, bent as the region is: v = c₀ + c₁u + c₂u², fitted to its area.
struct Axis {
    coefficients: Vector3<f64>,
    centre: Point2<f64>,
    /// Area over length.
    width: f64,
}

impl Axis {
    fn of(region: &Region) -> Self {
        let (count, mean, second) = region.moments();
        let centre = region.raster.origin + mean;
        let spread = (second[(0, 0)] / count - mean.x * mean.x).max(PITCH * PITCH).sqrt();
        let (mut normal, mut right) = (Matrix3::identity() * 1e-9, Vector3::zeros());
        for pixel in region.pixels() {
            let p = region.raster.origin + pixel - centre;
            let row = Vector3::new(1.0, p.x / spread, (p.x / spread).powi(2));
            normal += row * row.transpose();
            right += row * p.y;
        }
        let fit = normal.cholesky().map_or_else(Vector3::zeros, |c| c.solve(&right));
        let coefficients = fit.component_div(&Vector3::new(1.0, spread, spread * spread));
        // The side of a rectangle is √12 times its root second moment.
        let width = count * PITCH * PITCH / (12.0f64.sqrt() * spread);
        Self { coefficients, centre, width }
    }

    /// How far along the axis a point lies: the u of its foot.
    fn station(&self, p: Point2<f64>) -> f64 {
        let p = p - self.centre;
        let [c0, c1, c2] = self.coefficients.into();
        let mut u = p.x;
        for _ in 0..4 {
            let (height, slope) = (p.y - c0 - c1 * u - c2 * u * u, c1 + 2.0 * c2 * u);
            let step = (p.x - u + height * slope) / (1.0 + slope * slope - 2.0 * c2 * height).max(0.3);
            u += step;
        }
        u
    }

    /// Along the axis and to its left, voxels.
    fn straightened(&self, p: Point2<f64>) -> Vector2<f64> {
        let u = self.station(p);
        let [c0, c1, c2] = self.coefficients.into();
        let p = p - self.centre;
        let slope = c1 + 2.0 * c2 * u;
        let across = (p - Vector2::new(u, c0 + c1 * u + c2 * u * u)).dot(&Vector2::new(-slope, 1.0));
        Vector2::new(u, across / slope.hypot(1.0))
    }

    /// Middle of the straightened region, and half the sides of the rectangle that has its second moments.
    fn rectangle(&self, region: &Region) -> [Vector2<f64>; 2] {
        let (mut count, mut sum, mut second) = (0.0f64, Vector2::zeros(), Vector2::zeros());
        for pixel in region.pixels() {
            let at = self.straightened(region.raster.origin + pixel);
            count += 1.0;
            sum += at;
            second += at.component_mul(&at);
        }
        let mean = sum / count.max(1.0);
        let half = (second / count.max(1.0) - mean.component_mul(&mean)).map(|v| (3.0 * v.max(PITCH * PITCH)).sqrt());
        [mean, half]
    }

    /// Draws the two corners of an end along the outline towards it, as long as the outline is straight or hollow there: a
    /// side of a tail that bends away from the axis is no end.
    fn draw_to_end(&self, outline: &Polyline<2>, at: &mut [f64; 4], from: usize, to: usize) {
        let room = ((length_between(outline, at[from], at[to]) - LEAST_END * self.width) / 2.0).max(0.0);
        let drawn = [(from, PITCH), (to, -PITCH)].map(|(corner, step)| self.straight(outline, at[corner], step, room));
        at[from] = (at[from] + drawn[0]).rem_euclid(outline.length());
        at[to] = (at[to] - drawn[1]).rem_euclid(outline.length());
    }

    /// How far the outline goes on straight or hollow from a place, up to `room`. A line is the less straight the more it
    /// turns: the mean over how much it may, so that a side that turns by just so much has no cliff.
    fn straight(&self, outline: &Polyline<2>, start: f64, step: f64, room: f64) -> f64 {
        /// Length on both sides of a place over which the outline may turn, in mean widths. With half of it noise turns the
        /// outline as much: nodes of an ellipsoid move by 0.69 voxel under a turned grid, not 0.5.
        const SPAN: f64 = 0.25;
        /// By how much it may turn, radians. With less, sides of tails are taken for ends; with more, corners of long
        /// ellipses move to their tips.
        const TURNS: [f64; 7] = [0.06, 0.08, 0.1, 0.12, 0.14, 0.16, 0.18];
        let span = SPAN * self.width;
        let mut lengths = [room; TURNS.len()];
        let mut most = f64::NEG_INFINITY;
        for n in 0..floor_index(room / PITCH) {
            let along = n as f64 * PITCH;
            let turn = turning(outline, start + along * step.signum(), span);
            for (length, limit) in lengths.iter_mut().zip(TURNS) {
                if most < limit && turn >= limit {
                    *length = along;
                }
            }
            most = most.max(turn);
        }
        lengths.iter().sum::<f64>() / lengths.len() as f64
    }

    /// Corners in the order of [`DIAGONALS`]; a place is a piece of the outline and a share of it.
    fn corners(&self, region: &Region, outline: &Polyline<2>, ends: Ends) -> [(usize, f64); 4] {
        let [mean, half] = self.rectangle(region);
        let mut scaled = Vec::with_capacity(outline.points().len());
        for p in outline.points() {
            scaled.push((self.straightened(Point2::from(*p)) - mean).component_div(&half));
        }
        let scaled = Polyline::open(scaled);
        let mut at = DIAGONALS.map(|diagonal| outline.length_at(scaled.place(farthest(&scaled, diagonal))));
        if ends == Ends::OfTails {
            for (from, to) in [(1, 2), (3, 0)] {
                self.draw_to_end(outline, &mut at, from, to);
            }
        }
        // An end that is a point takes in some of the outline on both sides.
        for (from, to) in [(1, 2), (3, 0)] {
            let missing = (ends.least() * self.width - length_between(outline, at[from], at[to])).max(0.0);
            at[from] = (at[from] - missing / 2.0).rem_euclid(outline.length());
            at[to] = (at[to] + missing / 2.0).rem_euclid(outline.length());
        }
        at.map(|length| outline.place(length))
    }
}

/// By how much a closed line turns, counter-clockwise, from `span` before a place to `span` after it, radians.
fn turning(line: &Polyline<2>, at: f64, span: f64) -> f64 {
    let point = |length: f64| line.point(line.place(length.rem_euclid(line.length())));
    let before = point(at) - point(at - span);
    let after = point(at + span) - point(at);
    before.perp(&after).atan2(before.dot(&after))
}

/// Length along a closed line from one place on to another; an end that is turned over has a negative one.
fn length_between(line: &Polyline<2>, from: f64, to: f64) -> f64 {
    let length = (to - from).rem_euclid(line.length());
    if length > line.length() / 2.0 { length - line.length() } else { length }
}

/// Length up to where a closed line is farthest along a direction: the mean of the places near the farthest, weighted
/// by how near they come, so that noise does not move it along a flat maximum.
fn farthest(line: &Polyline<2>, [x, y]: [f64; 2]) -> f64 {
    /// Difference to the largest value at which a place counts 1/e. With 0.01, single voxels move the corner of a round end:
    /// medial nodes of a hippocampus lie a fifth further from the middle. With 0.6, the sides beside a corner pull at it: the mask of
    /// a spleen lies 1.18 mm from the model on average, not 1.12.
    const SOFT: f64 = 0.1;
    // The last point is the first.
    let count = line.points().len() - 1;
    let values: Vec<f64> = line.points().iter().map(|p| p.x * x + p.y * y).collect();
    let best = (0..count).max_by(|&a, &b| values[a].total_cmp(&values[b])).unwrap_or(0);
    let (mut sum, mut total) = (0.0, 0.0);
    for k in 0..count {
        let offset = length_between(line, line.reached(best), line.reached(k));
        if offset.abs() < line.length() / 8.0 {
            let weight = ((values[k] - values[best]) / SOFT).exp() * (line.reached(k + 1) - line.reached(k));
            sum += weight * offset;
            total += weight;
        }
    }
    (line.reached(best) + sum / total.max(1e-300)).rem_euclid(line.length())
}
