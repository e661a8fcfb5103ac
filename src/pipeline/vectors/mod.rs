//! Stage `spokes` (section 4 of the paper): which surface nodes belong to which medial node, and the vectors between
//! them.
//!
//! 1. Nodes are brought into space and paired with those of both sides. With `correspondence: "paper"` nodes of equal
//!    (i, j) on three lattices are paired (`paper`). We leave the paper with `"anchored"`, the default: the nodes of
//!    the medial lattice are carried to both sides along the spokes of its inscribed balls (`anchored`, `spokes`),
//!    because the three lattices stretch differently and vectors between them lean.
//! 2. The three meshes of the paper leave the rim open. Each node of the edge gets a crest point there, and an arc
//!    round the rim from its upper node over that point to its lower node, so that what the vectors fill is closed; where
//!    sheets meet, arcs keep to the share of their own ([`rim`]).
//! 3. The paper's vectors are meant not to cross. We look ([`mod@legality`]), and with `"anchored"` turn those that do
//!    (`spoked_lattice`, `untangle`, `rim`); what crosses whichever way it is turned is cut short (`shorten`).

mod nodes;

mod paper;

mod anchored;

mod spokes;

pub mod legality;

pub mod rim;

mod spoked_lattice;

mod fairing;

mod untangle;

mod shorten;

pub use self::nodes::Nodes;

use self::anchored::anchored;
use self::legality::legality;
use self::paper::paper;
use self::rim::arcs::round_rim;
use self::rim::shares::Share;
use self::spokes::Body;
use self::untangle::Patience;
use crate::cancel::Cancelled;
use crate::model::{LatticeSize, PerSurface, Repair};
use crate::numerics::field::floor_index;
use crate::params::GridChoice;
use crate::pipeline::chart::{Chart, Lattice};
use crate::pipeline::context::Context;
use crate::pipeline::lattice::map::SpaceFromPlane;
use crate::pipeline::lattice::{LEAST_SIZE, Laid};
use crate::pipeline::plane::Flat;
use crate::pipeline::sides::SheetSides;
use crate::pipeline::solid::Solid;
use crate::pipeline::solid::depth::Depth;

/// The nodes of a sheet's lattices in space, and what was repaired.
///
/// # Errors
/// When it is cancelled.
pub fn vectors(
    solid: &Solid,
    depth: &Depth,
    (sheet, share): (&SheetSides, Share<'_>),
    flat: &PerSurface<Flat>,
    laid: Laid,
    context: &Context<'_>,
) -> Result<(Nodes, Repair), Cancelled> {
    match laid {
        Laid::Anchored { whole, chart, lattice } => {
            let map = SpaceFromPlane::of(&whole.points).over_holes();
            let is_bowl = flat.medial.is_unrolled();
            let laying = Laying { body: Body::new(solid, depth, map), sheet, share, chart: &chart, is_bowl, context };
            laying.finest_sound(lattice)
        }
        Laid::Paper(lattices) => {
            let mut nodes = paper(solid, sheet, flat, lattices, context)?;
            round_rim(&mut nodes, &solid.level, share, context)?;
            Ok((nodes, Repair::default()))
        }
    }
}

/// A sheet that lattices are tried on.
struct Laying<'a> {
    body: Body<'a>,
    sheet: &'a SheetSides,
    share: Share<'a>,
    chart: &'a Chart,
    /// Whether the sheet is bent in both directions, so that its rim draws in.
    is_bowl: bool,
    context: &'a Context<'a>,
}

/// A lattice that was tried.
struct Tried {
    lattice: Lattice,
    margin: f64,
    nodes: Nodes,
    repair: Repair,
    spoilt: Spoilt,
}

