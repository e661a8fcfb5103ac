//! The region that a flattened surface covers: its principal axes and its outline as four sides.

use std::collections::BTreeMap;

use nalgebra::{Matrix2, Matrix3, Point2, Point3, SymmetricEigen, Vector2, Vector3};

use crate::numerics::cancel::GoOn;
use crate::numerics::components::{Connectivity, components};
use crate::numerics::distance::nearest_seed;
use crate::numerics::field::{Field, floor_index};
use crate::numerics::smooth::gaussian;
use crate::space::Grid;

use crate::pipeline::lattice::patch::Patch;
use crate::pipeline::observer::{Cancelled, Observer};

/// Pixel of the region's raster, voxels.
pub(super) const PITCH: f64 = 0.5;
/// Gaps between points up to twice this are part of the sheet, voxels. Neighbours on a staircase
/// lie up to 1.8 apart.
const CLOSING: f64 = 1.5;
/// How far the sheet goes on beyond its outermost points on average, voxels: its true rim lies
/// anywhere between them and the next voxel.
const OVERHANG: f64 = 0.5;
/// Standard deviation of the outline's smoothing, voxels: the rim of a voxel sheet is jagged by
/// half a voxel.
const OUTLINE_SIGMA: f64 = 1.0;
/// Length of the outline at an end at the least, as a share of the mean width: pointed ends would
/// squeeze all rows into a point.
const LEAST_END: f64 = 0.4;
/// Share of a sheet's area from which its holes are not filled but refused: every seventh node would lie
/// on nothing.
pub const HOLES_REFUSED: f64 = 0.15;
/// Free pixels around the points.
const PADDING: usize = 12;

/// The region covered by points of the plane. Lengths are voxels.
#[derive(Clone, Debug)]
pub struct Region {
    pub(super) origin: Point2<f64>,
    /// Positive inside, 0 on the smoothed outline.
    pub(super) level: Field,
    /// Distance to the nearest point, pixels.
    gap: Field,
    /// How far outside of the outline a point still counts as on it, in units of the level.
    slack: f64,
    /// Area of holes that were filled, as a share of the region.
    pub hole_share: f64,
}

impl Region {
    /// The region of `points`: their closing, with holes filled and a smooth outline.
    ///
    /// # Errors
    /// When the observer asks to stop.
    pub fn of(points: &[Point2<f64>], observer: &dyn Observer) -> Result<Self, Cancelled> {
        let go_on = || observer.check();
        let low = points.iter().fold(Vector2::repeat(f64::INFINITY), |a, p| a.inf(&p.coords));
        let high = points.iter().fold(Vector2::repeat(f64::NEG_INFINITY), |a, p| a.sup(&p.coords));
        let origin = Point2::from(low - Vector2::repeat(PADDING as f64 * PITCH));
        let pixels = |axis: usize| floor_index(((high - low)[axis] / PITCH).ceil()) + 1 + 2 * PADDING;
        let dims = [pixels(0), pixels(1), 1];
        let pixel_of = |p: &Point2<f64>| {
            let at = (p - origin) / PITCH;
            floor_index(at.x + 0.5) + dims[0] * floor_index(at.y + 0.5)
        };
        let mut taken: Vec<usize> = points.iter().map(pixel_of).collect();
        taken.sort_unstable();
        taken.dedup();
        let reach = CLOSING / PITCH;
        let mut near = nearest_seed(dims, [1.0; 3], &taken, &go_on)?.squared;
        let is_far = |o: &usize| f64::from(near.as_slice()[*o]) > reach * reach;
        let far: Vec<usize> = (0..near.as_slice().len()).filter(is_far).collect();
        let rim = nearest_seed(dims, [1.0; 3], &far, &go_on)?.squared;
        let shrink = reach - OVERHANG / PITCH;
        let inside = rim.try_map(|d| f64::from(*d) > shrink * shrink, go_on)?;
        let (inside, hole_share) = fill_holes(inside, &go_on)?;
        let mut level = inside.try_map(|m| f32::from(u8::from(*m)), go_on)?;
        gaussian(&mut level, [OUTLINE_SIGMA / PITCH, OUTLINE_SIGMA / PITCH, 0.0], &go_on)?;
        level.as_mut_slice().iter_mut().for_each(|v| *v -= 0.5);
        near.as_mut_slice().iter_mut().for_each(|d| *d = d.sqrt());
        Ok(Self { origin, level: Field(level), gap: Field(near), slack: 0.0, hole_share })
    }

