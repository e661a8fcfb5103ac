//! The rim of a sheet: how far it goes on beyond, or ends before, the outline of its voxels.
//!
//! Where the inscribed ball touches the boundary straight ahead, the sheet ends (Blum; Giblin,
//! Kimia, PAMI 26, 2004: the rim is where both feet meet in the crest). From a place well inside
//! we walk outward along the sheet by the gap between the distance straight ahead and the radius,
//! until there is none.

use nalgebra::{Matrix3, Point2, Point3, SymmetricEigen, Vector2, Vector3};

use crate::numerics::field::floor_index;

use crate::cancel::{Cancel, Cancelled};
use crate::pipeline::lattice::map::{Node, SpaceFromPlane};
use crate::pipeline::plane::region::Region;
use crate::pipeline::plane::strip::SheetPoints;
use crate::pipeline::solid::Solid;
use crate::pipeline::solid::depth::Depth;

/// How far inside of the outline the walk starts, voxels: where fits are sound.
const START: f64 = 2.0;
/// Gap at which the ball counts as touching straight ahead, voxels: what the boundary is known to.
const TOUCHING: f64 = 0.4;
/// Step of the walk, voxels.
const STEP: f64 = 0.25;
/// How far the rim may lie from the outline of the voxels, voxels.
const REACH: f64 = 3.0;
/// Distance of the places along the outline that are looked at, voxels.
const PITCH: f64 = 1.0;
/// Standard deviation of the smoothing along the outline, voxels.
const SIGMA: f64 = 3.0;

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
    let outline = evenly(&region.outline());
    if outline.len() < 8 {
        return Ok(whole);
    }
    let [x, y] = [0, 1].map(|axis| smoothed(&outline.iter().map(|p| p[axis]).collect::<Vec<f64>>()));
    let outline: Vec<Point2<f64>> = x.into_iter().zip(y).map(|(x, y)| Point2::new(x, y)).collect();
    let outward: Vec<Vector2<f64>> = (0..outline.len()).map(|k| outward(&outline, k)).collect();
    let map = SpaceFromPlane::new(&points.flat, &points.positions, &points.radii);
    let walks: Vec<Walk> = outline
        .iter()
        .zip(&outward)
        .map(|(q, o)| {
            cancel.check()?;
            let start = map.node(q - o * START);
            let met = Walk::to_hinge(&start, *o, hinge, depth);
            Ok(met.unwrap_or_else(|| Walk::to_rim(&start, *o, solid, depth)))
        })
        .collect::<Result<_, _>>()?;
    let shifts = smoothed(&walks.iter().map(|w| w.length - START).collect::<Vec<f64>>());
    let moved: Vec<Point2<f64>> =
        outline.iter().zip(outward.iter().zip(&shifts)).map(|(q, (o, s))| q + o * *s).collect();
    whole.region = region.reshaped(&moved);
    for ((q, o), walk) in outline.iter().zip(&outward).zip(&walks) {
        // Points of the sheet's own go as far as the outline.
        let mut walked = START;
        while walked <= walk.length + STEP {
            whole.points.flat.push(q + o * (walked - START));
            whole.points.positions.push(walk.from + walk.direction * walked);
            whole.points.radii.push(walk.radius(walked, depth));
            walked += PITCH;
        }
    }
    Ok(whole)
}

/// Points at equal distances along a closed curve, [`PITCH`] apart.
fn evenly(curve: &[Point2<f64>]) -> Vec<Point2<f64>> {
    let edge = |k: usize| (curve[k], curve[(k + 1) % curve.len()]);
    let length: f64 = (0..curve.len()).map(|k| (edge(k).1 - edge(k).0).norm()).sum();
    let count = floor_index((length / PITCH).round()).max(1);
    let (mut points, mut reached) = (Vec::with_capacity(count), 0.0);
    for k in 0..curve.len() {
        let (a, b) = edge(k);
        let step = (b - a).norm();
        while points.len() < count && points.len() as f64 * length / count as f64 <= reached + step {
            let t = (points.len() as f64 * length / count as f64 - reached) / step.max(1e-12);
            points.push(a + (b - a) * t);
        }
        reached += step;
    }
    points
}

