//! Stage 6: the N × M lattice over a flattened surface, and the map from the plane back to space
//! (section 3 of the paper).
//!
//! `regular` is the paper's rectangle. `fitted` follows the outline: nodes slide along the rows and
//! columns of a patch of the region in turn until they are equally spaced along both. The map back
//! is a local quadratic fit (moving least squares), so that the staircase of the voxels does not
//! reach the mesh.

pub mod outline;

pub mod patch;

pub mod rim;

pub mod automatic;

use nalgebra::{Point2, Point3, SVector, Vector2, Vector3};

use crate::numerics::cells::Cells;
use crate::numerics::fit::{LocalFit, quadratic};

use crate::model::LatticeSize;
use crate::model::ring;
use crate::params::LatticeKind;
use crate::pipeline::lattice::outline::Region;
use crate::pipeline::lattice::patch::Patch;
use crate::pipeline::observer::{Cancelled, Observer};

/// Radius of the local fits, voxels. Below 3 the staircase shows; above 6 bends of small radius
/// are flattened.
const FIT_RADIUS: f64 = 5.0;
/// Harmonic share left free at the rim in `paper` mode. It is a small part of a voxel along a smooth rim and several
/// voxels in a narrow tip, where the three surfaces end differently: lattices that run to the end of
/// tips fold there (2 to 10 % of the corners on organs with tails, against 0 to 2.5 %). What is
/// left free belongs to the crest.
pub const RIM_INSET: f64 = 0.01;
/// How far from its nearest point a fit may be read, voxels. The rim of a sheet lies up to one
/// voxel beyond its outermost points.
const OVERREACH: f64 = 2.0;
/// Radius of the fit of the slope of the values, in values: the radius of a medial sheet changes over
/// lengths of the radius itself, and what changes faster is the staircase.
const SLOPE_RADII: f64 = 1.5;
/// The same at most, voxels.
const MAX_SLOPE_RADIUS: f64 = 12.0;
/// Radius of a fit in a hole, in radii of the hole: points all around must count.
const HOLE_RADII: f64 = 2.0;
/// Rounds of sliding at most; 20 bring the spacing below 1 % of its mean on ellipses.
const SLIDE_ROUNDS: usize = 30;
/// Largest movement, as a share of the lattice, at which sliding ends.
const SLIDE_TOLERANCE: f64 = 5e-4;
/// Pieces in which the length of an edge is measured.
const EDGE_PIECES: usize = 3;

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
}

/// A lattice over the region, or `None` when the region is empty. `margin`: share of each line left free
/// at its ends; `inset`: harmonic share left free before that, for a fitted one.
///
/// # Errors
/// When the observer asks to stop.
pub fn lattice(
    region: &Region,
    kind: LatticeKind,
    size: LatticeSize,
    margin: f64,
    inset: f64,
    observer: &dyn Observer,
) -> Result<Option<Lattice>, Cancelled> {
    let (nodes, rim) = match kind {
        LatticeKind::Fitted => {
            let Some(patch) = region.patch(observer)? else { return Ok(None) };
            fitted(&patch, size, margin, inset, observer)?
        }
        LatticeKind::Regular => {
            let Some(bounds) = region.bounds() else { return Ok(None) };
            let nodes = regular(bounds, size, margin);
            let rim = ring(size).into_iter().map(|n| nodes[n]).collect();
            (nodes, rim)
        }
    };
    let valid = nodes.iter().map(|n| region.contains(*n)).collect();
    Ok(Some(Lattice { size, nodes, valid, rim }))
}

/// The paper's rectangle: the bounding box of the region less the margin.
fn regular([low, high]: [Point2<f64>; 2], size: LatticeSize, margin: f64) -> Vec<Point2<f64>> {
    let node = |i: usize, j: usize| {
        let shares = Vector2::new(share(j, size.cols, margin), share(i, size.rows, margin));
        low + (high - low).component_mul(&shares)
    };
    (0..size.rows * size.cols).map(|n| node(n / size.cols, n % size.cols)).collect()
}