    /// The same region with another outline, counter-clockwise, no further than a few voxels away.
    #[must_use]
    pub fn reshaped(&self, outline: &[Point2<f64>]) -> Self {
        /// Band around the outline in which the level is a distance, pixels.
        const BAND: f64 = 3.0;
        let mut level = self.level.clone();
        let [nx, ny, _] = level.0.dims();
        let place = |i: usize, j: usize| self.origin + Vector2::new(i as f64, j as f64) * PITCH;
        let edge = |k: usize| (outline[k], outline[(k + 1) % outline.len()]);
        let mut distance = vec![BAND * PITCH; nx * ny];
        let mut turns = vec![0i32; nx * ny];
        for (a, b) in (0..outline.len()).map(edge) {
            let (low, high) = (a.coords.inf(&b.coords), a.coords.sup(&b.coords));
            let pixel = |v: Vector2<f64>, add: f64| {
                let at = (v - self.origin.coords) / PITCH;
                [floor_index(at.x + add).min(nx - 1), floor_index(at.y + add).min(ny - 1)]
            };
            let (from, to) = (pixel(low, -BAND), pixel(high, BAND + 1.0));
            for j in from[1]..=to[1] {
                for i in from[0]..=to[0] {
                    let p = place(i, j);
                    let along = ((p - a).dot(&(b - a)) / (b - a).norm_squared().max(1e-12)).clamp(0.0, 1.0);
                    let d = &mut distance[i + nx * j];
                    *d = d.min((p - (a + (b - a) * along)).norm());
                }
                // Crossings of the pixel row to the left, with their sense.
                let y = place(0, j).y;
                if (a.y <= y) != (b.y <= y) {
                    let x = a.x + (b.x - a.x) * (y - a.y) / (b.y - a.y);
                    let first = floor_index(((x - self.origin.x) / PITCH).ceil()).min(nx);
                    turns[nx * j + first.min(nx - 1)] += if b.y > a.y { -1 } else { 1 };
                }
            }
        }
        for j in 0..ny {
            let mut winding = 0;
            for i in 0..nx {
                winding += turns[i + nx * j];
                let sign = if winding > 0 { 1.0 } else { -1.0 };
                #[expect(clippy::cast_possible_truncation, reason = "the field is f32")]
                let value = (sign * distance[i + nx * j] / PITCH) as f32;
                level.0.as_mut_slice()[i + nx * j] = value;
            }
        }
        Self { level, slack: 1.0, ..self.clone() }
    }

    /// Whether a point lies on the sheet: inside the outline, or as near to a point of the sheet as
    /// gaps in it may be wide.
    #[must_use]
    pub fn contains(&self, p: Point2<f64>) -> bool {
        let at = (p - self.origin) / PITCH;
        let dims = self.level.0.dims();
        let fits = at.iter().zip(dims).all(|(x, n)| *x >= 0.0 && *x <= (n - 1) as f64);
        let at = Point3::new(at.x, at.y, 0.0);
        fits && (self.level.at(at) >= -self.slack || self.gap.at(at) <= CLOSING / PITCH)
    }

    /// Unit directions of the longest and the shortest extent, from the second moments of the
    /// area (not of the points, whose density depends on the grid), and the root moments.
    #[must_use]
    pub fn principal_axes(&self) -> ([Vector2<f64>; 2], [f64; 2]) {
        let (count, mean, second) = self.moments();
        let covariance = second / count - mean * mean.transpose();
        let eigen = SymmetricEigen::new(covariance);
        let (first, other) = if eigen.eigenvalues[0] >= eigen.eigenvalues[1] { (0, 1) } else { (1, 0) };
        let axis = |k: usize| eigen.eigenvectors.column(k).into_owned();
        let extent = |k: usize| eigen.eigenvalues[k].max(0.0).sqrt();
        ([axis(first), axis(other)], [extent(first), extent(other)])
    }

