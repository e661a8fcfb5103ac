//! A region of the plane as the image of the unit square.
//!
//! The boundary is mapped by length, side by side; the inside by harmonic functions. The square is
//! convex, so the map is one to one however the region is bent (Radó, Kneser, Choquet; Floater,
//! Hormann, *Surface parameterization: a tutorial*, 2005, section 2): a patch that blends the
//! sides (Coons) leaves a region with a hollow.

use nalgebra::{Point2, Vector2};

use crate::numerics::field::floor_index;

use super::outline::{Arc, PITCH, Region};

/// Nodes of the table along each side of the square.
const TABLE: usize = 129;
/// Over-relaxation of the Laplace solver: near the best for a grid of 100 pixels.
const OVER_RELAXATION: f64 = 1.93;
/// Sweeps at most. 150 are the rule for 100 pixels across.
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

/// A pixel of the region.
#[derive(Clone, Copy, PartialEq)]
enum Pixel {
    Outside,
    Rim,
    Inner,
}

impl Patch {
    /// From a region and the four pieces of its outline, counter-clockwise from the bottom.
    #[must_use]
    pub fn harmonic(region: &Region, sides: &[Arc; 4]) -> Self {
        let grid = &region.level.0;
        let [nx, ny, _] = grid.dims();
        let is_inside = |o: usize| grid.as_slice()[o] > 0.0;
        let kind: Vec<Pixel> = (0..nx * ny)
            .map(|o| match is_inside(o) {
                false => Pixel::Outside,
                true if [o - 1, o + 1, o - nx, o + nx].iter().all(|&n| is_inside(n)) => Pixel::Inner,
                true => Pixel::Rim,
            })
            .collect();
        let place = |o: usize| region.origin + Vector2::new((o % nx) as f64, (o / nx) as f64) * PITCH;
        let rim = RimShares::of(sides);
        let mut shares: Vec<Vector2<f64>> = (0..nx * ny)
            .map(|o| match kind[o] {
                Pixel::Rim => rim.nearest(place(o)),
                // A first guess; the solver forgets it.
                _ => Vector2::new((o % nx) as f64 / nx as f64, (o / nx) as f64 / ny as f64),
            })
            .collect();
        relax(&kind, &mut shares, nx);
        let mut patch = Self { rows: TABLE, cols: TABLE, table: vec![Vector2::repeat(f64::NAN); TABLE * TABLE] };
        for o in (0..nx * ny - nx - 1).filter(|&o| is_inside(o)) {
            let corners = [o, o + 1, o + nx + 1, o + nx];
            if corners.iter().all(|&c| is_inside(c)) {
                for t in [[0, 1, 2], [0, 2, 3]] {
                    patch.fill(t.map(|k| (shares[corners[k]], place(corners[k]).coords)));
                }
            }
        }
        patch.set_sides(sides);
        patch.close_gaps();
        patch
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

/// Solves Laplace's equation for both shares on the inner pixels.
fn relax(kind: &[Pixel], shares: &mut [Vector2<f64>], nx: usize) {
    let inner: Vec<usize> = (0..kind.len()).filter(|&o| kind[o] == Pixel::Inner).collect();
    for _ in 0..MAX_SWEEPS {
        let mut moved = 0.0f64;
        for &o in &inner {
            let mean = (shares[o - 1] + shares[o + 1] + shares[o - nx] + shares[o + nx]) / 4.0;
            let step = (mean - shares[o]) * OVER_RELAXATION;
            shares[o] += step;
            moved = moved.max(step.x.abs().max(step.y.abs()));
        }
        if moved < SETTLED {
            break;
        }
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
