//! Step 4: sheets without which the others still account for the object.

use std::collections::BTreeMap;

use super::inscribed::Inscribed;
use super::sizes;
use crate::cancel::{Cancel, Cancelled};
use crate::params::Prune;
use crate::pipeline::medial::MedialSurface;
use crate::pipeline::solid::depth::Depth;

/// Share of the object's volume that would be lost without a sheet, for it to stay (`auto`). Below it, sheets of noise
/// and edges stay; above it, small branches that are part of a shape go.
const AUTO_LOSS: f64 = 0.03;

/// Sheets above which they are pruned a quarter at a time: what is lost is looked at anew for all of them after each. Organs
/// have up to a dozen; a mask of noise has hundreds.
const MANY: usize = 32;

/// What a sheet needs to be kept.
#[derive(Clone, Copy)]
pub(super) struct Needed {
    /// Share of the volume that would be lost without it.
    pub loss: f64,
    /// To be one of so many.
    pub most: usize,
}

/// Share of the object's volume that would be lost without a sheet, for it to be kept.
#[must_use]
pub fn loss_needed(prune: Prune) -> f64 {
    match prune {
        Prune::Auto => AUTO_LOSS,
        Prune::Strength(s) => s * s / (1.0 - s * s),
    }
}

/// The strength of pruning that is used. A sheet needs a loss of s²/(1 − s²): none at 0, more than
/// any sheet has at 1 (a loss is no true share: arms that stand far out lose more than the whole).
#[must_use]
pub fn strength(prune: Prune) -> f64 {
    match prune {
        Prune::Auto => (AUTO_LOSS / (1.0 + AUTO_LOSS)).sqrt(),
        Prune::Strength(strength) => strength,
    }
}

/// The sheets to prune next: the one whose loss is the smallest, of many a quarter, as far as that is less than is needed or
/// there are too many. None when all have evidence, or one is left.
pub(super) fn weakest(
    surface: &MedialSurface,
    depth: &Depth,
    label: &[u32],
    needed: Needed,
    cancel: &dyn Cancel,
) -> Result<Vec<u32>, Cancelled> {
    let count = sizes(label).len();
    if count < 2 {
        return Ok(Vec::new());
    }
    let mut by_loss: Vec<(u32, f64)> = losses(surface, depth, label, cancel)?.into_iter().collect();
    // Of equals the last, which came last.
    by_loss.sort_by(|a, b| a.1.total_cmp(&b.1).then(b.0.cmp(&a.0)));
    by_loss.truncate(if count > MANY { count / 4 } else { 1 });
    let excess = count.saturating_sub(needed.most);
    let mut weak = Vec::new();
    for (n, (sheet, loss)) in by_loss.into_iter().enumerate() {
        if n < excess || loss < needed.loss {
            weak.push(sheet);
        }
    }
    Ok(weak)
}

/// For each sheet, the share of the object's volume that sticks out of the balls of all other
/// sheets: the height of every skin point of the sheet above them, summed.
fn losses(
    surface: &MedialSurface,
    depth: &Depth,
    label: &[u32],
    cancel: &dyn Cancel,
) -> Result<BTreeMap<u32, f64>, Cancelled> {
    // A skin point stands for the face of a working voxel.
    let face = depth.voxels_per_unit.powi(-2);
    let volume = depth.volume();
    let balls = Inscribed::by_sheets(surface, label, cancel)?;
    let mut losses = BTreeMap::new();
    for (sheet, skin) in skin_of_sheets(&balls, depth, label, cancel)? {
        let heights = balls.heights_without(sheet, depth, &skin, cancel)?;
        losses.insert(sheet, face * heights.into_iter().sum::<f64>() / volume.max(1e-9));
    }
    Ok(losses)
}

/// The skin points of each sheet: those that a ball of it comes nearest to.
fn skin_of_sheets(
    balls: &Inscribed,
    depth: &Depth,
    label: &[u32],
    cancel: &dyn Cancel,
) -> Result<BTreeMap<u32, Vec<usize>>, Cancelled> {
    let mut skin_of = BTreeMap::new();
    for sheet in sizes(label).into_keys() {
        skin_of.insert(sheet, Vec::new());
    }
    let owners = balls.of_skin(depth, cancel)?;
    for (s, owner) in owners.into_iter().enumerate() {
        if let Some((p, _)) = owner {
            skin_of.entry(label[p]).or_default().push(s);
        }
    }
    Ok(skin_of)
}
