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
use self::paper::paper;
use self::shares::Share;
use crate::cancel::Cancelled;
use crate::model::{PerSurface, Repair};
use crate::pipeline::context::Context;
use crate::pipeline::lattice::Laid;
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
    let (mut nodes, repair) = match laid {
        Laid::Anchored { whole, lattice } => anchored(solid, depth, sheet, &whole, lattice, context)?,
        Laid::Paper(lattices) => (paper(solid, sheet, flat, lattices, context)?, Repair::default()),
    };
    round_rim(&mut nodes, &solid.level, share, context)?;
    Ok((nodes, repair))
}
