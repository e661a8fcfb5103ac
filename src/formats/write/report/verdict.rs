//! The verdict and its reasons.

use super::told;
use super::{EDGE, INNER, TEXT};
use crate::drawing::colors::Rgb;
use crate::drawing::page::{INK, QUIET};
use crate::drawing::{Page, Typeface};
use crate::model::{Reason, Structure, Verdict};

/// Reasons beyond these are in `thickness.json`.
const MOST_REASONS: usize = 10;
const BADGE: (Typeface, f64) = (Typeface::Bold, 13.0);
pub(super) const BADGE_SIZE: [f64; 2] = [84.0, 22.0];

/// The verdict in a word, with its colour. Dark enough for white letters on it.
fn told_verdict(structure: &Structure) -> (&'static str, Rgb) {
    match structure.quality.verdict {
        _ if structure.refusal.is_some() => ("REFUSED", [120, 30, 40]),
        Verdict::Pass => ("PASS", [0, 110, 80]),
        Verdict::Warn => ("WARN", [160, 95, 0]),
        Verdict::Fail => ("FAIL", [178, 34, 52]),
    }
}

/// Adds the verdict as a word on its colour.
pub(super) fn add_badge(page: &mut Page, [left, top]: [f64; 2], structure: &Structure) {
    const WHITE: Rgb = [255; 3];
    let (word, color) = told_verdict(structure);
    page.rectangle([left, top], BADGE_SIZE, color);
    page.words_around(word, [left + BADGE_SIZE[0] / 2.0, top + 16.0], BADGE, WHITE);
}

/// What decided the verdict, in a sentence.
pub(super) fn first_reason(structure: &Structure) -> String {
    if let Some(refusal) = &structure.refusal {
        return format!("No medial representation: {refusal}.");
    }
    let first = structure.quality.deciding_reason().or(structure.quality.reasons.first());
    match first {
        Some(reason) => sentence(reason),
        None => "Every measure is inside its threshold.".to_owned(),
    }
}

fn sentence(reason: &Reason) -> String {
    let Some(first) = reason.message.chars().next() else { return reason.code.to_string() };
    let rest = &reason.message[first.len_utf8()..];
    format!("{}{rest}.", first.to_uppercase()).replace("..", ".")
}

/// Adds the verdict with its first reason; where it ends.
pub(super) fn add(page: &mut Page, top: f64, structure: &Structure) -> f64 {
    add_badge(page, [EDGE, top], structure);
    let left = EDGE + BADGE_SIZE[0] + 14.0;
    let width = INNER - BADGE_SIZE[0] - 14.0;
    page.paragraph(&first_reason(structure), ([left, top - 1.0], width), TEXT, INK).max(top + BADGE_SIZE[1])
}

/// Adds all reasons, with the measure and its threshold, and the warnings; where they end.
pub(super) fn add_all(page: &mut Page, top: f64, structure: &Structure) -> f64 {
    let mut lines = Vec::new();
    if let Some(refusal) = &structure.refusal {
        lines.push(format!("{refusal} ({}): {}", refusal.code(), refusal.hint()));
    }
    let reasons = &structure.quality.reasons;
    for reason in reasons {
        let (value, threshold) = (number(reason.value), number(reason.threshold));
        lines.push(format!("{} ({}: {value}, threshold {threshold})", sentence(reason), reason.code));
    }
    for warning in &structure.warnings {
        lines.push(format!("{} ({})", warning.message, warning.code));
    }
    if lines.is_empty() {
        return page.paragraph("None.", ([EDGE, top], INNER), TEXT, QUIET);
    }
    let more = lines.len().saturating_sub(MOST_REASONS);
    lines.truncate(MOST_REASONS);
    if more > 0 {
        lines.push(format!("and {more} more in thickness.json"));
    }
    let mut end = top;
    for line in lines {
        page.words("•", [EDGE, end + 16.5], TEXT, QUIET);
        end = page.paragraph(&line, ([EDGE + 16.0, end], INNER - 16.0), TEXT, INK);
    }
    end
}

/// A measure with four digits.
fn number(value: f64) -> String {
    if !value.is_finite() {
        return told::NONE.to_owned();
    }
    let digits = if value.abs() >= 100.0 {
        0
    } else if value.abs() >= 1.0 {
        2
    } else {
        4
    };
    crate::drawing::told(format!("{value:.digits$}").parse().unwrap_or(value))
}
