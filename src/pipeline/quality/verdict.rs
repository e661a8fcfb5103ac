//! From the measures to `pass`, `warn` or `fail`. The rule is the table of
//! thresholds and nothing else, so that a reader can follow it.

use std::borrow::Cow;

use crate::model::{FigureQuality, Reason, StructureQuality, Threshold, Verdict};
use crate::pipeline::plane::embedding::MAX_TURNED_OVER;
use crate::pipeline::quality::measures::worse;

// Thresholds as `(warn, fail)`. What is quoted are results with the default parameters: of the samples, and of single
// organs of several data sets.

/// Overlap of the cells with the mask. The samples have 0.89 to 0.95, organs with a sheet 0.86 to 0.93, those that round
/// rims or a second sheet take much of 0.77 to 0.79, a vertebra 0.71. Higher, every rim that wedges only approximate
/// would be a warning; lower, organs without a sheet would pass.
const DICE: (f64, f64) = (0.90, 0.75);
/// Share of the mask's surface within one grain (a voxel, or a tenth of the radius) of the model's. Organs have 0.66 to
/// 0.98; below 0.35 are those whose vectors cross or of which a part has no sheet. Higher, the ends of a thick bend
/// (0.50) would be a failure.
const COVERED: (f64, f64) = (0.60, 0.30);
/// 95th percentile of the distance from the mask's surface to the model's, grains. The samples have up to 2.6, organs up
/// to 3.6; above 12 a part of the mask has no sheet near it.
const FAR: (f64, f64) = (4.0, 12.0);
/// Residual variance of any surface. The samples have up to 0.001, organs up to 0.01, a vertebra 0.04, or 0.08 on a graph
/// of 8 neighbours, whose lengths are rough.
const RESIDUAL: (f64, f64) = (0.05, 0.20);
/// Spacing variation of the medial lattice. The samples have up to 0.013, organs up to 0.09, or 0.2 where nodes on a fold
/// had to be moved; above 0.4 are sheets folded so much that nothing mends them.
const SPACING: (f64, f64) = (0.10, 0.40);
/// 95th percentile of the medial offset: one distance to the skin 1.2 and 2.3 times the other.
/// Single-sheet shapes and organs stay below 0.09, a kidney kept to one sheet has 0.25.
const OFFSET: (f64, f64) = (0.10, 0.40);
/// Share of nodes off the sheet. A fitted lattice has none; a regular one has 0.1 to 0.3 over round sheets, 0.45 over that
/// of a vertebra. With more than half of them off, what is left is no lattice of the sheet.
const INVALID: (f64, f64) = (0.0, 0.5);

/// Share of the nodes that repair spoilt: cut short, moved off the sheet or merged. Straps, muscles and slabs have up to
/// 0.02; above it the lattice is more the repair's than the organ's, and lengths are those of neither.
const MARRED: f64 = 0.05;

/// What a measure is called in a reason.
struct Wording {
    threshold: Threshold,
    what: &'static str,
}

/// Sets thresholds, reasons and verdict of a quality whose measures are there.
pub fn judge(quality: &mut StructureQuality, figures: &[FigureQuality], voxel_mm: f64) {
    let table = table(quality, figures, voxel_mm);
    quality.reasons = table.iter().filter_map(reason).collect();
    quality.thresholds = table.into_iter().map(|wording| wording.threshold).collect();
    quality.verdict = quality.thresholds.iter().map(Threshold::verdict).max().unwrap_or_default();
}

impl Wording {
    fn of(code: &'static str, what: &'static str, value: f64) -> Self {
        let threshold = Threshold { code: Cow::Borrowed(code), value, is_bad_below: false, warn: None, fail: None };
        Self { threshold, what }
    }

    fn bad_above(mut self, (warn, fail): (f64, f64)) -> Self {
        (self.threshold.warn, self.threshold.fail) = (Some(warn), Some(fail));
        self
    }

    fn bad_below(mut self, limits: (f64, f64)) -> Self {
        self.threshold.is_bad_below = true;
        self.bad_above(limits)
    }

    fn warned_above(mut self, limit: f64) -> Self {
        self.threshold.warn = Some(limit);
        self
    }

    fn failed_above(mut self, limit: f64) -> Self {
        self.threshold.fail = Some(limit);
        self
    }
}

fn table(quality: &StructureQuality, figures: &[FigureQuality], voxel_mm: f64) -> Vec<Wording> {
    let (fit, row) = (&quality.coverage, Wording::of);
    let far = fit.mask_to_model.p95_mm / fit.grain_mm.max(voxel_mm);
    let folds = "thickness vectors cross: the number of corners of cells turned over";
    let wedges = "the crest is turned over: the number of its wedges";
    let crossings = "the closed surface runs through itself: the number of pairs of triangles";
    let shortened = "vectors were cut short of the surface so that none cross: the number of their nodes";
    let marred = "share of nodes cut short, moved off the sheet or merged so that no vectors cross";
    let turned_over = "share of a surface that lies turned over where it was laid flat";
    vec![
        row("folds", folds, quality.folds as f64).failed_above(0.0),
        row("folded_centres", "cells are turned over inside: their number", quality.folded_centres as f64)
            .failed_above(0.0),
        row("folded_wedges", wedges, quality.folded_wedges as f64).failed_above(0.0),
        row("self_intersections", crossings, quality.self_intersections.unwrap_or(0) as f64).warned_above(0.0),
        row("shortened_nodes", shortened, quality.repair.shortened_nodes as f64).warned_above(0.0),
        row("repaired_share", marred, quality.repair.marred_share()).failed_above(MARRED),
        row("dice", "overlap of the cells with the mask", fit.dice).bad_below(DICE),
        row("covered_share", "share of the mask's surface covered", fit.covered_share).bad_below(COVERED),
        row("surface_distance", "95 % distance from the mask's surface, in voxels or tenths of the radius", far)
            .bad_above(FAR),
        row("residual_variance", "residual variance of the flattening", quality.residual_variance).bad_above(RESIDUAL),
        row("turned_over", turned_over, quality.turned_over.unwrap_or(0.0)).failed_above(MAX_TURNED_OVER),
        row("spacing_variation", "unevenness of the lattice", quality.spacing_variation).bad_above(SPACING),
        row("medial_offset", "95 % offset of medial nodes from the middle", quality.medial_offset.p95)
            .bad_above(OFFSET),
        row("invalid_nodes", "share of nodes off the sheet", invalid_share(figures)).bad_above(INVALID),
    ]
}

/// Share of the nodes off the sheet, of the worst figure.
fn invalid_share(figures: &[FigureQuality]) -> f64 {
    let mut worst = 0.0;
    for figure in figures {
        worst = worse(worst, 1.0 - figure.valid_share);
    }
    worst
}

fn reason(wording: &Wording) -> Option<Reason> {
    let Threshold { ref code, value, warn, fail, .. } = wording.threshold;
    let threshold = match wording.threshold.verdict() {
        Verdict::Pass => return None,
        Verdict::Warn => warn?,
        Verdict::Fail => fail?,
    };
    let is_count = warn.or(fail) == Some(0.0) && (warn.is_none() || fail.is_none());
    let message = if is_count {
        format!("{} is {value:.0}, none is allowed", wording.what)
    } else {
        format!("{} is {value:.3}, the threshold is {threshold:.3}", wording.what)
    };
    Some(Reason { code: code.clone(), message, value, threshold })
}
