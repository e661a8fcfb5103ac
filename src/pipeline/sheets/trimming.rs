//! Step 5: points that run into edges of the boundary are taken off the sheets.

use super::junctions::is_third_near;
use super::links::is_sure;
use super::{NO_SHEET, sizes};
use crate::cancel::{Cancel, Cancelled};
use crate::numerics::flood::flood;
use crate::pipeline::medial::MedialSurface;
use crate::pipeline::surface::picked;

/// No point.
const NONE: u32 = u32::MAX;

/// Points that are not sure stay only near another sheet, where they make the junction, or where
/// they hold a sheet together. Elsewhere they are the start of a sheet that runs into an edge of
/// the boundary.
pub(super) fn trim_edges(surface: &MedialSurface, label: &mut [u32], cancel: &dyn Cancel) -> Result<(), Cancelled> {
    let before = label.to_vec();
    for (p, sheet) in (0..).zip(label.iter_mut()) {
        cancel.check()?;
        if *sheet != NO_SHEET && !is_sure(surface, p) && !is_third_near(surface, &before, (*sheet, *sheet), p) {
            *sheet = NO_SHEET;
        }
    }
    for sheet in sizes(label).into_keys() {
        hold_together(surface, &before, label, sheet, cancel)?;
    }
    Ok(())
}

/// Joins the pieces of a trimmed sheet to its largest one by the shortest paths over points that
/// were trimmed.
fn hold_together(
    surface: &MedialSurface,
    before: &[u32],
    label: &mut [u32],
    sheet: u32,
    cancel: &dyn Cancel,
) -> Result<(), Cancelled> {
    let members = points_of(label, sheet);
    let starts = picked(&members, &surface.part(&members, cancel)?.largest_piece(cancel)?);
    let mut paths = Paths { sheet, before, came_from: vec![NONE; label.len()], label };
    for &p in &starts {
        paths.came_from[p as usize] = p;
    }
    flood(&surface.adjacency, starts, |from, to| paths.enter(from, to), cancel)?;
    Ok(())
}

/// Points of a sheet, ascending.
fn points_of(label: &[u32], sheet: u32) -> Vec<u32> {
    let mut points = Vec::new();
    for (p, &of) in (0..).zip(label) {
        if of == sheet {
            points.push(p);
        }
    }
    points
}

/// The shortest paths from the largest piece of a trimmed sheet.
struct Paths<'a> {
    sheet: u32,
    /// Sheets before trimming.
    before: &'a [u32],
    /// And after it.
    label: &'a mut [u32],
    /// The point before each on its path, [`NONE`] of those not reached.
    came_from: Vec<u32>,
}

impl Paths<'_> {
    /// Whether a path goes on to a point. One that is in the sheet gets the path to it back.
    fn enter(&mut self, from: u32, to: u32) -> bool {
        if self.came_from[to as usize] != NONE || self.before[to as usize] != self.sheet {
            return false;
        }
        self.came_from[to as usize] = from;
        if self.label[to as usize] == self.sheet {
            let mut on_path = from;
            while self.label[on_path as usize] != self.sheet {
                self.label[on_path as usize] = self.sheet;
                on_path = self.came_from[on_path as usize];
            }
        }
        true
    }
}
