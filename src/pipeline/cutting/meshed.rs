//! Parts in a plane that their mesh gave them, bowls and rings alike.

use nalgebra::Point2;

use super::Cutter;
use super::part::{Faults, Measure, Part};
use crate::cancel::Cancelled;
use crate::model::Stretch;
use crate::pipeline::kind::kind;
use crate::pipeline::plane::embedding::{Embedded, Flat};
use crate::pipeline::plane::region::Region;

/// Share of a part's points that must lie on its mesh. Bowls and kidneys have 0.998 and more. Where it is less, ISOMAP
/// fails for strings and clumps of points, of which there is no mesh, and not for a bend: a part of a liver has 0.95, of
/// vertebrae 0.93, a bladder 0.55.
const LEAST_ON_MESH: f64 = 0.98;

/// What an injective map made of a part.
pub(super) struct MeshPlane {
    /// Plane coordinates of every point, voxels; `None` of those that lie off the mesh.
    pub places: Vec<Option<Point2<f64>>>,
    /// What the plane does to lengths.
    pub stretch: Stretch,
    /// Of a ring, the length after which the first coordinate begins again, voxels.
    pub period: Option<f64>,
}

impl Cutter<'_> {
    /// A part without the points that lie off its mesh, in the plane of that; `None` where there are many.
    pub(super) fn laid_by_mesh(&self, part: &Part, plane: MeshPlane) -> Result<Option<Part>, Cancelled> {
        let mut on_mesh = Vec::new();
        for (p, place) in part.members.iter().zip(&plane.places) {
            if place.is_some() {
                on_mesh.push(*p);
            }
        }
        let members = self.largest_piece(&on_mesh)?;
        if (members.len() as f64) < LEAST_ON_MESH * part.members.len() as f64 {
            return Ok(None);
        }
        let mut points = Vec::with_capacity(members.len());
        for (p, place) in part.members.iter().zip(plane.places) {
            if members.binary_search(p).is_ok() {
                points.extend(place);
            }
        }
        let embedded = part.flat.as_ref().and_then(|flat| flat.embedded);
        let embedded = embedded.map(|isomap| Embedded { unrolled: Some(plane.stretch), ..isomap });
        let flat = Flat { points, embedded, period: plane.period };
        let surface = self.surface.part(&members, self.context)?;
        let region = Region::of(&flat.points, self.context)?;
        // The hole that a ring goes round is none in its strip.
        let measured = (Measure::TurnedOver, self.has_tunnels && plane.period.is_none());
        let faults = Faults::of(measured, (&flat, &region), &surface, self.context)?;
        let kind = kind(&region, self.largest_radius(&members));
        let is_bare = part.is_bare || members.len() < part.members.len();
        Ok(Some(Part { members, surface, flat: Some(flat), kind, faults, is_bare }))
    }
}
