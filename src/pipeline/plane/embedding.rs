//! The choice of how a surface is laid flat (section 2.4 of the paper names all three): one neighbourhood graph, one
//! measure of what became of lengths, angles and sides, and in between
//!
//! - ISOMAP, which keeps distances along the surface (`super::isomap`);
//! - modified LLE, which keeps neighbourhoods (`super::lle`);
//! - Laplacian eigenmaps, which keep neighbours close (`super::laplacian`).
//!
//! The last two give a plane up to a linear map only. It is scaled so that lengths are true on the whole
//! (`Tangents::scale`) and turned to its axes. A fit of the squared plane distances to the squared geodesic ones would
//! be the scale of the lowest residual variance, by a little; but geodesics of a sheet that bends in its plane run round
//! the bend, which makes it narrower than it is (angles off by 5° instead of 2° on a caudate), and where an eigenvector
//! repeats another the fit is no metric.

use nalgebra::{DMatrix, Matrix2, Point2, Vector2};

use super::geodesics::Geodesics;
use super::graph::neighborhood_graph;
use super::isomap::{EXACT_LIMIT, isomap};
use super::laplacian::laplacian;
use super::lle::lle;
use super::tangents::{PlaneDistortion, Tangents};
use crate::cancel::{Cancel, Cancelled};
use crate::model::Stretch;
use crate::numerics::field::floor_index;
use crate::numerics::graph::{Edges, Graph};
use crate::numerics::moments::{Axes2, mean};
use crate::numerics::sparse::EigenError;
use crate::params::{CheckedParams, Embedding, Landmarks, Neighbors};
use crate::pipeline::surface::Surface;

/// Points that are laid out by eigenvectors at most: matrix, factor and vectors take 8 kB a point then, as much in all as
/// exact ISOMAP takes at its limit.
pub(crate) const SPECTRAL_LIMIT: usize = 100_000;
/// Waves among which Laplacian eigenmaps look for the second coordinate: enough for sheets six times as long as
/// they are wide.
const WAVES: usize = 7;
/// Share of a plane that may be turned over. Planes that are good to work in have 0.011 at most; those of sheets
/// that lie over themselves 0.04 and more.
pub const MAX_TURNED_OVER: f64 = 0.02;

/// A flattened surface.
#[derive(Clone, Debug, Default)]
pub struct Flat {
    /// Plane coordinates of every point, voxels, centred at 0.
    pub points: Vec<Point2<f64>>,
    /// How it was laid flat; `None` of a side that takes its coordinates from the sheet.
    pub embedded: Option<Embedded>,
    /// Length after which the first coordinate begins again, voxels, of a ring
    /// ([`rolled`](super::injective::rolled)).
    pub period: Option<f64>,
}

impl Flat {
    /// Whether the plane is an injective map of the surface's mesh ([`injective`](super::injective)): lengths in it are
    /// not those on the surface.
    #[must_use]
    pub fn is_unrolled(&self) -> bool {
        self.embedded.is_some_and(|embedded| embedded.unrolled.is_some())
    }

    /// What the plane does to the angles and sides of the surface; `None` for a string, where nothing can be judged.
    ///
    /// # Errors
    /// When it is cancelled.
    pub fn distortion(&self, surface: &Surface, cancel: &dyn Cancel) -> Result<Option<PlaneDistortion>, Cancelled> {
        Ok(Tangents::of(surface, cancel)?.distortion_round(&self.points, self.period))
    }
}

/// How a surface was laid flat.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Embedded {
    /// 1 − R² between graph and plane distances, over all pairs with a landmark.
    pub residual_variance: f64,
    /// Neighbours per point, the mean.
    pub neighbors: f64,
    /// Landmarks used.
    pub landmarks: usize,
    /// Pieces that the neighbourhood graph fell into before touching points joined them.
    pub pieces: usize,
    /// How a plane stretches that took the place of the embedding's, of which all else is told.
    pub unrolled: Option<Stretch>,
}

/// How a surface is to be laid flat.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Method {
    /// The embedding.
    pub embedding: Embedding,
    /// The neighbourhood graph that it works on.
    pub neighbors: Neighbors,
    /// The sources of geodesics: for ISOMAP, and for the residual variance of all.
    pub landmarks: Landmarks,
}

impl From<&CheckedParams> for Method {
    fn from(params: &CheckedParams) -> Self {
        Self { embedding: params.embedding, neighbors: params.neighbors, landmarks: params.landmarks }
    }
}

