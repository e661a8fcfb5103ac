//! What a page comes from: the program, the file, the parameters, the run.

use super::{EDGE, INNER, PRINT, SMALL, STRONG, TITLE, WIDTH};
use crate::drawing::Page;
use crate::drawing::colors::Rgb;
use crate::drawing::page::{INK, QUIET, line_height};
use crate::formats::params_json::params_to_json;
use crate::formats::write::dates::Utc;
use crate::formats::write::record::Record;
use crate::space::significant;

const ALERT: Rgb = [178, 34, 52];
/// Characters of the parameters that are shown; more are in `thickness.json`.
const MOST_PARAMS: usize = 1500;

/// Said on every page.
pub(super) const NOT_FOR_DIAGNOSIS: &str = "NOT FOR DIAGNOSIS";

/// Adds a title with what every page says; where it ends.
pub(super) fn add_head(page: &mut Page, title: &str, under: &str) -> f64 {
    let (face, size) = STRONG;
    let width = face.width(NOT_FOR_DIAGNOSIS, size);
    let left = WIDTH - EDGE - width - 16.0;
    page.rectangle([left, 28.0], [width + 16.0, 26.0], ALERT);
    page.words(NOT_FOR_DIAGNOSIS, [left + 8.0, 46.5], STRONG, [255; 3]);
    let title = TITLE.0.fitted(title, TITLE.1, left - EDGE - 20.0);
    page.words(&title, [EDGE, 51.0], TITLE, INK);
    page.paragraph(under, ([EDGE, 58.0], INNER), SMALL, QUIET) + 8.0
}

/// Adds a line at the foot; where it ends.
pub(super) fn add_foot(page: &mut Page, top: f64, record: &Record) -> f64 {
    page.hairline([EDGE, top + 6.0], INNER);
    let words = format!(
        "medialrep {} · {} · mask SHA-256 {}… · measures a mask; not a medical device",
        env!("CARGO_PKG_VERSION"),
        run(record),
        record.input.sha256.get(..16).unwrap_or(&record.input.sha256)
    );
    page.paragraph(&words, ([EDGE, top + 8.0], INNER), PRINT, QUIET)
}

/// Adds all of it; where it ends.
pub(super) fn add_all(page: &mut Page, top: f64, record: &Record) -> f64 {
    let [x, y, z] = record.model.world_from_voxel.spacing_mm().map(significant);
    let [columns, rows, slices] = record.model.dims;
    let mut params = params_to_json(&record.model.params).to_string();
    if params.chars().count() > MOST_PARAMS {
        params = format!("{}… (all in thickness.json)", params.chars().take(MOST_PARAMS).collect::<String>());
    }
    // Lines are broken between words.
    let params = params.replace(",\"", ", \"");
    let facts = [
        ("Program", format!("medialrep {}; {}", env!("CARGO_PKG_VERSION"), run(record))),
        ("Mask", format!("{}, {columns} × {rows} × {slices} voxels of {x} × {y} × {z} mm", record.input.format)),
        ("SHA-256", record.input.sha256.clone()),
        ("Parameters", params),
    ];
    let mut end = top;
    for (what, text) in facts {
        page.words(what, [EDGE, end + line_height(PRINT.1) - 3.6], PRINT, QUIET);
        end = page.paragraph(&text, ([EDGE + 84.0, end], INNER - 84.0), PRINT, INK);
    }
    end
}

/// When the run was.
fn run(record: &Record) -> String {
    match record.ended_unix_s {
        Some(unix_s) => format!("run {}", Utc::of(unix_s).told()),
        None => "run at a time that was not kept".to_owned(),
    }
}

/// Whether the file says where the sides of the patient are.
pub(super) fn is_oriented(record: &Record) -> bool {
    record.warnings.iter().all(|warning| warning.code != "no_orientation")
}
