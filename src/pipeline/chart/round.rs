//! The lines of a ring: rows run round its hole and begin again where they end, columns from rim to rim.

use nalgebra::{Point2, Point3};

use super::patch::Patch;
use super::slide::{equal_shares, evenly_spaced};
use super::{Chart, Lattice, Lines};
use crate::cancel::{Cancel, Cancelled};
use crate::model::{LatticeSize, ring};
use crate::numerics::field::floor_index;
use crate::pipeline::plane::region::Region;

/// Size of the lattice that spaces the patch: its rows go round, and bend most.
const EVEN: LatticeSize = LatticeSize { rows: 17, cols: 97 };

/// Columns of a ring at the least, its first one counted twice: with fewer, opposite sides of it are next to each other.
pub const LEAST_ROUND: usize = 5;

/// A strip that begins again after a length. Lengths are voxels.
#[derive(Clone, Debug)]
pub struct Strip {
    /// That length.
    pub period: f64,
    /// Second coordinates of the lower and of the upper rim at places equally far apart, from the beginning on.
    pub rims: [Vec<f64>; 2],
}

impl Strip {
    /// The place at shares of the way round and across.
    fn at(&self, shares: Point2<f64>) -> Point2<f64> {
        let [low, high] = [0, 1].map(|side| self.rim(side, shares.x));
        Point2::new(shares.x * self.period, low + (high - low) * shares.y)
    }

    /// A rim at a share of the way round.
    fn rim(&self, side: usize, share: f64) -> f64 {
        let rim = &self.rims[side];
        let at = share * rim.len() as f64;
        let (k, part) = (floor_index(at), at.fract());
        rim[k % rim.len()] * (1.0 - part) + rim[(k + 1) % rim.len()] * part
    }
}

impl Chart {
    /// The chart of a strip, whose nodes are spaced evenly in space; `position` tells where its places lie there.
    ///
    /// # Errors
    /// When it is cancelled.
    pub(crate) fn round(
        region: &Region,
        strip: &Strip,
        position: impl Fn(Point2<f64>) -> Point3<f64>,
        cancel: &dyn Cancel,
    ) -> Result<Self, Cancelled> {
        let shares = equal_shares(EVEN, [0.0; 2]);
        let places: Vec<Point2<f64>> = shares.iter().map(|share| strip.at(*share)).collect();
        let uneven = Patch::of_nodes(EVEN.rows, EVEN.cols, &places).measured_in_space(&position);
        let even = uneven.places(&evenly_spaced(&uneven, EVEN, [0.0; 2], cancel)?);
        let patch = Patch::of_nodes(EVEN.rows, EVEN.cols, &even).measured_in_space(&position);
        let extents = extents(&patch);
        Ok(Self { region: region.clone(), lines: Lines::Round { patch, period: strip.period, extents } })
    }
}

/// Mean lengths of the rows and of the columns of a patch in space.
fn extents(patch: &Patch) -> [f64; 2] {
    let shares = equal_shares(EVEN, [0.0; 2]);
    let (mut around, mut across) = (0.0, 0.0);
    for (n, share) in shares.iter().enumerate() {
        if n % EVEN.cols + 1 < EVEN.cols {
            around += patch.length([*share, shares[n + 1]].into_iter());
        }
        if n + EVEN.cols < shares.len() {
            across += patch.length([*share, shares[n + EVEN.cols]].into_iter());
        }
    }
    [around / EVEN.rows as f64, across / EVEN.cols as f64]
}

/// A lattice of a size; `margin`: share of each column left free at the rims.
pub(super) fn lattice(
    patch: &Patch,
    period: f64,
    (size, margin): (LatticeSize, f64),
    cancel: &dyn Cancel,
) -> Result<Lattice, Cancelled> {
    let size = LatticeSize { cols: size.cols.max(LEAST_ROUND), ..size };
    let mut shares = evenly_spaced(patch, size, [0.0, margin], cancel)?;
    let mut lattice = joined(size, patch.places(&shares), period);
    for (n, share) in shares.iter_mut().enumerate() {
        share.y = super::outward(n / size.cols, size.rows, share.y);
    }
    lattice.rim = ring(size).into_iter().map(|n| patch.at(shares[n])).collect();
    Ok(lattice)
}

/// The lattice of the lines themselves.
pub(super) fn fine(patch: &Patch, period: f64) -> Lattice {
    joined(EVEN, patch.places(&equal_shares(EVEN, [0.0; 2])), period)
}

/// A lattice whose last column is the first again, a period on.
fn joined(size: LatticeSize, mut nodes: Vec<Point2<f64>>, period: f64) -> Lattice {
    for row in nodes.chunks_mut(size.cols) {
        row[size.cols - 1] = Point2::new(row[0].x + period, row[0].y);
    }
    let rim = ring(size).into_iter().map(|n| nodes[n]).collect();
    Lattice { size, valid: vec![true; nodes.len()], nodes, rim, period: Some(period) }
}
