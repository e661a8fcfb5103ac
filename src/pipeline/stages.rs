//! The stages in their order, and nothing else.
//!
//! ```text
//! label of a volume, part by part
//!     │ mask ─────── solid/    a clean solid, isotropic, with a sub-voxel boundary
//!     │ distance ─── solid/    the depth of every voxel below its skin
//!     │ skeleton ─── medial/   thinned to the medial surface
//!     │ sheets ───── sheets/   clustered into single sheets
//!     │ isomap ───── plane/    each laid flat, and cut where it cannot be
//!     │ sides ────── sides/    the skin labelled upper, lower and crest
//!     │ ┌ isomap ─── plane/    in its frame, with its sides
//!     │ │ lattice ── lattice/  a lattice over it; of what has no sheet, the wall of a tube (tubes/)
//!     │ └ spokes ─── vectors/  back in space, with vectors to both sides      (for each sheet)
//!     ▼ quality ──── quality/  legality, fit to the label as it was sent, verdict    (for all parts together)
//! figures, in work space; hand_out.rs brings them to the world
//! ```
//!
//! Where the figures do not stand for the solid, it is divided (division/), and portions go through the boxes again.
//!
//! The boxes are those of the paper's figure 2, but for the last. Each stage is a function of what came before it and the
//! [`Context`]; where it leaves the paper, the head of its folder says why.

use super::context::{Context, Part};
use super::cutting::{Rings, laid_flat};
use super::division::{Division, divided};
use super::draft::{AnyDraft, Draft};
use super::hand_out::hand_out;
use super::lattice::lattices;
use super::medial::{MedialSurface, medial_surface};
use super::plane::{Framed, framed};
use super::quality::{Answered, quality};
use super::sheets::{Joining, Sheets, sheets};
use super::sides::{SheetSides, sides};
use super::solid::changes::Changes;
use super::solid::cut_out::{Label, refuse_background};
use super::solid::depth::{Depth, SkinPoint, depth};
use super::solid::parts::{Sent, SentPart};
use super::solid::{Masked, Solid, masked};
use super::tubes::{TubeDraft, Tubes};
use super::vectors::rim::shares::{Share, Shares};
use super::vectors::vectors;
use super::{PipelineError, plane::Flat};
use crate::model::{LabelPart, Refusal, Stage, Structure};
use crate::space::LabelVolume;

/// What the stages made of one part of a label.
pub(super) struct Worked {
    /// Which part.
    pub part: usize,
    pub solid: Solid,
    pub changes: Changes,
    pub skin: Vec<SkinPoint>,
    pub division: Division,
}

/// The figures of a part.
pub(super) enum Figures {
    /// Its sheets, each with its figure if it has one.
    Sheets { sheets: Sheets, sides: Vec<SheetSides>, drafts: Vec<Option<Draft>> },
    /// All of it are tubes.
    Tubes(Tubes),
}

impl Figures {
    /// In their order.
    pub fn drafts(&self) -> Vec<AnyDraft<'_>> {
        match self {
            Self::Sheets { drafts, .. } => drafts.iter().flatten().map(AnyDraft::Sheet).collect(),
            Self::Tubes(tubes) => tubes.drafts.iter().map(AnyDraft::Tube).collect(),
        }
    }

    /// Those that are marked, of all in their order.
    pub fn only(&self, is_kept: &[bool]) -> Self {
        match self {
            Self::Sheets { sheets, sides, drafts } => {
                let (mut kept, mut number) = (drafts.clone(), 0);
                for draft in &mut kept {
                    if draft.is_some() {
                        *draft = draft.take().filter(|_| is_kept[number]);
                        number += 1;
                    }
                }
                Self::Sheets { sheets: sheets.clone(), sides: sides.clone(), drafts: kept }
            }
            Self::Tubes(tubes) => Self::Tubes(tubes.only(is_kept)),
        }
    }

    /// The same on the lattices that are asked for.
    pub fn into_asked(self) -> Self {
        match self {
            Self::Sheets { sheets, sides, drafts } => {
                let drafts = drafts.into_iter().map(|draft| draft.map(Draft::into_asked)).collect();
                Self::Sheets { sheets, sides, drafts }
            }
            Self::Tubes(Tubes { drafts, forks }) => {
                Self::Tubes(Tubes { drafts: drafts.into_iter().map(TubeDraft::into_asked).collect(), forks })
            }
        }
    }

    /// How many sheets were pruned.
    pub fn pruned(&self) -> usize {
        match self {
            Self::Sheets { sheets, .. } => sheets.pruned,
            Self::Tubes(_) => 0,
        }
    }
}

