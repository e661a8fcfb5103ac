//! Several structures together: three views, and a row of numbers for each.

use super::provenance::{add_foot, add_head, is_oriented};
use super::views::{Shown, add_badge, add_views, picture};
use super::{EDGE, INNER, MOST_STRUCTURES, SMALL, STRONG, TEXT, WIDTH, told, verdict};
use crate::drawing::page::{INK, QUIET};
use crate::drawing::{Page, Range, Solid, View};
use crate::formats::write::record::Record;
use crate::model::{Structure, Verdict};

/// Rows of a picture. More would be a picture that no viewer shows whole; the rest is in the report and the other files.
const MOST_ROWS: usize = 60;
const ROW: f64 = 78.0;
const THUMB: [f64; 2] = [96.0, 68.0];
/// Where numbers end, from the left edge of the page.
const COLUMNS: [(&str, f64); 6] =
    [("mean", 500.0), ("sd", 570.0), ("5 %", 640.0), ("95 %", 710.0), ("max", 780.0), ("volume", 888.0)];
const NAME: f64 = EDGE + 142.0;

/// Rows of the first page of a report, under the views, and of each page after it: so many fill a page of A4.
const PAGE_ROWS: [usize; 2] = [10, 16];

/// The page of a picture.
pub(super) fn page(record: &Record) -> Page {
    let count = record.model.structures.len();
    let (mut page, mut end) = with_rows(record, 0..count.min(MOST_ROWS));
    let more = count.saturating_sub(MOST_ROWS);
    if more > 0 {
        let words = format!("and {more} more structures: report.pdf has a page for each, thickness.json all numbers");
        page.words(&words, [EDGE, end + 18.0], TEXT, INK);
        end += 24.0;
    }
    page.size[1] = add_foot(&mut page, end, record) + 16.0;
    page
}

/// The pages of a report.
pub(super) fn pages(record: &Record) -> Vec<Page> {
    let (mut pages, all) = (Vec::new(), record.model.structures.len());
    let count = all.min(MOST_STRUCTURES);
    let mut first = 0;
    while first < count {
        let rows = PAGE_ROWS[usize::from(first > 0)];
        let (mut page, mut end) = with_rows(record, first..count.min(first + rows));
        if all > count && first + rows >= count {
            let words = format!("and {} more structures: thickness.json has all numbers", all - count);
            page.words(&words, [EDGE, end + 18.0], TEXT, INK);
            end += 24.0;
        }
        page.size[1] = add_foot(&mut page, end, record) + 16.0;
        pages.push(page);
        first += rows;
    }
    pages
}

/// A page with the rows of these structures, the first one under the views of all; where it ends.
fn with_rows(record: &Record, rows: std::ops::Range<usize>) -> (Page, f64) {
    let mut page = Page::new(WIDTH, 1);
    let structures = &record.model.structures;
    let title = format!("{} structures", structures.len());
    let mut end = add_head(&mut page, &title, &under(structures));
    let range = Range::of_thickness(structures);
    if rows.start == 0 {
        let shown = Shown { structures, range, is_oriented: is_oriented(record), place: None };
        end = add_views(&mut page, end, shown) + 6.0;
    }
    page.words("Thickness, mm", [NAME, end + 14.0], STRONG, INK);
    for (name, right) in COLUMNS {
        page.words_to(name, [right, end + 14.0], SMALL, QUIET);
    }
    end += 20.0;
    for (n, structure) in structures.iter().enumerate().take(rows.end).skip(rows.start) {
        add_row(&mut page, end, (n + 1, structure), range);
        end += ROW;
    }
    (page, end)
}

/// How many structures have which verdict, and what the numbers are.
fn under(structures: &[Structure]) -> String {
    let count = |wanted: Verdict| {
        let counts = |own: &&Structure| own.refusal.is_none() && own.quality.verdict == wanted;
        structures.iter().filter(counts).count()
    };
    let [pass, warn, fail] = [Verdict::Pass, Verdict::Warn, Verdict::Fail].map(count);
    let refused = structures.len() - pass - warn - fail;
    format!(
        "{pass} pass, {warn} warn, {fail} fail, {refused} refused · thickness is measured through the organ, from side to \
         side across its medial sheet, or across the centreline of a tube; weighted by area"
    )
}

fn add_row(page: &mut Page, top: f64, (number, structure): (usize, &Structure), range: Range) {
    page.hairline([EDGE, top], INNER);
    add_badge(page, [EDGE + 12.0, top + ROW / 2.0], &number.to_string(), INK);
    add_thumb(page, [EDGE + 32.0, top + 5.0], structure, range);
    let [mean, ..] = COLUMNS;
    let base = top + 25.0;
    page.words(&STRONG.0.fitted(&told::name(structure), STRONG.1, mean.1 - 56.0 - NAME), [NAME, base], STRONG, INK);
    let total = structure.thickness_summary().total_mm;
    let lengths = [total.map(|own| own.mean), total.map(|own| own.sd), total.map(|own| own.p5)];
    let others = [total.map(|own| own.p95), total.map(|own| own.max)];
    let mut cells: Vec<String> = lengths.into_iter().chain(others).map(told::length).collect();
    cells.push(told::volume(structure.volume_mm3));
    for ((_, right), cell) in COLUMNS.iter().zip(cells) {
        page.words_to(&cell, [*right, base], TEXT, INK);
    }
    verdict::add_badge(page, [WIDTH - EDGE - verdict::BADGE_SIZE[0], top + 9.0], structure);
    let facts =
        format!("label {} · {} · {}", structure.label, told::figures(structure), verdict::first_reason(structure));
    let mut lines = SMALL.0.lines(&facts, SMALL.1, WIDTH - EDGE - NAME);
    if lines.len() > 2 {
        let rest = lines.split_off(1).join(" ");
        lines.push(SMALL.0.fitted(&rest, SMALL.1, WIDTH - EDGE - NAME));
    }
    for (n, line) in lines.iter().enumerate() {
        page.words(line, [NAME, base + 21.0 + 18.0 * n as f64], SMALL, QUIET);
    }
}

/// The structure alone, onto its broad face.
fn add_thumb(page: &mut Page, at: [f64; 2], structure: &Structure, range: Range) {
    let solid = Solid::of([structure]);
    let mut best: Option<(f64, View, [[f64; 2]; 2])> = None;
    for view in [View::from_front(), View::from_left(), View::from_feet()] {
        let Some(bounds) = solid.bounds(&view) else { continue };
        let [low, high] = bounds;
        let scale = (THUMB[0] / (high[0] - low[0]).max(1e-9)).min(THUMB[1] / (high[1] - low[1]).max(1e-9));
        let seen = scale * scale * (high[0] - low[0]) * (high[1] - low[1]);
        if best.is_none_or(|(most, ..)| seen > most) {
            best = Some((seen, view, bounds));
        }
    }
    let Some((_, view, [low, high])) = best else { return };
    let center = [f64::midpoint(low[0], high[0]), f64::midpoint(low[1], high[1])];
    let scale = (THUMB[0] / (high[0] - low[0]).max(1e-9)).min(THUMB[1] / (high[1] - low[1]).max(1e-9));
    page.picture(picture(&solid, &view, (THUMB, page.dots), (center, 0.96 * scale), range), at);
}
