//! The centreline of a tube: the middles of its cross-sections from tip to tip.

use nalgebra::{Point3, Vector3};

use super::cells::Cells;
use super::drain::Drain;
use crate::cancel::{Cancel, Cancelled};
use crate::numerics::field::floor_index;
use crate::numerics::graph::Graph;
use crate::numerics::polyline::Polyline;
use crate::numerics::stats::median;
use crate::pipeline::solid::Solid;
use crate::pipeline::solid::depth::Depth;

/// Longest over the next extent, root moments, below which a solid has no one long axis: the direction of a tube in it is
/// that of the world. A ball has 1; cubes, and organs like a bladder or a femoral head, up to 1.15.
const ROUND: f64 = 1.2;
/// Way from one end to the other over the largest inscribed diameter up to which a solid may be round: a cube has 1.7.
const SHORT: f64 = 1.8;
/// Thickness of a slice in which the middle is taken, cells. With 1, slices of coarse cells have holes; with 4, the middle
/// of a narrow bend lies a twentieth of its radius to the inside.
const SLICE: f64 = 1.5;
/// Slices at the least and at the most.
const SLICES: [usize; 2] = [8, 160];
/// Standard deviation of the smoothing of middles, slices.
const SMOOTH: f64 = 1.5;
/// How far ahead of a place, in multiples of its distance from the tip, an end looks for the depth of the tube. With 2, a tip
/// that is a bump of noise is taken for the whole end of a ball.
const AHEAD: usize = 3;
/// Distance of two end centres, radii, up to which they are one: that of a ball, whose depth is known to a tenth.
const ONE_CENTRE: f64 = 0.3;
/// Height of such bumps, work units.
const BUMP: f64 = 1.5;

/// The two tips, as cells: that from which columns run first.
#[derive(Clone, Copy, Debug)]
pub struct Tips {
    /// Where the tube begins and ends.
    pub cells: [usize; 2],
    /// Whether the solid has no one long axis.
    pub is_round: bool,
}

impl Tips {
    /// The cells that are farthest from each other inside, by their graph; of a round solid, its lowest and highest.
    ///
    /// # Errors
    /// When it is cancelled.
    pub fn of(cells: &Cells, graph: &Graph, solid: &Solid, cancel: &dyn Cancel) -> Result<Self, Cancelled> {
        let from_middle = graph.geodesics(cells.deepest(), cancel)?;
        let first = farthest(cells.len(), |cell| f64::from(from_middle[cell]));
        let from_first = graph.geodesics(first, cancel)?;
        let last = farthest(cells.len(), |cell| f64::from(from_first[cell]));
        let length = f64::from(from_first[last]) / (2.0 * cells.depths[cells.deepest()]).max(cells.edge);
        // A bent tube may reach as far in one direction as in another.
        let is_round = length < SHORT && elongation(cells) < ROUND;
        let mut ends = if is_round {
            // The world's z, in work space.
            let up = solid.world_from_work.matrix().fixed_view::<1, 3>(2, 0).transpose();
            let height = |cell: usize| cells.places[cell].coords.dot(&up);
            [farthest(cells.len(), |cell| -height(cell)), farthest(cells.len(), height)]
        } else {
            [first, last]
        };
        let along = solid.world_from_work.vector(cells.places[ends[1]] - cells.places[ends[0]]);
        if solid.senses.of_direction(along.normalize()).sign < 0.0 {
            ends.swap(0, 1);
        }
        Ok(Self { cells: ends, is_round })
    }
}

/// Longest over the next extent of the cells, root moments.
fn elongation(cells: &Cells) -> f64 {
    let (_, axes) = cells.axes();
    (axes.values[0] / axes.values[1].max(1e-12)).max(0.0).sqrt()
}

/// The number of the largest of some values, the first of several.
fn farthest(count: usize, value: impl Fn(usize) -> f64) -> usize {
    let mut best = 0;
    for n in 1..count {
        if value(n) > value(best) {
            best = n;
        }
    }
    best
}

/// An end of a tube.
#[derive(Clone, Copy, Debug)]
pub enum End {
    /// A tip: where it is, and the value of f there.
    Tip(Point3<f64>, f64),
    /// Open to another tube from this value of f on.
    Open(f64),
    /// Open to the other end of the same tube, where f has this value.
    Joined(f64),
}

impl End {
    fn value(self) -> f64 {
        match self {
            Self::Tip(_, value) | Self::Open(value) | Self::Joined(value) => value,
        }
    }

