//! The rim of a sheet: how far it goes on beyond, or ends before, the outline of its voxels.
//!
//! Where the inscribed ball touches the boundary straight ahead, the sheet ends (Blum; Giblin,
//! Kimia, PAMI 26, 2004: the rim is where both feet meet in the crest). From a place well inside
//! we walk outward along the sheet by the gap between the distance straight ahead and the radius,
//! until there is none.

use nalgebra::{Matrix3, Point2, Point3, Vector2, Vector3};

use crate::cancel::{Cancel, Cancelled};
use crate::numerics::field::floor_index;
use crate::numerics::moments::Axes3;
use crate::numerics::polyline::Polyline;
use crate::numerics::smooth::gaussian_around;
use crate::pipeline::lattice::map::{Node, SpaceFromPlane};
use crate::pipeline::plane::region::Region;
use crate::pipeline::plane::strip::SheetPoints;
use crate::pipeline::solid::Solid;
use crate::pipeline::solid::depth::Depth;

/// How far inside of the outline the walk starts, voxels: where fits are sound. From 1, a caudate has 9 folded corners
/// before repair, not 4; from 3.5, a spleen has 12, not 6, and medial nodes of a gluteus lie twice as far from the middle.
pub(super) const START: f64 = 2.0;
/// Gap at which the ball counts as touching straight ahead, voxels: what the boundary is known to. With 1, masks lie up to
/// a quarter further from the model and three times as many corners are folded before repair (12 of a caudate, 18 of a
/// spleen); with 0.1, masks lie up to a fifth nearer, but medial nodes of two muscles twice as far from the middle.
const TOUCHING: f64 = 0.4;
/// Step of the walk, voxels. The last one is interpolated: with 1, only a few more corners are folded before repair (6 of a
/// caudate, not 4).
const STEP: f64 = 0.25;
/// How far the rim may lie from the outline of the voxels, voxels. With 1.5, the mask of a spleen lies 1.2 mm from the
/// model on average, not 1.1; with 6 no nearer (that of a caudate does), and 20 of its nodes are repaired, not 14.
const REACH: f64 = 3.0;
/// Distance of the places along the outline that are looked at, voxels. With 3, the farthest 5 % of the mask of a spleen
/// begin 3.9 mm from the model, not 3.6; less only takes longer.
pub(super) const PITCH: f64 = 1.0;
/// Standard deviation of the smoothing along the outline, voxels. With 8, tips are rounded off: the mask of a gluteus lies
/// 0.94 mm from the model on average, not 0.77; with 1, a hippocampus needs 4 nodes repaired, not none.
pub(super) const SIGMA: f64 = 3.0;

/// A sheet in its plane, carried on to its rim. Lengths are voxels.
#[derive(Clone, Debug)]
pub struct WholeSheet {
    /// The region it covers.
    pub region: Region,
    /// Its points, and those on the way to the rim.
    pub points: SheetPoints,
}

/// Carries a sheet on to its rim: moves the outline there and adds points up to it.
///
/// # Errors
/// When it is cancelled.
pub fn to_rim(
    points: &SheetPoints,
    region: &Region,
    hinge: &[Point3<f64>],
    solid: &Solid,
    depth: &Depth,
    cancel: &dyn Cancel,
) -> Result<WholeSheet, Cancelled> {
    let mut whole = WholeSheet { region: region.clone(), points: points.clone() };
    let outline = smooth_outline(region);
    if outline.len() < 8 {
        return Ok(whole);
    }
    let map = SpaceFromPlane::of(points);
    let mut walks = Vec::with_capacity(outline.len());
    for (k, q) in outline.iter().enumerate() {
        cancel.check()?;
        let outward = outward(&outline, k);
        let start = map.node(q - outward * START);
        walks.push(Walk::from(&start, outward, hinge, solid, depth));
    }
    whole.region = region.reshaped(&moved(&outline, &walks));
    for (q, walk) in outline.iter().zip(&walks) {
        whole.add_walk(*q, walk, depth);
    }
    Ok(whole)
}

impl WholeSheet {
    /// Adds the points of a walk that crosses the outline at `q`. Points of the sheet's own go as far as there.
    fn add_walk(&mut self, q: Point2<f64>, walk: &Walk, depth: &Depth) {
        for (walked, position, radius) in walk.points(depth) {
            self.points.flat.push(q + walk.outward * (walked - START));
            self.points.positions.push(position);
            self.points.radii.push(radius);
        }
    }
}

