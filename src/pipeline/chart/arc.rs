//! A piece of an outline, read by the share of its length.

use nalgebra::Vector2;

use crate::numerics::field::floor_index;
use crate::numerics::polyline::Polyline;

/// A piece of the outline, read by the share of its length.
#[derive(Clone, Debug)]
pub struct Arc {
    /// Points at equal lengths from one end to the other.
    table: Vec<Vector2<f64>>,
}

impl Arc {
    /// Entries of a table; a side of 500 voxels has one per voxel. Fewer cut the bends of long sides, more only take
    /// longer to fill.
    pub const ENTRIES: usize = 513;

    /// From one place on a closed outline on to another; a place is a piece and a share of it.
    pub(super) fn between(outline: &Polyline<2>, from: (usize, f64), to: (usize, f64)) -> Self {
        let count = outline.points().len() - 1;
        let mut points = vec![outline.point(from)];
        let mut piece = from.0;
        while piece != to.0 && points.len() <= count {
            piece = (piece + 1) % count;
            points.push(outline.points()[piece]);
        }
        points.push(outline.point(to));
        Self { table: Polyline::open(points).evenly(Self::ENTRIES, Self::ENTRIES - 1) }
    }

    /// The point at a share of the length, 0 to 1.
    #[must_use]
    pub fn at(&self, share: f64) -> Vector2<f64> {
        let x = share.clamp(0.0, 1.0) * (Self::ENTRIES - 1) as f64;
        let k = floor_index(x).min(Self::ENTRIES - 2);
        self.table[k] + (self.table[k + 1] - self.table[k]) * (x - k as f64)
    }
}
