//! A region of the plane as the image of the unit square.
//!
//! The boundary is mapped by length, side by side; the inside by harmonic functions. The square is
//! convex, so the map is one to one however the region is bent (Radó, Kneser, Choquet; Floater,
//! Hormann, *Surface parameterization: a tutorial*, 2005, section 2): a patch that blends the
//! sides (Coons) leaves a region with a hollow.

use nalgebra::{Point2, Vector2};

use crate::numerics::field::floor_index;

use super::arc::Arc;
use super::corners::sides;
use crate::cancel::{Cancel, Cancelled};
use crate::pipeline::plane::region::{PITCH, Region};

/// Nodes of the table along each side of the square.
const TABLE: usize = 129;
/// Pixels along the longer side of the finest raster that Laplace's equation is solved on, at the
/// most: two for each entry of the table.
const MOST_PIXELS: usize = 256;
/// Pixels along the longer side of the coarsest raster, from which the others start.
const LEAST_PIXELS: usize = 24;
/// Sweeps at most. 30 to 60 are the rule.
const MAX_SWEEPS: usize = 2000;
/// Change of a share at which the solver ends.
const SETTLED: f64 = 1e-5;

/// The map from shares of the square to the region, as a table read between its nodes.
#[derive(Clone, Debug)]
pub struct Patch {
    rows: usize,
    cols: usize,
    table: Vec<Vector2<f64>>,
}

impl Patch {
    /// A region as the image of the square. `None` for an empty region.
    ///
    /// # Errors
    /// When it is cancelled.
    pub fn of(region: &Region, cancel: &dyn Cancel) -> Result<Option<Self>, Cancelled> {
        sides(region).map(|sides| Self::harmonic(region, &sides, cancel)).transpose()
    }

    /// From a region and the four pieces of its outline, counter-clockwise from the bottom.
    fn harmonic(region: &Region, sides: &[Arc; 4], cancel: &dyn Cancel) -> Result<Self, Cancelled> {
        let [nx, ny, _] = region.level.0.dims();
        let stride = nx.max(ny).div_ceil(MOST_PIXELS);
        let raster = Raster::solved(region, &RimShares::of(sides), stride, cancel)?;
        let mut patch = Self { rows: TABLE, cols: TABLE, table: vec![Vector2::repeat(f64::NAN); TABLE * TABLE] };
        let width = raster.dims[0];
        for o in (0..raster.kind.len() - width - 1).filter(|&o| raster.is_inside(o)) {
            let corners = [o, o + 1, o + width + 1, o + width];
            if corners.iter().all(|&c| raster.is_inside(c)) {
                for t in [[0, 1, 2], [0, 2, 3]] {
                    patch.fill(t.map(|k| (raster.shares[corners[k]], raster.place(corners[k]).coords)));
                }
            }
        }
        patch.set_sides(sides);
        patch.close_gaps();
        Ok(patch)
    }

    /// Sets the table nodes inside a triangle, given by shares and places of its corners.
    fn fill(&mut self, corners: [(Vector2<f64>, Vector2<f64>); 3]) {
        let last = (TABLE - 1) as f64;
        let s = corners.map(|c| c.0 * last);
        let area = (s[1] - s[0]).perp(&(s[2] - s[0]));
        if area.abs() < 1e-12 {
            return;
        }
        let low = s[0].inf(&s[1]).inf(&s[2]);
        let high = s[0].sup(&s[1]).sup(&s[2]);
        for j in floor_index(low.y.ceil())..=floor_index(high.y).min(TABLE - 1) {
            for i in floor_index(low.x.ceil())..=floor_index(high.x).min(TABLE - 1) {
                let p = Vector2::new(i as f64, j as f64);
                let b = (p - s[0]).perp(&(s[2] - s[0])) / area;
                let c = (s[1] - s[0]).perp(&(p - s[0])) / area;
                if b >= -1e-9 && c >= -1e-9 && b + c <= 1.0 + 1e-9 {
                    self.table[i + TABLE * j] = corners[0].1 * (1.0 - b - c) + corners[1].1 * b + corners[2].1 * c;
                }
            }
        }
    }

    /// The rim of the table is the outline itself.
    fn set_sides(&mut self, [bottom, right, top, left]: &[Arc; 4]) {
        for k in 0..TABLE {
            let share = k as f64 / (TABLE - 1) as f64;
            self.table[k] = bottom.at(share);
            self.table[(TABLE - 1) + TABLE * k] = right.at(share);
            self.table[(TABLE - 1 - k) + TABLE * (TABLE - 1)] = top.at(share);
            self.table[TABLE * (TABLE - 1 - k)] = left.at(share);
        }
    }

