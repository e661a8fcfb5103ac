//! Weighted undirected graphs in compressed rows, and shortest paths on them.

use std::cmp::Reverse;
use std::collections::BinaryHeap;

/// A graph; the neighbours of node `a` are `targets[rows[a]..rows[a + 1]]`.
#[derive(Clone, Debug, Default)]
pub struct Graph {
    rows: Vec<u32>,
    targets: Vec<u32>,
    lengths: Vec<f32>,
}

impl Graph {
    /// From one list of `(neighbour, length)` per node. Lengths must be positive and finite,
    /// and every edge must be listed from both ends.
    #[must_use]
    pub fn from_lists(lists: &[Vec<(u32, f32)>]) -> Self {
        let mut graph = Self { rows: vec![0], ..Self::default() };
        for list in lists {
            graph.targets.extend(list.iter().map(|e| e.0));
            graph.lengths.extend(list.iter().map(|e| e.1));
            graph.rows.push(super::field::id(graph.targets.len()));
        }
        graph
    }

    /// Number of nodes.
    #[must_use]
    pub fn len(&self) -> usize {
        self.rows.len() - 1
    }

    /// Whether there is no node.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Mean number of neighbours; 0 without nodes.
    #[must_use]
    pub fn mean_degree(&self) -> f64 {
        self.targets.len() as f64 / self.len().max(1) as f64
    }

    /// Neighbours of a node with the lengths of the edges.
    pub fn edges(&self, node: usize) -> impl Iterator<Item = (usize, f32)> + '_ {
        let range = self.rows[node] as usize..self.rows[node + 1] as usize;
        self.targets[range.clone()].iter().map(|&t| t as usize).zip(self.lengths[range].iter().copied())
    }

    /// Length of the shortest path from `source` to every node (Dijkstra); infinite where there
    /// is none.
    #[must_use]
    pub fn geodesics(&self, source: usize) -> Vec<f32> {
        let mut distance = vec![f32::INFINITY; self.len()];
        let mut heap = BinaryHeap::with_capacity(self.len());
        distance[source] = 0.0;
        heap.push(Reverse((0u32, super::field::id(source))));
        while let Some(Reverse((bits, node))) = heap.pop() {
            // Bits of non-negative floats order as the floats do.
            let reached = f32::from_bits(bits);
            if reached > distance[node as usize] {
                continue;
            }
            for (next, length) in self.edges(node as usize) {
                let through = reached + length;
                if through < distance[next] {
                    distance[next] = through;
                    heap.push(Reverse((through.to_bits(), super::field::id(next))));
                }
            }
        }
        distance
    }

    /// Component number of every node, numbered by their first node, and their sizes.
    #[must_use]
    pub fn components(&self) -> (Vec<usize>, Vec<usize>) {
        let mut number = vec![usize::MAX; self.len()];
        let mut sizes = Vec::new();
        let mut stack = Vec::new();
        for start in 0..self.len() {
            if number[start] != usize::MAX {
                continue;
            }
            let mut size = 0;
            number[start] = sizes.len();
            stack.push(start);
            while let Some(node) = stack.pop() {
                size += 1;
                for (next, _) in self.edges(node) {
                    if number[next] == usize::MAX {
                        number[next] = sizes.len();
                        stack.push(next);
                    }
                }
            }
            sizes.push(size);
        }
        (number, sizes)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn shortest_paths_take_the_shorter_way_round() {
        let ring: Vec<Vec<(u32, f32)>> =
            (0..6u32).map(|a| vec![((a + 1) % 6, 1.0), ((a + 5) % 6, 1.0)]).chain([vec![]]).collect();
        let graph = Graph::from_lists(&ring);
        assert_eq!(graph.geodesics(0), [0.0, 1.0, 2.0, 3.0, 2.0, 1.0, f32::INFINITY]);
        assert_eq!(graph.components().1, [6, 1]);
    }
}
