//! The nodes of a tube: centres along its line, and wall nodes round each.
//!
//! 1. Stations lie evenly between the end centres; through each passes the section where f has the value of the line;
//! 2. its wall nodes lie at equal lengths round the longest curve, from a seam that is carried along the line without a
//!    twist (Wang, Jüttler, Zheng, Liu, *Computation of rotation minimizing frames*, 2008), from the middle station, where
//!    it looks in a direction of the world, and then slid to face the nodes of the station before;
//! 3. beyond an end centre lies a cap: rays from it, along great circles from its ring to the pole.

use nalgebra::{Point3, Unit, Vector3};

use super::line::{End, Line};
use super::sections::{Section, Skin};
use crate::cancel::{Cancel, Cancelled};
use crate::model::{LatticeSize, TubeShell};
use crate::numerics::polyline::{Polyline, vector_area};
use crate::pipeline::solid::Solid;
use crate::pipeline::solid::depth::Depth;

/// How far a seam may slide to face the station before, steps between nodes, and in how many places it is tried there.
const SLIDE: f64 = 1.0;
/// See [`SLIDE`].
const SLIDES: usize = 41;
/// How deep a centre must lie, as a share of the largest depth in its section: what is allowed of sheets without a warning is
/// 0.9. With 0.99, centres waver from end to end of flat sections.
const DEEP: f64 = 0.93;
/// Shares of the way from the middle of the area to the deepest place.
const STEPS: [f64; 6] = [0.0, 0.2, 0.4, 0.6, 0.8, 1.0];
/// Height of the fan that closes an open end, radii: it reaches into the place where tubes meet, of which sections of none of
/// them speak. With 0.25, the joints of a portal vein have gaps.
const OPEN: f64 = 0.8;
/// Share of the way to the skin that it takes at the most.
const SHORT_OF_SKIN: f64 = 0.8;
/// The way over which the direction of the line is taken, median radii.
const WAY: f64 = 0.5;
/// Nodes of a cap that are left out at its pole, steps: the pole has a node of its own.
const POLE: f64 = 0.6;

/// The nodes of a tube in work space.
#[derive(Clone, Debug)]
pub struct TubeNodes {
    /// Nodes around, and along.
    pub size: LatticeSize,
    /// The centre of each column; those of a cap are its end centre.
    pub centres: Vec<Point3<f64>>,
    /// Wall nodes, row-major.
    pub wall: Vec<Point3<f64>>,
    /// The tips, beyond the first and the last column.
    pub tips: [Point3<f64>; 2],
    /// Columns of the caps.
    pub caps: [usize; 2],
    /// Length along the line of each column between them.
    pub stations: Vec<f64>,
}

impl TubeNodes {
    /// The number of a node.
    pub fn node(&self, row: usize, col: usize) -> usize {
        row % self.size.rows * self.size.cols + col
    }

    /// A wall node; rows go on from the first after the last.
    pub fn wall_at(&self, row: usize, col: usize) -> Point3<f64> {
        self.wall[self.node(row, col)]
    }

    /// Whether the last column is the first again: nodes and centre are shared, and so are the tips, which close nothing.
    pub fn is_ring(&self) -> bool {
        TubeShell::from(self).is_ring()
    }

    /// Gives the last column of a ring the nodes and the centre of the first.
    pub fn share_ends(&mut self) {
        let last = self.size.cols - 1;
        self.centres[last] = self.centres[0];
        self.tips = [self.centres[0]; 2];
        for row in 0..self.size.rows {
            let (first, last) = (self.node(row, 0), self.node(row, last));
            self.wall[last] = self.wall[first];
        }
    }

    /// The wall nodes of a column.
    pub fn ring(&self, col: usize) -> Vec<Point3<f64>> {
        (0..self.size.rows).map(|row| self.wall_at(row, col)).collect()
    }
}