/// Why a surface could not be laid flat.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum EmbeddingError {
    /// Stopped.
    #[error(transparent)]
    Cancelled(#[from] Cancelled),
    /// Fewer points than coordinates can be told apart by.
    #[error("only {points} points")]
    TooFewPoints {
        /// Points given.
        points: usize,
    },
    /// More points than fit in memory.
    #[error("{points} points; at most {limit}")]
    TooManyPoints {
        /// Points given.
        points: usize,
        /// Points allowed.
        limit: usize,
    },
    /// A graph with more edges than fit in memory.
    #[error("a graph of {needed_mib} MiB; at most {allowed_mib}")]
    TooManyNeighbors {
        /// Memory that the graph needs.
        needed_mib: u64,
        /// Memory that there is for it.
        allowed_mib: u64,
    },
    /// The points lie on a line.
    #[error("the points span no plane")]
    NoPlane,
    /// The eigenproblem has no answer; never seen on a surface.
    #[error("the plane's eigenvectors were not found: {0}")]
    NoEigenvectors(EigenError),
}

impl From<EigenError> for EmbeddingError {
    fn from(error: EigenError) -> Self {
        match error {
            EigenError::Cancelled(stop) => Self::Cancelled(stop),
            EigenError::TooFewRows { rows, .. } => Self::TooFewPoints { points: rows },
            other => Self::NoEigenvectors(other),
        }
    }
}

/// Lays a connected surface flat. `voxel_mm` turns an ε in mm into voxels; the graph may take half of `memory_bytes`.
///
/// # Errors
/// See [`EmbeddingError`].
pub fn flatten(
    surface: &Surface,
    Method { embedding, neighbors, landmarks }: Method,
    voxel_mm: f64,
    memory_bytes: u64,
    cancel: &dyn Cancel,
) -> Result<Flat, EmbeddingError> {
    let points = surface.positions.len();
    if points < 8 {
        return Err(EmbeddingError::TooFewPoints { points });
    }
    let limit = if embedding == Embedding::Isomap { usize::MAX } else { SPECTRAL_LIMIT };
    let limit = if landmarks == Landmarks::All { EXACT_LIMIT } else { limit };
    if points > limit {
        return Err(EmbeddingError::TooManyPoints { points, limit });
    }
    check_graph(surface, neighbors, voxel_mm, memory_bytes)?;
    let (graph, pieces) = neighborhood_graph(surface, neighbors, voxel_mm, cancel)?;
    if embedding == Embedding::Laplacian {
        check_edges(points, graph.mean_degree())?;
    }
    let geodesics = Geodesics::chosen(&graph, landmarks, cancel)?;
    let points = match embedding {
        Embedding::Isomap => isomap(&geodesics, cancel)?,
        Embedding::Lle => Sheet::of(surface, &graph, cancel)?.by_neighborhoods(cancel)?,
        Embedding::Laplacian => Sheet::of(surface, &graph, cancel)?.by_waves(cancel)?,
    };
    let points = points.ok_or(EmbeddingError::NoPlane)?;
    let embedded = Embedded {
        residual_variance: geodesics.residual_variance(&points, cancel)?,
        neighbors: graph.mean_degree(),
        landmarks: geodesics.sources.len(),
        pieces,
        unrolled: None,
    };
    Ok(Flat { points, embedded: Some(embedded), period: None })
}

/// Refuses neighbourhoods whose graph would not fit in half of the memory, before it is made.
fn check_graph(
    surface: &Surface,
    neighbors: Neighbors,
    voxel_mm: f64,
    memory_bytes: u64,
) -> Result<(), EmbeddingError> {
    /// Bytes of an edge at both of its ends, in the lists that grow and in the graph made of them.
    const EDGE_BYTES: f64 = 48.0;
    /// Points of a surface of voxels in a circle of radius 1.
    const POINTS_IN_CIRCLE: f64 = 4.0;
    let points = surface.positions.len() as f64;
    let each = match neighbors {
        Neighbors::Auto => return Ok(()),
        Neighbors::Count(k) => k as f64,
        Neighbors::RadiusMm(radius_mm) => POINTS_IN_CIRCLE * (radius_mm / voxel_mm).powi(2),
    };
    let needed = points * each.min(points) * EDGE_BYTES;
    let allowed = memory_bytes / 2;
    if needed <= allowed as f64 {
        return Ok(());
    }
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a count; what is beyond saturates")]
    let needed_mib = needed as u64 >> 20;
    Err(EmbeddingError::TooManyNeighbors { needed_mib, allowed_mib: allowed >> 20 })
}

/// Refuses graphs with more edges than the largest surface has with the automatic neighbourhood: the factor of the
/// Laplacian grows with them. LLE takes no more neighbours than it needs.
fn check_edges(points: usize, neighbors: f64) -> Result<(), EmbeddingError> {
    /// Neighbours in a ball of 4 voxels.
    const AUTO_NEIGHBORS: f64 = 50.0;
    let limit = floor_index(SPECTRAL_LIMIT as f64 * (AUTO_NEIGHBORS / neighbors).min(1.0));
    if points > limit {
        return Err(EmbeddingError::TooManyPoints { points, limit });
    }
    Ok(())
}

