//! How truly a plane shows a sheet: whether angles are kept, and which parts are turned over.
//!
//! Triangles of touching points are a voxel wide and as noisy as the points. So triangles are looked at through the
//! linear map that carries the neighbourhood of a point from the sheet's tangent plane to the plane:
//!
//! 1. the tangent plane of a point is that of the spread of the points within `REACH`; where these form a
//!    string or a lump there is none, and nothing is judged;
//! 2. tangent planes are oriented along the sheet, the most parallel ones first (a maximum spanning tree;
//!    Hoppe et al., SIGGRAPH 1992);
//! 3. the map fits the plane's coordinates over the tangent plane's in least squares.
//!
//! A map with a negative determinant turns triangles over; the side of the majority is the right one. With singular
//! values s ≥ t the angles of an equilateral triangle change by (2 √3 / π) asin((s − t) / (s + t)) on average, over its
//! turns: that is the angle error.

use std::f64::consts::PI;

use nalgebra::{Matrix2, Matrix3, Point2, Point3, SymmetricEigen, Vector2, Vector3};

use crate::cancel::{Cancel, Cancelled};
use crate::numerics::moments::Axes3;
use crate::numerics::parallel::{POINTS_PER_TASK, each_number_within};
use crate::numerics::spanning::along_strongest;
use crate::pipeline::plane::graph::Around;
use crate::pipeline::surface::Surface;

/// Radius of a neighbourhood, voxels. Smaller ones show the noise of the points, larger ones bend, and look past parts
/// that are turned over. With 2, 4 % of a back muscle count as turned over and 8 % of a bladder, which are good with 3;
/// with 6, 4 % of a hip bone.
const REACH: f64 = 3.0;
/// Variance across, square voxels, below which a neighbourhood is a string: one row of voxels has next to none, two
/// rows have 0.25. With 0.05, strings are judged: 3 % of a hippocampus count as turned over, not 1 %; with 0.4 too
/// little is left: 5 % of a liver, not 2 %.
const STRING: f64 = 0.15;
/// Variance along the normal over that across, above which a neighbourhood is a lump. With more than 1, lumps are
/// judged: 3 % of a bladder count as turned over, not 1 %. With 0.2 places where sheets fold are not: 3 % of a
/// vertebra, not 10 %.
const LUMP: f64 = 0.5;
/// Second spread over the first up to which a plane is a line.
const LINE_SHARE: f64 = 1e-6;

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
pub struct Tangents<'a> {
    positions: &'a [Point3<f64>],
    /// Of every point.
    tangents: Vec<Tangent>,
}

/// The spread of the points around one: its tangent plane, where they span one.
#[derive(Clone, Debug)]
struct Tangent {
    /// Points around it, ascending.
    near: Vec<u32>,
    /// Unit directions along, across, and normal; once turned, the first two are right-handed about the oriented normal.
    axes: [Vector3<f64>; 3],
    /// Sums of squares along them.
    squares: [f64; 3],
    /// Whether there is a plane.
    is_plane: bool,
}

impl<'a> Tangents<'a> {
    /// Of a sheet. A neighbourhood is what lies within `REACH` along it, whatever the graph is that it is laid flat
    /// by: planes of different graphs are judged alike.
    ///
    /// # Errors
    /// When it is cancelled.
    pub fn of(surface: &'a Surface, cancel: &dyn Cancel) -> Result<Self, Cancelled> {
        let positions = surface.positions.as_slice();
        let count = positions.len();
        let tangent = |around: &mut Around, a: usize| Tangent::of(positions, a, points_near(surface, around, a));
        let mut tangents = each_number_within(count, POINTS_PER_TASK, || Around::new(count), tangent, cancel)?;
        let turned = turned(surface, &tangents, cancel)?;
        for (tangent, is_turned) in tangents.iter_mut().zip(turned) {
            tangent.turn(is_turned);
        }
        Ok(Self { positions, tangents })
    }

    /// The unit normal of every point, those of all agreeing along the sheet; `None` of those that have no tangent plane.
    pub fn normals(&self) -> impl Iterator<Item = Option<Vector3<f64>>> {
        let normal = |tangent: &Tangent| tangent.is_plane.then(|| tangent.axes[0].cross(&tangent.axes[1]));
        self.tangents.iter().map(normal)
    }

    /// The linear maps from the tangent planes to the places of points, of those that have one.
    fn maps(&self, places: &[Point2<f64>], period: Option<f64>) -> impl Iterator<Item = Matrix2<f64>> {
        let planes = self.tangents.iter().enumerate().filter(|(_, tangent)| tangent.is_plane);
        planes.map(move |(a, tangent)| tangent.map(self.positions, a, (places, period)))
    }

