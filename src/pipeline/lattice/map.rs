//! The map from the plane back to space: a local quadratic fit (moving least squares), so that the staircase of
//! the voxels does not reach the mesh.

use nalgebra::{Matrix2, Matrix3x2, Point2, Point3, SVector, SymmetricEigen, Vector3};

use crate::cancel::{Cancel, Cancelled};
use crate::numerics::cells::Cells;
use crate::numerics::fit::{LocalFit, quadratic};
use crate::numerics::parallel::each;
use crate::pipeline::plane::strip::SheetPoints;

/// Radius of the local fits, voxels. Below 3 the staircase shows: with 2.5, 532 nodes of 74 organs and shapes are
/// repaired, not 328. Above 6 bends of small radius are flattened: with 10, medial nodes lie twice as far from the
/// middle.
const FIT_RADIUS: f64 = 5.0;
/// How far from its nearest point a fit may be read, voxels. The rim of a sheet lies up to one voxel beyond its
/// outermost points. With 1, a wedge of a substantia nigra laid out as in the paper is turned over, and little else
/// changes; with 4 or 6, nothing does.
const OVERREACH: f64 = 2.0;
/// Radius of the fit of the slope of the values, in values: the radius of a medial sheet changes over
/// lengths of the radius itself, and what changes faster is the staircase. With 0.5, a hippocampus has 9 folded corners
/// before repair, not 3; with 4 little changes.
const SLOPE_RADII: f64 = 1.5;
/// The same at most, voxels. With 6, masks of two putamina and of a thalamus lie 5 to 8 % further from the model; with
/// 24, four of 75 organs and shapes change by more than 0.001 in overlap, a bladder by 0.014, and a slope takes four
/// times as long.
const MAX_SLOPE_RADIUS: f64 = 12.0;
/// Radius of a fit in a hole, in radii of the hole: points all around must count. The holes of 75 organs and shapes are
/// too small to tell: from 0 to 2 one changes, a thalamus, by less than 0.0005 in overlap; with 4 twelve, by 0.001 at
/// most.
const HOLE_RADII: f64 = 2.0;

/// Bounds of a plane's stretch, in space over the plane, by which fits in a plane that does not keep lengths are made
/// narrower or wider. Without, when fits are as wide in the plane everywhere, a kidney of 14 × 24 nodes has 5 of them cut
/// short, not 2, and 28 pairs of triangles that run through each other, not 1. Bowls of up to 150° shrink to 0.7 and are
/// stretched by 3 at their rims, 1.4 and 0.33 here: beyond, a first fit is rough.
const STRETCHES: [f64; 2] = [0.4, 2.5];

/// Nodes that one thread takes at a time; fewer are not worth handing over.
const NODES_PER_TASK: usize = 64;

/// The map from the plane back to space: position and one more value of every point.
pub struct SpaceFromPlane<'a> {
    flat: &'a [Point2<f64>],
    positions: &'a [Point3<f64>],
    values: &'a [f64],
    cells: Cells,
    overreach: f64,
    /// Whether the plane keeps lengths, so that those of fits can be measured in it.
    keeps_lengths: bool,
}

/// A node brought back to space.
#[derive(Clone, Copy, Debug)]
pub struct Node {
    /// Position, voxels of work space.
    pub position: Point3<f64>,
    /// Derivative of the position along u and v.
    pub tangents: [Vector3<f64>; 2],
    /// The value carried along.
    pub value: f64,
    /// Derivative of the value along u and v.
    pub slopes: [f64; 2],
}

impl<'a> SpaceFromPlane<'a> {
    /// From the points' plane coordinates, positions and a value each (may be empty: then 0).
    #[must_use]
    pub fn new(flat: &'a [Point2<f64>], positions: &'a [Point3<f64>], values: &'a [f64]) -> Self {
        Self { flat, positions, values, cells: Cells::new(flat, FIT_RADIUS), overreach: OVERREACH, keeps_lengths: true }
    }

    /// Of the points of a sheet, with their radii. In a plane that shrinks and stretches, fits reach as far as elsewhere in
    /// space.
    #[must_use]
    pub fn of(points: &'a SheetPoints) -> Self {
        let map = Self::new(&points.flat, &points.positions, &points.radii);
        Self { keeps_lengths: !points.is_unrolled, ..map }
    }

    /// The map of points that reach up to the rim: a place far from all of them lies in a hole, and is
    /// read from what is around it.
    #[must_use]
    pub(crate) fn over_holes(self) -> Self {
        Self { overreach: f64::INFINITY, ..self }
    }

    /// The point of space at `p`. Fits are read no further than `OVERREACH` from the points they
    /// were made of: beyond, they say nothing, and the nearest point stands for the place.
    #[must_use]
    pub fn node(&self, p: Point2<f64>) -> Node {
        self.read(p, true)
    }

    /// [`Self::node`] of some places, with the slopes of the value as its small fit has them: for where they do not count.
    ///
    /// # Errors
    /// When it is cancelled.
    pub(super) fn rough_nodes(&self, places: &[Point2<f64>], cancel: &dyn Cancel) -> Result<Vec<Node>, Cancelled> {
        each(places, NODES_PER_TASK, |p| self.read(*p, false), cancel)
    }

