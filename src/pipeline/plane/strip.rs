//! Narrow strips of a sheet, where an organ tapers to a tail.
//!
//! ISOMAP keeps the two directions in which distances vary most over the whole sheet. A strip that
//! bends or twists away from them is laid on a line: its width of a few voxels is lost in the
//! plane, though its points lie side by side in space. [`unfolded`] gives them back their places
//! across the strip. A strip of one voxel's width has none: [`widened`] adds points to either side
//! of it inside the object, so that it covers a part of the plane and fits know the direction
//! across. The rim is found from there on as for any other part of the sheet.

use nalgebra::{Matrix2, Matrix3, Matrix3x2, Point2, Point3, SymmetricEigen, Vector2, Vector3};

use crate::cancel::{Cancel, Cancelled};
use crate::numerics::cells::Cells;
use crate::numerics::moments::{Axes2, Axes3};
use crate::numerics::parallel::{POINTS_PER_TASK, each_number};
use crate::numerics::stats::median;
use crate::pipeline::plane::Flat;
use crate::pipeline::sides::SheetSides;
use crate::pipeline::solid::depth::Depth;

/// Radius in the plane of the part of the sheet that tells whether it is a strip, voxels. What is said of the constants
/// of strips was tried on 75 organs and shapes with 6 × 8 nodes. A change of almost anything by a twentieth moves the
/// overlap of six or eight with their masks by 0.005 or more, up or down: that is called noise. With 1.5 every part is
/// narrow: 14 fail that did not, 11 of them turned over. With 6, a third of a vena cava's surface is left uncovered.
const REACH: f64 = 3.0;
/// How much further apart points of that part may lie in space than in the plane before they are of another part. With
/// 1 there is only noise; with 4, or without it, a bladder is taken for a tube, and with 12 × 20 nodes a hip bone
/// folds.
const STRETCH: f64 = 2.0;
/// Points that such a part needs: fewer span no plane. With 8 there is only noise; with 16 thin tails have no strips:
/// the planes of a duodenum, a bladder, and a pancreas are turned over.
const MIN_POINTS: usize = 3;
/// Standard deviation across, voxels, below which a part is a strip for certain, and above which it is none. Half a
/// disc, as at the rim of a wide sheet, has 0.26 of its radius: 0.8. With half of both, the overlap of a duodenum is
/// 0.48, not 0.78; with twice of both, rims are strips: 13 of 75 fail that did not, 11 of them turned over.
const NARROW: [f64; 2] = [0.7, 1.0];
/// Width in the plane over that in space below which the strip was laid on a line for certain, and above which it was
/// not. With 0, when nothing is unfolded, the planes of a back muscle, a duodenum, a bladder, and a pancreas are turned
/// over on 3 to 5 % of their area; from half to twice of both there is only noise.
const FLATTENED: [f64; 2] = [0.55, 0.8];
/// Standard deviation across in space, voxels, up to which a part is a strip for certain, and from which it is none:
/// strips of 5 and 7 voxels. Wider parts that lie narrow in the plane are bent out of it. With half of both, 3 % of a
/// bladder's plane are turned over, not 1 %; with more, or without it, there is only noise.
const WIDE: [f64; 2] = [1.5, 2.0];
/// Spread along the normal over that across up to which a part is one sheet for certain, and from which it is parts of
/// the sheet one above the other. With half of both a bladder is taken for a tube; with more, or without it, there is
/// only noise.
const THICK: [f64; 2] = [0.5, 0.8];
/// Length in space over that in the plane, or the other way round, up to which the plane keeps lengths along the strip,
/// and from which it does not. With 1.1 and 1.25, 3 % of a bladder's plane are turned over, not 1 %; with 3 and 4, or
/// without it, the spacing of two thalami varies by 0.11 and 0.10, not by 0.09 and 0.08.
const UNEVEN: [f64; 2] = [1.5, 2.0];
/// Standard deviation across, voxels, below which a strip is widened: two rows of voxels have 0.5. With 0, when none
/// is, the overlap of a vena cava is 0.82, not 0.85, and with 12 × 20 nodes 14 of 76 masks lie more than 5 % further
/// from the model, 3 nearer; noise alone makes it 8 and 2 at most. With 1.2, 17 of 75 lie nearer by as much, and 6
/// further.
const THIN: f64 = 0.6;
/// How far across from a strip's points the added ones lie, voxels; the rim is walked to from there. With more at 2
/// voxels, surfaces of a thalamus came to lie 1.1 voxels off instead of 0.3; at 0.5 there is only noise.
const ASIDE: [f64; 2] = [1.0, -1.0];
/// Depth of an added point at the least, as a share of the radius of the point it belongs to. With 0, or without it,
/// five of 75 organs and shapes change, their overlap by 0.003 at most; with 1 there is only noise.
const LEAST_DEPTH: f64 = 0.5;
/// Radius of a point that is widened at the least, as a share of the sheet's median: thinner strips are filaments that
/// run into an edge of the boundary. With none, one of 75 organs and shapes changes, a caudate: 6 corners are folded
/// before repair, not 4. With 0.7 or 1 there is only noise.
const LEAST_RADIUS: f64 = 0.25;
/// Smallest share of the spread across that the spread along the normal may take for the points themselves to tell the
/// normal. With 0.01 they never do: the overlap of a hippocampus is 0.72, not 0.77, and 10 of its nodes are cut short;
/// from 0.15 to 0.6 there is only noise.
const FLATNESS: f64 = 0.3;

