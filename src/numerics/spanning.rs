//! Spreading something over a graph along its strongest links first.

use std::cmp::Reverse;
use std::collections::BinaryHeap;

use super::field::id;
use crate::cancel::{Cancel, Cancelled};

/// Visits every node once, along a maximum spanning tree of each piece: `visit(node, from)`, where `from` was visited
/// before. The first node of a piece, its smallest, comes from itself. `strength` of a link must not be negative; of
/// equal links the one to the smaller node is taken.
///
/// # Errors
/// When it is cancelled.
pub fn along_strongest(
    adjacency: &[Vec<u32>],
    strength: impl Fn(usize, usize) -> f64,
    mut visit: impl FnMut(usize, usize),
    cancel: &dyn Cancel,
) -> Result<(), Cancelled> {
    let mut is_done = vec![false; adjacency.len()];
    for start in 0..adjacency.len() {
        let mut heap = BinaryHeap::new();
        heap.push((0u64, Reverse(id(start)), id(start)));
        while let Some((_, Reverse(to), from)) = heap.pop() {
            cancel.check()?;
            let (to, from) = (to as usize, from as usize);
            if std::mem::replace(&mut is_done[to], true) {
                continue;
            }
            visit(to, from);
            for &next in &adjacency[to] {
                if !is_done[next as usize] {
                    // Bits of numbers that are not negative are in the order of the numbers.
                    heap.push((strength(to, next as usize).to_bits(), Reverse(next), id(to)));
                }
            }
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cancel::{Never, Stopped};

    #[test]
    fn the_strongest_links_are_taken_and_every_piece_is_visited() {
        // A triangle whose link 0-1 is weak, and a node alone.
        let adjacency = [vec![1, 2], vec![0, 2], vec![0, 1], vec![]];
        let strength = |a: usize, b: usize| if a + b == 1 { 0.1 } else { 0.9 };
        let mut visits = Vec::new();
        along_strongest(&adjacency, strength, |to, from| visits.push((to, from)), &Never).unwrap();
        assert_eq!(visits, [(0, 0), (2, 0), (1, 2), (3, 3)]);
        assert_eq!(along_strongest(&adjacency, strength, |_, _| (), &Stopped), Err(Cancelled));
    }
}
