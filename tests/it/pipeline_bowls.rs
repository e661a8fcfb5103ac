//! Bowls, which ISOMAP cannot lay flat, are one figure.

use medialrep::model::{LatticeSize, Sheet, Structure, Verdict};
use medialrep::params::{Correspondence, Embedding, Params};
use medialrep::space::WorldPoint;

use crate::help::phantoms::{model_of, params};
use crate::pipeline_cut::bowl;

fn structure(opening_deg: f64, params: Params) -> Structure {
    model_of(&bowl(opening_deg), params).structures.remove(0)
}

/// The mean length of the vectors to the nodes of a side, mm, in the middle half of rows and columns.
fn mean_length(sheet: &Sheet, side: &[WorldPoint]) -> f64 {
    let LatticeSize { rows, cols } = sheet.grid;
    let (mut sum, mut count) = (0.0, 0.0);
    for i in rows / 4..rows - rows / 4 {
        for j in cols / 4..cols - cols / 4 {
            let n = i * cols + j;
            sum += (side[n] - sheet.medial[n]).norm();
            count += 1.0;
        }
    }
    sum / count
}

#[test]
fn a_bowl_is_one_figure_with_true_lengths() {
    // Opened by 90°, and drawn in by 30° more.
    for opening_deg in [90.0, 60.0] {
        let bowl = structure(opening_deg, params());
        assert_eq!((bowl.figures.len(), bowl.quality.folds), (1, 0), "{opening_deg}°");
        assert_eq!((bowl.quality.folded_centres, bowl.quality.folded_wedges), (0, 0), "{opening_deg}°");
        assert!(bowl.quality.coverage.dice > 0.96, "{opening_deg}°: {:.3}", bowl.quality.coverage.dice);
        assert_eq!(bowl.quality.verdict, Verdict::Pass, "{opening_deg}°: {:?}", bowl.quality.reasons);
        assert!(bowl.warnings.iter().any(|warning| warning.code == "sheet_unrolled"), "{opening_deg}°");
        let sheet = bowl.sheets().next().expect("a sheet");
        for side in [&sheet.upper, &sheet.lower] {
            let mean = mean_length(sheet, side);
            assert!((mean / 3.0 - 1.0).abs() < 0.02, "{opening_deg}°: {mean:.3} of 3");
        }
    }
}

#[test]
fn the_residual_variance_of_a_bowl_is_isomap_s_and_does_not_judge_its_plane() {
    let bowl = structure(60.0, params());
    let plane = bowl.sheets().next().and_then(|sheet| sheet.quality.embedding.medial).expect("a plane");
    let stretch = plane.unrolled.expect("unrolled");
    assert!(plane.residual_variance > 0.05 && plane.turned_over == Some(0.0), "{plane:?}");
    assert!(stretch.energy > 1.015 && stretch.least > 0.6 && stretch.most < 2.5, "{stretch:?}");
    let judged = bowl.quality.thresholds.iter().find(|threshold| threshold.code == "residual_variance");
    assert_eq!(judged.map(|threshold| threshold.value), Some(0.0));
}

#[test]
fn the_paper_s_pairing_and_other_embeddings_unroll_nothing() {
    let others = [
        Params { correspondence: Correspondence::Paper, ..params() },
        Params { embedding: Embedding::Lle, ..params() },
    ];
    for params in others {
        let told = model_of(&bowl(90.0), params).structures.remove(0).warnings;
        assert!(told.iter().all(|warning| warning.code != "sheet_unrolled"), "{told:?}");
    }
}
