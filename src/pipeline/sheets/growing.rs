//! Step 2: sheets from linked points, and the rest of the points to the sheets they lie between.

use std::collections::BTreeSet;

use super::links::{is_linked, is_sure, steps_from_jumps};
use super::{NO_SHEET, sizes};
use crate::cancel::{Cancel, Cancelled};
use crate::numerics::field::id;
use crate::numerics::flood::{flood, pieces};
use crate::pipeline::medial::MedialSurface;

/// Points that a sheet of its own needs; fewer cannot carry a lattice. More would give small branches to
/// their neighbours before it is known what would be lost without them.
const MIN_POINTS: usize = 16;
/// Half the width of a bridge between two sheets, steps along the surface. With fewer, sheets hang together by it;
/// with more, sheets that are themselves as narrow are found in the second round only, joined or not.
const BRIDGE_STEPS: usize = 3;

/// Sheets of linked sure points. Where a branch starts, the foot jumps by next to nothing, and two
/// sheets hang together by a bridge there: sheets are told apart a few steps away from all jumps,
/// and get back what lies between. Then those too narrow for that are found, whatever their size.
pub(super) fn linked_components(surface: &MedialSurface, cancel: &dyn Cancel) -> Result<Vec<u32>, Cancelled> {
    let from_jump = steps_from_jumps(surface, BRIDGE_STEPS, cancel)?;
    let mut label = vec![NO_SHEET; surface.points.len()];
    let mut count = 0;
    for bridge in [BRIDGE_STEPS, 0] {
        let is_core = |p: u32| from_jump[p as usize] >= bridge && is_sure(surface, p);
        for start in 0..id(label.len()) {
            if label[start as usize] != NO_SHEET || !is_core(start) {
                continue;
            }
            label[start as usize] = count;
            let enters = |from, to| is_core(to) && is_linked(surface, from, to);
            let piece = spread(surface, &mut label, vec![start], enters, cancel)?;
            if bridge == 0 || piece.len() >= MIN_POINTS {
                count += 1;
                continue;
            }
            for p in piece {
                label[p as usize] = NO_SHEET;
            }
        }
        let enters = |from, to| is_sure(surface, to) && is_linked(surface, from, to);
        let starts = labelled(&label);
        spread(surface, &mut label, starts, enters, cancel)?;
    }
    Ok(label)
}

/// Points without a sheet of their own go to the nearest sheet along the surface, if they lie
/// between sheets or belong to one beyond doubt. The rest are edges and bumps of the boundary.
pub(super) fn hand_over_rest(surface: &MedialSurface, label: &mut [u32], cancel: &dyn Cancel) -> Result<(), Cancelled> {
    let sizes = sizes(label);
    for sheet in label.iter_mut() {
        if *sheet != NO_SHEET && sizes[sheet] < MIN_POINTS {
            *sheet = NO_SHEET;
        }
    }
    let is_between = between_sheets(surface, label, cancel)?;
    let enters = |_, to| is_between[to as usize] || is_sure(surface, to);
    let starts = labelled(label);
    spread(surface, label, starts, enters, cancel)?;
    Ok(())
}

/// Gives points without a sheet to the one that reaches them in the fewest steps, from some of its points on; those
/// that `enters(from, to)` lets in. Returns all that were reached, the starts first.
fn spread(
    surface: &MedialSurface,
    label: &mut [u32],
    starts: Vec<u32>,
    enters: impl Fn(u32, u32) -> bool,
    cancel: &dyn Cancel,
) -> Result<Vec<u32>, Cancelled> {
    let enter = |from: u32, to: u32| {
        let is_new = label[to as usize] == NO_SHEET && enters(from, to);
        if is_new {
            label[to as usize] = label[from as usize];
        }
        is_new
    };
    flood(&surface.adjacency, starts, enter, cancel)
}

/// Points that have a sheet, ascending.
fn labelled(label: &[u32]) -> Vec<u32> {
    let mut points = Vec::new();
    for (p, &sheet) in (0..).zip(label) {
        if sheet != NO_SHEET {
            points.push(p);
        }
    }
    points
}

/// Points in a piece without a label that touches two labels or more.
fn between_sheets(surface: &MedialSurface, label: &[u32], cancel: &dyn Cancel) -> Result<Vec<bool>, Cancelled> {
    let mut is_between = vec![false; label.len()];
    for piece in pieces(&surface.adjacency, |p| label[p as usize] == NO_SHEET, cancel)? {
        let mut touched = BTreeSet::new();
        for &p in &piece {
            for &n in &surface.adjacency[p as usize] {
                touched.insert(label[n as usize]);
            }
        }
        touched.remove(&NO_SHEET);
        for p in piece {
            is_between[p as usize] = touched.len() > 1;
        }
    }
    Ok(is_between)
}
