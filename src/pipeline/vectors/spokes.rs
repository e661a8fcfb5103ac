//! The spokes of a sheet's nodes: where the inscribed ball at each touches the boundary on either side.
//!
//! With the sheet m and the radius R smooth, the ball at m touches the boundary at
//! m − R∇R ± R√(1 − |∇R|²) n (Blum; Damon, *Smoothness and geometry of boundaries associated to
//! skeletal structures*, 2003).

use nalgebra::{Point2, Point3, Vector3};

use std::sync::OnceLock;

use super::spoked_lattice::{Surroundings, longest, reach};
use crate::cancel::{Cancel, Cancelled};
use crate::numerics::points::Points;
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
    /// The skin, to be searched: made when the first spoke misses its foot.
    skin: OnceLock<Points>,
}

impl<'a> Body<'a> {
    /// A sheet in its solid.
    #[must_use]
    pub fn new(solid: &'a Solid, depth: &'a Depth, map: SpaceFromPlane<'a>) -> Self {
        Self { solid, depth, map, skin: OnceLock::new() }
    }
}

impl Surroundings for Body<'_> {
    /// That of the map; where the fit leads out of the solid, as over a hole or at a thin edge, drawn back to the sheet.
    fn node(&self, place: Point2<f64>) -> Node {
        /// Halvings of the way back: after them the node is on the sheet's point.
        const HALVINGS: usize = 4;
        let mut node = self.map.node(place);
        if self.solid.level.at(node.position) > 0.0 {
            return node;
        }
        let own = self.point_inside(place).unwrap_or(node.position);
        for round in 1..=HALVINGS {
            let way = node.position - own;
            node.position = if round < HALVINGS { own + way / 2.0 } else { own };
            if self.solid.level.at(node.position) > 0.0 {
                break;
            }
        }
        node.value = self.radius(node.position);
        node
    }

    fn is_well_inside(&self, place: Point3<f64>, on_sheet: Point3<f64>) -> bool {
        /// Share of the depth on the sheet. With less, nodes come to lie under the skin, and a vector to the other side is
        /// as long as the organ is thick; with 1 they may not be moved off the sheet at all.
        const LEAST_SHARE: f64 = 0.5;
        self.solid.level.at(place) > 0.0 && self.radius(place) >= LEAST_SHARE * self.radius(on_sheet)
    }

    fn radius(&self, place: Point3<f64>) -> f64 {
        self.depth.at(place)
    }

    fn boundary(&self, node: &Node, direction: Vector3<f64>) -> Option<f64> {
        self.solid.level.first_zero(node.position, direction, reach(node))
    }
}

impl Body<'_> {
    /// The point of the sheet nearest to a place in the plane that lies inside of the solid.
    fn point_inside(&self, place: Point2<f64>) -> Option<Point3<f64>> {
        self.map.nearest_where(place, |position| self.solid.level.at(position) > 0.0)
    }

    /// Unit directions of the upper and of the lower spokes of nodes. `hand`: that of [`upper_sign`].
    ///
    /// # Errors
    /// When it is cancelled.
    pub fn spokes(&self, medial: &[Node], hand: f64, cancel: &dyn Cancel) -> Result<[Vec<Vector3<f64>>; 2], Cancelled> {
        let mut spokes = [Vec::with_capacity(medial.len()), Vec::with_capacity(medial.len())];
        for node in medial {
            cancel.check()?;
            let [upper, lower] = spoke_directions(node, normal(node) * hand);
            spokes[0].push(upper);
            spokes[1].push(lower);
        }
        Ok(spokes)
    }

    /// Turns spokes that run past their feet to them. `beyond`: of nodes at a hinge the unit direction out of the sheet, on
    /// whose side feet are those of other sheets.
    ///
    /// # Errors
    /// When it is cancelled.
    pub fn aim(
        &self,
        medial: &mut [Node],
        directions: &mut [Vec<Vector3<f64>>; 2],
        (hand, beyond): (f64, &[Vector3<f64>]),
        cancel: &dyn Cancel,
    ) -> Result<(), Cancelled> {
        for (n, node) in medial.iter_mut().enumerate() {
            cancel.check()?;
            if self.misses(node, directions[0][n]) || self.misses(node, directions[1][n]) {
                // Or it is the fit of the radius that is wrong: where other sheets are met it rises within a voxel or two.
                node.value = node.value.max(self.radius(node.position));
            }
            let normal = normal(node) * hand;
            directions[0][n] = self.aimed(node, directions[0][n], [normal, beyond[n]]);
            directions[1][n] = self.aimed(node, directions[1][n], [-normal, beyond[n]]);
        }
        Ok(())
    }

    /// Whether a spoke runs past its foot.
    fn misses(&self, node: &Node, direction: Vector3<f64>) -> bool {
        self.boundary(node, direction).is_none_or(|length| length > longest(node))
    }

    /// A spoke's direction, or that of the foot itself when the spoke passes it by: at a concave edge, which
    /// a spoke a few degrees off misses, and where the sheet ends more bluntly than its radius says. `side`: the sheet's
    /// normal on that side.
    fn aimed(&self, node: &Node, direction: Vector3<f64>, [side, beyond]: [Vector3<f64>; 2]) -> Vector3<f64> {
        /// Cosine to the direction out of the sheet from which on a foot is another sheet's. At 0 the foot straight below a
        /// hinge may be one by noise; at 0.5 those of arms at right angles are not.
        const OTHER: f64 = 0.25;
        if !self.misses(node, direction) {
            return direction;
        }
        let skin =
            self.skin.get_or_init(|| Points::new(&self.depth.skin.iter().map(|s| s.position).collect::<Vec<_>>()));
        let is_own = |_: usize, place: &Point3<f64>| {
            let way = place - node.position;
            way.dot(&side) > 0.0 && way.dot(&beyond) <= OTHER * way.norm()
        };
        let foot = skin.nearest_where(node.position, is_own).map(|foot| self.depth.skin[foot].position - node.position);
        foot.and_then(|foot| foot.try_normalize(1e-9)).unwrap_or(direction)
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

/// Unit normal of the sheet at a node.
fn normal(node: &Node) -> Vector3<f64> {
    node.tangents[0].cross(&node.tangents[1]).try_normalize(1e-9).unwrap_or_else(Vector3::z)
}

/// Unit directions of the upper and the lower spoke of the formula above. `normal`: towards the upper side.
fn spoke_directions(node: &Node, normal: Vector3<f64>) -> [Vector3<f64>; 2] {
    let [pu, pv] = node.tangents;
    let (g11, g12, g22) = (pu.norm_squared(), pu.dot(&pv), pv.norm_squared());
    let det = (g11 * g22 - g12 * g12).max(1e-9);
    let [ru, rv] = node.slopes;
    let gradient = pu * ((g22 * ru - g12 * rv) / det) + pv * ((g11 * rv - g12 * ru) / det);
    let slope = gradient.norm();
    let gradient = gradient * (slope.min(MAX_SLOPE) / slope.max(1e-9));
    let height = (1.0 - gradient.norm_squared()).sqrt();
    [normal * height - gradient, -normal * height - gradient]
}
