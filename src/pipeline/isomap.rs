//! Stage 5: ISOMAP (Tenenbaum, de Silva, Langford, Science 290, 2000): a surface is laid flat so
//! that distances in the plane are geodesic distances on it (section 2.4 of the paper).
//!
//! Geodesics from all points (exact) or from farthest-point landmarks (de Silva, Tenenbaum,
//! *Sparse multidimensional scaling using landmark points*, 2004) on a neighbourhood graph whose
//! edges stay on the surface: both ends are joined by touching points inside the edge's own ball.

use nalgebra::{DMatrix, Point2, Point3, SVector, Vector2};
use rayon::prelude::*;

use crate::numerics::cancel::GoOn;
use crate::numerics::eigen::leading_two;
use crate::numerics::field::{floor_index, id};
use crate::numerics::graph::Graph;

use super::observer::{Cancelled, Observer};
use super::params::{Landmarks, Neighbors};
use super::surface::Surface;

/// Radius of the automatic neighbourhood, voxels. Shortest paths on a ball of 3 are 2 % too long,
/// of 4 less than 1 %; larger balls cut corners of folds.
pub(super) const AUTO_RADIUS: f64 = 4.0;
/// Landmarks of the automatic choice: twice as many change an embedding by less than 0.2 % of
/// its extent.
const AUTO_LANDMARKS: usize = 48;
/// Steps from voxel to voxel, per voxel of distance, within which an edge's ends must be joined.
/// A straight diagonal needs 1; the staircase of a surface up to 1.5.
const STEPS_PER_VOXEL: f64 = 1.5;
/// Second eigenvalue over the first up to which points lie on a line: a plane a thousandth as wide as it
/// is long. Lengths of edges are kept to a few digits less.
const LINE_SHARE: f64 = 1e-6;
/// Points that one thread takes at a time: fewer are not worth handing over.
const POINTS_PER_TASK: usize = 256;
/// Points that exact ISOMAP takes at most: its matrix takes 8 bytes a pair.
pub const EXACT_LIMIT: usize = 10_000;

/// A flattened surface.
#[derive(Clone, Debug, Default)]
pub struct Flat {
    /// Plane coordinates of every point, voxels, centred at 0.
    pub points: Vec<Point2<f64>>,
    /// 1 − R² between graph and plane distances, over all pairs with a landmark.
    pub residual_variance: f64,
    /// Neighbours per point, the mean.
    pub neighbors: f64,
    /// Landmarks used.
    pub landmarks: usize,
    /// Pieces that the neighbourhood graph fell into before touching points joined them.
    pub pieces: usize,
}

/// Why a surface could not be laid flat.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum IsomapError {
    /// Stopped.
    #[error(transparent)]
    Cancelled(#[from] Cancelled),
    /// Fewer points than coordinates can be told apart by.
    #[error("only {points} points")]
    TooFewPoints {
        /// Points given.
        points: usize,
    },
    /// Exact ISOMAP on more points than fit in memory.
    #[error("exact ISOMAP of {points} points; at most {limit}")]
    TooManyForExact {
        /// Points given.
        points: usize,
        /// Points allowed.
        limit: usize,
    },
    /// The eigenproblem has no two positive values: the points lie on a line.
    #[error("the points span no plane")]
    NoPlane,
}

/// Lays a connected surface flat. `voxel_mm` turns an ε in mm into voxels.
///
/// # Errors
/// See [`IsomapError`].
pub fn flatten(
    surface: &Surface,
    neighbors: Neighbors,
    landmarks: Landmarks,
    voxel_mm: f64,
    observer: &dyn Observer,
) -> Result<Flat, IsomapError> {
    let count = surface.positions.len();
    if count < 8 {
        return Err(IsomapError::TooFewPoints { points: count });
    }
    if landmarks == Landmarks::All && count > EXACT_LIMIT {
        return Err(IsomapError::TooManyForExact { points: count, limit: EXACT_LIMIT });
    }
    let go_on = || observer.check();
    let (graph, pieces) = neighborhood_graph(surface, neighbors, voxel_mm, &go_on)?;
    let geodesics = Geodesics::chosen(&graph, landmarks, &go_on)?;
    let points = geodesics.embed(&go_on)?.ok_or(IsomapError::NoPlane)?;
    Ok(Flat {
        residual_variance: geodesics.residual_variance(&points, &go_on)?,
        points,
        neighbors: graph.mean_degree(),
        landmarks: geodesics.sources.len(),
        pieces,
    })
}

