//! A map of a disc to the plane made as true to lengths as can be, without ever turning a triangle over: the symmetric
//! Dirichlet energy of its linear maps J, the mean of |J|² + |J⁻¹|², is lowered in steps (Rabinovich, Poranne, Panozzo,
//! Sorkine-Hornung, *Scalable locally injective mappings*, ACM TOG 36, 2017):
//!
//! 1. every J is held against the turn R nearest to it, in a metric M in which the quadratic |J − R|²_M has the
//!    energy's slope; the places that make the sum least are the solution of linear equations;
//! 2. towards them goes a step that turns no triangle over, halved until the energy is lower.

use nalgebra::{DMatrix, Matrix2, Point2, Vector2};

use super::disc::Disc;
use crate::cancel::{Cancel, Cancelled};
use crate::numerics::field::id;
use crate::numerics::parallel::{POINTS_PER_TASK, each_number, each_number_within};
use crate::numerics::sparse::{FactorError, Memberships, RowSums, Sparse, solved};

/// Steps at most. Bowls and kidneys take 5 to 9, sheets with ragged rims, which are not used, up to 50.
const STEPS: usize = 60;
/// Share of the energy by which a step must lower it for another to be made. With 0.01 kidneys have 3 and 4 nodes cut short,
/// not 0 and 2; with 0.000001 steps are twice as many for nothing.
const SETTLED: f64 = 1e-4;
/// How often a step is halved at most: to a billionth, below which nothing moves.
const HALVINGS: usize = 30;
/// Share of the step at which the first triangle would be turned over that is taken at the most. With 0.5 or 0.95 nothing
/// changes but by chance; with 1 a triangle may have no area, from where no step leads on.
const BEFORE_FLIP: f64 = 0.8;
/// Height of a triangle over its longest edge that counts at the least: the shape of a flatter one is noise. From 0.01 to
/// 0.3 nothing changes; with 0 a triangle without height has no slopes.
const LEAST_HEIGHT: f64 = 0.1;
/// Weight of the triangles that fill a hole: their shapes say little of the sheet. With 0.01 and 1 nothing changes but by
/// chance.
const IN_HOLE: f64 = 0.3;
/// Weight that holds every place where it is, so that the equations have one answer: without it the map may slide. From
/// 1e-9 to 1e-3 nothing changes but by chance; with much more steps are short.
const HOLD: f64 = 1e-6;

/// A map of a disc: where its vertices lie in the plane.
pub(super) struct Map<'a> {
    disc: &'a Disc,
    shapes: Vec<Shape>,
    around: Memberships,
    pub places: Vec<Point2<f64>>,
    /// How far the corners of each triangle lie from the places of their vertices along the first axis; empty where they lie
    /// there. Of a ring some lie a turn on.
    shifts: Vec<[f64; 3]>,
}

/// A triangle in its own plane.
#[derive(Clone, Copy, Debug)]
struct Shape {
    area: f64,
    /// Slopes of the three functions that are 1 at a corner and 0 at the others.
    slopes: [Vector2<f64>; 3],
}

impl Shape {
    fn of(disc: &Disc, triangle: &[u32; 3]) -> Self {
        let [a, b, c] = triangle.map(|v| disc.positions[v as usize]);
        let (base, side) = (b - a, c - a);
        let length = base.norm().max(1e-6);
        let along = side.dot(&base) / length;
        let longest = length.max(side.norm()).max((c - b).norm());
        let height = (base.cross(&side).norm() / length).max(LEAST_HEIGHT * longest);
        let second = Vector2::new(1.0 / length, -along / (length * height));
        let third = Vector2::new(0.0, 1.0 / height);
        Self { area: length * height / 2.0, slopes: [-second - third, second, third] }
    }

    /// The linear map that carries it to three places.
    fn map(&self, corners: [Point2<f64>; 3]) -> Matrix2<f64> {
        let mut map = Matrix2::zeros();
        for (place, slope) in corners.iter().zip(&self.slopes) {
            map += place.coords * slope.transpose();
        }
        map
    }
}

/// The metric of a triangle in a step, and the turn nearest to its map.
#[derive(Clone, Copy)]
struct Pull {
    metric: Matrix2<f64>,
    turn: Matrix2<f64>,
}

impl Pull {
    /// Of a map that turns nothing over.
    fn of(map: &Matrix2<f64>) -> Self {
        let ([s, t], left, turn) = parts(map);
        let metric = left * Matrix2::from_diagonal(&Vector2::new(weight(s), weight(t))) * left.transpose();
        Self { metric, turn }
    }
}

/// (s − s⁻³) / (s − 1): with it the quadratic has the slope of s² + s⁻².
fn weight(s: f64) -> f64 {
    (s + 1.0) * (s * s + 1.0) / s.powi(3)
}

