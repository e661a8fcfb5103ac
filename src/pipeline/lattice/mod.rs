//! Stage `lattice`: the N × M lattice over a flattened surface, and the map from the plane back to space
//! (section 3 of the paper).
//!
//! 1. The region that the sheet covers in its plane is found; balls, tubes and sheets with large holes are refused;
//! 2. the sheet is carried on to its rim (`rim`), where it ends before or goes on beyond its voxels;
//! 3. the lattice gets its size (`automatic`);
//! 4. and is laid: the region is cut into four sides (`corners`) and made the image of a square (`patch`), in which nodes
//!    slide along rows and columns in turn until they are equally spaced along both (`slide`);
//! 5. [`map`] brings nodes back to space.
//!
//! Where we leave the paper: its lattice is the rectangle around the flattened points, here `lattice` "regular". That has
//! nodes on nothing: a rectangle inside an ellipse covers at most 64 % of it. "fitted", the default, follows the outline.
//! The map back is a local quadratic fit (moving least squares), so that the staircase of the voxels does not reach the
//! mesh; and only with `correspondence` "paper" does each surface have a lattice of its own.

mod arc;

mod corners;

mod harmonic;

mod patch;

mod slide;

pub(crate) mod rim;

pub mod map;

mod chords;

mod size;

use nalgebra::Point2;

use self::corners::Ends;
use self::patch::Patch;
use self::rim::{WholeSheet, to_rim};
use self::size::{automatic, respaced};
use self::slide::{equal_shares, evenly_spaced};
use crate::cancel::{Cancel, Cancelled};
use crate::model::{Automatic, FrameFacts, LatticeSize, PerSurface, Refusal, ring};
use crate::params::{Correspondence, LatticeKind};
use crate::pipeline::PipelineError;
use crate::pipeline::context::Context;
use crate::pipeline::plane::region::{HOLES_REFUSED, Region};
use crate::pipeline::plane::strip::{SheetPoints, widened};
use crate::pipeline::plane::{Flat, Framed};
use crate::pipeline::sheets::MIN_SHEET_POINTS;
use crate::pipeline::sides::SheetSides;
use crate::pipeline::solid::Solid;
use crate::pipeline::solid::depth::Depth;

/// A sheet shorter than this many radii is that of a ball, one narrower than this many that of a tube. From 0.5 to 1
/// nothing changes; with 2, a bladder is refused.
const BALL_LENGTH: f64 = 1.0;
/// See [`BALL_LENGTH`]. With 1.6, eight of 75 organs and shapes are refused, two thalami among them, which pass; with
/// 0.4, a rectum and a bladder are laid out that then fail, and an accumbens that does not.
const TUBE_WIDTH: f64 = 0.8;
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

/// Nodes of a lattice in the plane, row-major.
#[derive(Clone, Debug)]
pub struct Lattice {
    /// Its size.
    pub size: LatticeSize,
    /// Plane coordinates, voxels.
    pub nodes: Vec<Point2<f64>>,
    /// Whether the node lies inside the outline.
    pub valid: Vec<bool>,
    /// For every node of the edge, in the order of [`ring`], the place on the sheet's rim that it
    /// looks out to: along the lines of the lattice for a fitted one, its own for a regular one.
    pub rim: Vec<Point2<f64>>,
}

