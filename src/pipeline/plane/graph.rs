//! The neighbourhood graph of a surface (section 2.4 of the paper): each point with those near it along the surface.
//!
//! An edge stays on the surface: its ends are joined by touching points inside the edge's own ball. So no edge
//! leads from one wall of a fold to the other.

use nalgebra::Point3;
use rayon::prelude::*;

use crate::cancel::{Cancel, Cancelled};
use crate::numerics::field::{floor_index, id};
use crate::numerics::graph::{Edges, Graph, keep_shortest};
use crate::numerics::parallel::{POINTS_PER_TASK, each_number, each_number_within};
use crate::params::Neighbors;
use crate::pipeline::surface::Surface;

/// Radius of the automatic neighbourhood, voxels. Shortest paths on a ball of 3 are 2 % too long,
/// of 4 less than 1 %; larger balls cut corners of folds.
pub const AUTO_RADIUS: f64 = 4.0;
/// Steps from voxel to voxel, per voxel of distance, within which an edge's ends must be joined. A straight diagonal
/// needs 1; the staircase of a surface up to 1.5. With 1 and with 3, organs and shapes change by chance only.
const STEPS_PER_VOXEL: f64 = 1.5;

/// The neighbourhood graph, and how many pieces it was in before touching points joined them.
///
/// # Errors
/// When it is cancelled.
pub(super) fn neighborhood_graph(
    surface: &Surface,
    neighbors: Neighbors,
    voxel_mm: f64,
    cancel: &dyn Cancel,
) -> Result<(Graph, usize), Cancelled> {
    let count = surface.positions.len();
    let seen = |around: &mut Around, a: usize| around.seen_from(surface, a, neighbors, voxel_mm);
    let mut lists = each_number_within(count, POINTS_PER_TASK, || Around::new(count), seen, cancel)?;
    add_other_ends(&mut lists, cancel)?;
    let order = in_tiles(&surface.positions);
    let graph = Graph::from_lists(&lists, &order, cancel)?;
    let (piece, sizes) = graph.components(cancel)?;
    if sizes.len() == 1 {
        return Ok((graph, 1));
    }
    join_pieces(&mut lists, &piece, surface);
    Ok((Graph::from_lists(&lists, &order, cancel)?, sizes.len()))
}

/// Of two points, one may see the other only: an edge has two ends.
fn add_other_ends(lists: &mut [Edges], cancel: &dyn Cancel) -> Result<(), Cancelled> {
    let missing = each_number(lists.len(), POINTS_PER_TASK, |a| unseen_ends(lists, a), cancel)?;
    for (b, edge) in missing.into_iter().flatten() {
        lists[b as usize].push(edge);
    }
    lists.par_iter_mut().try_for_each(|list| {
        list.sort_unstable_by_key(|edge| edge.0);
        cancel.check()
    })
}

/// The other ends of the edges that are seen from `a` only: points, each with its edge.
fn unseen_ends(lists: &[Edges], a: usize) -> Vec<(u32, (u32, f32))> {
    let mut unseen = Vec::new();
    for &(b, length) in &lists[a] {
        if lists[b as usize].binary_search_by_key(&id(a), |edge| edge.0).is_err() {
            unseen.push((b, (id(a), length)));
        }
    }
    unseen
}

/// Joins the pieces of a graph through points that touch.
fn join_pieces(lists: &mut [Edges], piece: &[usize], surface: &Surface) {
    for (a, list) in surface.adjacency.iter().enumerate() {
        for &b in list {
            // No edge joins two pieces yet: none comes twice.
            if piece[a] != piece[b as usize] {
                lists[a].push((b, length_between(surface, a, b as usize)));
            }
        }
    }
}

/// The points in an order in which those of one part of space follow one another.
fn in_tiles(positions: &[Point3<f64>]) -> Vec<u32> {
    /// Edge of the parts, voxels: the edges of one stay in a core's fast memory.
    const TILE: f64 = 16.0;
    let mut order: Vec<u32> = (0..id(positions.len())).collect();
    order.sort_by_cached_key(|&p| [2, 1, 0].map(|axis| floor_index(positions[p as usize][axis] / TILE)));
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

    /// The neighbours of `a`, ascending.
    fn seen_from(&mut self, surface: &Surface, a: usize, neighbors: Neighbors, voxel_mm: f64) -> Edges {
        let mut list = match neighbors {
            Neighbors::Auto => self.within(surface, a, AUTO_RADIUS),
            Neighbors::RadiusMm(radius) => self.within(surface, a, radius / voxel_mm),
            Neighbors::Count(k) => self.nearest(surface, a, k),
        };
        list.sort_unstable_by_key(|edge| edge.0);
        list
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
        keep_shortest(&mut found, k);
        found
    }
}