impl Laying<'_> {
    /// The nodes of a lattice; where its size was left to us and repair spoils some, those of the first of coarser ones, and
    /// then of ones that leave the rim free, of which it spoils none: bends sharper than the nodes are far apart are smoothed
    /// by the former, and what noise makes of a rim is left out by the latter. If there is none, those with the least
    /// spoilt.
    fn finest_sound(&self, lattice: Lattice) -> Result<(Nodes, Repair), Cancelled> {
        let params = self.context.params;
        let is_ours = params.grid == GridChoice::Auto && params.spacing_mm.is_none() && self.context.repeat.is_none();
        if !is_ours {
            return self.repaired(lattice);
        }
        let whole_size = lattice.size;
        let mut best = self.tried(lattice, params.margin())?;
        let tries =
            if self.is_bowl { tries_of_bowl(whole_size, params.margin()) } else { tries(whole_size, params.margin()) };
        for (size, margin) in tries {
            if best.spoilt == Spoilt::default() {
                break;
            }
            let other = self.tried(self.chart.lattice(size, margin, self.context)?, margin)?;
            if other.spoilt < best.spoilt {
                best = other;
            }
        }
        if best.margin > params.margin() {
            let message = format!(
                "{:.0} % of the lattice's extent are left free at its rim, which is too rough",
                100.0 * best.margin
            );
            self.context.warn("rim_left_free", message);
        }
        if best.spoilt == Spoilt::default() { Ok((best.nodes, best.repair)) } else { self.repaired(best.lattice) }
    }

    /// A lattice in space, repaired as far as can be.
    fn repaired(&self, lattice: Lattice) -> Result<(Nodes, Repair), Cancelled> {
        let (mut nodes, repair) = anchored(&self.body, self.sheet, lattice, Patience::Whole, self.context)?;
        round_rim(&mut nodes, &self.body.solid.level, self.share, self.context)?;
        Ok((nodes, repair))
    }

    /// A lattice in space, repaired with little patience.
    fn tried(&self, lattice: Lattice, margin: f64) -> Result<Tried, Cancelled> {
        /// Share of nodes that repair may spoil: one in a hundred is the corner of a lattice.
        const CORNER: f64 = 0.01;
        // A bowl's vectors cross on its inner side: with little patience few of its lattices come through.
        let patience = if self.is_bowl { Patience::Whole } else { Patience::Little };
        let (mut nodes, repair) = anchored(&self.body, self.sheet, lattice.clone(), patience, self.context)?;
        round_rim(&mut nodes, &self.body.solid.level, self.share, self.context)?;
        let illegal = legality((&nodes).into()).parts.len();
        let marred = if repair.marred_share() <= CORNER { 0.0 } else { repair.marred_share() };
        Ok(Tried { lattice, margin, nodes, repair, spoilt: Spoilt { illegal, marred } })
    }
}

/// What is wrong with a lattice after repair, the worse first.
#[derive(Clone, Copy, Debug, Default, PartialEq, PartialOrd)]
struct Spoilt {
    /// Cells and wedges that stay turned over.
    illegal: usize,
    /// Share of the nodes that are spoilt, if it is more than a corner.
    marred: f64,
}

/// Lattices to try after the one of a size: coarser ones, then coarse ones with a margin.
fn tries(size: LatticeSize, margin: f64) -> Vec<(LatticeSize, f64)> {
    /// What a side is multiplied with: from 40 nodes down to 10.
    const COARSER: [f64; 4] = [0.75, 0.5, 0.32, 0.22];
    /// Share of the extent left free, and what the sides are multiplied with then.
    const FREE: [(f64, f64); 3] = [(0.03, 0.6), (0.03, 0.36), (0.06, 0.32)];
    let mut tries: Vec<(LatticeSize, f64)> = Vec::new();
    for share in COARSER {
        let coarse = coarser(size, share);
        if coarse != size && tries.last() != Some(&(coarse, margin)) {
            tries.push((coarse, margin));
        }
    }
    for (free, share) in FREE {
        if free > margin {
            tries.push((coarser(size, share), free));
        }
    }
    tries
}

/// The same over a bowl, whose rim draws in, so that vectors run together there: every size is tried with the rim left
/// free too, before a coarser one. A kidney of 17 × 28 nodes has up to 7 cut short with its rim, 2 without it.
fn tries_of_bowl(size: LatticeSize, margin: f64) -> Vec<(LatticeSize, f64)> {
    /// Share of the extent left free. With 0.02 or 0.04 as many nodes are cut short, and as much is covered.
    const FREE: f64 = 0.03;
    /// What the sides are multiplied with.
    const SHARES: [f64; 5] = [1.0, 0.75, 0.5, 0.32, 0.22];
    let mut tries: Vec<(LatticeSize, f64)> = Vec::new();
    for share in SHARES {
        for free in [margin, FREE.max(margin)] {
            tries.push((coarser(size, share), free));
        }
    }
    // The first is the one that was there before.
    tries.dedup();
    tries.remove(0);
    tries
}

/// A size with fewer nodes, the paper's at the least.
fn coarser(LatticeSize { rows, cols }: LatticeSize, share: f64) -> LatticeSize {
    let fewer = |count: usize, least: usize| floor_index(count as f64 * share).max(least).min(count);
    LatticeSize { rows: fewer(rows, LEAST_SIZE.rows), cols: fewer(cols, LEAST_SIZE.cols) }
}
