//! How far from the middle the medial nodes are.

use nalgebra::Vector3;
use rayon::prelude::*;

use super::skin_search::SkinSearch;
use crate::cancel::{Cancel, Cancelled};
use crate::model::{LatticeSize, MeanAndP95};
use crate::pipeline::tubes::TubeDraft;
use crate::pipeline::vectors::Nodes;

/// How far the medial nodes are from the middle: |a − b| / (a + b), with a and b the distances
/// to the nearest skin on the one and on the other side of the sheet that faces away from it
/// within 60° of its normal: a blunt rim is as near on both sides and says nothing. Zero of a perfect medial sheet, one of
/// a node on the skin or outside. The vectors are not used: they need not be the shortest way.
///
/// The node that is furthest off comes with it.
///
/// # Errors
/// When it is cancelled.
pub fn medial_offset(
    nodes: &Nodes,
    skin: &SkinSearch<'_>,
    cancel: &dyn Cancel,
) -> Result<(MeanAndP95, Option<usize>), Cancelled> {
    /// Nodes looked at; more say nothing new and cost time.
    const MOST: usize = 2000;
    let valid: Vec<usize> = (0..nodes.medial.len()).filter(|&n| nodes.valid[n]).collect();
    let step = valid.len().div_ceil(MOST).max(1);
    let looked_at: Vec<usize> = valid.into_iter().step_by(step).collect();
    let offsets = looked_at.par_iter().map(|&node| offset(nodes, node, skin, cancel));
    let offsets: Vec<f64> = offsets.collect::<Result<_, _>>()?;
    let mut worst: Option<usize> = None;
    for (place, offset) in offsets.iter().enumerate() {
        if worst.is_none_or(|other| *offset > offsets[other]) {
            worst = Some(place);
        }
    }
    Ok((MeanAndP95::of(offsets), worst.map(|place| looked_at[place])))
}

/// How far the centres of a tube are from the middle: what their depth lacks to the largest in their section, as a share of
/// it, over the columns between its caps; and the column that is furthest off. A sheet's |a − b| / (a + b) is the same of
/// its two distances.
#[must_use]
pub fn tube_offset(draft: &TubeDraft) -> (MeanAndP95, Option<usize>) {
    let nodes = &draft.nodes;
    let (mut offsets, mut worst) = (Vec::new(), None);
    for col in nodes.caps[0]..nodes.size.cols - nodes.caps[1] {
        let offset = 1.0 - draft.radii[col] / draft.deepest[col].max(1e-9);
        if worst.is_none_or(|(_, largest)| offset > largest) {
            worst = Some((col, offset));
        }
        offsets.push(offset);
    }
    (MeanAndP95::of(offsets), worst.map(|(col, _)| col))
}

/// That of one node.
fn offset(nodes: &Nodes, node: usize, skin: &SkinSearch<'_>, cancel: &dyn Cancel) -> Result<f64, Cancelled> {
    /// Cosine of 60°, the angle at which skin stops to be crest in the stage of the sides, too. With 0.8 slanted sides
    /// are missed: a bladder fails that did not, its 95th percentile 0.40 and not 0.08. With 0.25 a hippocampus gets a
    /// warning.
    const FACING_COSINE: f64 = 0.5;
    /// Difference of the distances that is none, voxels: neither side is known better than to a quarter of one. With none,
    /// organs two voxels deep are warned of for what their mask does not tell.
    const KNOWN: f64 = 0.5;
    cancel.check()?;
    let at = nodes.medial[node];
    let [up, down] = [nodes.upper[node] - at, nodes.lower[node] - at];
    let normal = normal(nodes, node).unwrap_or(up - down);
    // The surface nodes lie on the skin; the nearest that faces away is not much further off.
    let reach = 2.0 * up.norm().max(down.norm()) + 2.0;
    let mut sides = [f64::INFINITY; 2];
    for skin in skin.within(at, reach) {
        let side = usize::from((skin.position - at).dot(&normal) < 0.0);
        let facing = skin.normal.dot(&normal) / normal.norm() * [1.0, -1.0][side];
        if facing >= FACING_COSINE {
            sides[side] = sides[side].min(skin.distance(at));
        }
    }
    let has_both = sides[0].is_finite() && sides[1].is_finite();
    // Without skin on one of the sides it is on the other.
    let gap = ((sides[0] - sides[1]).abs() - KNOWN).max(0.0);
    Ok(if has_both { gap / (sides[0] + sides[1]).max(1e-12) } else { 1.0 })
}

/// Normal of the medial lattice at a node, of any sign and length.
fn normal(nodes: &Nodes, node: usize) -> Option<Vector3<f64>> {
    let LatticeSize { rows, cols } = nodes.size;
    let (i, j) = (node / cols, node % cols);
    let medial = &nodes.medial;
    let along_i = medial[(i + 1).min(rows - 1) * cols + j] - medial[i.saturating_sub(1) * cols + j];
    let along_j = medial[i * cols + (j + 1).min(cols - 1)] - medial[i * cols + j.saturating_sub(1)];
    let normal = along_i.cross(&along_j);
    (normal.norm() > 1e-9).then_some(normal)
}
