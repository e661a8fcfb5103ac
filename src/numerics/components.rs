//! Connected components of voxel sets, found on runs: voxels in a row along the first axis. The
//! cost goes with the runs, of which a solid has one or two a row, not with the voxels.

use std::ops::Range;

use crate::space::{Grid, VoxelIndex};

use super::field::id;
use super::parallel::each_number;
use crate::cancel::{Cancel, Cancelled};

/// Rows of voxels that one thread takes at a time; fewer are not worth handing over.
const ROWS_PER_TASK: usize = 64;

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

impl Run {
    /// Its row and plane; there are `height` rows in a plane.
    fn place(&self, height: usize) -> [usize; 2] {
        [self.row as usize % height, self.row as usize / height]
    }
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

    /// A component with one free voxel all around it, and its first voxel's place in the whole. The component must not
    /// touch the edge of the whole; there are `height` rows in a plane of it.
    #[must_use]
    pub(crate) fn cut_out(&self, kept: u32, height: usize) -> (Grid<bool>, VoxelIndex) {
        let (mut low, mut high) = ([usize::MAX; 3], [0; 3]);
        for run in self.runs_of(kept) {
            let [j, k] = run.place(height);
            let ends = [[run.from as usize, j, k], [run.to as usize - 1, j, k]];
            for axis in 0..3 {
                low[axis] = low[axis].min(ends[0][axis]);
                high[axis] = high[axis].max(ends[1][axis]);
            }
        }
        let first = low.map(|x| x.saturating_sub(1));
        let mut own = Grid::filled([0, 1, 2].map(|axis| (high[axis] + 2).saturating_sub(first[axis])), false);
        for run in self.runs_of(kept) {
            let [j, k] = run.place(height);
            let start = own.offset([run.from as usize - first[0], j - first[1], k - first[2]]);
            own.as_mut_slice()[start..start + (run.to - run.from) as usize].fill(true);
        }
        (own, first)
    }

    /// The runs of a component, ascending.
    fn runs_of(&self, wanted: u32) -> impl Iterator<Item = &Run> {
        let numbered = self.runs.iter().zip(&self.number);
        numbered.filter(move |(_, number)| **number == wanted).map(|(run, _)| run)
    }

    /// Numbers of the components, the largest first, of equals the first.
    #[must_use]
    pub fn by_size(&self) -> Vec<u32> {
        let mut numbers: Vec<u32> = (0..id(self.sizes.len())).collect();
        numbers.sort_by_key(|number| std::cmp::Reverse(self.sizes[*number as usize]));
        numbers
    }

