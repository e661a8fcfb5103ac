//! The round of the rim: between the spokes of an edge node and its crest vector more vectors are fanned out, to the skin
//! or to where the share of another sheet begins ([`shares`](super::shares)).
//!
//! 1. Between a spoke and the crest vector directions are taken at equal angles, and each is followed to its end.
//! 2. Where that turns a prism over, the points there are drawn back towards those that divide the straight way from the
//!    surface node to the crest point evenly: a wedge that is not turned over is not when it is divided like that.

use std::collections::BTreeSet;

use nalgebra::Point3;

use super::shares::Share;
use crate::cancel::{Cancel, Cancelled};
use crate::model::{FLANK, Flanks, Links, Side, ring};
use crate::pipeline::solid::level::Level;
use crate::pipeline::vectors::Nodes;
use crate::pipeline::vectors::legality::{Part, legality};

/// How far from its node a vector of the fan may end, in lengths of the longer of the spokes and the crest vector, and
/// what is added in voxels. With less, corners of flat ends are cut off; with more, vectors run along thin parts.
const REACH: (f64, f64) = (1.5, 2.0);
/// Rounds in which points are drawn back, and to what share of their way: after them they lie on the straight arc. With
/// fewer they are drawn back further than they need be.
const ROUNDS: usize = 12;
/// See [`ROUNDS`].
const BACK: f64 = 0.8;

/// Carries the points of all arcs from the straight arc on to the skin.
///
/// # Errors
/// When it is cancelled.
pub fn round_rim(nodes: &mut Nodes, level: &Level, share: Share<'_>, cancel: &dyn Cancel) -> Result<(), Cancelled> {
    let (edge, links) = (ring(nodes.size), nodes.links());
    nodes.straighten_arcs();
    let straight = nodes.flanks.clone();
    let mut whole = straight.clone();
    for (place, &node) in edge.iter().enumerate() {
        cancel.check()?;
        let reach = reach(nodes, place, node);
        for (half, skin) in whole[place].iter_mut().zip([nodes.upper[node], nodes.lower[node]]) {
            let fan = Fan { from: nodes.medial[node], spoke: skin, crest: nodes.crest[place] };
            for (k, point) in half.iter_mut().enumerate() {
                *point = fan.end(level, k, reach, share).unwrap_or(*point);
            }
        }
    }
    for place in 0..edge.len() {
        whole[place] = whole[links.own_place(place)];
    }
    let mut parts = vec![[1.0; 2]; edge.len()];
    for round in 0..ROUNDS + edge.len() {
        cancel.check()?;
        nodes.flanks = between(&straight, &whole, &parts);
        let mut is_done = true;
        for (place, side) in turned_over(nodes, &edge, links) {
            let part = &mut parts[place][side];
            is_done &= *part == 0.0;
            *part *= if round < ROUNDS { BACK } else { 0.0 };
            let part = *part;
            if let Some(twin) = links.twin_place(place) {
                parts[twin][side] = part;
            }
        }
        if is_done {
            break;
        }
    }
    Ok(())
}

/// How far from an edge node the vectors of its fan may end.
fn reach(nodes: &Nodes, place: usize, node: usize) -> f64 {
    let mut longest = 0.0f64;
    for end in [nodes.upper[node], nodes.crest[place], nodes.lower[node]] {
        longest = longest.max((end - nodes.medial[node]).norm());
    }
    REACH.0 * longest + REACH.1
}

/// The fan of an edge node between one of its spokes and its crest vector.
struct Fan {
    from: Point3<f64>,
    /// Where the spoke ends.
    spoke: Point3<f64>,
    /// Where the crest vector ends.
    crest: Point3<f64>,
}

impl Fan {
    /// Where the `k`th vector, from the spoke on, meets the skin, or the share of another sheet beyond the straight way from
    /// end to end; the first goes on along that share. `None` where it meets neither, and where the fan has no angle.
    fn end(&self, level: &Level, k: usize, reach: f64, share: Share<'_>) -> Option<Point3<f64>> {
        /// Sine of a fan's angle, or of what it lacks to a half turn, below which it has none: directions between would
        /// be those of rounding errors.
        const LEAST_SINE: f64 = 1e-3;
        let (spoke, crest) = (self.spoke - self.from, self.crest - self.from);
        let angle = spoke.angle(&crest);
        if angle.sin() < LEAST_SINE {
            return None;
        }
        let (part, is_first) = ((k + 1) as f64 / (FLANK + 1) as f64, k == 0);
        let (inner, outer) = (((1.0 - part) * angle).sin(), (part * angle).sin());
        let (a, b) = (spoke.norm(), crest.norm());
        let direction = (spoke * (inner / a) + crest * (outer / b)).normalize();
        let straight = a * b * angle.sin() / (a * outer + b * inner);
        let length = level.first_zero(self.from, direction, reach)?;
        if length <= straight {
            return Some(self.from + direction * length);
        }
        let own = share.own_length(self.from, direction, [straight, length]);
        let end = self.from + direction * own;
        Some(if own < length && is_first { self.raised(level, end, reach, share) } else { end })
    }

    /// A point at the share of another sheet, carried on along the spoke: up to the skin between the two.
    fn raised(&self, level: &Level, point: Point3<f64>, reach: f64, share: Share<'_>) -> Point3<f64> {
        let along = (self.spoke - self.from).normalize();
        let height = level.first_zero(point, along, reach).unwrap_or(0.0);
        point + along * share.own_length(point, along, [0.0, height])
    }
}

/// Arcs a part of the way from straight ones to whole ones; the part of each half.
fn between(straight: &[Flanks], whole: &[Flanks], parts: &[[f64; 2]]) -> Vec<Flanks> {
    let mut arcs = straight.to_vec();
    for (place, halves) in arcs.iter_mut().enumerate() {
        for (side, half) in halves.iter_mut().enumerate() {
            for (point, to) in half.iter_mut().zip(whole[place][side]) {
                *point += (to - *point) * parts[place][side];
            }
        }
    }
    arcs
}

/// Halves of arcs, by own place and side, at wedges that are turned over.
fn turned_over(nodes: &Nodes, edge: &[usize], links: Links) -> BTreeSet<(usize, usize)> {
    let mut bad = BTreeSet::new();
    for illegal in legality(nodes.into()).parts {
        if illegal.part == Part::Wedge {
            let node = illegal.place.i * nodes.size.cols + illegal.place.j;
            let here = edge.iter().position(|&n| n == node).unwrap_or(0);
            let side = usize::from(illegal.place.side == Side::Lower);
            bad.extend([here, (here + 1) % edge.len()].map(|place| (links.own_place(place), side)));
        }
    }
    bad
}
