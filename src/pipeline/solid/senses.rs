//! Which way is positive in the world, for one object.
//!
//! 1. Of the two senses of a direction the positive one is that of its strongest component: superior,
//!    anterior, or lateral, which counts half.
//! 2. *Lateral* is away from the plane x = 0 of the world, on the side that the object's centroid lies on.
//!    So left and right organs have frames that are mirror images of each other. An object on the plane has
//!    no lateral; there it is to the right.

use nalgebra::Point3;

use crate::cancel::{Cancel, Cancelled};
use crate::numerics::field::centre;
use crate::numerics::parallel::each_number;
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
/// Superior and anterior are known from the world alone, lateral needs the side too: a direction must be twice as
/// lateral as it is anything else. With 1, objects near the plane x = 0 would be turned by a hair of their place.
const LATERAL_WEIGHT: f64 = 0.5;
/// Rows of voxels that one thread takes at a time; fewer are not worth handing over.
const ROWS_PER_TASK: usize = 64;

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
        let [_, ny, nz] = inside.dims();
        let of_row = |row| Extent::of_row(inside, [row % ny, row / ny], world_from_work);
        let mut whole = Extent::NOTHING;
        for extent in each_number(ny * nz, ROWS_PER_TASK, of_row, cancel)? {
            whole.add(extent);
        }
        let Extent { voxels, index_sums, low, high } = whole;
        let mean = index_sums.map(|sum| sum as f64 / voxels.max(1) as f64);
        let centroid = world_from_work.point(Point3::from(mean)).x;
        let is_midline = voxels == 0 || centroid.abs() < OFF_MIDLINE * (high - low);
        Ok(Self { lateral: if is_midline || centroid > 0.0 { 1.0 } else { -1.0 }, is_midline })
    }

    /// +1 when lateral is towards right, −1 when it is towards left.
    #[must_use]
    pub fn lateral(&self) -> f64 {
        self.lateral
    }

    /// Which sense of a direction is the positive one.
    #[must_use]
    pub fn of_direction(&self, direction: WorldVector) -> Sense {
        let weighted = [direction.z, direction.y, LATERAL_WEIGHT * self.lateral * direction.x];
        let mut strongest = 0.0f64;
        for x in weighted {
            strongest = if x.abs() > strongest.abs() { x } else { strongest };
        }
        let sign = if strongest < 0.0 { -1.0 } else { 1.0 };
        let mut opposed = 0.0f64;
        for x in weighted {
            opposed = opposed.max(-sign * x);
        }
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

/// Some voxels in a few numbers. Sums are of whole numbers: they are the same in any order.
#[derive(Clone, Copy)]
struct Extent {
    voxels: usize,
    /// Sums of the voxels' indices.
    index_sums: [usize; 3],
    /// Least and greatest x in the world.
    low: f64,
    high: f64,
}

impl Extent {
    const NOTHING: Self = Self { voxels: 0, index_sums: [0; 3], low: f64::INFINITY, high: f64::NEG_INFINITY };

    /// Of the voxels of a row that are in a set.
    fn of_row(inside: &Grid<bool>, [j, k]: [usize; 2], world_from_work: &WorldFromVoxel) -> Self {
        let start = inside.offset([0, j, k]);
        let cells = &inside.as_slice()[start..start + inside.dims()[0]];
        let mut extent = Self::NOTHING;
        let (mut first, mut last) = (None, None);
        for (i, is_in) in cells.iter().enumerate() {
            if *is_in {
                extent.voxels += 1;
                extent.index_sums[0] += i;
                first = first.or(Some(i));
                last = Some(i);
            }
        }
        extent.index_sums[1] = extent.voxels * j;
        extent.index_sums[2] = extent.voxels * k;
        for i in [first, last].into_iter().flatten() {
            let x = world_from_work.point(centre([i, j, k])).x;
            extent.low = extent.low.min(x);
            extent.high = extent.high.max(x);
        }
        extent
    }

    fn add(&mut self, other: Self) {
        self.voxels += other.voxels;
        for (sum, more) in self.index_sums.iter_mut().zip(other.index_sums) {
            *sum += more;
        }
        self.low = self.low.min(other.low);
        self.high = self.high.max(other.high);
    }
}
