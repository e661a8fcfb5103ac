//! The region that a flattened surface covers: its principal axes and its outline. The paper has none: its lattice is the
//! bounding rectangle of the points.
//!
//! 1. Pixels near a point are taken, then those near the others are given back: gaps between points close, and the
//!    outline lies a little beyond the outermost ones;
//! 2. of the pieces the largest is kept, and its holes are filled;
//! 3. the edge is smoothed into a level, 0 on the outline.

use nalgebra::{Matrix2, Point2, Point3, Vector2};

use crate::cancel::{Cancel, Cancelled};
use crate::numerics::components::{Connectivity, components};
use crate::numerics::contour::longest_contour;
use crate::numerics::distance::nearest_seed;
use crate::numerics::field::Field;
use crate::numerics::moments::{Axes2, bounds};
use crate::numerics::raster::Raster;
use crate::numerics::smooth::gaussian;
use crate::space::Grid;

/// Pixel of the region's raster, voxels. With 1, masks of 75 organs and shapes lie 6 % further from the model on
/// average, and nearly twice as many corners are folded before repair; with 0.25 they lie 1 % nearer, for four times
/// the pixels.
pub(crate) const PITCH: f64 = 0.5;
/// Gaps between points up to twice this are part of the sheet, voxels. Neighbours on a staircase lie up to 1.8 apart.
/// From 0.9 to 3 nothing changes but by chance.
const CLOSING: f64 = 1.5;
/// How far the sheet goes on beyond its outermost points on average, voxels: its true rim lies
/// anywhere between them and the next voxel. With none, medial nodes of a hippocampus and a gluteus lie half as far
/// again from the middle; with 1, a caudate has 8 folded corners before repair, not 4, and a spleen 10, not 6.
const OVERHANG: f64 = 0.5;
/// Standard deviation of the outline's smoothing, voxels: the rim of a voxel sheet is jagged by half a voxel. With 2,
/// tails are smoothed away: the mask of a hippocampus lies three times as far from the model. With 0.5 nothing changes
/// but by chance.
const OUTLINE_SIGMA: f64 = 1.0;
/// Share of a sheet's area from which its holes are not filled but refused: every seventh node would lie on nothing.
/// With 0.05 two thalami are refused, which pass; with 0.5 five bones and organs more are laid out, of which four fail.
pub(crate) const HOLES_REFUSED: f64 = 0.15;
/// Level of pixels that are cut off, at the most: well outside, whatever the level's unit.
const CUT_OFF: f32 = 0.25;
/// Free pixels around the points.
const PADDING: usize = 12;

/// Band around another outline in which the level is a distance, pixels: as far as the outline is moved, and more than
/// what [`Region::contains`] asks for.
const BAND: f64 = 3.0;

/// The region covered by points of the plane. Lengths are voxels.
#[derive(Clone, Debug)]
pub struct Region {
    /// Where its pixels lie.
    pub(crate) raster: Raster,
    /// Positive inside, 0 on the smoothed outline.
    pub(crate) level: Field,
    /// Distance to the nearest point, pixels.
    gap: Field,
    /// How far outside of the outline a point still counts as on it, in units of the level.
    slack: f64,
    /// Area of holes that were filled, as a share of the region.
    pub hole_share: f64,
}

impl Region {
    /// The region of `points`: their closing, with holes filled and a smooth outline.
    ///
    /// # Errors
    /// When it is cancelled.
    pub fn of(points: &[Point2<f64>], cancel: &dyn Cancel) -> Result<Self, Cancelled> {
        let raster = Raster::around(points, PITCH, PADDING);
        let dims = [raster.dims[0], raster.dims[1], 1];
        let mut gap = nearest_seed(dims, [1.0; 3], &raster.taken_by(points), cancel)?.squared;
        let (inside, hole_share) = fill_holes(closed(&gap, cancel)?, cancel)?;
        let level = smooth_level(&inside, cancel)?;
        for distance in gap.as_mut_slice() {
            *distance = distance.sqrt();
        }
        Ok(Self { raster, level: Field(level), gap: Field(gap), slack: 0.0, hole_share })
    }

