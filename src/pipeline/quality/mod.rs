//! Stage `quality`, which the paper has not: how far a result can be trusted. Everything is measured on the nodes that are
//! handed out, against the label as it was sent: all its voxels, whatever was dropped, filled or smoothed away.
//!
//! 1. Legality of every cell and wedge ([`legality`]) and self-intersections of the closed surface.
//! 2. Fit: the solid that they fill against the label (`coverage`), each part and figure against its share of it
//!    (`owners`). Figures of several parts are compared in one space (`placed`).
//! 3. Evenness of the lattice, and what its plane does to areas and angles (`measures`).
//! 4. How well centred the medial nodes are (`centring`), and whether vectors stay in the label (`outside`).
//! 5. What became of the label's voxels (`kept`).
//! 6. Of all figures of a structure, sums and the worst (`sums`).
//! 7. The verdict, from a table of thresholds (`verdict`).

mod placed;

mod coverage;

pub(in crate::pipeline) mod overlap;

pub(in crate::pipeline) mod fill;

mod owners;

mod samples;

mod skin_search;

pub mod measures;

mod centring;

mod outside;

mod kept;

mod sums;

pub mod verdict;

use nalgebra::Point3;

use crate::cancel::{Cancel, Cancelled};
use crate::model::{
    Body, Coverage, EmbeddingQuality, FigurePatches, FigureQuality, LatticePlace, PerSurface, Repair, Shell,
    StructureQuality, WorldPlace,
};
use crate::pipeline::context::Context;
use crate::pipeline::draft::{AnyDraft, Draft};
use crate::pipeline::plane::Flat;
use crate::pipeline::plane::tangents::PlaneDistortion;
use crate::pipeline::quality::centring::{medial_offset, tube_offset};
use crate::pipeline::quality::coverage::coverage;
use crate::pipeline::quality::kept::{kept, kept_share};
use crate::pipeline::quality::measures::{FlatQuads, spacing_variation, tube_spacing, wall_distortion};
use crate::pipeline::quality::outside::outside_share;
use crate::pipeline::quality::placed::placed;
use crate::pipeline::quality::skin_search::SkinSearch;
use crate::pipeline::quality::sums::summed;
use crate::pipeline::quality::verdict::{Places, judge};
use crate::pipeline::solid::Solid;
use crate::pipeline::solid::changes::Changes;
use crate::pipeline::solid::depth::SkinPoint;
use crate::pipeline::solid::parts::Sent;
use crate::pipeline::tubes::{self, TubeDraft};
use crate::pipeline::vectors::legality::{Illegal, Part, legality};

/// A part of a label that has figures, as it is measured.
pub struct Answered<'a> {
    /// Which part of the label.
    pub part: usize,
    /// Its solid.
    pub solid: &'a Solid,
    /// Its skin.
    pub skin: &'a [SkinPoint],
    /// What the solid lost and gained.
    pub changes: &'a Changes,
    /// Its figures.
    pub drafts: Vec<AnyDraft<'a>>,
    /// The skin of the portion of the solid that each of them stands for.
    pub skins: Vec<&'a [SkinPoint]>,
    /// Sheets that were pruned.
    pub pruned: usize,
}

/// How far the figures of a structure can be trusted, and the structure itself.
#[derive(Clone, Debug, Default)]
pub struct Measured {
    /// Of every figure.
    pub figures: Vec<FigureQuality>,
    /// Of every answered part: the share of its voxels that its figures stand for, and how well they fit it.
    pub parts: Vec<(f64, Coverage)>,
    /// Of all together.
    pub structure: StructureQuality,
}

