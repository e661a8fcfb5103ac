//! Stage 8: how far a result can be trusted. Everything is measured on the nodes that are handed
//! out, against the mask on the working grid.

pub mod coverage;

pub mod measures;

pub mod verdict;

use crate::numerics::triangles::self_intersections;

use crate::model::Shell;
use crate::model::closed;
use crate::model::{Distortion, FigureQuality, MeanAndP95, PerSurface, Repair, StructureQuality, TriangleMesh};
use crate::pipeline::observer::{Cancelled, Observer};
use crate::pipeline::quality::coverage::{SkinSearch, coverage};
use crate::pipeline::quality::measures::{FlatQuads, medial_offset, spacing_variation, worse};
use crate::pipeline::quality::verdict::judge;
use crate::pipeline::solid::Solid;
use crate::pipeline::solid::depth::Depth;
use crate::pipeline::vectors::Nodes;
use crate::pipeline::vectors::legality::{Illegal, legality};

/// What can be said of a figure by itself: legality of its parts, evenness of its lattice. How
/// it fits the mask is added by [`structure_quality`]. `quads` are those of `nodes`.
///
/// # Errors
/// When the observer asks to stop.
pub fn figure_quality(
    nodes: &Nodes,
    quads: &FlatQuads<'_>,
    residual_variance: PerSurface<f64>,
    repair: Repair,
    observer: &dyn Observer,
) -> Result<FigureQuality, Cancelled> {
    let shell = Shell::from(nodes);
    let legality = legality(shell);
    let named = |is_wedge: bool| {
        let parts = legality.parts.iter().filter(|p| p.part.is_wedge() == is_wedge);
        parts.map(|&Illegal { part, i, j, .. }| (part.is_upper(), i, j)).collect()
    };
    observer.check()?;
    let crossings = |mesh: TriangleMesh| self_intersections(&mesh.positions, &mesh.triangles, &|| observer.check());
    let is_untouched = repair.moved_nodes == 0;
    Ok(FigureQuality {
        residual_variance,
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
///
/// # Errors
/// When the observer asks to stop.
pub fn structure_quality(
    solid: &Solid,
    depth: &Depth,
    figures: &[Nodes],
    qualities: &mut [FigureQuality],
    observer: &dyn Observer,
) -> Result<StructureQuality, Cancelled> {
    let skin = SkinSearch::of(&depth.skin, observer)?;
    let (whole, each) = coverage(solid, &skin, figures, observer)?;
    for ((quality, coverage), nodes) in qualities.iter_mut().zip(each).zip(figures) {
        quality.coverage = coverage;
        quality.medial_offset = medial_offset(nodes, &skin, observer)?;
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
        // Sides that were not laid flat have none.
        residual_variance: largest(&|f| {
            f.residual_variance.upper.max(f.residual_variance.lower).max(0.0).max(f.residual_variance.medial)
        }),
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

/// The largest of a measure over figures.
pub(super) fn worst(figures: &[FigureQuality], of: impl Fn(&FigureQuality) -> f64) -> f64 {
    figures.iter().map(of).fold(0.0, worse)
}