    /// The same region with another outline, counter-clockwise, no further than a few voxels away.
    #[must_use]
    pub(crate) fn reshaped(&self, outline: &[Point2<f64>]) -> Self {
        let level = Field(self.raster.signed_distance(outline, BAND));
        Self { raster: self.raster, level, gap: self.gap.clone(), slack: 1.0, hole_share: self.hole_share }
    }

    /// The region without the tails of it that are narrower than `width`, voxels; `None` where it has none. Corners are
    /// none: what is cut off must be longer than it is wide.
    ///
    /// # Errors
    /// When it is cancelled.
    pub(crate) fn without_tails(&self, width: f64, cancel: &dyn Cancel) -> Result<Option<Self>, Cancelled> {
        let inside = self.level.0.try_map(|level| *level > 0.0, cancel)?;
        let radius = width / 2.0 / PITCH;
        let wide = eroded(&inside, radius, cancel)?;
        let gap = nearest_seed(inside.dims(), [1.0; 3], &places_of(&wide, true), cancel)?.squared;
        let mut tails = inside;
        for (is_tail, gap) in tails.as_mut_slice().iter_mut().zip(gap.as_slice()) {
            *is_tail &= f64::from(*gap) > radius * radius;
        }
        let pieces = components(&tails, true, Connectivity::Corners26, cancel)?;
        let least = (width / PITCH).powi(2);
        if pieces.sizes.iter().all(|size| (*size as f64) < least) {
            return Ok(None);
        }
        let mut region = self.clone();
        for (level, is_tail) in region.level.0.as_mut_slice().iter_mut().zip(tails.as_slice()) {
            *level = if *is_tail { -level.abs().max(CUT_OFF) } else { *level };
        }
        Ok(Some(region))
    }

    /// Whether a point lies on the sheet: inside the outline, or as near to a point of the sheet as
    /// gaps in it may be wide.
    #[must_use]
    pub fn contains(&self, p: Point2<f64>) -> bool {
        let pixels = self.raster.pixels_of(p);
        let at = Point3::new(pixels.x, pixels.y, 0.0);
        self.raster.holds(pixels) && (self.level.at(at) >= -self.slack || self.gap.at(at) <= CLOSING / PITCH)
    }

    /// The longest closed curve where the level is 0, counter-clockwise.
    #[must_use]
    pub(crate) fn outline(&self) -> Vec<Point2<f64>> {
        let contour = longest_contour(&self.level.0);
        contour.into_iter().map(|at| self.raster.origin + at * PITCH).collect()
    }

    /// The second coordinate of the outline farthest along the second axis, or back along it, at a first one; `None` where the
    /// region has none.
    #[must_use]
    pub(crate) fn outermost(&self, x: f64, towards: f64) -> Option<f64> {
        let rows = self.raster.dims[1];
        let level = |row: usize| {
            let pixels = self.raster.pixels_of(Point2::new(x, self.raster.origin.y + row as f64 * PITCH));
            self.level.at(Point3::new(pixels.x, pixels.y, 0.0))
        };
        let order: Vec<usize> = if towards < 0.0 { (0..rows).collect() } else { (0..rows).rev().collect() };
        for step in order.windows(2) {
            let [before, here] = [level(step[0]), level(step[1])];
            if before <= 0.0 && here > 0.0 {
                let share = before / (before - here);
                let row = step[0] as f64 + (step[1] as f64 - step[0] as f64) * share;
                return Some(self.raster.origin.y + row * PITCH);
            }
        }
        None
    }

    /// Smallest and largest coordinates of the outline; `None` for an empty region.
    #[must_use]
    pub fn bounds(&self) -> Option<[Point2<f64>; 2]> {
        let outline = self.outline();
        if outline.is_empty() { None } else { Some(bounds(&outline).map(Point2::from)) }
    }

    /// Unit directions of the longest and the shortest extent, from the second moments of the
    /// area (not of the points, whose density depends on the grid), and the root moments.
    #[must_use]
    pub(crate) fn principal_axes(&self) -> ([Vector2<f64>; 2], [f64; 2]) {
        let (count, mean, second) = self.moments();
        let axes = Axes2::of(second / count - mean * mean.transpose());
        (axes.directions, axes.values.map(|moment| moment.max(0.0).sqrt()))
    }

