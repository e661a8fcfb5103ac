//! Stage `spokes` (section 4 of the paper): which surface nodes belong to which medial node, and the vectors between
//! them.
//!
//! 1. Nodes are brought into space and paired with those of both sides. With `correspondence: "paper"` nodes of equal
//!    (i, j) on three lattices are paired (`paper`). We leave the paper with `"anchored"`, the default: the nodes of
//!    the medial lattice are carried to both sides along the spokes of its inscribed balls (`anchored`, `spokes`),
//!    because the three lattices stretch differently and vectors between them lean.
//! 2. The three meshes of the paper leave the rim open. Each node of the edge gets a crest point there (`crest`), and an
//!    arc round the rim from its upper node over that point to its lower node (`arcs`), so that what the vectors fill is
//!    closed. Where sheets meet, arcs keep to the share of their own ([`shares`]).
//! 3. The paper's vectors are meant not to cross. We look ([`legality`]), and with `"anchored"` turn those that do
//!    (`spoked_lattice`, `untangle`, `mend_crest`); what crosses whichever way it is turned is cut short (`shorten`).

mod nodes;

mod paper;

mod anchored;

mod spokes;

mod crest;

pub mod legality;

mod spoked_lattice;

mod fairing;

mod untangle;

mod mend_crest;

mod shorten;

mod arcs;

pub mod shares;

pub use self::nodes::Nodes;

use self::anchored::anchored;
use self::arcs::round_rim;
use self::legality::legality;
use self::paper::paper;
use self::shares::Share;
use crate::cancel::Cancelled;
use crate::model::{LatticeSize, PerSurface, Repair};
use crate::numerics::field::floor_index;
use crate::params::GridChoice;
use crate::pipeline::context::Context;
use crate::pipeline::lattice::rim::WholeSheet;
use crate::pipeline::lattice::{LEAST_SIZE, Laid, Lattice, relaid};
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
        Laid::Anchored { whole, lattice } => {
            let body = Laying { solid, depth, sheet, share, whole: &whole, context };
            body.finest_sound(lattice)
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
    solid: &'a Solid,
    depth: &'a Depth,
    sheet: &'a SheetSides,
    share: Share<'a>,
    whole: &'a WholeSheet,
    context: &'a Context<'a>,
}

impl Laying<'_> {
    /// The nodes of a lattice; where its size was left to us and repair spoils some, those of the first of coarser ones, and
    /// then of ones that leave the rim free, of which it spoils none: bends sharper than the nodes are far apart are smoothed
    /// by the former, and what noise makes of a rim is left out by the latter. If there is none, those with the least
    /// spoilt.
    fn finest_sound(&self, lattice: Lattice) -> Result<(Nodes, Repair), Cancelled> {
        let params = self.context.params;
        let is_ours = params.grid == GridChoice::Auto && params.spacing_mm.is_none() && self.context.repeat.is_none();
        let whole_size = lattice.size;
        let mut best = self.nodes(lattice)?;
        if !is_ours {
            return Ok((best.0, best.1));
        }
        for (size, margin) in tries(whole_size, params.margin()) {
            if best.2 == Spoilt::default() {
                break;
            }
            let Some(lattice) = relaid(self.whole, size, margin, self.context)? else { break };
            let other = self.nodes(lattice)?;
            if other.2 < best.2 {
                best = other;
                if margin > params.margin() && best.2 == Spoilt::default() {
                    let message = format!(
                        "{:.0} % of the lattice's extent are left free at its rim, which is too rough",
                        100.0 * margin
                    );
                    self.context.warn("rim_left_free", message);
                }
            }
        }
        Ok((best.0, best.1))
    }

    fn nodes(&self, lattice: Lattice) -> Result<(Nodes, Repair, Spoilt), Cancelled> {
        /// Share of nodes that repair may spoil: one in a hundred is the corner of a lattice.
        const CORNER: f64 = 0.01;
        let Self { solid, depth, sheet, share, whole, context } = self;
        let (mut nodes, repair) = anchored(solid, depth, sheet, whole, lattice, *context)?;
        round_rim(&mut nodes, &solid.level, *share, *context)?;
        let illegal = legality((&nodes).into()).parts.len();
        let marred = if repair.marred_share() <= CORNER { 0.0 } else { repair.marred_share() };
        Ok((nodes, repair, Spoilt { illegal, marred }))
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
    const COARSER: [f64; 5] = [0.75, 0.56, 0.42, 0.32, 0.24];
    /// Share of the extent left free, and what the sides are multiplied with then.
    const FREE: [(f64, f64); 4] = [(0.03, 0.75), (0.03, 0.42), (0.06, 0.75), (0.06, 0.32)];
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

/// A size with fewer nodes, the paper's at the least.
fn coarser(LatticeSize { rows, cols }: LatticeSize, share: f64) -> LatticeSize {
    let fewer = |count: usize, least: usize| floor_index(count as f64 * share).max(least).min(count);
    LatticeSize { rows: fewer(rows, LEAST_SIZE.rows), cols: fewer(cols, LEAST_SIZE.cols) }
}
