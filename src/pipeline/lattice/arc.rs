//! A piece of an outline, read by the share of its length.

use nalgebra::{Point2, Vector2};

use crate::numerics::field::floor_index;

/// A piece of the outline, read by the share of its length.
#[derive(Clone, Debug)]
pub struct Arc {
    /// Points at equal lengths from one end to the other.
    table: Vec<Vector2<f64>>,
}

impl Arc {
    /// Entries of a table; a side of 500 voxels has one per voxel.
    pub const ENTRIES: usize = 513;

    /// From one place on the outline on to another; a place is an edge and a share of it.
    pub(super) fn between(outline: &[Point2<f64>], from: (usize, f64), to: (usize, f64)) -> Self {
        let count = outline.len();
        let at = |(k, t): (usize, f64)| outline[k].coords + (outline[(k + 1) % count] - outline[k]) * t;
        let mut points = vec![at(from)];
        let mut k = from.0;
        while k != to.0 && points.len() <= count {
            k = (k + 1) % count;
            points.push(outline[k].coords);
        }
        points.push(at(to));
        Self::of(&points)
    }

    fn of(points: &[Vector2<f64>]) -> Self {
        let mut reached = vec![0.0];
        for pair in points.windows(2) {
            reached.push(reached[reached.len() - 1] + (pair[1] - pair[0]).norm());
        }
        let total = reached[reached.len() - 1];
        let mut k = 1;
        let mut entry = |n: usize| {
            let wanted = total * n as f64 / (Self::ENTRIES - 1) as f64;
            while k + 1 < points.len() && reached[k] < wanted {
                k += 1;
            }
            let t = (wanted - reached[k - 1]) / (reached[k] - reached[k - 1]).max(1e-12);
            points[k - 1] + (points[k] - points[k - 1]) * t.clamp(0.0, 1.0)
        };
        Self { table: (0..Self::ENTRIES).map(&mut entry).collect() }
    }

    /// The point at a share of the length, 0 to 1.
    #[must_use]
    pub fn at(&self, share: f64) -> Vector2<f64> {
        let x = share.clamp(0.0, 1.0) * (Self::ENTRIES - 1) as f64;
        let k = floor_index(x).min(Self::ENTRIES - 2);
        self.table[k] + (self.table[k + 1] - self.table[k]) * (x - k as f64)
    }
}