/// How many columns lie in the first cap, between the end centres (those included), and in the last cap.
/// An open end has no cap.
fn shared_columns(cols: usize, ends: [f64; 2], whole: f64, is_open: [bool; 2]) -> [usize; 3] {
    let share = |length: f64| ((cols as f64 * length / whole).round()).max(2.0);
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a few columns")]
    let count = |length: f64| share(length) as usize;
    let cap = |is_open: bool, length: f64| if is_open { 0 } else { count(length) };
    let [mut first, mut last] = [cap(is_open[0], ends[0]), cap(is_open[1], whole - ends[1])];
    let least = if ends[0] < ends[1] { 2 } else { 1 };
    let most = usize::from(first > 0) + usize::from(last > 0);
    while first + last + least > cols && first + last > most {
        if first >= last { first -= 1 } else { last -= 1 }
    }
    [first, cols.saturating_sub(first + last).max(1), last]
}

/// What the nodes of a tube are laid on.
pub struct Laying<'a> {
    /// The solid.
    pub solid: &'a Solid,
    /// The depth below its skin.
    pub depth: &'a Depth,
    /// Its skin.
    pub skin: &'a Skin,
    /// Its centreline.
    pub line: &'a Line,
    /// Which branch of the solid it is.
    pub branch: usize,
    /// Where on it the end centres lie.
    pub ends: [f64; 2],
    /// The inscribed radius along its middle, the median.
    pub radius: f64,
}