    /// Whether it is open.
    pub fn is_open(self) -> bool {
        matches!(self, Self::Open(_) | Self::Joined(_))
    }

    /// Whether the other end of the tube lies there too.
    pub fn is_joined(self) -> bool {
        matches!(self, Self::Joined(_))
    }
}

/// Places along a tube, by the length from its first tip: the middles of sections, and the value of f there.
pub struct Line {
    line: Polyline<3>,
    values: Vec<f64>,
    /// The largest depth in the slice of each, and where it is.
    deepest: Vec<(f64, Point3<f64>)>,
    ends: [End; 2],
}

impl Line {
    /// Of the function of a tube in some cells between two ends; `None` without cells there.
    pub fn of(cells: &Cells, members: &[usize], drain: &Drain<'_>, ends: [End; 2]) -> Option<Self> {
        let [least, largest] = ends.map(|end| if end.is_open() { Some(end.value()) } else { None });
        let is_between =
            |value: f64| least.is_none_or(|least| value >= least) && largest.is_none_or(|largest| value <= largest);
        let mut order: Vec<usize> = members.iter().copied().filter(|&cell| is_between(drain.values[cell])).collect();
        order.sort_by(|&a, &b| drain.values[a].total_cmp(&drain.values[b]));
        let whole: f64 = order.iter().map(|&cell| cells.shares[cell]).sum();
        let count = slices(cells, &order, whole)?;
        let (mut middles, mut values) = (vec![Vector3::zeros(); count], vec![0.0; count]);
        let (mut weights, mut passed, mut depths) = (vec![0.0; count], 0.0, vec![(0.0, Point3::origin()); count]);
        for &cell in &order {
            let slice = floor_index(passed / whole * count as f64).min(count - 1);
            let weight = cells.shares[cell] * cells.depths[cell].powi(2).max(1e-6);
            middles[slice] += cells.places[cell].coords * weight;
            values[slice] += drain.values[cell] * weight;
            weights[slice] += weight;
            if cells.depths[cell] > depths[slice].0 {
                depths[slice] = (cells.depths[cell], cells.places[cell]);
            }
            passed += cells.shares[cell];
        }
        for slice in 0..count {
            middles[slice] /= weights[slice].max(1e-300);
            values[slice] /= weights[slice].max(1e-300);
        }
        let is_full: Vec<bool> = weights.iter().map(|weight| *weight > 0.0).collect();
        let keep = |slice: &usize| is_full[*slice];
        let values: Vec<f64> = (0..count).filter(keep).map(|slice| values[slice]).collect();
        let middles: Vec<Vector3<f64>> = (0..count).filter(keep).map(|slice| middles[slice]).collect();
        let depths = (0..count).filter(keep).map(|slice| depths[slice]).collect();
        Self::through(&smoothed(&middles), (values, depths), ends)
    }

    /// From end to end through the middles, with values that grow; `None` through fewer than two places.
    fn through(
        middles: &[Vector3<f64>],
        (values, inner): (Vec<f64>, Vec<(f64, Point3<f64>)>),
        ends: [End; 2],
    ) -> Option<Self> {
        let (mut points, mut all, mut deepest) = (middles.to_vec(), values, inner);
        let last_middle = points.len().checked_sub(1)?;
        let between = (points[0] + points[last_middle]) / 2.0;
        for (end, place) in ends.into_iter().zip([0, last_middle]) {
            match end {
                End::Open(value) => all[place] = value,
                End::Tip(..) | End::Joined(_) => {
                    let beside = if place == 0 { deepest[0] } else { deepest[deepest.len() - 1] };
                    let (point, inner) = match end {
                        End::Tip(tip, _) => (tip.coords, (0.0, tip)),
                        _ => (between, beside),
                    };
                    let at = if place == 0 { 0 } else { points.len() };
                    points.insert(at, point);
                    all.insert(at, end.value());
                    deepest.insert(at, inner);
                }
            }
        }
        for n in 1..all.len() {
            all[n] = all[n].max(all[n - 1]);
        }
        (points.len() > 1).then(|| Self { line: Polyline::open(points), values: all, deepest, ends })
    }

    /// Length from tip to tip.
    pub fn length(&self) -> f64 {
        self.line.length()
    }

    /// The place at a length.
    pub fn at(&self, length: f64) -> Point3<f64> {
        Point3::from(self.line.point(self.clamped(length)))
    }

    /// The value of f at a length.
    pub fn value(&self, length: f64) -> f64 {
        let (piece, share) = self.clamped(length);
        self.values[piece] + (self.values[piece + 1] - self.values[piece]) * share
    }

