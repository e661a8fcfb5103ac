//! Narrow strips of a sheet, where an organ tapers to a tail.
//!
//! ISOMAP keeps the two directions in which distances vary most over the whole sheet. A strip that
//! bends or twists away from them is laid on a line: its width of a few voxels is lost in the
//! plane, though its points lie side by side in space. [`unfolded`] gives them back their places
//! across the strip. A strip of one voxel's width has none: [`widened`] adds points to either side
//! of it inside the object, so that it covers a part of the plane and fits know the direction
//! across. The rim is found from there on as for any other part of the sheet.

use nalgebra::{Matrix2, Matrix3, Matrix3x2, Point2, Point3, SymmetricEigen, Vector2, Vector3};
use rayon::prelude::*;

use crate::numerics::cells::Cells;

use crate::cancel::{Cancel, Cancelled};
use crate::pipeline::sheets::sides::SheetSides;
use crate::pipeline::solid::depth::Depth;

/// Radius in the plane of the part of the sheet that tells whether it is a strip, voxels.
const REACH: f64 = 3.0;
/// How much further apart points of that part may lie in space than in the plane before they are
/// of another part.
const STRETCH: f64 = 2.0;
/// Points that such a part needs.
const MIN_POINTS: usize = 3;
/// Standard deviation across, voxels, below which a part is a strip for certain, and above which it
/// is none. Half a disc, as at the rim of a wide sheet, has 0.26 of its radius: 0.8.
const NARROW: [f64; 2] = [0.7, 1.0];
/// Width in the plane over that in space below which the strip was laid on a line for certain, and
/// above which it was not.
const FLATTENED: [f64; 2] = [0.55, 0.8];
/// Standard deviation across in space, voxels, up to which a part is a strip for certain, and from
/// which it is none: strips of 5 and 7 voxels. Wider parts that lie narrow in the plane are bent
/// out of it.
const WIDE: [f64; 2] = [1.5, 2.0];
/// Spread along the normal over that across up to which a part is one sheet for certain, and from
/// which it is parts of the sheet one above the other.
const THICK: [f64; 2] = [0.5, 0.8];
/// Length in space over that in the plane, or the other way round, up to which the plane keeps
/// lengths along the strip, and from which it does not.
const UNEVEN: [f64; 2] = [1.5, 2.0];
/// Standard deviation across, voxels, below which a strip is widened: two rows of voxels have 0.5.
const THIN: f64 = 0.6;
/// How far across from a strip's points the added ones lie, voxels; the rim is walked to from there.
/// With more at 2 voxels, surfaces of a thalamus came to lie 1.1 voxels off instead of 0.3.
const ASIDE: [f64; 2] = [1.0, -1.0];
/// Depth of an added point at the least, as a share of the radius of the point it belongs to.
const LEAST_DEPTH: f64 = 0.5;
/// Radius of a point that is widened at the least, as a share of the sheet's median: thinner strips
/// are filaments that run into an edge of the boundary.
const LEAST_RADIUS: f64 = 0.25;
/// Smallest share of the spread across that the spread along the normal may take for the points
/// themselves to tell the normal.
const FLATNESS: f64 = 0.3;
/// Points that one thread takes at a time.
const POINTS_PER_TASK: usize = 256;

/// Points of a sheet in its plane and in space. Lengths are voxels.
#[derive(Clone, Debug, Default)]
pub struct SheetPoints {
    /// Plane coordinates.
    pub flat: Vec<Point2<f64>>,
    /// Positions in work space.
    pub positions: Vec<Point3<f64>>,
    /// Radii.
    pub radii: Vec<f64>,
}

/// The directions of a strip at one of its points.
struct Strip {
    /// Unit direction across in the plane.
    across_flat: Vector2<f64>,
    /// The same in space.
    across: Vector3<f64>,
    /// Standard deviations across in the plane and in space.
    widths: [f64; 2],
    /// Middle of the strip in the plane, beside the point.
    middle: Point2<f64>,
    /// How far the point lies across from the middle, in space.
    offset: f64,
    /// How sure it is that this is a strip, 0 to 1.
    sure: f64,
}

/// Plane coordinates with the points of flattened strips back in their places across.
///
/// # Errors
/// When it is cancelled.
pub fn unfolded(sheet: &SheetSides, flat: &[Point2<f64>], cancel: &dyn Cancel) -> Result<Vec<Point2<f64>>, Cancelled> {
    let around = Around::new(flat, &sheet.medial.positions);
    let hand = handedness(sheet, &around, cancel)?;
    let moved = |k: usize| {
        cancel.check()?;
        let Some(strip) = around.strip(k, &sheet.normals, hand) else { return Ok(flat[k]) };
        let [narrow, wide] = strip.widths;
        let share = strip.sure * below(narrow / wide.max(1e-9), FLATTENED);
        Ok(flat[k] + (strip.middle + strip.across_flat * strip.offset - flat[k]) * share)
    };
    (0..flat.len()).into_par_iter().with_min_len(POINTS_PER_TASK).map(moved).collect()
}

