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

use nalgebra::{Matrix2, Matrix3x2, Point2, Point3, Vector2, Vector3};

use crate::cancel::{Cancel, Cancelled};
use crate::model::{FrameFacts, FrameRule};
use crate::numerics::moments::{Axes2, mean};
use crate::pipeline::plane::region::Region;
use crate::pipeline::sides::SheetSides;
use crate::pipeline::solid::Solid;
use crate::space::WorldVector;

/// Ratio of the extents up to which the world chooses the axes: below it, an eigenvector moves by
/// more than 15° when one edge of a sheet of 20 voxels moves by one.
const NEAR_SQUARE: f64 = 1.1;
/// Ratio of the extents up to which a voxel at an edge may decide which is the longer.
const AMBIGUOUS_ASPECT: f64 = 1.15;
/// Share of the fourth angular moment from which a sheet has corners: a square has 0.43, an octagon
/// 0, an ellipse of aspect 1.1 has 0.01.
const CORNERED: f64 = 0.1;

/// Turns the flattened sheet into its frame (columns along the first coordinate, rows along the
/// second) and says which it is.
///
/// # Errors
/// When it is cancelled.
pub fn in_frame(
    flat: &[Point2<f64>],
    sheet: &SheetSides,
    solid: &Solid,
    cancel: &dyn Cancel,
) -> Result<(Vec<Point2<f64>>, FrameFacts), Cancelled> {
    let region = Region::of(flat, cancel)?;
    let world_from_plane = world_from_plane(flat, &sheet.medial.positions, solid);
    let (rule, axes, aspect) = axes(&region, flat, &world_from_plane);
    let mut senses = Senses { solid, ambiguities: Vec::new() };
    if aspect < AMBIGUOUS_ASPECT {
        senses.ambiguities.push("the sheet is nearly as wide as it is long".to_owned());
    }
    let [cols, rows] = axes.map(|axis| world_from_plane * axis);
    let cols_sign = senses.sign_of("the direction of the columns", cols);
    let rows_sign = senses.sign_of("the direction of the rows", rows);
    let upper = mean_normal(sheet, solid);
    // The sides are turned already.
    senses.sign_of("the upper side", upper);
    let mut points = Vec::with_capacity(flat.len());
    for p in flat {
        points.push(Point2::new(axes[0].dot(&p.coords) * cols_sign, axes[1].dot(&p.coords) * rows_sign));
    }
    let facts = FrameFacts {
        rule,
        cols_along: unit(cols * cols_sign),
        rows_along: unit(rows * rows_sign),
        upper_towards: unit(upper),
        aspect,
        ambiguities: senses.ambiguities,
    };
    Ok((points, facts))
}

/// The senses of directions in the world, and which of them are in doubt.
struct Senses<'a> {
    solid: &'a Solid,
    ambiguities: Vec<String>,
}

impl Senses<'_> {
    /// +1 for the positive sense of what `name` says, −1 for the other.
    fn sign_of(&mut self, name: &str, direction: WorldVector) -> f64 {
        let sense = self.solid.senses.of_direction(direction);
        if let Some(why) = sense.ambiguity {
            self.ambiguities.push(format!("{name} {why}"));
        }
        sense.sign
    }
}

/// The mean of a sheet's normals in the world.
fn mean_normal(sheet: &SheetSides, solid: &Solid) -> WorldVector {
    let mut sum = WorldVector::zeros();
    for normal in &sheet.normals {
        sum += world_direction(*normal, solid);
    }
    sum / sheet.normals.len().max(1) as f64
}

/// Of length 1, or none at all.
pub(super) fn unit(direction: WorldVector) -> WorldVector {
    direction.try_normalize(1e-9).unwrap_or_default()
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
    let [cols, _] = Axes2::of(superior).directions;
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
    let centre = mean(flat);
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
    let (centre, middle) = (mean(flat), mean(positions));
    let (mut across, mut own) = (Matrix3x2::zeros(), Matrix2::zeros());
    for (p, x) in flat.iter().zip(positions) {
        let d = p.coords - centre;
        across += (x.coords - middle) * d.transpose();
        own += d * d.transpose();
    }
    let work_from_plane = across * own.try_inverse().unwrap_or_else(Matrix2::zeros);
    Matrix3x2::from_columns(&[0, 1].map(|k| world_direction(work_from_plane.column(k).into_owned(), solid)))
}

/// A direction of work space in the world, of the same length.
pub(super) fn world_direction(direction: Vector3<f64>, solid: &Solid) -> WorldVector {
    solid.world_from_work.vector(direction) / solid.unit_mm
}
