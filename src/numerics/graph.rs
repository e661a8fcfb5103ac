//! Weighted undirected graphs in compressed rows, and shortest paths on them.

/// A weighted undirected graph; the edges of node `a` are `edges[rows[a]..rows[a + 1]]`.
#[derive(Clone, Debug, Default)]
pub struct Graph {
    rows: Vec<u32>,
    edges: Vec<(u32, f32)>,
    /// Length of the longest edge; 0 without edges.
    longest: f32,
}

impl Graph {
    /// From one list of `(neighbour, length)` per node. Lengths must be positive and finite,
    /// and every edge must be listed from both ends.
    #[must_use]
    pub fn from_lists(lists: &[Vec<(u32, f32)>]) -> Self {
        let mut rows = vec![0];
        for list in lists {
            rows.push(rows[rows.len() - 1] + super::field::id(list.len()));
        }
        let longest = lists.iter().flatten().map(|e| e.1).fold(0.0, f32::max);
        Self { rows, edges: lists.concat(), longest }
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
        self.edges.len() as f64 / self.len().max(1) as f64
    }

    /// Neighbours of a node with the lengths of the edges.
    fn edges(&self, node: usize) -> &[(u32, f32)] {
        &self.edges[self.rows[node] as usize..self.rows[node + 1] as usize]
    }

    /// Length of the shortest path from `source` to every node; infinite where there is none.
    #[must_use]
    pub fn geodesics(&self, source: usize) -> Vec<f32> {
        let mut distances = vec![f32::INFINITY; self.len()];
        self.improve(&mut distances, source);
        distances
    }

    /// Lowers distances to those from `source` where these are smaller, as if `distances` were to the
    /// nearest of some sources and this one was added. What is no nearer is not gone through, so that
    /// the cost is that of the part that belongs to the new source.
    ///
    /// Nodes wait in buckets of equal width by their distance (Dial, CACM 12, 1969); one whose
    /// distance is lowered again within its bucket is gone through again, so the outcome is exact.
    pub fn improve(&self, distances: &mut [f32], source: usize) {
        /// Buckets per longest edge. More are searched in vain, with fewer more nodes come twice.
        const PER_EDGE: f32 = 8.0;
        /// No edge leads further ahead than by one bucket more: so many are used in turn.
        const BUCKETS: usize = 16;
        let per_length = PER_EDGE / self.longest.max(f32::MIN_POSITIVE);
        let bucket_of = |distance: f32| super::field::floor_index(f64::from(distance * per_length));
        let mut buckets: [Vec<(u32, f32)>; BUCKETS] = Default::default();
        distances[source] = 0.0;
        buckets[0].push((super::field::id(source), 0.0));
        let (mut bucket, mut waiting) = (0, 1usize);
        while waiting > 0 {
            let Some((node, reached)) = buckets[bucket % BUCKETS].pop() else {
                bucket += 1;
                continue;
            };
            waiting -= 1;
            if reached > distances[node as usize] {
                continue;
            }
            for &(next, length) in self.edges(node as usize) {
                let through = reached + length;
                if through < distances[next as usize] {
                    distances[next as usize] = through;
                    buckets[bucket_of(through) % BUCKETS].push((next, through));
                    waiting += 1;
                }
            }
        }
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
                for next in self.edges(node).iter().map(|e| e.0 as usize) {
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

    /// A strip of points at uneven places with all edges up to a length.
    fn strip() -> Graph {
        let place = |n: usize| [(n * n * 37 % 401) as f32 / 10.0, (n * 7919 % 83) as f32 / 10.0];
        let length = |a: usize, b: usize| (place(a)[0] - place(b)[0]).hypot(place(a)[1] - place(b)[1]);
        let list = |a: usize| (0..300).filter(move |&b| b != a && length(a, b) < 4.0);
        let edges = |a: usize| list(a).map(|b| (u32::try_from(b).expect("small"), length(a, b).max(0.01))).collect();
        Graph::from_lists(&(0..300).map(edges).collect::<Vec<_>>())
    }

    #[test]
    fn buckets_find_the_lengths_that_relaxing_all_edges_finds() {
        let graph = strip();
        let mut expected = vec![f32::INFINITY; graph.len()];
        expected[5] = 0.0;
        for _ in 0..graph.len() {
            for node in 0..graph.len() {
                for &(next, length) in graph.edges(node) {
                    expected[next as usize] = expected[next as usize].min(expected[node] + length);
                }
            }
        }
        assert_eq!(graph.geodesics(5), expected);
    }

    #[test]
    fn an_added_source_gives_the_distances_to_the_nearer_one() {
        let graph = strip();
        let mut nearest = graph.geodesics(0);
        graph.improve(&mut nearest, 200);
        let [a, b] = [0, 200].map(|source| graph.geodesics(source));
        let apart = |n: usize| (nearest[n] - a[n].min(b[n])).abs();
        assert!((0..graph.len()).all(|n| nearest[n] == a[n] || apart(n) < 1e-4));
    }
}