/// A surface with its neighbourhood graph and tangent planes.
struct Sheet<'a> {
    surface: &'a Surface,
    lists: Vec<Edges>,
    tangents: Tangents<'a>,
}

impl<'a> Sheet<'a> {
    fn of(surface: &'a Surface, graph: &Graph, cancel: &dyn Cancel) -> Result<Self, Cancelled> {
        let lists = graph.lists(cancel)?;
        let tangents = Tangents::of(surface, cancel)?;
        Ok(Self { surface, lists, tangents })
    }

    /// The plane of LLE.
    fn by_neighborhoods(&self, cancel: &dyn Cancel) -> Result<Option<Vec<Point2<f64>>>, EmbeddingError> {
        let found = lle(&self.surface.positions, &self.lists, cancel)?;
        let pairs = pairs(&found, 1);
        let Some(scale) = self.tangents.scale(&pairs) else { return Ok(None) };
        Ok(Some(on_axes(&scaled(&pairs, &scale))))
    }

    /// The plane of the first wave and another: of those that leave no more turned over than is
    /// allowed, the one that keeps angles best; of none, the one that leaves least.
    fn by_waves(&self, cancel: &dyn Cancel) -> Result<Option<Vec<Point2<f64>>>, EmbeddingError> {
        let found = laplacian(&self.surface.positions, &self.lists, WAVES, cancel)?;
        let mut best: Option<([f64; 2], Vec<Point2<f64>>)> = None;
        for second in 1..WAVES {
            cancel.check()?;
            let pairs = pairs(&found, second);
            let Some(scale) = self.tangents.scale(&pairs) else { continue };
            let scaled = scaled(&pairs, &scale);
            let Some(distortion) = self.tangents.distortion(&scaled) else { continue };
            let loss = [distortion.turned_over.max(MAX_TURNED_OVER), distortion.angle_error_deg];
            if best.as_ref().is_none_or(|best| loss < best.0) {
                best = Some((loss, scaled));
            }
        }
        Ok(best.map(|(_, scaled)| on_axes(&scaled)))
    }
}

/// The first coordinate of every point, and one of the others.
fn pairs(vectors: &DMatrix<f64>, second: usize) -> Vec<Point2<f64>> {
    (0..vectors.nrows()).map(|p| Point2::new(vectors[(p, 0)], vectors[(p, second)])).collect()
}

fn scaled(pairs: &[Point2<f64>], scale: &Matrix2<f64>) -> Vec<Point2<f64>> {
    pairs.iter().map(|pair| scale * pair).collect()
}

/// Points about their mean, the first axis along their largest spread, as ISOMAP's are.
pub(super) fn on_axes(places: &[Point2<f64>]) -> Vec<Point2<f64>> {
    let middle = mean(places);
    let mut spread = Matrix2::zeros();
    for place in places {
        let d = place.coords - middle;
        spread += d * d.transpose();
    }
    let [along, _] = Axes2::of(spread).directions;
    let across = Vector2::new(-along.y, along.x);
    let mut points = Vec::with_capacity(places.len());
    for place in places {
        let d = place.coords - middle;
        points.push(Point2::new(along.dot(&d), across.dot(&d)));
    }
    points
}

#[cfg(test)]
mod tests {
    use nalgebra::{Point3, Vector3};
    use rayon::ThreadPoolBuilder;

    use super::*;
    use crate::cancel::Never;
    use crate::numerics::field::id;

    /// A strip of points about one apart, each touching the eight around it, with some noise.
    fn strip(rows: usize, cols: usize, place: impl Fn(f64, f64) -> Point3<f64>) -> Surface {
        let mut surface = Surface::default();
        let uneven = |n: usize, step: f64| (n as f64 * step).fract() - 0.5;
        for n in 0..rows * cols {
            let (i, j) = (n / cols, n % cols);
            let at = place(j as f64 + 0.6 * uneven(n, 0.754_877), i as f64 + 0.6 * uneven(n, 0.569_84));
            surface.positions.push(at + Vector3::z() * 0.3 * uneven(n, 0.618_034));
            let near = |m: &usize| *m != n && (m / cols).abs_diff(i).max((m % cols).abs_diff(j)) < 2;
            surface.adjacency.push((0..rows * cols).filter(near).map(id).collect());
        }
        surface
    }

    fn plane_of(surface: &Surface, embedding: Embedding) -> Result<Flat, EmbeddingError> {
        let method = Method { embedding, neighbors: Neighbors::Auto, landmarks: Landmarks::Auto };
        flatten(surface, method, 1.0, u64::MAX, &Never)
    }

    fn distortion_of(flat: &Flat, surface: &Surface) -> PlaneDistortion {
        flat.distortion(surface, &Never).expect("not stopped").expect("judged")
    }