/// Position of the k-th of `count` equally spaced values between `margin` and `1 − margin`.
fn share(k: usize, count: usize, margin: f64) -> f64 {
    margin + (1.0 - 2.0 * margin) * k as f64 / (count - 1) as f64
}

/// Places of the nodes, and of the rim before those of the edge.
type NodesAndRim = (Vec<Point2<f64>>, Vec<Point2<f64>>);

/// Nodes that follow the outline, equally spaced along rows and columns, and the rim before those
/// of the edge.
///
/// Harmonic shares crowd in hollows and thin out in tips. The patch is spaced evenly first, so that
/// the margin is a share of the length of each line.
fn fitted(
    patch: &Patch,
    size: LatticeSize,
    margin: f64,
    inset: f64,
    observer: &dyn Observer,
) -> Result<NodesAndRim, Cancelled> {
    /// Size of the lattice that spaces the patch.
    const EVEN: LatticeSize = LatticeSize { rows: 25, cols: 49 };
    let even = evenly_spaced(patch, EVEN, inset, observer)?;
    let places = |shares: &[Point2<f64>]| -> Vec<Point2<f64>> { shares.iter().map(|s| patch.at(*s)).collect() };
    let inner = Patch::of_nodes(EVEN.rows, EVEN.cols, &places(&even));
    let pushed: Vec<Point2<f64>> = even.iter().enumerate().map(|(n, s)| to_rim(EVEN, n, *s)).collect();
    let outer = Patch::of_nodes(EVEN.rows, EVEN.cols, &places(&pushed));
    let shares = evenly_spaced(&inner, size, margin, observer)?;
    let nodes = shares.iter().map(|s| inner.at(*s)).collect();
    let rim = ring(size).into_iter().map(|n| outer.at(to_rim(size, n, shares[n]))).collect();
    Ok((nodes, rim))
}

/// The share on the rim that a node of the edge looks out to; inner nodes stay.
fn to_rim(size: LatticeSize, node: usize, shares: Point2<f64>) -> Point2<f64> {
    let outward = |k: usize, count: usize, share: f64| match k {
        0 => 0.0,
        k if k + 1 == count => 1.0,
        _ => share,
    };
    Point2::new(outward(node % size.cols, size.cols, shares.x), outward(node / size.cols, size.rows, shares.y))
}

/// Shares of nodes that were equal at first, then slid along rows and columns in turn.
fn evenly_spaced(
    patch: &Patch,
    size: LatticeSize,
    margin: f64,
    observer: &dyn Observer,
) -> Result<Vec<Point2<f64>>, Cancelled> {
    let LatticeSize { rows, cols } = size;
    let at = |s: Point2<f64>| patch.at(s);
    let mut shares: Vec<Point2<f64>> =
        (0..rows * cols).map(|n| Point2::new(share(n % cols, cols, margin), share(n / cols, rows, margin))).collect();
    let first = shares.clone();
    for _ in 0..SLIDE_ROUNDS {
        let mut moved = 0.0f64;
        for i in 0..rows {
            observer.check()?;
            moved = moved.max(slide(&mut shares, &at, |k| i * cols + k, cols));
        }
        for j in 0..cols {
            observer.check()?;
            moved = moved.max(slide(&mut shares, &at, |k| k * cols + j, rows));
        }
        if moved < SLIDE_TOLERANCE {
            break;
        }
    }
    upright(patch, size, &first, shares, observer)
}

