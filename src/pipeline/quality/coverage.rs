//! Stage 8, second part: the solid that cells and crest wedges fill, against the mask on the
//! working grid.

use std::ops::Range;

use nalgebra::{Matrix3, Point3, Vector3};
use rayon::prelude::*;

use crate::numerics::balls::Balls;
use crate::numerics::field::floor_index;
use crate::numerics::points::Points;
use crate::space::Grid;

use crate::cancel::{Cancel, Cancelled};
use crate::model::Shell;
use crate::model::{Coverage, DistanceSummary};
use crate::pipeline::solid::Solid;
use crate::pipeline::solid::depth::SkinPoint;
use crate::pipeline::vectors::Nodes;

/// Distance between the samples of the model's surfaces, voxels.
const SAMPLE_STEP: f64 = 0.7;
/// Distance between the balls that split the mask among figures, voxels. The split moves by less
/// than a voxel with it, and the search is the slowest part of this stage.
const BALL_STEP: f64 = 2.0;
/// Share of the radius that cells of a coarse lattice may be off: a finer mask of the same object is not
/// to turn a result that is as good into a worse one.
const GRAIN: f64 = 0.1;

/// Coverage of the whole mask by all figures, and of each figure's share of it by that figure.
///
/// A voxel or skin point is the share of the figure whose inscribed balls come nearest to it
/// (power distance): where sheets meet, the mask is split along the hinge. Of a single figure
/// both are the same.
///
/// # Errors
/// When it is cancelled.
pub fn coverage(
    solid: &Solid,
    skin: &SkinSearch<'_>,
    figures: &[&Nodes],
    cancel: &dyn Cancel,
) -> Result<(Coverage, Vec<Coverage>), Cancelled> {
    let owners = Owners::of(figures, cancel)?;
    let owner = |s: &SkinPoint| cancel.check().map(|()| owners.of_point(s.position));
    let skin_owner: Vec<usize> = skin.points.par_iter().map(owner).collect::<Result<_, _>>()?;
    let samples = figures.par_iter().map(|nodes| surface_samples((*nodes).into(), cancel));
    let samples: Vec<Vec<SkinPoint>> = samples.collect::<Result<_, _>>()?;
    let (dice, dice_of) = overlaps(&solid.mask, figures, &owners, cancel)?;
    let grain = grain(figures);
    let measured = |dice: f64, own: &[SkinPoint], samples: &[SkinPoint]| {
        let to_model = SkinSearch::of(samples, cancel)?.distances(own, cancel)?;
        Ok(Coverage {
            dice,
            grain_mm: grain * solid.voxel_mm,
            covered_share: to_model.iter().filter(|d| **d <= grain).count() as f64 / to_model.len().max(1) as f64,
            mask_to_model: summary(to_model, solid.voxel_mm),
            model_to_mask: summary(skin.distances(samples, cancel)?, solid.voxel_mm),
        })
    };
    let whole = measured(dice, skin.points, &samples.concat())?;
    if figures.len() == 1 {
        return Ok((whole, vec![whole]));
    }
    let each = samples.iter().zip(dice_of).enumerate().map(|(number, (samples, dice))| {
        let own = skin.points.iter().zip(&skin_owner).filter(|(_, owner)| **owner == number);
        let own: Vec<SkinPoint> = own.map(|(s, _)| *s).collect();
        measured(dice, &own, samples)
    });
    Ok((whole, each.collect::<Result<_, _>>()?))
}

/// The unit of the fit, voxels: one, or a share of the median radius if that is more.
fn grain(figures: &[&Nodes]) -> f64 {
    let mut radii: Vec<f64> = figures.iter().flat_map(|nodes| nodes.radii.iter().copied()).collect();
    radii.sort_by(f64::total_cmp);
    radii.get(radii.len() / 2).map_or(1.0, |median| (GRAIN * median).max(1.0))
}

/// A surface given by points with normals, to be found by distance.
pub struct SkinSearch<'a> {
    points: &'a [SkinPoint],
    tree: Points,
}

