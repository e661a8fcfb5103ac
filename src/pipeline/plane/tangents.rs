//! How truly a plane shows a sheet: whether angles are kept, and which parts are turned over.
//!
//! Triangles of touching points are a voxel wide and as noisy as the points. So triangles are looked at through the
//! linear map that carries the neighbourhood of a point from the sheet's tangent plane to the plane:
//!
//! 1. the tangent plane of a point is that of the spread of the points within [`REACH`]; where these form a
//!    string or a lump there is none, and nothing is judged;
//! 2. tangent planes are oriented along the sheet, the most parallel ones first (a maximum spanning tree;
//!    Hoppe et al., SIGGRAPH 1992);
//! 3. the map fits the plane's coordinates over the tangent plane's in least squares.
//!
//! A map with a negative determinant turns triangles over; the side of the majority is the right one. With singular
//! values s ≥ t the angles of an equilateral triangle change by (2 √3 / π) asin((s − t) / (s + t)) on average, over its
//! turns: that is the angle error.

use std::cmp::Reverse;
use std::collections::BinaryHeap;
use std::f64::consts::PI;

use nalgebra::{Matrix2, Matrix3, Point3, SymmetricEigen, Vector2, Vector3};
use rayon::prelude::*;

use crate::cancel::{Cancel, Cancelled};
use crate::numerics::field::id;

use crate::pipeline::plane::graph::Around;
use crate::pipeline::sheets::surface::Surface;

/// Radius of a neighbourhood, voxels. Smaller ones show the noise of the points, larger ones bend, and look past
/// parts that are turned over.
const REACH: f64 = 3.0;
/// Variance across, square voxels, below which a neighbourhood is a string: one row of voxels has next to
/// none, two rows have 0.25.
const STRING: f64 = 0.15;
/// Variance along the normal over that across, above which a neighbourhood is a lump.
const LUMP: f64 = 0.5;
/// Second spread over the first up to which a plane is a line.
const LINE_SHARE: f64 = 1e-6;
/// Points that one thread takes at a time.
const POINTS_PER_TASK: usize = 256;

/// How a plane distorts a sheet.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PlaneDistortion {
    /// Share of the judged points around which the sheet is turned over.
    pub turned_over: f64,
    /// Mean change of the angles of small triangles, degrees.
    pub angle_error_deg: f64,
    /// Points with a tangent plane of their own: those that are judged.
    pub judged: usize,
}

/// The oriented tangent planes of a sheet's points.
#[derive(Clone, Debug)]
pub struct Tangents {
    planes: Vec<Tangent>,
}

/// A point with its tangent plane.
#[derive(Clone, Debug)]
struct Tangent {
    point: u32,
    /// Points around it, with the share of each in the derivatives along two tangent directions, right-handed about
    /// the oriented normal.
    around: Vec<(u32, Vector2<f64>)>,
}

/// The spread of the points around one.
struct Spread {
    /// Unit directions along, across, and normal.
    axes: [Vector3<f64>; 3],
    /// Sums of squares along them.
    squares: [f64; 3],
    is_plane: bool,
}

impl Tangents {
    /// Of a sheet. A neighbourhood is what lies within [`REACH`] along it, whatever the graph is that it is laid flat
    /// by: planes of different graphs are judged alike.
    ///
    /// # Errors
    /// When it is cancelled.
    pub fn of(surface: &Surface, cancel: &dyn Cancel) -> Result<Self, Cancelled> {
        let count = surface.positions.len();
        let all = || (0..count).into_par_iter().with_min_len(POINTS_PER_TASK);
        let near = |around: &mut Around, a: usize| {
            cancel.check()?;
            let mut near: Vec<u32> = around.within(surface, a, REACH).into_iter().map(|edge| edge.0).collect();
            near.sort_unstable();
            Ok(near)
        };
        let lists: Vec<Vec<u32>> = all().map_init(|| Around::new(count), near).collect::<Result<_, Cancelled>>()?;
        let spread = |a: usize| cancel.check().map(|()| Spread::around(&surface.positions, a, &lists[a]));
        let spreads: Vec<Spread> = all().map(spread).collect::<Result<_, _>>()?;
        let turned = turned(surface, &spreads, cancel)?;
        let tangent = |a: usize| {
            cancel.check()?;
            Ok(spreads[a].is_plane.then(|| Tangent::of(&surface.positions, a, &lists[a], &spreads[a], turned[a])))
        };
        let planes: Vec<Option<Tangent>> = all().map(tangent).collect::<Result<_, Cancelled>>()?;
        Ok(Self { planes: planes.into_iter().flatten().collect() })
    }

