//! Stage 5 (the paper's ISOMAP, section 2.4): sheets laid flat.

pub mod embedding;

mod graph;

mod geodesics;

mod isomap;

mod lle;

mod laplacian;

pub mod tangents;

pub mod region;

pub mod cut;

pub mod frame;

pub mod strip;

pub use self::embedding::{Embedded, Flat, Method, flatten};
pub use self::graph::AUTO_RADIUS;

use self::embedding::EmbeddingError;
use self::frame::in_frame;
use self::strip::unfolded;
use self::tangents::PlaneDistortion;
use crate::model::{FrameFacts, PerSurface, Refusal};
use crate::numerics::fit::Rigid2;
use crate::params::{Correspondence, Embedding};
use crate::pipeline::PipelineError;
use crate::pipeline::context::Context;
use crate::pipeline::sheets::MIN_SHEET_POINTS;
use crate::pipeline::sheets::sides::{SheetSides, Side};
use crate::pipeline::sheets::surface::Surface;
use crate::pipeline::solid::Solid;
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
pub fn framed(
    solid: &Solid,
    sheet: &SheetSides,
    laid: Option<Flat>,
    number: usize,
    context: &Context<'_>,
) -> Result<Framed, PipelineError> {
    let flat_of = |name: &str, surface: &Surface| {
        let flat = flatten(surface, context.params.into(), solid.voxel_mm, context)
            .map_err(|error| refused(error, context.params.embedding, sheet, solid.voxel_mm))?;
        warn_of_pieces(&flat, name, number, context);
        Ok::<Flat, PipelineError>(flat)
    };
    let mut medial = match laid {
        Some(flat) => {
            warn_of_pieces(&flat, "medial", number, context);
            flat
        }
        None => flat_of("medial", &sheet.medial)?,
    };
    let (points, frame) = in_frame(&medial.points, sheet, solid, context)?;
    medial.points = points;
    if context.params.correspondence == Correspondence::Anchored {
        medial.points = unfolded(sheet, &medial.points, context)?;
        let (upper, lower) = (carried(&sheet.upper, &medial), carried(&sheet.lower, &medial));
        let distortion = PerSurface { medial: medial.distortion(&sheet.medial, context)?, ..PerSurface::default() };
        return Ok(Framed { flat: PerSurface { medial, upper, lower }, distortion, frame });
    }
    let upper = flat_of("upper", &sheet.upper.surface)?;
    let lower = flat_of("lower", &sheet.lower.surface)?;
    let upper = aligned(upper, &sheet.upper, &medial);
    let lower = aligned(lower, &sheet.lower, &medial);
    let distortion = PerSurface {
        medial: medial.distortion(&sheet.medial, context)?,
        upper: upper.distortion(&sheet.upper.surface, context)?,
        lower: lower.distortion(&sheet.lower.surface, context)?,
    };
    Ok(Framed { flat: PerSurface { medial, upper, lower }, distortion, frame })
}

fn warn_of_pieces(flat: &Flat, name: &str, number: usize, context: &Context<'_>) {
    let pieces = flat.embedded.map_or(1, |embedded| embedded.pieces);
    if pieces > 1 {
        let message = format!(
            "the neighbourhood graph of the {name} surface of sheet {number} fell into {pieces} pieces, joined through touching voxels",
        );
        context.warn("neighborhood_too_small", message);
    }
}

/// A side that takes its coordinates from the sheet; it has no graph of its own.
fn carried(side: &Side, medial: &Flat) -> Flat {
    Flat { points: side.partners.iter().map(|&p| medial.points[p as usize]).collect(), embedded: None }
}

/// A flattened side, turned rigidly onto the flattened sheet.
fn aligned(mut flat: Flat, side: &Side, medial: &Flat) -> Flat {
    let partners: Vec<Point2<f64>> = side.partners.iter().map(|&p| medial.points[p as usize]).collect();
    let rigid = Rigid2::between(&flat.points, &partners);
    for p in &mut flat.points {
        *p = rigid.apply(*p);
    }
    flat
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
        EmbeddingError::NoEigenvectors(reason) => {
            Refusal::NoEmbedding { method: method.into(), reason: reason.to_string() }
        }
        EmbeddingError::NoPlane => {
            let from = sheet.medial.positions[0];
            let length = sheet.medial.positions.iter().map(|p| (p - from).norm()).fold(0.0, f64::max);
            let radius = sheet.radii.iter().copied().fold(0.0, f64::max);
            Refusal::Tube { length_mm: length * voxel_mm, radius_mm: radius * voxel_mm }
        }
    };
    refusal.into()
}
