//! Correspondence `anchored`: the medial lattice alone is laid out; its nodes are carried to both sides
//! along the spokes.
//!
//! 1. The nodes of the lattice are brought into space.
//! 2. Each gets two spokes, along which its inscribed ball touches the boundary ([`spokes`](super::spokes)).
//! 3. They are walked to the sub-voxel boundary, and turned until none cross ([`untangle`](super::untangle)).
//! 4. The edge gets its crest ([`crest`](super::rim::crest)), which is turned until no wedge is turned over
//!    ([`mend_crest`](super::rim::mend_crest)); where that fails, the spokes of the edge are drawn towards those around them, and 3 and
//!    4 begin again.
//! 5. What was moved and what ends short of the boundary is counted.

use std::collections::BTreeSet;

use nalgebra::Point3;

use super::nodes::Nodes;
use super::rim::crest::{beyond_hinges, crest, look_ahead};
use super::rim::mend_crest::{Mended, mend_crest};
use super::spoked_lattice::{SpokedLattice, Surroundings, spacing};
use super::spokes::{Body, upper_sign};
use super::untangle::Patience;
use crate::cancel::{Cancel, Cancelled};
use crate::model::{NodeRepair, Repair};
use crate::pipeline::chart::Lattice;
use crate::pipeline::sides::SheetSides;

/// Rounds of turning the spokes of the edge until the crest is legal too; from half of them on its nodes are moved along
/// it, too. On the structures of [`ROUNDS`](super::untangle::ROUNDS) wedges of 13 more stay turned over without any
/// round, of 6 more with 3 rounds or when nothing is moved, of none with 12; 24 mend nothing more.
const CREST_ROUNDS: usize = 12;

/// Rounds of mending the crest of a lattice that may be left for another: what they do not mend, more seldom do.
const FEW_CREST_ROUNDS: usize = 1;

/// Nodes of the sheet's lattice and where their spokes end.
///
/// # Errors
/// When it is cancelled.
pub fn anchored(
    body: &Body<'_>,
    sheet: &SheetSides,
    lattice: Lattice,
    patience: Patience,
    cancel: &dyn Cancel,
) -> Result<(Nodes, Repair), Cancelled> {
    let mut spoked = spoked(body, sheet, lattice, cancel)?;
    let folds_before = spoked.untangle(patience)?;
    let (mut nodes, crest) = with_crest(&mut spoked, body, &sheet.hinge, patience, cancel)?;
    let repair = Repair { folds_before, ..noted(&mut nodes, &spoked, &crest)? };
    Ok((nodes, repair))
}

/// Notes at each node what was done to it, and counts it.
fn noted(nodes: &mut Nodes, spoked: &SpokedLattice<'_>, crest: &Mended) -> Result<Repair, Cancelled> {
    let turned: BTreeSet<usize> = spoked.touched.union(&crest.touched).copied().collect();
    let past_foot = spoked.past_foot()?;
    let shortened: BTreeSet<usize> = spoked.short()?.union(&crest.cut).copied().collect();
    let off_sheet = spoked.off_sheet()?;
    // The worst last: it is what is kept.
    for (done_to, what) in [
        (&turned, NodeRepair::Turned),
        (&past_foot, NodeRepair::PastFoot),
        (&shortened, NodeRepair::Shortened),
        (&off_sheet, NodeRepair::OffSheet),
        (&spoked.merged, NodeRepair::Merged),
    ] {
        for &n in done_to {
            nodes.repaired[n] = Some(what);
        }
    }
    let links = spoked.links();
    let own = || (0..nodes.repaired.len()).filter(|&n| links.own(n) == n);
    let is_marred = |n: &usize| nodes.repaired[*n] >= Some(NodeRepair::Shortened);
    let (count, marred_nodes) = (own().count(), own().filter(is_marred).count());
    for n in 0..nodes.repaired.len() {
        nodes.repaired[n] = nodes.repaired[links.own(n)];
    }
    Ok(Repair {
        nodes: count,
        folds_before: 0,
        moved_nodes: turned.len(),
        past_foot_nodes: past_foot.len(),
        shortened_nodes: shortened.len(),
        off_sheet_nodes: off_sheet.len(),
        merged_nodes: spoked.merged.len(),
        marred_nodes,
    })
}

/// Brings a lattice into space and lays its spokes, up to the boundary.
fn spoked<'a>(
    body: &'a Body<'_>,
    sheet: &SheetSides,
    lattice: Lattice,
    cancel: &'a dyn Cancel,
) -> Result<SpokedLattice<'a>, Cancelled> {
    let mut medial = Vec::with_capacity(lattice.nodes.len());
    for &place in &lattice.nodes {
        cancel.check()?;
        medial.push(body.node(place));
    }
    let hand = upper_sign(&lattice.nodes, &medial, &body.map, sheet, cancel)?;
    let directions = body.spokes(&medial, hand, cancel)?;
    let (count, spacing) = (medial.len(), spacing(lattice.links(), &medial));
    let mut spoked = SpokedLattice {
        lattice,
        medial,
        directions,
        lengths: [vec![0.0; count], vec![0.0; count]],
        // Columns run along u, rows along v: the normal of (i, j) is that of (v, u).
        hand: -hand,
        touched: BTreeSet::new(),
        merged: BTreeSet::new(),
        is_given_up: false,
        spacing,
        around: body,
        cancel,
    };
    spoked.join_twins();
    spoked.make_fair()?;
    let beyond = beyond_hinges(&spoked.lattice, &body.map, &sheet.hinge);
    body.aim(&mut spoked.medial, &mut spoked.directions, (hand, &beyond), cancel)?;
    spoked.join_twins();
    for n in 0..count {
        cancel.check()?;
        spoked.let_reach(0, n);
        spoked.let_reach(1, n);
    }
    Ok(spoked)
}

/// The nodes with their crest, and what was done to it.
fn with_crest(
    spoked: &mut SpokedLattice<'_>,
    body: &Body<'_>,
    hinge: &[Point3<f64>],
    patience: Patience,
    cancel: &dyn Cancel,
) -> Result<(Nodes, Mended), Cancelled> {
    let rounds = if patience == Patience::Whole { CREST_ROUNDS } else { FEW_CREST_ROUNDS };
    let level = &body.solid.level;
    let mut round = 0;
    loop {
        let ahead = look_ahead(&spoked.lattice, &body.map, hinge);
        let mut nodes = spoked.nodes(crest(level, spoked.links(), &spoked.medial, &ahead));
        let mended = mend_crest(&mut nodes, level, cancel)?;
        if mended.left.is_empty() || spoked.is_given_up || round == rounds {
            return Ok((nodes, mended));
        }
        // Spokes that cross along the edge, where cells are still legal.
        if round >= rounds / 2 {
            spoked.even_out(&mended.left);
        }
        spoked.calm(&mended.left);
        spoked.untangle(patience)?;
        round += 1;
    }
}