/// Points of a sheet in its plane and in space. Lengths are voxels.
#[derive(Clone, Debug, Default)]
pub struct SheetPoints {
    /// Plane coordinates.
    pub flat: Vec<Point2<f64>>,
    /// Positions in work space.
    pub positions: Vec<Point3<f64>>,
    /// Radii.
    pub radii: Vec<f64>,
    /// Whether the plane shrinks and stretches.
    pub is_unrolled: bool,
}

impl SheetPoints {
    /// Those of a sheet.
    #[must_use]
    pub fn of(sheet: &SheetSides, flat: &Flat) -> Self {
        Self {
            flat: flat.points.clone(),
            positions: sheet.medial.positions.clone(),
            radii: sheet.radii.clone(),
            is_unrolled: flat.is_unrolled(),
        }
    }
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
    let strips = Strips::of(sheet, flat, cancel)?;
    each_number(flat.len(), POINTS_PER_TASK, |k| strips.unfolded(k), cancel)
}

/// The sheet's points, followed by those that widen its thin strips.
///
/// # Errors
/// When it is cancelled.
pub fn widened(sheet: &SheetSides, flat: &Flat, depth: &Depth, cancel: &dyn Cancel) -> Result<SheetPoints, Cancelled> {
    let strips = Strips::of(sheet, &flat.points, cancel)?;
    let least_radius = LEAST_RADIUS * median(sheet.radii.clone()).unwrap_or(0.0);
    let added = each_number(flat.points.len(), POINTS_PER_TASK, |k| strips.beside(k, least_radius, depth), cancel)?;
    let mut points = SheetPoints::of(sheet, flat);
    for (flat, position, radius) in added.into_iter().flatten() {
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

/// Search for strips of a sheet.
struct Strips<'a> {
    sheet: &'a SheetSides,
    flat: &'a [Point2<f64>],
    cells: Cells,
    /// +1 when u × v of the plane is carried to the sheet's normals, −1 when it is carried to their
    /// opposites.
    hand: f64,
}

impl<'a> Strips<'a> {
    fn of(sheet: &'a SheetSides, flat: &'a [Point2<f64>], cancel: &dyn Cancel) -> Result<Self, Cancelled> {
        let mut strips = Self { sheet, flat, cells: Cells::new(flat, REACH), hand: 1.0 };
        // Summed in the order of the points, not in that of the threads.
        let turns = each_number(flat.len(), POINTS_PER_TASK, |k| strips.turn(k), cancel)?;
        if turns.into_iter().sum::<f64>() < 0.0 {
            strips.hand = -1.0;
        }
        Ok(strips)
    }

    /// Which way the plane is turned at a point; 0 where the sheet does not cover it.
    fn turn(&self, k: usize) -> f64 {
        match self.part(k) {
            Some(part) if part.narrow() > NARROW[1] => part.turn(self.sheet.normals[k]),
            _ => 0.0,
        }
    }

    /// A point back in its place across, as far as it is sure that a strip was laid on a line.
    fn unfolded(&self, k: usize) -> Point2<f64> {
        let own = self.flat[k];
        let Some(strip) = self.strip(k) else { return own };
        let [narrow, wide] = strip.widths;
        let share = strip.sure * below(narrow / wide.max(1e-9), FLATTENED);
        own + (strip.middle + strip.across_flat * strip.offset - own) * share
    }

    /// The points that widen a thin strip at one of its points: each in the plane, in space, and its radius.
    fn beside(&self, k: usize, least_radius: f64, depth: &Depth) -> Vec<(Point2<f64>, Point3<f64>, f64)> {
        let radius = self.sheet.radii[k];
        let mut added = Vec::new();
        if radius < least_radius {
            return added;
        }
        let Some(strip) = self.strip(k) else { return added };
        if strip.widths[0] >= THIN || strip.sure <= 0.5 {
            return added;
        }
        for aside in ASIDE {
            let position = self.sheet.medial.positions[k] + strip.across * aside;
            let below = depth.at(position);
            if below > LEAST_DEPTH * radius {
                added.push((self.flat[k] + strip.across_flat * aside, position, below));
            }
        }
        added
    }

    /// The part of the sheet around a point.
    fn part(&self, k: usize) -> Option<Part> {
        let positions = &self.sheet.medial.positions;
        let mut members = Vec::new();
        for j in self.cells.around(self.flat[k], REACH) {
            let (flat, space) = (self.flat[j] - self.flat[k], positions[j] - positions[k]);
            let share = flat.norm() / REACH;
            if share < 1.0 && space.norm() < STRETCH * REACH {
                members.push(Member { point: j, weight: 1.0 - share * share, flat, space });
            }
        }
        (members.len() >= MIN_POINTS).then(|| Part::of(members))
    }

    /// The strip at a point; `None` where the sheet covers the plane or no direction is certain.
    fn strip(&self, k: usize) -> Option<Strip> {
        let part = self.part(k)?;
        let narrow = part.narrow();
        if narrow >= NARROW[1] {
            return None;
        }
        let along_flat = part.along();
        let slope = part.slope(along_flat);
        let along = slope.try_normalize(1e-6)?;
        let normal = part.normal(along, &self.sheet.normals).try_normalize(1e-6)?;
        let across = normal.cross(&along) * self.hand;
        let (wide, thick) = (part.spread(across), part.spread(normal));
        let uneven = slope.norm().max(1.0 / slope.norm());
        // What is thinner than a voxel is no second part.
        let sure =
            below(narrow, NARROW) * below(wide, WIDE) * below(thick / wide.max(1.0), THICK) * below(uneven, UNEVEN);
        // The middle beside the point: the means, carried along the strip.
        let back = -part.mean.dot(&along);
        let step = back / part.spread(along).powi(2).max(1e-9);
        let middle = self.flat[k] + part.mean_flat + part.both.transpose() * along * step;
        let offset = -across.dot(&(part.mean + part.space * along * step));
        let across_flat = Vector2::new(-along_flat.y, along_flat.x);
        Some(Strip { across_flat, across, widths: [narrow, wide], middle, offset, sure })
    }
}

/// A point of a part, from the point that the part lies around.
struct Member {
    point: usize,
    weight: f64,
    flat: Vector2<f64>,
    space: Vector3<f64>,
}

/// First and second moments of a part of the sheet, from one of its points.
struct Part {
    members: Vec<Member>,
    mean_flat: Vector2<f64>,
    mean: Vector3<f64>,
    flat: Matrix2<f64>,
    space: Matrix3<f64>,
    /// Covariance of position (rows) and plane (columns).
    both: Matrix3x2<f64>,
}

impl Part {
    fn of(members: Vec<Member>) -> Self {
        let total: f64 = members.iter().map(|member| member.weight).sum();
        let (mut mean_flat, mut mean) = (Vector2::zeros(), Vector3::zeros());
        for member in &members {
            mean_flat += member.flat * (member.weight / total);
            mean += member.space * (member.weight / total);
        }
        let (mut flat, mut space, mut both) = (Matrix2::zeros(), Matrix3::zeros(), Matrix3x2::zeros());
        for member in &members {
            let (p, x, share) = (member.flat - mean_flat, member.space - mean, member.weight / total);
            flat += p * p.transpose() * share;
            space += x * x.transpose() * share;
            both += x * p.transpose() * share;
        }
        Self { members, mean_flat, mean, flat, space, both }
    }

    /// Standard deviation across in the plane.
    fn narrow(&self) -> f64 {
        SymmetricEigen::new(self.flat).eigenvalues.min().max(0.0).sqrt()
    }

    /// Unit direction of the largest spread in the plane.
    fn along(&self) -> Vector2<f64> {
        Axes2::of(self.flat).directions[0]
    }

    /// The slope of the position along a direction of the plane: 1 long, where the plane keeps lengths.
    fn slope(&self, along: Vector2<f64>) -> Vector3<f64> {
        let length = along.dot(&(self.flat * along));
        self.both * along / length.max(1e-9)
    }

    /// Standard deviation along a direction of space.
    fn spread(&self, direction: Vector3<f64>) -> f64 {
        direction.dot(&(self.space * direction)).max(0.0).sqrt()
    }

    /// The sheet's normal at right angles to the strip: from the points, where they span a plane,
    /// else the mean of the points' own, whose sense it has.
    fn normal(&self, along: Vector3<f64>, normals: &[Vector3<f64>]) -> Vector3<f64> {
        let mut sum = Vector3::zeros();
        for member in &self.members {
            sum += normals[member.point] * member.weight;
        }
        let mean = sum - along * sum.dot(&along);
        let beside = Matrix3::identity() - along * along.transpose();
        // Along the strip nothing is left: the axes are across, normal, along.
        let axes = Axes3::of(beside * self.space * beside);
        let [across, normal, _] = axes.values.map(|square| square.max(0.0).sqrt());
        if normal > FLATNESS * across || across < FLATNESS {
            return mean;
        }
        let normal = along.cross(&axes.directions[0]);
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
