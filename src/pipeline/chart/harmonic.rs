//! Harmonic shares: to every pixel of a region its place in the unit square, by Laplace's equation with the sides of
//! the square on the outline.
//!
//! It is solved by over-relaxation, on rasters of half as many pixels along each side first, on which what is smooth
//! settles at a quarter of the cost.

use std::f64::consts::PI;

use nalgebra::{Point2, Vector2};

use super::arc::Arc;
use crate::cancel::{Cancel, Cancelled};
use crate::numerics::field::floor_index;
use crate::pipeline::plane::region::{PITCH, Region};

/// Pixels along the longer side of the finest raster at the most: two for each entry of the patch's table.
const MOST_PIXELS: usize = 256;
/// Pixels along the longer side of the coarsest raster, from which the others start. With fewer, narrow parts of a region
/// fall between them; with more, the coarsest takes longer to settle.
const LEAST_PIXELS: usize = 24;
/// Sweeps at most. 30 to 60 are the rule.
const MAX_SWEEPS: usize = 2000;
/// Change of a share at which the solver ends, about a thousandth of a step of the patch's table: less only takes longer.
const SETTLED: f64 = 1e-5;

/// A pixel of the region.
#[derive(Clone, Copy, PartialEq)]
enum Pixel {
    Outside,
    Rim,
    Inner,
}

/// The shares of the square at the pixels of a region, every few pixels of its own raster.
pub(super) struct Harmonic {
    origin: Point2<f64>,
    dims: [usize; 2],
    stride: usize,
    kind: Vec<Pixel>,
    shares: Vec<Vector2<f64>>,
}

impl Harmonic {
    /// Of a region and the four pieces of its outline, counter-clockwise from the bottom.
    ///
    /// # Errors
    /// When it is cancelled.
    pub fn of(region: &Region, sides: &[Arc; 4], cancel: &dyn Cancel) -> Result<Self, Cancelled> {
        let [nx, ny] = region.raster.dims;
        Self::solved(region, &RimShares::of(sides), nx.max(ny).div_ceil(MOST_PIXELS), cancel)
    }

    /// Shares and places of the corners of all cells between four pixels inside, counter-clockwise.
    pub fn cells(&self) -> Vec<[(Vector2<f64>, Vector2<f64>); 4]> {
        let width = self.dims[0];
        let mut cells = Vec::new();
        for o in 0..self.kind.len() - width - 1 {
            let corners = [o, o + 1, o + width + 1, o + width];
            if corners.iter().all(|&c| self.kind[c] != Pixel::Outside) {
                cells.push(corners.map(|c| (self.shares[c], self.place(c).coords)));
            }
        }
        cells
    }

    /// Solved on coarser rasters first.
    fn solved(region: &Region, rim: &RimShares, stride: usize, cancel: &dyn Cancel) -> Result<Self, Cancelled> {
        let [nx, ny] = region.raster.dims;
        let is_coarsest = nx.max(ny) / stride < 2 * LEAST_PIXELS;
        let coarse = if is_coarsest { None } else { Some(Self::solved(region, rim, 2 * stride, cancel)?) };
        let mut fine = Self::blank(region, stride);
        for o in 0..fine.kind.len() {
            let share = fine.first_share(o, rim, coarse.as_ref());
            fine.shares.push(share);
        }
        fine.relax(cancel)?;
        Ok(fine)
    }

    /// A raster without shares.
    fn blank(region: &Region, stride: usize) -> Self {
        // One pixel more on every side, so that all inside have neighbours.
        let dims = region.raster.dims.map(|count| count.div_ceil(stride) + 2);
        let mut kind = Vec::with_capacity(dims[0] * dims[1]);
        for j in 0..dims[1] {
            for i in 0..dims[0] {
                kind.push(kind_of(region, stride, i, j));
            }
        }
        Self { origin: region.raster.origin, dims, stride, kind, shares: Vec::new() }
    }

