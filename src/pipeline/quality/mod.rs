//! Stage `quality`, which the paper has not: how far a result can be trusted. Everything is measured on the nodes that are
//! handed out, against the mask on the working grid.
//!
//! 1. Legality of every cell and wedge ([`legality`]) and self-intersections of the closed surface.
//! 2. Fit: the solid that they fill against the mask (`coverage`), each figure against its share of it (`owners`).
//! 3. Evenness of the lattice, and what its plane does to areas and angles (`measures`).
//! 4. How well centred the medial nodes are (`centring`).
//! 5. Of all figures of a structure, sums and the worst (`sums`).
//! 6. The verdict, from a table of thresholds (`verdict`).

mod coverage;

mod overlap;

mod fill;

mod owners;

mod samples;

mod skin_search;

pub mod measures;

mod centring;

mod sums;

pub mod verdict;

use crate::cancel::{Cancel, Cancelled};
use crate::model::{
    EmbeddingQuality, FigureQuality, LatticePlace, PerSurface, Repair, Shell, StructureQuality, closed,
};
use crate::numerics::triangles::self_intersections;
use crate::pipeline::context::Context;
use crate::pipeline::draft::Draft;
use crate::pipeline::plane::Flat;
use crate::pipeline::plane::tangents::PlaneDistortion;
use crate::pipeline::quality::centring::medial_offset;
use crate::pipeline::quality::coverage::coverage;
use crate::pipeline::quality::measures::{FlatQuads, spacing_variation};
use crate::pipeline::quality::skin_search::SkinSearch;
use crate::pipeline::quality::sums::summed;
use crate::pipeline::quality::verdict::judge;
use crate::pipeline::solid::Solid;
use crate::pipeline::solid::depth::Depth;
use crate::pipeline::vectors::Nodes;
use crate::pipeline::vectors::legality::{Illegal, Part, legality};

/// How far the figures of a structure can be trusted, and the structure itself.
#[derive(Clone, Debug, Default)]
pub struct Measured {
    /// Of every figure.
    pub figures: Vec<FigureQuality>,
    /// Of all together.
    pub structure: StructureQuality,
}

/// Measures every figure by itself and against the mask, and judges the structure. Of a repeat only the vectors
/// are wanted: nothing is measured.
///
/// # Errors
/// When it is cancelled.
pub fn quality(
    solid: &Solid,
    depth: &Depth,
    drafts: &[Option<Draft>],
    pruned_sheets: usize,
    context: &Context<'_>,
) -> Result<Measured, Cancelled> {
    if context.repeat.is_some() {
        return Ok(Measured::default());
    }
    let mut measured = Measured::default();
    let drafts: Vec<&Draft> = drafts.iter().flatten().collect();
    for (number, draft) in drafts.iter().enumerate() {
        measured.figures.push(figure_quality(draft, context)?);
        context.advance(0.5 * (number + 1) as f64 / drafts.len() as f64);
    }
    let nodes: Vec<&Nodes> = drafts.iter().map(|draft| &draft.nodes).collect();
    measured.structure = structure_quality(solid, depth, &nodes, &mut measured.figures, context)?;
    measured.structure.pruned_sheets = pruned_sheets;
    if pruned_sheets > 0 {
        context.warn("branches_pruned", format!("{pruned_sheets} small branches of the skeleton were pruned"));
    }
    Ok(measured)
}

/// What can be said of a figure by itself: legality of its parts, evenness of its lattice. How
/// it fits the mask is added by [`quality`].
///
/// # Errors
/// When it is cancelled.
pub fn figure_quality(draft: &Draft, cancel: &dyn Cancel) -> Result<FigureQuality, Cancelled> {
    let Draft { nodes, flat, distortion, repair, .. } = draft;
    let (quads, repair) = (FlatQuads::from(nodes), *repair);
    let embedding = PerSurface {
        medial: embedding_quality(&flat.medial, distortion.medial),
        upper: embedding_quality(&flat.upper, distortion.upper),
        lower: embedding_quality(&flat.lower, distortion.lower),
    };
    let shell = Shell::from(nodes);
    let legality = legality(shell);
    cancel.check()?;
    let is_untouched = repair.moved_nodes + repair.marred_nodes + repair.past_foot_nodes == 0;
    Ok(FigureQuality {
        embedding,
        folds: legality.folds,
        corners: legality.corners,
        folded_cells: places(&legality.parts, Part::Cell),
        folded_centres: legality.folded_centres,
        folded_wedges: places(&legality.parts, Part::Wedge),
        repair: if is_untouched { Repair { folds_before: legality.folds, ..repair } } else { repair },
        self_intersections: crossings(shell, cancel)?,
        spacing_variation: spacing_variation(nodes.size, &nodes.medial),
        distortion: quads.distortion(),
        valid_share: nodes.valid.iter().filter(|v| **v).count() as f64 / nodes.valid.len().max(1) as f64,
        ..FigureQuality::default()
    })
}

/// How truly a surface was laid flat; `None` of a side that takes its coordinates from the sheet.
fn embedding_quality(flat: &Flat, distortion: Option<PlaneDistortion>) -> Option<EmbeddingQuality> {
    let embedded = flat.embedded?;
    Some(EmbeddingQuality {
        residual_variance: embedded.residual_variance,
        turned_over: distortion.map(|distortion| distortion.turned_over),
        angle_error_deg: distortion.map(|distortion| distortion.angle_error_deg),
    })
}

/// Where the parts of a kind among illegal ones are.
fn places(parts: &[Illegal], kind: Part) -> Vec<LatticePlace> {
    parts.iter().filter(|illegal| illegal.part == kind).map(|illegal| illegal.place).collect()
}

/// Pairs of triangles of the closed surface that run through each other; `None` without a closed surface.
fn crossings(shell: Shell<'_>, cancel: &dyn Cancel) -> Result<Option<usize>, Cancelled> {
    let Some(mesh) = closed(shell) else { return Ok(None) };
    self_intersections(&mesh.positions, &mesh.triangles, cancel).map(Some)
}

/// Quality of a structure from all its figures; what is measured against the mask is added to
/// theirs.
fn structure_quality(
    solid: &Solid,
    depth: &Depth,
    figures: &[&Nodes],
    qualities: &mut [FigureQuality],
    cancel: &dyn Cancel,
) -> Result<StructureQuality, Cancelled> {
    let skin = SkinSearch::of(&depth.skin, cancel)?;
    let (whole, each) = coverage(solid, &skin, figures, cancel)?;
    for ((quality, coverage), nodes) in qualities.iter_mut().zip(each).zip(figures) {
        quality.coverage = coverage;
        quality.medial_offset = medial_offset(nodes, &skin, cancel)?;
    }
    let mut quality = StructureQuality { coverage: whole, ..summed(qualities) };
    judge(&mut quality, qualities, solid.voxel_mm);
    Ok(quality)
}
