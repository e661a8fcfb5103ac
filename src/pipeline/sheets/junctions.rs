//! Where sheets meet.

use std::collections::{BTreeMap, BTreeSet};

use super::{Hinge, NO_SHEET};
use crate::cancel::{Cancel, Cancelled};
use crate::numerics::field::id;
use crate::numerics::flood::{any_within_steps, pieces};
use crate::pipeline::medial::MedialSurface;
use crate::pipeline::surface::picked;

/// Steps along the surface within which sheets meet at one junction: thinning leaves the
/// junction of thick arms up to two voxels wide. With fewer, two of three arms would be taken for one sheet with a
/// step in it; with more, so would not what is one sheet not far from a branch.
const NEAR_STEPS: usize = 4;

/// Which sheets touch, with the points that touch.
pub(super) fn contacts(
    surface: &MedialSurface,
    label: &[u32],
    cancel: &dyn Cancel,
) -> Result<BTreeMap<(u32, u32), BTreeSet<u32>>, Cancelled> {
    let mut contacts: BTreeMap<(u32, u32), BTreeSet<u32>> = BTreeMap::new();
    for (a, list) in surface.adjacency.iter().enumerate() {
        cancel.check()?;
        for &b in list {
            let (la, lb) = (label[a], label[b as usize]);
            if la < lb && lb != NO_SHEET {
                contacts.entry((la, lb)).or_default().extend([id(a), b]);
            }
        }
    }
    Ok(contacts)
}

/// Whether a sheet other than two lies within a few steps along the surface.
pub(super) fn is_third_near(surface: &MedialSurface, label: &[u32], (a, b): (u32, u32), start: u32) -> bool {
    let is_third = |p: u32| ![a, b, NO_SHEET].contains(&label[p as usize]);
    any_within_steps(&surface.adjacency, start, NEAR_STEPS, is_third)
}

/// Connected sets of touching points with the sheets that touch there.
pub(super) fn hinges(surface: &MedialSurface, label: &[u32], cancel: &dyn Cancel) -> Result<Vec<Hinge>, Cancelled> {
    let mut is_touching = vec![false; label.len()];
    for p in contacts(surface, label, cancel)?.into_values().flatten() {
        is_touching[p as usize] = true;
    }
    let mut hinges = Vec::new();
    for mut points in pieces(&surface.adjacency, |p| is_touching[p as usize], cancel)? {
        points.sort_unstable();
        let sheets: BTreeSet<u32> = picked(label, &points).into_iter().collect();
        hinges.push(Hinge { sheets: sheets.into_iter().collect(), points });
    }
    Ok(hinges)
}
