//! Stage `isomap` (section 2.4 of the paper): sheets laid flat, by ISOMAP or another embedding.
//!
//! 1. every sheet is laid flat (`embedding`, over `graph` and `geodesics`, by `isomap`, `lle` or `laplacian`) and judged
//!    (`tangents`, `region`); where ISOMAP has no plane for it, a bowl is unrolled by its mesh (`injective`), and any other
//!    is cut by [`cutting`](super::cutting);
//! 2. `framed`: its plane is turned into a frame that the world fixes (`frame`), narrow tails get back their width
//!    (`strip`), and the sides take their coordinates from the sheet, or are laid flat themselves.
//!
//! Where we leave the paper: edges of the graph stay on the surface, and geodesics start at landmarks, not at every
//! point (`graph`, `isomap`); a bowl has a plane of its own (`injective`); the frame is not left to the signs of an eigen solver; and the sides are
//! laid flat themselves with `correspondence` "paper" only, since planes that are laid out apart do not pair their points.

pub mod embedding;

mod graph;

mod geodesics;

mod isomap;

mod lle;

mod laplacian;

pub(crate) mod tangents;

pub mod injective;

pub mod region;

pub(crate) mod frame;

mod round_frame;

pub mod strip;

pub use self::embedding::{Embedded, Flat, Method, flatten};
pub use self::graph::AUTO_RADIUS;

use self::embedding::EmbeddingError;
use self::frame::in_frame;
use self::round_frame::round_frame;
use self::strip::unfolded;
use self::tangents::PlaneDistortion;
use crate::cancel::{Cancel, Cancelled};
use crate::model::{FrameFacts, PerSurface, Refusal};
use crate::numerics::fit::Rigid2;
use crate::params::{Correspondence, Embedding};
use crate::pipeline::PipelineError;
use crate::pipeline::context::Context;
use crate::pipeline::sheets::MIN_SHEET_POINTS;
use crate::pipeline::sides::{SheetSides, Side};
use crate::pipeline::solid::Solid;
use crate::pipeline::surface::Surface;
use nalgebra::Point2;

/// A sheet and its sides in their planes, turned into the sheet's frame.
#[derive(Clone, Debug)]
pub struct Framed {
    /// The planes.
    pub flat: PerSurface<Flat>,
    /// What the planes do to angles and sides; `None` of a side that takes its coordinates from the sheet, and where
    /// nothing can be judged.
    pub distortion: PerSurface<Option<PlaneDistortion>>,
    /// Which way the sheet lies in the world.
    pub frame: FrameFacts,
}

/// Lays a sheet flat, unless it was before, and its sides, and turns them into one frame. Warnings name the sheet by
/// its `number`.
///
/// # Errors
/// When it cannot be laid flat; when it is cancelled.
pub(crate) fn framed(
    solid: &Solid,
    sheet: &SheetSides,
    laid: Option<Flat>,
    number: usize,
    context: &Context<'_>,
) -> Result<Framed, PipelineError> {
    let surfaces = Flattener { solid, sheet, number, context };
    let mut medial = match laid {
        Some(flat) => surfaces.warned("medial", flat),
        None => surfaces.flat("medial", &sheet.medial)?,
    };
    let (points, frame) = match medial.period {
        Some(period) => round_frame((&medial.points, period), sheet, solid),
        None => in_frame(&medial.points, sheet, solid, context)?,
    };
    medial.points = points;
    let flat = match context.params.correspondence {
        Correspondence::Anchored => {
            if medial.period.is_none() {
                medial.points = unfolded(sheet, &medial.points, context)?;
            }
            PerSurface { upper: carried(&sheet.upper, &medial), lower: carried(&sheet.lower, &medial), medial }
        }
        Correspondence::Paper => {
            let upper = aligned(surfaces.flat("upper", &sheet.upper.surface)?, &sheet.upper, &medial);
            let lower = aligned(surfaces.flat("lower", &sheet.lower.surface)?, &sheet.lower, &medial);
            PerSurface { medial, upper, lower }
        }
    };
    let distortion = distortions(&flat, sheet, context)?;
    Ok(Framed { flat, distortion, frame })
}

