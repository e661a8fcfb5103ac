//! The lattice of a figure: its size, the nodes round its edge, and which nodes are neighbours.

use serde::{Deserialize, Serialize};

/// Lattice size: `rows` across the shorter intrinsic axis, `cols` along the longer.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct LatticeSize {
    /// Nodes across (i).
    pub rows: usize,
    /// Nodes along (j).
    pub cols: usize,
}

impl LatticeSize {
    /// The nodes of a quad as row-major offsets `[(i, j), (i, j+1), (i+1, j), (i+1, j+1)]`.
    #[must_use]
    pub fn quad(self, i: usize, j: usize) -> [usize; 4] {
        let first = i * self.cols + j;
        [first, first + 1, first + self.cols, first + self.cols + 1]
    }
}

/// The nodes round the edge of a lattice as row-major offsets: (0,0)…(0,M−1), (1,M−1)…(N−1,M−1),
/// (N−1,M−2)…(N−1,0), (N−2,0)…(1,0).
#[must_use]
pub fn ring(grid: LatticeSize) -> Vec<usize> {
    let LatticeSize { rows, cols } = grid;
    let top = (0..cols).map(|j| (0, j));
    let right = (1..rows).map(|i| (i, cols - 1));
    let bottom = (0..cols - 1).rev().map(|j| (rows - 1, j));
    let left = (1..rows - 1).rev().map(|i| (i, 0));
    top.chain(right).chain(bottom).chain(left).map(|(i, j)| i * cols + j).collect()
}

/// Which nodes of a lattice are neighbours. The columns of a *ring* run round it, and its last column is the first again: of
/// each node there, called the *twin*, the one in the first column is the *own* one.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Links {
    /// Lattice size.
    pub size: LatticeSize,
    /// Whether the last column is the first again.
    pub is_ring: bool,
}

impl Links {
    /// The own node of a node: but for the last column of a ring, itself.
    #[must_use]
    pub fn own(self, n: usize) -> usize {
        let cols = self.size.cols;
        if self.is_ring && n % cols == cols - 1 { n + 1 - cols } else { n }
    }

    /// The node that is the same as an own one.
    #[must_use]
    pub fn twin(self, n: usize) -> Option<usize> {
        let cols = self.size.cols;
        (self.is_ring && n.is_multiple_of(cols)).then_some(n + cols - 1)
    }

    /// Nodes around a node, row by row, itself not included: eight with those across the corner, four without.
    #[must_use]
    pub fn around(self, n: usize, diagonals: bool) -> Vec<usize> {
        let LatticeSize { rows, cols } = self.size;
        let (i, j) = (self.own(n) / cols, self.own(n) % cols);
        let mut around = Vec::with_capacity(8);
        for a in i.saturating_sub(1)..=(i + 1).min(rows - 1) {
            for b in self.beside(j, cols) {
                if (a, b) != (i, j) && (diagonals || a == i || b == j) {
                    around.push(a * cols + b);
                }
            }
        }
        around
    }

    /// A column and those beside it, of `count`; those of a ring without its last one, which is the first.
    fn beside(self, j: usize, count: usize) -> Vec<usize> {
        match (self.is_ring, j) {
            (true, 0) => vec![count - 2, 0, 1],
            (true, j) => vec![j - 1, j, (j + 1) % (count - 1)],
            (false, j) => (j.saturating_sub(1)..=(j + 1).min(count - 1)).collect(),
        }
    }

    /// The quads at a node, by their rows and columns.
    #[must_use]
    pub fn quads_at(self, n: usize) -> Vec<[usize; 2]> {
        let LatticeSize { rows, cols } = self.size;
        let (i, j) = (self.own(n) / cols, self.own(n) % cols);
        let columns =
            if self.is_ring && j == 0 { vec![cols - 2, 0] } else { (j.saturating_sub(1)..=j.min(cols - 2)).collect() };
        let mut quads = Vec::with_capacity(4);
        for a in i.saturating_sub(1)..=i.min(rows - 2) {
            quads.extend(columns.iter().map(|&b| [a, b]));
        }
        quads
    }

