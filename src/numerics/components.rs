//! Connected components of voxel sets, found on runs: voxels in a row along the first axis. The
//! cost goes with the runs, of which a solid has one or two a row, not with the voxels.

use std::ops::Range;

use rayon::prelude::*;

use crate::space::Grid;

use super::field::id;
use crate::cancel::{Cancel, Cancelled};

/// Which voxels touch.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Connectivity {
    /// Through faces.
    Faces6,
    /// Through faces, edges and corners.
    Corners26,
}

/// Voxels `from..to` of a row.
#[derive(Clone, Copy, Debug)]
struct Run {
    row: u32,
    from: u32,
    to: u32,
}

/// The components of a set, numbered 0, 1, … in the order of their first voxel.
#[derive(Clone, Debug)]
pub struct Components {
    /// Voxels in a row of the grid.
    width: usize,
    /// All runs, ascending.
    runs: Vec<Run>,
    /// Component of each run.
    number: Vec<u32>,
    /// Voxels of each component.
    pub sizes: Vec<usize>,
}

impl Components {
    /// Number of the largest component (the first of equals), or `None` of an empty set.
    #[must_use]
    pub fn largest(&self) -> Option<u32> {
        let mut best: Option<usize> = None;
        for (k, &size) in self.sizes.iter().enumerate() {
            if best.is_none_or(|b| size > self.sizes[b]) {
                best = Some(k);
            }
        }
        best.map(id)
    }

    /// The component that the grid's first voxel is in, if it is in the set.
    #[must_use]
    pub fn of_first_voxel(&self) -> Option<u32> {
        self.runs.first().is_some_and(|run| run.row == 0 && run.from == 0).then_some(0)
    }

    /// Sets the voxels of all components but one, and returns their number.
    pub fn set_all_but(&self, kept: Option<u32>, grid: &mut Grid<bool>, value: bool) -> usize {
        let mut count = 0;
        for (run, number) in self.runs.iter().zip(&self.number) {
            if Some(*number) != kept {
                let start = run.row as usize * self.width;
                grid.as_mut_slice()[start + run.from as usize..start + run.to as usize].fill(value);
                count += (run.to - run.from) as usize;
            }
        }
        count
    }
}

/// Components of the voxels of `grid` that are `value`.
///
/// # Errors
/// When it is cancelled.
pub fn components(
    grid: &Grid<bool>,
    value: bool,
    connectivity: Connectivity,
    cancel: &dyn Cancel,
) -> Result<Components, Cancelled> {
    /// Runs that are numbered between two looks at whether to stop.
    const RUNS: usize = 1 << 16;
    let [width, ny, nz] = grid.dims();
    let (runs, first_of_row) = runs_of(grid, value, cancel)?;
    let mut parent: Vec<u32> = (0..id(runs.len())).collect();
    for (k, j) in (0..nz).flat_map(|k| (0..ny).map(move |j| (k, j))) {
        cancel.check()?;
        let row = j + ny * k;
        let is_diagonal = connectivity == Connectivity::Corners26;
        let before = [
            (j > 0).then(|| row - 1),
            (k > 0).then(|| row - ny),
            (is_diagonal && k > 0 && j > 0).then(|| row - ny - 1),
            (is_diagonal && k > 0 && j + 1 < ny).then(|| row - ny + 1),
        ];
        let of_row = |row: usize| first_of_row[row]..first_of_row[row + 1];
        for other in before.into_iter().flatten() {
            touching(&runs, of_row(row), of_row(other), u32::from(is_diagonal), |a, b| unite(&mut parent, a, b));
        }
    }
    let (mut number, mut sizes) = (vec![0; runs.len()], Vec::new());
    for (k, run) in runs.iter().enumerate() {
        if k.is_multiple_of(RUNS) {
            cancel.check()?;
        }
        // The root of a component is its first run.
        let root = root(&mut parent, id(k)) as usize;
        number[k] = if root == k { id(sizes.len()) } else { number[root] };
        sizes.resize(sizes.len().max(number[k] as usize + 1), 0);
        sizes[number[k] as usize] += (run.to - run.from) as usize;
    }
    Ok(Components { width, runs, number, sizes })
}

/// All runs, and the number of the first run of every row, with that of all at the end.
fn runs_of(grid: &Grid<bool>, value: bool, cancel: &dyn Cancel) -> Result<(Vec<Run>, Vec<usize>), Cancelled> {
    let [nx, ny, _] = grid.dims();
    let of_plane = |(k, plane): (usize, &[bool])| {
        cancel.check()?;
        let mut runs = Vec::new();
        for (j, row) in plane.chunks_exact(nx).enumerate() {
            let mut at = 0;
            while let Some(skipped) = row[at..].iter().position(|v| *v == value) {
                let from = at + skipped;
                at = row[from..].iter().position(|v| *v != value).map_or(nx, |length| from + length);
                runs.push(Run { row: id(j + ny * k), from: id(from), to: id(at) });
            }
        }
        Ok(runs)
    };
    let planes = grid.as_slice().par_chunks(nx * ny).enumerate();
    let runs: Vec<Vec<Run>> = planes.map(of_plane).collect::<Result<_, Cancelled>>()?;
    let runs = runs.concat();
    let mut first_of_row = Vec::new();
    for (k, run) in runs.iter().enumerate() {
        first_of_row.resize((run.row as usize + 1).max(first_of_row.len()), k);
    }
    first_of_row.resize(grid.as_slice().len() / nx + 1, runs.len());
    Ok((runs, first_of_row))
}

