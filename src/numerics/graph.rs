//! Weighted undirected graphs in compressed rows, and shortest paths on them.

use std::hint::black_box;

use super::field::{floor_index, id};
use crate::cancel::{Cancel, Cancelled};

/// Bits that a length takes at most: with more, sums over tens of thousands of edges would not fit.
const MOST_LENGTH_BITS: u32 = 16;
/// No way leads here.
const UNREACHED: u32 = u32::MAX;

/// The edges of one node: the nodes that they lead to, and their lengths.
pub type Edges = Vec<(u32, f32)>;

/// Leaves the `count` shortest edges, the shortest first; of edges of one length the one to the first node.
pub fn keep_shortest(edges: &mut Edges, count: usize) {
    edges.sort_by(|x, y| x.1.total_cmp(&y.1).then(x.0.cmp(&y.0)));
    edges.truncate(count);
}

/// A weighted undirected graph; the edges of the node kept at `a` are `edges[rows[a]..rows[a + 1]]`.
///
/// Searches read all edges again and again. So an edge is four bytes: the step to the place of the other
/// node above, the length below, in units. The fewer bits steps take, the more are left for
/// lengths: 16 for steps of up to 2¹⁵, which is 1 / 30 000 of the longest edge. And nodes are kept in an
/// order of their own, in which what is searched together should lie together.
#[derive(Clone, Debug, Default)]
pub struct Graph {
    /// The place of each node.
    place: Vec<u32>,
    rows: Vec<u32>,
    edges: Vec<u32>,
    length_bits: u32,
    /// Length of one unit, a power of two; the longest edge has less than 2^length_bits.
    unit: f64,
}

impl Graph {
    /// From one list of `(neighbour, length)` per node, and all nodes in the order in which to keep
    /// them. Lengths must be positive and finite, and every edge must be listed from both ends.
    ///
    /// # Errors
    /// When it is cancelled.
    pub fn from_lists(lists: &[Vec<(u32, f32)>], order: &[u32], cancel: &dyn Cancel) -> Result<Self, Cancelled> {
        let mut place = vec![0; order.len()];
        order.iter().enumerate().for_each(|(at, &node)| place[node as usize] = id(at));
        let (mut widest, mut longest) = (0, f32::MIN_POSITIVE);
        for (node, list) in lists.iter().enumerate() {
            cancel.check()?;
            for &(next, length) in list {
                widest = widest.max(place[node].abs_diff(place[next as usize]));
                longest = longest.max(length);
            }
        }
        // One bit more for the sign.
        let length_bits = widest.leading_zeros().saturating_sub(1).min(MOST_LENGTH_BITS);
        let most = ((1u32 << length_bits) - 1).max(1);
        // A power of two: whole and half lengths are kept exactly.
        let unit = (f64::from(longest) / f64::from(most)).log2().ceil().exp2();
        let (mut rows, mut edges) = (vec![0], Vec::with_capacity(lists.iter().map(Vec::len).sum()));
        for (at, &node) in order.iter().enumerate() {
            cancel.check()?;
            for &(next, length) in &lists[node as usize] {
                let units = id(floor_index(f64::from(length) / unit + 0.5)).clamp(1, most);
                edges.push(place[next as usize].wrapping_sub(id(at)) << length_bits | units);
            }
            rows.push(id(edges.len()));
        }
        Ok(Self { place, rows, edges, length_bits, unit })
    }

    /// Number of nodes.
    #[must_use]
    pub fn len(&self) -> usize {
        self.place.len()
    }

    /// Mean number of neighbours; 0 without nodes.
    #[must_use]
    pub fn mean_degree(&self) -> f64 {
        self.edges.len() as f64 / self.len().max(1) as f64
    }

    /// Of every node the nodes that edges lead to, ascending, and the lengths as they are kept.
    ///
    /// # Errors
    /// Those of `cancel`.
    pub fn lists(&self, cancel: &dyn Cancel) -> Result<Vec<Edges>, Cancelled> {
        let mut node_at = vec![0; self.len()];
        self.place.iter().enumerate().for_each(|(node, &place)| node_at[place as usize] = id(node));
        let mut lists = Vec::with_capacity(self.len());
        for &place in &self.place {
            cancel.check()?;
            let mut list = Vec::new();
            for (next, length) in self.edges(place) {
                #[expect(clippy::cast_possible_truncation, reason = "f32 is as exact as the units")]
                list.push((node_at[next as usize], (f64::from(length) * self.unit) as f32));
            }
            list.sort_unstable_by_key(|edge| edge.0);
            lists.push(list);
        }
        Ok(lists)
    }

