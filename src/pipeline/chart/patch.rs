//! A region of the plane as the image of the unit square.
//!
//! 1. The boundary is mapped by length, side by side ([`sides`]);
//! 2. the inside by harmonic functions, solved for on a raster ([`Harmonic`]). The square is convex, so the map is one to one
//!    however the region is bent (Radó, Kneser, Choquet; Floater, Hormann, *Surface parameterization: a tutorial*, 2005,
//!    section 2): a patch that blends the sides (Coons) leaves a region with a hollow;
//! 3. the map from pixels to shares is turned round into a table of places.

use nalgebra::{Point2, Point3, SVector, Vector2, Vector3};

use super::arc::Arc;
use super::corners::{Ends, sides};
use super::harmonic::Harmonic;
use crate::cancel::{Cancel, Cancelled};
use crate::numerics::field::floor_index;
use crate::pipeline::plane::region::Region;

/// Nodes of the table along each side of the square. Fewer round off the bends of the outline, more ask for a finer
/// raster. With 65 and 257, models change by chance only.
const TABLE: usize = 129;

/// The map from shares of the square to the region, as a table read between its nodes.
#[derive(Clone, Debug)]
pub struct Patch {
    rows: usize,
    cols: usize,
    table: Vec<Vector2<f64>>,
    /// Where they lie in space, if lengths are to be measured there.
    positions: Vec<Vector3<f64>>,
}

/// Shares of the square, and the place that they belong to.
type Placed = (Vector2<f64>, Vector2<f64>);

impl Patch {
    /// A region as the image of the square. `None` for an empty region.
    ///
    /// # Errors
    /// When it is cancelled.
    pub fn of(region: &Region, ends: Ends, cancel: &dyn Cancel) -> Result<Option<Self>, Cancelled> {
        let Some(sides) = sides(region, ends) else { return Ok(None) };
        let harmonic = Harmonic::of(region, &sides, cancel)?;
        let mut patch = Self {
            rows: TABLE,
            cols: TABLE,
            table: vec![Vector2::repeat(f64::NAN); TABLE * TABLE],
            positions: Vec::new(),
        };
        for [a, b, c, d] in harmonic.cells() {
            patch.fill([a, b, c]);
            patch.fill([a, c, d]);
        }
        patch.set_sides(&sides);
        patch.close_gaps();
        Ok(Some(patch))
    }

    /// Sets the table nodes inside a triangle of pixels.
    fn fill(&mut self, corners: [Placed; 3]) {
        let last = (TABLE - 1) as f64;
        let s = corners.map(|corner| corner.0 * last);
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

    /// Nodes between the outermost pixels and the outline, as means of what is around them, layer by layer.
    fn close_gaps(&mut self) {
        let mut gaps: Vec<usize> = (0..TABLE * TABLE).filter(|&n| self.table[n].x.is_nan()).collect();
        while !gaps.is_empty() {
            let (mut found, mut left) = (Vec::new(), Vec::new());
            for n in gaps {
                match self.mean_around(n) {
                    Some(mean) => found.push((n, mean)),
                    None => left.push(n),
                }
            }
            for (n, mean) in found {
                self.table[n] = mean;
            }
            gaps = left;
        }
    }

    /// The mean of the nodes around one inside of the table that are known; `None` when none is.
    fn mean_around(&self, n: usize) -> Option<Vector2<f64>> {
        let (mut sum, mut count) = (Vector2::zeros(), 0usize);
        for near in [n - 1, n + 1, n - TABLE, n + TABLE] {
            if !self.table[near].x.is_nan() {
                sum += self.table[near];
                count += 1;
            }
        }
        (count > 0).then(|| sum / count as f64)
    }

    /// From the places of `rows` × `cols` nodes at equal shares, row-major.
    #[must_use]
    pub fn of_nodes(rows: usize, cols: usize, nodes: &[Point2<f64>]) -> Self {
        Self { rows, cols, table: nodes.iter().map(|n| n.coords).collect(), positions: Vec::new() }
    }

    /// The same with lengths measured in space; `position` tells where places of the plane lie there.
    #[must_use]
    pub fn measured_in_space(mut self, position: impl Fn(Point2<f64>) -> Point3<f64>) -> Self {
        self.positions = self.table.iter().map(|place| position(Point2::from(*place)).coords).collect();
        self
    }

    /// The point at shares (s along the first axis, t along the second).
    #[must_use]
    pub fn at(&self, shares: Point2<f64>) -> Point2<f64> {
        Point2::from(self.read(&self.table, shares))
    }

    /// Length of the way along the points at some shares: in the plane, or in space where positions are known.
    #[must_use]
    pub fn length(&self, shares: impl Iterator<Item = Point2<f64>>) -> f64 {
        if self.positions.is_empty() {
            length_of(shares.map(|share| self.read(&self.table, share)))
        } else {
            length_of(shares.map(|share| self.read(&self.positions, share)))
        }
    }

    /// A table between its nodes.
    fn read<const D: usize>(&self, table: &[SVector<f64, D>], shares: Point2<f64>) -> SVector<f64, D> {
        let x = shares.x.clamp(0.0, 1.0) * (self.cols - 1) as f64;
        let y = shares.y.clamp(0.0, 1.0) * (self.rows - 1) as f64;
        let (i, j) = (floor_index(x).min(self.cols - 2), floor_index(y).min(self.rows - 2));
        let (a, b) = (x - i as f64, y - j as f64);
        let n = i + self.cols * j;
        let low = table[n] * (1.0 - a) + table[n + 1] * a;
        let high = table[n + self.cols] * (1.0 - a) + table[n + self.cols + 1] * a;
        low * (1.0 - b) + high * b
    }

    /// The points at some shares.
    #[must_use]
    pub fn places(&self, shares: &[Point2<f64>]) -> Vec<Point2<f64>> {
        shares.iter().map(|s| self.at(*s)).collect()
    }
}

/// Length of the way along some points.
fn length_of<const D: usize>(points: impl Iterator<Item = SVector<f64, D>>) -> f64 {
    let (mut length, mut before) = (0.0, None);
    for point in points {
        length += before.map_or(0.0, |before: SVector<f64, D>| (point - before).norm());
        before = Some(point);
    }
    length
}
