//! Stage 8, last part: from the measures to `pass`, `warn` or `fail`. The rule is the table of
//! thresholds and nothing else, so that a reader can follow it.

use std::borrow::Cow;

use crate::model::{FigureQuality, Reason, StructureQuality, Threshold, Verdict};
use crate::pipeline::plane::embedding::MAX_TURNED_OVER;
use crate::pipeline::quality::worst;

/// Thresholds as `(warn, fail)`. Overlap of the cells with the mask.
const DICE: (f64, f64) = (0.90, 0.75);
/// Share of the mask's surface within one grain (a voxel, or a tenth of the radius) of the model's.
const COVERED: (f64, f64) = (0.60, 0.30);
/// 95th percentile of the distance from the mask's surface to the model's, grains.
const FAR: (f64, f64) = (4.0, 12.0);
/// ISOMAP residual variance of any surface.
const RESIDUAL: (f64, f64) = (0.05, 0.20);
/// Spacing variation of the medial lattice.
const SPACING: (f64, f64) = (0.10, 0.40);
/// 95th percentile of the medial offset: one distance to the skin 1.2 and 2.3 times the other.
/// Single-sheet shapes and organs stay below 0.07, a kidney cut to one sheet has 0.4.
const OFFSET: (f64, f64) = (0.10, 0.40);
/// Share of nodes off the sheet.
const INVALID: (f64, f64) = (0.0, 0.5);

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
    quality.verdict = quality.thresholds.iter().map(verdict).max().unwrap_or_default();
}

/// What one measure says.
#[must_use]
pub fn verdict(threshold: &Threshold) -> Verdict {
    let is_beyond = |limit: Option<f64>| {
        limit.is_some_and(|limit| {
            let is_good = if threshold.is_bad_below { threshold.value >= limit } else { threshold.value <= limit };
            !is_good
        })
    };
    if is_beyond(threshold.fail) {
        Verdict::Fail
    } else if is_beyond(threshold.warn) {
        Verdict::Warn
    } else {
        Verdict::Pass
    }
}

fn table(quality: &StructureQuality, figures: &[FigureQuality], voxel_mm: f64) -> Vec<Wording> {
    let measure = |code, what, value, (warn, fail): (Option<f64>, Option<f64>), is_bad_below| Wording {
        threshold: Threshold { code: Cow::Borrowed(code), value, is_bad_below, warn, fail },
        what,
    };
    let never = |code, what, count: usize| measure(code, what, count as f64, (None, Some(0.0)), false);
    let below = |code, what, value, (warn, fail)| measure(code, what, value, (Some(warn), Some(fail)), true);
    let above = |code, what, value, (warn, fail)| measure(code, what, value, (Some(warn), Some(fail)), false);
    let far = quality.coverage.mask_to_model.p95_mm / quality.coverage.grain_mm.max(voxel_mm);
    let crossings = quality.self_intersections.unwrap_or(0) as f64;
    let invalid = worst(figures, |f| 1.0 - f.valid_share);
    vec![
        never("folds", "thickness vectors cross: the number of corners of cells turned over", quality.folds),
        never("folded_centres", "cells are turned over inside: their number", quality.folded_centres),
        never("folded_wedges", "the crest is turned over: the number of its wedges", quality.folded_wedges),
        measure(
            "self_intersections",
            "the closed surface runs through itself: the number of pairs of triangles",
            crossings,
            (Some(0.0), None),
            false,
        ),
        measure(
            "shortened_nodes",
            "vectors were cut short of the surface so that none cross: the number of their nodes",
            quality.repair.shortened_nodes as f64,
            (Some(0.0), None),
            false,
        ),
        below("dice", "overlap of the cells with the mask", quality.coverage.dice, DICE),
        below("covered_share", "share of the mask's surface covered", quality.coverage.covered_share, COVERED),
        above("surface_distance", "95 % distance from the mask's surface, in voxels or tenths of the radius", far, FAR),
        above("residual_variance", "residual variance of the flattening", quality.residual_variance, RESIDUAL),
        measure(
            "turned_over",
            "share of a surface that lies turned over where it was laid flat",
            quality.turned_over.unwrap_or(0.0),
            (None, Some(MAX_TURNED_OVER)),
            false,
        ),
        above("spacing_variation", "unevenness of the lattice", quality.spacing_variation, SPACING),
        above("medial_offset", "95 % offset of medial nodes from the middle", quality.medial_offset.p95, OFFSET),
        above("invalid_nodes", "share of nodes off the sheet", invalid, INVALID),
    ]
}

fn reason(wording: &Wording) -> Option<Reason> {
    let Threshold { ref code, value, warn, fail, .. } = wording.threshold;
    let threshold = match verdict(&wording.threshold) {
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
