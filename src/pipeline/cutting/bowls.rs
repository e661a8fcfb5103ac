//! Bowls: parts that ISOMAP cannot lay flat, unrolled by an injective map of their mesh
//! ([`injective`](crate::pipeline::plane::injective)) where that is sound. They stay one figure. The paper has no such
//! step.

use std::ops::RangeInclusive;

use super::Cutter;
use super::meshed::MeshPlane;
use super::part::Part;
use crate::cancel::{Cancel, Cancelled};
use crate::pipeline::kind::Kind;
use crate::pipeline::plane::embedding::{Flat, MAX_TURNED_OVER};
use crate::pipeline::plane::injective::unrolled;
use crate::pipeline::plane::strip::unfolded;
use crate::pipeline::sides::{SheetSides, agreeing_normals};
use crate::pipeline::surface::Surface;

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
        let plane = MeshPlane { places: found.places, stretch: found.stretch, period: None };
        let bowl = self.laid_by_mesh(&part, plane)?;
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
}

/// Whether more of a surface lies turned over in a plane than may.
fn is_turned_over(flat: &Flat, surface: &Surface, cancel: &dyn Cancel) -> Result<bool, Cancelled> {
    let distortion = flat.distortion(surface, cancel)?;
    Ok(distortion.is_some_and(|found| found.turned_over > MAX_TURNED_OVER))
}
