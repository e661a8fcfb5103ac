//! Stage `lattice`: the N × M lattice over a flattened surface, and the map from the plane back to space
//! (section 3 of the paper).
//!
//! 1. The region that the sheet covers in its plane is found; balls, tubes and sheets with large holes are refused;
//! 2. the sheet is carried on to its rim (`rim`), where it ends before or goes on beyond its voxels;
//! 3. the region is made the image of a square with evenly spaced lines ([`chart`](super::chart));
//! 4. the lattice gets its size (`automatic`) and is laid along those lines;
//! 5. [`map`] brings nodes back to space.
//!
//! Where we leave the paper: its lattice is the rectangle around the flattened points, here `lattice` "regular". That has
//! nodes on nothing: a rectangle inside an ellipse covers at most 64 % of it. "fitted", the default, follows the outline.
//! The map back is a local quadratic fit (moving least squares), so that the staircase of the voxels does not reach the
//! mesh; and only with `correspondence` "paper" does each surface have a lattice of its own.

pub(crate) mod rim;

pub mod map;

mod closing;

pub(in crate::pipeline) mod chords;

pub(in crate::pipeline) mod size;

use self::closing::closing;
use self::map::SpaceFromPlane;
use self::rim::{WholeSheet, to_rim};
use self::size::{automatic, respaced};
use crate::cancel::Cancelled;
use crate::model::{Automatic, FrameFacts, LatticeSize, PerSurface, Refusal};
use crate::params::Correspondence;
use crate::pipeline::PipelineError;
use crate::pipeline::chart::{Chart, Ends, Lattice};
use crate::pipeline::context::Context;
use crate::pipeline::kind::{Kind, kind};
use crate::pipeline::plane::region::{HOLES_REFUSED, Region};
use crate::pipeline::plane::strip::{SheetPoints, widened};
use crate::pipeline::plane::{Flat, Framed};
use crate::pipeline::sheets::MIN_SHEET_POINTS;
use crate::pipeline::sides::SheetSides;
use crate::pipeline::solid::Solid;
use crate::pipeline::solid::depth::Depth;

/// The paper's lattice (figure 5): an automatic one has as many nodes at the least.
pub(super) const LEAST_SIZE: LatticeSize = LatticeSize { rows: 6, cols: 8 };
/// Width of a tail below which no lattice follows it, voxels: it is a curve there. With 1 a hippocampus loses its tail, 0.07
/// of the overlap, and at 1.5 so does every tail of a single row of points; with none, rows lie on top of each other there.
const LEAST_WIDTH: f64 = 0.7;
/// Share of a sheet's area that holes may take before it is said that they were filled: gaps of a
/// voxel or two in a skeleton are no holes of the organ.
const HOLES_SAID: f64 = 0.02;
/// Harmonic share left free at the rim in `paper` mode. It is a small part of a voxel along a smooth rim and several
/// voxels in a narrow tip, where the three surfaces end differently: lattices that run to the end of tips fold there (2
/// to 10 % of the corners on organs with tails, against 0 to 2.5 %). What is left free belongs to the crest. With 0.05,
/// masks of 26 organs and shapes lie a third further from the model on average.
const RIM_INSET: f64 = 0.01;

/// The lattices of a figure.
#[derive(Clone, Debug)]
pub enum Laid {
    /// One, over the sheet carried on to its rim.
    Anchored {
        /// The sheet.
        whole: Box<WholeSheet>,
        /// The lines of its region.
        chart: Box<Chart>,
        /// Its lattice.
        lattice: Lattice,
    },
    /// One on each surface.
    Paper(PerSurface<Lattice>),
}

/// Lays the lattices of a sheet, with what was chosen for them. Warnings name the sheet by its `number`.
///
/// # Errors
/// When the sheet is that of a ball or a tube, has large holes or no room for a lattice; when it is cancelled.
pub fn lattices(
    solid: &Solid,
    depth: &Depth,
    sheet: &SheetSides,
    framed: &Framed,
    number: usize,
    context: &Context<'_>,
) -> Result<(Automatic, Laid), PipelineError> {
    let flat = &framed.flat;
    let own_region = Region::of(&flat.medial.points, context)?;
    if number == 0 {
        check_kind(&own_region, sheet, solid)?;
    }
    if let Some(period) = flat.medial.period {
        return round(solid, depth, sheet, (framed, period), number, context);
    }
    let is_anchored = context.params.correspondence == Correspondence::Anchored;
    let points = if is_anchored { widened(sheet, &flat.medial, depth, context)? } else { SheetPoints::default() };
    let is_widened = points.flat.len() > flat.medial.points.len();
    let region = if is_widened { Region::of(&points.flat, context)? } else { own_region };
    check_holes(region.hole_share, solid, number, context)?;
    warn_of_frame(&framed.frame, number, context);
    if !is_anchored {
        let own = SheetPoints::of(sheet, &flat.medial);
        let chart = chart(&region, (Ends::Wide, RIM_INSET), context)?.ok_or_else(|| too_small(sheet))?;
        let (size, choices) = sized(flat, (&chart, &own), solid, number, context)?;
        let lattices = on_each_surface(flat, &chart, size, context)?.ok_or_else(|| too_small(sheet))?;
        return Ok((choices, Laid::Paper(lattices)));
    }
    let mut whole = to_rim(&points, &region, &sheet.hinge, solid, depth, context)?;
    if let Some(wide) = whole.region.without_tails(LEAST_WIDTH, context)? {
        context.warn(
            "tip_is_a_curve",
            format!("a tail of sheet {number} is too narrow for a lattice: it ends where the tail begins"),
        );
        whole.region = wide;
    }
    let mut chart = chart(&whole.region, (Ends::OfTails, 0.0), context)?.ok_or_else(|| too_small(sheet))?;
    if flat.medial.is_unrolled() {
        let map = SpaceFromPlane::of(&whole.points).over_holes();
        chart = chart.spaced_in_space(|place| map.node(place).position);
    }
    let (size, choices) = sized(flat, (&chart, &whole.points), solid, number, context)?;
    let lattice = spaced_as_asked(&chart, size, solid, context)?;
    Ok((choices, Laid::Anchored { whole: Box::new(whole), chart: Box::new(chart), lattice }))
}

