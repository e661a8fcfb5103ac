//! What was measured, where, and how sure it is, for people: pages with three views, numbers and the verdict.
//!
//! A page is laid out once, in units that are pixels of `picture.png`; `report.pdf` sets it on paper.

mod told;

mod views;

mod numbers;

mod verdict;

mod provenance;

mod structure;

mod overview;

use rayon::prelude::*;

use super::record::Record;
use crate::drawing::{Page, Typeface};

/// Width of a page, units. The smallest letters are 12 high: they can be read where a page is shown in as many pixels.
const WIDTH: f64 = 1024.0;
/// Space at the edges.
const EDGE: f64 = 32.0;
/// Width of what is between them.
const INNER: f64 = WIDTH - 2.0 * EDGE;

const TITLE: (Typeface, f64) = (Typeface::Bold, 26.0);
const HEADING: (Typeface, f64) = (Typeface::Bold, 15.0);
const TEXT: (Typeface, f64) = (Typeface::Regular, 15.0);
const STRONG: (Typeface, f64) = (Typeface::Bold, 15.0);
const SMALL: (Typeface, f64) = (Typeface::Regular, 13.0);
const PRINT: (Typeface, f64) = (Typeface::Regular, 12.0);

/// The picture of a result: of its structure, or of all with a row of numbers for each.
#[must_use]
pub fn picture(record: &Record) -> Page {
    match record.model.structures.as_slice() {
        [only] => structure::page(record, only, structure::Detail::Picture),
        _ => overview::page(record),
    }
}

/// Pages that are drawn at a time: a picture takes 50 MiB while it is drawn, and a run has 256 MiB.
const AT_A_TIME: usize = 2;
/// Structures that have rows and a page in a report. A body has some hundreds; who has more reads the numbers elsewhere.
const MOST_STRUCTURES: usize = 500;

/// A page for each structure, with everything that its verdict rests on; of several structures some before them that
/// show them together.
pub fn pages(record: &Record) -> impl Iterator<Item = Page> + '_ {
    let structures = &record.model.structures;
    let overview = if structures.len() > 1 { overview::pages(record) } else { Vec::new() };
    let each = structures[..structures.len().min(MOST_STRUCTURES)].chunks(AT_A_TIME).flat_map(move |some| {
        let page = |structure| structure::page(record, structure, structure::Detail::Report);
        some.par_iter().map(page).collect::<Vec<Page>>()
    });
    overview.into_iter().chain(each)
}