/// Measures every figure by itself and against the label, and judges the structure. Of a repeat only the vectors
/// are wanted: nothing is measured.
///
/// # Errors
/// When it is cancelled.
pub fn quality(sent: &Sent, parts: &[Answered<'_>], context: &Context<'_>) -> Result<Measured, Cancelled> {
    if context.repeat.is_some() || parts.is_empty() {
        return Ok(Measured::default());
    }
    let (mut figures, mut patches, mut places) = (Vec::new(), Vec::new(), Places::default());
    for (number, answered) in parts.iter().enumerate() {
        add_figures(answered, (&mut figures, &mut patches), &mut places, context)?;
        context.advance(0.5 * (number + 1) as f64 / parts.len() as f64);
    }
    let placed = placed(parts, patches, &sent.whole);
    for (quality, figure) in figures.iter_mut().zip(&placed) {
        quality.outside_share = outside_share(&sent.whole.mask, figure, context)?;
    }
    let numbers: Vec<usize> = parts.iter().map(|answered| answered.part).collect();
    let unanswered = sent.surface_outside(&numbers, context)?;
    let fits = coverage(&sent.whole, parts, &placed, &unanswered, context)?;
    for (quality, coverage) in figures.iter_mut().zip(fits.figures) {
        quality.coverage = coverage;
    }
    places.fit = fits.worst;
    let mut structure = StructureQuality { coverage: fits.whole, worst_place: fits.worst, ..summed(&figures) };
    structure.kept = kept(sent, parts, &unanswered, &mut places);
    structure.pruned_sheets = parts.iter().map(|answered| answered.pruned).sum();
    if structure.pruned_sheets > 0 {
        let message = format!("{} small branches of the skeleton were pruned", structure.pruned_sheets);
        context.warn("branches_pruned", message);
    }
    judge(&mut structure, &figures, parts[0].solid.unit_mm, &places);
    let shares = parts.iter().map(|answered| kept_share(sent, answered));
    Ok(Measured { parts: shares.zip(fits.parts).collect(), figures, structure })
}

/// Adds what can be said of the figures of a part without the others, and where they are worst.
fn add_figures(
    answered: &Answered<'_>,
    (figures, all_patches): (&mut Vec<FigureQuality>, &mut Vec<FigurePatches>),
    places: &mut Places,
    cancel: &dyn Cancel,
) -> Result<(), Cancelled> {
    let mut skin = SkinSearch::of(answered.skin, cancel)?;
    let mut of_portion = answered.skin;
    for (draft, own) in answered.drafts.iter().zip(&answered.skins) {
        if !std::ptr::eq(*own, of_portion) {
            skin = SkinSearch::of(own, cancel)?;
            of_portion = own;
        }
        let (mut quality, patches) = match draft {
            AnyDraft::Sheet(draft) => figure_quality(draft, cancel)?,
            AnyDraft::Tube(draft) => tube_quality(draft, cancel)?,
        };
        let (offset, furthest) = match draft {
            AnyDraft::Sheet(draft) => medial_offset(&draft.nodes, &skin, cancel)?,
            AnyDraft::Tube(draft) => tube_offset(draft),
        };
        quality.medial_offset = offset;
        let place = |node: usize| WorldPlace {
            figure: Some(figures.len()),
            position: answered.solid.world_from_work.point(medial_node(*draft, node)),
        };
        if figures.iter().all(|other| other.medial_offset.p95 < offset.p95) {
            places.offset = furthest.map(place);
        }
        places.folded = places.folded.or(first_fold(&quality, *draft).map(place));
        figures.push(quality);
        all_patches.push(patches);
    }
    Ok(())
}

/// Where a node of the medial set lies.
fn medial_node(draft: AnyDraft<'_>, node: usize) -> Point3<f64> {
    match draft {
        AnyDraft::Sheet(draft) => draft.nodes.medial[node],
        AnyDraft::Tube(draft) => draft.nodes.centres[node % draft.nodes.size.cols],
    }
}

/// The node of the first part that is turned over.
fn first_fold(quality: &FigureQuality, draft: AnyDraft<'_>) -> Option<usize> {
    match draft {
        AnyDraft::Sheet(draft) => {
            let at = quality.folded_cells.first().or(quality.folded_wedges.first())?;
            Some(at.i * draft.nodes.size.cols + at.j)
        }
        AnyDraft::Tube(draft) => quality.folded_prisms.first().map(|[i, j]| i * draft.nodes.size.cols + j),
    }
}

/// What can be said of a tube by itself.
///
/// # Errors
/// When it is cancelled.
fn tube_quality(draft: &TubeDraft, cancel: &dyn Cancel) -> Result<(FigureQuality, FigurePatches), Cancelled> {
    let legality = tubes::legality::legality(&draft.nodes);
    let (patches, self_intersections) = FigurePatches::of(Body::Tube(draft.into()), cancel)?;
    let quality = FigureQuality {
        folds: legality.folds,
        corners: legality.corners,
        folded_prisms: legality.wedges.iter().map(|wedge| [wedge.row, wedge.col]).collect(),
        repair: draft.repair,
        self_intersections,
        spacing_variation: tube_spacing(&draft.nodes),
        distortion: wall_distortion(&draft.nodes, &draft.intrinsic),
        valid_share: 1.0,
        ..FigureQuality::default()
    };
    Ok((quality, patches))
}

/// What can be said of a sheet by itself: legality of its parts, evenness of its lattice, and the smooth surfaces through
/// its nodes. How they fit the mask is added by [`quality`].
///
/// # Errors
/// When it is cancelled.
pub fn figure_quality(draft: &Draft, cancel: &dyn Cancel) -> Result<(FigureQuality, FigurePatches), Cancelled> {
    let Draft { nodes, flat, distortion, repair, .. } = draft;
    let (quads, repair) = (FlatQuads::from(nodes), *repair);
    let embedding = PerSurface {
        medial: embedding_quality(&flat.medial, distortion.medial),
        upper: embedding_quality(&flat.upper, distortion.upper),
        lower: embedding_quality(&flat.lower, distortion.lower),
    };
    let shell = Shell::from(nodes);
    let legality = legality(shell);
    let (patches, self_intersections) = FigurePatches::of(Body::Sheet(shell), cancel)?;
    let is_untouched = repair.moved_nodes + repair.marred_nodes + repair.past_foot_nodes == 0;
    let quality = FigureQuality {
        embedding,
        folds: legality.folds,
        corners: legality.corners,
        folded_cells: places(&legality.parts, Part::Cell),
        folded_centres: legality.folded_centres,
        folded_wedges: places(&legality.parts, Part::Wedge),
        repair: if is_untouched { Repair { folds_before: legality.folds, ..repair } } else { repair },
        self_intersections,
        spacing_variation: spacing_variation(nodes.size, &nodes.medial),
        distortion: quads.distortion(),
        valid_share: nodes.valid.iter().filter(|v| **v).count() as f64 / nodes.valid.len().max(1) as f64,
        ..FigureQuality::default()
    };
    Ok((quality, patches))
}

/// How truly a surface was laid flat; `None` of a side that takes its coordinates from the sheet.
fn embedding_quality(flat: &Flat, distortion: Option<PlaneDistortion>) -> Option<EmbeddingQuality> {
    let embedded = flat.embedded?;
    Some(EmbeddingQuality {
        residual_variance: embedded.residual_variance,
        turned_over: distortion.map(|distortion| distortion.turned_over),
        angle_error_deg: distortion.map(|distortion| distortion.angle_error_deg),
        unrolled: embedded.unrolled,
    })
}

/// Where the parts of a kind among illegal ones are.
fn places(parts: &[Illegal], kind: Part) -> Vec<LatticePlace> {
    parts.iter().filter(|illegal| illegal.part == kind).map(|illegal| illegal.place).collect()
}