/// Calls `meet` with every pair of runs of two neighbouring rows that overlap, or lie no more than
/// `slack` apart.
fn touching(runs: &[Run], mut a: Range<usize>, mut b: Range<usize>, slack: u32, mut meet: impl FnMut(u32, u32)) {
    while !a.is_empty() && !b.is_empty() {
        let (p, q) = (runs[a.start], runs[b.start]);
        if p.from < q.to + slack && q.from < p.to + slack {
            meet(id(a.start), id(b.start));
        }
        if p.to < q.to {
            a.start += 1;
        } else {
            b.start += 1;
        }
    }
}

fn root(parent: &mut [u32], mut run: u32) -> u32 {
    while parent[run as usize] != run {
        let above = parent[parent[run as usize] as usize];
        parent[run as usize] = above;
        run = above;
    }
    run
}

/// The earlier of two roots becomes that of both.
fn unite(parent: &mut [u32], a: u32, b: u32) {
    let (a, b) = (root(parent, a), root(parent, b));
    parent[a.max(b) as usize] = a.min(b);
}

/// Voxels that are `value` with a face on one that is not, ascending. The grid's edge is no face.
///
/// # Errors
/// When it is cancelled.
pub fn boundary_voxels(grid: &Grid<bool>, value: bool, cancel: &dyn Cancel) -> Result<Vec<usize>, Cancelled> {
    let [nx, ny, nz] = grid.dims();
    let cells = grid.as_slice();
    let of_row = |row: usize| {
        cancel.check()?;
        let (j, k, start) = (row % ny, row / ny, row * nx);
        let at = |row: usize| &cells[row * nx..(row + 1) * nx];
        let own = at(row);
        let mut found = Vec::new();
        if !own.contains(&value) {
            return Ok(found);
        }
        let beside = [
            at(if j > 0 { row - 1 } else { row }),
            at(if j + 1 < ny { row + 1 } else { row }),
            at(if k > 0 { row - ny } else { row }),
            at(if k + 1 < nz { row + ny } else { row }),
        ];
        for x in (0..nx).filter(|&x| own[x] == value) {
            let ends = own[x.saturating_sub(1)] != value || own[(x + 1).min(nx - 1)] != value;
            if ends || beside.iter().any(|row| row[x] != value) {
                found.push(start + x);
            }
        }
        Ok(found)
    };
    let rows = (0..ny * nz).into_par_iter().with_min_len(64).map(of_row);
    Ok(rows.collect::<Result<Vec<Vec<usize>>, Cancelled>>()?.concat())
}

/// Calls `visit` with the offset of every neighbour inside the grid.
pub fn neighbors(dims: [usize; 3], offset: usize, connectivity: Connectivity, mut visit: impl FnMut(usize)) {
    let [nx, ny, nz] = dims;
    let at = [offset % nx, offset / nx % ny, offset / (nx * ny)];
    let low = at.map(|x| x.saturating_sub(1));
    let high = [(at[0] + 1).min(nx - 1), (at[1] + 1).min(ny - 1), (at[2] + 1).min(nz - 1)];
    for k in low[2]..=high[2] {
        for j in low[1]..=high[1] {
            for i in low[0]..=high[0] {
                let moved = usize::from(i != at[0]) + usize::from(j != at[1]) + usize::from(k != at[2]);
                let touches = match connectivity {
                    Connectivity::Faces6 => moved == 1,
                    Connectivity::Corners26 => moved >= 1,
                };
                if touches {
                    visit(i + nx * (j + ny * k));
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cancel::Never;

    /// Sizes in the order of the first voxel, by growing one voxel at a time.
    fn grown(grid: &Grid<bool>, connectivity: Connectivity) -> Vec<usize> {
        let mut left = grid.as_slice().to_vec();
        let mut sizes = Vec::new();
        while let Some(start) = left.iter().position(|v| *v) {
            let (mut stack, mut size) = (vec![start], 0);
            left[start] = false;
            while let Some(offset) = stack.pop() {
                size += 1;
                neighbors(grid.dims(), offset, connectivity, |n| {
                    if std::mem::replace(&mut left[n], false) {
                        stack.push(n);
                    }
                });
            }
            sizes.push(size);
        }
        sizes
    }

    #[test]
    fn runs_find_the_components_that_growing_finds() {
        for (divisor, limit) in [(7, 3), (5, 2), (11, 4), (3, 1), (2, 1)] {
            let dims = [9, 8, 7];
            let cells = (0..504usize).map(|o| (o * o * 31 + o * 7919 + 13) % 1009 % divisor < limit).collect();
            let grid = Grid::from_vec(dims, cells).expect("9 × 8 × 7 voxels");
            for connectivity in [Connectivity::Faces6, Connectivity::Corners26] {
                let found = components(&grid, true, connectivity, &Never).expect("not stopped");
                assert_eq!(found.sizes, grown(&grid, connectivity));
            }
        }
    }

    #[test]
    fn an_empty_set_has_no_component() {
        let empty = Grid::filled([3, 2, 2], false);
        let found = components(&empty, true, Connectivity::Corners26, &Never).expect("not stopped");
        assert!(found.sizes.is_empty() && found.largest().is_none() && found.of_first_voxel().is_none());
    }
}
