//! Wedges of a tube that are turned over are mended.
//!
//! Wall nodes of such wedges go towards the mean of their neighbours, then along the ray from their centre back to the
//! skin; centres towards those beside them. Rounds take in ever wider surroundings; late ones leave wall nodes where they
//! are, inside of the skin, and these are told as shortened. What is best of all rounds is kept.

use nalgebra::{Point3, Vector3};

use super::legality::legality;
use super::wall::{TubeNodes, at_skin};
use crate::cancel::{Cancel, Cancelled};
use crate::model::NodeRepair;
use crate::pipeline::solid::Solid;

/// Rounds at most. Tubes that can be mended are within 20.
const ROUNDS: usize = 60;
/// Rounds after which surroundings grow by one node, up to [`WIDEST`].
const WIDEN_AFTER: usize = 6;
/// See [`WIDEN_AFTER`].
const WIDEST: usize = 3;
/// How far a node goes towards the mean in a round. More overshoots, less takes longer.
const STEP: f64 = 0.6;
/// What a vector may lack to the skin, work units, to reach it: half of what the mask tells of its boundary.
const SHORT: f64 = 0.25;
/// How far a node must be moved to be told, work units.
const MOVED: f64 = 1e-6;

/// What was done to each wall node, and how many corners were bad before.
pub struct Mended {
    /// Of each node.
    pub repaired: Vec<Option<NodeRepair>>,
    /// Before.
    pub folds_before: usize,
}

/// Mends the wedges of a tube.
///
/// # Errors
/// When it is cancelled.
pub fn mended(solid: &Solid, nodes: &mut TubeNodes, cancel: &dyn Cancel) -> Result<Mended, Cancelled> {
    let before = nodes.clone();
    let (mut tried, mut found) = (nodes.clone(), legality(nodes));
    let folds_before = found.folds;
    let mut least = folds_before;
    for round in 0..ROUNDS {
        cancel.check()?;
        if found.folds == 0 {
            break;
        }
        let mut is_bad = vec![false; tried.wall.len()];
        for wedge in &found.wedges {
            for (row, col) in [(0, 0), (0, 1), (1, 0), (1, 1)] {
                let col = (wedge.col + col).min(tried.size.cols - 1);
                is_bad[tried.node(wedge.row + row, col)] = true;
            }
        }
        for _ in 0..(round / WIDEN_AFTER).min(WIDEST) {
            is_bad = widened(&tried, &is_bad);
        }
        move_centres(solid, &mut tried, &is_bad);
        move_wall(solid, &mut tried, &is_bad, round < ROUNDS / 2);
        if tried.is_ring() {
            tried.share_ends();
        }
        found = legality(&tried);
        if found.folds < least {
            least = found.folds;
            *nodes = tried.clone();
        }
    }
    Ok(Mended { repaired: told(solid, &before, nodes), folds_before })
}

/// The nodes that are marked and those beside them.
fn widened(nodes: &TubeNodes, is_marked: &[bool]) -> Vec<bool> {
    let mut wide = is_marked.to_vec();
    for row in 0..nodes.size.rows {
        for col in 0..nodes.size.cols {
            if is_marked[nodes.node(row, col)] {
                for n in beside(nodes, row, col) {
                    wide[n] = true;
                }
            }
        }
    }
    wide
}

/// The nodes beside one: two around, and one or two along.
fn beside(nodes: &TubeNodes, row: usize, col: usize) -> [usize; 4] {
    let TubeNodes { size, .. } = nodes;
    [
        nodes.node(row + 1, col),
        nodes.node(row + size.rows - 1, col),
        nodes.node(row, col.saturating_sub(1)),
        nodes.node(row, (col + 1).min(size.cols - 1)),
    ]
}

/// Moves centres of columns with marked nodes, but for those of caps, towards the middle of those beside them.
fn move_centres(solid: &Solid, nodes: &mut TubeNodes, is_bad: &[bool]) {
    let old = nodes.centres.clone();
    let [first, last] = nodes.caps;
    for col in first + 1..(nodes.size.cols - last).saturating_sub(1) {
        if (0..nodes.size.rows).any(|row| is_bad[nodes.node(row, col)]) {
            let middle = nalgebra::center(&old[col - 1], &old[col + 1]);
            let moved = nalgebra::center(&old[col], &middle);
            if solid.level.at(moved) > 0.0 {
                nodes.centres[col] = moved;
            }
        }
    }
}

/// Moves marked wall nodes towards the mean of their neighbours, and on to the skin.
fn move_wall(solid: &Solid, nodes: &mut TubeNodes, is_bad: &[bool], is_to_skin: bool) {
    let old = nodes.wall.clone();
    for row in 0..nodes.size.rows {
        for col in 0..nodes.size.cols {
            let node = nodes.node(row, col);
            if !is_bad[node] {
                continue;
            }
            let mut mean = Vector3::zeros();
            for n in beside(nodes, row, col) {
                mean += old[n].coords / 4.0;
            }
            let target = Point3::from(old[node].coords * (1.0 - STEP) + mean * STEP);
            let centre = nodes.centres[col];
            let Some(out) = (target - centre).try_normalize(1e-9) else { continue };
            let skin = at_skin(solid, centre, out);
            let is_beyond = (target - centre).norm() > (skin - centre).norm();
            nodes.wall[node] = if is_to_skin || is_beyond { skin } else { target };
        }
    }
}

/// What was done to each wall node.
fn told(solid: &Solid, before: &TubeNodes, nodes: &TubeNodes) -> Vec<Option<NodeRepair>> {
    let mut repaired = Vec::with_capacity(nodes.wall.len());
    for (node, at) in nodes.wall.iter().enumerate() {
        let centre = nodes.centres[node % nodes.size.cols];
        let vector = at - centre;
        let was_moved =
            (at - before.wall[node]).norm() > MOVED || (centre - before.centres[node % nodes.size.cols]).norm() > MOVED;
        let lacks = vector.try_normalize(1e-9).map_or(0.0, |out| (at_skin(solid, centre, out) - at).dot(&out));
        repaired.push(match was_moved {
            true if lacks > SHORT => Some(NodeRepair::Shortened),
            true => Some(NodeRepair::Turned),
            false => None,
        });
    }
    repaired
}
