//! ISOMAP (Tenenbaum, de Silva, Langford, Science 290, 2000; section 2.4 of the paper): a surface is laid flat so
//! that distances in the plane are those along the surface.
//!
//! 1. B = −½ J D² J of the squared geodesic distances D² between the sources, J taking the mean of rows and columns away;
//! 2. the two leading eigenpairs of B place the sources: classical scaling;
//! 3. every point is placed by its distances to the sources.
//!
//! With all points as sources it is exact; with farthest-point landmarks it is landmark ISOMAP (de Silva,
//! Tenenbaum, *Sparse multidimensional scaling using landmark points*, 2004).

use nalgebra::{DMatrix, DVector, Point2, Vector2};

use super::geodesics::Geodesics;
use crate::cancel::{Cancel, Cancelled};
use crate::numerics::eigen::leading_two;
use crate::numerics::moments::mean;
use crate::numerics::parallel::{POINTS_PER_TASK, each_number};

/// Second eigenvalue over the first up to which points lie on a line: a plane a thousandth as wide as it
/// is long. Lengths of edges are kept to a few digits less.
const LINE_SHARE: f64 = 1e-6;
/// Points that exact ISOMAP takes at most: its matrix takes 8 bytes a pair.
pub const EXACT_LIMIT: usize = 10_000;

/// Classical scaling of the sources, then every point by its distances to them. `None` where the eigenproblem has no
/// two positive values: the points lie on a line.
///
/// # Errors
/// When it is cancelled.
pub(super) fn isomap(geodesics: &Geodesics, cancel: &dyn Cancel) -> Result<Option<Vec<Point2<f64>>>, Cancelled> {
    let mut gram = squared_distances(geodesics, cancel)?;
    let means = centred(&mut gram, cancel)?;
    let Some(leading) = leading_two(gram, cancel)? else { return Ok(None) };
    if leading.values[1] <= LINE_SHARE * leading.values[0].abs() || leading.values[0] <= 0.0 {
        return Ok(None);
    }
    let axes = [0, 1].map(|k| leading.vectors[k].scale(1.0 / leading.values[k].sqrt()));
    let scaling = Scaling { geodesics, means, axes };
    let mut points = each_number(geodesics.distances[0].len(), POINTS_PER_TASK, |p| scaling.place(p), cancel)?;
    let centre = mean(&points);
    for p in &mut points {
        *p -= centre;
    }
    Ok(Some(points))
}

/// Squared distances between the sources, as the mean of both ways: a symmetric matrix.
fn squared_distances(geodesics: &Geodesics, cancel: &dyn Cancel) -> Result<DMatrix<f64>, Cancelled> {
    let sources = &geodesics.sources;
    let mut squares = DMatrix::zeros(sources.len(), sources.len());
    for c in 0..sources.len() {
        cancel.check()?;
        for r in 0..sources.len() {
            squares[(r, c)] = (geodesics.squared(r, sources[c]) + geodesics.squared(c, sources[r])) / 2.0;
        }
    }
    Ok(squares)
}

/// Makes squared distances the products of vectors from their mean, and returns the means of the rows that were.
fn centred(squares: &mut DMatrix<f64>, cancel: &dyn Cancel) -> Result<Vec<f64>, Cancelled> {
    let count = squares.nrows();
    let mut means = Vec::with_capacity(count);
    for r in 0..count {
        cancel.check()?;
        means.push(squares.row(r).mean());
    }
    let mean = means.iter().sum::<f64>() / count as f64;
    for r in 0..count {
        cancel.check()?;
        for c in 0..count {
            squares[(r, c)] = -0.5 * (squares[(r, c)] - means[r] - means[c] + mean);
        }
    }
    Ok(means)
}

/// What places a point by its distances to the sources.
struct Scaling<'a> {
    geodesics: &'a Geodesics,
    /// Mean squared distance of each source to the others.
    means: Vec<f64>,
    /// The two leading eigenvectors, over the roots of their values.
    axes: [DVector<f64>; 2],
}

impl Scaling<'_> {
    fn place(&self, point: usize) -> Point2<f64> {
        let mut at = Vector2::zeros();
        for s in 0..self.means.len() {
            let pull = -0.5 * (self.geodesics.squared(s, point) - self.means[s]);
            at += Vector2::new(self.axes[0][s], self.axes[1][s]) * pull;
        }
        at.into()
    }
}
