//! The branches of a solid: what a wave that runs through it from one end falls into.
//!
//! 1. Cells are taken in fronts, by the length of the shortest way to the first tip inside of the solid;
//! 2. each connected piece of a front is a knot, joined to those of the fronts before and after that it touches;
//! 3. knots in a row are a branch; one ends where the front parts, or where two fronts meet;
//! 4. a branch that ends sooner than the one it leaves is thick is a bump of that one, and two that run side by side for no
//!    longer are one: what parts them is no hole of this scale.
//!
//! A tree has a branch between each two of its forks; a ring has two, which meet.

use std::collections::BTreeSet;

use super::cells::Cells;
use crate::cancel::{Cancel, Cancelled};
use crate::numerics::field::floor_index;

/// Thickness of a front, cells. With 1 fronts have holes, as wide as ways by corners are longer than straight ones.
const FRONT: f64 = 2.0;
/// Length of a branch below which it is a bump, in radii of the one that it leaves at that place. With 0.5, the corners of
/// flat ends are branches; with 2, a side branch as long as its trunk is thick is none.
const BUMP: f64 = 1.0;

/// How far the ball of a front reaches, radii: ways by corners are longer than straight ones.
const REACH: f64 = 1.2;

/// A branch.
#[derive(Clone)]
pub struct Branch {
    /// Its cells, ascending.
    pub cells: Vec<usize>,
    /// The branches that it leads on from, nearer to the first tip.
    pub before: BTreeSet<usize>,
    /// Those that lead on from it.
    pub after: BTreeSet<usize>,
}

/// A branch in the making.
struct Run {
    cells: Vec<usize>,
    before: BTreeSet<usize>,
    after: BTreeSet<usize>,
    /// The first front.
    first: usize,
    /// The largest depth in each front from there on.
    depths: Vec<f64>,
}

/// The branches of a solid, in the order in which they begin; `lengths` are those of the ways from the first tip.
///
/// # Errors
/// When it is cancelled.
pub fn branches(cells: &Cells, lengths: &[f32], cancel: &dyn Cancel) -> Result<Vec<Branch>, Cancelled> {
    let mut runs = knots(cells, lengths, cancel)?;
    loop {
        cancel.check()?;
        if !(join_one(&mut runs) || drop_bump(&mut runs, cells.edge) || close_one(&mut runs, cells.edge)) {
            break;
        }
    }
    Ok(numbered(runs))
}

/// The pieces of all fronts, joined to those beside them.
fn knots(cells: &Cells, lengths: &[f32], cancel: &dyn Cancel) -> Result<Vec<Option<Run>>, Cancelled> {
    let front_of: Vec<usize> =
        lengths.iter().map(|length| floor_index(f64::from(*length) / (FRONT * cells.edge))).collect();
    let mut order: Vec<usize> = (0..cells.len()).collect();
    order.sort_by_key(|&cell| (front_of[cell], cell));
    let mut knot_of = vec![usize::MAX; cells.len()];
    let mut runs: Vec<Option<Run>> = Vec::new();
    for &first in &order {
        if knot_of[first] != usize::MAX {
            continue;
        }
        cancel.check()?;
        let (number, front) = (runs.len(), front_of[first]);
        let (mut members, mut waiting) = (Vec::new(), vec![first]);
        knot_of[first] = number;
        let (mut before, mut depth) = (BTreeSet::new(), 0.0f64);
        while let Some(cell) = waiting.pop() {
            members.push(cell);
            depth = depth.max(cells.depths[cell]);
            cells.near(cells.places[cell], 1, |next| {
                if front_of[next] == front && knot_of[next] == usize::MAX {
                    knot_of[next] = number;
                    waiting.push(next);
                } else if front_of[next] < front {
                    before.insert(knot_of[next]);
                }
            });
        }
        for &other in &before {
            if let Some(run) = &mut runs[other] {
                run.after.insert(number);
            }
        }
        let depths = vec![depth];
        runs.push(Some(Run { cells: members, before, after: BTreeSet::new(), first: front, depths }));
    }
    Ok(runs)
}

/// Joins two runs that lead on from each other alone, if there are such.
fn join_one(runs: &mut [Option<Run>]) -> bool {
    let mut is_changed = false;
    for number in 0..runs.len() {
        while let Some(next) = only_next(runs, number) {
            absorb(runs, number, next, true);
            is_changed = true;
        }
    }
    is_changed
}

/// The run that leads on from one, if it is the only one, and this the only one that it leads on from.
fn only_next(runs: &[Option<Run>], number: usize) -> Option<usize> {
    let run = runs[number].as_ref()?;
    let next = *run.after.first().filter(|_| run.after.len() == 1)?;
    let other = runs[next].as_ref()?;
    (other.before.len() == 1).then_some(next)
}

