//! The curves of the plane on which a field is 0 (marching squares).
//!
//! A curve goes from pixel edge to pixel edge, through the cells between four pixels' centres. Edges are numbered
//! 2 · pixel for those along i, 2 · pixel + 1 for those along j.

use std::collections::{BTreeMap, BTreeSet};

use nalgebra::Vector2;

use crate::space::Grid;

/// The longest closed curve on which a grid of one layer is 0, in pixels, with what is positive to its left; empty where
/// nothing is positive. What is positive at the border has no closed curve.
#[must_use]
pub fn longest_contour(grid: &Grid<f32>) -> Vec<Vector2<f64>> {
    let next = crossings(grid);
    let mut unused: BTreeSet<usize> = next.keys().copied().collect();
    let mut longest: Vec<usize> = Vec::new();
    while let Some(start) = unused.pop_first() {
        let mut curve = vec![start];
        let mut edge = next[&start];
        while edge != start && unused.remove(&edge) {
            curve.push(edge);
            edge = next[&edge];
        }
        if curve.len() > longest.len() {
            longest = curve;
        }
    }
    longest.into_iter().map(|edge| crossing(grid, edge)).collect()
}

/// For every edge that a curve crosses, the edge that it crosses next.
fn crossings(grid: &Grid<f32>) -> BTreeMap<usize, usize> {
    let [nx, ny, _] = grid.dims();
    let mut next = BTreeMap::new();
    for j in 0..ny - 1 {
        for i in 0..nx - 1 {
            go_through_cell(grid, i + nx * j, &mut next);
        }
    }
    next
}

/// Adds the ways through the cell whose first corner is pixel `o`.
fn go_through_cell(grid: &Grid<f32>, o: usize, next: &mut BTreeMap<usize, usize>) {
    let nx = grid.dims()[0];
    let edges = [2 * o, 2 * (o + 1) + 1, 2 * (o + nx), 2 * o + 1];
    let values = [o, o + 1, o + nx + 1, o + nx].map(|corner| grid.as_slice()[corner]);
    // Going round the cell, the curve leaves it where what is positive ends, and comes in where it begins.
    let (mut ends, mut begins) = (Vec::new(), Vec::new());
    for k in 0..4 {
        match (values[k] > 0.0, values[(k + 1) % 4] > 0.0) {
            (true, false) => ends.push(k),
            (false, true) => begins.push(k),
            _ => {}
        }
    }
    let is_joined = values.iter().sum::<f32>() > 0.0;
    for &end in &ends {
        let begin = match begins[..] {
            [only] => only,
            // With two of each, the middle tells which belong together.
            _ if is_joined => (end + 1) % 4,
            _ => (end + 3) % 4,
        };
        next.insert(edges[end], edges[begin]);
    }
}

/// Where a curve crosses an edge.
fn crossing(grid: &Grid<f32>, edge: usize) -> Vector2<f64> {
    let (o, is_along_j) = (edge / 2, edge % 2 == 1);
    let (step, along) = if is_along_j { (grid.dims()[0], Vector2::y()) } else { (1, Vector2::x()) };
    let [i, j, _] = grid.index(o);
    let (a, b) = (f64::from(grid.as_slice()[o]), f64::from(grid.as_slice()[o + step]));
    Vector2::new(i as f64, j as f64) + along * (a / (a - b))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A grid that is the largest of some values at each pixel.
    fn grid(dims: [usize; 2], value: impl Fn(Vector2<f64>) -> f64) -> Grid<f32> {
        let mut cells = Vec::new();
        for n in 0..dims[0] * dims[1] {
            let at = Vector2::new((n % dims[0]) as f64, (n / dims[0]) as f64);
            cells.push(format!("{}", value(at)).parse().expect("a number"));
        }
        Grid::from_vec([dims[0], dims[1], 1], cells).expect("as many cells")
    }

    fn disc(at: Vector2<f64>, x: f64, y: f64, radius: f64) -> f64 {
        radius - (at - Vector2::new(x, y)).norm()
    }

    #[test]
    fn the_longest_curve_runs_counter_clockwise_around_the_larger_disc() {
        let two = grid([40, 24], |at| disc(at, 10.0, 11.0, 8.0).max(disc(at, 31.0, 12.0, 4.0)));
        let curve = longest_contour(&two);
        let mut twice_the_area = 0.0;
        for (k, p) in curve.iter().enumerate() {
            assert!((disc(*p, 10.0, 11.0, 8.0)).abs() < 0.05, "{p}");
            twice_the_area += p.perp(&curve[(k + 1) % curve.len()]);
        }
        assert!((twice_the_area / 2.0 - 201.0).abs() < 2.0, "{twice_the_area}");
    }

    #[test]
    fn the_middle_tells_whether_corners_that_touch_are_joined() {
        let corners = |middle: f64| {
            grid([4, 4], |at| if at == Vector2::new(1.0, 1.0) || at == Vector2::new(2.0, 2.0) { middle } else { -1.0 })
        };
        assert_eq!(longest_contour(&corners(2.0)).len(), 8);
        assert_eq!(longest_contour(&corners(0.5)).len(), 4);
        assert!(longest_contour(&corners(-1.0)).is_empty());
    }
}