/// The sheet's points, followed by those that widen its thin strips.
///
/// # Errors
/// When it is cancelled.
pub fn widened(
    sheet: &SheetSides,
    flat: &[Point2<f64>],
    depth: &Depth,
    cancel: &dyn Cancel,
) -> Result<SheetPoints, Cancelled> {
    let mut points =
        SheetPoints { flat: flat.to_vec(), positions: sheet.medial.positions.clone(), radii: sheet.radii.clone() };
    let around = Around::new(flat, &sheet.medial.positions);
    let hand = handedness(sheet, &around, cancel)?;
    let least_radius = LEAST_RADIUS * median(&sheet.radii);
    let thin = |k: usize| {
        cancel.check()?;
        let radius = sheet.radii[k];
        let strip = around.strip(k, &sheet.normals, hand).filter(|s| s.widths[0] < THIN && s.sure > 0.5);
        let strip = strip.filter(|_| radius >= least_radius);
        let beside = |strip: Strip| {
            let place = |aside: f64| {
                let position = sheet.medial.positions[k] + strip.across * aside;
                let below = depth.at(position);
                (below > LEAST_DEPTH * radius).then(|| (flat[k] + strip.across_flat * aside, position, below))
            };
            ASIDE.map(place)
        };
        Ok(strip.map_or([None; 2], beside))
    };
    let all = (0..flat.len()).into_par_iter().with_min_len(POINTS_PER_TASK);
    let added = all.map(thin).collect::<Result<Vec<_>, _>>()?;
    for (flat, position, radius) in added.into_iter().flatten().flatten() {
        points.flat.push(flat);
        points.positions.push(position);
        points.radii.push(radius);
    }
    Ok(points)
}

/// 1 up to the first bound, 0 from the second on.
fn below(x: f64, [low, high]: [f64; 2]) -> f64 {
    ((high - x) / (high - low)).clamp(0.0, 1.0)
}

fn median(values: &[f64]) -> f64 {
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    sorted.get(sorted.len() / 2).copied().unwrap_or(0.0)
}

/// +1 when u × v of the plane is carried to the sheet's normals, −1 when it is carried to their
/// opposites, told by the parts that cover the plane.
fn handedness(sheet: &SheetSides, around: &Around<'_>, cancel: &dyn Cancel) -> Result<f64, Cancelled> {
    let wide = |k: usize| around.part(k).filter(|part| part.narrow() > NARROW[1]);
    let turn = |k: usize| cancel.check().map(|()| wide(k).map_or(0.0, |part| part.turn(sheet.normals[k])));
    let points = (0..sheet.normals.len()).into_par_iter().with_min_len(POINTS_PER_TASK);
    // Summed in the order of the points, not in that of the threads.
    let turns: Vec<f64> = points.map(turn).collect::<Result<_, _>>()?;
    Ok(if turns.into_iter().sum::<f64>() < 0.0 { -1.0 } else { 1.0 })
}

/// Search for the part of the sheet around a point.
struct Around<'a> {
    flat: &'a [Point2<f64>],
    positions: &'a [Point3<f64>],
    cells: Cells,
}

/// First and second moments of a part of the sheet, from one of its points.
struct Part {
    members: Vec<(usize, f64)>,
    mean_flat: Vector2<f64>,
    mean: Vector3<f64>,
    flat: Matrix2<f64>,
    space: Matrix3<f64>,
    /// Covariance of position (rows) and plane (columns).
    both: Matrix3x2<f64>,
}

impl<'a> Around<'a> {
    fn new(flat: &'a [Point2<f64>], positions: &'a [Point3<f64>]) -> Self {
        Self { flat, positions, cells: Cells::new(flat, REACH) }
    }

    fn part(&self, k: usize) -> Option<Part> {
        let at = self.flat[k];
        let weight = |j: usize| {
            let share = (self.flat[j] - at).norm() / REACH;
            let is_near = share < 1.0 && (self.positions[j] - self.positions[k]).norm() < STRETCH * REACH;
            is_near.then_some((j, 1.0 - share * share))
        };
        let members: Vec<(usize, f64)> = self.cells.around(at, REACH).filter_map(weight).collect();
        (members.len() >= MIN_POINTS).then(|| self.moments(k, members))
    }

