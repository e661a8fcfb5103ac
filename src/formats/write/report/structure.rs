//! The page of a structure.

use super::provenance::{self, add_foot, add_head, is_oriented};
use super::views::{Shown, add_views};
use super::{EDGE, HEADING, WIDTH, numbers, told, verdict};
use crate::drawing::page::INK;
use crate::drawing::{Page, Range};
use crate::formats::write::record::Record;
use crate::model::Structure;

/// How much a page says.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(super) enum Detail {
    /// What was measured, where, and the first reason of the verdict.
    Picture,
    /// All reasons and where everything comes from too.
    Report,
}

/// Pixels for each unit where a page is printed: 210 to the inch on A4.
const PRINT_DOTS: u32 = 2;

/// The page.
pub(super) fn page(record: &Record, structure: &Structure, detail: Detail) -> Page {
    let mut page = Page::new(WIDTH, if detail == Detail::Report { PRINT_DOTS } else { 1 });
    let mut end = add_head(&mut page, &told::name(structure), &under(structure));
    end = verdict::add(&mut page, end, structure) + 18.0;
    let place = structure.quality.deciding_reason().and_then(|reason| reason.place).map(|place| place.position);
    let shown = Shown {
        structures: std::slice::from_ref(structure),
        range: Range::of_thickness([structure]),
        is_oriented: is_oriented(record),
        place,
    };
    end = add_views(&mut page, end, shown) + 14.0;
    end = numbers::add(&mut page, end, structure) + 16.0;
    end = heading(&mut page, end, "How sure");
    end = numbers::add_trust(&mut page, end, structure) + 12.0;
    if detail == Detail::Report {
        end = heading(&mut page, end, "Reasons of the verdict, and warnings");
        end = verdict::add_all(&mut page, end, structure) + 12.0;
        end = heading(&mut page, end, "Where this comes from");
        end = provenance::add_all(&mut page, end, record) + 8.0;
    }
    page.size[1] = add_foot(&mut page, end, record) + 16.0;
    page
}

fn heading(page: &mut Page, top: f64, words: &str) -> f64 {
    page.words(words, [EDGE, top + 15.0], HEADING, INK);
    top + 20.0
}

/// What was measured.
fn under(structure: &Structure) -> String {
    format!(
        "Label {} · volume {} · {} · thickness is measured through the organ, from side to side across its medial sheet, \
         or across the centreline of a tube; weighted by area",
        structure.label,
        told::volume(structure.volume_mm3),
        told::figures(structure)
    )
}