/// The neighbourhood graph, and how many pieces it was in before touching points joined them.
pub(super) fn neighborhood_graph(
    surface: &Surface,
    neighbors: Neighbors,
    voxel_mm: f64,
    go_on: &GoOn<'_>,
) -> Result<(Graph, usize), Cancelled> {
    let count = surface.positions.len();
    let found = |around: &mut Around, a: usize| {
        go_on()?;
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
    let mut lists: Vec<Vec<(u32, f32)>> = lists?;
    // Of two points, one may see the other only: an edge has two ends.
    let unseen = |(a, list): (usize, &Vec<(u32, f32)>)| {
        go_on()?;
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
        go_on()
    })?;
    let order = in_tiles(&surface.positions);
    let graph = Graph::from_lists(&lists, &order, go_on)?;
    let (piece, sizes) = graph.components(go_on)?;
    if sizes.len() == 1 {
        return Ok((graph, 1));
    }
    for (a, list) in surface.adjacency.iter().enumerate() {
        // No edge joins two pieces yet: none comes twice.
        for &b in list.iter().filter(|b| piece[a] != piece[**b as usize]) {
            lists[a].push((b, length_between(surface, a, b as usize)));
        }
    }
    Ok((Graph::from_lists(&lists, &order, go_on)?, sizes.len()))
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
struct Around {
    seen: Vec<u32>,
    round: u32,
    queue: Vec<u32>,
}

impl Around {
    fn new(count: usize) -> Self {
        Self { seen: vec![0; count], round: 0, queue: Vec::new() }
    }

    /// Points within `radius` of `a` that touching points inside that ball join to it in few steps.
    fn within(&mut self, surface: &Surface, a: usize, radius: f64) -> Vec<(u32, f32)> {
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
    fn nearest(&mut self, surface: &Surface, a: usize, k: usize) -> Vec<(u32, f32)> {
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

/// Geodesic distances from some sources to all points.
pub(super) struct Geodesics {
    pub(super) sources: Vec<usize>,
    distances: Vec<Vec<f32>>,
}

impl Geodesics {
    /// From the landmarks asked for.
    pub(super) fn chosen(graph: &Graph, landmarks: Landmarks, go_on: &GoOn<'_>) -> Result<Self, Cancelled> {
        match landmarks {
            Landmarks::All => Self::all(graph, go_on),
            Landmarks::Auto => Self::farthest(graph, AUTO_LANDMARKS, go_on),
            Landmarks::Count(n) => Self::farthest(graph, n, go_on),
        }
    }

    fn all(graph: &Graph, go_on: &GoOn<'_>) -> Result<Self, Cancelled> {
        Self::from_sources(graph, (0..graph.len()).collect(), go_on)
    }

    /// Landmarks each as far as can be from those before, the first at a rim.
    fn farthest(graph: &Graph, count: usize, go_on: &GoOn<'_>) -> Result<Self, Cancelled> {
        let sources = graph.spread(count, go_on)?;
        Self::from_sources(graph, sources, go_on)
    }

    fn from_sources(graph: &Graph, sources: Vec<usize>, go_on: &GoOn<'_>) -> Result<Self, Cancelled> {
        let distances = sources.par_iter().map(|&source| graph.geodesics(source, go_on)).collect::<Result<_, _>>()?;
        Ok(Self { sources, distances })
    }

    /// Classical scaling of the sources, then every point by its distances to them.
    pub(super) fn embed(&self, go_on: &GoOn<'_>) -> Result<Option<Vec<Point2<f64>>>, Cancelled> {
        let count = self.sources.len();
        let squared = |row: usize, p: usize| f64::from(self.distances[row][p]).powi(2);
        let mut gram = DMatrix::zeros(count, count);
        for c in 0..count {
            go_on()?;
            for r in 0..count {
                gram[(r, c)] = (squared(r, self.sources[c]) + squared(c, self.sources[r])) / 2.0;
            }
        }
        let means = (0..count).map(|r| go_on().map(|()| gram.row(r).mean())).collect::<Result<Vec<f64>, _>>()?;
        let mean = means.iter().sum::<f64>() / count as f64;
        for r in 0..count {
            go_on()?;
            for c in 0..count {
                gram[(r, c)] = -0.5 * (gram[(r, c)] - means[r] - means[c] + mean);
            }
        }
        let Some(leading) = leading_two(gram, go_on)? else { return Ok(None) };
        if leading.values[1] <= LINE_SHARE * leading.values[0].abs() || leading.values[0] <= 0.0 {
            return Ok(None);
        }
        let rows = [0, 1].map(|k| leading.vectors[k].scale(1.0 / leading.values[k].sqrt()));
        let place = |p: usize| {
            go_on()?;
            let mut at = Vector2::zeros();
            for s in 0..count {
                let pull = -0.5 * (squared(s, p) - means[s]);
                at += Vector2::new(rows[0][s], rows[1][s]) * pull;
            }
            Ok(Point2::from(at))
        };
        let all = (0..self.distances[0].len()).into_par_iter().with_min_len(POINTS_PER_TASK);
        let mut points: Vec<Point2<f64>> = all.map(place).collect::<Result<_, Cancelled>>()?;
        let centre = points.iter().map(|p| p.coords).sum::<Vector2<f64>>() / points.len() as f64;
        points.iter_mut().for_each(|p| *p -= centre);
        Ok(Some(points))
    }

    pub(super) fn residual_variance(&self, points: &[Point2<f64>], go_on: &GoOn<'_>) -> Result<f64, Cancelled> {
        // Count, and sums of graph distance g, plane distance p, g², p² and g p.
        let of_row = |(row, &source): (&Vec<f32>, &usize)| {
            go_on()?;
            Ok(row.iter().zip(points).fold(SVector::<f64, 6>::zeros(), |sums, (g, p)| {
                let (g, p) = (f64::from(*g), (p - points[source]).norm());
                sums + SVector::from([1.0, g, p, g * g, p * p, g * p])
            }))
        };
        // Summed in the order of the sources, not in that of the threads.
        let rows = self.distances.par_iter().zip(&self.sources).map(of_row);
        let rows: Vec<SVector<f64, 6>> = rows.collect::<Result<_, Cancelled>>()?;
        let [n, g, p, gg, pp, gp] = rows.into_iter().sum::<SVector<f64, 6>>().into();
        let covariance = gp - g * p / n;
        let spread = (gg - g * g / n) * (pp - p * p / n);
        Ok(if spread > 0.0 { (1.0 - covariance * covariance / spread).max(0.0) } else { 1.0 })
    }
}