    /// Places that edges lead to from a place, with their lengths in units.
    fn edges(&self, node: u32) -> impl Iterator<Item = (u32, u32)> + '_ {
        let row = &self.edges[self.rows[node as usize] as usize..self.rows[node as usize + 1] as usize];
        let (bits, mask) = (self.length_bits, (1 << self.length_bits) - 1);
        row.iter().map(move |&edge| (node.wrapping_add_signed(edge.cast_signed() >> bits), edge & mask))
    }

    /// Length of the shortest path from `source` to every node; infinite where there is none.
    ///
    /// # Errors
    /// When it is cancelled.
    pub fn geodesics(&self, source: usize, cancel: &dyn Cancel) -> Result<Vec<f32>, Cancelled> {
        let mut distances = vec![UNREACHED; self.len()];
        self.improve(&mut distances, self.place[source], cancel)?;
        #[expect(clippy::cast_possible_truncation, reason = "f32 is as exact as the units")]
        let length = |d: u32| if d == UNREACHED { f32::INFINITY } else { (f64::from(d) * self.unit) as f32 };
        Ok(self.place.iter().map(|&place| length(distances[place as usize])).collect())
    }

    /// `count` nodes each as far as can be from those before, the first as far as can be from node 0.
    ///
    /// # Errors
    /// When it is cancelled.
    pub fn spread(&self, count: usize, cancel: &dyn Cancel) -> Result<Vec<usize>, Cancelled> {
        let mut nearest = vec![UNREACHED; self.len()];
        let Some(&first) = self.place.first() else { return Ok(Vec::new()) };
        self.improve(&mut nearest, first, cancel)?;
        let mut next = self.farthest(&nearest);
        nearest.fill(UNREACHED);
        let mut nodes = Vec::new();
        while nodes.len() < count.min(self.len()) {
            self.improve(&mut nearest, self.place[next], cancel)?;
            nodes.push(next);
            next = self.farthest(&nearest);
        }
        Ok(nodes)
    }

    /// Lowers distances, by place, to those from `source` where these are smaller, as if `distances` were to the
    /// nearest of some sources and this one was added. What is no nearer is not gone through, so that
    /// the cost is that of the part that belongs to the new source.
    ///
    /// Nodes wait in buckets of equal width by their distance (Dial, CACM 12, 1969); one whose
    /// distance is lowered again within its bucket is gone through again, so the outcome is exact.
    fn improve(&self, distances: &mut [u32], source: u32, cancel: &dyn Cancel) -> Result<(), Cancelled> {
        /// Buckets per longest edge, as bits. With more, more are searched in vain; with fewer, more
        /// nodes come twice.
        const BITS_PER_EDGE: u32 = 3;
        /// No edge leads further ahead than by one bucket more: so many are used in turn.
        const BUCKETS: usize = 16;
        /// Nodes that are gone through together.
        const BATCH: usize = 16;
        /// Batches between two looks at whether to stop.
        const BATCHES: usize = 256;
        let bucket_of = |distance: u32| (distance >> self.length_bits.saturating_sub(BITS_PER_EDGE)) as usize;
        let mut buckets: [Vec<(u32, u32)>; BUCKETS] = Default::default();
        distances[source as usize] = 0;
        buckets[0].push((source, 0));
        let (mut bucket, mut waiting) = (0, 1usize);
        let (mut batch, mut batches) = (Vec::with_capacity(BATCH), 0usize);
        while waiting > 0 {
            if batches.is_multiple_of(BATCHES) {
                cancel.check()?;
            }
            batches += 1;
            let own = &mut buckets[bucket % BUCKETS];
            batch.extend(own.drain(own.len().saturating_sub(BATCH)..));
            bucket += usize::from(batch.is_empty());
            waiting -= batch.len();
            batch.retain(|&(node, reached): &(u32, u32)| reached <= distances[node as usize]);
            // Rows lie anywhere in memory: asked for together, they come together.
            black_box(batch.iter().map(|&(node, _)| self.touched(node)).fold(0, |a, b| a ^ b));
            for (node, reached) in batch.drain(..) {
                for (next, length) in self.edges(node) {
                    let through = reached.saturating_add(length);
                    if through < distances[next as usize] {
                        distances[next as usize] = through;
                        buckets[bucket_of(through) % BUCKETS].push((next, through));
                        waiting += 1;
                    }
                }
            }
        }
        Ok(())
    }

    /// Reads one edge of every line of memory that a row takes.
    fn touched(&self, node: u32) -> u32 {
        /// Edges in a line of 64 bytes.
        const LINE: usize = 16;
        let row = &self.edges[self.rows[node as usize] as usize..self.rows[node as usize + 1] as usize];
        row.iter().step_by(LINE).fold(0, |a, b| a ^ b)
    }

    /// The farthest node that can be reached, the first of equals.
    fn farthest(&self, distances: &[u32]) -> usize {
        let mut best = (0, 0);
        for (node, &place) in self.place.iter().enumerate() {
            let distance = distances[place as usize];
            if distance != UNREACHED && distance > best.1 {
                best = (node, distance);
            }
        }
        best.0
    }

    /// Component number of every node, numbered by their first node, and their sizes.
    ///
    /// # Errors
    /// When it is cancelled.
    pub fn components(&self, cancel: &dyn Cancel) -> Result<(Vec<usize>, Vec<usize>), Cancelled> {
        let mut number = vec![usize::MAX; self.len()];
        let mut sizes = Vec::new();
        let mut stack = Vec::new();
        for &start in &self.place {
            if number[start as usize] != usize::MAX {
                continue;
            }
            let mut size = 0;
            number[start as usize] = sizes.len();
            stack.push(start);
            while let Some(place) = stack.pop() {
                cancel.check()?;
                size += 1;
                for (next, _) in self.edges(place) {
                    if number[next as usize] == usize::MAX {
                        number[next as usize] = sizes.len();
                        stack.push(next);
                    }
                }
            }
            sizes.push(size);
        }
        Ok((self.place.iter().map(|&place| number[place as usize]).collect(), sizes))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cancel::Never;

    fn graph_of(lists: &[Vec<(u32, f32)>], order: &[u32]) -> Graph {
        Graph::from_lists(lists, order, &Never).expect("not stopped")
    }

    #[test]
    fn shortest_paths_take_the_shorter_way_round() {
        let ring: Vec<Vec<(u32, f32)>> =
            (0..6u32).map(|a| vec![((a + 1) % 6, 1.0), ((a + 5) % 6, 1.0)]).chain([vec![]]).collect();
        let graph = graph_of(&ring, &[3, 0, 6, 1, 5, 2, 4]);
        assert_eq!(graph.geodesics(0, &Never), Ok(vec![0.0, 1.0, 2.0, 3.0, 2.0, 1.0, f32::INFINITY]));
        assert_eq!(graph.components(&Never).expect("not stopped").1, [6, 1]);
    }

    /// A strip of points at uneven places with all edges up to a length.
    fn strip() -> Graph {
        let place = |n: usize| [(n * n * 37 % 401) as f32 / 10.0, (n * 7919 % 83) as f32 / 10.0];
        let length = |a: usize, b: usize| (place(a)[0] - place(b)[0]).hypot(place(a)[1] - place(b)[1]);
        let list = |a: usize| (0..300).filter(move |&b| b != a && length(a, b) < 4.0);
        let edges = |a: usize| list(a).map(|b| (u32::try_from(b).expect("small"), length(a, b).max(0.01))).collect();
        let order: Vec<u32> = (0..300).map(|n| n * 7 % 300).collect();
        graph_of(&(0..300).map(edges).collect::<Vec<_>>(), &order)
    }

    #[test]
    fn buckets_find_the_lengths_that_relaxing_all_edges_finds() {
        let graph = strip();
        let mut expected = vec![UNREACHED; graph.len()];
        expected[5] = 0;
        for _ in 0..graph.len() {
            for node in 0..300 {
                if expected[node as usize] == UNREACHED {
                    continue;
                }
                for (next, length) in graph.edges(node).collect::<Vec<_>>() {
                    expected[next as usize] = expected[next as usize].min(expected[node as usize] + length);
                }
            }
        }
        let mut found = vec![UNREACHED; graph.len()];
        graph.improve(&mut found, 5, &Never).expect("not stopped");
        assert_eq!(found, expected);
    }

    #[test]
    fn an_added_source_gives_the_distances_to_the_nearer_one() {
        let graph = strip();
        let mut nearest = vec![UNREACHED; graph.len()];
        for source in [0, 200] {
            graph.improve(&mut nearest, graph.place[source], &Never).expect("not stopped");
        }
        let [a, b] = [0, 200].map(|source| graph.geodesics(source, &Never).expect("not stopped"));
        let unit = graph.unit;
        let nearest: Vec<u32> = graph.place.iter().map(|&place| nearest[place as usize]).collect();
        assert!((0..graph.len()).all(|n| (f64::from(nearest[n]) * unit - f64::from(a[n].min(b[n]))).abs() < unit));
    }

    #[test]
    fn lengths_are_kept_to_a_small_share_of_the_longest() {
        let far = 3_000_000u32;
        let mut lists = vec![Vec::new(); far as usize + 1];
        lists[0] = vec![(1, 1.25), (far, 3.0)];
        (lists[1], lists[far as usize]) = (vec![(0, 1.25)], vec![(0, 3.0)]);
        // Steps of three million leave 9 bits for lengths.
        let graph = graph_of(&lists, &(0..=far).collect::<Vec<_>>());
        let distances = graph.geodesics(1, &Never).expect("not stopped");
        assert!((distances[0] - 1.25).abs() < 3.0 / 512.0 && (distances[far as usize] - 4.25).abs() < 3.0 / 256.0);
    }

    #[test]
    fn lists_are_those_the_graph_was_made_of() {
        let lists = [vec![(1, 1.25), (3, 2.0)], vec![(0, 1.25)], vec![], vec![(0, 2.0)]];
        assert_eq!(graph_of(&lists, &[2, 3, 0, 1]).lists(&Never), Ok(lists.to_vec()));
    }

    #[test]
    fn spread_nodes_are_the_ends_of_a_line_and_then_its_middle() {
        let line: Vec<Vec<(u32, f32)>> = (0..9u32)
            .map(|a| [a.checked_sub(1), (a < 8).then_some(a + 1)].into_iter().flatten().map(|b| (b, 1.0)).collect())
            .collect();
        assert_eq!(graph_of(&line, &[0, 1, 2, 3, 4, 5, 6, 7, 8]).spread(3, &Never), Ok(vec![8, 0, 4]));
    }
}
