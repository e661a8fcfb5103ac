//! A connected part of a sheet in its plane, and what is wrong with it there.

use crate::cancel::Cancelled;
use crate::params::{Embedding, LatticeKind};
use crate::pipeline::chart::{Chart, Ends};
use crate::pipeline::context::Context;
use crate::pipeline::kind::Kind;
use crate::pipeline::plane::Flat;
use crate::pipeline::plane::embedding::MAX_TURNED_OVER;
use crate::pipeline::plane::region::{HOLES_REFUSED, Region};
use crate::pipeline::surface::Surface;

/// Residual variance above which a sheet counts as not laid flat. Sheets known to be developable
/// have 0.0006 at most, organs that are laid out well 0.008, and sheets that lie over themselves in
/// the plane 0.04 and more.
const MAX_RESIDUAL: f64 = 0.018;
/// Squareness of a chart below which its region has no lattice: an L of two arms has 0.06, the sheets of 14 masks of
/// organs 0.69 and more.
const LEAST_SQUARENESS: f64 = 0.4;
/// Share of its rectangle from which on the chart of a region is not looked at: a triangle has 0.87, an L of two slender
/// arms 0.6. It saves a tenth of a second for each sheet.
const COMPACT: f64 = 0.85;

/// The measure that tells a plane in which a sheet does not lie flat.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Measure {
    /// Of distances that are not kept.
    Residual,
    /// Of area that lies turned over.
    TurnedOver,
}

impl Measure {
    /// Of the planes of an embedding.
    pub fn of(embedding: Embedding) -> Self {
        if embedding == Embedding::Isomap { Self::Residual } else { Self::TurnedOver }
    }

    /// What a plane to work in has at most.
    fn most(self) -> f64 {
        match self {
            Self::Residual => MAX_RESIDUAL,
            Self::TurnedOver => MAX_TURNED_OVER,
        }
    }

    fn name(self) -> &'static str {
        match self {
            Self::Residual => "residual variance",
            Self::TurnedOver => "share turned over",
        }
    }
}

/// What is wrong with the plane of a part.
#[derive(Clone, Copy, Debug)]
pub(super) struct Faults {
    measure: Measure,
    /// By the measure of the embedding.
    plane: f64,
    /// [`Chart::squareness`] of its region; 1 of one that is compact.
    squareness: f64,
    /// Share of its region that holes take, unless they are gaps of the skeleton.
    holes: f64,
}

impl Faults {
    /// None: of what is not laid flat.
    pub fn none(measure: Measure) -> Self {
        Self { measure, plane: 0.0, squareness: 1.0, holes: 0.0 }
    }

    /// Of a surface in its plane; `has_tunnels`: so that holes may be those of the solid.
    ///
    /// # Errors
    /// When it is cancelled.
    pub fn of(
        (measure, has_tunnels): (Measure, bool),
        (flat, region): (&Flat, &Region),
        surface: &Surface,
        context: &Context<'_>,
    ) -> Result<Self, Cancelled> {
        let plane = match measure {
            Measure::Residual => flat.embedded.map_or(0.0, |embedded| embedded.residual_variance),
            Measure::TurnedOver => flat.distortion(surface, context)?.map_or(0.0, |found| found.turned_over),
        };
        let holes = if has_tunnels { region.hole_share } else { 0.0 };
        Ok(Self { measure, plane, squareness: squareness(region, context)?, holes })
    }

    /// The worst of them, over what it may be: above 1 a part is cut.
    pub fn worse(self) -> f64 {
        let bend = (1.0 - self.squareness) / (1.0 - LEAST_SQUARENESS);
        (self.plane / self.measure.most()).max(bend).max(self.holes / HOLES_REFUSED)
    }

    /// Whether it has holes that no lattice covers.
    pub fn has_holes(self) -> bool {
        self.holes > HOLES_REFUSED
    }

    /// Whether it does not lie flat in its plane.
    pub fn is_curled(self) -> bool {
        self.plane > self.measure.most()
    }

    /// Whether no lattice fits its outline.
    pub fn is_bent(self) -> bool {
        self.squareness < LEAST_SQUARENESS
    }
}

impl std::fmt::Display for Faults {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{} {:.3}, squareness {:.2}", self.measure.name(), self.plane, self.squareness)?;
        if self.has_holes() { write!(f, ", holes {:.2}", self.holes) } else { Ok(()) }
    }
}

/// How square the cells of lattices over a region will be.
fn squareness(region: &Region, context: &Context<'_>) -> Result<f64, Cancelled> {
    let [length, width] = region.rectangle();
    if region.area() > COMPACT * length * width {
        return Ok(1.0);
    }
    let chart = Chart::of(region, LatticeKind::Fitted, (Ends::OfTails, 0.0), context)?;
    Ok(chart.map_or(1.0, |chart| chart.squareness()))
}

/// A connected part of a sheet in its plane.
pub(super) struct Part {
    /// Medial points, ascending.
    pub members: Vec<u32>,
    /// The same as a surface.
    pub surface: Surface,
    /// Its plane.
    pub flat: Option<Flat>,
    /// What it is by its extents there.
    pub kind: Kind,
    /// What is wrong with it.
    pub faults: Faults,
    /// Strings were taken off.
    pub is_bare: bool,
}

impl Part {
    /// Whether it meets itself round a hole.
    pub fn is_ring(&self) -> bool {
        self.flat.as_ref().is_some_and(|flat| flat.period.is_some())
    }

    /// Whether it lies in the plane of its mesh, not in ISOMAP's.
    pub fn is_unrolled(&self) -> bool {
        self.flat.as_ref().is_some_and(Flat::is_unrolled)
    }
}
