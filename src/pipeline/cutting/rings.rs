//! Rings: parts with one hole, bands and washers, laid in a strip that begins again by an injective map of their mesh
//! ([`rolled`]). They stay one figure, which meets itself. The paper has no such step: its sheets have no holes.

use super::Cutter;
use super::meshed::MeshPlane;
use super::part::Part;
use crate::cancel::Cancelled;
use crate::pipeline::kind::Kind;
use crate::pipeline::plane::injective::rolled;
use crate::pipeline::sides::agreeing_normals;

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
        let Some(found) = rolled(&part.surface, self.context)? else { return Ok(part) };
        if found.stretch.least < STRETCHES[0] || found.stretch.most > STRETCHES[1] {
            return Ok(part);
        }
        let plane = MeshPlane { places: found.places, stretch: found.stretch, period: Some(found.period) };
        let ring = self.laid_by_mesh(&part, plane)?;
        Ok(ring.filter(|ring| ring.kind == Kind::Sheet && ring.faults.worse() <= 1.0).unwrap_or(part))
    }
}