/// Unit outward normal of a counter-clockwise curve.
fn outward(curve: &[Point2<f64>], k: usize) -> Vector2<f64> {
    /// Points to either side that the tangent is taken between.
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
struct Walk {
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
    /// To where other sheets are met, if that is on the way.
    fn to_hinge(node: &Node, outward: Vector2<f64>, hinge: &[Point3<f64>], depth: &Depth) -> Option<Self> {
        /// How far to the side of the way points of the hinge still count, voxels.
        const ASIDE: f64 = 2.5;
        /// Cosine between the way and the hinge above which the way leads along it: 30°.
        const ALONG: f64 = 0.85;
        /// Radius in which the direction of the hinge is taken, voxels.
        const LOCAL: f64 = 6.0;
        let direction = ahead_of(node, outward);
        let (mut sum, mut count) = (Vector3::zeros(), 0.0);
        for h in hinge {
            let v = h - node.position;
            let along = v.dot(&direction);
            if along > -1.0 && along < START + REACH && (v - direction * along).norm() < ASIDE {
                sum += v;
                count += 1.0;
            }
        }
        if count == 0.0 {
            return None;
        }
        let way = sum / count;
        let near = hinge.iter().map(|h| h - node.position - way).filter(|v| v.norm() < LOCAL);
        let spread: Matrix3<f64> = near.map(|v| v * v.transpose()).sum();
        let eigen = SymmetricEigen::new(spread);
        if eigen.eigenvectors.column(eigen.eigenvalues.imax()).dot(&direction).abs() > ALONG {
            return None;
        }
        let length = way.dot(&direction);
        if length <= 0.0 {
            return None;
        }
        let met = depth.at(node.position + way);
        Some(Self { from: node.position, direction: way / length, radius: node.value, ahead: met + length, length })
    }

    /// To the rim.
    fn to_rim(node: &Node, outward: Vector2<f64>, solid: &Solid, depth: &Depth) -> Self {
        let direction = ahead_of(node, outward);
        let reach = node.value + 2.0 * (START + REACH);
        let ahead = solid.level.first_zero(node.position, direction, reach).unwrap_or(reach);
        let mut walk = Self { from: node.position, direction, radius: node.value, ahead, length: 0.0 };
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
        self.ahead - self.length - depth.at(self.from + self.direction * self.length)
    }

    /// Whether the boundary comes nearer as fast as one walks: beyond the rim of a round end, where the
    /// staircase around keeps the gap from closing.
    fn is_past_rim(&self, depth: &Depth) -> bool {
        /// Length over which that is looked at, voxels, and the share of it that counts as all.
        const WINDOW: (f64, f64) = (1.0, 0.8);
        let depth_at = |walked: f64| depth.at(self.from + self.direction * walked);
        depth_at(self.length) - depth_at(self.length + WINDOW.0) > WINDOW.0 * WINDOW.1
    }

    /// Radius on the way: that of the rim is what is left ahead of it. The depth itself is too
    /// small near the rim, where the nearest of many points of the staircase counts.
    fn radius(&self, walked: f64, depth: &Depth) -> f64 {
        let share = walked / self.length.max(1e-6);
        let linear = self.radius + (self.ahead - self.length - self.radius) * share.min(1.0);
        linear.max(depth.at(self.from + self.direction * walked))
    }
}

/// Gaussian mean along the closed outline.
fn smoothed(values: &[f64]) -> Vec<f64> {
    let sigma = SIGMA / PITCH;
    let reach = floor_index((3.0 * sigma).ceil());
    let weights: Vec<f64> = (0..=reach).map(|d| (-0.5 * (d as f64 / sigma).powi(2)).exp()).collect();
    let total = weights[0] + 2.0 * weights[1..].iter().sum::<f64>();
    let count = values.len();
    let mean = |k: usize| {
        let pair = |d: usize| values[(k + d) % count] + values[(k + count * (1 + reach) - d) % count];
        (weights[0] * values[k] + (1..=reach).map(|d| weights[d] * pair(d)).sum::<f64>()) / total
    };
    (0..count).map(mean).collect()
}
