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

use crate::model::{FrameFacts, FrameRule};
use crate::space::WorldVector;

use crate::cancel::{Cancel, Cancelled};
use crate::pipeline::plane::region::Region;
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
    let mut ambiguities = Vec::new();
    let mut note = |what: &str, why: Option<&str>| ambiguities.extend(why.map(|why| format!("{what} {why}")));
    note("the sheet", (aspect < AMBIGUOUS_ASPECT).then_some("is nearly as wide as it is long"));
    let mut sensed = |what: &str, direction: WorldVector| {
        let sense = solid.senses.of_direction(direction);
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