impl<'a> From<&'a Worked> for Answered<'a> {
    fn from(worked: &'a Worked) -> Self {
        let (mut drafts, mut skins, mut pruned) = (Vec::new(), Vec::new(), 0);
        for group in &worked.division.groups {
            drafts.extend(group.figures.drafts());
            skins.resize(drafts.len(), &group.skin[..]);
            pruned += group.figures.pruned();
        }
        Self {
            part: worked.part,
            solid: &worked.solid,
            skin: &worked.skin,
            changes: &worked.changes,
            drafts,
            skins,
            pruned,
        }
    }
}

/// Runs all stages on a label, part by part, and notes in `structure` what they find, as far as they come.
///
/// # Errors
/// When no part of it has a medial representation, with the reason of the largest, or the run is cancelled.
pub fn stages(
    volume: &LabelVolume,
    label: Label,
    context: &Context<'_>,
    structure: &mut Structure,
) -> Result<(), PipelineError> {
    let sent = context.stage(Stage::Mask, || sent(volume, label, context))?;
    structure.grain_mm = sent.grain_mm;
    let mut all = Vec::new();
    for (number, part) in sent.parts.iter().enumerate() {
        let outcome = on_part(part, Part { number, of: sent.parts.len() }, context, structure)?;
        let refusal = outcome.as_ref().err().cloned();
        structure.parts.push(LabelPart { voxels: stored(part, &sent), refusal, ..LabelPart::default() });
        all.extend(outcome);
    }
    let refused = structure.parts.first().and_then(|largest| largest.refusal.clone());
    if let (true, Some(refusal)) = (all.is_empty(), refused) {
        return Err(refusal.into());
    }
    let measured = context.stage(Stage::Quality, || {
        let answered: Vec<Answered<'_>> = all.iter().map(Answered::from).collect();
        quality(&sent, &answered, context)
    })?;
    hand_out(all, measured, structure);
    Ok(())
}

/// The label, unless it is no object.
fn sent(volume: &LabelVolume, label: Label, context: &Context<'_>) -> Result<Sent, PipelineError> {
    refuse_background(volume, label)?;
    Ok(Sent::of(volume, label, context)?)
}

/// How many voxels of the file a part has.
fn stored(part: &SentPart, sent: &Sent) -> u64 {
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a count of voxels that are in memory")]
    let voxels = (part.voxels as f64 * sent.stored_voxels).round() as u64;
    voxels
}

/// What the stages make of a part, or why they make nothing of it. Of several parts, one that is refused is told as
/// a warning.
fn on_part(
    part: &SentPart,
    Part { number, of }: Part,
    context: &Context<'_>,
    structure: &mut Structure,
) -> Result<Result<Worked, Refusal>, PipelineError> {
    let own = context.of_part(number);
    let outcome = worked(part, number, &own, structure);
    let name = (of > 1).then(|| format!("part {number}"));
    context.take_in(own.into_notes(), name.as_deref());
    match outcome {
        Ok(worked) => Ok(Ok(worked)),
        Err(PipelineError::Refused(refusal)) => {
            if of > 1 {
                let message = format!("part {number}, of {} voxels, has no figures: {refusal}", part.voxels);
                context.warn("part_refused", message);
            }
            Ok(Err(refusal))
        }
        Err(stop) => Err(stop),
    }
}

/// All stages of one part but the last. Its outer surface is noted even if it is refused after that.
fn worked(
    part: &SentPart,
    number: usize,
    context: &Context<'_>,
    structure: &mut Structure,
) -> Result<Worked, PipelineError> {
    part.refuse_fragment()?;
    let Masked { solid, object, changes } = context.stage(Stage::Mask, || masked(&part.native, context))?;
    structure.object.append(object);
    if structure.working_voxel_mm == 0.0 {
        structure.working_voxel_mm = solid.working_voxel_mm;
    }
    let depth = context.stage(Stage::Distance, || depth(&solid, context))?;
    let surface = context.stage(Stage::Skeleton, || medial_surface(&solid, &depth, context))?;
    // From here on lengths count in grains.
    let grain = solid.voxels_per_grain;
    let (solid, depth, surface) = (solid.in_units(grain), depth.in_units(grain), surface.in_units(grain));
    let skin = depth.skin.clone();
    let division = divided(&solid, depth, surface, context)?;
    Ok(Worked { part: number, solid, changes, skin, division })
}