    /// The largest depth in the section at a length, and where it is about.
    pub fn deepest(&self, length: f64) -> (f64, Point3<f64>) {
        let (piece, share) = self.clamped(length);
        let [from, to] = [self.deepest[piece], self.deepest[piece + 1]];
        let depth = from.0 + (to.0 - from.0) * share;
        (depth, if share < 0.5 { from.1 } else { to.1 })
    }

    /// Unit direction at a length, over a way on both sides.
    pub fn direction(&self, length: f64, way: f64) -> Vector3<f64> {
        let along = self.at(length + way) - self.at(length - way);
        along.try_normalize(1e-12).unwrap_or_else(Vector3::z)
    }

    fn clamped(&self, length: f64) -> (usize, f64) {
        let (piece, share) = self.line.place(length.clamp(0.0, self.length()));
        (piece, share.clamp(0.0, 1.0))
    }

    /// The inscribed radius along the middle half of it, the median.
    pub fn median_radius(&self, depth: &Depth) -> f64 {
        const PLACES: usize = 64;
        let at = |n: usize| depth.at(self.at(self.length() * (n as f64 + 0.5) / PLACES as f64));
        median((PLACES / 4..3 * PLACES / 4).map(at).collect()).unwrap_or(1.0).max(0.5)
    }

    /// Its ends.
    pub fn kinds_of_ends(&self) -> [End; 2] {
        self.ends
    }

    /// How far along the end centres lie: at an open end, and else as far from either tip as the tube is deep up to three times as far. So a ball has one
    /// centre, a tube ends one radius before its tip, and a neck is not looked past.
    pub fn ends(&self, depth: &Depth) -> [f64; 2] {
        const PLACES: usize = 400;
        let whole = self.length();
        let depths: Vec<f64> = (0..=PLACES).map(|n| depth.at(self.at(whole * n as f64 / PLACES as f64))).collect();
        let from = |is_last: bool| {
            let at = |n: usize| depths[if is_last { PLACES - n } else { n }];
            let mut deepest = 0.0f64;
            for n in 1..=PLACES / 2 {
                for ahead in AHEAD * (n - 1) + 1..=(AHEAD * n).min(PLACES) {
                    deepest = deepest.max(at(ahead));
                }
                let gone = whole * n as f64 / PLACES as f64;
                if gone >= deepest.max(BUMP) {
                    return gone;
                }
            }
            whole / 2.0
        };
        let first = if self.ends[0].is_open() { 0.0 } else { from(false) };
        let last = if self.ends[1].is_open() { whole } else { whole - from(true) };
        let ends = [first, last];
        let deepest = depths.iter().copied().fold(0.0, f64::max);
        let is_ball = !self.ends.iter().any(|end| end.is_open()) && ends[1] - ends[0] < ONE_CENTRE * deepest;
        if is_ball || ends[0] > ends[1] { [(ends[0] + ends[1]) / 2.0; 2] } else { ends }
    }
}

/// How many slices some cells, in the order of f, are taken in; `None` of none.
fn slices(cells: &Cells, order: &[usize], whole: f64) -> Option<usize> {
    let [first, last] = [order.first()?, order.last()?].map(|cell| cells.places[*cell]);
    // A solid bends: it is as long as its volume over its largest section, at the least.
    let deepest = order.iter().map(|&cell| cells.depths[cell]).fold(0.0, f64::max) / cells.edge;
    let by_volume = whole / (std::f64::consts::PI * deepest * deepest).max(1.0);
    let straight = (last - first).norm() / cells.edge;
    Some(floor_index(by_volume.max(straight) / SLICE).clamp(SLICES[0], SLICES[1]))
}

/// A line smoothed by a Gaussian over its points; its ends by those of them that there are.
fn smoothed(points: &[Vector3<f64>]) -> Vec<Vector3<f64>> {
    let reach = 4;
    let mut smooth = Vec::with_capacity(points.len());
    for n in 0..points.len() {
        // As many on both sides, so that ends are not drawn in.
        let reach = reach.min(n).min(points.len() - 1 - n);
        let (mut sum, mut total) = (Vector3::zeros(), 0.0);
        for (offset, point) in points[n - reach..=n + reach].iter().enumerate() {
            let weight = (-0.5 * ((offset as f64 - reach as f64) / SMOOTH).powi(2)).exp();
            sum += point * weight;
            total += weight;
        }
        smooth.push(sum / total);
    }
    smooth
}
