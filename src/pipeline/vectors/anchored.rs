//! Stage 7, `anchored`: the medial lattice alone is laid out; its nodes are carried to both sides
//! along the spokes.
//!
//! With the sheet m and the radius R smooth, the ball at m touches the boundary at
//! m − R∇R ± R√(1 − |∇R|²) n (Blum; Damon, *Smoothness and geometry of boundaries associated to
//! skeletal structures*, 2003). We walk that way to the sub-voxel boundary.

use std::collections::BTreeSet;

use nalgebra::{Point2, Point3, Vector3};

use super::crest::{Ahead, crest, look_ahead};
use super::nodes::Nodes;
use super::repair::{Spread, mend_crest};
use crate::cancel::{Cancel, Cancelled};
use crate::model::{Repair, ring};
use crate::pipeline::lattice::Lattice;
use crate::pipeline::lattice::map::{Node, SpaceFromPlane};
use crate::pipeline::lattice::rim::WholeSheet;
use crate::pipeline::sheets::sides::SheetSides;
use crate::pipeline::solid::Solid;
use crate::pipeline::solid::depth::Depth;

/// Slope of the radius at most: at 1 both spokes lie in the sheet.
const MAX_SLOPE: f64 = 0.95;

/// Rounds of turning the spokes of the edge until the crest is legal too.
const CREST_ROUNDS: usize = 12;

/// Nodes of the sheet's lattice and where their spokes end.
///
/// # Errors
/// When it is cancelled.
pub fn anchored(
    solid: &Solid,
    depth: &Depth,
    sheet: &SheetSides,
    whole: &WholeSheet,
    mut lattice: Lattice,
    cancel: &dyn Cancel,
) -> Result<(Nodes, Repair), Cancelled> {
    let map = SpaceFromPlane::new(&whole.points.flat, &whole.points.positions, &whole.points.radii).over_holes();
    let medial = map.nodes(&lattice.nodes, cancel)?;
    let hand = upper_sign(&lattice, &medial, &map, sheet, cancel)?;
    let spoke = |n: &Node| {
        cancel.check()?;
        Ok(spoke_directions(n, hand).map(|d| aimed(solid, depth, n, d)))
    };
    let mut spokes: Vec<[Vector3<f64>; 2]> = medial.iter().map(spoke).collect::<Result<_, _>>()?;
    let ahead = look_ahead(&lattice, &map, &sheet.hinge);
    for (n, ahead) in ring(lattice.size).into_iter().zip(&ahead).filter(|(_, a)| !a.is_hinge) {
        spokes[n] = spokes[n].map(|direction| fanned(&medial[n], direction, ahead));
    }
    let directions = [0, 1].map(|side| spokes.iter().map(|s| s[side]).collect::<Vec<_>>());
    let length = |node: &Node, direction: Vector3<f64>| length(solid, node, direction);
    let lengths_of = |side: usize| {
        let length_of = |n: usize| cancel.check().map(|()| length(&medial[n], spokes[n][side]));
        (0..medial.len()).map(length_of).collect::<Result<Vec<f64>, _>>()
    };
    let lengths = [lengths_of(0)?, lengths_of(1)?];
    let node_at = |p: Point2<f64>| map.node(p);
    let radius_at = |p: Point3<f64>| depth.at(p);
    let mut spread = Spread {
        size: lattice.size,
        flat: std::mem::take(&mut lattice.nodes),
        medial,
        directions,
        lengths,
        node_at: &node_at,
        radius_at: &radius_at,
        length: &length,
        // Columns run along u, rows along v: the normal of (i, j) is that of (v, u).
        hand: -hand,
        touched: BTreeSet::new(),
        cancel,
    };
    let folds_before = spread.repair()?;
    let mut round = 0;
    let (nodes, crest) = loop {
        lattice.nodes.clone_from(&spread.flat);
        let crest = crest(&solid.level, lattice.size, &spread.medial, &look_ahead(&lattice, &map, &sheet.hinge));
        let mut nodes = spread.nodes(crest, lattice.valid.clone());
        let reach_of = |from, direction, reach| solid.level.first_zero(from, direction, reach);
        let mended = mend_crest(&mut nodes, reach_of, cancel)?;
        if mended.left.is_empty() || round == CREST_ROUNDS {
            break (nodes, mended);
        }
        // Spokes that cross along the edge, where cells are still legal.
        spread.calm(&mended.left, round >= CREST_ROUNDS / 2);
        spread.repair()?;
        round += 1;
    };
    let moved_nodes = spread.touched.union(&crest.touched).count();
    let mut short = crest.cut;
    for n in 0..nodes.medial.len() {
        cancel.check()?;
        if (0..2).any(|side| falls_short(solid, &spread, n, side)) {
            short.insert(n);
        }
    }
    let repair = Repair { folds_before, moved_nodes, shortened_nodes: short.len() };
    Ok((nodes, repair))
}