/// Lays the surfaces of a sheet flat.
struct Flattener<'a> {
    solid: &'a Solid,
    sheet: &'a SheetSides,
    number: usize,
    context: &'a Context<'a>,
}

impl Flattener<'_> {
    fn flat(&self, name: &str, surface: &Surface) -> Result<Flat, PipelineError> {
        let (params, voxel_mm) = (self.context.params, self.solid.unit_mm);
        match flatten(surface, params.into(), voxel_mm, self.context.memory_bytes(), self.context) {
            Ok(flat) => Ok(self.warned(name, flat)),
            Err(error) => Err(refused(error, params.embedding, self.sheet, voxel_mm)),
        }
    }

    /// Says when the graph of a surface was in pieces.
    fn warned(&self, name: &str, flat: Flat) -> Flat {
        let pieces = flat.embedded.map_or(1, |embedded| embedded.pieces);
        if pieces > 1 {
            let message = format!(
                "the neighbourhood graph of the {name} surface of sheet {} fell into {pieces} pieces, joined through touching voxels",
                self.number,
            );
            self.context.warn("neighborhood_too_small", message);
        }
        flat
    }
}

/// A side that takes its coordinates from the sheet; it has no graph of its own.
fn carried(side: &Side, medial: &Flat) -> Flat {
    Flat { points: partners(side, medial), embedded: None, period: medial.period }
}

/// A flattened side, turned rigidly onto the flattened sheet.
fn aligned(mut flat: Flat, side: &Side, medial: &Flat) -> Flat {
    let rigid = Rigid2::between(&flat.points, &partners(side, medial));
    for p in &mut flat.points {
        *p = rigid.apply(*p);
    }
    flat
}

/// Where the medial points of a side's points lie.
fn partners(side: &Side, medial: &Flat) -> Vec<Point2<f64>> {
    side.partners.iter().map(|&p| medial.points[p as usize]).collect()
}

/// What the planes do to the surfaces that were laid flat.
fn distortions(
    flat: &PerSurface<Flat>,
    sheet: &SheetSides,
    cancel: &dyn Cancel,
) -> Result<PerSurface<Option<PlaneDistortion>>, Cancelled> {
    let medial = flat.medial.distortion(&sheet.medial, cancel)?;
    let [mut upper, mut lower] = [None, None];
    if flat.upper.embedded.is_some() {
        upper = flat.upper.distortion(&sheet.upper.surface, cancel)?;
    }
    if flat.lower.embedded.is_some() {
        lower = flat.lower.distortion(&sheet.lower.surface, cancel)?;
    }
    Ok(PerSurface { medial, upper, lower })
}

/// Why a sheet has no figure when it, or a side of it, could not be laid flat.
fn refused(error: EmbeddingError, embedding: Embedding, sheet: &SheetSides, voxel_mm: f64) -> PipelineError {
    let method = match embedding {
        Embedding::Isomap => "exact ISOMAP",
        Embedding::Lle => "LLE",
        Embedding::Laplacian => "Laplacian eigenmaps",
    };
    let refusal = match error {
        EmbeddingError::Cancelled(stop) => return stop.into(),
        EmbeddingError::TooFewPoints { points } => Refusal::TooSmall { points, needed: MIN_SHEET_POINTS },
        EmbeddingError::TooManyPoints { points, limit } => {
            Refusal::TooManyPoints { method: method.into(), points, limit }
        }
        EmbeddingError::TooManyNeighbors { needed_mib, allowed_mib } => {
            Refusal::NeighborhoodTooLarge { needed_mib, allowed_mib }
        }
        EmbeddingError::NoEigenvectors(reason) => {
            Refusal::NoEmbedding { method: method.into(), reason: reason.to_string() }
        }
        EmbeddingError::NoPlane => tube(sheet, voxel_mm),
    };
    refusal.into()
}

/// A sheet that is a string, as long as its points reach from the first.
fn tube(sheet: &SheetSides, voxel_mm: f64) -> Refusal {
    let from = sheet.medial.positions[0];
    let mut length = 0.0f64;
    for p in &sheet.medial.positions {
        length = length.max((p - from).norm());
    }
    let radius = sheet.radii.iter().copied().fold(0.0, f64::max);
    Refusal::Tube { length_mm: length * voxel_mm, radius_mm: radius * voxel_mm }
}