impl Laying<'_> {
    /// The nodes, and how many of the sections have several curves.
    ///
    /// # Errors
    /// When it is cancelled.
    pub fn nodes(&self, size: LatticeSize, cancel: &dyn Cancel) -> Result<Option<(TubeNodes, usize)>, Cancelled> {
        let kinds = self.line.kinds_of_ends();
        let (is_open, is_joined) = (kinds.map(End::is_open), kinds[0].is_joined());
        let [first, between, last] = shared_columns(size.cols, self.ends, self.line.length(), is_open);
        let mut stations = Vec::with_capacity(between);
        for n in 0..between {
            let share = if between > 1 { n as f64 / (between - 1) as f64 } else { 0.5 };
            stations.push(self.ends[0] + (self.ends[1] - self.ends[0]) * share);
        }
        let (mut rings, mut several) = (Vec::with_capacity(between), 0);
        for &station in &stations {
            cancel.check()?;
            let section = self.skin.section(self.branch, self.line.value(station));
            several += usize::from(section.is_split());
            let Some(ring) = Ring::of(section, self.line.at(station), self.line.direction(station, WAY * self.radius))
            else {
                return Ok(None);
            };
            rings.push(ring);
        }
        self.centre(&mut rings, &stations);
        let mut starts = self.starts(&rings, size.rows);
        if is_joined {
            join(&mut rings, &mut starts, size.rows);
        }
        let columns: Vec<Vec<Point3<f64>>> =
            rings.iter().zip(&starts).map(|(ring, start)| ring.nodes(*start, size.rows)).collect();
        let centres: Vec<Point3<f64>> = rings.iter().map(|ring| ring.centre).collect();
        let head = self.cap(centres[0], &columns[0], -1.0, first);
        let tail = self.cap(centres[between - 1], &columns[between - 1], 1.0, last);
        let mut all = head.0;
        all.reverse();
        all.extend(columns);
        all.extend(tail.0);
        let centre = |col: usize| centres[col.saturating_sub(first).min(between - 1)];
        let mut nodes = TubeNodes {
            size,
            centres: (0..size.cols).map(centre).collect(),
            wall: (0..size.rows * size.cols).map(|n| all[n % size.cols][n / size.cols]).collect(),
            tips: [head.1, tail.1],
            caps: [first, last],
            stations,
        };
        if is_joined {
            let last = size.cols - 1;
            for row in 0..size.rows {
                let first = nodes.node(row, 0);
                nodes.wall[first] = nalgebra::center(&nodes.wall[first], &nodes.wall_at(row, last));
            }
            nodes.share_ends();
        }
        Ok(Some((nodes, several)))
    }

    /// Moves the centres of rings to the middles of their areas, or from there towards where they are deepest, as far as it
    /// takes to be nearly as deep.
    fn centre(&self, rings: &mut [Ring], stations: &[f64]) {
        let is_ball = rings.len() == 1;
        for (ring, station) in rings.iter_mut().zip(stations) {
            let (depth, deepest) = self.line.deepest(*station);
            if is_ball {
                ring.centre = self.deepest_of([ring.centre, ring.middle(), deepest]);
                continue;
            }
            let middle = ring.middle();
            let reached = STEPS.map(|share| middle + (deepest - middle) * share);
            let is_deep = |place: &Point3<f64>| self.depth.at(*place) >= DEEP * depth;
            ring.centre = reached.into_iter().find(is_deep).unwrap_or(ring.centre);
        }
    }

    /// The deepest of some places, the first of several. A section of a ball is a bowl, whose rim has its middle elsewhere.
    fn deepest_of(&self, places: [Point3<f64>; 3]) -> Point3<f64> {
        let mut best = places[0];
        for place in places {
            if self.depth.at(place) > self.depth.at(best) {
                best = place;
            }
        }
        best
    }

    /// Where row 0 lies on the curves of all rings, so that their nodes face each other: lengths round them.
    fn starts(&self, rings: &[Ring], rows: usize) -> Vec<f64> {
        let middle = rings.len() / 2;
        let seam = self.solid.superior_across(rings[middle].direction);
        let mut starts = vec![rings[middle].facing(seam); rings.len()];
        let forward: Vec<usize> = (middle + 1..rings.len()).collect();
        let backward: Vec<usize> = (0..middle).rev().collect();
        for way in [forward, backward] {
            let (mut before, mut seam) = (middle, seam);
            for here in way {
                seam = carried(seam, rings[before].direction, rings[here].direction);
                let beside = rings[before].nodes(starts[before], rows);
                let slide = SLIDE * rings[here].curve.length() / rows as f64;
                starts[here] = rings[here].slid((rings[here].facing(seam), slide), &beside, rings[before].centre);
                before = here;
            }
        }
        starts
    }

    /// The columns of a cap, from its ring to its pole, and the pole.
    fn cap(
        &self,
        centre: Point3<f64>,
        ring: &[Point3<f64>],
        sense: f64,
        columns: usize,
    ) -> (Vec<Vec<Point3<f64>>>, Point3<f64>) {
        let mut offsets: Vec<Vector3<f64>> = ring.iter().map(|p| p - centre).collect();
        offsets.push(offsets[0]);
        let pole = vector_area(&offsets).try_normalize(1e-12).unwrap_or_else(Vector3::z) * sense;
        let mut cap = vec![Vec::with_capacity(ring.len()); columns];
        for p in ring {
            let out = (p - centre).try_normalize(1e-12).unwrap_or_else(Vector3::x);
            let turn = out.angle(&pole);
            let side = (out - pole * out.dot(&pole)).try_normalize(1e-9).unwrap_or_else(Vector3::x);
            for (n, column) in cap.iter_mut().enumerate() {
                let left = turn * (1.0 - (n + 1) as f64 / (columns as f64 + POLE));
                column.push(at_skin(self.solid, centre, pole * left.cos() + side * left.sin()));
            }
        }
        let skin = at_skin(self.solid, centre, pole);
        (cap, if columns == 0 { self.open_tip(ring, centre, skin) } else { skin })
    }

    /// The tip of the fan that closes an open end: on the way to the skin beyond, which is another tube's.
    fn open_tip(&self, ring: &[Point3<f64>], centre: Point3<f64>, skin: Point3<f64>) -> Point3<f64> {
        let radius = ring.iter().map(|wall| (wall - centre).norm()).sum::<f64>() / ring.len().max(1) as f64;
        let most = (skin - centre).norm();
        centre + (skin - centre) * (OPEN * radius / most.max(1e-9)).min(SHORT_OF_SKIN)
    }
}

/// Where a ray from a place leaves the solid; the place itself when it lies outside.
pub fn at_skin(solid: &Solid, from: Point3<f64>, direction: Vector3<f64>) -> Point3<f64> {
    let reach: f64 = solid.inside.dims().iter().map(|count| *count as f64).sum();
    from + direction * solid.level.first_zero(from, direction, reach).unwrap_or(0.0)
}

/// A direction carried along a line without a twist: turned as the line turns.
fn carried(seam: Vector3<f64>, from: Vector3<f64>, to: Vector3<f64>) -> Vector3<f64> {
    let turned = nalgebra::UnitQuaternion::rotation_between_axis(&Unit::new_normalize(from), &Unit::new_normalize(to))
        .map_or(seam, |turn| turn * seam);
    (turned - to * turned.dot(&to)).try_normalize(1e-9).unwrap_or(seam)
}