/// The lattices of a figure.
#[derive(Clone, Debug)]
pub enum Laid {
    /// One, over the sheet carried on to its rim.
    Anchored {
        /// The sheet.
        whole: WholeSheet,
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
        check_extents(&own_region, sheet, solid)?;
    }
    let is_anchored = context.params.correspondence == Correspondence::Anchored;
    let points =
        if is_anchored { widened(sheet, &flat.medial.points, depth, context)? } else { SheetPoints::default() };
    let is_widened = points.flat.len() > flat.medial.points.len();
    let region = if is_widened { Region::of(&points.flat, context)? } else { own_region };
    check_holes(region.hole_share, number, context)?;
    warn_of_frame(&framed.frame, number, context);
    let too_small = Refusal::TooSmall { points: sheet.medial.positions.len(), needed: MIN_SHEET_POINTS };
    if !is_anchored {
        let own = SheetPoints::of(sheet, &flat.medial.points);
        let (size, choices) = sized(flat, (&region, &own), solid, number, context)?;
        let lattices = on_each_surface(flat, size, context)?.ok_or(too_small)?;
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
    let (size, choices) = sized(flat, (&whole.region, &whole.points), solid, number, context)?;
    let lattice = spaced_as_asked(&whole.region, size, solid, context)?.ok_or(too_small)?;
    Ok((choices, Laid::Anchored { whole, lattice }))
}

/// Says when a little noise might turn the frame.
fn warn_of_frame(frame: &FrameFacts, number: usize, context: &Context<'_>) {
    if !frame.ambiguities.is_empty() {
        let message = format!("another frame of sheet {number} is as good: {}", frame.ambiguities.join("; "));
        context.warn("frame_ambiguous", message);
    }
}

/// Refuses large holes and tells of small ones.
fn check_holes(share: f64, number: usize, context: &Context<'_>) -> Result<(), Refusal> {
    if share > HOLES_REFUSED {
        return Err(Refusal::SheetHasHoles { share, allowed: HOLES_REFUSED });
    }
    if share > HOLES_SAID {
        let message = format!("holes in sheet {number} were filled: {:.1} % of its area", 100.0 * share);
        context.warn("sheet_holes_filled", message);
    }
    Ok(())
}

/// The size of the lattice, that of the figure it repeats in a repeat, with the evidence for all choices.
fn sized(
    flat: &PerSurface<Flat>,
    (region, points): (&Region, &SheetPoints),
    solid: &Solid,
    number: usize,
    context: &Context<'_>,
) -> Result<(LatticeSize, Automatic), Cancelled> {
    let (size, choices) = automatic(flat, region, points, solid.unit_mm, context)?;
    Ok((context.repeated_size(number).unwrap_or(size), choices))
}

/// A lattice over a region; with `spacing_mm`, laid again in the size at which its nodes are that far apart.
fn spaced_as_asked(
    region: &Region,
    size: LatticeSize,
    solid: &Solid,
    context: &Context<'_>,
) -> Result<Option<Lattice>, Cancelled> {
    let params = context.params;
    let first = lattice(region, params.lattice, size, params.margin(), 0.0, context)?;
    if let (None, Some(spacing_mm), Some(first)) = (context.repeat, params.spacing_mm, &first) {
        let better = respaced(first, spacing_mm / solid.unit_mm);
        if better != size {
            return lattice(region, params.lattice, better, params.margin(), 0.0, context);
        }
    }
    Ok(first)
}

/// Another lattice over the same sheet.
///
/// # Errors
/// When it is cancelled.
pub(super) fn relaid(
    whole: &WholeSheet,
    size: LatticeSize,
    margin: f64,
    context: &Context<'_>,
) -> Result<Option<Lattice>, Cancelled> {
    lattice(&whole.region, context.params.lattice, size, margin, 0.0, context)
}

/// Lattices on the three aligned embeddings. `None` when a region is empty.
fn on_each_surface(
    flat: &PerSurface<Flat>,
    size: LatticeSize,
    context: &Context<'_>,
) -> Result<Option<PerSurface<Lattice>>, Cancelled> {
    let medial = on_surface(&flat.medial, size, context)?;
    let upper = on_surface(&flat.upper, size, context)?;
    let lower = on_surface(&flat.lower, size, context)?;
    let (Some(medial), Some(upper), Some(lower)) = (medial, upper, lower) else { return Ok(None) };
    Ok(Some(PerSurface { medial, upper, lower }))
}

fn on_surface(flat: &Flat, size: LatticeSize, context: &Context<'_>) -> Result<Option<Lattice>, Cancelled> {
    let region = Region::of(&flat.points, context)?;
    lattice(&region, context.params.lattice, size, context.params.margin(), RIM_INSET, context)
}

/// Refuses balls and tubes: their medial sheet is no wider than they are thick.
fn check_extents(region: &Region, sheet: &SheetSides, solid: &Solid) -> Result<(), Refusal> {
    let [length, width] = region.rectangle();
    let radius = sheet.radii.iter().copied().fold(0.0, f64::max);
    let mm = solid.unit_mm;
    let (length_mm, radius_mm) = (length * mm, radius * mm);
    if length < BALL_LENGTH * radius {
        Err(Refusal::Ball { radius_mm })
    } else if width < TUBE_WIDTH * radius {
        Err(Refusal::Tube { length_mm, radius_mm })
    } else {
        Ok(())
    }
}

/// A lattice over the region, or `None` when the region is empty. `margin`: share of each line left free
/// at its ends; `inset`: harmonic share left free before that, for a fitted one.
///
/// # Errors
/// When it is cancelled.
pub fn lattice(
    region: &Region,
    kind: LatticeKind,
    size: LatticeSize,
    margin: f64,
    inset: f64,
    cancel: &dyn Cancel,
) -> Result<Option<Lattice>, Cancelled> {
    let (nodes, rim) = match kind {
        LatticeKind::Fitted => {
            let Some(patch) = Patch::of(region, if inset == 0.0 { Ends::OfTails } else { Ends::Wide }, cancel)? else {
                return Ok(None);
            };
            fitted(&patch, size, margin, inset, cancel)?
        }
        LatticeKind::Regular => {
            let Some(bounds) = region.bounds() else { return Ok(None) };
            let nodes = regular(bounds, size, margin);
            let rim = ring(size).into_iter().map(|n| nodes[n]).collect();
            (nodes, rim)
        }
    };
    let valid = nodes.iter().map(|n| region.contains(*n)).collect();
    Ok(Some(Lattice { size, nodes, valid, rim }))
}

/// The paper's rectangle: the bounding box of the region less the margin.
fn regular([low, high]: [Point2<f64>; 2], size: LatticeSize, margin: f64) -> Vec<Point2<f64>> {
    let shares = equal_shares(size, margin);
    shares.iter().map(|s| low + (high - low).component_mul(&s.coords)).collect()
}

/// Places of the nodes, and of the rim before those of the edge.
type NodesAndRim = (Vec<Point2<f64>>, Vec<Point2<f64>>);

/// Nodes that follow the outline, equally spaced along rows and columns, and the rim before those
/// of the edge.
///
/// Harmonic shares crowd in hollows and thin out in tips. The patch is spaced evenly first, so that
/// the margin is a share of the length of each line.
fn fitted(
    patch: &Patch,
    size: LatticeSize,
    margin: f64,
    inset: f64,
    cancel: &dyn Cancel,
) -> Result<NodesAndRim, Cancelled> {
    /// Size of the lattice that spaces the patch. With fewer nodes it cuts off bends; with more it takes longer to slide.
    const EVEN: LatticeSize = LatticeSize { rows: 25, cols: 49 };
    let mut even = evenly_spaced(patch, EVEN, inset, cancel)?;
    let inner = Patch::of_nodes(EVEN.rows, EVEN.cols, &patch.places(&even));
    push_to_rim(EVEN, &mut even);
    let outer = Patch::of_nodes(EVEN.rows, EVEN.cols, &patch.places(&even));
    let mut shares = evenly_spaced(&inner, size, margin, cancel)?;
    let mut nodes = inner.places(&shares);
    if inset == 0.0 {
        open_corners(size, &mut nodes);
    }
    push_to_rim(size, &mut shares);
    let rim = ring(size).into_iter().map(|n| outer.at(shares[n])).collect();
    Ok((nodes, rim))
}

/// Draws the nodes beside each corner inward until the edges that meet there make an angle: on a round outline they are
/// nearly in line, and a cell without an angle is turned over by anything.
fn open_corners(LatticeSize { rows, cols }: LatticeSize, nodes: &mut [Point2<f64>]) {
    /// Sine of what the angle lacks to a half turn at the least: 10°. With 5° corners of muscles and of a caudate are
    /// turned over; each degree more takes the edge a sixtieth of a step off the rim.
    const LEAST_TURN: f64 = 0.17;
    let last = rows * cols - 1;
    for (corner, along, across) in [
        (0, 1, cols),
        (cols - 1, cols - 2, 2 * cols - 1),
        (last, last - 1, last - cols),
        (last + 1 - cols, last + 2 - cols, last + 1 - 2 * cols),
    ] {
        let inner = along + across - corner;
        let inward = (nodes[inner] - nodes[corner]).try_normalize(1e-9).unwrap_or_default();
        let [a, b] = [nodes[along] - nodes[corner], nodes[across] - nodes[corner]];
        // The angle that each of the two makes with the line across the way inward.
        let turn = [a.dot(&inward) / a.norm().max(1e-9), b.dot(&inward) / b.norm().max(1e-9)];
        let missing = (LEAST_TURN - turn[0] - turn[1]).max(0.0) / 2.0;
        nodes[along] += inward * (missing * a.norm());
        nodes[across] += inward * (missing * b.norm());
    }
}

/// Moves the shares of the nodes of the edge to the rim that they look out to.
fn push_to_rim(size: LatticeSize, shares: &mut [Point2<f64>]) {
    let LatticeSize { rows, cols } = size;
    for (n, share) in shares.iter_mut().enumerate() {
        share.x = outward(n % cols, cols, share.x);
        share.y = outward(n / cols, rows, share.y);
    }
}

/// The share of the k-th node of a line: that of the rim at its ends.
fn outward(k: usize, count: usize, share: f64) -> f64 {
    match k {
        0 => 0.0,
        k if k + 1 == count => 1.0,
        _ => share,
    }
}