    /// The region as the image of the square, with the short sides across its two ends. `None` for
    /// an empty region.
    ///
    /// Corners are the places farthest out along the diagonals of the rectangle that has the region's
    /// second moments, along and across its bent axis: those of a rectangle are its corners, an
    /// ellipse has them where both axes have the same share.
    ///
    /// # Errors
    /// When the observer asks to stop.
    pub fn patch(&self, observer: &dyn Observer) -> Result<Option<Patch>, Cancelled> {
        let outline = self.outline();
        if outline.len() < 8 {
            return Ok(None);
        }
        observer.check()?;
        let axis = Axis::of(self);
        let corners = axis.corners(self, &outline);
        let side = |k: usize| Arc::between(&outline, corners[k], corners[(k + 1) % 4]);
        let sides = [side(0), side(1), side(2), side(3)];
        Ok(Some(Patch::harmonic(self, &sides, observer)?))
    }

    /// Smallest and largest coordinates of the outline; `None` for an empty region.
    #[must_use]
    pub fn bounds(&self) -> Option<[Point2<f64>; 2]> {
        let outline = self.outline();
        let first = outline.first()?;
        let low = outline.iter().fold(first.coords, |a, p| a.inf(&p.coords));
        let high = outline.iter().fold(first.coords, |a, p| a.sup(&p.coords));
        Some([low.into(), high.into()])
    }

    /// Number of inside pixels (at least 1), mean of their positions from the origin, and sum of
    /// the positions' products.
    fn moments(&self) -> (f64, Vector2<f64>, Matrix2<f64>) {
        let grid = &self.level.0;
        let (mut count, mut sum, mut second) = (0.0f64, Vector2::zeros(), Matrix2::zeros());
        for o in (0..grid.as_slice().len()).filter(|&o| grid.as_slice()[o] > 0.0) {
            let [i, j, _] = grid.index(o);
            let at = Vector2::new(i as f64, j as f64) * PITCH;
            count += 1.0;
            sum += at;
            second += at * at.transpose();
        }
        let count = count.max(1.0);
        (count, sum / count, second)
    }

    /// The longest closed curve where the level is 0, counter-clockwise (marching squares).
    #[must_use]
    pub fn outline(&self) -> Vec<Point2<f64>> {
        let next = self.crossings();
        let mut unused: std::collections::BTreeSet<usize> = next.keys().copied().collect();
        let mut best: Vec<usize> = Vec::new();
        while let Some(start) = unused.pop_first() {
            let mut curve = vec![start];
            let mut edge = next[&start];
            while edge != start && unused.remove(&edge) {
                curve.push(edge);
                edge = next[&edge];
            }
            if curve.len() > best.len() {
                best = curve;
            }
        }
        best.into_iter().map(|edge| self.crossing(edge)).collect()
    }

    /// For every pixel edge that the outline crosses, the edge it crosses next, inside to the left.
    /// Edges are numbered 2 · pixel for those along i, 2 · pixel + 1 along j.
    fn crossings(&self) -> BTreeMap<usize, usize> {
        let [nx, ny, _] = self.level.0.dims();
        let values = self.level.0.as_slice();
        let mut next = BTreeMap::new();
        for j in 0..ny - 1 {
            for i in 0..nx - 1 {
                let o = i + nx * j;
                let corners = [o, o + 1, o + nx + 1, o + nx];
                let edges = [2 * o, 2 * (o + 1) + 1, 2 * (o + nx), 2 * o + 1];
                let inside = corners.map(|c| values[c] > 0.0);
                // Going round the cell, the outline leaves it where inside ends and comes in
                // where it begins.
                let begins: Vec<usize> = (0..4).filter(|&k| !inside[k] && inside[(k + 1) % 4]).collect();
                let ends: Vec<usize> = (0..4).filter(|&k| inside[k] && !inside[(k + 1) % 4]).collect();
                let is_joined = corners.iter().map(|&c| values[c]).sum::<f32>() > 0.0;
                for &end in &ends {
                    // With two of each, the middle tells which belong together.
                    let after = begins.iter().copied().min_by_key(|b| (b + 4 - end) % 4);
                    let before = begins.iter().copied().min_by_key(|b| (end + 4 - b) % 4);
                    let begin = if begins.len() == 1 {
                        Some(begins[0])
                    } else if is_joined {
                        after
                    } else {
                        before
                    };
                    if let Some(begin) = begin {
                        next.insert(edges[end], edges[begin]);
                    }
                }
            }
        }
        next
    }

