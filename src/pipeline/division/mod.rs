//! A solid for which its sheets, or its tubes, do not stand well is divided, and each portion gets figures of its own.
//!
//! 1. What figures leave over is a portion (`remainders`): the wing of a bone whose shaft is a tube.
//! 2. Where the figures of a solid are not sound (vectors cross, many nodes are spoilt, or little of it is filled), those of them
//!    that are stay, and the rest is a portion; or the tubes that were not taken do so;
//! 3. or it is cut in two where it is narrowest (`halves`), as is what has no figures at all.
//!
//! Whichever stands best for the solid is taken. Portions are divided in the same way, a few levels deep. They meet where the
//! cut is (`joints`). The paper represents an object by the sheets of its skeleton and has no such step.

mod halves;

mod joints;

mod remainders;

use std::cell::Cell;

use self::halves::halves;
pub(super) use self::joints::Joint;
use self::joints::joints;
use self::remainders::remainders;
use super::PipelineError;
use super::choice::{Chosen, figures};
use super::context::{Context, Notes};
use super::draft::AnyDraft;
use super::medial::{MedialSurface, medial_surface};
use super::sheets::loss_needed;
use super::solid::Solid;
use super::solid::depth::{Depth, SkinPoint};
use super::soundness::{Soundness, is_sound};
use super::stages::Figures;
use crate::cancel::Cancelled;
use crate::model::{Refusal, Stage, Warning};
use crate::params::Prune;
use crate::space::Grid;

/// Share of a part's volume from which a portion has figures of its own, or as much more as `prune` says that a sheet must account for.
const LEAST_SHARE: f64 = 0.02;
/// The same in cubic grains: the smallest ribs that have a tube have 140. Of 16 labels of a torso that are divided, none changes
/// with 30, and an arch with 120 (overlap of L4 0.876, not 0.878).
const LEAST_VOLUME: f64 = 60.0;
/// Dice with its own voxels from which figures stand for a portion. From 0.3 to 0.7 none of the 16 changes.
const OWN_OVERLAP: f64 = 0.5;
/// The same from which portions stand for what has no figures as a whole: one half of a ring alone has 0.67.
const INSTEAD_OVERLAP: f64 = 0.7;
/// How often a portion may be divided again. With 2, an L1 has an overlap of 0.82, not 0.89, and a liver fails; with 1, four of the 16
/// more fail; with 4 nothing changes.
const MOST_LEVELS: usize = 3;
/// Portions that are tried for a part at the most. A sacrum tries 22, vertebrae up to 13; from 20 on nothing changes, with 10 an
/// L1 has 0.80, not 0.89.
const MOST_PORTIONS: usize = 40;
/// Tunnels of a solid up to which it is divided. A sacrum has 10, all other labels of a torso 3 at the most; a sponge of 259
/// takes 266 s when it is divided, and 17 s when not.
const MOST_TUNNELS: i64 = 60;

/// Figures of a solid or of a portion of it, and what they were found in.
pub(super) struct Group {
    /// The skin of the portion.
    pub skin: Vec<SkinPoint>,
    pub surface: MedialSurface,
    pub figures: Figures,
    warnings: Vec<Warning>,
}

/// The groups of figures of a solid, and where they meet.
pub(super) struct Division {
    pub groups: Vec<Group>,
    pub joints: Vec<Joint>,
}

/// The figures of a solid, portion by portion.
///
/// # Errors
/// When neither it nor portions of it have figures; when it is cancelled.
pub(super) fn divided(
    solid: &Solid,
    depth: Depth,
    surface: MedialSurface,
    context: &Context<'_>,
) -> Result<Division, PipelineError> {
    let params = context.params;
    let voxels = solid.inside.as_slice().iter().filter(|is_in| **is_in).count() as f64;
    let share = match params.prune {
        Prune::Auto => LEAST_SHARE,
        Prune::Strength(_) => loss_needed(params.prune).max(LEAST_SHARE),
    };
    let least = (share * voxels).max(LEAST_VOLUME * solid.voxels_per_grain.powi(3));
    let most_levels = if params.are_of_paper() || solid.tunnels > MOST_TUNNELS { 0 } else { MOST_LEVELS };
    let divider = Divider { context, least, most_levels, portions: Cell::new(MOST_PORTIONS) };
    let mut groups = Vec::new();
    for group in divider.ways(solid, (depth, surface), Place { level: 0, before: 0 })?.groups {
        groups.push(Group { figures: group.figures.into_asked(), ..group });
    }
    let joints = joints(solid, &groups, context)?;
    divider.tell(&groups);
    Ok(Division { groups, joints })
}