    /// The linear map after which lengths in a plane are those on the sheet, as nearly as a linear map can make
    /// them: with the maps J of all points, the mean of A J Jᵀ Aᵀ is 1. `None` where the plane is a line.
    #[must_use]
    pub fn scale(&self, places: &[Point2<f64>]) -> Option<Matrix2<f64>> {
        let (mut sum, mut planes) = (Matrix2::zeros(), 0usize);
        for map in self.maps(places, None) {
            sum += map * map.transpose();
            planes += 1;
        }
        let eigen = SymmetricEigen::new(sum / planes.max(1) as f64);
        let (low, high) = (eigen.eigenvalues.min(), eigen.eigenvalues.max());
        // Not so for NaN either.
        let is_plane = low > LINE_SHARE * high;
        if !is_plane {
            return None;
        }
        let roots = Matrix2::from_diagonal(&eigen.eigenvalues.map(|value| value.sqrt().recip()));
        Some(eigen.eigenvectors * roots * eigen.eigenvectors.transpose())
    }

    /// How a plane, of the places of all points, distorts the sheet; `None` where nothing can be judged.
    #[must_use]
    pub fn distortion(&self, places: &[Point2<f64>]) -> Option<PlaneDistortion> {
        self.distortion_round(places, None)
    }

    /// The same of a plane whose first coordinate begins again after a period.
    #[must_use]
    pub fn distortion_round(&self, places: &[Point2<f64>], period: Option<f64>) -> Option<PlaneDistortion> {
        let (mut judged, mut turned, mut angles) = (0, 0, 0.0f64);
        for map in self.maps(places, period) {
            judged += 1;
            turned += usize::from(map.determinant() < 0.0);
            angles += angle_error(&map);
        }
        if judged == 0 {
            return None;
        }
        // The side of the majority is the right one.
        let turned = turned.min(judged - turned);
        Some(PlaneDistortion {
            turned_over: turned as f64 / judged as f64,
            angle_error_deg: angles.to_degrees() / judged as f64,
            judged,
        })
    }
}

/// The points within [`REACH`] of one along the sheet, ascending.
fn points_near(surface: &Surface, around: &mut Around, a: usize) -> Vec<u32> {
    let mut near: Vec<u32> = around.within(surface, a, REACH).into_iter().map(|edge| edge.0).collect();
    near.sort_unstable();
    near
}

/// Mean change of the angles of an equilateral triangle, radians.
fn angle_error(map: &Matrix2<f64>) -> f64 {
    let values = map.singular_values();
    let (sum, difference) = (values.max() + values.min(), values.max() - values.min());
    let share = if sum > 0.0 { (difference / sum).min(1.0) } else { 1.0 };
    2.0 * 3.0f64.sqrt() / PI * share.asin()
}

impl Tangent {
    fn of(positions: &[Point3<f64>], a: usize, near: Vec<u32>) -> Self {
        let mut spread = Matrix3::zeros();
        for &b in &near {
            let d = positions[b as usize] - positions[a];
            spread += d * d.transpose();
        }
        let Axes3 { directions: axes, values: squares } = Axes3::of(spread);
        let is_plane = squares[1] > STRING * near.len().max(1) as f64 && squares[2] < LUMP * squares[1];
        Self { near, axes, squares, is_plane }
    }

    /// Makes the directions in the plane right-handed about the normal, or about its opposite where it is turned.
    fn turn(&mut self, is_turned: bool) {
        let [along, across, normal] = self.axes;
        let is_left_handed = along.cross(&across).dot(&normal) < 0.0;
        if is_left_handed != is_turned {
            self.axes[1] = -across;
        }
    }

    /// The linear map from the tangent plane of point `a` to the places of points.
    fn map(
        &self,
        positions: &[Point3<f64>],
        a: usize,
        (places, period): (&[Point2<f64>], Option<f64>),
    ) -> Matrix2<f64> {
        let ([along, across, _], [length, width, _]) = (self.axes, self.squares);
        let mut map = Matrix2::zeros();
        for &b in &self.near {
            let d = positions[b as usize] - positions[a];
            let share = Vector2::new(along.dot(&d) / length, across.dot(&d) / width);
            map += (nearest_turn(places[b as usize], places[a], period) - places[a]) * share.transpose();
        }
        map
    }
}

/// The place nearest to another at which a plane that begins again after a period has the same.
#[must_use]
pub(crate) fn nearest_turn(place: Point2<f64>, to: Point2<f64>, period: Option<f64>) -> Point2<f64> {
    let Some(period) = period else { return place };
    Point2::new(place.x - period * ((place.x - to.x) / period).round(), place.y)
}