    /// Whether no point has a tangent plane.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.planes.is_empty()
    }

    /// The linear map after which lengths in a plane are those on the sheet, as nearly as a linear map can make
    /// them: with the maps J of all points, the mean of A J Jᵀ Aᵀ is 1. `None` where the plane is a line.
    #[must_use]
    pub fn scale(&self, at: impl Fn(usize) -> Vector2<f64>) -> Option<Matrix2<f64>> {
        let mut sum = Matrix2::zeros();
        for plane in &self.planes {
            let map = plane.map(&at);
            sum += map * map.transpose();
        }
        let eigen = SymmetricEigen::new(sum / self.planes.len().max(1) as f64);
        let (low, high) = (eigen.eigenvalues.min(), eigen.eigenvalues.max());
        // Not so for NaN either.
        let is_plane = low > LINE_SHARE * high;
        if !is_plane {
            return None;
        }
        let roots = Matrix2::from_diagonal(&eigen.eigenvalues.map(|value| value.sqrt().recip()));
        Some(eigen.eigenvectors * roots * eigen.eigenvectors.transpose())
    }

    /// How a plane distorts the sheet; `None` where nothing can be judged.
    #[must_use]
    pub fn distortion(&self, at: impl Fn(usize) -> Vector2<f64>) -> Option<PlaneDistortion> {
        let judged = self.planes.len();
        let (mut turned, mut angles) = (0, 0.0);
        for plane in &self.planes {
            let map = plane.map(&at);
            turned += usize::from(map.determinant() < 0.0);
            angles += angle_error(&map);
        }
        // The side of the majority is the right one.
        let turned = turned.min(judged - turned);
        let share = |sum: f64| sum / judged as f64;
        (judged > 0).then(|| PlaneDistortion {
            turned_over: share(turned as f64),
            angle_error_deg: share(angles.to_degrees()),
            judged,
        })
    }
}

/// Mean change of the angles of an equilateral triangle, radians.
fn angle_error(map: &Matrix2<f64>) -> f64 {
    let values = map.singular_values();
    let (sum, difference) = (values.max() + values.min(), values.max() - values.min());
    let share = if sum > 0.0 { (difference / sum).min(1.0) } else { 1.0 };
    2.0 * 3.0f64.sqrt() / PI * share.asin()
}

impl Spread {
    fn around(positions: &[Point3<f64>], a: usize, near: &[u32]) -> Self {
        let (mut spread, mut count) = (Matrix3::zeros(), 0usize);
        for &b in near {
            let d = positions[b as usize] - positions[a];
            spread += d * d.transpose();
            count += 1;
        }
        let eigen = SymmetricEigen::new(spread);
        let mut order = [0, 1, 2];
        order.sort_by(|&i, &j| eigen.eigenvalues[j].total_cmp(&eigen.eigenvalues[i]));
        let squares = order.map(|k| eigen.eigenvalues[k]);
        let axes = order.map(|k| eigen.eigenvectors.column(k).into_owned());
        let is_plane = squares[1] > STRING * count.max(1) as f64 && squares[2] < LUMP * squares[1];
        Self { axes, squares, is_plane }
    }
}

impl Tangent {
    fn of(positions: &[Point3<f64>], a: usize, near: &[u32], spread: &Spread, is_turned: bool) -> Self {
        let [along, across, normal] = spread.axes;
        let is_left_handed = along.cross(&across).dot(&normal) < 0.0;
        let across = if is_left_handed == is_turned { across } else { -across };
        let share = |&b: &u32| {
            let d = positions[b as usize] - positions[a];
            (b, Vector2::new(along.dot(&d) / spread.squares[0], across.dot(&d) / spread.squares[1]))
        };
        Self { point: id(a), around: near.iter().map(share).collect() }
    }

    /// The linear map from the tangent plane to coordinates.
    fn map(&self, at: &impl Fn(usize) -> Vector2<f64>) -> Matrix2<f64> {
        let centre = at(self.point as usize);
        let mut map = Matrix2::zeros();
        for &(b, share) in &self.around {
            map += (at(b as usize) - centre) * share.transpose();
        }
        map
    }
}

/// Whose normals must be turned for all to agree along the sheet.
fn turned(surface: &Surface, spreads: &[Spread], cancel: &dyn Cancel) -> Result<Vec<bool>, Cancelled> {
    let mut turned: Vec<Option<bool>> = vec![None; spreads.len()];
    for start in 0..spreads.len() {
        let mut heap = BinaryHeap::new();
        heap.push((0u64, Reverse(id(start)), id(start)));
        while let Some((_, Reverse(to), from)) = heap.pop() {
            cancel.check()?;
            let (to, from) = (to as usize, from as usize);
            if turned[to].is_some() {
                continue;
            }
            let agree = spreads[to].axes[2].dot(&spreads[from].axes[2]) >= 0.0;
            turned[to] = Some(turned[from].unwrap_or(false) == agree);
            for &next in &surface.adjacency[to] {
                if turned[next as usize].is_none() {
                    heap.push((parallel(&spreads[to], &spreads[next as usize]), Reverse(next), id(to)));
                }
            }
        }
    }
    Ok(turned.into_iter().map(|is| is == Some(true)).collect())
}

