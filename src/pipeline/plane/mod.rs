//! Stage 5 (the paper's ISOMAP, section 2.4): sheets laid flat.

pub mod isomap;

pub mod region;

pub mod cut;

pub mod frame;

pub mod strip;

pub use self::isomap::Flat;

use self::frame::in_frame;
use self::isomap::{IsomapError, flatten};
use self::strip::unfolded;
use crate::model::{FrameFacts, PerSurface, Refusal};
use crate::numerics::fit::Rigid2;
use crate::params::Correspondence;
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
        let params = context.params;
        let flat = flatten(surface, params.neighbors, params.landmarks, solid.voxel_mm, context)
            .map_err(|error| refused(error, sheet, solid.voxel_mm))?;
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
        return Ok(Framed { flat: PerSurface { medial, upper, lower }, frame });
    }
    let upper = flat_of("upper", &sheet.upper.surface)?;
    let lower = flat_of("lower", &sheet.lower.surface)?;
    let upper = aligned(upper, &sheet.upper, &medial);
    let lower = aligned(lower, &sheet.lower, &medial);
    Ok(Framed { flat: PerSurface { medial, upper, lower }, frame })
}

fn warn_of_pieces(flat: &Flat, name: &str, number: usize, context: &Context<'_>) {
    if flat.pieces > 1 {
        let message = format!(
            "the neighbourhood graph of the {name} surface of sheet {number} fell into {} pieces, joined through touching voxels",
            flat.pieces
        );
        context.warn("neighborhood_too_small", message);
    }
}

/// A side that takes its coordinates from the sheet; it has no graph of its own.
fn carried(side: &Side, medial: &Flat) -> Flat {
    Flat {
        points: side.partners.iter().map(|&p| medial.points[p as usize]).collect(),
        residual_variance: f64::NAN,
        neighbors: f64::NAN,
        landmarks: 0,
        pieces: 0,
    }
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

fn refused(error: IsomapError, sheet: &SheetSides, voxel_mm: f64) -> PipelineError {
    let refusal = match error {
        IsomapError::Cancelled(stop) => return stop.into(),
        IsomapError::TooFewPoints { points } => Refusal::TooSmall { points, needed: MIN_SHEET_POINTS },
        IsomapError::TooManyForExact { points, limit } => Refusal::TooManyPoints { points, limit },
        IsomapError::NoPlane => {
            let from = sheet.medial.positions[0];
            let length = sheet.medial.positions.iter().map(|p| (p - from).norm()).fold(0.0, f64::max);
            let radius = sheet.radii.iter().copied().fold(0.0, f64::max);
            Refusal::Tube { length_mm: length * voxel_mm, radius_mm: radius * voxel_mm }
        }
    };
    refusal.into()
}
