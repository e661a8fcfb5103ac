//! Triangles and smooth normals over a lattice, shared by everything that draws a model.

use crate::model::LatticeSize;
use crate::model::{Figure, ring};
use crate::space::{WorldPoint, WorldVector};

/// Corners of triangles as offsets of nodes.
pub(super) type Triangles = Vec<[usize; 3]>;

/// Two triangles for every cell of the lattice whose four nodes are `ok`.
pub(super) fn quads(grid: LatticeSize, ok: &[bool]) -> Triangles {
    let mut triangles = Vec::new();
    for i in 1..grid.rows {
        for j in 1..grid.cols {
            let d = i * grid.cols + j;
            let (a, b, c) = (d - grid.cols - 1, d - grid.cols, d - 1);
            if [a, b, c, d].iter().all(|node| ok[*node]) {
                triangles.extend([[a, c, b], [b, c, d]]);
            }
        }
    }
    triangles
}

/// The triangles turned, all or none, so that they face along `outward` in the mean, with unit
/// normals per point. `None` without triangles.
pub(super) fn outward_normals(
    points: &[WorldPoint],
    mut triangles: Triangles,
    outward: &[WorldVector],
) -> Option<(Triangles, Vec<WorldVector>)> {
    if triangles.is_empty() {
        return None;
    }
    let facing: f64 = triangles
        .iter()
        .map(|t| doubled_area(points, t).dot(&t.iter().map(|node| outward[*node]).sum::<WorldVector>()))
        .sum();
    if facing < 0.0 {
        for triangle in &mut triangles {
            triangle.swap(1, 2);
        }
    }
    let normals = normals(points, &triangles, Some(outward));
    Some((triangles, normals))
}

/// Unit normals per point, the mean of the triangles round it by area; where that vanishes,
/// along `fallback`, else along z.
pub(super) fn normals(
    points: &[WorldPoint],
    triangles: &[[usize; 3]],
    fallback: Option<&[WorldVector]>,
) -> Vec<WorldVector> {
    let mut sums = vec![WorldVector::zeros(); points.len()];
    for triangle in triangles {
        let area = doubled_area(points, triangle);
        for node in triangle {
            sums[*node] += area;
        }
    }
    let unit = |(node, sum): (usize, WorldVector)| {
        let other = fallback.and_then(|vectors| vectors[node].try_normalize(1e-12));
        sum.try_normalize(1e-12).or(other).unwrap_or_else(WorldVector::z)
    };
    sums.into_iter().enumerate().map(unit).collect()
}

fn doubled_area(points: &[WorldPoint], &[a, b, c]: &[usize; 3]) -> WorldVector {
    (points[b] - points[a]).cross(&(points[c] - points[a]))
}

/// The wedge round the edge: from the upper edge over the crest to the lower edge, each point
/// with the medial node it belongs to. `None` when there is no crest.
pub(super) fn crest_strip(figure: &Figure, ok: &[bool]) -> Option<(Vec<(WorldPoint, WorldPoint)>, Triangles)> {
    let edge = ring(figure.grid);
    if figure.crest.len() != edge.len() {
        return None;
    }
    let mut points = Vec::with_capacity(3 * edge.len());
    for (node, crest) in edge.iter().zip(&figure.crest) {
        let medial = figure.medial[*node];
        points.extend([figure.upper[*node], *crest, figure.lower[*node]].map(|point| (point, medial)));
    }
    let usable = |n: usize| ok[edge[n]] && figure.crest[n].iter().all(|x| x.is_finite());
    let mut triangles = Vec::new();
    for here in 0..edge.len() {
        let next = (here + 1) % edge.len();
        if usable(here) && usable(next) {
            for step in [0, 1] {
                let (a, b) = (3 * here + step, 3 * next + step);
                triangles.extend([[a, a + 1, b], [b, a + 1, b + 1]]);
            }
        }
    }
    Some((points, triangles))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn triangles_face_outward_whatever_the_lattice_says() {
        let grid = LatticeSize { rows: 3, cols: 4 };
        let points: Vec<WorldPoint> = (0..12).map(|n| WorldPoint::new((n % 4) as f64, (n / 4) as f64, 0.0)).collect();
        for side in [1.0, -1.0] {
            let outward = vec![WorldVector::z() * side; 12];
            let (triangles, normals) = outward_normals(&points, quads(grid, &[true; 12]), &outward).unwrap();
            assert_eq!(triangles.len(), 12);
            assert!(normals.iter().all(|normal| (normal - WorldVector::z() * side).norm() < 1e-12));
        }
    }

    #[test]
    fn an_invalid_node_takes_its_quads_along() {
        let grid = LatticeSize { rows: 3, cols: 3 };
        let mut ok = [true; 9];
        ok[4] = false;
        assert!(quads(grid, &ok).is_empty());
        ok[4] = true;
        ok[0] = false;
        assert_eq!(quads(grid, &ok).len(), 6);
    }
}
