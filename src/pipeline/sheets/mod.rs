//! Stage `sheets` (*cluster into single sheets* in the paper's figure 2): single sheets and the junctions (hinges) between
//! them.
//!
//! The paper drops voxels with more than 8 of 26 neighbours and takes components. On a bent
//! sheet that rule drops a quarter of the voxels and breaks it into pieces. We use what makes a
//! sheet a sheet instead: its points see the same two sides of the object. Walking along one
//! sheet, both feet move on smoothly; where sheets meet, one foot jumps to another side.
//!
//! 1. Two adjacent medial points are *linked* when both feet move less than a share of the radius (`links`).
//! 2. Linked components of points that see their feet under a wide angle are sheets, if they are
//!    large enough; other points are handed to the sheets they lie between (`growing`).
//! 3. Sheets that touch where no third one is near become one, or all that go on smoothly into one another, as is asked for
//!    (`joining`).
//! 4. Sheets without which the others still account for the object are pruned (the paper prunes the skeleton
//!    before), and sheets that only met at a pruned one become one again (`pruning`).
//! 5. What runs into an edge of the boundary is taken off (`trimming`).
//! 6. Sheets are numbered by size, and the hinges between them found (`ordering`, `junctions`).
//!
//! The sides of the sheets are the next stage but one ([`sides`](super::sides)): they are laid flat first.

mod links;

mod growing;

mod joining;

mod pruning;

pub(crate) mod inscribed;

mod trimming;

mod ordering;

mod junctions;

pub use self::ordering::in_order;
pub use self::pruning::{loss_needed, strength};

use std::collections::BTreeMap;
use std::f64::consts::PI;

use self::growing::{hand_over_rest, linked_components};
pub use self::joining::Joining;
use self::joining::join_across_pairs;
use self::pruning::{Needed, weakest};
use self::trimming::trim_edges;
use crate::model::Refusal;
use crate::pipeline::PipelineError;
use crate::pipeline::context::Context;
use crate::pipeline::medial::MedialSurface;
use crate::pipeline::solid::Solid;
use crate::pipeline::solid::depth::Depth;

/// Medial points that the main sheet needs: fewer are less than a lattice of 3 × 3 nodes with something to fit each to.
/// With 160, ten of 75 organs and shapes are refused; with 20, three small ones more are laid out, two of which fail.
pub(crate) const MIN_SHEET_POINTS: usize = 40;

/// No sheet.
pub const NO_SHEET: u32 = u32::MAX;

/// The sheets of a medial surface.
#[derive(Clone, Debug, Default)]
pub struct Sheets {
    /// Sheet of every medial point, or [`NO_SHEET`] where it was pruned.
    pub sheet_of: Vec<u32>,
    /// Points of each sheet; sheets are in the order of their size, those of nearly one size in that of their place.
    pub members: Vec<Vec<u32>>,
    /// Which sheets meet, and at which medial points.
    pub hinges: Vec<Hinge>,
    /// Sheets that were pruned.
    pub pruned: usize,
}

/// Where sheets meet.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Hinge {
    /// The sheets, ascending.
    pub sheets: Vec<u32>,
    /// Medial points that touch another of the sheets.
    pub points: Vec<u32>,
}

/// Splits a medial surface into single sheets and prunes those without evidence.
///
/// # Errors
/// When no sheet has enough points for a lattice; when it is cancelled.
pub fn sheets(
    surface: &MedialSurface,
    solid: &Solid,
    depth: &Depth,
    joining: Joining,
    context: &Context<'_>,
) -> Result<Sheets, PipelineError> {
    let needed =
        Needed { loss: loss_needed(context.params.prune), most: context.params.max_figures.unwrap_or(usize::MAX) };
    // The sheet of every medial point; numbers say nothing until the end.
    let mut label = linked_components(surface, context)?;
    context.advance(0.3);
    hand_over_rest(surface, &mut label, context)?;
    join_across_pairs(surface, &mut label, joining, context)?;
    context.advance(0.5);
    let mut pruned = 0;
    loop {
        let weak = weakest(surface, depth, &label, needed, context)?;
        if weak.is_empty() {
            break;
        }
        pruned += weak.len();
        for sheet in weak {
            rename(&mut label, sheet, NO_SHEET);
        }
        join_across_pairs(surface, &mut label, joining, context)?;
    }
    context.advance(0.9);
    trim_edges(surface, &mut label, context)?;
    let sheets = in_order(surface, solid, &label, pruned, context)?;
    check_sheet(surface, &sheets, solid, depth)?;
    Ok(sheets)
}

/// Gives all points of one sheet to another.
fn rename(label: &mut [u32], from: u32, to: u32) {
    for sheet in label {
        if *sheet == from {
            *sheet = to;
        }
    }
}

/// How many points each sheet has.
fn sizes(label: &[u32]) -> BTreeMap<u32, usize> {
    let mut sizes = BTreeMap::new();
    for &sheet in label {
        *sizes.entry(sheet).or_insert(0) += 1;
    }
    sizes.remove(&NO_SHEET);
    sizes
}

/// Refuses an object whose medial surface has too few points for a sheet.
fn check_sheet(surface: &MedialSurface, sheets: &Sheets, solid: &Solid, depth: &Depth) -> Result<(), Refusal> {
    /// Largest radius, voxels, below which such an object is too thin for its grid, whatever its shape is.
    const THIN: f64 = 2.0;
    /// Volume, in balls of the largest radius, below which it is a ball. One that is twice as long as it is wide,
    /// with round ends, has 2.5.
    const BALLS: f64 = 2.5;
    /// Volume, in that of a plate of the largest radius and the fewest points of a sheet, above which it is a tube,
    /// straight or closed, whose medial points see skin all around.
    const PLATES: f64 = 2.0;
    let points = sheets.members.iter().map(Vec::len).max().unwrap_or(0);
    if points >= MIN_SHEET_POINTS {
        return Ok(());
    }
    let radius = surface.points.iter().map(|p| p.radius).fold(0.0, f64::max);
    let volume = depth.volume();
    let (voxel_mm, radius_mm) = (solid.unit_mm, radius * solid.unit_mm);
    if radius < THIN {
        let thickness_mm = 2.0 * radius * voxel_mm;
        return Err(Refusal::TooThin {
            thickness_mm,
            voxels: 2.0 * radius,
            voxel_mm,
            resolution_mm: voxel_mm * radius / 3.0,
        });
    }
    if volume < BALLS * (4.0 / 3.0 * PI * radius.powi(3)) {
        return Err(Refusal::Ball { radius_mm });
    }
    if volume > PLATES * 2.0 * radius * MIN_SHEET_POINTS as f64 {
        let length_mm = volume / (PI * radius * radius) * voxel_mm;
        return Err(Refusal::Tube { length_mm, radius_mm });
    }
    Err(Refusal::TooSmall { points, needed: MIN_SHEET_POINTS })
}
