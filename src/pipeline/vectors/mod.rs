//! Stage 7 (section 4 of the paper): which surface nodes belong to which medial node, and the vectors between
//! them.
//!
//! With `correspondence: "paper"` nodes of equal (i, j) on three lattices are paired ([`paper`]). We leave the
//! paper with `"anchored"`, the default: the nodes of the medial lattice are carried to both sides along the
//! spokes of its inscribed balls ([`anchored`]), and turned until none cross ([`repair`]), because the three
//! lattices stretch differently and vectors between them lean.

mod nodes;

pub mod legality;

mod crest;

mod paper;

mod repair;

mod anchored;

pub use self::nodes::Nodes;

use self::anchored::anchored;
use self::paper::paper;
use crate::cancel::Cancelled;
use crate::model::{PerSurface, Repair};
use crate::pipeline::context::Context;
use crate::pipeline::lattice::Laid;
use crate::pipeline::plane::Flat;
use crate::pipeline::sheets::sides::SheetSides;
use crate::pipeline::solid::Solid;
use crate::pipeline::solid::depth::Depth;

/// The nodes of a sheet's lattices in space, and what was repaired.
///
/// # Errors
/// When it is cancelled.
pub fn vectors(
    solid: &Solid,
    depth: &Depth,
    sheet: &SheetSides,
    flat: &PerSurface<Flat>,
    laid: Laid,
    context: &Context<'_>,
) -> Result<(Nodes, Repair), Cancelled> {
    match laid {
        Laid::Anchored { whole, lattice } => anchored(solid, depth, sheet, &whole, lattice, context),
        Laid::Paper(lattices) => Ok((paper(solid, sheet, flat, lattices, context)?, Repair::default())),
    }
}