/// Singular values of a map, the larger first, its left directions, and the turn nearest to it.
fn parts(map: &Matrix2<f64>) -> ([f64; 2], Matrix2<f64>, Matrix2<f64>) {
    // The turn is the part of the map that commutes with turns; what it leaves is symmetric.
    let (c, s) = (map[(0, 0)] + map[(1, 1)], map[(1, 0)] - map[(0, 1)]);
    let length = c.hypot(s).max(1e-300);
    let turn = Matrix2::new(c, -s, s, c) / length;
    let stretch = map * turn.transpose();
    let (mean, half) = (stretch.trace() / 2.0, (stretch[(0, 0)] - stretch[(1, 1)]) / 2.0);
    let off = (stretch[(0, 1)] + stretch[(1, 0)]) / 2.0;
    let spread = half.hypot(off);
    let angle = off.atan2(half) / 2.0;
    let left = Matrix2::new(angle.cos(), -angle.sin(), angle.sin(), angle.cos());
    ([mean + spread, mean - spread], left, turn)
}

/// |J|² + |J⁻¹|²; infinite of a map that turns over.
fn energy(map: &Matrix2<f64>) -> f64 {
    let area = map.determinant();
    // Not so for NaN either.
    let is_upright = area > 0.0;
    if is_upright { map.norm_squared() * (1.0 + 1.0 / (area * area)) } else { f64::INFINITY }
}

impl<'a> Map<'a> {
    /// Of the places of a disc's vertices.
    pub fn new(disc: &'a Disc, places: Vec<Point2<f64>>) -> Self {
        let mut shapes = Vec::with_capacity(disc.triangles.len());
        let mut around = vec![Vec::new(); disc.triangles.len().max(disc.positions.len())];
        for (k, triangle) in disc.triangles.iter().enumerate() {
            let mut shape = Shape::of(disc, triangle);
            if k >= disc.of_sheet {
                shape.area *= IN_HOLE;
            }
            shapes.push(shape);
            around[k] = triangle.to_vec();
        }
        Self { disc, shapes, around: Memberships::of(&around), places, shifts: Vec::new() }
    }

    /// The same of a ring: some corners of its triangles lie a turn on.
    pub fn shifted(self, shifts: Vec<[f64; 3]>) -> Self {
        Self { shifts, ..self }
    }

    /// How far the corners of a triangle lie from the places of their vertices.
    fn shift(&self, k: usize) -> [Vector2<f64>; 3] {
        self.shifts.get(k).copied().unwrap_or_default().map(|x| Vector2::new(x, 0.0))
    }

    /// Where the corners of a triangle lie.
    pub fn corners(&self, k: usize, places: &[Point2<f64>]) -> [Point2<f64>; 3] {
        let (triangle, shift) = (self.disc.triangles[k], self.shift(k));
        [0, 1, 2].map(|corner| places[triangle[corner] as usize] + shift[corner])
    }

    /// The maps of all triangles.
    fn maps(&self, places: &[Point2<f64>], cancel: &dyn Cancel) -> Result<Vec<Matrix2<f64>>, Cancelled> {
        let map = |k: usize| self.shapes[k].map(self.corners(k, places));
        each_number(self.shapes.len(), POINTS_PER_TASK, map, cancel)
    }

    /// Mean energy over the area; infinite when a triangle is turned over.
    pub fn energy(&self, places: &[Point2<f64>], cancel: &dyn Cancel) -> Result<f64, Cancelled> {
        let (mut sum, mut area) = (0.0, 0.0);
        for (map, shape) in self.maps(places, cancel)?.iter().zip(&self.shapes) {
            sum += energy(map) * shape.area;
            area += shape.area;
        }
        Ok(sum / area)
    }

    /// Lowers the energy as far as steps do. Whether it is no less than `least`, below which nobody wants the map, and
    /// no triangle is turned over.
    ///
    /// # Errors
    /// When it is cancelled.
    pub fn relax(&mut self, least: f64, cancel: &dyn Cancel) -> Result<bool, Cancelled> {
        let mut now = self.energy(&self.places, cancel)?;
        for _ in 0..STEPS {
            if !now.is_finite() || now < least {
                return Ok(false);
            }
            let Some(aims) = self.aims(cancel)? else { return Ok(true) };
            let (places, next) = self.step(&aims, now, cancel)?;
            let gained = now - next;
            (self.places, now) = (places, next);
            if gained <= SETTLED * now {
                break;
            }
        }
        Ok(now.is_finite() && now >= least)
    }

