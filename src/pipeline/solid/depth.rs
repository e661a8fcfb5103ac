//! Stage 1, second half: the skin (sub-voxel surface points) and the depth of every inner voxel
//! below it.

use nalgebra::{Point3, Vector3};
use rayon::prelude::*;

use crate::numerics::components::boundary_voxels;
use crate::numerics::distance::{NO_SEED, Nearest, nearest_seed_within};
use crate::numerics::field::{Field, floor_index};
use crate::space::Grid;

use crate::cancel::{Cancel, Cancelled};
use crate::pipeline::context::Context;
use crate::pipeline::solid::Solid;

/// How far along the surface a skin point speaks for it, voxels: half the way to the next one
/// across a voxel's diagonal.
const SKIN_REACH: f64 = 0.7;
/// Newton steps that bring a boundary voxel's centre onto the boundary. The level is nearly
/// linear there: the second step moves by less than 0.02 voxel.
const NEWTON_STEPS: usize = 3;

/// A point of the sub-voxel boundary, in work space.
#[derive(Clone, Copy, Debug)]
pub struct SkinPoint {
    /// Position, voxels.
    pub position: Point3<f64>,
    /// Unit normal, outward.
    pub normal: Vector3<f64>,
}

/// The skin and the depth below it.
#[derive(Clone, Debug)]
pub struct Depth {
    /// One point per boundary voxel, ascending in voxel offset.
    pub skin: Vec<SkinPoint>,
    /// The boundary voxel of each skin point.
    pub skin_voxels: Vec<usize>,
    /// Depth below the skin, voxels; 0 outside.
    pub depth: Grid<f32>,
    /// Index of the nearest skin point; [`NO_SEED`] outside.
    pub nearest: Grid<u32>,
}

impl SkinPoint {
    /// Distance of `p` from the surface that this point speaks for: from its tangent plane
    /// near it, from its rim further off.
    #[must_use]
    pub fn distance(&self, p: Point3<f64>) -> f64 {
        let v = p - self.position;
        let along_normal = v.dot(&self.normal);
        let tangential = (v.norm_squared() - along_normal * along_normal).max(0.0).sqrt();
        let beyond = (tangential - SKIN_REACH).max(0.0);
        // Lengths are voxels: nothing overflows, and `hypot` takes five times as long.
        (along_normal * along_normal + beyond * beyond).sqrt()
    }
}

impl Depth {
    /// The skin point of a boundary voxel; `None` of any other voxel.
    #[must_use]
    pub fn skin_at(&self, voxel: usize) -> Option<u32> {
        let nearest = self.nearest.as_slice()[voxel];
        (nearest != NO_SEED && self.skin_voxels[nearest as usize] == voxel).then_some(nearest)
    }

    /// Depth of a place below the skin, voxels: the least distance of the skin points nearest to
    /// the voxels around it. 0 outside.
    #[must_use]
    pub fn at(&self, p: Point3<f64>) -> f64 {
        let dims = self.depth.dims();
        let base = [0, 1, 2].map(|a| floor_index(p[a]).min(dims[a] - 2));
        let mut least = f64::INFINITY;
        for bits in 0..8usize {
            let corner = [base[0] + (bits & 1), base[1] + (bits >> 1 & 1), base[2] + (bits >> 2)];
            if self.depth[corner] > 0.0 {
                least = least.min(self.skin[self.nearest[corner] as usize].distance(p));
            }
        }
        if least.is_finite() { least } else { 0.0 }
    }
}

/// The boundary of a solid: one point per boundary voxel, ascending in voxel offset.
struct Skin {
    points: Vec<SkinPoint>,
    voxels: Vec<usize>,
}

fn skin(solid: &Solid, cancel: &dyn Cancel) -> Result<Skin, Cancelled> {
    let voxels = boundary_voxels(&solid.inside, true, cancel)?;
    let point_of = |&offset: &usize| {
        cancel.check()?;
        Ok(skin_point(&solid.level, solid.inside.index(offset)))
    };
    let points = voxels.par_iter().with_min_len(64).map(point_of).collect::<Result<_, _>>()?;
    Ok(Skin { points, voxels })
}

/// The skin of a solid, and the depth of every inner voxel below it.
///
/// # Errors
/// When it is cancelled.
pub fn depth(solid: &Solid, context: &Context<'_>) -> Result<Depth, Cancelled> {
    let Skin { points: skin, voxels: skin_voxels } = skin(solid, context)?;
    context.advance(0.3);
    let nearest = nearest_seed_within(&solid.inside, &skin_voxels, context)?;
    context.advance(0.7);
    let Nearest { squared: mut depth, seed: nearest } = nearest;
    let [nx, ny, _] = solid.inside.dims();
    let rows = depth.as_mut_slice().par_chunks_mut(nx).zip(nearest.as_slice().par_chunks(nx));
    rows.enumerate().with_min_len(16).try_for_each(|(row, (depth, nearest))| {
        context.check()?;
        let (j, k) = ((row % ny) as f64, (row / ny) as f64);
        for (i, (depth, &point)) in depth.iter_mut().zip(nearest).enumerate() {
            #[expect(clippy::cast_possible_truncation, reason = "the grid is f32")]
            let below = |point: u32| skin[point as usize].distance(Point3::new(i as f64, j, k)) as f32;
            *depth = if point == NO_SEED { 0.0 } else { below(point) };
        }
        Ok(())
    })?;
    Ok(Depth { skin, skin_voxels, depth, nearest })
}

fn skin_point(level: &Field, voxel: [usize; 3]) -> SkinPoint {
    let centre = Point3::from(voxel.map(|x| x as f64));
    let mut position = centre;
    for _ in 0..NEWTON_STEPS {
        let gradient = level.gradient(position);
        let step = -gradient * (level.at(position) / gradient.norm_squared().max(1e-9));
        position += step * (0.7 / step.norm().max(0.7));
        // A voxel that is not carried to the boundary near it keeps its own place.
        if (position - centre).norm() > 1.5 {
            position = centre;
            break;
        }
    }
    let normal = (-level.gradient(position)).try_normalize(1e-9).unwrap_or_else(Vector3::z);
    SkinPoint { position, normal }
}
