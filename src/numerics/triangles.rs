//! Triangle meshes: volume, and places where a mesh runs through itself.

use std::cmp::Ordering;

use nalgebra::{Point3, Vector3};

use super::field::id;
use crate::cancel::{Cancel, Cancelled};

/// The volume that a closed mesh encloses, positive when its triangles run
/// counter-clockwise seen from outside.
#[must_use]
pub fn volume(positions: &[Point3<f64>], triangles: &[[u32; 3]]) -> f64 {
    // Measured from a point of the mesh, so that nothing is lost far from the origin.
    let Some(origin) = positions.first() else { return 0.0 };
    let mut sixfold = 0.0;
    for triangle in triangles {
        let [a, b, c] = triangle.map(|n| positions[n as usize] - origin);
        sixfold += a.cross(&b).dot(&c);
    }
    sixfold / 6.0
}

/// Pairs of triangles that share no corner and run through each other. Triangles that only
/// touch, or that overlap in one plane, are not counted.
///
/// # Errors
/// When it is cancelled.
pub fn self_intersections(
    positions: &[Point3<f64>],
    triangles: &[[u32; 3]],
    cancel: &dyn Cancel,
) -> Result<usize, Cancelled> {
    let corners: Vec<Corners> = triangles.iter().map(|t| t.map(|n| positions[n as usize])).collect();
    let tree = BoxTree::new(&corners, cancel)?;
    let mut count = 0;
    for (a, own) in corners.iter().enumerate() {
        cancel.check()?;
        for b in tree.overlapping(&Bounds::of(own)) {
            let is_met = b > a && are_apart(triangles[a], triangles[b]) && do_cross(own, &corners[b]);
            count += usize::from(is_met);
        }
    }
    Ok(count)
}

type Corners = [Point3<f64>; 3];

/// Whether two triangles share no corner.
fn are_apart(a: [u32; 3], b: [u32; 3]) -> bool {
    a.iter().all(|n| !b.contains(n))
}

/// Whether an edge of one triangle passes through the other. Two triangles in different planes
/// meet in a segment each end of which lies on such an edge.
fn do_cross(a: &Corners, b: &Corners) -> bool {
    for (from, to) in [(0, 1), (1, 2), (2, 0)] {
        if pierces(a[from], a[to], b) || pierces(b[from], b[to], a) {
            return true;
        }
    }
    false
}

/// Whether the segment from `p` to `q` has its ends strictly on both sides of a triangle's plane
/// and passes through the triangle, its border included.
fn pierces(p: Point3<f64>, q: Point3<f64>, [a, b, c]: &Corners) -> bool {
    let normal = (b - a).cross(&(c - a));
    let (above, below) = (normal.dot(&(p - a)), normal.dot(&(q - a)));
    if above * below >= 0.0 || above.is_nan() || below.is_nan() {
        return false;
    }
    let (way, [a, b, c]) = (q - p, [a - p, b - p, c - p]);
    let turns = [way.dot(&a.cross(&b)), way.dot(&b.cross(&c)), way.dot(&c.cross(&a))];
    turns.iter().all(|t| *t >= 0.0) || turns.iter().all(|t| *t <= 0.0)
}

/// A box along the axes.
#[derive(Clone, Copy, Debug)]
struct Bounds {
    low: Vector3<f64>,
    high: Vector3<f64>,
}

impl Bounds {
    fn of(corners: &Corners) -> Self {
        let [a, b, c] = corners.map(|p| p.coords);
        Self { low: a.inf(&b).inf(&c), high: a.sup(&b).sup(&c) }
    }

    fn and(self, other: Self) -> Self {
        Self { low: self.low.inf(&other.low), high: self.high.sup(&other.high) }
    }

    fn overlaps(&self, other: &Self) -> bool {
        (0..3).all(|x| self.low[x] <= other.high[x] && other.low[x] <= self.high[x])
    }
}

/// Triangles in a tree of boxes, halved along the longest side.
struct BoxTree {
    nodes: Vec<BoxNode>,
    order: Vec<u32>,
    bounds: Vec<Bounds>,
}

struct BoxNode {
    bounds: Bounds,
    /// Its triangles, a range of the order.
    start: usize,
    end: usize,
    /// Its halves; none of a leaf.
    halves: Option<[usize; 2]>,
}

impl BoxTree {
    /// Triangles of a leaf: fewer cost more boxes than tests are saved.
    const LEAF: usize = 6;

    fn new(corners: &[Corners], cancel: &dyn Cancel) -> Result<Self, Cancelled> {
        let bounds = corners.iter().map(Bounds::of).collect();
        let mut tree = Self { nodes: Vec::new(), order: (0..corners.len()).map(id).collect(), bounds };
        if !corners.is_empty() {
            tree.add(0, corners.len(), cancel)?;
        }
        Ok(tree)
    }

