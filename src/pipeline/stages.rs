//! The stages in their order, and nothing else.
//!
//! ```text
//! label of a volume
//!     │ mask ─────── solid/    a clean solid, isotropic, with a sub-voxel boundary
//!     │ distance ─── solid/    the depth of every voxel below its skin
//!     │ skeleton ─── medial/   thinned to the medial surface
//!     │ sheets ───── sheets/   clustered into single sheets
//!     │ isomap ───── plane/    each laid flat, and cut where it cannot be
//!     │ sides ────── sides/    the skin labelled upper, lower and crest
//!     │ ┌ isomap ─── plane/    in its frame, with its sides
//!     │ │ lattice ── lattice/  a lattice over it
//!     │ └ spokes ─── vectors/  back in space, with vectors to both sides      (for each sheet)
//!     ▼ quality ──── quality/  legality, fit, verdict
//! figures, in work space; hand_out.rs brings them to the world
//! ```
//!
//! The boxes are those of the paper's figure 2, but for the last. Each stage is a function of what came before it and the
//! [`Context`]; where it leaves the paper, the head of its folder says why.

use super::context::{Context, Part};
use super::draft::Draft;
use super::hand_out::hand_out;
use super::lattice::lattices;
use super::medial::medial_surface;
use super::plane::cut::laid_flat;
use super::plane::{Framed, framed};
use super::quality::quality;
use super::sheets::sheets;
use super::sides::{SheetSides, sides};
use super::solid::cut_out::Label;
use super::solid::depth::{Depth, depth};
use super::solid::{Masked, Solid, masked};
use super::vectors::shares::{Share, Shares};
use super::vectors::vectors;
use super::{PipelineError, plane::Flat};
use crate::model::{Stage, Structure};
use crate::space::LabelVolume;

/// Runs all stages on a label and notes in `structure` what they find, as far as they come.
///
/// # Errors
/// When the shape has no medial representation, or the run is cancelled.
pub fn stages(
    volume: &LabelVolume,
    label: Label,
    context: &Context<'_>,
    structure: &mut Structure,
) -> Result<(), PipelineError> {
    let Masked { solid, object } = context.stage(Stage::Mask, || masked(volume, label, context))?;
    structure.object = object;
    structure.working_voxel_mm = solid.voxel_mm;
    let depth = context.stage(Stage::Distance, || depth(&solid, context))?;
    let surface = context.stage(Stage::Skeleton, || medial_surface(&solid, &depth, context))?;
    let sheets = context.stage(Stage::Sheets, || sheets(&surface, &solid, &depth, context))?;
    let laid = context.stage(Stage::Isomap, || laid_flat(&surface, sheets, &solid, context))?;
    let sides = context.stage(Stage::Sides, || sides(&solid, &depth, &surface, &laid.sheets, context))?;
    let drafts = drafts(&solid, &depth, &sides, laid.flat, context)?;
    let measured = context.stage(Stage::Quality, || quality(&solid, &depth, &drafts, laid.sheets.pruned, context))?;
    hand_out(&solid, &surface, &laid.sheets, (&sides, &drafts), measured, structure);
    Ok(())
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

/// The stages of one sheet.
fn draft(
    solid: &Solid,
    depth: &Depth,
    (sheet, flat, shares): (&SheetSides, Option<Flat>, &Shares),
    part: Part,
    context: &Context<'_>,
) -> Result<Draft, PipelineError> {
    let framed = context.part_of_stage(Stage::Isomap, part, || framed(solid, sheet, flat, part.number, context))?;
    let laid =
        context.part_of_stage(Stage::Lattice, part, || lattices(solid, depth, sheet, &framed, part.number, context))?;
    let (choices, laid) = laid;
    let own = (sheet, Share { shares, number: part.number });
    let (nodes, repair) =
        context.part_of_stage(Stage::Spokes, part, || vectors(solid, depth, own, &framed.flat, laid, context))?;
    let Framed { flat, distortion, frame } = framed;
    Ok(Draft { nodes, flat, distortion, frame, choices, repair })
}
