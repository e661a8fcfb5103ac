//! ISOMAP (Tenenbaum, de Silva, Langford, Science 290, 2000; section 2.4 of the paper): a surface is laid flat so
//! that distances in the plane are those along the surface.
//!
//! With all points as sources it is exact; with farthest-point landmarks it is landmark ISOMAP (de Silva,
//! Tenenbaum, *Sparse multidimensional scaling using landmark points*, 2004).

use nalgebra::{DMatrix, Point2, Vector2};
use rayon::prelude::*;

use super::geodesics::Geodesics;
use crate::cancel::{Cancel, Cancelled};
use crate::numerics::eigen::leading_two;

/// Second eigenvalue over the first up to which points lie on a line: a plane a thousandth as wide as it
/// is long. Lengths of edges are kept to a few digits less.
const LINE_SHARE: f64 = 1e-6;
/// Points that one thread takes at a time: fewer are not worth handing over.
const POINTS_PER_TASK: usize = 256;
/// Points that exact ISOMAP takes at most: its matrix takes 8 bytes a pair.
pub const EXACT_LIMIT: usize = 10_000;

/// Classical scaling of the sources, then every point by its distances to them. `None` where the eigenproblem has no
/// two positive values: the points lie on a line.
pub(super) fn isomap(geodesics: &Geodesics, cancel: &dyn Cancel) -> Result<Option<Vec<Point2<f64>>>, Cancelled> {
    let count = geodesics.sources.len();
    let squared = |row: usize, p: usize| f64::from(geodesics.distances[row][p]).powi(2);
    let mut gram = DMatrix::zeros(count, count);
    for c in 0..count {
        cancel.check()?;
        for r in 0..count {
            gram[(r, c)] = (squared(r, geodesics.sources[c]) + squared(c, geodesics.sources[r])) / 2.0;
        }
    }
    let means = (0..count).map(|r| cancel.check().map(|()| gram.row(r).mean())).collect::<Result<Vec<f64>, _>>()?;
    let mean = means.iter().sum::<f64>() / count as f64;
    for r in 0..count {
        cancel.check()?;
        for c in 0..count {
            gram[(r, c)] = -0.5 * (gram[(r, c)] - means[r] - means[c] + mean);
        }
    }
    let Some(leading) = leading_two(gram, cancel)? else { return Ok(None) };
    if leading.values[1] <= LINE_SHARE * leading.values[0].abs() || leading.values[0] <= 0.0 {
        return Ok(None);
    }
    let rows = [0, 1].map(|k| leading.vectors[k].scale(1.0 / leading.values[k].sqrt()));
    let place = |p: usize| {
        cancel.check()?;
        let mut at = Vector2::zeros();
        for s in 0..count {
            let pull = -0.5 * (squared(s, p) - means[s]);
            at += Vector2::new(rows[0][s], rows[1][s]) * pull;
        }
        Ok(Point2::from(at))
    };
    let all = (0..geodesics.distances[0].len()).into_par_iter().with_min_len(POINTS_PER_TASK);
    let mut points: Vec<Point2<f64>> = all.map(place).collect::<Result<_, Cancelled>>()?;
    let centre = points.iter().map(|p| p.coords).sum::<Vector2<f64>>() / points.len() as f64;
    points.iter_mut().for_each(|p| *p -= centre);
    Ok(Some(points))
}