/// Whose normals must be turned for all to agree along the sheet.
fn turned(surface: &Surface, tangents: &[Tangent], cancel: &dyn Cancel) -> Result<Vec<bool>, Cancelled> {
    let mut turned = vec![false; tangents.len()];
    let tell = |to: usize, from: usize| {
        let agree = tangents[to].axes[2].dot(&tangents[from].axes[2]) >= 0.0;
        // A first point is its own neighbour: it is not turned.
        turned[to] = turned[from] == agree;
    };
    let parallel = |a: usize, b: usize| parallel(&tangents[a], &tangents[b]);
    along_strongest(&surface.adjacency, parallel, tell, cancel)?;
    Ok(turned)
}

/// How surely two points' normals tell each other's sense: more where they are more parallel, least where one has
/// no tangent plane.
fn parallel(a: &Tangent, b: &Tangent) -> f64 {
    let both = f64::from(u8::from(a.is_plane && b.is_plane));
    both + a.axes[2].dot(&b.axes[2]).abs()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cancel::Never;
    use crate::numerics::field::id;

    /// A grid of points bent over a cylinder, each touching the eight around it.
    fn bent(rows: usize, cols: usize, radius: f64) -> (Surface, Vec<Point2<f64>>) {
        let at = |n: usize| Point2::new((n % cols) as f64, (n / cols) as f64);
        let flat: Vec<_> = (0..rows * cols).map(at).collect();
        let place = |p: &Point2<f64>| Point3::new(radius * (p.x / radius).sin(), p.y, radius * (p.x / radius).cos());
        let touches = |a: usize, b: usize| b != a && (flat[a] - flat[b]).norm() < 1.5;
        let touching = |a: usize| (0..flat.len()).filter(|&b| touches(a, b)).map(id).collect();
        let adjacency = (0..flat.len()).map(touching).collect();
        let positions: Vec<_> = flat.iter().map(place).collect();
        (Surface { positions, adjacency }, flat)
    }

    fn moved(flat: &[Point2<f64>], to: impl Fn(&Point2<f64>) -> Point2<f64>) -> Vec<Point2<f64>> {
        flat.iter().map(to).collect()
    }

    fn tangents_of(surface: &Surface) -> Tangents<'_> {
        Tangents::of(surface, &Never).expect("not stopped")
    }

    #[test]
    fn a_true_plane_is_called_true() {
        let (surface, flat) = bent(15, 40, 12.0);
        let tangents = tangents_of(&surface);
        let found = tangents.distortion(&flat).expect("judged");
        assert_eq!((found.judged, found.turned_over), (flat.len(), 0.0));
        assert!(found.angle_error_deg < 0.4, "{found:?}");
        let scale = tangents.scale(&flat).expect("a plane");
        assert!((scale - Matrix2::identity()).norm() < 0.02, "{scale}");
    }

    #[test]
    fn a_stretch_by_two_changes_angles_by_21_degrees_and_is_undone() {
        let (surface, flat) = bent(15, 40, 12.0);
        let tangents = tangents_of(&surface);
        let found = tangents.distortion(&moved(&flat, |p| Point2::new(2.0 * p.x, p.y))).expect("judged");
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
        let scale = tangents.scale(&moved(&flat, |p| skew * p)).expect("a plane");
        let undone = tangents.distortion(&moved(&flat, |p| scale * skew * p)).expect("judged");
        assert!(undone.angle_error_deg < 0.4, "{undone:?}");
    }

    #[test]
    fn what_is_folded_over_is_told_by_its_share() {
        let (surface, flat) = bent(15, 40, 12.0);
        let tangents = tangents_of(&surface);
        // Ten of forty columns lie over others.
        let folded = tangents.distortion(&moved(&flat, |p| Point2::new((p.x - 9.5).abs(), p.y))).expect("judged");
        assert!((folded.turned_over - 0.25).abs() < 0.01, "{folded:?}");
        let mirrored = tangents.distortion(&moved(&flat, |p| Point2::new(-p.x, p.y))).expect("judged");
        assert_eq!(mirrored.turned_over, 0.0);
    }

    #[test]
    fn strings_and_lines_are_decided() {
        let (surface, _) = bent(1, 30, 1e6);
        let string = tangents_of(&surface);
        assert!(string.tangents.iter().all(|tangent| !tangent.is_plane));
        assert_eq!(string.distortion(&[]), None);
        assert_eq!(string.scale(&[]), None);
        let (surface, flat) = bent(15, 40, 12.0);
        let tangents = tangents_of(&surface);
        assert_eq!(tangents.scale(&moved(&flat, |p| Point2::new(p.x, p.x))), None);
        assert_eq!(tangents.scale(&moved(&flat, |_| Point2::new(f64::NAN, f64::NAN))), None);
        let line = tangents.distortion(&moved(&flat, |p| Point2::new(p.x, 0.0))).expect("judged");
        assert!((line.angle_error_deg - 99.2).abs() < 0.1, "{line:?}");
    }
}