impl<'a> SkinSearch<'a> {
    /// The surface of some points; there may be none.
    ///
    /// # Errors
    /// When it is cancelled.
    pub fn of(points: &'a [SkinPoint], cancel: &dyn Cancel) -> Result<Self, Cancelled> {
        cancel.check()?;
        let places: Vec<Point3<f64>> = points.iter().map(|s| s.position).collect();
        Ok(Self { points, tree: Points::new(&places) })
    }

    /// Distance from each of `from` to the surface around the nearest point; infinite when there is none.
    fn distances(&self, from: &[SkinPoint], cancel: &dyn Cancel) -> Result<Vec<f64>, Cancelled> {
        let distance = |s: &SkinPoint| {
            cancel.check()?;
            let nearest = self.tree.nearest(s.position);
            Ok(nearest.map_or(f64::INFINITY, |nearest| self.points[nearest].distance(s.position)))
        };
        from.par_iter().with_min_len(64).map(distance).collect()
    }

    /// The points within `reach` of a place.
    pub fn within(&self, p: Point3<f64>, reach: f64) -> impl Iterator<Item = &SkinPoint> {
        self.tree.within(p, reach).into_iter().map(|found| &self.points[found])
    }
}

/// Which figure a point belongs to: that of the inscribed ball nearest in power distance.
struct Owners {
    balls: Balls,
    figure_of: Vec<usize>,
}

impl Owners {
    fn of(figures: &[&Nodes], cancel: &dyn Cancel) -> Result<Self, Cancelled> {
        let (mut balls, mut figure_of) = (Vec::new(), Vec::new());
        if figures.len() > 1 {
            for (number, nodes) in figures.iter().enumerate() {
                cancel.check()?;
                balls.extend(balls_of(nodes));
                figure_of.resize(balls.len(), number);
            }
        }
        Ok(Self { balls: Balls::new(&balls, cancel)?, figure_of })
    }

    fn of_point(&self, p: Point3<f64>) -> usize {
        self.balls.nearest(p).map_or(0, |ball| self.figure_of[ball])
    }
}

/// Inscribed balls all over the medial quads of a figure, their radii interpolated.
fn balls_of(nodes: &Nodes) -> Vec<(Point3<f64>, f64)> {
    let mut balls = Vec::new();
    for quad in Shell::from(nodes).quads() {
        let corners = quad.nodes.map(|n| nodes.medial[n]);
        let [a, b, c, d] = quad.nodes.map(|n| nodes.radii[n]);
        sample_quad(corners, BALL_STEP, |p, [s, t]| {
            let (left, right) = (a + (c - a) * t, b + (d - b) * t);
            balls.push((p, left + (right - left) * s));
        });
    }
    balls
}

fn summary(mut voxels: Vec<f64>, voxel_mm: f64) -> DistanceSummary {
    voxels.par_sort_unstable_by(f64::total_cmp);
    let Some(&largest) = voxels.last() else { return DistanceSummary::default() };
    let rank = floor_index(0.95 * (voxels.len() - 1) as f64);
    DistanceSummary {
        mean_mm: voxels.iter().sum::<f64>() / voxels.len() as f64 * voxel_mm,
        p95_mm: voxels[rank] * voxel_mm,
        max_mm: largest * voxel_mm,
    }
}

