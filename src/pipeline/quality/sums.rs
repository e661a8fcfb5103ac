//! What a structure has from its figures: sums of what is counted, the worst figure of what is measured.

use crate::model::{Distortion, EmbeddingQuality, FigureQuality, MeanAndP95, Repair, StructureQuality};
use crate::pipeline::quality::measures::worse;

/// Sums of what is counted, the worst figure of what is measured.
#[must_use]
pub fn summed(figures: &[FigureQuality]) -> StructureQuality {
    let mut all = StructureQuality::default();
    for figure in figures {
        add_counts(&mut all, figure);
        for (_, plane) in figure.embedding.named() {
            if let Some(plane) = plane {
                widen_planes(&mut all, plane);
            }
        }
        all.spacing_variation = worse(all.spacing_variation, figure.spacing_variation);
        widen_distortion(&mut all.distortion, figure.distortion);
        widen_share(&mut all.medial_offset, figure.medial_offset);
        all.outside_share = worse(all.outside_share, figure.outside_share);
    }
    all
}

fn add_counts(all: &mut StructureQuality, figure: &FigureQuality) {
    all.folds += figure.folds;
    all.folded_centres += figure.folded_centres;
    all.folded_wedges += figure.folded_wedges.len();
    let (sum, repair) = (all.repair, figure.repair);
    all.repair = Repair {
        nodes: sum.nodes + repair.nodes,
        folds_before: sum.folds_before + repair.folds_before,
        moved_nodes: sum.moved_nodes + repair.moved_nodes,
        past_foot_nodes: sum.past_foot_nodes + repair.past_foot_nodes,
        shortened_nodes: sum.shortened_nodes + repair.shortened_nodes,
        off_sheet_nodes: sum.off_sheet_nodes + repair.off_sheet_nodes,
        merged_nodes: sum.merged_nodes + repair.merged_nodes,
        marred_nodes: sum.marred_nodes + repair.marred_nodes,
    };
    if let Some(crossings) = figure.self_intersections {
        *all.self_intersections.get_or_insert(0) += crossings;
    }
}

fn widen_planes(all: &mut StructureQuality, plane: &EmbeddingQuality) {
    // A figure that was unrolled does not lie in the plane that the embedding's residual variance tells of.
    if plane.unrolled.is_none() {
        all.residual_variance = worse(all.residual_variance, plane.residual_variance);
    }
    if let Some(turned_over) = plane.turned_over {
        all.turned_over = Some(worse(all.turned_over.unwrap_or(0.0), turned_over));
    }
}

fn widen_distortion(worst: &mut Distortion, figure: Distortion) {
    worst.area_sd = worse(worst.area_sd, figure.area_sd);
    worst.area_max_log = worse(worst.area_max_log, figure.area_max_log);
    worst.angle_mean_deg = worse(worst.angle_mean_deg, figure.angle_mean_deg);
    worst.angle_max_deg = worse(worst.angle_max_deg, figure.angle_max_deg);
}

fn widen_share(worst: &mut MeanAndP95, figure: MeanAndP95) {
    *worst = MeanAndP95 { mean: worse(worst.mean, figure.mean), p95: worse(worst.p95, figure.p95) };
}