    /// The places that the equations give; `None` where they have no answer.
    fn aims(&self, cancel: &dyn Cancel) -> Result<Option<Vec<Point2<f64>>>, Cancelled> {
        let pulls: Vec<Pull> = self.maps(&self.places, cancel)?.iter().map(Pull::of).collect();
        let count = self.places.len();
        let row = |sums: &mut RowSums, row: usize| self.row(&pulls, row, sums);
        let rows = each_number_within(2 * count, POINTS_PER_TASK, || RowSums::new(2 * count), row, cancel)?;
        let mut right = DMatrix::zeros(2 * count, 1);
        let (mut entries, mut seats) = (Vec::with_capacity(rows.len()), Vec::with_capacity(rows.len()));
        for (n, (row, value)) in rows.into_iter().enumerate() {
            entries.push(row);
            right[n] = value;
            seats.push(self.disc.positions[n / 2]);
        }
        let found = match solved(&Sparse::from_rows(entries), &seats, &right, cancel) {
            Ok(found) => found,
            Err(FactorError::Cancelled(stop)) => return Err(stop),
            Err(FactorError::NotPositive) => return Ok(None),
        };
        Ok(Some((0..count).map(|v| Point2::new(found[2 * v], found[2 * v + 1])).collect()))
    }

    /// A row of the equations, that of a coordinate of a vertex, and its right side.
    fn row(&self, pulls: &[Pull], row: usize, sums: &mut RowSums) -> (Vec<(u32, f64)>, f64) {
        let (v, axis) = (row / 2, row % 2);
        sums.add(id(row), HOLD);
        let mut right = HOLD * self.places[v][axis];
        for &(k, corner) in self.around.of_point(v) {
            let (shape, pull) = (&self.shapes[k as usize], &pulls[k as usize]);
            let own = shape.slopes[corner as usize];
            right += shape.area * (pull.metric * pull.turn * own)[axis];
            let shifts = self.shift(k as usize);
            for ((n, slope), shift) in self.disc.triangles[k as usize].iter().zip(&shape.slopes).zip(shifts) {
                let weight = shape.area * own.dot(slope);
                right -= weight * (pull.metric * shift)[axis];
                sums.add(2 * n, weight * pull.metric[(axis, 0)]);
                sums.add(2 * n + 1, weight * pull.metric[(axis, 1)]);
            }
        }
        (sums.take(), right)
    }

    /// Places on the way to the aims at which the energy is lower than `now`, and what it is; those of now where there
    /// are none.
    fn step(&self, aims: &[Point2<f64>], now: f64, cancel: &dyn Cancel) -> Result<(Vec<Point2<f64>>, f64), Cancelled> {
        let mut share = (BEFORE_FLIP * self.first_flip(aims)).min(1.0);
        for _ in 0..HALVINGS {
            let mut places = Vec::with_capacity(aims.len());
            for (place, aim) in self.places.iter().zip(aims) {
                places.push(place + (aim - place) * share);
            }
            let next = self.energy(&places, cancel)?;
            if next < now {
                return Ok((places, next));
            }
            share /= 2.0;
        }
        Ok((self.places.clone(), now))
    }

    /// The share of the way to the aims at which the first triangle has no area.
    fn first_flip(&self, aims: &[Point2<f64>]) -> f64 {
        let mut first = f64::INFINITY;
        for (k, triangle) in self.disc.triangles.iter().enumerate() {
            let [a, b, c] = self.corners(k, &self.places);
            let [da, db, dc] = triangle.map(|v| aims[v as usize] - self.places[v as usize]);
            let (p, q, dp, dq) = (b - a, c - a, db - da, dc - da);
            first = first.min(first_zero(dp.perp(&dq), dp.perp(&q) + p.perp(&dq), p.perp(&q)));
        }
        first
    }

    /// Singular values of all triangles' maps, the larger first, with the area that each stands for.
    pub fn stretches(&self, cancel: &dyn Cancel) -> Result<Vec<([f64; 2], f64)>, Cancelled> {
        let mut all = Vec::with_capacity(self.shapes.len());
        for (map, shape) in self.maps(&self.places, cancel)?.iter().zip(&self.shapes) {
            all.push((parts(map).0, shape.area));
        }
        Ok(all)
    }
}

/// The smallest positive zero of a t² + b t + c with a positive c; infinite where there is none.
fn first_zero(a: f64, b: f64, c: f64) -> f64 {
    let square = b * b - 4.0 * a * c;
    if square < 0.0 {
        return f64::INFINITY;
    }
    // The form without cancellation: t = 2 c / (−b ± √…).
    let mut first = f64::INFINITY;
    for root in [square.sqrt(), -square.sqrt()] {
        let t = 2.0 * c / (root - b);
        if t > 0.0 {
            first = first.min(t);
        }
    }
    first
}
