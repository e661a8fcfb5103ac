//! A region as a square whose lines are evenly spaced: what its lattices of all sizes are laid from.
//!
//! 1. The region is made the image of a square (`patch`), in which nodes slide along rows and columns in turn until they
//!    are equally spaced along both (`slide`): harmonic shares crowd in hollows and thin out in tips, and a margin is to be
//!    a share of the length of each line;
//! 2. a lattice is laid over that, less its margin, and slid in turn;
//! 3. its corners are opened.

mod arc;

mod corners;

mod harmonic;

mod patch;

mod slide;

mod round;

use nalgebra::{Point2, Point3};

pub use self::corners::Ends;
use self::patch::Patch;
pub use self::round::{LEAST_ROUND, Strip};
use self::slide::{equal_shares, evenly_spaced};
use crate::cancel::{Cancel, Cancelled};
use crate::model::{LatticeSize, Links, ring};
use crate::numerics::stats::percentile;
use crate::params::LatticeKind;
use crate::pipeline::plane::region::Region;
use crate::pipeline::plane::tangents::nearest_turn;

/// Size of the lattice that spaces the patch. With fewer nodes it cuts off bends; with more it takes longer to slide.
const EVEN: LatticeSize = LatticeSize { rows: 25, cols: 49 };

/// Nodes of a lattice in the plane, row-major.
#[derive(Clone, Debug)]
pub struct Lattice {
    /// Its size.
    pub size: LatticeSize,
    /// Plane coordinates, voxels.
    pub nodes: Vec<Point2<f64>>,
    /// Whether the node lies inside the outline.
    pub valid: Vec<bool>,
    /// For every node of the edge, in the order of [`ring`], the place on the sheet's rim that it
    /// looks out to: along the lines of the lattice for a fitted one, its own for a regular one.
    pub rim: Vec<Point2<f64>>,
    /// Length after which the first coordinate begins again, of a ring: its last column is the first.
    pub period: Option<f64>,
}

impl Lattice {
    /// Which nodes are neighbours.
    #[must_use]
    pub fn links(&self) -> Links {
        Links { size: self.size, is_ring: self.period.is_some() }
    }

    /// Where a node lies, seen from another: of a ring on the same turn.
    #[must_use]
    pub fn seen_from(&self, other: usize, node: usize) -> Point2<f64> {
        nearest_turn(self.nodes[node], self.nodes[other], self.period)
    }
}

/// A region with the lines that its lattices follow.
#[derive(Clone, Debug)]
pub struct Chart {
    region: Region,
    lines: Lines,
}

#[derive(Clone, Debug)]
enum Lines {
    /// Those of a patch that follows the outline: up to the inset, and up to the outline.
    Fitted { inner: Patch, outer: Patch, ends: Ends },
    /// Those of a ring, which begin again, and their mean lengths in space, round and across.
    Round { patch: Patch, period: f64, extents: [f64; 2] },
    /// Those of the rectangle round it, from its lowest to its highest corner.
    Regular([Point2<f64>; 2]),
}

impl Chart {
    /// The chart of a region, or `None` when it is empty. `inset`: harmonic share left free at the rim of a fitted one.
    ///
    /// # Errors
    /// When it is cancelled.
    pub fn of(
        region: &Region,
        kind: LatticeKind,
        (ends, inset): (Ends, f64),
        cancel: &dyn Cancel,
    ) -> Result<Option<Self>, Cancelled> {
        let lines = match kind {
            LatticeKind::Regular => region.bounds().map(Lines::Regular),
            LatticeKind::Fitted => fitted(region, ends, inset, cancel)?,
        };
        Ok(lines.map(|lines| Self { region: region.clone(), lines }))
    }

    /// The same with nodes spaced evenly in space, not in the plane; `position` tells where places of the plane lie there.
    #[must_use]
    pub(crate) fn spaced_in_space(self, position: impl Fn(Point2<f64>) -> Point3<f64>) -> Self {
        let Self { region, lines } = self;
        let lines = match lines {
            Lines::Fitted { inner, outer, ends } => {
                Lines::Fitted { inner: inner.measured_in_space(position), outer, ends }
            }
            others @ (Lines::Regular(_) | Lines::Round { .. }) => others,
        };
        Self { region, lines }
    }

    /// The region.
    #[must_use]
    pub fn region(&self) -> &Region {
        &self.region
    }

    /// The lengths of its lines on the whole, the longer first; of a ring round it and across.
    #[must_use]
    pub fn extents(&self) -> [f64; 2] {
        if let Lines::Round { extents, .. } = &self.lines { *extents } else { self.region.rectangle() }
    }

    /// A lattice of a size. `margin`: share of each line left free at its ends.
    ///
    /// # Errors
    /// When it is cancelled.
    pub fn lattice(&self, size: LatticeSize, margin: f64, cancel: &dyn Cancel) -> Result<Lattice, Cancelled> {
        match &self.lines {
            Lines::Regular(bounds) => {
                let nodes = regular(*bounds, size, margin);
                let rim = ring(size).into_iter().map(|n| nodes[n]).collect();
                Ok(self.checked(size, nodes, rim))
            }
            Lines::Fitted { inner, outer, ends } => {
                let mut shares = evenly_spaced(inner, size, [margin; 2], cancel)?;
                let mut nodes = inner.places(&shares);
                if *ends == Ends::OfTails {
                    open_corners(size, &mut nodes);
                }
                push_to_rim(size, &mut shares);
                let rim = ring(size).into_iter().map(|n| outer.at(shares[n])).collect();
                Ok(self.checked(size, nodes, rim))
            }
            Lines::Round { patch, period, .. } => round::lattice(patch, *period, (size, margin), cancel),
        }
    }

