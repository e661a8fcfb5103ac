//! The frame of a figure: which way columns and rows run, and which side is upper. It is fixed by
//! the anatomy's position in the world, not by the signs of an eigen solver or the order of voxels,
//! so that the same organ has the same (i, j) however the scanner lay.
//!
//! 1. `cols` run along the longer principal axis of the flattened sheet. Where both axes are as good
//!    as equal, the world chooses: for a sheet with corners the one of its two axes, for a round
//!    one the direction in the plane, that leads the most superior (anterior counts half).
//! 2. Of the two senses of each direction (`cols`, `rows`, upper) the positive one is that of its
//!    strongest component: superior, anterior, or lateral, which counts half.
//! 3. *Lateral* is away from the plane x = 0 of the world, on the side that the object's centroid
//!    lies on. So left and right organs have frames that are mirror images of each other. An object
//!    on the plane has no lateral; there it is to the right.
//!
//! Every rule has a cliff, where a little noise would turn the frame. There it is called ambiguous.

use nalgebra::{Matrix2, Matrix3x2, Point2, Point3, SymmetricEigen, Vector2, Vector3};
use rayon::prelude::*;

use crate::model::{FrameFacts, FrameRule};
use crate::space::{Grid, WorldFromVoxel, WorldVector};

use crate::pipeline::lattice::outline::Region;
use crate::pipeline::observer::{Cancelled, Observer};
use crate::pipeline::sheets::sides::SheetSides;
use crate::pipeline::solid::Solid;

/// Ratio of the extents up to which the world chooses the axes: below it, an eigenvector moves by
/// more than 15° when one edge of a sheet of 20 voxels moves by one.
const NEAR_SQUARE: f64 = 1.1;
/// Ratio of the extents up to which a voxel at an edge may decide which is the longer.
const AMBIGUOUS_ASPECT: f64 = 1.15;
/// Share of the fourth angular moment from which a sheet has corners: a square has 0.43, an octagon
/// 0, an ellipse of aspect 1.1 has 0.01.
const CORNERED: f64 = 0.1;
/// A component that points the other way and is at least this share of the strongest one makes a
/// sense ambiguous: two directions 5° apart could be decided differently.
const CLOSE_SECOND: f64 = 0.85;
/// Distance of the centroid from the plane x = 0, as a share of the object's extent in x, from
/// which the object lies on one side of the body.
const OFF_MIDLINE: f64 = 0.25;
/// Mean of a unit vector over the sheet below which it has no direction worth the name: a half
/// ring has 0.64, a closed ring 0.
const CURLED: f64 = 0.3;

/// Which world directions count as positive for one object.
#[derive(Clone, Copy, Debug)]
pub struct Senses {
    /// +1 when lateral is towards right, −1 when it is towards left.
    lateral: f64,
    /// The object lies on the plane x = 0, so that lateral means nothing.
    is_midline: bool,
}

/// A decided sense.
#[derive(Clone, Debug)]
pub struct Sense {
    /// +1 when the direction is positive, −1 when its opposite is.
    pub sign: f64,
    /// Why the other sense would be as good.
    pub ambiguity: Option<&'static str>,
}

