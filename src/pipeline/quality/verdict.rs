//! From the measures to `pass`, `warn` or `fail`. The rule is the table of
//! thresholds and nothing else, so that a reader can follow it.

use std::borrow::Cow;

use crate::model::{FigureQuality, Reason, StructureQuality, Threshold, Verdict, WorldPlace};
use crate::pipeline::plane::embedding::MAX_TURNED_OVER;
use crate::pipeline::quality::measures::worse;
use crate::pipeline::solid::changes::in_words;

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
const DISTANCE: (f64, f64) = (4.0, 12.0);
// Those of the voxels and the surface follow from what a fault of known size does to the mean thickness of a plate
// (`make verdict`, the table in docs/quality.md): beyond `warn` it may be off by more than 3 %, beyond `fail` by more than
// a quarter.

/// Share of the mask's surface further than one and a half grains from the model. A piece that is left out and makes the
/// mean wrong by 3 % has 0.08, a sheet of four 0.25. Lower, the round rim of every organ would be a warning; higher, a
/// lost lobe would pass. It is no failure: few nodes on a fine mask have 0.3 all round a rim that is right in thickness.
const FAR: f64 = 0.10;
/// Share of the points along vectors that are more than a voxel outside of the label. A legal figure has none; a bowel
/// whose vectors leap over its folds has 0.04.
const OUTSIDE: (f64, f64) = (0.01, 0.05);
/// Share of the label's voxels that the figures stand for. Without 3 %, half as thick as the rest, the mean is off by
/// 3 %; without a quarter by a quarter. Organs have 0.995 and more.
const KEPT: (f64, f64) = (0.97, 0.75);
/// Share of the label's voxels in clumps that are too thin for the grid. A fin of one voxel on a plate of 8 makes the mean
/// wrong by 5 % when 0.004 are lost, by 26 % with 0.034. The tips of organs are below the size of such clumps.
const THIN: (f64, f64) = (0.002, 0.03);
/// Voxels added by filling cavities, as a share of the label. With 0.009 in cavities three voxels high the mean is off by
/// 3 %, and more than 0.05 is hollow if they are large. Organs have up to 0.0003, masks with 30 % of their boundary
/// flipped 0.007.
const FILLED: (f64, f64) = (0.008, 0.05);
/// Voxels added by closing gaps and tunnels, as a share of the label. A slit of one voxel in a plate of 8 makes the mean
/// wrong by 4 % with 0.002, by 25 % with 0.024. Organs have up to 0.0005.
const CLOSED: (f64, f64) = (0.0015, 0.02);
/// Residual variance of any surface whose plane is the embedding's own. The samples have up to 0.001, organs up to 0.01, a vertebra 0.04, or 0.08 on a graph
/// of 8 neighbours, whose lengths are rough.
const RESIDUAL: (f64, f64) = (0.05, 0.20);
/// Spacing variation of the medial lattice. The samples have up to 0.013, organs up to 0.09, with a tail 0.18, and 0.2
/// where nodes on a fold had to be moved. No length hangs on it: means are weighted by area. Above 0.4 are sheets folded
/// so much that nothing mends them.
const SPACING: (f64, f64) = (0.25, 0.40);
/// 95th percentile of the medial offset: one distance to the skin 1.2 and 2.3 times the other.
/// Single-sheet shapes and organs stay below 0.09, a kidney kept to one sheet has 0.25.
const OFFSET: (f64, f64) = (0.10, 0.40);
/// Share of nodes off the sheet. A fitted lattice has none; a regular one has 0.1 to 0.3 over round sheets, 0.45 over that
/// of a vertebra. With more than half of them off, what is left is no lattice of the sheet.
const INVALID: (f64, f64) = (0.0, 0.5);

/// Share of the nodes that repair spoilt: cut short, moved off the sheet or merged. They are named one by one and are in
/// no mean: one in a hundred is the corner of a lattice. With one in twenty the lattice is more the repair's than the
/// organ's.
const MARRED: (f64, f64) = (0.01, 0.05);

/// Where measures are worst, as far as it is known.
#[derive(Clone, Copy, Debug, Default)]
pub struct Places {
    /// The label's surface is furthest from the model.
    pub fit: Option<WorldPlace>,
    /// A node is furthest off the middle.
    pub offset: Option<WorldPlace>,
    /// A cell or a wedge is turned over.
    pub folded: Option<WorldPlace>,
    /// Voxels of the label have no figure.
    pub kept: Option<WorldPlace>,
    /// Voxels of the label were too thin.
    pub lost: Option<WorldPlace>,
    /// A cavity was filled.
    pub filled: Option<WorldPlace>,
    /// A gap was closed.
    pub closed: Option<WorldPlace>,
}

/// What a measure is called in a reason.
struct Wording {
    threshold: Threshold,
    what: &'static str,
    place: Option<WorldPlace>,
}

/// Sets thresholds, reasons and verdict of a quality whose measures are there.
pub fn judge(quality: &mut StructureQuality, figures: &[FigureQuality], voxel_mm: f64, places: &Places) {
    let table = table(quality, figures, voxel_mm, places);
    quality.reasons = table.iter().filter_map(reason).collect();
    quality.thresholds = table.into_iter().map(|wording| wording.threshold).collect();
    quality.verdict = quality.thresholds.iter().map(Threshold::verdict).max().unwrap_or_default();
}