    /// Whether a node lies on the rim of the sheet; the *banks* of a ring, where it meets itself, are none.
    #[must_use]
    pub fn is_on_rim(self, n: usize) -> bool {
        let LatticeSize { rows, cols } = self.size;
        let (i, j) = (n / cols, n % cols);
        i == 0 || i + 1 == rows || (!self.is_ring && (j == 0 || j + 1 == cols))
    }

    /// Whether a step between two nodes of the edge leads along a bank of a ring.
    #[must_use]
    pub fn is_along_bank(self, [a, b]: [usize; 2]) -> bool {
        let cols = self.size.cols;
        self.is_ring && a % cols == b % cols
    }

    /// Own places on the edge before and after one, in the order of [`ring`]: along the rim of a ring, which is closed.
    #[must_use]
    pub fn along_edge(self, place: usize) -> [usize; 2] {
        let LatticeSize { rows, cols } = self.size;
        let count = 2 * (rows + cols) - 4;
        let (top, bottom) = (cols - 1, cols + rows - 2);
        let [mut before, mut after] = [(place + count - 1) % count, (place + 1) % count];
        if self.is_ring && (place == 0 || place == top) {
            [before, after] = [top - 1, 1];
        } else if self.is_ring && (place == bottom || place == bottom + top) {
            [before, after] = [bottom + top - 1, bottom + 1];
        }
        [before, after].map(|place| self.own_place(place))
    }

    /// The place on the edge of the own node of the node at a place.
    #[must_use]
    pub fn own_place(self, place: usize) -> usize {
        let LatticeSize { rows, cols } = self.size;
        let (top, bottom) = (cols - 1, cols + rows - 2);
        match place {
            _ if !self.is_ring => place,
            _ if place == top => 0,
            _ if place == bottom => bottom + top,
            _ => place,
        }
    }

    /// The place on the edge of the twin of the own node at a place, if that is on the rim.
    #[must_use]
    pub fn twin_place(self, place: usize) -> Option<usize> {
        let LatticeSize { rows, cols } = self.size;
        let (top, bottom) = (cols - 1, cols + rows - 2);
        match place {
            _ if !self.is_ring => None,
            0 => Some(top),
            _ if place == bottom + top => Some(bottom),
            _ => None,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SIZE: LatticeSize = LatticeSize { rows: 4, cols: 6 };

    #[test]
    fn nodes_of_a_ring_have_neighbours_across_its_banks() {
        let ring_links = Links { size: SIZE, is_ring: true };
        let open = Links { size: SIZE, is_ring: false };
        assert_eq!((ring_links.own(11), open.own(11)), (6, 11));
        assert_eq!((ring_links.twin(6), ring_links.twin(7), open.twin(6)), (Some(11), None, None));
        assert_eq!(ring_links.around(6, false), [0, 10, 7, 12]);
        assert_eq!(ring_links.around(11, false), ring_links.around(6, false));
        assert_eq!(ring_links.around(10, false), [4, 9, 6, 16]);
        assert_eq!(open.around(6, false), [0, 7, 12]);
        assert_eq!(ring_links.quads_at(0), [[0, 4], [0, 0]]);
        assert_eq!(open.quads_at(0), [[0, 0]]);
    }

    #[test]
    fn the_edge_of_a_ring_is_two_closed_lines() {
        let (links, edge) = (Links { size: SIZE, is_ring: true }, ring(SIZE));
        for (place, &node) in edge.iter().enumerate() {
            assert_eq!(
                edge[links.own_place(place)] == links.own(node),
                links.is_on_rim(node) || links.own(node) == node
            );
            if links.is_on_rim(node) {
                let own: Vec<usize> = links.around(node, false).into_iter().filter(|n| n / 6 == node / 6).collect();
                let mut found = links.along_edge(place).map(|place| edge[place]);
                let mut wanted = [own[0], own[1]];
                found.sort_unstable();
                wanted.sort_unstable();
                assert_eq!(found, wanted, "node {node}");
            }
        }
        let banks =
            edge.iter().enumerate().filter(|(here, a)| links.is_along_bank([**a, edge[(here + 1) % edge.len()]]));
        assert_eq!(banks.count(), 6);
    }
}