    /// The node at `p`; its slopes from a fit of their own if they count.
    fn read(&self, p: Point2<f64>, slopes_count: bool) -> Node {
        let (nearest, gap) = self.nearest(p);
        let (at, gap) = if gap <= self.overreach { (p, gap) } else { (self.flat[nearest], 0.0) };
        let mut radius = FIT_RADIUS.max(HOLE_RADII * gap);
        let metric = self.metric(at, radius);
        // Twice doubled, a radius reaches 20 voxels: with fewer than six points there, there is no sheet.
        for _ in 0..3 {
            if let Some(fit) = self.fit(at, radius, &metric) {
                let mut node = as_node(&fit);
                let wide = (SLOPE_RADII * node.value).min(MAX_SLOPE_RADIUS);
                if slopes_count
                    && wide > radius
                    && let Some(fit) = self.fit(at, wide, &metric)
                {
                    node.slopes = [fit.du[3], fit.dv[3]];
                }
                return node;
            }
            radius *= 2.0;
        }
        self.bare(nearest)
    }

    /// The linear map of the plane after which lengths round a place are those in space, as a first fit tells them.
    fn metric(&self, at: Point2<f64>, radius: f64) -> Matrix2<f64> {
        if self.keeps_lengths {
            return Matrix2::identity();
        }
        let Some(fit) = self.fit(at, radius, &Matrix2::identity()) else { return Matrix2::identity() };
        let tangents = Matrix3x2::from_columns(&[of_space(&fit.du), of_space(&fit.dv)]);
        let eigen = SymmetricEigen::new(tangents.transpose() * tangents);
        let [least, most] = STRETCHES;
        let roots = eigen.eigenvalues.map(|value| value.max(0.0).sqrt().clamp(least, most));
        eigen.eigenvectors * Matrix2::from_diagonal(&roots) * eigen.eigenvectors.transpose()
    }

    /// The position of the nearest of the points, by their positions, that are accepted.
    pub fn nearest_where(&self, p: Point2<f64>, accept: impl Fn(Point3<f64>) -> bool) -> Option<Point3<f64>> {
        self.nearest_of(p, |k| accept(self.positions[k])).map(|(k, _)| self.positions[k])
    }

    /// [`Self::node`] of some places.
    ///
    /// # Errors
    /// When it is cancelled.
    pub fn nodes(&self, places: &[Point2<f64>], cancel: &dyn Cancel) -> Result<Vec<Node>, Cancelled> {
        let mut nodes = Vec::with_capacity(places.len());
        for p in places {
            cancel.check()?;
            nodes.push(self.node(*p));
        }
        Ok(nodes)
    }

    /// The point nearest to `p`, and how far it is.
    #[must_use]
    pub fn nearest(&self, p: Point2<f64>) -> (usize, f64) {
        self.nearest_of(p, |_| true).unwrap_or((0, f64::INFINITY))
    }

    /// The nearest of the points, by their numbers, that are accepted: looked for in ever larger circles.
    fn nearest_of(&self, p: Point2<f64>, accept: impl Fn(usize) -> bool) -> Option<(usize, f64)> {
        /// Doublings of the circle, to 64 times that of a fit; few places are so far from all points.
        const DOUBLINGS: usize = 6;
        let mut radius = FIT_RADIUS;
        for _ in 0..=DOUBLINGS {
            let near = self.nearest_among(self.cells.around(p, radius).filter(|k| accept(*k)), p);
            // Beyond the radius, the cells may hold one and miss a nearer one.
            if near.is_some_and(|(_, distance)| distance <= radius) {
                return near;
            }
            radius *= 2.0;
        }
        self.nearest_among((0..self.flat.len()).filter(|k| accept(*k)), p)
    }

    fn nearest_among(&self, points: impl Iterator<Item = usize>, p: Point2<f64>) -> Option<(usize, f64)> {
        let mut best: Option<(usize, f64)> = None;
        for k in points {
            let distance = (self.flat[k] - p).norm();
            if best.is_none_or(|(_, least)| distance < least) {
                best = Some((k, distance));
            }
        }
        best
    }

    /// A fit to the points no further from a place than a radius, by lengths after a linear map of the plane.
    fn fit(&self, p: Point2<f64>, radius: f64, metric: &Matrix2<f64>) -> Option<LocalFit<4>> {
        if self.keeps_lengths {
            return quadratic(p, radius, self.cells.around(p, radius).map(|k| self.sample(k)));
        }
        let least = metric.singular_values().min().max(STRETCHES[0]);
        let samples = self.cells.around(p, radius / least).map(|k| {
            let (place, value) = self.sample(k);
            (p + metric * (place - p), value)
        });
        let fit = quadratic(p, radius, samples)?;
        // Slopes along the plane's own axes: the metric is symmetric.
        let along = |axis: usize| fit.du * metric[(0, axis)] + fit.dv * metric[(1, axis)];
        Some(LocalFit { value: fit.value, du: along(0), dv: along(1) })
    }

    /// A point's place in the plane, and what the map brings back: its position and its value.
    fn sample(&self, k: usize) -> (Point2<f64>, SVector<f64, 4>) {
        let x = self.positions[k];
        (self.flat[k], SVector::from([x.x, x.y, x.z, self.value(k)]))
    }

    fn value(&self, k: usize) -> f64 {
        self.values.get(k).copied().unwrap_or(0.0)
    }

    fn bare(&self, k: usize) -> Node {
        let tangents = [Vector3::x(), Vector3::y()];
        Node { position: self.positions[k], tangents, value: self.value(k), slopes: [0.0; 2] }
    }
}

/// The first three of four values.
fn of_space(v: &SVector<f64, 4>) -> Vector3<f64> {
    Vector3::new(v[0], v[1], v[2])
}

fn as_node(fit: &LocalFit<4>) -> Node {
    Node {
        position: Point3::from(of_space(&fit.value)),
        tangents: [of_space(&fit.du), of_space(&fit.dv)],
        value: fit.value[3],
        slopes: [fit.du[3], fit.dv[3]],
    }
}
