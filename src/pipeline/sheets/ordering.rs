//! Step 6: sheets in the order of their size.

use std::collections::BTreeMap;

use super::junctions::hinges;
use super::{NO_SHEET, Sheets, sizes};
use crate::cancel::{Cancel, Cancelled};
use crate::numerics::field::id;
use crate::pipeline::medial::MedialSurface;

/// Renumbers the sheets, the largest first; of equals the one with the smaller number.
///
/// # Errors
/// When it is cancelled.
pub fn in_order_of_size(
    surface: &MedialSurface,
    label: &[u32],
    pruned: usize,
    cancel: &dyn Cancel,
) -> Result<Sheets, Cancelled> {
    let mut order: Vec<(u32, usize)> = sizes(label).into_iter().collect();
    order.sort_by(|a, b| b.1.cmp(&a.1).then(a.0.cmp(&b.0)));
    let mut number_of = BTreeMap::new();
    for (number, (sheet, _)) in order.iter().enumerate() {
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
