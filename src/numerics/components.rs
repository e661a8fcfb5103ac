//! Connected components of voxel sets.

use crate::space::Grid;

/// Which voxels touch.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Connectivity {
    /// Through faces.
    Faces6,
    /// Through faces, edges and corners.
    Corners26,
}

/// Component number of every voxel (0 outside the set, then 1, 2, … in order of their first
/// voxel) and the number of voxels of each.
#[derive(Clone, Debug)]
pub struct Components {
    /// Number per voxel.
    pub labels: Grid<u32>,
    /// Voxels of component `k` at `k − 1`.
    pub sizes: Vec<usize>,
}

impl Components {
    /// Number of the largest component (the first of equals), or `None` of an empty set.
    #[must_use]
    pub fn largest(&self) -> Option<u32> {
        let mut best = None;
        for (k, &size) in self.sizes.iter().enumerate() {
            if best.is_none_or(|(_, s)| size > s) {
                best = Some((super::field::id(k + 1), size));
            }
        }
        best.map(|(k, _)| k)
    }
}

/// Components of the voxels for which `inside` (given offsets) holds.
pub fn components(dims: [usize; 3], connectivity: Connectivity, inside: impl Fn(usize) -> bool) -> Components {
    let mut labels = Grid::filled(dims, 0u32);
    let mut sizes = Vec::new();
    let mut stack = Vec::new();
    for start in 0..labels.as_slice().len() {
        if labels.as_slice()[start] != 0 || !inside(start) {
            continue;
        }
        let number = super::field::id(sizes.len() + 1);
        let mut size = 0;
        labels.as_mut_slice()[start] = number;
        stack.push(start);
        while let Some(offset) = stack.pop() {
            size += 1;
            neighbors(dims, offset, connectivity, |next| {
                if labels.as_slice()[next] == 0 && inside(next) {
                    labels.as_mut_slice()[next] = number;
                    stack.push(next);
                }
            });
        }
        sizes.push(size);
    }
    Components { labels, sizes }
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