    /// Nodes between the outermost pixels and the outline, as means of what is around them.
    fn close_gaps(&mut self) {
        let mut gaps: Vec<usize> = (0..TABLE * TABLE).filter(|&n| self.table[n].x.is_nan()).collect();
        while !gaps.is_empty() {
            let mean = |table: &[Vector2<f64>], n: usize| {
                let near = [n - 1, n + 1, n - TABLE, n + TABLE].map(|m| table[m]);
                let known: Vec<_> = near.into_iter().filter(|v| !v.x.is_nan()).collect();
                (!known.is_empty()).then(|| known.iter().sum::<Vector2<f64>>() / known.len() as f64)
            };
            let found: Vec<(usize, Vector2<f64>)> =
                gaps.iter().filter_map(|&n| Some((n, mean(&self.table, n)?))).collect();
            found.iter().for_each(|(n, v)| self.table[*n] = *v);
            gaps.retain(|&n| self.table[n].x.is_nan());
        }
    }

    /// From the places of `rows` × `cols` nodes at equal shares, row-major.
    #[must_use]
    pub fn of_nodes(rows: usize, cols: usize, nodes: &[Point2<f64>]) -> Self {
        Self { rows, cols, table: nodes.iter().map(|n| n.coords).collect() }
    }

    /// The point at shares (s along the first axis, t along the second).
    #[must_use]
    pub fn at(&self, shares: Point2<f64>) -> Point2<f64> {
        let (x, y) =
            (shares.x.clamp(0.0, 1.0) * (self.cols - 1) as f64, shares.y.clamp(0.0, 1.0) * (self.rows - 1) as f64);
        let (i, j) = (floor_index(x).min(self.cols - 2), floor_index(y).min(self.rows - 2));
        let (a, b) = (x - i as f64, y - j as f64);
        let node = |i: usize, j: usize| self.table[i + self.cols * j];
        let low = node(i, j) * (1.0 - a) + node(i + 1, j) * a;
        let high = node(i, j + 1) * (1.0 - a) + node(i + 1, j + 1) * a;
        Point2::from(low * (1.0 - b) + high * b)
    }
}

/// A pixel of the region.
#[derive(Clone, Copy, PartialEq)]
enum Pixel {
    Outside,
    Rim,
    Inner,
}

/// The shares of the square at the pixels of a region, every few pixels of its own raster.
struct Raster {
    origin: Point2<f64>,
    dims: [usize; 2],
    stride: usize,
    kind: Vec<Pixel>,
    shares: Vec<Vector2<f64>>,
}

impl Raster {
    /// Solved on a raster of half as many pixels along each side first, on which what is smooth
    /// settles at a quarter of the cost.
    fn solved(region: &Region, rim: &RimShares, stride: usize, cancel: &dyn Cancel) -> Result<Self, Cancelled> {
        let [nx, ny, _] = region.level.0.dims();
        let is_coarsest = nx.max(ny) / stride < 2 * LEAST_PIXELS;
        let coarse = (!is_coarsest).then(|| Self::solved(region, rim, 2 * stride, cancel)).transpose()?;
        let mut raster = Self::blank(region, stride);
        raster.shares = (0..raster.kind.len())
            .map(|o| match (raster.kind[o], &coarse) {
                (Pixel::Rim, _) => rim.nearest(raster.place(o)),
                (Pixel::Inner, Some(coarse)) => {
                    coarse.read(raster.at(o)).unwrap_or_else(|| rim.nearest(raster.place(o)))
                }
                _ => Vector2::repeat(0.5),
            })
            .collect();
        raster.relax(cancel)?;
        Ok(raster)
    }