impl Senses {
    /// For an object, from the side of the plane x = 0 on which its centroid lies.
    ///
    /// # Errors
    /// When the observer asks to stop.
    pub fn of(
        inside: &Grid<bool>,
        world_from_work: &WorldFromVoxel,
        observer: &dyn Observer,
    ) -> Result<Self, Cancelled> {
        let [nx, ny, _] = inside.dims();
        let x_of = |i: usize, j: usize, k: usize| world_from_work.point(Point3::from([i, j, k].map(|x| x as f64))).x;
        // Of a row: its voxels, the sums of their indices, and the range of x.
        let of_row = |(row, cells): (usize, &[bool])| {
            observer.check()?;
            let [j, k] = [row % ny, row / ny];
            let taken = || (0..nx).filter(|&i| cells[i]);
            let (count, sum) = taken().fold((0, 0), |(count, sum), i| (count + 1, sum + i));
            let ends = [taken().next(), taken().next_back()].into_iter().flatten().map(|i| x_of(i, j, k));
            let range = ends.fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], x| [low.min(x), high.max(x)]);
            Ok(([count, sum, count * j, count * k], range))
        };
        let both = |(a, p): ([usize; 4], [f64; 2]), (b, q): ([usize; 4], [f64; 2])| {
            Ok(([0, 1, 2, 3].map(|n| a[n] + b[n]), [p[0].min(q[0]), p[1].max(q[1])]))
        };
        let none = || ([0; 4], [f64::INFINITY, f64::NEG_INFINITY]);
        let rows = inside.as_slice().par_chunks(nx).enumerate().with_min_len(64);
        let ([count, i, j, k], [low, high]) = rows.map(of_row).try_reduce(none, both)?;
        let mean = [i, j, k].map(|sum| sum as f64 / count.max(1) as f64);
        let centroid = world_from_work.point(Point3::from(mean)).x;
        let is_midline = count == 0 || centroid.abs() < OFF_MIDLINE * (high - low);
        Ok(Self { lateral: if is_midline || centroid > 0.0 { 1.0 } else { -1.0 }, is_midline })
    }

    /// Which sense of a direction is the positive one.
    #[must_use]
    pub fn of_direction(&self, direction: WorldVector) -> Sense {
        /// Superior and anterior are known from the world alone, lateral needs the side too: a
        /// direction must be twice as lateral as it is anything else.
        const LATERAL_WEIGHT: f64 = 0.5;
        let weighted = [direction.z, direction.y, LATERAL_WEIGHT * self.lateral * direction.x];
        let strongest = weighted.into_iter().fold(0.0f64, |best, x| if x.abs() > best.abs() { x } else { best });
        let sign = if strongest < 0.0 { -1.0 } else { 1.0 };
        let opposed = weighted.into_iter().map(|x| -sign * x).fold(0.0, f64::max);
        let ambiguity = if direction.norm() < CURLED {
            Some("curls up: it has no one direction")
        } else if opposed >= CLOSE_SECOND * strongest.abs() {
            Some("is as much towards one world direction as against another")
        } else if self.is_midline && strongest.abs() == weighted[2].abs() {
            Some("runs sideways in an object on the plane x = 0, where neither side is lateral")
        } else {
            None
        };
        Sense { sign, ambiguity }
    }
}

/// Turns the flattened sheet into its frame (columns along the first coordinate, rows along the
/// second) and says which it is.
///
/// # Errors
/// When the observer asks to stop.
pub fn framed(
    flat: &[Point2<f64>],
    sheet: &SheetSides,
    solid: &Solid,
    senses: &Senses,
    observer: &dyn Observer,
) -> Result<(Vec<Point2<f64>>, FrameFacts), Cancelled> {
    let region = Region::of(flat, observer)?;
    let world_from_plane = world_from_plane(flat, &sheet.medial.positions, solid);
    let (rule, axes, aspect) = axes(&region, flat, &world_from_plane);
    let mut ambiguities = Vec::new();
    let mut note = |what: &str, why: Option<&str>| ambiguities.extend(why.map(|why| format!("{what} {why}")));
    note("the sheet", (aspect < AMBIGUOUS_ASPECT).then_some("is nearly as wide as it is long"));
    let mut sensed = |what: &str, direction: WorldVector| {
        let sense = senses.of_direction(direction);
        note(what, sense.ambiguity);
        sense.sign
    };
    let [cols, rows] = axes.map(|axis| world_from_plane * axis);
    let signs = Vector2::new(sensed("the direction of the columns", cols), sensed("the direction of the rows", rows));
    // The sides are turned already.
    let upper = sheet.normals.iter().map(|n| world_direction(*n, solid)).sum::<WorldVector>();
    let upper = upper / sheet.normals.len().max(1) as f64;
    sensed("the upper side", upper);
    let points = flat
        .iter()
        .map(|p| Point2::from(Vector2::new(axes[0].dot(&p.coords), axes[1].dot(&p.coords)).component_mul(&signs)))
        .collect();
    let unit = |v: WorldVector| v.try_normalize(1e-9).unwrap_or_default();
    let facts = FrameFacts {
        rule,
        cols_along: unit(cols * signs.x),
        rows_along: unit(rows * signs.y),
        upper_towards: unit(upper),
        aspect,
        ambiguities,
    };
    Ok((points, facts))
}

