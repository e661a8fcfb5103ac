//! Laplacian eigenmaps (Belkin, Niyogi, *Laplacian Eigenmaps for Dimensionality Reduction and Data Representation*,
//! Neural Computation 15, 2003): a surface is laid flat so that points that are joined come to lie near each other.
//!
//! 1. heat weights w = exp(−d² / t) on the edges of the neighbourhood graph, t the mean of their squared lengths;
//! 2. L f = λ D f, with D the sums of a point's weights and L = D − W, by the symmetric 1 − D^−½ W D^−½;
//! 3. the coordinates are D^−½ times its smallest eigenvectors but the first, which is constant.
//!
//! On a sheet these are waves: half a wave over its length, then a whole one, and so on, until half a wave over its
//! width comes. So the second coordinate is not always the second wave: [`laplacian`] returns several, for the caller
//! to choose one that tells more than the first does (Chen, Meilă, NeurIPS 2019).

use nalgebra::{DMatrix, DVector, Point3};

use crate::cancel::{Cancel, Cancelled};
use crate::numerics::field::id;
use crate::numerics::graph::Edges;
use crate::numerics::sparse::{EigenError, Sparse, smallest};

/// The `count` smoothest coordinates of points, in no scale. `lists` are the edges of a connected neighbourhood graph.
///
/// # Errors
/// Those of [`smallest`].
pub fn laplacian(
    positions: &[Point3<f64>],
    lists: &[Edges],
    count: usize,
    cancel: &dyn Cancel,
) -> Result<DMatrix<f64>, EigenError> {
    let heat = heat(lists);
    let roots = roots(lists, heat, cancel)?;
    let matrix = matrix(lists, heat, &roots, cancel)?;
    let known = roots.normalize();
    let mut found = smallest(&matrix, positions, count, Some(&known), cancel)?;
    for mut wave in found.column_iter_mut() {
        wave.component_div_assign(&roots);
    }
    Ok(found)
}

/// D^½.
fn roots(lists: &[Edges], heat: f64, cancel: &dyn Cancel) -> Result<DVector<f64>, Cancelled> {
    let mut roots = DVector::from_element(lists.len(), 1.0);
    for (a, list) in lists.iter().enumerate() {
        cancel.check()?;
        let sum: f64 = list.iter().map(|edge| weight(edge.1, heat)).sum();
        // A point without edges is a piece of its own.
        roots[a] = if sum > 0.0 { sum.sqrt() } else { 1.0 };
    }
    Ok(roots)
}

/// 1 − D^−½ W D^−½.
fn matrix(lists: &[Edges], heat: f64, roots: &DVector<f64>, cancel: &dyn Cancel) -> Result<Sparse, Cancelled> {
    let mut rows = Vec::with_capacity(lists.len());
    for (a, list) in lists.iter().enumerate() {
        cancel.check()?;
        let mut row = Vec::with_capacity(list.len() + 1);
        row.push((id(a), if list.is_empty() { 0.0 } else { 1.0 }));
        for &(b, length) in list {
            row.push((b, -weight(length, heat) / (roots[a] * roots[b as usize])));
        }
        row.sort_unstable_by_key(|entry| entry.0);
        rows.push(row);
    }
    Ok(Sparse::from_rows(rows))
}

/// t: the mean of the squared lengths of the edges.
fn heat(lists: &[Edges]) -> f64 {
    let (mut sum, mut count) = (0.0, 0usize);
    for edge in lists.iter().flatten() {
        sum += f64::from(edge.1).powi(2);
        count += 1;
    }
    sum / count.max(1) as f64
}

fn weight(length: f32, heat: f64) -> f64 {
    (-f64::from(length).powi(2) / heat).exp()
}

#[cfg(test)]
mod tests {
    use std::f64::consts::PI;

    use super::*;
    use crate::cancel::Never;

    /// Points of a row, each joined to the next.
    fn row(count: usize) -> (Vec<Point3<f64>>, Vec<Edges>) {
        let beside = |n: usize| [n.checked_sub(1), (n + 1 < count).then_some(n + 1)];
        let list = |n: usize| beside(n).into_iter().flatten().map(|m| (id(m), 1.0)).collect();
        ((0..count).map(|n| Point3::new(n as f64, 0.0, 0.0)).collect(), (0..count).map(list).collect())
    }

    /// The eigenvalues that coordinates belong to.
    fn values_of(lists: &[Edges], coordinates: &DMatrix<f64>) -> Vec<f64> {
        let heat = heat(lists);
        let roots = roots(lists, heat, &Never).expect("not stopped");
        let matrix = matrix(lists, heat, &roots, &Never).expect("not stopped");
        let mut vectors = coordinates.clone();
        for mut vector in vectors.column_iter_mut() {
            vector.component_mul_assign(&roots);
        }
        let image = matrix.product(&vectors);
        (0..vectors.ncols()).map(|k| vectors.column(k).dot(&image.column(k))).collect()
    }

    #[test]
    fn coordinates_of_a_row_are_its_waves() {
        // D^-1 L of a path: 1 - cos(k pi / (n - 1)), cos(k pi m / (n - 1)).
        let count = 240;
        let (places, lists) = row(count);
        let found = laplacian(&places, &lists, 3, &Never).expect("settles");
        let values = values_of(&lists, &found);
        let last = (count - 1) as f64;
        for (k, value) in values.iter().enumerate() {
            let step = PI * (k + 1) as f64 / last;
            assert!((value - (1.0 - step.cos())).abs() < 1e-9);
            let wave = DVector::from_fn(count, |m, _| (step * m as f64).cos()).normalize();
            let own = found.column(k).normalize();
            assert!((own.dot(&wave).abs() - 1.0).abs() < 1e-8);
        }
    }

    #[test]
    fn points_without_edges_are_pieces_of_their_own() {
        let (mut places, mut lists) = row(30);
        places.push(Point3::new(50.0, 0.0, 0.0));
        lists.push(Vec::new());
        let found = laplacian(&places, &lists, 2, &Never).expect("settles");
        let values = values_of(&lists, &found);
        assert!(values[0].abs() < 1e-12 && values[1] > 1e-3, "{values:?}");
    }
}