    /// Where the outline crosses a pixel edge.
    fn crossing(&self, edge: usize) -> Point2<f64> {
        let grid = &self.level.0;
        let (o, along_j) = (edge / 2, edge % 2 == 1);
        let [i, j, _] = grid.index(o);
        let (a, b) =
            (f64::from(grid.as_slice()[o]), f64::from(grid.as_slice()[o + if along_j { grid.dims()[0] } else { 1 }]));
        let t = a / (a - b);
        let at = Vector2::new(i as f64, j as f64) + if along_j { Vector2::new(0.0, t) } else { Vector2::new(t, 0.0) };
        self.origin + at * PITCH
    }
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

/// A piece of the outline, read by the share of its length.
#[derive(Clone, Debug)]
pub struct Arc {
    /// Points at equal lengths from one end to the other.
    table: Vec<Vector2<f64>>,
}

impl Arc {
    /// Entries of a table; a side of 500 voxels has one per voxel.
    pub const ENTRIES: usize = 513;

    /// From one place on the outline on to another; a place is an edge and a share of it.
    fn between(outline: &[Point2<f64>], from: (usize, f64), to: (usize, f64)) -> Self {
        let count = outline.len();
        let at = |(k, t): (usize, f64)| outline[k].coords + (outline[(k + 1) % count] - outline[k]) * t;
        let mut points = vec![at(from)];
        let mut k = from.0;
        while k != to.0 && points.len() <= count {
            k = (k + 1) % count;
            points.push(outline[k].coords);
        }
        points.push(at(to));
        Self::of(&points)
    }

    fn of(points: &[Vector2<f64>]) -> Self {
        let mut reached = vec![0.0];
        for pair in points.windows(2) {
            reached.push(reached[reached.len() - 1] + (pair[1] - pair[0]).norm());
        }
        let total = reached[reached.len() - 1];
        let mut k = 1;
        let mut entry = |n: usize| {
            let wanted = total * n as f64 / (Self::ENTRIES - 1) as f64;
            while k + 1 < points.len() && reached[k] < wanted {
                k += 1;
            }
            let t = (wanted - reached[k - 1]) / (reached[k] - reached[k - 1]).max(1e-12);
            points[k - 1] + (points[k] - points[k - 1]) * t.clamp(0.0, 1.0)
        };
        Self { table: (0..Self::ENTRIES).map(&mut entry).collect() }
    }

    /// The point at a share of the length, 0 to 1.
    #[must_use]
    pub fn at(&self, share: f64) -> Vector2<f64> {
        let x = share.clamp(0.0, 1.0) * (Self::ENTRIES - 1) as f64;
        let k = floor_index(x).min(Self::ENTRIES - 2);
        self.table[k] + (self.table[k + 1] - self.table[k]) * (x - k as f64)
    }
}

/// Keeps the largest piece of the pixels and fills its holes; returns their share too.
fn fill_holes(mut pixels: Grid<bool>, go_on: &GoOn<'_>) -> Result<(Grid<bool>, f64), Cancelled> {
    let pieces = components(&pixels, true, Connectivity::Corners26, go_on)?;
    pieces.set_all_but(pieces.largest(), &mut pixels, false);
    let background = components(&pixels, false, Connectivity::Faces6, go_on)?;
    let filled = background.set_all_but(background.of_first_voxel(), &mut pixels, true);
    let area = pixels.as_slice().iter().filter(|p| **p).count().max(1);
    Ok((pixels, filled as f64 / area as f64))
}