    /// Where the solver starts: on the rim it stays so.
    fn first_share(&self, o: usize, rim: &RimShares, coarse: Option<&Self>) -> Vector2<f64> {
        match (self.kind[o], coarse) {
            (Pixel::Rim, _) => rim.nearest(self.place(o)),
            (Pixel::Inner, Some(coarse)) => coarse.read(self.at(o)).unwrap_or_else(|| rim.nearest(self.place(o))),
            _ => Vector2::repeat(0.5),
        }
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
        let weights = [(0, 0, (1.0 - a) * (1.0 - b)), (1, 0, a * (1.0 - b)), (0, 1, (1.0 - a) * b), (1, 1, a * b)];
        let (mut sum, mut total) = (Vector2::zeros(), 0.0);
        for (di, dj, weight) in weights {
            let o = i + di + self.dims[0] * (j + dj);
            if weight > 0.0 && o < self.kind.len() && self.kind[o] != Pixel::Outside {
                sum += self.shares[o] * weight;
                total += weight;
            }
        }
        (total > 0.0).then(|| sum / total)
    }

    /// Makes both shares of every inner pixel the means of those around it.
    fn relax(&mut self, cancel: &dyn Cancel) -> Result<(), Cancelled> {
        let width = self.dims[0];
        let inner: Vec<usize> = (0..self.kind.len()).filter(|&o| self.kind[o] == Pixel::Inner).collect();
        // The best factor of a square of this many pixels; a longer region settles no slower.
        let across = (inner.len() as f64).sqrt().max(2.0);
        let factor = 2.0 / (1.0 + (PI / across).sin());
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

/// The kind of a pixel of a coarser raster, which begins one before the region's own.
fn kind_of(region: &Region, stride: usize, i: usize, j: usize) -> Pixel {
    if i == 0 || j == 0 || !is_inside(region, stride, i, j) {
        return Pixel::Outside;
    }
    let around = [(i - 1, j), (i + 1, j), (i, j - 1), (i, j + 1)];
    if around.iter().all(|&(i, j)| is_inside(region, stride, i, j)) { Pixel::Inner } else { Pixel::Rim }
}

fn is_inside(region: &Region, stride: usize, i: usize, j: usize) -> bool {
    let [nx, ny] = region.raster.dims;
    let at = [i.wrapping_sub(1).wrapping_mul(stride), j.wrapping_sub(1).wrapping_mul(stride), 0];
    at[0] < nx && at[1] < ny && region.level.0[at] > 0.0
}

/// Points of the outline with their shares on the square's boundary.
struct RimShares {
    points: Vec<(Vector2<f64>, Vector2<f64>)>,
}

impl RimShares {
    fn of(sides: &[Arc; 4]) -> Self {
        /// Points per side: one for each pixel of the finest raster.
        const PIECES: usize = MOST_PIXELS;
        let mut points = Vec::with_capacity(4 * PIECES);
        for (side, arc) in sides.iter().enumerate() {
            for k in 0..PIECES {
                let a = k as f64 / PIECES as f64;
                points.push((arc.at(a), on_square(side, a)));
            }
        }
        Self { points }
    }

    fn nearest(&self, p: Point2<f64>) -> Vector2<f64> {
        let (mut best, mut least) = (Vector2::zeros(), f64::INFINITY);
        for (place, shares) in &self.points {
            let squared = (place - p.coords).norm_squared();
            if squared < least {
                (best, least) = (*shares, squared);
            }
        }
        best
    }
}

/// The place at a share of a side of the square, counter-clockwise from the bottom.
fn on_square(side: usize, share: f64) -> Vector2<f64> {
    match side {
        0 => Vector2::new(share, 0.0),
        1 => Vector2::new(1.0, share),
        2 => Vector2::new(1.0 - share, 1.0),
        _ => Vector2::new(0.0, 1.0 - share),
    }
}
