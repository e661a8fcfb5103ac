//! Geodesic distances on a surface, and the residual variance: how well a plane keeps them (section 2.4 of the paper).

use nalgebra::{Point2, SVector};
use rayon::prelude::*;

use crate::cancel::{Cancel, Cancelled};
use crate::numerics::graph::Graph;
use crate::params::Landmarks;

/// Landmarks of the automatic choice: twice as many take twice the time and change an embedding by less than 0.2 % of
/// its extent. With half as many, models change by chance only.
const AUTO_LANDMARKS: usize = 48;

/// Geodesic distances from some sources to all points.
pub(super) struct Geodesics {
    /// The sources.
    pub sources: Vec<usize>,
    /// Of each source the distances to all points, voxels.
    pub distances: Vec<Vec<f32>>,
}

impl Geodesics {
    /// From the landmarks asked for.
    ///
    /// # Errors
    /// When it is cancelled.
    pub fn chosen(graph: &Graph, landmarks: Landmarks, cancel: &dyn Cancel) -> Result<Self, Cancelled> {
        match landmarks {
            Landmarks::All => Self::from_sources(graph, (0..graph.len()).collect(), cancel),
            Landmarks::Auto => Self::farthest(graph, AUTO_LANDMARKS, cancel),
            Landmarks::Count(n) => Self::farthest(graph, n, cancel),
        }
    }

    /// Landmarks each as far as can be from those before, the first at a rim.
    fn farthest(graph: &Graph, count: usize, cancel: &dyn Cancel) -> Result<Self, Cancelled> {
        let sources = graph.spread(count, cancel)?;
        Self::from_sources(graph, sources, cancel)
    }

    fn from_sources(graph: &Graph, sources: Vec<usize>, cancel: &dyn Cancel) -> Result<Self, Cancelled> {
        let distances = sources.par_iter().map(|&source| graph.geodesics(source, cancel)).collect::<Result<_, _>>()?;
        Ok(Self { sources, distances })
    }

    /// Squared distance from a source, by its number, to a point.
    pub fn squared(&self, source: usize, point: usize) -> f64 {
        f64::from(self.distances[source][point]).powi(2)
    }

    /// 1 − R² between the distances along the surface and those in a plane (Tenenbaum et al. 2000), over all pairs
    /// with a source: 0 where the plane keeps all of them up to a common scale.
    ///
    /// # Errors
    /// When it is cancelled.
    pub fn residual_variance(&self, points: &[Point2<f64>], cancel: &dyn Cancel) -> Result<f64, Cancelled> {
        let rows = self.distances.par_iter().zip(&self.sources);
        let rows = rows.map(|(row, &source)| cancel.check().map(|()| sums_of_pairs(row, points, source)));
        // Summed in the order of the sources, not in that of the threads.
        let rows: Vec<SVector<f64, 6>> = rows.collect::<Result<_, Cancelled>>()?;
        let [n, g, p, gg, pp, gp] = rows.into_iter().sum::<SVector<f64, 6>>().into();
        let covariance = gp - g * p / n;
        let spread = (gg - g * g / n) * (pp - p * p / n);
        Ok(if spread > 0.0 { (1.0 - covariance * covariance / spread).max(0.0) } else { 1.0 })
    }
}

/// Over the pairs with one source: their count, the sums of the distance g along the surface and p in the plane, and those
/// of g², p² and g p.
fn sums_of_pairs(distances: &[f32], points: &[Point2<f64>], source: usize) -> SVector<f64, 6> {
    let mut sums = SVector::zeros();
    for (g, p) in distances.iter().zip(points) {
        let (g, p) = (f64::from(*g), (p - points[source]).norm());
        sums += SVector::from([1.0, g, p, g * g, p * p, g * p]);
    }
    sums
}