/// A section of a tube.
struct Ring {
    centre: Point3<f64>,
    direction: Vector3<f64>,
    /// Its curve, counter-clockwise about the direction.
    curve: Polyline<3>,
}

impl Ring {
    /// The longest curve of a section round a centre; `None` without one.
    fn of(section: Section, centre: Point3<f64>, direction: Vector3<f64>) -> Option<Self> {
        let curve = section.curves.into_iter().next()?;
        let is_turned = vector_area(curve.points()).dot(&direction) < 0.0;
        let curve = if is_turned { Polyline::open(curve.points().iter().rev().copied().collect()) } else { curve };
        Some(Self { centre, direction, curve })
    }

    /// The middle of the area that the curve encloses, seen along its normal.
    fn middle(&self) -> Point3<f64> {
        let points = self.curve.points();
        let normal = vector_area(points).try_normalize(1e-12).unwrap_or(self.direction);
        let (mut sum, mut total) = (Vector3::zeros(), 0.0);
        for pair in points.windows(2) {
            let [a, b] = [pair[0] - self.centre.coords, pair[1] - self.centre.coords];
            let area = a.cross(&b).dot(&normal);
            sum += (a + b) * (area / 3.0);
            total += area;
        }
        if total > 1e-12 { self.centre + sum / total } else { self.centre }
    }

    /// Length round the curve to where it lies in a direction across the tube.
    fn facing(&self, seam: Vector3<f64>) -> f64 {
        let left = self.direction.cross(&seam);
        let mut best = (f64::NEG_INFINITY, 0.0);
        let points = self.curve.points();
        for n in 1..points.len() {
            let [a, b] = [points[n - 1] - self.centre.coords, points[n] - self.centre.coords];
            let [from, to] = [a.dot(&left), b.dot(&left)];
            // From right to left of the seam: once, on a section that is seen whole from its centre.
            if from <= 0.0 && to > 0.0 {
                let share = -from / (to - from);
                let out = (a + (b - a) * share).dot(&seam);
                if out > best.0 {
                    best = (out, self.curve.length_at((n - 1, share)));
                }
            }
        }
        best.1
    }

    /// Nodes at equal lengths from a length on.
    fn nodes(&self, start: f64, rows: usize) -> Vec<Point3<f64>> {
        let whole = self.curve.length();
        let place = |row: usize| (start + whole * row as f64 / rows as f64).rem_euclid(whole);
        (0..rows).map(|row| Point3::from(self.curve.point(self.curve.place(place(row))))).collect()
    }

    /// The length, at most `most` away from another, from which nodes lie most as those of a ring round a centre do.
    fn slid(&self, (start, most): (f64, f64), nodes: &[Point3<f64>], centre: Point3<f64>) -> f64 {
        let mut best = (f64::INFINITY, start);
        for n in 0..SLIDES {
            let tried = start + most * (2.0 * n as f64 / (SLIDES - 1) as f64 - 1.0);
            let offset =
                |(here, there): (&Point3<f64>, &Point3<f64>)| ((here - self.centre) - (there - centre)).norm_squared();
            let apart: f64 = self.nodes(tried, nodes.len()).iter().zip(nodes).map(offset).sum();
            if apart < best.0 {
                best = (apart, tried);
            }
        }
        best.1
    }
}

/// Makes the last section of a ring meet its first one: they share a centre, and what a seam that is carried round has
/// turned by then is spread over all sections.
fn join(rings: &mut [Ring], starts: &mut [f64], rows: usize) {
    let last = rings.len() - 1;
    let shared = nalgebra::center(&rings[0].centre, &rings[last].centre);
    let (first, whole) = (rings[0].nodes(starts[0], rows), rings[last].curve.length());
    // All round, and then between the places tried.
    let near = rings[last].slid((starts[last], whole / 2.0), &first, rings[0].centre);
    let turned = rings[last].slid((near, whole / SLIDES as f64), &first, rings[0].centre) - starts[last];
    let middle = rings.len() / 2;
    for (n, start) in starts.iter_mut().enumerate() {
        let share = (n as f64 - middle as f64) / last.max(1) as f64;
        *start += turned / whole * share * rings[n].curve.length();
    }
    rings[0].centre = shared;
    rings[last].centre = shared;
}