    fn arch(x: f64, y: f64) -> Point3<f64> {
        Point3::new(12.0 * (x / 12.0).sin(), y, 12.0 * (x / 12.0).cos())
    }

    fn extent(points: &[Point2<f64>], axis: usize) -> f64 {
        let of = |p: &Point2<f64>| p[axis];
        points.iter().map(of).fold(f64::MIN, f64::max) - points.iter().map(of).fold(f64::MAX, f64::min)
    }

    #[test]
    fn isomap_and_lle_lay_an_arch_flat_with_its_lengths() {
        let surface = strip(14, 32, arch);
        for (embedding, degrees) in [(Embedding::Isomap, 2.0), (Embedding::Lle, 0.8)] {
            let flat = plane_of(&surface, embedding).expect("a plane");
            let residual_variance = flat.embedded.expect("laid flat").residual_variance;
            let distortion = distortion_of(&flat, &surface);
            assert!(distortion.angle_error_deg < degrees && distortion.turned_over == 0.0, "{distortion:?}");
            assert!(residual_variance < 0.001, "{residual_variance:.5}");
            let [long, wide] = [0, 1].map(|axis| extent(&flat.points, axis));
            assert!(
                (30.0..33.5).contains(&long) && (12.5..14.5).contains(&wide),
                "{embedding:?}: {long:.1} by {wide:.1}"
            );
        }
    }

    #[test]
    fn the_second_coordinate_of_a_long_strip_runs_across_it() {
        // Four times as long as wide: the second wave is along the strip too.
        let surface = strip(10, 40, arch);
        let flat = plane_of(&surface, Embedding::Laplacian).expect("a plane");
        let distortion = distortion_of(&flat, &surface);
        assert!(distortion.turned_over < 0.02 && distortion.angle_error_deg < 40.0, "{distortion:?}");
        let along = |n: usize| f64::from(id(n % 40)) - 19.5;
        let sum: f64 = (0..400).map(|n| along(n) * flat.points[n].x).sum::<f64>().abs();
        let norm = |of: &dyn Fn(usize) -> f64| (0..400).map(|n| of(n).powi(2)).sum::<f64>().sqrt();
        assert!(sum > 0.95 * norm(&along) * norm(&|n| flat.points[n].x));
    }

    #[test]
    fn what_cannot_be_laid_flat_is_typed() {
        let short = strip(1, 5, |x, y| Point3::new(x, y, 0.0));
        let string = strip(1, 40, |x, _| Point3::new(x, 0.0, 0.0));
        for embedding in Embedding::ALL {
            let points = EmbeddingError::TooFewPoints { points: 5 };
            assert_eq!(plane_of(&short, embedding).err(), Some(points));
        }
        for embedding in [Embedding::Lle, Embedding::Laplacian] {
            assert_eq!(plane_of(&string, embedding).err(), Some(EmbeddingError::NoPlane));
        }
        let many = Surface { positions: vec![Point3::origin(); SPECTRAL_LIMIT + 1], adjacency: Vec::new() };
        let error = plane_of(&many, Embedding::Lle).expect_err("too many");
        assert_eq!(error.to_string(), "100001 points; at most 100000");
        assert_eq!(check_edges(90_000, 48.0), Ok(()));
        let error = check_edges(30_000, 400.0).expect_err("too many edges");
        assert_eq!(error.to_string(), "30000 points; at most 12500");
    }

    #[test]
    fn a_closed_band_has_no_plane() {
        let around = |x: f64, y: f64| {
            let angle = x * std::f64::consts::TAU / 40.0;
            Point3::new(6.4 * angle.sin(), y, 6.4 * angle.cos())
        };
        let mut surface = strip(10, 40, around);
        for (n, list) in surface.adjacency.iter_mut().enumerate() {
            let (i, j) = (n / 40, n % 40);
            let other_end = [0, 39].contains(&j).then_some(39 - j);
            list.extend(
                other_end.iter().flat_map(|j| (i.saturating_sub(1)..(i + 2).min(10)).map(move |i| id(i * 40 + j))),
            );
            list.sort_unstable();
        }
        for embedding in Embedding::ALL {
            let distortion = distortion_of(&plane_of(&surface, embedding).expect("a plane"), &surface);
            assert!(distortion.turned_over > MAX_TURNED_OVER, "{embedding:?}: {distortion:?}");
        }
    }

    #[test]
    fn planes_do_not_depend_on_the_threads() {
        let surface = strip(20, 50, arch);
        for embedding in Embedding::ALL {
            let on = |threads: usize| {
                let pool = ThreadPoolBuilder::new().num_threads(threads).build().expect("a pool");
                pool.install(|| plane_of(&surface, embedding)).expect("a plane").points
            };
            assert_eq!(on(1), on(3), "{embedding:?}");
        }
    }
}
