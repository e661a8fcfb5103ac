//! The numbers of a structure as a table, and what they rest on.

use super::{EDGE, INNER, PRINT, SMALL, STRONG, TEXT, told};
use crate::drawing::Page;
use crate::drawing::page::{INK, QUIET, line_height};
use crate::model::{Figure, Structure, ThicknessSummary};

/// Figures beyond these are in `thickness.json`.
const MOST_FIGURES: usize = 14;
/// Right edges of the columns of lengths, from the left edge of the page.
const COLUMNS: [(&str, f64); 7] = [
    ("mean", 360.0),
    ("sd", 435.0),
    ("min", 510.0),
    ("5 %", 585.0),
    ("median", 670.0),
    ("95 %", 745.0),
    ("max", 820.0),
];
const AREA: f64 = 960.0;

/// Adds the table: a row for the structure, and one for each figure where there are several; where it ends.
pub(super) fn add(page: &mut Page, top: f64, structure: &Structure) -> f64 {
    let mut base = top + 16.0;
    page.words("Thickness, mm", [EDGE, base], STRONG, INK);
    for (name, right) in COLUMNS {
        page.words_to(name, [right + EDGE, base], SMALL, QUIET);
    }
    page.words_to("area", [AREA + EDGE, base], SMALL, QUIET);
    page.hairline([EDGE, base + 7.0], INNER);
    base = add_row(page, base + 8.0, "all figures", &structure.thickness_summary());
    if structure.figures.len() < 2 {
        return base;
    }
    for (n, figure) in structure.figures.iter().enumerate().take(MOST_FIGURES) {
        let kind = if figure.as_tube().is_some() { "tube" } else { "sheet" };
        base = add_row(page, base, &format!("figure {n}, {kind}"), &figure.thickness_summary());
    }
    let more = structure.figures.len().saturating_sub(MOST_FIGURES);
    if more > 0 {
        base += line_height(PRINT.1);
        page.words(&format!("and {more} more in thickness.json"), [EDGE, base - 4.0], PRINT, QUIET);
    }
    base
}

fn add_row(page: &mut Page, top: f64, name: &str, summary: &ThicknessSummary) -> f64 {
    let base = top + line_height(TEXT.1);
    page.words(name, [EDGE, base - 5.0], TEXT, INK);
    for ((_, right), length) in COLUMNS.iter().zip(lengths(summary)) {
        page.words_to(&told::length(length), [right + EDGE, base - 5.0], TEXT, INK);
    }
    page.words_to(&told::area(summary.area_mm2), [AREA + EDGE, base - 5.0], TEXT, INK);
    base + 2.0
}

/// In the order of the columns.
fn lengths(summary: &ThicknessSummary) -> [Option<f64>; 7] {
    let Some(total) = summary.total_mm else { return [None; 7] };
    [total.mean, total.sd, total.min, total.p5, total.p50, total.p95, total.max].map(Some)
}

/// Adds how sure the numbers are; where it ends.
pub(super) fn add_trust(page: &mut Page, top: f64, structure: &Structure) -> f64 {
    let mut end = top;
    for line in trust(structure) {
        end = page.paragraph(&line, ([EDGE, end], INNER), TEXT, INK);
    }
    end
}

fn trust(structure: &Structure) -> Vec<String> {
    let mut lines = Vec::new();
    let coverage = &structure.quality.coverage;
    if structure.refusal.is_none() {
        let (near, far) = (coverage.mask_to_model.p95_mm, coverage.mask_to_model.max_mm);
        lines.push(format!(
            "Fit to the mask: overlap (Dice) {:.3}; 95 % of its surface lie within {} mm of the figures, all within {} mm.",
            coverage.dice,
            told::length(Some(near)),
            told::length(Some(far))
        ));
        lines.push(format!(
            "Figures stand for {} of the voxels of the label.",
            told::percent(structure.quality.kept.kept)
        ));
    }
    lines.push(match spread(structure) {
        Some((mean_mm, repeats)) => format!(
            "Uncertainty: standard deviation of {} mm at a node in the mean, over {repeats} repeats with the mask moved \
             within its voxels.",
            told::length(Some(mean_mm))
        ),
        None => "Uncertainty at each node was not asked for (parameter uncertainty).".to_owned(),
    });
    lines
}

/// Mean over all nodes of the standard deviation of the thickness, mm, and the repeats; `None` where it was not asked for
/// or nothing was found again.
fn spread(structure: &Structure) -> Option<(f64, usize)> {
    let (mut sum, mut count, mut repeats) = (0.0, 0_usize, 0);
    for figure in &structure.figures {
        let found = match figure {
            Figure::Sheet(sheet) => sheet.uncertainty.as_ref().map(|own| (own.repeats, &own.total_mm)),
            Figure::Tube(tube) => tube.uncertainty.as_ref().map(|own| (own.repeats, &own.total_mm)),
        };
        let Some((own_repeats, nodes)) = found else { continue };
        repeats = repeats.max(own_repeats);
        for spread_mm in nodes.iter().flatten() {
            sum += spread_mm;
            count += 1;
        }
    }
    (count > 0).then(|| (sum / count as f64, repeats))
}