    /// Sets the voxels of all components but some, and returns their number.
    pub fn set_all_but(&self, kept: &[u32], grid: &mut Grid<bool>, value: bool) -> usize {
        let mut count = 0;
        for (run, number) in self.runs.iter().zip(&self.number) {
            if !kept.contains(number) {
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
    for row in 0..ny * nz {
        cancel.check()?;
        for other in rows_before(row, ny, connectivity).into_iter().flatten() {
            let (a, b) = (first_of_row[row]..first_of_row[row + 1], first_of_row[other]..first_of_row[other + 1]);
            unite_touching(&runs, a, b, connectivity, &mut parent);
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
    let [nx, _, nz] = grid.dims();
    let runs = each_number(nz, 1, |k| runs_of_plane(grid, k, value), cancel)?.concat();
    let mut first_of_row = Vec::new();
    for (k, run) in runs.iter().enumerate() {
        first_of_row.resize((run.row as usize + 1).max(first_of_row.len()), k);
    }
    first_of_row.resize(grid.as_slice().len() / nx + 1, runs.len());
    Ok((runs, first_of_row))
}

/// The runs of a plane.
fn runs_of_plane(grid: &Grid<bool>, k: usize, value: bool) -> Vec<Run> {
    let [nx, ny, _] = grid.dims();
    let mut runs = Vec::new();
    for number in k * ny..(k + 1) * ny {
        let row = row_of(grid, number);
        let mut at = 0;
        while let Some(skipped) = row[at..].iter().position(|v| *v == value) {
            let from = at + skipped;
            at = row[from..].iter().position(|v| *v != value).map_or(nx, |length| from + length);
            runs.push(Run { row: id(number), from: id(from), to: id(at) });
        }
    }
    runs
}

/// The rows before one whose voxels may touch those of it; there are `ny` in a plane.
fn rows_before(row: usize, ny: usize, connectivity: Connectivity) -> [Option<usize>; 4] {
    let (j, has_plane) = (row % ny, row >= ny);
    let is_diagonal = has_plane && connectivity == Connectivity::Corners26;
    [
        (j > 0).then_some(row.wrapping_sub(1)),
        has_plane.then_some(row.wrapping_sub(ny)),
        (is_diagonal && j > 0).then_some(row.wrapping_sub(ny + 1)),
        (is_diagonal && j + 1 < ny).then_some((row + 1).wrapping_sub(ny)),
    ]
}

/// Makes one component of every two runs of two neighbouring rows that touch: that overlap, or meet at a corner.
fn unite_touching(
    runs: &[Run],
    mut a: Range<usize>,
    mut b: Range<usize>,
    connectivity: Connectivity,
    parent: &mut [u32],
) {
    let slack = u32::from(connectivity == Connectivity::Corners26);
    while !a.is_empty() && !b.is_empty() {
        let (p, q) = (runs[a.start], runs[b.start]);
        if p.from < q.to + slack && q.from < p.to + slack {
            unite(parent, id(a.start), id(b.start));
        }
        if p.to < q.to {
            a.start += 1;
        } else {
            b.start += 1;
        }
    }
}

/// The first run of the component that a run is in, so far as it is known.
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
    let [_, ny, nz] = grid.dims();
    Ok(each_number(ny * nz, ROWS_PER_TASK, |row| boundary_of_row(grid, value, row), cancel)?.concat())
}

/// Those of a row.
fn boundary_of_row(grid: &Grid<bool>, value: bool, row: usize) -> Vec<usize> {
    let [nx, ny, nz] = grid.dims();
    let (j, k) = (row % ny, row / ny);
    let mut found = Vec::new();
    let own = row_of(grid, row);
    if !own.contains(&value) {
        return found;
    }
    let beside = [
        row_of(grid, if j > 0 { row - 1 } else { row }),
        row_of(grid, if j + 1 < ny { row + 1 } else { row }),
        row_of(grid, if k > 0 { row - ny } else { row }),
        row_of(grid, if k + 1 < nz { row + ny } else { row }),
    ];
    for x in 0..nx {
        if own[x] != value {
            continue;
        }
        let is_at_end = own[x.saturating_sub(1)] != value || own[(x + 1).min(nx - 1)] != value;
        if is_at_end || beside.iter().any(|row| row[x] != value) {
            found.push(row * nx + x);
        }
    }
    found
}

fn row_of(grid: &Grid<bool>, row: usize) -> &[bool] {
    let nx = grid.dims()[0];
    &grid.as_slice()[row * nx..(row + 1) * nx]
}

/// Calls `visit` with the offset of every neighbour inside the grid: what runs are compared with.
#[cfg(test)]
pub(super) fn neighbors(dims: [usize; 3], offset: usize, connectivity: Connectivity, mut visit: impl FnMut(usize)) {
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
    fn a_component_is_cut_out_with_room_around() {
        let mut grid = Grid::filled([9, 7, 6], false);
        let own = [[5, 2, 2], [6, 3, 2], [6, 3, 3]];
        for at in own.iter().chain(&[[1, 1, 1]]) {
            grid[*at] = true;
        }
        let found = components(&grid, true, Connectivity::Corners26, &Never).expect("not stopped");
        let (cut, first) = found.cut_out(1, 7);
        assert_eq!((found.sizes, cut.dims(), first), (vec![1, 3], [4, 4, 4], [4, 1, 1]));
        assert_eq!(cut.as_slice().iter().filter(|is_in| **is_in).count(), 3);
        assert!(own.iter().all(|at| cut[[0, 1, 2].map(|axis| at[axis] - first[axis])]));
    }

    #[test]
    fn an_empty_set_has_no_component() {
        let empty = Grid::filled([3, 2, 2], false);
        let found = components(&empty, true, Connectivity::Corners26, &Never).expect("not stopped");
        assert!(found.sizes.is_empty() && found.largest().is_none() && found.of_first_voxel().is_none());
    }
}