/// The lattice of a ring.
fn round(
    solid: &Solid,
    depth: &Depth,
    sheet: &SheetSides,
    (framed, period): (&Framed, f64),
    number: usize,
    context: &Context<'_>,
) -> Result<(Automatic, Laid), PipelineError> {
    warn_of_frame(&framed.frame, number, context);
    let points = SheetPoints::of(sheet, &framed.flat.medial);
    let laid = closing(&points, period, &sheet.hinge, (solid, depth), context)?;
    let (whole, chart) = laid.ok_or_else(|| too_small(sheet))?;
    check_holes(whole.region.hole_share, solid, number, context)?;
    let (size, choices) = sized(&framed.flat, (&chart, &whole.points), solid, number, context)?;
    let lattice = spaced_as_asked(&chart, size, solid, context)?;
    Ok((choices, Laid::Anchored { whole: Box::new(whole), chart: Box::new(chart), lattice }))
}

fn too_small(sheet: &SheetSides) -> Refusal {
    Refusal::TooSmall { points: sheet.medial.positions.len(), needed: MIN_SHEET_POINTS }
}

/// The lines of a region, of the kind that is asked for.
fn chart(region: &Region, ends: (Ends, f64), context: &Context<'_>) -> Result<Option<Chart>, Cancelled> {
    Chart::of(region, context.params.lattice, ends, context)
}

/// Says when a little noise might turn the frame.
fn warn_of_frame(frame: &FrameFacts, number: usize, context: &Context<'_>) {
    if !frame.ambiguities.is_empty() {
        let message = format!("another frame of sheet {number} is as good: {}", frame.ambiguities.join("; "));
        context.warn("frame_ambiguous", message);
    }
}

/// Refuses large holes that the object has, and tells of small ones and of those that its medial sheet alone has.
fn check_holes(share: f64, solid: &Solid, number: usize, context: &Context<'_>) -> Result<(), Refusal> {
    if share > HOLES_REFUSED && solid.has_tunnels() {
        return Err(Refusal::SheetHasHoles { share, allowed: HOLES_REFUSED });
    }
    if share > HOLES_SAID {
        let whose = if solid.has_tunnels() { "" } else { "; the mask has none" };
        let message = format!("holes in sheet {number} were filled: {:.1} % of its area{whose}", 100.0 * share);
        context.warn("sheet_holes_filled", message);
    }
    Ok(())
}

/// The size of the lattice, that of the figure it repeats in a repeat, with the evidence for all choices.
fn sized(
    flat: &PerSurface<Flat>,
    (chart, points): (&Chart, &SheetPoints),
    solid: &Solid,
    number: usize,
    context: &Context<'_>,
) -> Result<(LatticeSize, Automatic), Cancelled> {
    let (size, choices) = automatic(flat, chart, points, solid.unit_mm, context)?;
    Ok((context.repeated_size(number).unwrap_or(size), choices))
}

/// A lattice over a region; with `spacing_mm`, laid again in the size at which its nodes are that far apart.
fn spaced_as_asked(
    chart: &Chart,
    size: LatticeSize,
    solid: &Solid,
    context: &Context<'_>,
) -> Result<Lattice, Cancelled> {
    let params = context.params;
    let first = chart.lattice(size, params.margin(), context)?;
    if let (None, Some(spacing_mm)) = (context.repeat, params.spacing_mm) {
        let better = respaced(&first, spacing_mm / solid.unit_mm);
        if better != size {
            return chart.lattice(better, params.margin(), context);
        }
    }
    Ok(first)
}

/// Lattices on the three aligned embeddings, the medial one on its chart. `None` when a region is empty.
fn on_each_surface(
    flat: &PerSurface<Flat>,
    chart: &Chart,
    size: LatticeSize,
    context: &Context<'_>,
) -> Result<Option<PerSurface<Lattice>>, Cancelled> {
    let medial = chart.lattice(size, context.params.margin(), context)?;
    let upper = on_side(&flat.upper, size, context)?;
    let lower = on_side(&flat.lower, size, context)?;
    let (Some(upper), Some(lower)) = (upper, lower) else { return Ok(None) };
    Ok(Some(PerSurface { medial, upper, lower }))
}

fn on_side(flat: &Flat, size: LatticeSize, context: &Context<'_>) -> Result<Option<Lattice>, Cancelled> {
    let region = Region::of(&flat.points, context)?;
    let Some(chart) = chart(&region, (Ends::Wide, RIM_INSET), context)? else { return Ok(None) };
    Ok(Some(chart.lattice(size, context.params.margin(), context)?))
}

/// Refuses balls and tubes.
fn check_kind(region: &Region, sheet: &SheetSides, solid: &Solid) -> Result<(), Refusal> {
    let radius = sheet.radii.iter().copied().fold(0.0, f64::max);
    let radius_mm = radius * solid.unit_mm;
    match kind(region, radius) {
        Kind::Ball => Err(Refusal::Ball { radius_mm }),
        Kind::Tube { length } => Err(Refusal::Tube { length_mm: length * solid.unit_mm, radius_mm }),
        Kind::Sheet => Ok(()),
    }
}