    fn blank(region: &Region, stride: usize) -> Self {
        let level = &region.level.0;
        // One pixel more on every side, so that all inside have neighbours.
        let dims = [0, 1].map(|a| level.dims()[a].div_ceil(stride) + 2);
        let is_inside = |i: usize, j: usize| {
            let at = [i.wrapping_sub(1).wrapping_mul(stride), j.wrapping_sub(1).wrapping_mul(stride), 0];
            at[0] < level.dims()[0] && at[1] < level.dims()[1] && level[at] > 0.0
        };
        let kind = |o: usize| {
            let (i, j) = (o % dims[0], o / dims[0]);
            if i == 0 || j == 0 || !is_inside(i, j) {
                Pixel::Outside
            } else if is_inside(i - 1, j) && is_inside(i + 1, j) && is_inside(i, j - 1) && is_inside(i, j + 1) {
                Pixel::Inner
            } else {
                Pixel::Rim
            }
        };
        let kind = (0..dims[0] * dims[1]).map(kind).collect();
        Self { origin: region.origin, dims, stride, kind, shares: Vec::new() }
    }

    fn is_inside(&self, o: usize) -> bool {
        self.kind[o] != Pixel::Outside
    }

    /// A pixel in those of the region.
    fn at(&self, o: usize) -> Vector2<f64> {
        let [i, j] = [o % self.dims[0], o / self.dims[0]].map(|x| x as f64 - 1.0);
        Vector2::new(i, j) * self.stride as f64
    }

    fn place(&self, o: usize) -> Point2<f64> {
        self.origin + self.at(o) * PITCH
    }

    /// The mean of the pixels around a place (in pixels of the region) that are inside, weighted as for
    /// bilinear interpolation; `None` when there is none.
    fn read(&self, at: Vector2<f64>) -> Option<Vector2<f64>> {
        let at = at / self.stride as f64 + Vector2::repeat(1.0);
        let [i, j] = [floor_index(at.x), floor_index(at.y)];
        let (a, b) = (at.x - i as f64, at.y - j as f64);
        let (mut sum, mut total) = (Vector2::zeros(), 0.0);
        for (di, dj, weight) in
            [(0, 0, (1.0 - a) * (1.0 - b)), (1, 0, a * (1.0 - b)), (0, 1, (1.0 - a) * b), (1, 1, a * b)]
        {
            let o = i + di + self.dims[0] * (j + dj);
            if weight > 0.0 && self.kind.get(o).is_some_and(|kind| *kind != Pixel::Outside) {
                sum += self.shares[o] * weight;
                total += weight;
            }
        }
        (total > 0.0).then(|| sum / total)
    }

    /// Solves Laplace's equation for both shares on the inner pixels, by over-relaxation.
    fn relax(&mut self, cancel: &dyn Cancel) -> Result<(), Cancelled> {
        let width = self.dims[0];
        let inner: Vec<usize> = (0..self.kind.len()).filter(|&o| self.kind[o] == Pixel::Inner).collect();
        // The best factor of a square of this many pixels; a longer region settles no slower.
        let across = (inner.len() as f64).sqrt().max(2.0);
        let factor = 2.0 / (1.0 + (std::f64::consts::PI / across).sin());
        let shares = &mut self.shares;
        for _ in 0..MAX_SWEEPS {
            cancel.check()?;
            let mut moved = 0.0f64;
            for &o in &inner {
                let mean = (shares[o - 1] + shares[o + 1] + shares[o - width] + shares[o + width]) / 4.0;
                let step = (mean - shares[o]) * factor;
                shares[o] += step;
                moved = moved.max(step.x.abs().max(step.y.abs()));
            }
            if moved < SETTLED {
                break;
            }
        }
        Ok(())
    }
}

/// Points of the outline with their shares on the square's boundary.
struct RimShares {
    points: Vec<(Vector2<f64>, Vector2<f64>)>,
}

impl RimShares {
    fn of(sides: &[Arc; 4]) -> Self {
        /// Points per side.
        const PIECES: usize = 256;
        let on_square = |side: usize, a: f64| match side {
            0 => Vector2::new(a, 0.0),
            1 => Vector2::new(1.0, a),
            2 => Vector2::new(1.0 - a, 1.0),
            _ => Vector2::new(0.0, 1.0 - a),
        };
        let points = (0..4 * PIECES).map(|n| {
            let (side, a) = (n / PIECES, (n % PIECES) as f64 / PIECES as f64);
            (sides[side].at(a), on_square(side, a))
        });
        Self { points: points.collect() }
    }

    fn nearest(&self, p: Point2<f64>) -> Vector2<f64> {
        let distance = |q: &Vector2<f64>| (q - p.coords).norm_squared();
        let best = self.points.iter().min_by(|a, b| distance(&a.0).total_cmp(&distance(&b.0)));
        best.map_or_else(Vector2::zeros, |b| b.1)
    }
}