/// Takes back as much of the sliding as it takes for rows and columns to cross: where a region narrows
/// or turns, lines that are spaced evenly lean over until they run together.
fn upright(
    patch: &Patch,
    size: LatticeSize,
    first: &[Point2<f64>],
    slid: Vec<Point2<f64>>,
    observer: &dyn Observer,
) -> Result<Vec<Point2<f64>>, Cancelled> {
    /// Sine of the angle at which lines cross at the least, if they did before.
    const LEAST_SINE: f64 = 0.35;
    /// What is kept of the sliding from one try to the next.
    const KEPT: f64 = 0.75;
    /// Tries; a hundredth of the sliding is left after them.
    const TRIES: usize = 16;
    let wanted = LEAST_SINE.min(0.9 * least_sine(patch, size, first));
    let (mut shares, mut kept) = (slid.clone(), 1.0);
    for _ in 0..TRIES {
        observer.check()?;
        if least_sine(patch, size, &shares) >= wanted {
            return Ok(shares);
        }
        kept *= KEPT;
        shares = first.iter().zip(&slid).map(|(a, b)| a + (b - a) * kept).collect();
    }
    Ok(first.to_vec())
}

/// The smallest sine between the two directions of a lattice at the corners of its quads, negative where
/// one is turned over. The corners of the lattice are left out: on a smooth outline they are flat.
fn least_sine(patch: &Patch, size: LatticeSize, shares: &[Point2<f64>]) -> f64 {
    let LatticeSize { rows, cols } = size;
    let nodes: Vec<Point2<f64>> = shares.iter().map(|s| patch.at(*s)).collect();
    let is_corner = |n: usize| [0, cols - 1, (rows - 1) * cols, rows * cols - 1].contains(&n);
    let mut least = 1.0f64;
    for (i, j) in (0..rows - 1).flat_map(|i| (0..cols - 1).map(move |j| (i, j))) {
        let quad = [(0, 0), (0, 1), (1, 0), (1, 1)].map(|(a, b)| (i + a) * cols + j + b);
        for k in (0..4).filter(|&k| !is_corner(quad[k])) {
            let along = nodes[quad[(k & 2) | 1]] - nodes[quad[k & 2]];
            let across = nodes[quad[2 | (k & 1)]] - nodes[quad[k & 1]];
            least = least.min(along.perp(&across) / (along.norm() * across.norm()).max(1e-12));
        }
    }
    least
}

/// Spaces the nodes of one lattice line equally along it; the ends stay. Returns the largest
/// movement.
fn slide(
    shares: &mut [Point2<f64>],
    at: &impl Fn(Point2<f64>) -> Point2<f64>,
    line: impl Fn(usize) -> usize,
    count: usize,
) -> f64 {
    let old: Vec<Point2<f64>> = (0..count).map(|k| shares[line(k)]).collect();
    let mut reached = vec![0.0];
    for pair in old.windows(2) {
        let piece = |k: usize| at(pair[0] + (pair[1] - pair[0]) * (k as f64 / EDGE_PIECES as f64));
        let length: f64 = (0..EDGE_PIECES).map(|k| (piece(k + 1) - piece(k)).norm()).sum();
        reached.push(reached[reached.len() - 1] + length);
    }
    let total = reached[count - 1];
    let (mut moved, mut edge) = (0.0f64, 0);
    for k in 1..count - 1 {
        let wanted = total * k as f64 / (count - 1) as f64;
        while edge + 2 < count && reached[edge + 1] < wanted {
            edge += 1;
        }
        let length = (reached[edge + 1] - reached[edge]).max(1e-12);
        let new = old[edge] + (old[edge + 1] - old[edge]) * ((wanted - reached[edge]) / length).clamp(0.0, 1.0);
        moved = moved.max((new - old[k]).norm());
        shares[line(k)] = new;
    }
    moved
}

/// The map from the plane back to space: position and one more value of every point.
pub struct SpaceFromPlane<'a> {
    flat: &'a [Point2<f64>],
    positions: &'a [Point3<f64>],
    values: &'a [f64],
    cells: Cells,
    overreach: f64,
}

/// A node brought back to space.
#[derive(Clone, Copy, Debug)]
pub struct Node {
    /// Position, voxels of work space.
    pub position: Point3<f64>,
    /// Derivative of the position along u and v.
    pub tangents: [Vector3<f64>; 2],
    /// The value carried along.
    pub value: f64,
    /// Derivative of the value along u and v.
    pub slopes: [f64; 2],
}