/// Dice of the mask with the union of all cells and wedges, and of each figure's share of the
/// mask with its own.
fn overlaps(
    mask: &Grid<bool>,
    figures: &[&Nodes],
    owners: &Owners,
    cancel: &dyn Cancel,
) -> Result<(f64, Vec<f64>), Cancelled> {
    let filled = figures.iter().map(|nodes| filled(mask.dims(), (*nodes).into(), cancel));
    let filled: Vec<Grid<bool>> = filled.collect::<Result<_, _>>()?;
    let [nx, ny, _] = mask.dims();
    // Of all figures together, and then of each: voxels of the mask, of the model, and of both.
    let of_row = |(row, cells): (usize, &[bool])| {
        cancel.check()?;
        let mut counts = vec![[0usize; 3]; 1 + figures.len()];
        for (i, &in_mask) in cells.iter().enumerate() {
            let is_filled = |grid: &Grid<bool>| grid.as_slice()[row * nx + i];
            let mut add = |n: usize, in_mask: bool, in_model: bool| {
                let all = [in_mask, in_model, in_mask && in_model];
                counts[n].iter_mut().zip(all).for_each(|(count, holds)| *count += usize::from(holds));
            };
            add(0, in_mask, filled.iter().any(is_filled));
            if figures.len() > 1 {
                let at = Point3::from([i, row % ny, row / ny].map(|x| x as f64));
                let owner = in_mask.then(|| owners.of_point(at));
                filled.iter().enumerate().for_each(|(n, grid)| add(n + 1, owner == Some(n), is_filled(grid)));
            }
        }
        Ok(counts)
    };
    let sum = |a: Vec<[usize; 3]>, b: Vec<[usize; 3]>| {
        Ok(a.iter().zip(b).map(|(a, b)| [a[0] + b[0], a[1] + b[1], a[2] + b[2]]).collect())
    };
    let rows = mask.as_slice().par_chunks(nx).enumerate().with_min_len(64);
    let counts = rows.map(of_row).try_reduce(|| vec![[0; 3]; 1 + figures.len()], sum)?;
    let dice = |[mask, model, both]: &[usize; 3]| 2.0 * *both as f64 / (mask + model).max(1) as f64;
    Ok((dice(&counts[0]), counts[1..].iter().map(dice).collect()))
}

type Tetrahedron = [Point3<f64>; 4];

/// All cells and crest wedges, cut into tetrahedra.
fn tetrahedra(shell: Shell<'_>) -> Vec<Tetrahedron> {
    let mut all = Vec::new();
    let m = shell.medial;
    for skin in [shell.upper, shell.lower] {
        for quad in shell.quads() {
            let [a, b, c, d] = quad.nodes;
            all.extend(prism([m[a], m[b], m[d]], [skin[a], skin[b], skin[d]]));
            all.extend(prism([m[a], m[d], m[c]], [skin[a], skin[d], skin[c]]));
        }
        for step in shell.edge_steps() {
            let [a, b] = step.nodes;
            all.extend(prism([m[a], skin[a], shell.crest[step.here]], [m[b], skin[b], shell.crest[step.next]]));
        }
    }
    all
}

/// Three tetrahedra between two triangles.
fn prism([a, b, c]: [Point3<f64>; 3], [d, e, f]: [Point3<f64>; 3]) -> [Tetrahedron; 3] {
    [[a, b, c, d], [b, c, d, e], [c, d, e, f]]
}

/// The voxels whose centres lie in the cells and wedges of a figure.
fn filled(dims: [usize; 3], shell: Shell<'_>, cancel: &dyn Cancel) -> Result<Grid<bool>, Cancelled> {
    /// Planes of the grid that one thread takes at a time.
    const PLANES: usize = 4;
    /// Tetrahedra between two looks at whether to stop.
    const CUTS: usize = 1 << 10;
    let mut cuts = Vec::new();
    for tetrahedra in tetrahedra(shell).chunks(CUTS) {
        cancel.check()?;
        cuts.extend(tetrahedra.iter().filter_map(Cut::of));
    }
    let mut grid = Grid::filled(dims, false);
    let plane = dims[0] * dims[1];
    grid.as_mut_slice().par_chunks_mut(PLANES * plane).enumerate().try_for_each(|(n, planes)| {
        let from = n * PLANES;
        for (number, cut) in cuts.iter().enumerate() {
            if number.is_multiple_of(CUTS) {
                cancel.check()?;
            }
            for k in cut.range(2, from, from + planes.len() / plane) {
                let rows = &mut planes[(k - from) * plane..(k - from + 1) * plane];
                for j in cut.range(1, 0, dims[1]) {
                    rows[dims[0] * j..dims[0] * (j + 1)][cut.along_row(j, k, dims[0])].fill(true);
                }
            }
        }
        Ok(())
    })?;
    Ok(grid)
}

/// A tetrahedron as the places where its four barycentric coordinates are positive.
struct Cut {
    low: Point3<f64>,
    high: Point3<f64>,
    /// Each coordinate at the origin, and its slopes.
    coordinates: [(f64, Vector3<f64>); 4],
}