/// Takes the shortest branch that is a bump into the one that it leaves.
fn drop_bump(runs: &mut [Option<Run>], edge: f64) -> bool {
    let mut shortest: Option<(f64, usize, usize)> = None;
    for (number, run) in runs.iter().enumerate() {
        let Some(run) = run.as_ref().filter(|run| run.after.is_empty()) else { continue };
        for &from in &run.before {
            let Some(trunk) = &runs[from] else { continue };
            let length = length(run, edge);
            if length < BUMP * thickness(trunk, edge) && shortest.is_none_or(|shortest| length < shortest.0) {
                shortest = Some((length, from, number));
            }
        }
    }
    let Some((_, trunk, bump)) = shortest else { return false };
    absorb(runs, trunk, bump, false);
    true
}

/// Makes one of two branches that run side by side, from the same one to the same one, for a short way.
fn close_one(runs: &mut [Option<Run>], edge: f64) -> bool {
    for number in 0..runs.len() {
        let Some(run) = &runs[number] else { continue };
        if run.before.is_empty() || run.after.is_empty() {
            continue;
        }
        for other in number + 1..runs.len() {
            let Some(beside) = &runs[other] else { continue };
            if beside.before != run.before || beside.after != run.after {
                continue;
            }
            let trunk = run.before.iter().filter_map(|from| runs[*from].as_ref()).map(|trunk| thickness(trunk, edge));
            if length(run, edge).max(length(beside, edge)) < 2.0 * BUMP * trunk.fold(0.0, f64::max) {
                absorb(runs, number, other, false);
                return true;
            }
        }
    }
    false
}

fn length(run: &Run, edge: f64) -> f64 {
    run.depths.len() as f64 * FRONT * edge
}

/// How thick a run is where it ends: the largest of the inscribed balls of its fronts that reach to there.
fn thickness(run: &Run, edge: f64) -> f64 {
    let mut thickness = 0.0f64;
    for (back, depth) in run.depths.iter().rev().enumerate() {
        if back as f64 * FRONT * edge <= REACH * depth {
            thickness = thickness.max(*depth);
        }
    }
    thickness
}

/// Takes a run into another; `is_next`: it goes on from there.
fn absorb(runs: &mut [Option<Run>], into: usize, taken: usize, is_next: bool) {
    let Some(gone) = runs[taken].take() else { return };
    for &other in gone.before.iter().chain(&gone.after) {
        if let Some(other_run) = &mut runs[other] {
            for side in [&mut other_run.before, &mut other_run.after] {
                if side.remove(&taken) && other != into {
                    side.insert(into);
                }
            }
        }
    }
    if let Some(run) = &mut runs[into] {
        run.cells.extend(gone.cells);
        run.before.extend(gone.before.into_iter().filter(|other| *other != into));
        run.after.extend(gone.after.into_iter().filter(|other| *other != into));
        if is_next {
            // As many as there are fronts in both, in order.
            run.depths.resize(gone.first.saturating_sub(run.first), 0.0);
            run.depths.extend(gone.depths);
        }
    }
    // What comes before cannot come after too.
    let Some(run) = &mut runs[into] else { return };
    let both: Vec<usize> = run.before.intersection(&run.after).copied().collect();
    run.after.retain(|other| !both.contains(other));
    for other in both {
        if let Some(run) = &mut runs[other] {
            run.before.remove(&into);
        }
    }
}

/// The branches with one of them taken into one that it touches: the first that it leads on from, or that leads on from it.
/// `None` when it touches none.
pub fn without(branches: Vec<Branch>, taken: usize) -> Option<Vec<Branch>> {
    let into = *branches[taken].before.first().or(branches[taken].after.first())?;
    let mut runs = Vec::with_capacity(branches.len());
    for Branch { cells, before, after } in branches {
        runs.push(Some(Run { cells, before, after, first: 0, depths: Vec::new() }));
    }
    absorb(&mut runs, into, taken, false);
    join_one(&mut runs);
    Some(numbered(runs))
}

/// The runs that are left, numbered through.
fn numbered(runs: Vec<Option<Run>>) -> Vec<Branch> {
    let mut number = vec![usize::MAX; runs.len()];
    let mut count = 0;
    for (n, _) in runs.iter().enumerate().filter(|(_, run)| run.is_some()) {
        number[n] = count;
        count += 1;
    }
    let mut all = Vec::with_capacity(count);
    for run in runs.into_iter().flatten() {
        let renamed = |others: BTreeSet<usize>| others.into_iter().map(|other| number[other]).collect();
        let mut cells = run.cells;
        cells.sort_unstable();
        all.push(Branch { cells, before: renamed(run.before), after: renamed(run.after) });
    }
    all
}
