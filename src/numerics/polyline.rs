//! Lines of straight pieces, measured by their length.

use nalgebra::{SVector, Vector3};

use super::field::floor_index;

/// Points joined by straight pieces, and the length up to each.
#[derive(Clone, Debug)]
pub struct Polyline<const D: usize> {
    points: Vec<SVector<f64, D>>,
    /// Length from the first point on; one per point.
    reached: Vec<f64>,
}

impl<const D: usize> Polyline<D> {
    /// From one point to the next. There must be two at the least.
    #[must_use]
    pub fn open(points: Vec<SVector<f64, D>>) -> Self {
        Self::measured(points, |from, to| (to - from).norm())
    }

    /// The same, and from the last point back to the first.
    #[must_use]
    pub fn closed(mut points: Vec<SVector<f64, D>>) -> Self {
        points.extend(points.first().copied());
        Self::open(points)
    }

    /// With another length of the pieces.
    #[must_use]
    pub fn measured(points: Vec<SVector<f64, D>>, length: impl Fn(SVector<f64, D>, SVector<f64, D>) -> f64) -> Self {
        let mut reached = vec![0.0];
        for pair in points.windows(2) {
            reached.push(reached[reached.len() - 1] + length(pair[0], pair[1]));
        }
        Self { points, reached }
    }

    /// The points; of a closed line the first comes again at the end.
    #[must_use]
    pub fn points(&self) -> &[SVector<f64, D>] {
        &self.points
    }

    /// Length of the whole.
    #[must_use]
    pub fn length(&self) -> f64 {
        self.reached[self.reached.len() - 1]
    }

    /// Length up to a point.
    #[must_use]
    pub fn reached(&self, point: usize) -> f64 {
        self.reached[point]
    }

    /// Length at a share of the piece that begins at a point.
    #[must_use]
    pub fn length_at(&self, (piece, share): (usize, f64)) -> f64 {
        self.reached[piece] + (self.reached[piece + 1] - self.reached[piece]) * share
    }

    /// The piece at a length, and the share of it.
    #[must_use]
    pub fn place(&self, length: f64) -> (usize, f64) {
        let piece = self.reached.partition_point(|l| *l <= length).clamp(1, self.reached.len() - 1) - 1;
        (piece, (length - self.reached[piece]) / self.piece_length(piece))
    }

    /// The point at a share of a piece.
    #[must_use]
    pub fn point(&self, (piece, share): (usize, f64)) -> SVector<f64, D> {
        self.points[piece] + (self.points[piece + 1] - self.points[piece]) * share
    }

    /// `count` points at equal lengths, `steps` of which make the whole: one less than `count` to have both ends, `count`
    /// for a closed line, whose ends are one.
    #[must_use]
    pub fn evenly(&self, count: usize, steps: usize) -> Vec<SVector<f64, D>> {
        let mut points = Vec::with_capacity(count);
        let mut piece = 0;
        for n in 0..count {
            let wanted = self.length() * n as f64 / steps as f64;
            while piece + 2 < self.points.len() && self.reached[piece + 1] < wanted {
                piece += 1;
            }
            let share = (wanted - self.reached[piece]) / self.piece_length(piece);
            points.push(self.point((piece, share.clamp(0.0, 1.0))));
        }
        points
    }

    /// `count` points at equal lengths around a closed line. Shares are of the pieces' own lengths, not of the difference of
    /// the lengths up to their ends, which far along the line have fewer digits.
    #[must_use]
    pub fn evenly_around(&self, count: usize) -> Vec<SVector<f64, D>> {
        let mut points = Vec::with_capacity(count);
        let mut piece = 0;
        for n in 0..count {
            let wanted = n as f64 * self.length() / count as f64;
            while piece + 2 < self.points.len() && self.reached[piece + 1] < wanted {
                piece += 1;
            }
            let own = (self.points[piece + 1] - self.points[piece]).norm().max(1e-12);
            points.push(self.point((piece, (wanted - self.reached[piece]) / own)));
        }
        points
    }

    /// Pieces between two points in one place have a length, so that shares of them are numbers.
    fn piece_length(&self, piece: usize) -> f64 {
        (self.reached[piece + 1] - self.reached[piece]).max(1e-12)
    }
}