/// The outline of a region without the steps of its voxels, in points [`PITCH`] apart.
fn smooth_outline(region: &Region) -> Vec<Point2<f64>> {
    let points: Vec<Vector2<f64>> = region.outline().iter().map(|p| p.coords).collect();
    if points.is_empty() {
        return Vec::new();
    }
    let line = Polyline::closed(points);
    let points = line.evenly_around(floor_index((line.length() / PITCH).round()).max(1));
    gaussian_around(&points, SIGMA / PITCH).into_iter().map(Point2::from).collect()
}

/// The outline moved to where the walks end, but smooth.
fn moved(outline: &[Point2<f64>], walks: &[Walk]) -> Vec<Point2<f64>> {
    let shifts: Vec<f64> = walks.iter().map(|walk| walk.length - START).collect();
    let shifts = gaussian_around(&shifts, SIGMA / PITCH);
    let mut moved = Vec::with_capacity(outline.len());
    for (k, q) in outline.iter().enumerate() {
        moved.push(q + walks[k].outward * shifts[k]);
    }
    moved
}

/// Unit outward normal of a counter-clockwise curve.
pub(super) fn outward(curve: &[Point2<f64>], k: usize) -> Vector2<f64> {
    /// Points to either side that the tangent is taken between. With 12 it cuts bends: medial nodes of 75 organs and
    /// shapes lie 5 % further from the middle on average, and a part of a spleen 2.3 mm from its mask, not 1.5. From 1
    /// to 6 no more changes than by chance.
    const SPAN: usize = 2;
    let n = curve.len();
    let along = curve[(k + SPAN) % n] - curve[(k + n - SPAN) % n];
    Vector2::new(along.y, -along.x).try_normalize(1e-9).unwrap_or_else(Vector2::x)
}

/// The direction of space that leads outward in the plane.
fn ahead_of(node: &Node, outward: Vector2<f64>) -> Vector3<f64> {
    (node.tangents[0] * outward.x + node.tangents[1] * outward.y).try_normalize(1e-9).unwrap_or_else(Vector3::x)
}

/// A way along the sheet, straight outward to its rim.
pub(super) struct Walk {
    /// Unit direction in the plane.
    outward: Vector2<f64>,
    /// Where it starts, well inside.
    from: Point3<f64>,
    direction: Vector3<f64>,
    /// Radius where it starts.
    radius: f64,
    /// Distance to the boundary straight ahead.
    ahead: f64,
    /// Distance to the rim.
    length: f64,
}

impl Walk {
    /// To where other sheets are met, else to the rim.
    pub fn from(node: &Node, outward: Vector2<f64>, hinge: &[Point3<f64>], solid: &Solid, depth: &Depth) -> Self {
        let met = Self::to_hinge(node, outward, hinge, depth);
        met.unwrap_or_else(|| Self::to_rim(node, outward, solid, depth))
    }

    /// Distance to its end, voxels.
    pub fn length(&self) -> f64 {
        self.length
    }

    /// Places on the way from the outline on: how far they are, where, and with which radius.
    pub fn points(&self, depth: &Depth) -> Vec<(f64, Point3<f64>, f64)> {
        let (mut points, mut walked) = (Vec::new(), START);
        while walked <= self.length + STEP {
            points.push((walked, self.from + self.direction * walked, self.radius(walked, depth)));
            walked += PITCH;
        }
        points
    }

    /// To where other sheets are met, if that is on the way.
    fn to_hinge(node: &Node, outward: Vector2<f64>, hinge: &[Point3<f64>], depth: &Depth) -> Option<Self> {
        let direction = ahead_of(node, outward);
        let way = way_to_hinge(node.position, direction, hinge)?;
        let length = way.dot(&direction);
        if length <= 0.0 || leads_along(hinge, node.position, way, direction) {
            return None;
        }
        let (from, ahead) = (node.position, depth.at(node.position + way) + length);
        Some(Self { outward, from, direction: way / length, radius: node.value, ahead, length })
    }