/// Which portion it is.
#[derive(Clone, Copy)]
struct Place {
    /// How often the solid was divided.
    level: usize,
    /// Figures of the part before its own.
    before: usize,
}

/// One way to represent a solid.
struct Way {
    groups: Vec<Group>,
    soundness: Soundness,
}

/// Divides solids.
struct Divider<'a> {
    context: &'a Context<'a>,
    /// Voxels of a portion at the least.
    least: f64,
    /// How often a portion may be divided again.
    most_levels: usize,
    /// Portions that may still be tried.
    portions: Cell<usize>,
}

impl Divider<'_> {
    /// The best way to represent a solid.
    fn ways(
        &self,
        solid: &Solid,
        (depth, surface): (Depth, MedialSurface),
        place: Place,
    ) -> Result<Way, PipelineError> {
        let own = self.context.of_rest(place.before);
        let found = figures(solid, &depth, &surface, &own);
        let notes = own.into_notes();
        self.take_time(&notes);
        let chosen = match found {
            Ok(chosen) => chosen,
            Err(PipelineError::Refused(refusal)) => return self.cut_instead(solid, refusal, place),
            Err(stop) => return Err(stop),
        };
        let Chosen { figures, soundness, tubes } = chosen;
        let mut others = vec![without_unsound(&figures)];
        others.extend(tubes.map(|tubes| {
            let tubes = Figures::Tubes(tubes);
            without_unsound(&tubes).or(Some(tubes))
        }));
        let group = |figures| Group {
            skin: depth.skin.clone(),
            surface: surface.clone(),
            figures,
            warnings: notes.warnings.clone(),
        };
        let mut best = self.with_remainders(solid, vec![group(figures)], Some(soundness), place)?;
        if best.soundness.is_sound() || place.level >= self.most_levels {
            return Ok(best);
        }
        for figures in others.into_iter().flatten() {
            if best.soundness.is_sound() {
                return Ok(best);
            }
            let other = self.with_remainders(solid, vec![group(figures)], None, place)?;
            best = better(best, other);
        }
        if !best.soundness.is_sound()
            && let Some(other) = self.cut(solid, place)?
        {
            best = better(best, other);
        }
        Ok(best)
    }

    /// What is refused as it is, cut.
    fn cut_instead(&self, solid: &Solid, refusal: Refusal, place: Place) -> Result<Way, PipelineError> {
        let may_be_cut = place.level < self.most_levels && self.may_be_cut(&refusal);
        let cut = if may_be_cut { self.cut(solid, place)? } else { None };
        let stands = |way: &Way| way.soundness.is_legal && way.soundness.overlap >= INSTEAD_OVERLAP;
        cut.filter(stands).ok_or_else(|| refusal.into())
    }

    /// Whether halves of what is refused may have figures. A Möbius band cut in two would look like a band that is none, and of a
    /// ball that is to be a sheet nothing better is made.
    fn may_be_cut(&self, refusal: &Refusal) -> bool {
        match refusal {
            Refusal::SheetHasHoles { .. } => true,
            Refusal::Ball { .. } | Refusal::Tube { .. } | Refusal::NoTube | Refusal::TooSmall { .. } => {
                self.context.params.kinds.may_be_tubes()
            }
            _ => false,
        }
    }

    /// A solid cut in two.
    fn cut(&self, solid: &Solid, place: Place) -> Result<Option<Way>, Cancelled> {
        if self.portions.get() == 0 {
            return Ok(None);
        }
        let pieces = halves(solid, self.least, self.context)?;
        // Without a figure for each, what is left out would be no remainder but a part of the solid.
        if place.before + pieces.len() > self.most_figures() {
            return Ok(None);
        }
        let mut groups = Vec::new();
        for marked in pieces {
            self.add_portion(solid, &marked, &mut groups, place)?;
        }
        if groups.is_empty() { Ok(None) } else { self.with_remainders(solid, groups, None, place).map(Some) }
    }

    /// Groups of figures with those of what they leave over. `known`: how well they stand for the solid without.
    fn with_remainders(
        &self,
        solid: &Solid,
        mut groups: Vec<Group>,
        known: Option<Soundness>,
        place: Place,
    ) -> Result<Way, Cancelled> {
        let before = groups.len();
        let is_legal = drafts(&groups).into_iter().all(AnyDraft::is_legal);
        // Where vectors cross, what is left over does not help.
        if is_legal && place.level < self.most_levels && self.portions.get() > 0 {
            for marked in remainders(solid, &drafts(&groups), self.least, self.context)? {
                self.add_portion(solid, &marked, &mut groups, place)?;
            }
        }
        let soundness = match known {
            Some(soundness) if groups.len() == before => soundness,
            _ => Soundness::of(solid, &drafts(&groups), self.context)?,
        };
        Ok(Way { groups, soundness })
    }

    /// Adds the figures of a portion, if they stand for it.
    fn add_portion(
        &self,
        solid: &Solid,
        marked: &Grid<bool>,
        groups: &mut Vec<Group>,
        place: Place,
    ) -> Result<(), Cancelled> {
        let Some(left) = self.portions.get().checked_sub(1) else { return Ok(()) };
        self.portions.set(left);
        let Some((portion, depth)) = solid.portion(marked, self.context)? else { return Ok(()) };
        let own = self.context.apart();
        let surface = own.stage(Stage::Skeleton, || medial_surface(&portion, &depth, &own))?;
        self.take_time(&own.into_notes());
        let grain = solid.voxels_per_grain;
        let (portion, depth, surface) = (portion.in_units(grain), depth.in_units(grain), surface.in_units(grain));
        let place = Place { level: place.level + 1, before: place.before + drafts(groups).len() };
        match self.ways(&portion, (depth, surface), place) {
            Ok(way) => {
                if way.stands() && place.before + drafts(&way.groups).len() <= self.most_figures() {
                    groups.extend(way.groups);
                }
                Ok(())
            }
            Err(PipelineError::Refused(_)) => Ok(()),
            Err(PipelineError::Cancelled(stop)) => Err(stop),
        }
    }

    /// Figures that a part may have.
    fn most_figures(&self) -> usize {
        self.context.params.max_figures.unwrap_or(usize::MAX)
    }

    /// Counts the time of what may not be used.
    fn take_time(&self, notes: &Notes) {
        self.context.take_in(notes.clone().without_warnings(), None);
    }

    /// Says what is to be known of the groups.
    fn tell(&self, groups: &[Group]) {
        for (number, group) in groups.iter().enumerate() {
            let name = (groups.len() > 1).then(|| format!("portion {number}"));
            self.context.take_in(Notes::of_warnings(group.warnings.clone()), name.as_deref());
        }
        if groups.len() > 1 {
            let counts: Vec<String> = groups.iter().map(|group| group.figures.drafts().len().to_string()).collect();
            let message = format!(
                "the figures found first do not stand for all of the object: it was divided into {} portions, of {} figures",
                groups.len(),
                counts.join(", ")
            );
            self.context.warn("divided", message);
        }
    }
}

impl Way {
    /// Whether figures stand for a portion better than nothing.
    fn stands(&self) -> bool {
        self.soundness.is_legal && self.soundness.overlap >= OWN_OVERLAP
    }
}

/// The better of two ways.
fn better(first: Way, second: Way) -> Way {
    if second.soundness.is_better_than(first.soundness) { second } else { first }
}

/// The figures of all groups in their order.
fn drafts(groups: &[Group]) -> Vec<AnyDraft<'_>> {
    let mut all = Vec::new();
    for group in groups {
        all.extend(group.figures.drafts());
    }
    all
}

/// Figures without those that are not sound; `None` where none is left, or none is missing.
fn without_unsound(figures: &Figures) -> Option<Figures> {
    let kept: Vec<bool> = figures.drafts().into_iter().map(is_sound).collect();
    let is_some_missing = kept.contains(&true) && kept.contains(&false);
    is_some_missing.then(|| figures.only(&kept))
}
