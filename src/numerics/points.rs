//! Points in space, to find the nearest to a place and those around it: a k-d tree (Bentley, CACM 18, 1975).
//!
//! The tree is whole: every leaf lies at the same depth, so that a node's children need no pointers.
//! Of points equally near the one that the search meets first is taken; that depends on the points and the
//! place alone.

use nalgebra::Point3;

use super::field::id;

/// Points of a leaf, about.
const LEAF: usize = 32;

/// Points in a k-d tree.
#[derive(Clone, Debug, Default)]
pub struct Points {
    /// Leaf by leaf.
    places: Vec<Point3<f64>>,
    /// The number of each.
    numbers: Vec<u32>,
    /// Where each leaf begins, and where the last ends.
    leaves: Vec<usize>,
    /// The coordinate that each node is split at: that of node k has those of its halves at 2k and 2k + 1; the
    /// root is node 1.
    splits: Vec<f64>,
    depth: usize,
}

impl Points {
    /// From points, which must be finite, numbered in their order.
    #[must_use]
    pub fn new(points: &[Point3<f64>]) -> Self {
        let depth = points.len().div_ceil(LEAF).max(1).next_power_of_two().ilog2() as usize;
        let mut tree = Self { depth, splits: vec![f64::INFINITY; 1 << depth], leaves: vec![0], ..Self::default() };
        let mut order: Vec<usize> = (0..points.len()).collect();
        tree.add(points, &mut order, 1, 0);
        tree
    }

    /// Adds a node and all below it.
    fn add(&mut self, points: &[Point3<f64>], order: &mut [usize], node: usize, level: usize) {
        if level == self.depth {
            self.places.extend(order.iter().map(|&n| points[n]));
            self.numbers.extend(order.iter().map(|&n| id(n)));
            self.leaves.push(self.places.len());
            return;
        }
        let axis = level % 3;
        let middle = split(points, order, axis);
        if let Some(&first) = order.get(middle) {
            self.splits[node] = points[first][axis];
        }
        let (low, high) = order.split_at_mut(middle);
        self.add(points, low, 2 * node, level + 1);
        self.add(points, high, 2 * node + 1, level + 1);
    }

    /// Number of the nearest point, or `None` without points.
    #[must_use]
    pub fn nearest(&self, p: Point3<f64>) -> Option<usize> {
        let mut best = (f64::INFINITY, None);
        self.visit(p, f64::INFINITY, |place, number| {
            let squared = squared(place, p);
            if squared < best.0 {
                best = (squared, Some(number));
            }
            best.0
        });
        best.1
    }

    /// Number of the nearest of the points, by number and place, that are accepted (the first of equals).
    #[must_use]
    pub fn nearest_where(&self, p: Point3<f64>, accept: impl Fn(usize, &Point3<f64>) -> bool) -> Option<usize> {
        let mut best = (f64::INFINITY, usize::MAX);
        self.visit(p, f64::INFINITY, |place, number| {
            let found = (squared(place, p), number);
            if found < best && accept(number, place) {
                best = found;
            }
            best.0
        });
        (best.1 != usize::MAX).then_some(best.1)
    }

    /// Numbers of the points within `reach` of a place, in no order.
    #[must_use]
    pub fn within(&self, p: Point3<f64>, reach: f64) -> Vec<usize> {
        let limit = reach * reach;
        let mut found = Vec::new();
        self.visit(p, limit, |place, number| {
            if squared(place, p) <= limit {
                found.push(number);
            }
            limit
        });
        found
    }

    /// Calls `take` for the points of every leaf that may hold one as near as the limit, squared, the nearer of two halves
    /// first. `take` returns the limit from there on.
    fn visit(&self, p: Point3<f64>, mut limit: f64, mut take: impl FnMut(&Point3<f64>, usize) -> f64) {
        // Nodes to be looked at: number, level, and how far they are along each axis at the least.
        let mut waiting = vec![(1usize, 0usize, [0.0f64; 3])];
        while let Some((mut node, mut level, off)) = waiting.pop() {
            if off.iter().map(|x| x * x).sum::<f64>() > limit {
                continue;
            }
            while level < self.depth {
                let (axis, gap) = (level % 3, p[level % 3] - self.splits[node]);
                let is_high = gap >= 0.0;
                let mut far = off;
                far[axis] = gap.abs();
                waiting.push((2 * node + usize::from(!is_high), level + 1, far));
                node = 2 * node + usize::from(is_high);
                level += 1;
            }
            let leaf = node - (1 << self.depth);
            for k in self.leaves[leaf]..self.leaves[leaf + 1] {
                limit = take(&self.places[k], self.numbers[k] as usize);
            }
        }
    }
}

fn squared(a: &Point3<f64>, b: Point3<f64>) -> f64 {
    let d = a - b;
    d.x * d.x + d.y * d.y + d.z * d.z
}

/// Puts some points in the order of their halves along an axis, and returns where the second begins: near the middle,
/// but never between two that are equal there.
fn split(points: &[Point3<f64>], order: &mut [usize], axis: usize) -> usize {
    let middle = order.len().div_ceil(2);
    if middle >= order.len() {
        return middle;
    }
    let at = |n: usize| points[n][axis];
    order.select_nth_unstable_by(middle, |&a, &b| at(a).total_cmp(&at(b)));
    let mut first = middle;
    while first > 0 && at(order[first]) == at(order[first - 1]) {
        first -= 1;
    }
    if first > 0 {
        return first;
    }
    order.sort_unstable_by(|&a, &b| at(a).total_cmp(&at(b)));
    let mut last = middle;
    while last + 1 < order.len() && at(order[last]) == at(order[last + 1]) {
        last += 1;
    }
    last + 1
}

#[cfg(test)]
mod tests {
    use super::*;

    fn scattered(count: usize) -> Vec<Point3<f64>> {
        let of = |n: usize, k: usize| ((n * n * 37 + n * 7919 * k) % 1009) as f64 / 50.0;
        (0..count).map(|n| Point3::new(of(n, 1), of(n, 2), 0.1 * of(n, 3))).collect()
    }

    #[test]
    fn the_nearest_is_as_near_as_looking_at_all_finds() {
        for count in [1, 31, 32, 33, 700] {
            let points = scattered(count);
            let tree = Points::new(&points);
            for p in scattered(900).into_iter().step_by(7) {
                let found = tree.nearest(p).expect("there are points");
                let least = points.iter().map(|q| (q - p).norm()).fold(f64::INFINITY, f64::min);
                assert!(((points[found] - p).norm() - least).abs() < 1e-12);
            }
        }
        assert_eq!(Points::new(&[]).nearest(Point3::origin()), None);
    }

    #[test]
    fn all_points_within_a_reach_are_found() {
        let points = scattered(500);
        let tree = Points::new(&points);
        for p in scattered(60) {
            let mut found = tree.within(p, 4.0);
            found.sort_unstable();
            let expected: Vec<usize> = (0..points.len()).filter(|&k| (p - points[k]).norm() <= 4.0).collect();
            assert_eq!(found, expected);
        }
    }

    #[test]
    fn many_points_in_one_place_are_one_place() {
        let points = vec![Point3::new(1.0, 2.0, 3.0); 200];
        let tree = Points::new(&points);
        assert!(tree.nearest(Point3::origin()).is_some());
        assert_eq!(tree.within(Point3::origin(), 4.0).len(), 200);
    }
}
