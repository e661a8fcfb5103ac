//! The neighbourhood graph of a surface: each point with those near it along the surface.
//!
//! An edge stays on the surface: its ends are joined by touching points inside the edge's own ball. So no edge
//! leads from one wall of a fold to the other.

use nalgebra::Point3;
use rayon::prelude::*;

use crate::cancel::{Cancel, Cancelled};
use crate::numerics::field::{floor_index, id};
use crate::numerics::graph::{Edges, Graph};
use crate::params::Neighbors;
use crate::pipeline::sheets::surface::Surface;

/// Radius of the automatic neighbourhood, voxels. Shortest paths on a ball of 3 are 2 % too long,
/// of 4 less than 1 %; larger balls cut corners of folds.
pub const AUTO_RADIUS: f64 = 4.0;
/// Steps from voxel to voxel, per voxel of distance, within which an edge's ends must be joined.
/// A straight diagonal needs 1; the staircase of a surface up to 1.5.
const STEPS_PER_VOXEL: f64 = 1.5;
/// Points that one thread takes at a time: fewer are not worth handing over.
const POINTS_PER_TASK: usize = 256;

/// The neighbourhood graph, and how many pieces it was in before touching points joined them.
pub(super) fn neighborhood_graph(
    surface: &Surface,
    neighbors: Neighbors,
    voxel_mm: f64,
    cancel: &dyn Cancel,
) -> Result<(Graph, usize), Cancelled> {
    let count = surface.positions.len();
    let found = |around: &mut Around, a: usize| {
        cancel.check()?;
        let mut list = match neighbors {
            Neighbors::Auto => around.within(surface, a, AUTO_RADIUS),
            Neighbors::RadiusMm(radius) => around.within(surface, a, radius / voxel_mm),
            Neighbors::Count(k) => around.nearest(surface, a, k),
        };
        list.sort_unstable_by_key(|e| e.0);
        Ok(list)
    };
    let points = (0..count).into_par_iter().with_min_len(POINTS_PER_TASK);
    let lists = points.map_init(|| Around::new(count), found).collect::<Result<_, Cancelled>>();
    let mut lists: Vec<Edges> = lists?;
    // Of two points, one may see the other only: an edge has two ends.
    let unseen = |(a, list): (usize, &Edges)| {
        cancel.check()?;
        let is_unseen = |e: &&(u32, f32)| lists[e.0 as usize].binary_search_by_key(&id(a), |e| e.0).is_err();
        Ok(list.iter().filter(is_unseen).map(|&(b, length)| (b, (id(a), length))).collect::<Vec<_>>())
    };
    let missing = lists.par_iter().enumerate().with_min_len(POINTS_PER_TASK).map(unseen);
    let missing = missing.collect::<Result<Vec<_>, Cancelled>>()?;
    for (b, edge) in missing.into_iter().flatten() {
        lists[b as usize].push(edge);
    }
    lists.par_iter_mut().try_for_each(|list| {
        list.sort_unstable_by_key(|e| e.0);
        cancel.check()
    })?;
    let order = in_tiles(&surface.positions);
    let graph = Graph::from_lists(&lists, &order, cancel)?;
    let (piece, sizes) = graph.components(cancel)?;
    if sizes.len() == 1 {
        return Ok((graph, 1));
    }
    for (a, list) in surface.adjacency.iter().enumerate() {
        // No edge joins two pieces yet: none comes twice.
        for &b in list.iter().filter(|b| piece[a] != piece[**b as usize]) {
            lists[a].push((b, length_between(surface, a, b as usize)));
        }
    }
    Ok((Graph::from_lists(&lists, &order, cancel)?, sizes.len()))
}

/// The points in an order in which those of one part of space follow one another.
fn in_tiles(positions: &[Point3<f64>]) -> Vec<u32> {
    /// Edge of the parts, voxels: the edges of one stay in a core's fast memory.
    const TILE: f64 = 16.0;
    let tile = |p: u32| [2, 1, 0].map(|axis| floor_index(positions[p as usize][axis] / TILE));
    let mut order: Vec<u32> = (0..id(positions.len())).collect();
    order.sort_by_cached_key(|&p| tile(p));
    order
}

/// Edges are never of length 0: two points in one place would be one.
fn length_between(surface: &Surface, a: usize, b: usize) -> f32 {
    #[expect(clippy::cast_possible_truncation, reason = "edges are a few voxels long; f32 halves the graph")]
    let length = (surface.positions[a] - surface.positions[b]).norm().max(1e-3) as f32;
    length
}

/// Search for points around a point, along the surface.
pub(super) struct Around {
    seen: Vec<u32>,
    round: u32,
    queue: Vec<u32>,
}

impl Around {
    /// For surfaces of so many points.
    pub fn new(count: usize) -> Self {
        Self { seen: vec![0; count], round: 0, queue: Vec::new() }
    }

    /// Points within `radius` of `a` that touching points inside that ball join to it in few steps.
    pub fn within(&mut self, surface: &Surface, a: usize, radius: f64) -> Edges {
        self.round += 1;
        self.queue.clear();
        self.queue.push(id(a));
        self.seen[a] = self.round;
        let mut found = Vec::new();
        let mut layer = 0..1;
        for _ in 0..floor_index((radius * STEPS_PER_VOXEL).ceil()) {
            for q in layer.clone() {
                for &b in &surface.adjacency[self.queue[q] as usize] {
                    if self.seen[b as usize] == self.round {
                        continue;
                    }
                    self.seen[b as usize] = self.round;
                    let length = length_between(surface, a, b as usize);
                    if f64::from(length) <= radius {
                        self.queue.push(b);
                        found.push((b, length));
                    }
                }
            }
            layer = layer.end..self.queue.len();
            if layer.is_empty() {
                break;
            }
        }
        found
    }

    /// The `k` nearest of the points around `a` along the surface.
    fn nearest(&mut self, surface: &Surface, a: usize, k: usize) -> Edges {
        /// A plane sheet of one point a voxel has k points in this many radii.
        const PER_ROOT: f64 = 0.75;
        let mut radius = (k as f64).sqrt() * PER_ROOT + 1.0;
        let mut found = self.within(surface, a, radius);
        while found.len() < k && found.len() + 1 < surface.positions.len() {
            let before = found.len();
            radius *= 1.5;
            found = self.within(surface, a, radius);
            if found.len() == before {
                break;
            }
        }
        found.sort_by(|x, y| x.1.total_cmp(&y.1).then(x.0.cmp(&y.0)));
        found.truncate(k);
        found
    }
}