    /// Sides of the rectangle that has the region's second moments, the longer first, voxels.
    #[must_use]
    pub fn rectangle(&self) -> [f64; 2] {
        // The side of a rectangle is √12 times its root second moment.
        self.principal_axes().1.map(|moment| moment * 12.0f64.sqrt())
    }

    /// Its area, square voxels.
    #[must_use]
    pub fn area(&self) -> f64 {
        self.moments().0 * PITCH * PITCH
    }

    /// Number of inside pixels (at least 1), mean of their positions from the origin, and sum of
    /// the positions' products.
    #[must_use]
    pub(crate) fn moments(&self) -> (f64, Vector2<f64>, Matrix2<f64>) {
        let (mut count, mut sum, mut second) = (0.0f64, Vector2::zeros(), Matrix2::zeros());
        for at in self.pixels() {
            count += 1.0;
            sum += at;
            second += at * at.transpose();
        }
        let count = count.max(1.0);
        (count, sum / count, second)
    }

    /// The pixels inside, from the raster's origin.
    pub(crate) fn pixels(&self) -> Vec<Vector2<f64>> {
        let grid = &self.level.0;
        let mut pixels = Vec::new();
        for (o, level) in grid.as_slice().iter().enumerate() {
            if *level > 0.0 {
                let [i, j, _] = grid.index(o);
                pixels.push(Vector2::new(i as f64, j as f64) * PITCH);
            }
        }
        pixels
    }
}

/// Offsets of the pixels that are `value`.
fn places_of(pixels: &Grid<bool>, value: bool) -> Vec<usize> {
    let mut places = Vec::new();
    for (o, is_set) in pixels.as_slice().iter().enumerate() {
        if *is_set == value {
            places.push(o);
        }
    }
    places
}

/// Pixels further than a radius, pixels, from all that are not set.
fn eroded(pixels: &Grid<bool>, radius: f64, cancel: &dyn Cancel) -> Result<Grid<bool>, Cancelled> {
    let gap = nearest_seed(pixels.dims(), [1.0; 3], &places_of(pixels, false), cancel)?.squared;
    gap.try_map(|squared| f64::from(*squared) > radius * radius, cancel)
}

/// The pixels near a point, less those near to the pixels that are not: all of `CLOSING` but the overhang.
fn closed(gap_squared: &Grid<f32>, cancel: &dyn Cancel) -> Result<Grid<bool>, Cancelled> {
    let reach = CLOSING / PITCH;
    let near = gap_squared.try_map(|squared| f64::from(*squared) <= reach * reach, cancel)?;
    eroded(&near, reach - OVERHANG / PITCH, cancel)
}

/// ½ well inside, −½ well outside, 0 on the smoothed outline.
fn smooth_level(inside: &Grid<bool>, cancel: &dyn Cancel) -> Result<Grid<f32>, Cancelled> {
    let mut level = inside.try_map(|m| f32::from(u8::from(*m)), cancel)?;
    gaussian(&mut level, [OUTLINE_SIGMA / PITCH, OUTLINE_SIGMA / PITCH, 0.0], cancel)?;
    for value in level.as_mut_slice() {
        *value -= 0.5;
    }
    Ok(level)
}

/// Keeps the largest piece of the pixels and fills its holes; returns their share too.
fn fill_holes(mut pixels: Grid<bool>, cancel: &dyn Cancel) -> Result<(Grid<bool>, f64), Cancelled> {
    let pieces = components(&pixels, true, Connectivity::Corners26, cancel)?;
    pieces.set_all_but(pieces.largest().as_slice(), &mut pixels, false);
    let background = components(&pixels, false, Connectivity::Faces6, cancel)?;
    let filled = background.set_all_but(background.of_first_voxel().as_slice(), &mut pixels, true);
    let area = pixels.as_slice().iter().filter(|is_inside| **is_inside).count().max(1);
    Ok((pixels, filled as f64 / area as f64))
}