/// Directions of columns and rows in the plane, how they were found, and the ratio of the extents.
fn axes(
    region: &Region,
    flat: &[Point2<f64>],
    world_from_plane: &Matrix3x2<f64>,
) -> (FrameRule, [Vector2<f64>; 2], f64) {
    let (principal, [long, short]) = region.principal_axes();
    let aspect = long / short.max(1e-9);
    if aspect >= NEAR_SQUARE {
        return (FrameRule::LongerAxis, principal, aspect);
    }
    let superior = superior_form(world_from_plane);
    if let Some([a, b]) = cornered_axes(flat) {
        let axes = if a.dot(&(superior * a)) >= b.dot(&(superior * b)) { [a, b] } else { [b, a] };
        return (FrameRule::SuperiorOfEqualAxes, axes, aspect);
    }
    let eigen = SymmetricEigen::new(superior);
    let most = if eigen.eigenvalues[0] >= eigen.eigenvalues[1] { 0 } else { 1 };
    let cols = eigen.eigenvectors.column(most).into_owned();
    (FrameRule::SuperiorDirection, [cols, Vector2::new(-cols.y, cols.x)], aspect)
}

/// How much a direction of the plane leads superior or, at half the weight, anterior: a quadratic
/// form. Reflecting the world in x leaves it as it is.
fn superior_form(world_from_plane: &Matrix3x2<f64>) -> Matrix2<f64> {
    /// An axial sheet has no superior direction; anterior is the next that is the same on both
    /// sides of the body.
    const ANTERIOR_WEIGHT: f64 = 0.5;
    let (anterior, superior) = (world_from_plane.row(1), world_from_plane.row(2));
    anterior.transpose() * anterior * ANTERIOR_WEIGHT + superior.transpose() * superior
}

/// The two axes of a sheet with four corners, which lie half-way between them: from the fourth
/// angular moment Σ r⁴ e^(4iφ) about the centroid. `None` for a round sheet.
fn cornered_axes(flat: &[Point2<f64>]) -> Option<[Vector2<f64>; 2]> {
    let centre = flat.iter().map(|p| p.coords).sum::<Vector2<f64>>() / flat.len().max(1) as f64;
    let (mut moment, mut total) = (Vector2::zeros(), 0.0);
    for p in flat {
        let d = p.coords - centre;
        let square = Vector2::new(d.x * d.x - d.y * d.y, 2.0 * d.x * d.y);
        moment += Vector2::new(square.x * square.x - square.y * square.y, 2.0 * square.x * square.y);
        total += d.norm_squared().powi(2);
    }
    if moment.norm() < CORNERED * total {
        return None;
    }
    let angle = (moment.y.atan2(moment.x) + std::f64::consts::PI) / 4.0;
    Some([Vector2::new(angle.cos(), angle.sin()), Vector2::new(-angle.sin(), angle.cos())])
}

/// The linear map from the plane to the world that fits the flattened points best: its columns are
/// the mean directions of the plane's axes in space, 1 long for a flat sheet.
fn world_from_plane(flat: &[Point2<f64>], positions: &[Point3<f64>], solid: &Solid) -> Matrix3x2<f64> {
    let count = flat.len().max(1) as f64;
    let centre = flat.iter().map(|p| p.coords).sum::<Vector2<f64>>() / count;
    let middle = positions.iter().map(|p| p.coords).sum::<Vector3<f64>>() / count;
    let (mut across, mut own) = (Matrix3x2::zeros(), Matrix2::zeros());
    for (p, x) in flat.iter().zip(positions) {
        let d = p.coords - centre;
        across += (x.coords - middle) * d.transpose();
        own += d * d.transpose();
    }
    let work_from_plane = across * own.try_inverse().unwrap_or_else(Matrix2::zeros);
    let column = |k: usize| world_direction(work_from_plane.column(k).into_owned(), solid);
    Matrix3x2::from_columns(&[column(0), column(1)])
}

/// A direction of work space in the world, of the same length.
fn world_direction(direction: Vector3<f64>, solid: &Solid) -> WorldVector {
    solid.world_from_work.vector(direction) / solid.voxel_mm
}
