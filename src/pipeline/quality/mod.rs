//! Stage 8: how far a result can be trusted. Everything is measured on the nodes that are handed
//! out, against the mask on the working grid.

pub mod coverage;

pub mod measures;

pub mod verdict;

use crate::numerics::triangles::self_intersections;

use crate::cancel::{Cancel, Cancelled};
use crate::model::Shell;
use crate::model::closed;
use crate::model::{
    Distortion, EmbeddingQuality, FigureQuality, LatticePlace, MeanAndP95, PerSurface, Repair, Side, StructureQuality,
    TriangleMesh,
};
use crate::pipeline::context::Context;
use crate::pipeline::draft::Draft;
use crate::pipeline::plane::Flat;
use crate::pipeline::plane::tangents::PlaneDistortion;
use crate::pipeline::quality::coverage::{SkinSearch, coverage};
use crate::pipeline::quality::measures::{FlatQuads, medial_offset, spacing_variation, worse};
use crate::pipeline::quality::verdict::judge;
use crate::pipeline::solid::Solid;
use crate::pipeline::solid::depth::Depth;
use crate::pipeline::vectors::Nodes;
use crate::pipeline::vectors::legality::{Illegal, legality};

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
    let named = |is_wedge: bool| {
        let parts = legality.parts.iter().filter(|p| p.part.is_wedge() == is_wedge);
        parts
            .map(|&Illegal { part, i, j, .. }| LatticePlace {
                side: if part.is_upper() { Side::Upper } else { Side::Lower },
                i,
                j,
            })
            .collect()
    };
    cancel.check()?;
    let crossings = |mesh: TriangleMesh| self_intersections(&mesh.positions, &mesh.triangles, cancel);
    let is_untouched = repair.moved_nodes == 0;
    Ok(FigureQuality {
        embedding,
        folds: legality.folds,
        corners: legality.corners,
        folded_cells: named(false),
        folded_centres: legality.folded_centres,
        folded_wedges: named(true),
        repair: if is_untouched { Repair { folds_before: legality.folds, ..Repair::default() } } else { repair },
        self_intersections: closed(shell).map(crossings).transpose()?,
        spacing_variation: spacing_variation(nodes.size, &nodes.medial),
        distortion: quads.distortion(),
        valid_share: nodes.valid.iter().filter(|v| **v).count() as f64 / nodes.valid.len().max(1) as f64,
        ..FigureQuality::default()
    })
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

/// Sums of what is counted, the worst figure of what is measured.
fn summed(figures: &[FigureQuality]) -> StructureQuality {
    let sum = |of: &dyn Fn(&FigureQuality) -> usize| figures.iter().map(of).sum::<usize>();
    let largest = |of: &dyn Fn(&FigureQuality) -> f64| worst(figures, of);
    StructureQuality {
        folds: sum(&|f| f.folds),
        folded_centres: sum(&|f| f.folded_centres),
        folded_wedges: sum(&|f| f.folded_wedges.len()),
        repair: Repair {
            folds_before: sum(&|f| f.repair.folds_before),
            moved_nodes: sum(&|f| f.repair.moved_nodes),
            shortened_nodes: sum(&|f| f.repair.shortened_nodes),
        },
        self_intersections: figures.iter().filter_map(|f| f.self_intersections).reduce(|a, b| a + b),
        residual_variance: of_planes(figures, |plane| Some(plane.residual_variance)).unwrap_or(0.0),
        turned_over: of_planes(figures, |plane| plane.turned_over),
        spacing_variation: largest(&|f| f.spacing_variation),
        distortion: Distortion {
            area_sd: largest(&|f| f.distortion.area_sd),
            area_max_log: largest(&|f| f.distortion.area_max_log),
            angle_mean_deg: largest(&|f| f.distortion.angle_mean_deg),
            angle_max_deg: largest(&|f| f.distortion.angle_max_deg),
        },
        medial_offset: MeanAndP95 { mean: largest(&|f| f.medial_offset.mean), p95: largest(&|f| f.medial_offset.p95) },
        ..StructureQuality::default()
    }
}

/// How truly a surface was laid flat; `None` of a side that takes its coordinates from the sheet.
fn embedding_quality(flat: &Flat, distortion: Option<PlaneDistortion>) -> Option<EmbeddingQuality> {
    flat.embedded.map(|embedded| EmbeddingQuality {
        residual_variance: embedded.residual_variance,
        turned_over: distortion.map(|distortion| distortion.turned_over),
        angle_error_deg: distortion.map(|distortion| distortion.angle_error_deg),
    })
}

/// The largest of a measure over all planes that have it.
fn of_planes(figures: &[FigureQuality], of: impl Fn(&EmbeddingQuality) -> Option<f64>) -> Option<f64> {
    let mut largest: Option<f64> = None;
    for figure in figures {
        for (_, plane) in figure.embedding.named() {
            if let Some(value) = plane.as_ref().and_then(&of) {
                largest = Some(worse(largest.unwrap_or(0.0), value));
            }
        }
    }
    largest
}

/// The largest of a measure over figures.
pub(super) fn worst(figures: &[FigureQuality], of: impl Fn(&FigureQuality) -> f64) -> f64 {
    figures.iter().map(of).fold(0.0, worse)
}
