//! Breadth-first search over nodes that know which others they touch.

use crate::cancel::{Cancel, Cancelled};

/// Goes from `starts` on to every node that `enter(from, to)` lets in, the nearest first; returns all of them, the starts first.
/// `enter` is asked for every node that one which is in touches, and must let each in once.
///
/// # Errors
/// When it is cancelled.
pub fn flood(
    adjacency: &[Vec<u32>],
    starts: Vec<u32>,
    mut enter: impl FnMut(u32, u32) -> bool,
    cancel: &dyn Cancel,
) -> Result<Vec<u32>, Cancelled> {
    let mut reached = starts;
    let mut next = 0;
    while next < reached.len() {
        cancel.check()?;
        let from = reached[next];
        for &to in &adjacency[from as usize] {
            if enter(from, to) {
                reached.push(to);
            }
        }
        next += 1;
    }
    Ok(reached)
}

/// The nodes within `steps` of a start, itself first, in the order of their steps.
#[must_use]
pub fn within_steps(adjacency: &[Vec<u32>], start: u32, steps: usize) -> Vec<u32> {
    stepped(adjacency, start, steps, |_| false).0
}

/// Whether any node within `steps` of a start, itself included, is of a kind. It looks no further than to the first.
#[must_use]
pub fn any_within_steps(adjacency: &[Vec<u32>], start: u32, steps: usize, is_of_kind: impl Fn(u32) -> bool) -> bool {
    stepped(adjacency, start, steps, is_of_kind).1
}

/// The nodes within `steps` of a start up to the first that is of a kind, and whether there is one.
fn stepped(adjacency: &[Vec<u32>], start: u32, steps: usize, is_last: impl Fn(u32) -> bool) -> (Vec<u32>, bool) {
    let mut reached = vec![start];
    if is_last(start) {
        return (reached, true);
    }
    let mut layer = 0;
    for _ in 0..steps {
        let end = reached.len();
        for at in layer..end {
            for &to in &adjacency[reached[at] as usize] {
                // A few steps reach a few dozen nodes: a search is faster than a table of all.
                if reached.contains(&to) {
                    continue;
                }
                reached.push(to);
                if is_last(to) {
                    return (reached, true);
                }
            }
        }
        layer = end;
    }
    (reached, false)
}

/// The connected pieces of the nodes of a kind, by their first nodes; each is in the order in which a search from
/// its first node finds it.
///
/// # Errors
/// When it is cancelled.
pub fn pieces(
    adjacency: &[Vec<u32>],
    is_of_kind: impl Fn(u32) -> bool,
    cancel: &dyn Cancel,
) -> Result<Vec<Vec<u32>>, Cancelled> {
    let mut is_seen = vec![false; adjacency.len()];
    let mut pieces = Vec::new();
    for start in 0..super::field::id(adjacency.len()) {
        if is_seen[start as usize] || !is_of_kind(start) {
            continue;
        }
        is_seen[start as usize] = true;
        let enter = |_, to: u32| is_of_kind(to) && !std::mem::replace(&mut is_seen[to as usize], true);
        pieces.push(flood(adjacency, vec![start], enter, cancel)?);
    }
    Ok(pieces)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cancel::Never;

    /// A ring of six and a pair.
    fn ring_and_pair() -> Vec<Vec<u32>> {
        let ring = (0..6u32).map(|a| vec![(a + 5) % 6, (a + 1) % 6]);
        ring.chain([vec![7], vec![6]]).collect()
    }

    #[test]
    fn pieces_are_found_by_their_first_nodes() {
        let all = pieces(&ring_and_pair(), |_| true, &Never);
        assert_eq!(all, Ok(vec![vec![0, 5, 1, 4, 2, 3], vec![6, 7]]));
        let without = pieces(&ring_and_pair(), |node| node != 0 && node != 3, &Never);
        assert_eq!(without, Ok(vec![vec![1, 2], vec![4, 5], vec![6, 7]]));
    }

    #[test]
    fn steps_are_counted_along_the_graph() {
        assert_eq!(within_steps(&ring_and_pair(), 2, 1), [2, 1, 3]);
        assert_eq!(within_steps(&ring_and_pair(), 6, 9), [6, 7]);
        let is_any = |start, steps| any_within_steps(&ring_and_pair(), start, steps, |node| node == 3);
        assert_eq!([is_any(2, 0), is_any(2, 1), is_any(3, 0), is_any(6, 9)], [false, true, true, false]);
    }
}
