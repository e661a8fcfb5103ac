//! Which way is positive in the world, for one object.
//!
//! 1. Of the two senses of a direction the positive one is that of its strongest component: superior,
//!    anterior, or lateral, which counts half.
//! 2. *Lateral* is away from the plane x = 0 of the world, on the side that the object's centroid lies on.
//!    So left and right organs have frames that are mirror images of each other. An object on the plane has
//!    no lateral; there it is to the right.

use nalgebra::Point3;
use rayon::prelude::*;

use crate::cancel::{Cancel, Cancelled};
use crate::space::{Grid, WorldFromVoxel, WorldVector};

/// A component that points the other way and is at least this share of the strongest one makes a
/// sense ambiguous: two directions 5° apart could be decided differently.
const CLOSE_SECOND: f64 = 0.85;
/// Distance of the centroid from the plane x = 0, as a share of the object's extent in x, from
/// which the object lies on one side of the body.
const OFF_MIDLINE: f64 = 0.25;
/// Mean of a unit vector over the sheet below which it has no direction worth the name: a half
/// ring has 0.64, a closed ring 0.
const CURLED: f64 = 0.3;

/// Which world directions count as positive for one object.
#[derive(Clone, Copy, Debug)]
pub struct Senses {
    /// +1 when lateral is towards right, −1 when it is towards left.
    lateral: f64,
    /// The object lies on the plane x = 0, so that lateral means nothing.
    is_midline: bool,
}

/// A decided sense.
#[derive(Clone, Debug)]
pub struct Sense {
    /// +1 when the direction is positive, −1 when its opposite is.
    pub sign: f64,
    /// Why the other sense would be as good.
    pub ambiguity: Option<&'static str>,
}

impl Senses {
    /// For an object, from the side of the plane x = 0 on which its centroid lies.
    ///
    /// # Errors
    /// When it is cancelled.
    pub fn of(inside: &Grid<bool>, world_from_work: &WorldFromVoxel, cancel: &dyn Cancel) -> Result<Self, Cancelled> {
        let [nx, ny, _] = inside.dims();
        let x_of = |i: usize, j: usize, k: usize| world_from_work.point(Point3::from([i, j, k].map(|x| x as f64))).x;
        // Of a row: its voxels, the sums of their indices, and the range of x.
        let of_row = |(row, cells): (usize, &[bool])| {
            cancel.check()?;
            let [j, k] = [row % ny, row / ny];
            let taken = || (0..nx).filter(|&i| cells[i]);
            let (count, sum) = taken().fold((0, 0), |(count, sum), i| (count + 1, sum + i));
            let ends = [taken().next(), taken().next_back()].into_iter().flatten().map(|i| x_of(i, j, k));
            let range = ends.fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], x| [low.min(x), high.max(x)]);
            Ok(([count, sum, count * j, count * k], range))
        };
        let both = |(a, p): ([usize; 4], [f64; 2]), (b, q): ([usize; 4], [f64; 2])| {
            Ok(([0, 1, 2, 3].map(|n| a[n] + b[n]), [p[0].min(q[0]), p[1].max(q[1])]))
        };
        let none = || ([0; 4], [f64::INFINITY, f64::NEG_INFINITY]);
        let rows = inside.as_slice().par_chunks(nx).enumerate().with_min_len(64);
        let ([count, i, j, k], [low, high]) = rows.map(of_row).try_reduce(none, both)?;
        let mean = [i, j, k].map(|sum| sum as f64 / count.max(1) as f64);
        let centroid = world_from_work.point(Point3::from(mean)).x;
        let is_midline = count == 0 || centroid.abs() < OFF_MIDLINE * (high - low);
        Ok(Self { lateral: if is_midline || centroid > 0.0 { 1.0 } else { -1.0 }, is_midline })
    }

    /// Which sense of a direction is the positive one.
    #[must_use]
    pub fn of_direction(&self, direction: WorldVector) -> Sense {
        /// Superior and anterior are known from the world alone, lateral needs the side too: a
        /// direction must be twice as lateral as it is anything else.
        const LATERAL_WEIGHT: f64 = 0.5;
        let weighted = [direction.z, direction.y, LATERAL_WEIGHT * self.lateral * direction.x];
        let strongest = weighted.into_iter().fold(0.0f64, |best, x| if x.abs() > best.abs() { x } else { best });
        let sign = if strongest < 0.0 { -1.0 } else { 1.0 };
        let opposed = weighted.into_iter().map(|x| -sign * x).fold(0.0, f64::max);
        let ambiguity = if direction.norm() < CURLED {
            Some("curls up: it has no one direction")
        } else if opposed >= CLOSE_SECOND * strongest.abs() {
            Some("is as much towards one world direction as against another")
        } else if self.is_midline && strongest.abs() == weighted[2].abs() {
            Some("runs sideways in an object on the plane x = 0, where neither side is lateral")
        } else {
            None
        };
        Sense { sign, ambiguity }
    }
}