/// Whether a spoke ends before the boundary, because it was cut or never meets it.
fn falls_short(solid: &Solid, spread: &Spread<'_>, n: usize, side: usize) -> bool {
    /// Share of a length that rounding may take.
    const ROUNDING: f64 = 1e-6;
    let (node, length) = (&spread.medial[n], spread.lengths[side][n]);
    let whole = solid.level.first_zero(node.position, spread.directions[side][n], reach(node));
    whole.is_none_or(|whole| length < whole * (1.0 - ROUNDING))
}

/// +1 when the normals of the nodes' tangents point to the upper side, else −1.
fn upper_sign(
    lattice: &Lattice,
    medial: &[Node],
    map: &SpaceFromPlane<'_>,
    sheet: &SheetSides,
    cancel: &dyn Cancel,
) -> Result<f64, Cancelled> {
    let agree = |(p, node): (&nalgebra::Point2<f64>, &Node)| {
        let normal = node.tangents[0].cross(&node.tangents[1]).normalize();
        cancel.check()?;
        Ok(sheet.normals.get(map.nearest(*p).0).map_or(0.0, |n| normal.dot(n)))
    };
    let agreement = lattice.nodes.iter().zip(medial).map(agree).sum::<Result<f64, _>>()?;
    Ok(if agreement < 0.0 { -1.0 } else { 1.0 })
}

/// Unit directions of the upper and the lower spoke.
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

/// The direction of an edge node's spoke, turned towards the crest where the sheet ends abruptly. At a
/// round end the spokes of the rim fan out from one side to the other; a node near it stands for
/// them, and takes the one half way to the crest. Further from the rim it keeps its own.
fn fanned(node: &Node, direction: Vector3<f64>, ahead: &Ahead) -> Vector3<f64> {
    /// Distances to the rim, in radii, up to which a node stands for the fan, and from which on it
    /// does not.
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

/// A spoke's direction, or that of the foot itself when the spoke passes it by: at a concave edge, which
/// a spoke a few degrees off misses.
fn aimed(solid: &Solid, depth: &Depth, node: &Node, direction: Vector3<f64>) -> Vector3<f64> {
    /// Length in radii, and what is added in voxels, above which a spoke has missed its foot.
    const MISSED: (f64, f64) = (1.3, 1.0);
    /// Cosine between the spoke and the foot at the least: 60°.
    const SAME_SIDE: f64 = 0.5;
    if length(solid, node, direction) <= MISSED.0 * node.value + MISSED.1 {
        return direction;
    }
    let ways = depth.skin.iter().map(|s| s.position - node.position);
    let ahead = ways.filter(|w| w.dot(&direction) > SAME_SIDE * w.norm());
    let foot = ahead.min_by(|a, b| a.norm_squared().total_cmp(&b.norm_squared()));
    foot.and_then(|f| f.try_normalize(1e-9)).unwrap_or(direction)
}

/// Length of a spoke to the sub-voxel boundary, voxels.
fn length(solid: &Solid, node: &Node, direction: Vector3<f64>) -> f64 {
    solid.level.first_zero(node.position, direction, reach(node)).unwrap_or(reach(node))
}

/// How far from a node the boundary is looked for, voxels.
fn reach(node: &Node) -> f64 {
    3.0 * node.value.max(1.0) + 4.0
}