    fn moments(&self, k: usize, members: Vec<(usize, f64)>) -> Part {
        let total: f64 = members.iter().map(|m| m.1).sum();
        let of = |j: usize| (self.flat[j] - self.flat[k], self.positions[j] - self.positions[k]);
        let (mut mean_flat, mut mean) = (Vector2::zeros(), Vector3::zeros());
        for &(j, w) in &members {
            let (p, x) = of(j);
            mean_flat += p * (w / total);
            mean += x * (w / total);
        }
        let (mut flat, mut space, mut both) = (Matrix2::zeros(), Matrix3::zeros(), Matrix3x2::zeros());
        for &(j, w) in &members {
            let (p, x) = of(j);
            let (p, x) = (p - mean_flat, x - mean);
            flat += p * p.transpose() * (w / total);
            space += x * x.transpose() * (w / total);
            both += x * p.transpose() * (w / total);
        }
        Part { members, mean_flat, mean, flat, space, both }
    }

    /// The strip at a point; `None` where the sheet covers the plane or no direction is certain.
    fn strip(&self, k: usize, normals: &[Vector3<f64>], hand: f64) -> Option<Strip> {
        let part = self.part(k)?;
        let narrow = part.narrow();
        if narrow >= NARROW[1] {
            return None;
        }
        let along_flat = part.along();
        let length = along_flat.dot(&(part.flat * along_flat));
        // The slope of the position along the strip: 1, where the plane keeps lengths.
        let slope = part.both * along_flat / length.max(1e-9);
        let along = slope.try_normalize(1e-6)?;
        let uneven = slope.norm().max(1.0 / slope.norm());
        let sum: Vector3<f64> = part.members.iter().map(|&(j, w)| normals[j] * w).sum();
        let normal = part.normal(along, sum).try_normalize(1e-6)?;
        let across = normal.cross(&along) * hand;
        let across_flat = Vector2::new(-along_flat.y, along_flat.x);
        let spread = |direction: Vector3<f64>| direction.dot(&(part.space * direction)).max(0.0).sqrt();
        let (wide, thick) = (spread(across), spread(normal));
        // What is thinner than a voxel is no second part.
        let sure =
            below(narrow, NARROW) * below(wide, WIDE) * below(thick / wide.max(1.0), THICK) * below(uneven, UNEVEN);
        // The middle beside the point: the means, carried along the strip.
        let back = -part.mean.dot(&along);
        let step = back / spread(along).powi(2).max(1e-9);
        let middle = self.flat[k] + part.mean_flat + part.both.transpose() * along * step;
        let offset = -across.dot(&(part.mean + part.space * along * step));
        Some(Strip { across_flat, across, widths: [narrow, wide], middle, offset, sure })
    }
}

impl Part {
    /// Standard deviation across in the plane.
    fn narrow(&self) -> f64 {
        SymmetricEigen::new(self.flat).eigenvalues.min().max(0.0).sqrt()
    }

    /// Unit direction of the largest spread in the plane.
    fn along(&self) -> Vector2<f64> {
        let eigen = SymmetricEigen::new(self.flat);
        eigen.eigenvectors.column(eigen.eigenvalues.imax()).into_owned()
    }

    /// The sheet's normal at right angles to the strip: from the points, where they span a plane,
    /// else the mean of the points' own, whose sense it has.
    fn normal(&self, along: Vector3<f64>, mean: Vector3<f64>) -> Vector3<f64> {
        let mean = mean - along * mean.dot(&along);
        let beside = Matrix3::identity() - along * along.transpose();
        let eigen = SymmetricEigen::new(beside * self.space * beside);
        let mut order = [0, 1, 2];
        // Along the strip nothing is left; the order is along, normal, across.
        order.sort_by(|&a, &b| eigen.eigenvalues[a].total_cmp(&eigen.eigenvalues[b]));
        let spread = |k: usize| eigen.eigenvalues[order[k]].max(0.0).sqrt();
        let across = eigen.eigenvectors.column(order[2]).into_owned();
        let normal = along.cross(&across);
        if spread(1) > FLATNESS * spread(2) || spread(2) < FLATNESS {
            return mean;
        }
        if normal.dot(&mean) < 0.0 { -normal } else { normal }
    }

    /// Which way, and how surely, the plane is turned in space: the cosine between `normal` and the
    /// normal of the linear fit.
    fn turn(&self, normal: Vector3<f64>) -> f64 {
        let Some(inverse) = self.flat.try_inverse() else { return 0.0 };
        let slopes = self.both * inverse;
        let own = slopes.column(0).cross(&slopes.column(1));
        own.try_normalize(1e-9).map_or(0.0, |n| n.dot(&normal))
    }
}