    /// To the rim.
    fn to_rim(node: &Node, outward: Vector2<f64>, solid: &Solid, depth: &Depth) -> Self {
        let direction = ahead_of(node, outward);
        let reach = node.value + 2.0 * (START + REACH);
        let ahead = solid.level.first_zero(node.position, direction, reach).unwrap_or(reach);
        let mut walk = Self { outward, from: node.position, direction, radius: node.value, ahead, length: 0.0 };
        let mut before = walk.gap(depth);
        while before > TOUCHING && walk.length < START + REACH {
            if before < 2.0 * TOUCHING && walk.is_past_rim(depth) {
                break;
            }
            walk.length += STEP;
            let next = walk.gap(depth);
            if next <= TOUCHING {
                walk.length -= STEP * (TOUCHING - next) / (before - next);
                break;
            }
            before = next;
        }
        walk
    }

    /// Distance to the boundary straight ahead less that to the nearest part of it, at the end.
    fn gap(&self, depth: &Depth) -> f64 {
        self.ahead - self.length - self.depth_at(self.length, depth)
    }

    /// Whether the boundary comes nearer as fast as one walks: beyond the rim of a round end, where the
    /// staircase around keeps the gap from closing.
    fn is_past_rim(&self, depth: &Depth) -> bool {
        /// Length over which that is looked at, voxels, and the share of it that counts as all. With lengths of 0.5 or
        /// 2 no more changes than by chance. With a share of 0.5, walks end early: masks of 75 organs and shapes lie
        /// 4 % further from the model on average, and nearly twice as many corners are folded before repair. With more
        /// than 1 it is never so: masks lie 2 % nearer, but medial nodes 4 % further from the middle.
        const WINDOW: (f64, f64) = (1.0, 0.8);
        let end = self.depth_at(self.length, depth);
        end - self.depth_at(self.length + WINDOW.0, depth) > WINDOW.0 * WINDOW.1
    }

    /// Depth of a place on the way.
    fn depth_at(&self, walked: f64, depth: &Depth) -> f64 {
        depth.at(self.from + self.direction * walked)
    }

    /// Radius on the way: that of the rim is what is left ahead of it. The depth itself is too
    /// small near the rim, where the nearest of many points of the staircase counts.
    fn radius(&self, walked: f64, depth: &Depth) -> f64 {
        let share = walked / self.length.max(1e-6);
        let linear = self.radius + (self.ahead - self.length - self.radius) * share.min(1.0);
        linear.max(self.depth_at(walked, depth))
    }
}

/// The way from a place to the middle of the points of a hinge that a direction leads to; `None` where it leads to none.
fn way_to_hinge(from: Point3<f64>, direction: Vector3<f64>, hinge: &[Point3<f64>]) -> Option<Vector3<f64>> {
    /// How far to the side of the way points of the hinge still count, voxels: neighbouring points of a hinge are up to
    /// 1.7 apart. With less, ways pass between them; with more, ways beside the end of a hinge are bent to it.
    const ASIDE: f64 = 2.5;
    let (mut sum, mut count) = (Vector3::zeros(), 0.0);
    for h in hinge {
        let v = h - from;
        let along = v.dot(&direction);
        if along > -1.0 && along < START + REACH && (v - direction * along).norm() < ASIDE {
            sum += v;
            count += 1.0;
        }
    }
    (count > 0.0).then(|| sum / count)
}

/// Whether a way leads along a hinge and not to it.
fn leads_along(hinge: &[Point3<f64>], from: Point3<f64>, way: Vector3<f64>, direction: Vector3<f64>) -> bool {
    /// Cosine between the way and the hinge above which the way leads along it: 30°. With 0.5, ways that meet a hinge
    /// aslant are not taken: a part of a spleen lies 4.4 mm from its mask on average, not 1.5. With more than 1, when
    /// none leads along, its overlap is 0.903, not 0.909; nothing else changes but by chance.
    const ALONG: f64 = 0.85;
    /// Radius in which the direction of the hinge is taken, voxels. Less shows its steps: with 3, a cross has 8 folded
    /// corners before repair, not none. More shows its bends: with 12, the overlap of a spleen is 0.902, not 0.909.
    const LOCAL: f64 = 6.0;
    let mut spread = Matrix3::zeros();
    for h in hinge {
        let v = h - from - way;
        if v.norm() < LOCAL {
            spread += v * v.transpose();
        }
    }
    Axes3::of(spread).directions[0].dot(&direction).abs() > ALONG
}
