//! Sheets or a tube: which kind of figure stands for a part of a label.
//!
//! 1. Where the medial set is shorter or narrower than the solid is thick, or has no lattice, it is no sheet;
//! 2. where it is narrow or long, the sections of the tube say what it is: round ones are those of a tube;
//! 3. where the sheets are not sound (vectors cross, many nodes are spoilt, or little of the solid is filled), a tube takes
//!    their place that is sound and fills more.
//!
//! Of the ways to lay a sheet with one hole, whole or cut, the first one that is sound is taken.

use super::PipelineError;
use super::context::{Context, Notes};
use super::cutting::{RING, Rings};
use super::medial::MedialSurface;
use super::sheets::Joining;
use super::solid::Solid;
use super::solid::depth::Depth;
use super::soundness::{SOUND_OVERLAP, Soundness};
use super::stages::{Figures, Ways, sheet_figures};
use super::tubes::{TubeDraft, Tubes, tubes};
use crate::cancel::Cancelled;
use crate::model::{KindEvidence, Refusal, Stage};
use crate::numerics::stats::mean;

/// Length over twice the radius up to which what is nearly round is short: that of a ball, a bladder, a femoral head, which
/// have 1.5 to 2.1. Thalami have 2.4 to 2.5.
const SHORT: f64 = 2.25;
/// The same from which a tube is long: a femur has 4, a stomach 6. Between the two are thalami, which are either.
const LONG: f64 = 3.5;
/// The same from which it is so long that its sections may be flat: ribs have 9 to 34, caudates 7.
const VERY_LONG: f64 = 8.0;
/// Radius of the circle of a section's area over its inscribed radius up to which a long solid is a tube: an ellipse of
/// 2 by 1 has 1.41. It changes by less than 0.06 with the grid. Vessels have 1.04 to 1.16, stomach, duodenum and femur 1.2 to
/// 1.26, the muscles beside the spine 1.26 to 1.30; caudates and a supraspinatus, which are sheets, 1.35 and more.
const ROUND: f64 = 1.32;
/// The same of one that is not long, or whose sheet is narrow: 1.27 and 1.30 of a bladder, 1.20 and 1.35 of a femoral head.
const NEARLY_ROUND: f64 = 1.4;
/// The same of a very long one: ribs have 1.2 to 1.65, glutei 2.
const ROUND_OF_VERY_LONG: f64 = 1.66;
/// Width of the main sheet over its mean radius up to which it is narrow. It changes by half with the grid, thus it
/// decides nothing alone.
const NARROW: f64 = 1.7;
/// The same up to which a tube is tried at all: thalami have 1.5 to 2.2, bladders 1.3.
const MAY_BE_NARROW: f64 = 2.5;
/// Overlap from which sheets stay though the solid may be a tube as well: thalami have 0.956 and more.
const FILLS_WELL: f64 = 0.94;
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
        let (figures, soundness) = sheets_of(solid, depth, surface, context)?;
        return Ok(Chosen { figures, soundness, tubes: None });
    }
    if !kinds.may_be_sheets() {
        let tubes = as_tubes(solid, context)?.ok_or(Refusal::NoTube)?;
        return Ok(tubes.chosen());
    }
    let attempt = context.apart();
    let outcome = sheets_of(solid, depth, surface, &attempt);
    let sheets = match outcome {
        Ok((figures, soundness)) => Sheets::of(figures, soundness, solid),
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

/// The sheets of a solid, and how well they stand for it, laid in the first of these ways that suits it:
///
/// 1. rings whole, where there are, if that is sound;
/// 2. where sheets were left out that might be strips of a ring, these joined, if that makes a sound ring;
/// 3. rings cut, if that stands for it better.
fn sheets_of(
    solid: &Solid,
    depth: &Depth,
    surface: &MedialSurface,
    context: &Context<'_>,
) -> Result<(Figures, Soundness), PipelineError> {
    let attempt = |joining, rings| Attempt::of((solid, depth, surface), Ways { joining, rings }, context);
    let whole = attempt(Joining::Alone, Rings::Whole);
    if whole.is_stopped() || whole.is_sound_ring() {
        return whole.taken(context);
    }
    if whole.has_ring() {
        let cut = attempt(Joining::Alone, Rings::Cut);
        let [kept, other] = if whole.stands_as_well_as(&cut) { [whole, cut] } else { [cut, whole] };
        context.take_in(other.notes.without_warnings(), None);
        return kept.taken(context);
    }
    if whole.may_be_in_strips(solid) {
        let joined = attempt(Joining::Smooth, Rings::Whole);
        let [kept, other] = if joined.is_sound_ring() { [joined, whole] } else { [whole, joined] };
        context.take_in(other.notes.without_warnings(), None);
        return kept.taken(context);
    }
    whole.taken(context)
}

/// Sheets that were tried.
struct Attempt {
    found: Result<(Figures, Soundness), PipelineError>,
    notes: Notes,
}

impl Attempt {
    fn of((solid, depth, surface): (&Solid, &Depth, &MedialSurface), ways: Ways, context: &Context<'_>) -> Self {
        let own = context.apart();
        let figures = sheet_figures(solid, depth, surface, ways, &own);
        let found = figures.and_then(|figures| {
            let soundness = Soundness::of(solid, &figures.drafts(), context)?;
            Ok((figures, soundness))
        });
        Self { found, notes: own.into_notes() }
    }

    fn is_stopped(&self) -> bool {
        matches!(self.found, Err(PipelineError::Cancelled(_)))
    }

    fn has_ring(&self) -> bool {
        self.notes.tell_of(RING)
    }

    fn is_sound_ring(&self) -> bool {
        self.has_ring() && self.found.as_ref().is_ok_and(|(_, soundness)| soundness.is_sound())
    }

    /// Whether nothing speaks for another one instead.
    fn stands_as_well_as(&self, other: &Self) -> bool {
        match (&self.found, &other.found) {
            (Ok((_, own)), Ok((_, other))) => !other.is_better_than(*own),
            (Ok(_), Err(PipelineError::Refused(_))) => true,
            _ => false,
        }
    }

    /// Whether it may be a ring of which strips were left out: what is left fills the solid all the same.
    fn may_be_in_strips(&self, solid: &Solid) -> bool {
        /// Tunnels of a solid with one ring at the most: noise makes some more.
        const TUNNELS: i64 = 3;
        let fills = |(figures, soundness): &(Figures, Soundness)| figures.pruned() > 0 && soundness.fills();
        (1..=TUNNELS).contains(&solid.tunnels) && self.found.as_ref().is_ok_and(fills)
    }

    /// With what was noted.
    fn taken(self, context: &Context<'_>) -> Result<(Figures, Soundness), PipelineError> {
        context.take_in(self.notes, None);
        self.found
    }
}

/// A solid as tubes.
struct AsTubes {
    tubes: Tubes,
    soundness: Soundness,
}

/// A solid as tubes, in the better of the ways that there are. What has a lumen is none: its sections would be rings.
fn as_tubes(solid: &Solid, context: &Context<'_>) -> Result<Option<AsTubes>, Cancelled> {
    if solid.lumens > 0 {
        return Ok(None);
    }
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

/// What the sections of a tube say of a solid.
enum Sections {
    /// It is a tube.
    Tube,
    /// They are flat.
    Sheet,
    /// They are round, but it is not longer than it is wide.
    Either,
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
    fn of(figures: Figures, soundness: Soundness, solid: &Solid) -> Self {
        let drafts = figures.drafts();
        let width_in_radii = drafts.first().map_or(0.0, |main| {
            let radius_mm = mean(main.radii()).unwrap_or(0.0) * solid.unit_mm;
            main.choices().width_mm / radius_mm.max(f64::MIN_POSITIVE)
        });
        let aspect = drafts
            .first()
            .map_or(1.0, |main| main.choices().length_mm / main.choices().width_mm.max(f64::MIN_POSITIVE));
        Self { figures, width_in_radii, aspect, soundness }
    }

    /// Whether it is worth looking at the sections of a tube.
    fn may_be_of_tube(&self) -> bool {
        self.width_in_radii <= MAY_BE_NARROW || (self.width_in_radii <= MODERATE && self.aspect >= LONGISH)
    }

    /// Whether tubes stand better for the part than they do.
    fn yield_to(&self, other: &AsTubes) -> bool {
        if !other.soundness.is_legal {
            return false;
        }
        let kept_from = match &other.tubes.drafts[..] {
            [tube] => match self.said_by_sections(tube) {
                Sections::Tube => return true,
                Sections::Either => FILLS_WELL,
                Sections::Sheet => SOUND_OVERLAP,
            },
            _ => SOUND_OVERLAP,
        };
        let stay = self.soundness.spoils_few() && self.soundness.overlap >= kept_from;
        !stay && other.soundness.overlap > self.soundness.overlap
    }

    /// What the sections of the one tube say, which hardly change with the grid.
    fn said_by_sections(&self, tube: &TubeDraft) -> Sections {
        let elongation = tube.choices.kind.and_then(|evidence| evidence.elongation).unwrap_or(0.0);
        let is_long = elongation >= LONG;
        let is_short = elongation < SHORT;
        let roundness = match () {
            () if elongation >= VERY_LONG => ROUND_OF_VERY_LONG,
            () if is_long && self.width_in_radii > NARROW => ROUND,
            () => NEARLY_ROUND,
        };
        match () {
            () if tube.flatness > roundness => Sections::Sheet,
            () if is_long || is_short => Sections::Tube,
            () => Sections::Either,
        }
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