/// How surely two points' normals tell each other's sense: more where they are more parallel, least where one has
/// no tangent plane.
fn parallel(a: &Spread, b: &Spread) -> u64 {
    let both = f64::from(u8::from(a.is_plane && b.is_plane));
    (both + a.axes[2].dot(&b.axes[2]).abs()).to_bits()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cancel::Never;

    /// A grid of points bent over a cylinder, each touching the eight around it.
    fn bent(rows: usize, cols: usize, radius: f64) -> (Surface, Vec<Vector2<f64>>) {
        let at = |n: usize| Vector2::new((n % cols) as f64, (n / cols) as f64);
        let flat: Vec<_> = (0..rows * cols).map(at).collect();
        let place = |p: &Vector2<f64>| Point3::new(radius * (p.x / radius).sin(), p.y, radius * (p.x / radius).cos());
        let touches = |a: usize, b: usize| b != a && (flat[a] - flat[b]).norm() < 1.5;
        let touching = |a: usize| (0..flat.len()).filter(|&b| touches(a, b)).map(id).collect();
        let adjacency = (0..flat.len()).map(touching).collect();
        let positions: Vec<_> = flat.iter().map(place).collect();
        (Surface { positions, adjacency }, flat)
    }

    fn tangents() -> (Tangents, Vec<Vector2<f64>>) {
        let (surface, flat) = bent(15, 40, 12.0);
        (Tangents::of(&surface, &Never).expect("not stopped"), flat)
    }

    #[test]
    fn a_true_plane_is_called_true() {
        let (tangents, flat) = tangents();
        let found = tangents.distortion(|p| flat[p]).expect("judged");
        assert_eq!((found.judged, found.turned_over), (flat.len(), 0.0));
        assert!(found.angle_error_deg < 0.4, "{found:?}");
        let scale = tangents.scale(|p| flat[p]).expect("a plane");
        assert!((scale - Matrix2::identity()).norm() < 0.02, "{scale}");
    }

    #[test]
    fn a_stretch_by_two_changes_angles_by_21_degrees_and_is_undone() {
        let (tangents, flat) = tangents();
        let stretched = |p: usize| Vector2::new(2.0 * flat[p].x, flat[p].y);
        let found = tangents.distortion(stretched).expect("judged");
        let expected = (2.0 * 3.0f64.sqrt() / PI * (1.0f64 / 3.0).asin()).to_degrees();
        assert!((found.angle_error_deg - expected).abs() < 0.4 && found.turned_over == 0.0, "{found:?}");
        // The mean over all turns of an equilateral triangle, one by one.
        let corner = |k: usize, turn: f64| {
            let angle = turn + k as f64 * 2.0 * PI / 3.0;
            Vector2::new(2.0 * angle.cos(), angle.sin())
        };
        let angle_at = |k: usize, turn: f64| {
            (corner(k + 1, turn) - corner(k, turn)).angle(&(corner(k + 2, turn) - corner(k, turn)))
        };
        let changes = (0..3600).map(|n| (angle_at(0, f64::from(n) * PI / 1800.0) - PI / 3.0).abs().to_degrees());
        let mean = changes.sum::<f64>() / 3600.0;
        assert!((mean - expected).abs() < 1.0, "{mean:.2} and {expected:.2}");
        let skew = Matrix2::new(0.02, 0.01, 0.0, 0.05);
        let scale = tangents.scale(|p| skew * flat[p]).expect("a plane");
        let undone = tangents.distortion(|p| scale * skew * flat[p]).expect("judged");
        assert!(undone.angle_error_deg < 0.4, "{undone:?}");
    }

    #[test]
    fn what_is_folded_over_is_told_by_its_share() {
        let (tangents, flat) = tangents();
        // Ten of forty columns lie over others.
        let folded = tangents.distortion(|p| Vector2::new((flat[p].x - 9.5).abs(), flat[p].y)).expect("judged");
        assert!((folded.turned_over - 0.25).abs() < 0.01, "{folded:?}");
        let mirrored = tangents.distortion(|p| Vector2::new(-flat[p].x, flat[p].y)).expect("judged");
        assert_eq!(mirrored.turned_over, 0.0);
    }

    #[test]
    fn strings_and_lines_are_decided() {
        let (surface, _) = bent(1, 30, 1e6);
        let string = Tangents::of(&surface, &Never).expect("not stopped");
        assert!(string.is_empty());
        assert_eq!(string.distortion(|_| Vector2::zeros()), None);
        assert_eq!(string.scale(|_| Vector2::zeros()), None);
        let (tangents, flat) = tangents();
        assert_eq!(tangents.scale(|p| Vector2::new(flat[p].x, flat[p].x)), None);
        assert_eq!(tangents.scale(|_| Vector2::repeat(f64::NAN)), None);
        let line = tangents.distortion(|p| Vector2::new(flat[p].x, 0.0)).expect("judged");
        assert!((line.angle_error_deg - 99.2).abs() < 0.1, "{line:?}");
    }
}
