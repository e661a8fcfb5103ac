//! The region that a flattened surface covers: its principal axes, and for every station along
//! the first the chord inside the outline.

use nalgebra::{Matrix2, Point2, SymmetricEigen, Vector2};

use crate::numerics::components::{Connectivity, components};
use crate::numerics::distance::nearest_seed;
use crate::numerics::field::{Field, floor_index};
use crate::numerics::smooth::gaussian;
use crate::space::Grid;

/// Pixel of the region's raster, voxels.
const PITCH: f64 = 0.5;
/// Gaps between points up to twice this are part of the sheet, voxels. Neighbours on a staircase
/// lie up to 1.8 apart.
const CLOSING: f64 = 1.5;
/// Standard deviation of the outline's smoothing, voxels: the rim of a voxel sheet is jagged by
/// half a voxel.
const OUTLINE_SIGMA: f64 = 1.0;
/// Free pixels around the points.
const PADDING: usize = 12;

/// The region covered by points of the plane. Lengths are voxels.
#[derive(Clone, Debug)]
pub struct Region {
    origin: Point2<f64>,
    /// Positive inside, 0 on the smoothed outline.
    level: Field,
    /// Area of holes that were filled, as a share of the region.
    pub hole_share: f64,
}

/// Chords of a region across its first axis.
#[derive(Clone, Debug)]
pub struct Chords {
    /// First and last station.
    pub ends: [f64; 2],
    /// Station of the first entry of the tables, [`PITCH`] apart.
    first: f64,
    low: Vec<f64>,
    high: Vec<f64>,
}

impl Region {
    /// The region of `points`: their closing, with holes filled and a smooth outline.
    #[must_use]
    pub fn of(points: &[Point2<f64>]) -> Self {
        let low = points.iter().fold(Vector2::repeat(f64::INFINITY), |a, p| a.inf(&p.coords));
        let high = points.iter().fold(Vector2::repeat(f64::NEG_INFINITY), |a, p| a.sup(&p.coords));
        let origin = Point2::from(low - Vector2::repeat(PADDING as f64 * PITCH));
        let pixels = |axis: usize| floor_index(((high - low)[axis] / PITCH).ceil()) + 1 + 2 * PADDING;
        let dims = [pixels(0), pixels(1), 1];
        let mut has_point = vec![false; dims[0] * dims[1]];
        for p in points {
            let at = (p - origin) / PITCH;
            has_point[floor_index(at.x + 0.5) + dims[0] * floor_index(at.y + 0.5)] = true;
        }
        let reach = CLOSING / PITCH;
        let near = nearest_seed(dims, [1.0; 3], |o| has_point[o]).squared;
        let is_far = |o: usize| f64::from(near.as_slice()[o]) > reach * reach;
        let rim = nearest_seed(dims, [1.0; 3], is_far).squared;
        let inside: Vec<bool> = rim.as_slice().iter().map(|d| f64::from(*d) > reach * reach).collect();
        let (inside, hole_share) = fill_holes(dims, inside);
        let soft = inside.iter().map(|m| f32::from(u8::from(*m))).collect();
        let mut level = Grid::from_vec(dims, soft).expect("one value per pixel");
        gaussian(&mut level, [OUTLINE_SIGMA / PITCH, OUTLINE_SIGMA / PITCH, 0.0]);
        level.as_mut_slice().iter_mut().for_each(|v| *v -= 0.5);
        Self { origin, level: Field(level), hole_share }
    }

    /// Whether a point lies inside the outline.
    #[must_use]
    pub fn contains(&self, p: Point2<f64>) -> bool {
        let at = (p - self.origin) / PITCH;
        let dims = self.level.0.dims();
        let fits = at.iter().zip(dims).all(|(x, n)| *x >= 0.0 && *x <= (n - 1) as f64);
        fits && self.level.at(nalgebra::Point3::new(at.x, at.y, 0.0)) >= 0.0
    }

    /// Unit directions of the longest and the shortest extent, from the second moments of the
    /// area (not of the points, whose density depends on the grid), and the root moments.
    #[must_use]
    pub fn principal_axes(&self) -> ([Vector2<f64>; 2], [f64; 2]) {
        let grid = &self.level.0;
        let inside = (0..grid.as_slice().len()).filter(|&o| grid.as_slice()[o] > 0.0);
        let at = |o: usize| Vector2::new(grid.index(o)[0] as f64, grid.index(o)[1] as f64) * PITCH;
        let (mut count, mut mean, mut second) = (0.0f64, Vector2::zeros(), Matrix2::zeros());
        for o in inside {
            count += 1.0;
            mean += at(o);
            second += at(o) * at(o).transpose();
        }
        let covariance = second / count.max(1.0) - mean * mean.transpose() / (count * count).max(1.0);
        let eigen = SymmetricEigen::new(covariance);
        let (first, other) = if eigen.eigenvalues[0] >= eigen.eigenvalues[1] { (0, 1) } else { (1, 0) };
        let axis = |k: usize| eigen.eigenvectors.column(k).into_owned();
        let extent = |k: usize| eigen.eigenvalues[k].max(0.0).sqrt();
        ([axis(first), axis(other)], [extent(first), extent(other)])
    }

