//! Rings: parts with one hole, bands and washers, laid in a strip that begins again by an injective map of their mesh
//! ([`rolled`]). They stay one figure, which meets itself. The paper has no such step: its sheets have no holes.

use super::Cutter;
use super::part::{Faults, Measure, Part};
use crate::cancel::Cancelled;
use crate::pipeline::kind::{Kind, kind};
use crate::pipeline::plane::embedding::{Embedded, Flat};
use crate::pipeline::plane::injective::rolled;
use crate::pipeline::plane::region::Region;
use crate::pipeline::sides::agreeing_normals;

/// Share of a part's points that must lie on its mesh, as of a bowl.
const LEAST_ON_MESH: f64 = 0.98;
/// How much narrower or wider than on average the ring may be drawn, for 98 % of its area: fits are made wider or narrower by
/// as much, and no more than that.
const STRETCHES: [f64; 2] = [0.4, 2.5];

impl Cutter<'_> {
    /// A part with one hole as a ring, if that is sound; any other as it is. One with a single side, a Möbius band, is none.
    pub(super) fn closed_round(&self, part: Part) -> Result<Part, Cancelled> {
        let may_be_ring = self.may_close && self.has_tunnels && !part.is_unrolled() && part.faults.worse() > 1.0;
        if !may_be_ring || agreeing_normals(self.surface, &part.members, self.context)?.is_none() {
            return Ok(part);
        }
        let ring = self.ring(&part)?;
        Ok(ring.filter(|ring| ring.kind == Kind::Sheet && ring.faults.worse() <= 1.0).unwrap_or(part))
    }

    /// A part without the points that lie off its mesh, in the strip of that; `None` where there are many.
    fn ring(&self, part: &Part) -> Result<Option<Part>, Cancelled> {
        let Some(found) = rolled(&part.surface, self.context)? else { return Ok(None) };
        if found.stretch.least < STRETCHES[0] || found.stretch.most > STRETCHES[1] {
            return Ok(None);
        }
        let on_mesh = part.members.iter().zip(&found.places).filter(|(_, place)| place.is_some());
        let members = self.largest_piece(&on_mesh.map(|(p, _)| *p).collect::<Vec<_>>())?;
        if (members.len() as f64) < LEAST_ON_MESH * part.members.len() as f64 {
            return Ok(None);
        }
        let mut points = Vec::with_capacity(members.len());
        for (p, place) in part.members.iter().zip(found.places) {
            if members.binary_search(p).is_ok() {
                points.extend(place);
            }
        }
        let embedded = part.flat.as_ref().and_then(|flat| flat.embedded);
        let embedded = embedded.map(|isomap| Embedded { unrolled: Some(found.stretch), ..isomap });
        let flat = Flat { points, embedded, period: Some(found.period) };
        let surface = self.surface.part(&members, self.context)?;
        let region = Region::of(&flat.points, self.context)?;
        let faults = Faults::of((Measure::TurnedOver, false), (&flat, &region), &surface, self.context)?;
        let kind = kind(&region, self.largest_radius(&members));
        let is_bare = part.is_bare || members.len() < part.members.len();
        Ok(Some(Part { members, surface, flat: Some(flat), kind, faults, is_bare }))
    }
}
