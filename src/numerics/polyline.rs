//! Lines of straight pieces, measured by their length.

use nalgebra::SVector;

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

/// Share of the points of some lines that lie near the chords between so many nodes, equally far apart from one end of each
/// to the other.
#[must_use]
pub fn share_within<const D: usize>(lines: &[&Polyline<D>], nodes: usize, tolerance: f64) -> f64 {
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
    fn two_points_in_one_place_do_no_harm() {
        let point = Vector2::new(1.0, 2.0);
        assert_eq!(Polyline::open(vec![point, point]).evenly(3, 2), [point; 3]);
    }
}