    /// A lattice that shows the surfaces with their bends, up to the rim: that of the lines themselves.
    ///
    /// # Errors
    /// When it is cancelled.
    pub(crate) fn fine(&self, cancel: &dyn Cancel) -> Result<Lattice, Cancelled> {
        match &self.lines {
            Lines::Regular(_) => self.lattice(EVEN, 0.0, cancel),
            Lines::Fitted { inner, .. } => {
                let nodes = inner.places(&equal_shares(EVEN, [0.0; 2]));
                let rim = ring(EVEN).into_iter().map(|n| nodes[n]).collect();
                Ok(self.checked(EVEN, nodes, rim))
            }
            Lines::Round { patch, period, .. } => Ok(round::fine(patch, *period)),
        }
    }

    /// Sine below which a quarter of the angles lie at which its lines cross: 1 is a grid of squares. Lines that must run
    /// round a bend of the region, into an arm or a notch, cross at small angles all the way.
    #[must_use]
    pub(crate) fn squareness(&self) -> f64 {
        match &self.lines {
            Lines::Regular(_) | Lines::Round { .. } => 1.0,
            Lines::Fitted { inner, .. } => {
                let mut sines = sines(EVEN, &inner.places(&equal_shares(EVEN, [0.0; 2])));
                sines.sort_by(f64::total_cmp);
                percentile(&sines, 25).unwrap_or(1.0)
            }
        }
    }

    /// A lattice that says of its nodes whether they lie inside.
    fn checked(&self, size: LatticeSize, nodes: Vec<Point2<f64>>, rim: Vec<Point2<f64>>) -> Lattice {
        let valid = nodes.iter().map(|n| self.region.contains(*n)).collect();
        Lattice { size, nodes, valid, rim, period: None }
    }
}

/// Lines that follow the outline, evenly spaced.
fn fitted(region: &Region, ends: Ends, inset: f64, cancel: &dyn Cancel) -> Result<Option<Lines>, Cancelled> {
    let Some(patch) = Patch::of(region, ends, cancel)? else { return Ok(None) };
    let mut even = evenly_spaced(&patch, EVEN, [inset; 2], cancel)?;
    let inner = Patch::of_nodes(EVEN.rows, EVEN.cols, &patch.places(&even));
    push_to_rim(EVEN, &mut even);
    let outer = Patch::of_nodes(EVEN.rows, EVEN.cols, &patch.places(&even));
    Ok(Some(Lines::Fitted { inner, outer, ends }))
}

/// Sines of the angles at the corners of all cells of a lattice, negative where a cell is turned over there.
fn sines(LatticeSize { rows, cols }: LatticeSize, nodes: &[Point2<f64>]) -> Vec<f64> {
    let mut sines = Vec::with_capacity(4 * rows * cols);
    for i in 0..rows - 1 {
        for j in 0..cols - 1 {
            let n = i * cols + j;
            let cell = [nodes[n], nodes[n + 1], nodes[n + 1 + cols], nodes[n + cols]];
            for k in 0..4 {
                let [on, back] = [cell[(k + 1) % 4] - cell[k], cell[(k + 3) % 4] - cell[k]];
                sines.push(on.perp(&back) / (on.norm() * back.norm()).max(f64::MIN_POSITIVE));
            }
        }
    }
    sines
}

/// The paper's rectangle: the bounding box of the region less the margin.
fn regular([low, high]: [Point2<f64>; 2], size: LatticeSize, margin: f64) -> Vec<Point2<f64>> {
    let shares = equal_shares(size, [margin; 2]);
    shares.iter().map(|s| low + (high - low).component_mul(&s.coords)).collect()
}

/// Draws the nodes beside each corner inward until the edges that meet there make an angle: on a round outline they are
/// nearly in line, and a cell without an angle is turned over by anything.
fn open_corners(LatticeSize { rows, cols }: LatticeSize, nodes: &mut [Point2<f64>]) {
    /// Sine of what the angle lacks to a half turn at the least: 10°. With 5° corners of muscles and of a caudate are
    /// turned over; each degree more takes the edge a sixtieth of a step off the rim.
    const LEAST_TURN: f64 = 0.17;
    let last = rows * cols - 1;
    for (corner, along, across) in [
        (0, 1, cols),
        (cols - 1, cols - 2, 2 * cols - 1),
        (last, last - 1, last - cols),
        (last + 1 - cols, last + 2 - cols, last + 1 - 2 * cols),
    ] {
        let inner = along + across - corner;
        let inward = (nodes[inner] - nodes[corner]).try_normalize(1e-9).unwrap_or_default();
        let [a, b] = [nodes[along] - nodes[corner], nodes[across] - nodes[corner]];
        // The angle that each of the two makes with the line across the way inward.
        let turn = [a.dot(&inward) / a.norm().max(1e-9), b.dot(&inward) / b.norm().max(1e-9)];
        let missing = (LEAST_TURN - turn[0] - turn[1]).max(0.0) / 2.0;
        nodes[along] += inward * (missing * a.norm());
        nodes[across] += inward * (missing * b.norm());
    }
}

/// Moves the shares of the nodes of the edge to the rim that they look out to.
fn push_to_rim(size: LatticeSize, shares: &mut [Point2<f64>]) {
    let LatticeSize { rows, cols } = size;
    for (n, share) in shares.iter_mut().enumerate() {
        share.x = outward(n % cols, cols, share.x);
        share.y = outward(n / cols, rows, share.y);
    }
}

/// The share of the k-th node of a line: that of the rim at its ends.
fn outward(k: usize, count: usize, share: f64) -> f64 {
    match k {
        0 => 0.0,
        k if k + 1 == count => 1.0,
        _ => share,
    }
}