    /// Adds the node of a range, which must not be empty, and all below it. Halving keeps the depth below 64.
    fn add(&mut self, start: usize, end: usize, cancel: &dyn Cancel) -> Result<usize, Cancelled> {
        cancel.check()?;
        let mut bounds = self.bounds[self.order[start] as usize];
        for &triangle in &self.order[start + 1..end] {
            bounds = bounds.and(self.bounds[triangle as usize]);
        }
        let place = self.nodes.len();
        self.nodes.push(BoxNode { bounds, start, end, halves: None });
        if end - start > Self::LEAF {
            let axis = (bounds.high - bounds.low).imax();
            let middle = start.midpoint(end);
            let (order, known) = (&mut self.order[start..end], &self.bounds);
            order.select_nth_unstable_by(middle - start, |a, b| by_middle(known, axis, *a, *b));
            let halves = [self.add(start, middle, cancel)?, self.add(middle, end, cancel)?];
            self.nodes[place].halves = Some(halves);
        }
        Ok(place)
    }

    /// Triangles with a box that overlaps another.
    fn overlapping(&self, with: &Bounds) -> Vec<usize> {
        let mut found = Vec::new();
        let mut stack = vec![0];
        while let Some(place) = stack.pop() {
            let Some(node) = self.nodes.get(place).filter(|node| node.bounds.overlaps(with)) else { continue };
            if let Some(halves) = node.halves {
                stack.extend(halves);
                continue;
            }
            for &triangle in &self.order[node.start..node.end] {
                if self.bounds[triangle as usize].overlaps(with) {
                    found.push(triangle as usize);
                }
            }
        }
        found
    }
}

/// The order of two boxes by their middles along an axis, of equal ones by their numbers.
fn by_middle(bounds: &[Bounds], axis: usize, a: u32, b: u32) -> Ordering {
    let [own, other] = [a, b].map(|n| bounds[n as usize].low[axis] + bounds[n as usize].high[axis]);
    own.total_cmp(&other).then(a.cmp(&b))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cancel::Never;

    /// A tetrahedron with its corner at `at`.
    fn tetrahedron(at: [f64; 3]) -> (Vec<Point3<f64>>, Vec<[u32; 3]>) {
        let from = Vector3::from(at);
        let points = [[0.0, 0.0, 0.0], [3.0, 0.0, 0.0], [0.0, 3.0, 0.0], [0.0, 0.0, 3.0]];
        (points.map(|p| Point3::from(p) + from).to_vec(), vec![[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])
    }

    fn both(other: [f64; 3]) -> (Vec<Point3<f64>>, Vec<[u32; 3]>) {
        let (mut points, mut triangles) = tetrahedron([0.0; 3]);
        let (more, again) = tetrahedron(other);
        points.extend(more);
        triangles.extend(again.into_iter().map(|t| t.map(|n| n + 4)));
        (points, triangles)
    }

    #[test]
    fn the_volume_is_that_of_the_solid_wherever_it_lies() {
        for at in [[0.0; 3], [1e6, -2e6, 3e6]] {
            let (points, mut triangles) = tetrahedron(at);
            assert!((volume(&points, &triangles) - 4.5).abs() < 1e-9);
            triangles.iter_mut().for_each(|t| t.swap(0, 1));
            assert!((volume(&points, &triangles) + 4.5).abs() < 1e-9);
        }
        assert_eq!(volume(&[], &[]), 0.0);
    }

    #[test]
    fn solids_that_run_through_each_other_are_found_and_others_not() {
        let count = |other| {
            let (points, triangles) = both(other);
            self_intersections(&points, &triangles, &Never)
        };
        // The slanted face of the first goes through three faces of the second.
        assert_eq!(count([0.5, 0.5, 0.5]), Ok(3));
        assert_eq!(count([1.5, 1.5, 1.5]), Ok(0));
        assert_eq!(count([0.0, 0.0, 3.5]), Ok(0));
        assert_eq!(self_intersections(&[], &[], &Never), Ok(0));
    }

    #[test]
    fn the_tree_of_boxes_finds_what_all_pairs_find() {
        // Loose triangles from a fixed sequence.
        let mut state = 0x2545_F491_4F6C_DD1D_u64;
        let mut next = || {
            state ^= state << 13;
            state ^= state >> 7;
            state ^= state << 17;
            (state % 1000) as f64 / 1000.0
        };
        let mut points = Vec::new();
        for _ in 0..200 {
            let at = Vector3::new(next(), next(), next()) * 5.0;
            points.extend((0..3).map(|_| Point3::from(at + Vector3::new(next(), next(), next()))));
        }
        let triangles: Vec<[u32; 3]> = (0..200).map(|t| [3 * t, 3 * t + 1, 3 * t + 2]).collect();
        let corners: Vec<Corners> = triangles.iter().map(|t| t.map(|n| points[n as usize])).collect();
        let mut pairs = 0;
        for a in 0..200 {
            pairs += (a + 1..200).filter(|&b| do_cross(&corners[a], &corners[b])).count();
        }
        assert!(pairs > 10, "{pairs}");
        assert_eq!(self_intersections(&points, &triangles, &Never), Ok(pairs));
    }
}
