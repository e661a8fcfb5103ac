//! Sheets or a tube: which kind of figure stands for a part of a label.
//!
//! 1. Where the medial set is shorter or narrower than the solid is thick, or has no lattice, it is no sheet;
//! 2. where it is narrow, the sections of the tube say what it is: round ones are those of a tube;
//! 3. where the sheets are not sound (vectors cross, many nodes are spoilt, or little of the solid is filled), a tube takes
//!    their place that is sound and fills more.

use super::PipelineError;
use super::context::Context;
use super::medial::MedialSurface;
use super::solid::Solid;
use super::solid::depth::Depth;
use super::soundness::Soundness;
use super::stages::{Figures, sheet_figures};
use super::tubes::{Tubes, tubes};
use crate::cancel::Cancelled;
use crate::model::{KindEvidence, Refusal, Stage};
use crate::numerics::stats::mean;

/// Width of the main sheet over its mean radius up to which it may be that of a tube of any length. Sheets of organs that are
/// laid out well have 2 and more, thalami 1.8, a vena cava 1.0, bladders 1.4.
const NARROW: f64 = 1.7;
/// Radius of the circle of a section's area over its inscribed radius up to which a narrow sheet is that of a tube: an ellipse
/// of 2 by 1 has 1.41. It hardly changes with the grid: 1.27 and 1.32 of a bladder, 1.21 and 1.18 of a stomach.
const NEARLY_ROUND: f64 = 1.4;
/// The same of a sheet that is wider, but long. Vessels have 1.04 to 1.16, stomach, duodenum and femur 1.2 to 1.26,
/// hippocampi 1.25 to 1.6, caudates 1.36, glutei 2.
const ROUND: f64 = 1.24;
/// Length over twice the radius from which a tube is long: a thalamus has 2.5, a femur 4, a stomach 6.
const LONG: f64 = 3.5;
/// Width in radii, and length over width, of sheets that may be those of long tubes: of others no tube is tried.
const MODERATE: f64 = 3.8;
/// See [`MODERATE`].
const LONGISH: f64 = 2.0;
/// Flatness of the sections up to which the branches of what has holes are those of a ring of tubes. Those of a round ring have
/// 1.0 to 1.2, of a flat one, which is a sheet with a hole, 1.5 to 1.7.
const ROUND_BRANCH: f64 = 1.35;
/// The same up to which what is too thin for sheets is a tube: an ellipse of 4 by 1 has 2. A plate of two
/// voxels would be a tube with wall nodes that end short. With 1.4 an L4 has an overlap of 0.85, not 0.88; with 4 an L1 has 0.85,
/// not 0.89.
const THIN_FLATNESS: f64 = 2.0;

/// The figures of a solid.
pub(super) struct Chosen {
    /// Those that stand best for it.
    pub figures: Figures,
    /// How well.
    pub soundness: Soundness,
    /// The tubes that were not taken, where there are.
    pub tubes: Option<Tubes>,
}

/// The figures of a solid.
///
/// # Errors
/// When it has neither sheets nor is a tube; when it is cancelled.
pub(super) fn figures(
    solid: &Solid,
    depth: &Depth,
    surface: &MedialSurface,
    context: &Context<'_>,
) -> Result<Chosen, PipelineError> {
    let kinds = context.params.kinds;
    if !kinds.may_be_tubes() {
        let figures = sheet_figures(solid, depth, surface, context)?;
        let soundness = Soundness::of(solid, &figures.drafts(), context)?;
        return Ok(Chosen { figures, soundness, tubes: None });
    }
    if !kinds.may_be_sheets() {
        let tubes = as_tubes(solid, context)?.ok_or(Refusal::NoTube)?;
        return Ok(tubes.chosen());
    }
    let attempt = context.apart();
    let outcome = sheet_figures(solid, depth, surface, &attempt);
    let sheets = match outcome {
        Ok(sheets) => Sheets::of(sheets, solid, context)?,
        Err(PipelineError::Refused(refusal)) if may_be_tube(&refusal) => {
            let other = context.apart();
            let mut tubes = as_tubes(solid, &other)?;
            if let Some(found) = &tubes
                && !found.stand_for(&refusal)
            {
                tubes = None;
            }
            context.take_in(attempt.into_notes().without_warnings(), None);
            context.take_in(other.into_notes(), None);
            return tubes.map(AsTubes::chosen).ok_or_else(|| refusal.into());
        }
        Err(stop) => return Err(stop),
    };
    if context.params.are_of_paper() || (sheets.soundness.fills() && !sheets.may_be_of_tube()) {
        context.take_in(attempt.into_notes(), None);
        return Ok(sheets.chosen(None));
    }
    let other = context.apart();
    match as_tubes(solid, &other)? {
        Some(tubes) if sheets.yield_to(&tubes) => {
            context.take_in(attempt.into_notes().without_warnings(), None);
            context.take_in(other.into_notes(), None);
            Ok(sheets.told_by(tubes).chosen())
        }
        tubes => {
            context.take_in(attempt.into_notes(), None);
            context.take_in(other.into_notes().without_warnings(), None);
            Ok(sheets.chosen(tubes))
        }
    }
}

/// A solid as tubes.
struct AsTubes {
    tubes: Tubes,
    soundness: Soundness,
}