impl Wording {
    fn of(code: &'static str, what: &'static str, value: f64) -> Self {
        let threshold = Threshold { code: Cow::Borrowed(code), value, is_bad_below: false, warn: None, fail: None };
        Self { threshold, what, place: None }
    }

    fn at(mut self, place: Option<WorldPlace>) -> Self {
        self.place = place;
        self
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

fn table(quality: &StructureQuality, figures: &[FigureQuality], voxel_mm: f64, places: &Places) -> Vec<Wording> {
    let mut rows = Vec::from(legality_rows(quality, places));
    rows.extend(fit_rows(quality, voxel_mm, places));
    rows.extend(kept_rows(quality, places));
    rows.extend(lattice_rows(quality, figures, places));
    rows
}

/// Whether the vectors cross nothing.
fn legality_rows(quality: &StructureQuality, places: &Places) -> [Wording; 5] {
    let row = Wording::of;
    let folds = "thickness vectors cross: the number of corners of cells turned over";
    let wedges = "the crest is turned over: the number of its wedges";
    let crossings = "the closed surface runs through itself: the number of pairs of triangles";
    let centres = "cells are turned over inside: their number";
    let marred = "share of nodes cut short, moved off the sheet or merged so that no vectors cross";
    [
        row("folds", folds, quality.folds as f64).failed_above(0.0).at(places.folded),
        row("folded_centres", centres, quality.folded_centres as f64).failed_above(0.0).at(places.folded),
        row("folded_wedges", wedges, quality.folded_wedges as f64).failed_above(0.0).at(places.folded),
        row("self_intersections", crossings, quality.self_intersections.unwrap_or(0) as f64).warned_above(0.0),
        row("repaired_share", marred, quality.repair.marred_share()).bad_above(MARRED),
    ]
}

/// How the model fits the label.
fn fit_rows(quality: &StructureQuality, voxel_mm: f64, places: &Places) -> [Wording; 5] {
    let (fit, row) = (&quality.coverage, Wording::of);
    let distance = fit.mask_to_model.p95_mm / fit.grain_mm.max(voxel_mm);
    let distance_name = "95 % distance from the mask's surface, in voxels or tenths of the radius";
    let outside_name = "share of the vectors' points that are outside of the label";
    [
        row("dice", "overlap of the cells with the mask", fit.dice).bad_below(DICE).at(places.fit),
        row("covered_share", "share of the mask's surface covered", fit.covered_share)
            .bad_below(COVERED)
            .at(places.fit),
        row("far_share", "share of the mask's surface far from the model", fit.far_share)
            .warned_above(FAR)
            .at(places.fit),
        row("surface_distance", distance_name, distance).bad_above(DISTANCE).at(places.fit),
        row("outside_share", outside_name, quality.outside_share).bad_above(OUTSIDE),
    ]
}

/// What the figures stand for.
fn kept_rows(quality: &StructureQuality, places: &Places) -> [Wording; 4] {
    let (kept, row) = (&quality.kept, Wording::of);
    let kept_name = "share of the label's voxels that the figures stand for";
    let thin_name = "share of the label's voxels in parts of it that are too thin for the grid";
    let filled_name = "voxels added by filling cavities, as a share of the label";
    let closed_name = "voxels added by closing gaps and tunnels, as a share of the label";
    [
        row("kept_share", kept_name, kept.kept).bad_below(KEPT).at(places.kept),
        row("thin_share", thin_name, kept.thin).bad_above(THIN).at(places.lost),
        row("filled_share", filled_name, kept.filled).bad_above(FILLED).at(places.filled),
        row("closed_share", closed_name, kept.closed).bad_above(CLOSED).at(places.closed),
    ]
}

/// How well the lattices lie.
fn lattice_rows(quality: &StructureQuality, figures: &[FigureQuality], places: &Places) -> [Wording; 5] {
    let row = Wording::of;
    let turned_over = "share of a surface that lies turned over where it was laid flat";
    [
        row("residual_variance", "residual variance of the flattening", quality.residual_variance).bad_above(RESIDUAL),
        row("turned_over", turned_over, quality.turned_over.unwrap_or(0.0)).failed_above(MAX_TURNED_OVER),
        row("spacing_variation", "unevenness of the lattice", quality.spacing_variation).bad_above(SPACING),
        row("medial_offset", "95 % offset of medial nodes from the middle", quality.medial_offset.p95)
            .bad_above(OFFSET)
            .at(places.offset),
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
    let mut message = if is_count {
        format!("{} is {value:.0}, none is allowed", wording.what)
    } else {
        format!("{} is {value:.3}, the threshold is {threshold:.3}", wording.what)
    };
    if let Some(WorldPlace { figure, position }) = wording.place {
        let where_to = figure.map_or_else(|| "; for one".to_owned(), |figure| format!("; worst in figure {figure}"));
        message = format!("{message}{where_to} at {}", in_words(position));
    }
    Some(Reason { code: code.clone(), message, value, threshold, place: wording.place })
}