    /// The chord at every station along the first coordinate; where the outline is crossed more
    /// than twice, the longest piece. `None` for an empty region.
    #[must_use]
    pub fn chords(&self) -> Option<Chords> {
        let columns = self.level.0.dims()[0];
        let all: Vec<Option<(f64, f64)>> = (0..columns).map(|i| self.longest_chord(i)).collect();
        let first = all.iter().position(Option::is_some)?;
        let last = all.iter().rposition(Option::is_some)?;
        let mut known = all[first]?;
        let filled: Vec<(f64, f64)> = all[first..=last].iter().map(|c| *known_or(&mut known, *c)).collect();
        let station = |i: f64| self.origin.x + i * PITCH;
        let ends = [
            station(first as f64 - self.beyond(first, first.saturating_sub(1))),
            station(last as f64 + self.beyond(last, (last + 1).min(columns - 1))),
        ];
        let (low, high) = filled.into_iter().unzip();
        Some(Chords { ends, first: station(first as f64), low, high })
    }

    /// How far the region goes on from one column towards an empty one, pixels below 1.
    fn beyond(&self, column: usize, empty: usize) -> f64 {
        let most = |i: usize| {
            let rows = self.level.0.dims()[1];
            (0..rows).map(|j| f64::from(self.level.0[[i, j, 0]])).fold(f64::NEG_INFINITY, f64::max)
        };
        let (a, b) = (most(column), most(empty));
        if b < 0.0 { (a / (a - b)).clamp(0.0, 1.0) } else { 0.0 }
    }

    fn longest_chord(&self, column: usize) -> Option<(f64, f64)> {
        let rows = self.level.0.dims()[1];
        let value = |j: usize| f64::from(self.level.0[[column, j, 0]]);
        let crossing = |j: usize| j as f64 + value(j) / (value(j) - value(j + 1));
        let (mut best, mut start) = (None::<(f64, f64)>, None);
        for j in 0..rows - 1 {
            match (value(j) >= 0.0, value(j + 1) >= 0.0) {
                (false, true) => start = Some(crossing(j)),
                (true, false) => {
                    if let Some(a) = start.take() {
                        let b = crossing(j);
                        if best.is_none_or(|(p, q)| b - a > q - p) {
                            best = Some((a, b));
                        }
                    }
                }
                _ => {}
            }
        }
        best.map(|(a, b)| (self.origin.y + a * PITCH, self.origin.y + b * PITCH))
    }
}

/// The chord, or the last one known.
fn known_or(known: &mut (f64, f64), chord: Option<(f64, f64)>) -> &(f64, f64) {
    if let Some(chord) = chord {
        *known = chord;
    }
    known
}

/// Keeps the largest piece of the pixels and fills its holes; returns their share too.
fn fill_holes(dims: [usize; 3], inside: Vec<bool>) -> (Vec<bool>, f64) {
    let pieces = components(dims, Connectivity::Corners26, |o| inside[o]);
    let largest = pieces.largest();
    let mut kept: Vec<bool> = pieces.labels.as_slice().iter().map(|l| *l != 0 && Some(*l) == largest).collect();
    let outside = components(dims, Connectivity::Faces6, |o| !kept[o]);
    let open = outside.labels.as_slice()[0];
    let mut filled = 0;
    for (k, l) in kept.iter_mut().zip(outside.labels.as_slice()) {
        if *l != 0 && *l != open {
            *k = true;
            filled += 1;
        }
    }
    let area = kept.iter().filter(|k| **k).count().max(1);
    (kept, f64::from(filled) / area as f64)
}

impl Chords {
    /// Both ends of the chord at a station.
    #[must_use]
    pub fn at(&self, station: f64) -> [f64; 2] {
        let x = (station - self.first) / PITCH;
        [read(&self.low, x), read(&self.high, x)]
    }
}

/// Linear interpolation in a table; its ends go on outside.
fn read(table: &[f64], x: f64) -> f64 {
    let last = table.len() - 1;
    let x = x.clamp(0.0, last as f64);
    let k = floor_index(x).min(last.saturating_sub(1));
    let next = table[(k + 1).min(last)];
    table[k] + (next - table[k]) * (x - k as f64)
}