/// A solid as tubes, in the better of the ways that there are.
fn as_tubes(solid: &Solid, context: &Context<'_>) -> Result<Option<AsTubes>, Cancelled> {
    let mut best: Option<AsTubes> = None;
    for tubes in context.stage(Stage::Lattice, || tubes(solid, context))? {
        let soundness = Soundness::of_tubes(solid, &tubes, context)?;
        if best.as_ref().is_none_or(|best| soundness.is_better_than(best.soundness)) {
            best = Some(AsTubes { tubes, soundness });
        }
    }
    Ok(best)
}

/// Whether what has no sheets may be a tube.
fn may_be_tube(refusal: &Refusal) -> bool {
    matches!(
        refusal,
        Refusal::Ball { .. }
            | Refusal::Tube { .. }
            | Refusal::TooSmall { .. }
            | Refusal::TooThin { .. }
            | Refusal::SheetHasHoles { .. }
    )
}

impl AsTubes {
    /// As what is chosen.
    fn chosen(self) -> Chosen {
        let mut tubes = self.tubes;
        for tube in &mut tubes.drafts {
            let evidence = tube.choices.kind.unwrap_or_default();
            tube.choices.kind = Some(KindEvidence { tube_overlap: Some(self.soundness.overlap), ..evidence });
        }
        Chosen { figures: Figures::Tubes(tubes), soundness: self.soundness, tubes: None }
    }

    /// Whether they stand for what has no sheets. A solid with holes may be a ring of round sections; of flat ones it is a sheet
    /// that has to be cut, and what it is cut into here would have no thickness. What is too thin for sheets is a tube only if
    /// that is not flat either and spoils few nodes.
    fn stand_for(&self, refusal: &Refusal) -> bool {
        let flattest = self.tubes.drafts.iter().map(|tube| tube.flatness).fold(0.0, f64::max);
        match refusal {
            Refusal::SheetHasHoles { .. } => flattest <= ROUND_BRANCH && self.soundness.is_legal,
            Refusal::TooThin { .. } => flattest <= THIN_FLATNESS && self.soundness.spoils_few(),
            _ => true,
        }
    }
}

/// The sheets of a part with what speaks for them.
struct Sheets {
    figures: Figures,
    /// Width of the main one over its mean radius.
    width_in_radii: f64,
    /// Its length over its width.
    aspect: f64,
    soundness: Soundness,
}

impl Sheets {
    fn of(figures: Figures, solid: &Solid, context: &Context<'_>) -> Result<Self, Cancelled> {
        let drafts = figures.drafts();
        let soundness = Soundness::of(solid, &drafts, context)?;
        let width_in_radii = drafts.first().map_or(0.0, |main| {
            let radius_mm = mean(main.radii()).unwrap_or(0.0) * solid.unit_mm;
            main.choices().width_mm / radius_mm.max(f64::MIN_POSITIVE)
        });
        let aspect = drafts
            .first()
            .map_or(1.0, |main| main.choices().length_mm / main.choices().width_mm.max(f64::MIN_POSITIVE));
        Ok(Self { figures, width_in_radii, aspect, soundness })
    }

    /// Whether it is worth looking at the sections of a tube.
    fn may_be_of_tube(&self) -> bool {
        self.width_in_radii <= NARROW || (self.width_in_radii <= MODERATE && self.aspect >= LONGISH)
    }

    /// Whether tubes stand better for the part than they do.
    fn yield_to(&self, other: &AsTubes) -> bool {
        if !other.soundness.is_legal {
            return false;
        }
        if self.soundness.fills() {
            let [tube] = &other.tubes.drafts[..] else { return false };
            let elongation = tube.choices.kind.and_then(|evidence| evidence.elongation).unwrap_or(0.0);
            let is_long = tube.flatness <= ROUND && elongation >= LONG;
            return is_long || (self.width_in_radii <= NARROW && tube.flatness <= NEARLY_ROUND);
        }
        other.soundness.overlap > self.soundness.overlap
    }

    /// The tubes with what spoke against them.
    fn told_by(&self, mut other: AsTubes) -> AsTubes {
        for tube in &mut other.tubes.drafts {
            let evidence = KindEvidence {
                width_in_radii: Some(self.width_in_radii),
                sheet_overlap: Some(self.soundness.overlap),
                ..tube.choices.kind.unwrap_or_default()
            };
            tube.choices.kind = Some(evidence);
        }
        other
    }

    /// As what is chosen, each told what spoke for it; `other`: the tubes that were not.
    fn chosen(self, other: Option<AsTubes>) -> Chosen {
        let of_tubes = other.as_ref().and_then(|other| other.tubes.drafts.first()?.choices.kind);
        let evidence = KindEvidence {
            width_in_radii: Some(self.width_in_radii),
            sheet_overlap: Some(self.soundness.overlap),
            tube_overlap: other.as_ref().map(|other| other.soundness.overlap),
            ..of_tubes.unwrap_or_default()
        };
        let mut figures = self.figures;
        if let Figures::Sheets { drafts, .. } = &mut figures {
            for draft in drafts.iter_mut().flatten() {
                draft.choices.kind = Some(evidence);
            }
        }
        Chosen { figures, soundness: self.soundness, tubes: other.map(|other| other.tubes) }
    }
}
