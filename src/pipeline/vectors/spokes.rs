//! The spokes of a sheet's nodes: where the inscribed ball at each touches the boundary on either side.
//!
//! With the sheet m and the radius R smooth, the ball at m touches the boundary at
//! m − R∇R ± R√(1 − |∇R|²) n (Blum; Damon, *Smoothness and geometry of boundaries associated to
//! skeletal structures*, 2003).

use nalgebra::{Point2, Point3, Vector3};

use super::crest::Ahead;
use super::spoked_lattice::{Surroundings, reach};
use crate::cancel::{Cancel, Cancelled};
use crate::model::{LatticeSize, ring};
use crate::pipeline::lattice::map::{Node, SpaceFromPlane};
use crate::pipeline::sides::SheetSides;
use crate::pipeline::solid::Solid;
use crate::pipeline::solid::depth::Depth;

/// Slope of the radius at most: at 1 both spokes lie in the sheet. Nothing hangs on it but where the fit of the radius is
/// rough: with 0.8 or 0.99 the overlap with the mask changes by 0.002.
const MAX_SLOPE: f64 = 0.95;

/// A sheet in its solid.
pub struct Body<'a> {
    /// The solid.
    pub solid: &'a Solid,
    /// Its skin and depth.
    pub depth: &'a Depth,
    /// The sheet.
    pub map: SpaceFromPlane<'a>,
}

impl Surroundings for Body<'_> {
    fn node(&self, place: Point2<f64>) -> Node {
        self.map.node(place)
    }

    fn radius(&self, place: Point3<f64>) -> f64 {
        self.depth.at(place)
    }

    fn boundary(&self, node: &Node, direction: Vector3<f64>) -> Option<f64> {
        self.solid.level.first_zero(node.position, direction, reach(node))
    }
}

impl Body<'_> {
    /// Unit directions of the upper and of the lower spokes of nodes. `hand`: that of [`upper_sign`].
    ///
    /// # Errors
    /// When it is cancelled.
    pub fn spokes(&self, medial: &[Node], hand: f64, cancel: &dyn Cancel) -> Result<[Vec<Vector3<f64>>; 2], Cancelled> {
        let mut spokes = [Vec::with_capacity(medial.len()), Vec::with_capacity(medial.len())];
        for node in medial {
            cancel.check()?;
            let [upper, lower] = spoke_directions(node, hand);
            spokes[0].push(self.aimed(node, upper));
            spokes[1].push(self.aimed(node, lower));
        }
        Ok(spokes)
    }

    /// A spoke's direction, or that of the foot itself when the spoke passes it by: at a concave edge, which
    /// a spoke a few degrees off misses.
    fn aimed(&self, node: &Node, direction: Vector3<f64>) -> Vector3<f64> {
        /// Length in radii, and what is added in voxels, above which a spoke has missed its foot. At 1.1 radii spokes are
        /// turned that only lean, and a fifth more nodes have to be mended; at 3 there is one node more to cut short
        /// where four sheets meet at right angles.
        const MISSED: (f64, f64) = (1.3, 1.0);
        /// Cosine between the spoke and the foot at the least: 60°. Any foot between 37° and 78° does as well on scans.
        const SAME_SIDE: f64 = 0.5;
        if self.length(node, direction) <= MISSED.0 * node.value + MISSED.1 {
            return direction;
        }
        let (mut foot, mut least) = (Vector3::zeros(), f64::INFINITY);
        for skin in &self.depth.skin {
            let way = skin.position - node.position;
            if way.dot(&direction) > SAME_SIDE * way.norm() && way.norm_squared() < least {
                (foot, least) = (way, way.norm_squared());
            }
        }
        foot.try_normalize(1e-9).unwrap_or(direction)
    }
}

/// +1 when the normals of the nodes' tangents point to the upper side, else −1. `places`: the nodes in the plane.
///
/// # Errors
/// When it is cancelled.
pub fn upper_sign(
    places: &[Point2<f64>],
    medial: &[Node],
    map: &SpaceFromPlane<'_>,
    sheet: &SheetSides,
    cancel: &dyn Cancel,
) -> Result<f64, Cancelled> {
    let mut agreement = 0.0;
    for (place, node) in places.iter().zip(medial) {
        cancel.check()?;
        let normal = node.tangents[0].cross(&node.tangents[1]).normalize();
        // Points beyond those of the sheet lead to its rim and have no normal.
        if let Some(upward) = sheet.normals.get(map.nearest(*place).0) {
            agreement += normal.dot(upward);
        }
    }
    Ok(if agreement < 0.0 { -1.0 } else { 1.0 })
}

/// Unit directions of the upper and the lower spoke of the formula above.
fn spoke_directions(node: &Node, sign: f64) -> [Vector3<f64>; 2] {
    let [pu, pv] = node.tangents;
    let normal = pu.cross(&pv).try_normalize(1e-9).unwrap_or_else(Vector3::z) * sign;
    let (g11, g12, g22) = (pu.norm_squared(), pu.dot(&pv), pv.norm_squared());
    let det = (g11 * g22 - g12 * g12).max(1e-9);
    let [ru, rv] = node.slopes;
    let gradient = pu * ((g22 * ru - g12 * rv) / det) + pv * ((g11 * rv - g12 * ru) / det);
    let slope = gradient.norm();
    let gradient = gradient * (slope.min(MAX_SLOPE) / slope.max(1e-9));
    let height = (1.0 - gradient.norm_squared()).sqrt();
    [normal * height - gradient, -normal * height - gradient]
}

/// Turns the spokes of the edge towards the crest, but for where other sheets are met. `ahead`: what lies ahead of the
/// edge, in the order of [`ring`].
pub fn fan_out(spokes: &mut [Vec<Vector3<f64>>; 2], medial: &[Node], size: LatticeSize, ahead: &[Ahead]) {
    for (n, ahead) in ring(size).into_iter().zip(ahead) {
        if !ahead.is_hinge {
            spokes[0][n] = fanned(&medial[n], spokes[0][n], ahead);
            spokes[1][n] = fanned(&medial[n], spokes[1][n], ahead);
        }
    }
}

/// The direction of an edge node's spoke, turned towards the crest where the sheet ends abruptly. At a
/// round end the spokes of the rim fan out from one side to the other; a node near it stands for
/// them, and takes the one half way to the crest. Further from the rim it keeps its own.
fn fanned(node: &Node, direction: Vector3<f64>, ahead: &Ahead) -> Vector3<f64> {
    /// Distances to the rim, in radii, up to which a node stands for the fan, and from which on it
    /// does not. With 0 for the one, or 0.5 for the other, less of the ends is covered; with 0.5 for the one, or 1.5 for
    /// the other, more is, but with 1.5 spokes lean that are not of the rim, and cross.
    const NEAR: f64 = 0.25;
    const FAR: f64 = 0.75;
    let far = ((ahead.rim - node.position).norm() / node.value.max(1e-6) - NEAR) / (FAR - NEAR);
    let widest = std::f64::consts::FRAC_PI_4 * (1.0 + far.clamp(0.0, 1.0));
    let angle = direction.angle(&ahead.outward);
    let across = (direction - ahead.outward * direction.dot(&ahead.outward)).try_normalize(1e-9);
    match across {
        Some(across) if angle > widest => ahead.outward * widest.cos() + across * widest.sin(),
        _ => direction,
    }
}
