//! Bowls: parts that ISOMAP cannot lay flat, unrolled by an injective map of their mesh
//! ([`injective`](crate::pipeline::plane::injective)) where that is sound. They stay one figure. The paper has no such
//! step.

use std::ops::RangeInclusive;

use super::Cutter;
use super::part::{Faults, Measure, Part};
use crate::cancel::{Cancel, Cancelled};
use crate::pipeline::kind::{Kind, kind};
use crate::pipeline::plane::embedding::{Embedded, Flat, MAX_TURNED_OVER};
use crate::pipeline::plane::injective::{Unrolled, unrolled};
use crate::pipeline::plane::region::Region;
use crate::pipeline::plane::strip::unfolded;
use crate::pipeline::sides::{SheetSides, agreeing_normals};
use crate::pipeline::surface::Surface;

/// Share of a part's points that must lie on its mesh. Bowls and kidneys have 0.998 and more. Where it is less, ISOMAP
/// fails for strings and clumps of points, of which there is no mesh, and not for a bend: a part of a liver has 0.95, of
/// vertebrae 0.93, a bladder 0.55.
const LEAST_ON_MESH: f64 = 0.98;
/// Energies of the maps of bowls, 1 where all lengths are kept. Below, a sheet is not bent in both directions, and ISOMAP
/// fails for other reasons, for strings, notches and noise: parts of a liver, of muscles and vertebrae have up to 1.012, a bowl
/// of 78°, from where ISOMAP does not keep distances, about 1.018. From 1 on, vertebrae lose 0.01 to 0.04 of their overlap to
/// sheets that stand for them no better. Above, a part is cut: bowls have 1.03 (90°), 1.12 (120°), 1.25 (140°), 1.36 (150°) and
/// 1.53 (160°), kidneys 1.02 and 1.12. At 160° the rim, stretched by 4, has 18 nodes cut short and 504 pairs of triangles that
/// run through each other; in two parts it has none.
const BOWL_ENERGY: RangeInclusive<f64> = 1.015..=1.4;

impl Cutter<'_> {
    /// A part that does not lie flat in its plane, unrolled, if that is sound; any other as it is.
    pub(super) fn flattened(&self, part: Part) -> Result<Part, Cancelled> {
        if !self.may_unroll || part.is_unrolled() || !self.lies_over_itself(&part)? {
            return Ok(part);
        }
        let Some(found) = unrolled(&part.surface, *BOWL_ENERGY.start(), self.context)? else { return Ok(part) };
        if !BOWL_ENERGY.contains(&found.stretch.energy) {
            return Ok(part);
        }
        let bowl = self.bowl(&part, found)?;
        Ok(bowl.filter(|bowl| bowl.kind == Kind::Sheet && bowl.faults.worse() <= 1.0).unwrap_or(part))
    }

    /// Whether a part has two sides, and ISOMAP keeps its distances too badly or turns too much of it over.
    fn lies_over_itself(&self, part: &Part) -> Result<bool, Cancelled> {
        let Some(flat) = &part.flat else { return Ok(false) };
        let is_curled = part.faults.is_curled();
        if !is_curled && !is_turned_over(flat, &part.surface, self.context)? {
            return Ok(false);
        }
        let Some(normals) = agreeing_normals(self.surface, &part.members, self.context)? else { return Ok(false) };
        if is_curled {
            return Ok(true);
        }
        // A strip that was laid on a line is no fold: it will get back its width.
        let sheet = SheetSides { medial: part.surface.clone(), normals, ..SheetSides::default() };
        let points = unfolded(&sheet, &flat.points, self.context)?;
        is_turned_over(&Flat { points, ..Flat::default() }, &part.surface, self.context)
    }

    /// A part without the points that lie off its mesh, in the plane of that; `None` where there are many.
    fn bowl(&self, part: &Part, found: Unrolled) -> Result<Option<Part>, Cancelled> {
        let mut on_mesh = Vec::new();
        for (p, place) in part.members.iter().zip(&found.places) {
            if place.is_some() {
                on_mesh.push(*p);
            }
        }
        let members = self.largest_piece(&on_mesh)?;
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
        let flat = Flat { points, embedded, period: None };
        let surface = self.surface.part(&members, self.context)?;
        let region = Region::of(&flat.points, self.context)?;
        let measured = (Measure::TurnedOver, self.has_tunnels);
        let faults = Faults::of(measured, (&flat, &region), &surface, self.context)?;
        let kind = kind(&region, self.largest_radius(&members));
        let is_bare = part.is_bare || members.len() < part.members.len();
        Ok(Some(Part { members, surface, flat: Some(flat), kind, faults, is_bare }))
    }
}

/// Whether more of a surface lies turned over in a plane than may.
fn is_turned_over(flat: &Flat, surface: &Surface, cancel: &dyn Cancel) -> Result<bool, Cancelled> {
    let distortion = flat.distortion(surface, cancel)?;
    Ok(distortion.is_some_and(|found| found.turned_over > MAX_TURNED_OVER))
}