/// How sheets are found and laid.
#[derive(Clone, Copy, Debug)]
pub(super) struct Ways {
    pub joining: Joining,
    pub rings: Rings,
}

/// The sheets of a solid.
///
/// # Errors
/// When its main sheet has no figure; when it is cancelled.
pub(super) fn sheet_figures(
    solid: &Solid,
    depth: &Depth,
    surface: &MedialSurface,
    ways: Ways,
    context: &Context<'_>,
) -> Result<Figures, PipelineError> {
    let sheets = context.stage(Stage::Sheets, || sheets(surface, solid, depth, ways.joining, context))?;
    let laid = context.stage(Stage::Isomap, || laid_flat(surface, sheets, solid, ways.rings, context))?;
    let sides = context.stage(Stage::Sides, || sides(solid, depth, surface, &laid.sheets, context))?;
    let drafts = drafts(solid, depth, &sides, laid.flat, context)?;
    Ok(Figures::Sheets { sheets: laid.sheets, sides, drafts })
}

/// The figure of every sheet. A secondary sheet that has none is left out with a warning; without the main
/// one there is no answer.
fn drafts(
    solid: &Solid,
    depth: &Depth,
    sheets: &[SheetSides],
    flat: Vec<Option<Flat>>,
    context: &Context<'_>,
) -> Result<Vec<Option<Draft>>, PipelineError> {
    let shares = Shares::of(sheets, context)?;
    let mut drafts = Vec::new();
    for (number, (sheet, flat)) in sheets.iter().zip(flat).enumerate() {
        let part = Part { number, of: sheets.len() };
        match draft(solid, depth, (sheet, flat, &shares), part, context) {
            Ok(draft) => drafts.push(Some(draft)),
            Err(PipelineError::Refused(refusal)) if number > 0 => {
                context.warn("sheet_left_out", format!("sheet {number} was left out: {refusal}"));
                drafts.push(None);
            }
            Err(stop) => return Err(stop),
        }
    }
    Ok(drafts)
}

/// The stages of one sheet. Where its lattice is asked for, it comes with another one that follows its shape, which is the one to
/// choose by: else what figures a solid has would change with the lattice.
fn draft(
    solid: &Solid,
    depth: &Depth,
    (sheet, flat, shares): (&SheetSides, Option<Flat>, &Shares),
    part: Part,
    context: &Context<'_>,
) -> Result<Draft, PipelineError> {
    let framed = context.part_of_stage(Stage::Isomap, part, || framed(solid, sheet, flat, part.number, context))?;
    let own = (sheet, Share { shares, number: part.number });
    let Some(params) = context.params_of_shape() else { return laid(solid, depth, own, framed, part, context) };
    let by_shape = context.with_params(&params);
    let chosen = laid(solid, depth, own, framed.clone(), part, &by_shape);
    context.take_in(by_shape.into_notes().without_warnings(), None);
    let asked = laid(solid, depth, own, framed, part, context)?;
    Ok(Draft { asked: Some(Box::new(asked)), ..chosen? })
}

/// A sheet on the lattice that the parameters say.
fn laid(
    solid: &Solid,
    depth: &Depth,
    own: (&SheetSides, Share<'_>),
    framed: Framed,
    part: Part,
    context: &Context<'_>,
) -> Result<Draft, PipelineError> {
    let laid =
        context.part_of_stage(Stage::Lattice, part, || lattices(solid, depth, own.0, &framed, part.number, context))?;
    let (choices, laid) = laid;
    let (nodes, repair) =
        context.part_of_stage(Stage::Spokes, part, || vectors(solid, depth, own, &framed.flat, laid, context))?;
    let Framed { flat, distortion, frame } = framed;
    Ok(Draft { nodes, flat, distortion, frame, choices, repair, asked: None })
}