/// The fewest nodes on some lines, from `least` on and up to `most`, `step` more at a time, between which chords follow them: of
/// each group of lines the share `within` of the points lies no further than the tolerance from them. A line has as many from
/// one end to the other, both counted.
#[must_use]
pub fn fewest_nodes<const D: usize>(
    groups: &[&[&Polyline<D>]],
    [least, most, step]: [usize; 3],
    (tolerance, within): (f64, f64),
) -> usize {
    let mut nodes = least;
    while nodes < most && groups.iter().any(|lines| share_within(lines, nodes, tolerance) < within) {
        nodes += step;
    }
    nodes
}

/// Length of the longest of some lines.
#[must_use]
pub fn longest<const D: usize>(lines: &[Polyline<D>]) -> f64 {
    lines.iter().map(Polyline::length).fold(0.0, f64::max)
}

/// Vector area of a closed curve, whose first point comes again at the end.
#[must_use]
pub fn vector_area(curve: &[Vector3<f64>]) -> Vector3<f64> {
    let mut doubled = Vector3::zeros();
    let Some(first) = curve.first() else { return doubled };
    for pair in curve.windows(2) {
        doubled += (pair[0] - first).cross(&(pair[1] - first));
    }
    doubled / 2.0
}

/// Share of the points of some lines that lie near the chords between so many nodes, equally far apart from one end of each
/// to the other.
fn share_within<const D: usize>(lines: &[&Polyline<D>], nodes: usize, tolerance: f64) -> f64 {
    let (mut near, mut all) = (0usize, 0usize);
    for line in lines {
        let knots = line.evenly(nodes, nodes - 1);
        for (n, p) in line.points().iter().enumerate() {
            let share = line.reached(n) / line.length().max(f64::MIN_POSITIVE);
            let chord = floor_index(share * (nodes - 1) as f64).min(nodes - 2);
            all += 1;
            near += usize::from(from_line(*p, knots[chord], knots[chord + 1]) <= tolerance);
        }
    }
    near as f64 / all.max(1) as f64
}

/// Distance of a point from the line through two others, from the first where they are one.
fn from_line<const D: usize>(p: SVector<f64, D>, a: SVector<f64, D>, b: SVector<f64, D>) -> f64 {
    let along = (b - a).try_normalize(1e-12).unwrap_or_else(SVector::zeros);
    (p - a - along * (p - a).dot(&along)).norm()
}

#[cfg(test)]
mod tests {
    use nalgebra::Vector2;

    use super::*;

    #[test]
    fn points_of_a_square_lie_at_equal_lengths() {
        let corners = [(0.0, 0.0), (2.0, 0.0), (2.0, 2.0), (0.0, 2.0)].map(|(x, y)| Vector2::new(x, y));
        let closed = Polyline::closed(corners.to_vec());
        assert_eq!(closed.length(), 8.0);
        assert_eq!(closed.evenly(4, 4), corners);
        assert_eq!(closed.evenly(8, 8)[7], Vector2::new(0.0, 1.0));
        assert_eq!(closed.evenly_around(8), closed.evenly(8, 8));
        let open = Polyline::open(corners.to_vec());
        assert_eq!(open.evenly(4, 3), corners);
        assert_eq!(open.place(3.0), (1, 0.5));
        assert_eq!(open.length_at((1, 0.5)), 3.0);
        assert_eq!(open.point((1, 0.5)), Vector2::new(2.0, 1.0));
    }

    #[test]
    fn chords_of_a_circle_are_as_many_as_it_takes() {
        let angle = |n: usize| n as f64 * std::f64::consts::TAU / 720.0;
        let circle: Vec<_> = (0..720).map(|n| Vector2::new(10.0 * angle(n).cos(), 10.0 * angle(n).sin())).collect();
        let circle = Polyline::closed(circle);
        // The middle of one of n chords lies 10 (1 − cos π/n) inside: 0.251 with 14, 0.219 with 15.
        let nodes = |most: usize| fewest_nodes(&[&[&circle]], [3, most, 1], (0.25, 1.0));
        assert_eq!((nodes(64), nodes(8)), (16, 8));
    }

    #[test]
    fn the_area_of_a_square_has_its_normal() {
        let square = [(0.0, 0.0), (2.0, 0.0), (2.0, 2.0), (0.0, 2.0), (0.0, 0.0)];
        let area = vector_area(&square.map(|(x, y)| Vector3::new(x, y, 5.0)));
        assert_eq!(area, Vector3::new(0.0, 0.0, 4.0));
        assert_eq!(vector_area(&[]), Vector3::zeros());
    }

    #[test]
    fn two_points_in_one_place_do_no_harm() {
        let point = Vector2::new(1.0, 2.0);
        assert_eq!(Polyline::open(vec![point, point]).evenly(3, 2), [point; 3]);
    }
}