impl<'a> SpaceFromPlane<'a> {
    /// From the points' plane coordinates, positions and a value each (may be empty: then 0).
    #[must_use]
    pub fn new(flat: &'a [Point2<f64>], positions: &'a [Point3<f64>], values: &'a [f64]) -> Self {
        Self { flat, positions, values, cells: Cells::new(flat, FIT_RADIUS), overreach: OVERREACH }
    }

    /// The map of points that reach up to the rim: a place far from all of them lies in a hole, and is
    /// read from what is around it.
    #[must_use]
    pub fn over_holes(self) -> Self {
        Self { overreach: f64::INFINITY, ..self }
    }

    /// The point of space at `p`. Fits are read no further than [`OVERREACH`] from the points they
    /// were made of: beyond, they say nothing, and the nearest point stands for the place.
    #[must_use]
    pub fn node(&self, p: Point2<f64>) -> Node {
        let (nearest, gap) = self.nearest(p);
        let (at, gap) = if gap <= self.overreach { (p, gap) } else { (self.flat[nearest], 0.0) };
        let mut radius = FIT_RADIUS.max(HOLE_RADII * gap);
        // Twice doubled, a radius reaches 20 voxels: with fewer than six points there, there is no sheet.
        for _ in 0..3 {
            if let Some(fit) = self.fit(at, radius) {
                let mut node = as_node(&fit);
                let wide = (SLOPE_RADII * node.value).min(MAX_SLOPE_RADIUS);
                if wide > radius
                    && let Some(fit) = self.fit(at, wide)
                {
                    node.slopes = [fit.du[3], fit.dv[3]];
                }
                return node;
            }
            radius *= 2.0;
        }
        self.bare(nearest)
    }

    /// [`Self::node`] of some places.
    ///
    /// # Errors
    /// When the observer asks to stop.
    pub fn nodes(&self, places: &[Point2<f64>], observer: &dyn Observer) -> Result<Vec<Node>, Cancelled> {
        places.iter().map(|p| observer.check().map(|()| self.node(*p))).collect()
    }

    /// The point nearest to `p`, and how far it is.
    #[must_use]
    pub fn nearest(&self, p: Point2<f64>) -> (usize, f64) {
        let distance = |k: usize| (self.flat[k] - p).norm();
        let closest =
            |points: &mut dyn Iterator<Item = usize>| points.min_by(|&a, &b| distance(a).total_cmp(&distance(b)));
        let near = closest(&mut self.cells.around(p, FIT_RADIUS)).filter(|&k| distance(k) <= FIT_RADIUS);
        let k = near.or_else(|| closest(&mut (0..self.flat.len()))).unwrap_or(0);
        (k, distance(k))
    }

    fn fit(&self, p: Point2<f64>, radius: f64) -> Option<LocalFit<4>> {
        let sample = |k: usize| {
            let x = self.positions[k];
            let value = self.values.get(k).copied().unwrap_or(0.0);
            (self.flat[k], SVector::<f64, 4>::new(x.x, x.y, x.z, value))
        };
        quadratic(p, radius, self.cells.around(p, radius).map(sample))
    }

    fn bare(&self, k: usize) -> Node {
        let value = self.values.get(k).copied().unwrap_or(0.0);
        Node { position: self.positions[k], tangents: [Vector3::x(), Vector3::y()], value, slopes: [0.0; 2] }
    }
}

fn as_node(fit: &LocalFit<4>) -> Node {
    let part = |v: &SVector<f64, 4>| Vector3::new(v[0], v[1], v[2]);
    Node {
        position: Point3::from(part(&fit.value)),
        tangents: [part(&fit.du), part(&fit.dv)],
        value: fit.value[3],
        slopes: [fit.du[3], fit.dv[3]],
    }
}
