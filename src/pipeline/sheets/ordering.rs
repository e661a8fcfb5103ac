//! Step 6: sheets in the order of their size, those of nearly one size in the order of their place in the world.

use std::cmp::Reverse;
use std::collections::BTreeMap;

use nalgebra::Point3;

use super::junctions::hinges;
use super::{NO_SHEET, Sheets};
use crate::cancel::{Cancel, Cancelled};
use crate::numerics::field::id;
use crate::pipeline::medial::MedialSurface;
use crate::pipeline::solid::Solid;

/// Share of a sheet's size from which another is as large: noise changes sizes by a tenth. With 1, the halves of a kidney
/// change places under a turned grid.
const AS_LARGE: f64 = 0.8;

/// A sheet before it has a number.
struct Candidate {
    label: u32,
    size: usize,
    /// How far its middle lies towards positive directions of the world.
    lead: f64,
}

/// Renumbers the sheets, the largest first; of those that are nearly as large the one that lies farther superior, where
/// anterior and lateral count less.
///
/// # Errors
/// When it is cancelled.
pub fn in_order(
    surface: &MedialSurface,
    solid: &Solid,
    label: &[u32],
    pruned: usize,
    cancel: &dyn Cancel,
) -> Result<Sheets, Cancelled> {
    let order = ordered(surface, solid, label);
    let mut number_of = BTreeMap::new();
    for (number, sheet) in order.iter().enumerate() {
        number_of.insert(*sheet, number);
    }
    let mut sheet_of = vec![NO_SHEET; label.len()];
    let mut members = vec![Vec::new(); order.len()];
    for (p, sheet) in label.iter().enumerate() {
        if let Some(&number) = number_of.get(sheet) {
            sheet_of[p] = id(number);
            members[number].push(id(p));
        }
    }
    let hinges = hinges(surface, &sheet_of, cancel)?;
    Ok(Sheets { sheet_of, members, hinges, pruned })
}

/// The labels of the sheets in their order.
fn ordered(surface: &MedialSurface, solid: &Solid, label: &[u32]) -> Vec<u32> {
    let mut sums: BTreeMap<u32, (usize, f64)> = BTreeMap::new();
    for (point, sheet) in surface.points.iter().zip(label) {
        let (size, sum) = sums.entry(*sheet).or_default();
        *size += 1;
        *sum += lead(solid, point.position);
    }
    sums.remove(&NO_SHEET);
    let mut rest = Vec::new();
    for (label, (size, sum)) in sums {
        rest.push(Candidate { label, size, lead: sum / size as f64 });
    }
    rest.sort_by_key(|c| (Reverse(c.size), c.label));
    let mut order = Vec::new();
    let mut group = rest.as_mut_slice();
    while let Some(first) = group.first() {
        let least = AS_LARGE * first.size as f64;
        let count = group.partition_point(|c| c.size as f64 >= least);
        let (alike, smaller) = group.split_at_mut(count);
        alike.sort_by(|a, b| b.lead.total_cmp(&a.lead));
        order.extend(alike.iter().map(|c| c.label));
        group = smaller;
    }
    order
}

/// How far a point of work space lies towards positive directions of the world, mm.
fn lead(solid: &Solid, position: Point3<f64>) -> f64 {
    /// Weights of lateral, anterior and superior: no two sheets of an organ lie level in all of them.
    const WEIGHTS: [f64; 3] = [0.25, 0.5, 1.0];
    let world = solid.world_from_work.point(position);
    let [lateral, anterior, superior] = WEIGHTS;
    lateral * solid.senses.lateral() * world.x + anterior * world.y + superior * world.z
}
