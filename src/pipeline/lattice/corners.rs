//! The four corners of a region: where the sides of its lattice begin and end.
//!
//! Corners are the places farthest out along the diagonals of the rectangle that has the region's
//! second moments, along and across its bent axis: those of a rectangle are its corners, an
//! ellipse has them where both axes have the same share.

use nalgebra::{Matrix3, Point2, Vector2, Vector3};

use super::arc::Arc;
use crate::pipeline::plane::region::{PITCH, Region};

/// Length of the outline at an end at the least, as a share of the mean width: pointed ends would
/// squeeze all rows into a point.
const LEAST_END: f64 = 0.4;

/// The pieces of a region's outline between its corners, counter-clockwise, the short sides across the two ends. `None`
/// for an empty region.
#[must_use]
pub fn sides(region: &Region) -> Option<[Arc; 4]> {
    let outline = region.outline();
    if outline.len() < 8 {
        return None;
    }
    let corners = Axis::of(region).corners(region, &outline);
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
        let centre = region.origin + mean;
        let spread = (second[(0, 0)] / count - mean.x * mean.x).max(PITCH * PITCH).sqrt();
        let grid = &region.level.0;
        let (mut normal, mut right) = (Matrix3::identity() * 1e-9, Vector3::zeros());
        for o in (0..grid.as_slice().len()).filter(|&o| grid.as_slice()[o] > 0.0) {
            let [i, j, _] = grid.index(o);
            let p = region.origin + Vector2::new(i as f64, j as f64) * PITCH - centre;
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
    fn station(&self, p: &Point2<f64>) -> f64 {
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
    fn straightened(&self, p: &Point2<f64>) -> Vector2<f64> {
        let u = self.station(p);
        let [c0, c1, c2] = self.coefficients.into();
        let p = p - self.centre;
        let slope = c1 + 2.0 * c2 * u;
        let across = (p - Vector2::new(u, c0 + c1 * u + c2 * u * u)).dot(&Vector2::new(-slope, 1.0));
        Vector2::new(u, across / slope.hypot(1.0))
    }

    /// Corners counter-clockwise from the one that is first along and right of the axis; a place is
    /// an edge of the outline and a share of it.
    fn corners(&self, region: &Region, outline: &[Point2<f64>]) -> [(usize, f64); 4] {
        let grid = &region.level.0;
        let (mut count, mut sum, mut second) = (0.0f64, Vector2::zeros(), Vector2::zeros());
        for o in (0..grid.as_slice().len()).filter(|&o| grid.as_slice()[o] > 0.0) {
            let [i, j, _] = grid.index(o);
            let at = self.straightened(&(region.origin + Vector2::new(i as f64, j as f64) * PITCH));
            count += 1.0;
            sum += at;
            second += at.component_mul(&at);
        }
        let mean = sum / count.max(1.0);
        let half = (second / count.max(1.0) - mean.component_mul(&mean)).map(|v| (3.0 * v.max(PITCH * PITCH)).sqrt());
        let scaled: Vec<Point2<f64>> =
            outline.iter().map(|p| (self.straightened(p) - mean).component_div(&half).into()).collect();
        let (lengths, scaled_lengths) = (Lengths::of(outline), Lengths::of(&scaled));
        let mut at = [(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)].map(|(x, y)| {
            let values: Vec<f64> = scaled.iter().map(|p| p.x * x + p.y * y).collect();
            lengths.at(scaled_lengths.place(scaled_lengths.of_farthest(&values)))
        });
        // An end that is a point takes in some of the outline on both sides.
        for (from, to) in [(1, 2), (3, 0)] {
            let missing = (LEAST_END * self.width - lengths.between(at[from], at[to])).max(0.0);
            at[from] = (at[from] - missing / 2.0).rem_euclid(lengths.total());
            at[to] = (at[to] + missing / 2.0).rem_euclid(lengths.total());
        }
        at.map(|length| lengths.place(length))
    }
}

/// Lengths along a closed outline from its first point.
struct Lengths(Vec<f64>);

impl Lengths {
    fn of(outline: &[Point2<f64>]) -> Self {
        let mut reached = vec![0.0];
        for k in 0..outline.len() {
            reached.push(reached[k] + (outline[(k + 1) % outline.len()] - outline[k]).norm());
        }
        Self(reached)
    }

    fn total(&self) -> f64 {
        self.0[self.0.len() - 1]
    }

    /// Length counter-clockwise from one place to another; an end that is turned over has none.
    fn between(&self, from: f64, to: f64) -> f64 {
        let length = (to - from).rem_euclid(self.total());
        if length > self.total() / 2.0 { length - self.total() } else { length }
    }

    /// Where a value is largest: the mean of the places near the largest, weighted by how near they
    /// come, so that noise does not move it along a flat maximum.
    fn of_farthest(&self, values: &[f64]) -> f64 {
        /// Difference to the largest value at which a place counts 1/e.
        const SOFT: f64 = 0.1;
        let best = (0..values.len()).max_by(|&a, &b| values[a].total_cmp(&values[b])).unwrap_or(0);
        let (mut sum, mut total) = (0.0, 0.0);
        for (k, value) in values.iter().enumerate() {
            let offset = self.between(self.0[best], self.0[k]);
            if offset.abs() < self.total() / 8.0 {
                let weight = ((value - values[best]) / SOFT).exp() * (self.0[k + 1] - self.0[k]);
                sum += weight * offset;
                total += weight;
            }
        }
        (self.0[best] + sum / total.max(1e-300)).rem_euclid(self.total())
    }

    /// The length at a share of an edge.
    fn at(&self, (k, share): (usize, f64)) -> f64 {
        self.0[k] + (self.0[k + 1] - self.0[k]) * share
    }

    /// The edge at a length, and the share of it.
    fn place(&self, length: f64) -> (usize, f64) {
        let k = self.0.partition_point(|l| *l <= length).clamp(1, self.0.len() - 1) - 1;
        (k, (length - self.0[k]) / (self.0[k + 1] - self.0[k]).max(1e-12))
    }
}
