//! The region that a flattened surface covers: its principal axes and its outline as four sides.

use std::collections::BTreeMap;

use nalgebra::{Matrix2, Point2, Point3, SymmetricEigen, Vector2};

use crate::cancel::{Cancel, Cancelled};
use crate::numerics::components::{Connectivity, components};
use crate::numerics::distance::nearest_seed;
use crate::numerics::field::{Field, floor_index};
use crate::numerics::smooth::gaussian;
use crate::space::Grid;

/// Pixel of the region's raster, voxels.
pub const PITCH: f64 = 0.5;
/// Gaps between points up to twice this are part of the sheet, voxels. Neighbours on a staircase
/// lie up to 1.8 apart.
const CLOSING: f64 = 1.5;
/// How far the sheet goes on beyond its outermost points on average, voxels: its true rim lies
/// anywhere between them and the next voxel.
const OVERHANG: f64 = 0.5;
/// Standard deviation of the outline's smoothing, voxels: the rim of a voxel sheet is jagged by
/// half a voxel.
const OUTLINE_SIGMA: f64 = 1.0;
/// Share of a sheet's area from which its holes are not filled but refused: every seventh node would lie
/// on nothing.
pub const HOLES_REFUSED: f64 = 0.15;
/// Free pixels around the points.
const PADDING: usize = 12;

/// The region covered by points of the plane. Lengths are voxels.
#[derive(Clone, Debug)]
pub struct Region {
    pub(crate) origin: Point2<f64>,
    /// Positive inside, 0 on the smoothed outline.
    pub(crate) level: Field,
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
    /// When it is cancelled.
    pub fn of(points: &[Point2<f64>], cancel: &dyn Cancel) -> Result<Self, Cancelled> {
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
        let mut near = nearest_seed(dims, [1.0; 3], &taken, cancel)?.squared;
        let is_far = |o: &usize| f64::from(near.as_slice()[*o]) > reach * reach;
        let far: Vec<usize> = (0..near.as_slice().len()).filter(is_far).collect();
        let rim = nearest_seed(dims, [1.0; 3], &far, cancel)?.squared;
        let shrink = reach - OVERHANG / PITCH;
        let inside = rim.try_map(|d| f64::from(*d) > shrink * shrink, cancel)?;
        let (inside, hole_share) = fill_holes(inside, cancel)?;
        let mut level = inside.try_map(|m| f32::from(u8::from(*m)), cancel)?;
        gaussian(&mut level, [OUTLINE_SIGMA / PITCH, OUTLINE_SIGMA / PITCH, 0.0], cancel)?;
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
    #[must_use]
    pub fn moments(&self) -> (f64, Vector2<f64>, Matrix2<f64>) {
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

/// Keeps the largest piece of the pixels and fills its holes; returns their share too.
fn fill_holes(mut pixels: Grid<bool>, cancel: &dyn Cancel) -> Result<(Grid<bool>, f64), Cancelled> {
    let pieces = components(&pixels, true, Connectivity::Corners26, cancel)?;
    pieces.set_all_but(pieces.largest(), &mut pixels, false);
    let background = components(&pixels, false, Connectivity::Faces6, cancel)?;
    let filled = background.set_all_but(background.of_first_voxel(), &mut pixels, true);
    let area = pixels.as_slice().iter().filter(|p| **p).count().max(1);
    Ok((pixels, filled as f64 / area as f64))
}