impl Cut {
    /// `None` for a flat one.
    fn of([o, a, b, c]: &Tetrahedron) -> Option<Self> {
        let inverse = Matrix3::from_columns(&[a - o, b - o, c - o]).try_inverse()?;
        let along = [0, 1, 2].map(|r| inverse.row(r).transpose());
        let [x, y, z] = along.map(|slope| (-slope.dot(&o.coords), slope));
        let rest = (1.0 - x.0 - y.0 - z.0, -(x.1 + y.1 + z.1));
        let low = o.coords.inf(&a.coords).inf(&b.coords.inf(&c.coords)).into();
        let high = o.coords.sup(&a.coords).sup(&b.coords.sup(&c.coords)).into();
        Some(Self { low, high, coordinates: [x, y, z, rest] })
    }

    /// Indices along an axis that its box reaches, from `first` and below `end`.
    fn range(&self, axis: usize, first: usize, end: usize) -> Range<usize> {
        whole_numbers(self.low[axis].max(first as f64), self.high[axis].min(end as f64 - 1.0))
    }

    /// The voxels of a row that lie in it.
    fn along_row(&self, j: usize, k: usize, end: usize) -> Range<usize> {
        /// Points this much outside count as inside, so that no voxel falls between two cells.
        const SEAM: f64 = 1e-9;
        let (mut low, mut high) = (self.low.x.max(0.0), self.high.x.min(end as f64 - 1.0));
        for (constant, slope) in &self.coordinates {
            let at_start = constant + slope.y * j as f64 + slope.z * k as f64 + SEAM;
            let zero = -at_start / slope.x;
            if slope.x > 0.0 {
                low = low.max(zero);
            } else if slope.x < 0.0 {
                high = high.min(zero);
            } else if at_start < 0.0 {
                return 0..0;
            }
        }
        whole_numbers(low, high)
    }
}

/// Whole numbers from `low` to `high`, both included and not negative.
fn whole_numbers(low: f64, high: f64) -> Range<usize> {
    if low.ceil() > high { 0..0 } else { floor_index(low.ceil())..floor_index(high) + 1 }
}

/// Points spread over the outer surface of a figure: upper, lower and the crest strips.
fn surface_samples(shell: Shell<'_>, cancel: &dyn Cancel) -> Result<Vec<SkinPoint>, Cancelled> {
    let mut samples = Vec::new();
    let mut sample = |corners: [Point3<f64>; 4]| {
        let [a, b, c, d] = corners;
        sample_quad(corners, SAMPLE_STEP, |position, [s, t]| {
            let (across, down) = ((b - a) * (1.0 - t) + (d - c) * t, (c - a) * (1.0 - s) + (d - b) * s);
            let normal = across.cross(&down).try_normalize(1e-9).unwrap_or_else(Vector3::z);
            samples.push(SkinPoint { position, normal });
        });
    };
    for skin in [shell.upper, shell.lower] {
        for quad in shell.quads() {
            cancel.check()?;
            sample(quad.nodes.map(|n| skin[n]));
        }
        for step in shell.edge_steps() {
            let [a, b] = step.nodes;
            sample([skin[a], skin[b], shell.crest[step.here], shell.crest[step.next]]);
        }
    }
    Ok(samples)
}

/// Bilinear samples, `step` apart at most, of a quad given as rows `[a b; c d]`, with their place in it: shares from a
/// to b and from a to c.
fn sample_quad([a, b, c, d]: [Point3<f64>; 4], step: f64, mut take: impl FnMut(Point3<f64>, [f64; 2])) {
    /// Samples along an edge at most; a quad of 2 000 voxels is as good as any with these.
    const MOST: usize = 400;
    let pieces = |length: f64| floor_index((length / step).ceil()).clamp(1, MOST);
    let across = pieces((b - a).norm().max((d - c).norm()));
    let down = pieces((c - a).norm().max((d - b).norm()));
    for y in 0..=down {
        let t = y as f64 / down as f64;
        let (left, right) = (a + (c - a) * t, b + (d - b) * t);
        for x in 0..=across {
            let s = x as f64 / across as f64;
            take(left + (right - left) * s, [s, t]);
        }
    }
}
