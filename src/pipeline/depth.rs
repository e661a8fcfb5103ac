//! Stage 1, second half: the skin (sub-voxel surface points) and the depth of every inner voxel
//! below it.

use nalgebra::{Point3, Vector3};

use crate::numerics::components::{Connectivity, neighbors};
use crate::numerics::distance::nearest_seed;
use crate::numerics::field::{Field, floor_index, id};
use crate::space::Grid;

use super::mask::Solid;

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
    /// Index of the nearest skin point; meaningful inside only.
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
        along_normal.hypot((tangential - SKIN_REACH).max(0.0))
    }
}

impl Depth {
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

/// Skin points and depths of a solid.
#[must_use]
pub fn depth(solid: &Solid) -> Depth {
    let dims = solid.inside.dims();
    let inside = solid.inside.as_slice();
    let mut skin_of = vec![u32::MAX; inside.len()];
    let (mut skin, mut skin_voxels) = (Vec::new(), Vec::new());
    for offset in (0..inside.len()).filter(|&o| inside[o]) {
        let mut is_boundary = false;
        neighbors(dims, offset, Connectivity::Faces6, |n| is_boundary |= !inside[n]);
        if is_boundary {
            skin_of[offset] = id(skin.len());
            skin.push(skin_point(&solid.level, solid.inside.index(offset)));
            skin_voxels.push(offset);
        }
    }
    let found = nearest_seed(dims, [1.0; 3], |o| skin_of[o] != u32::MAX);
    let mut nearest = found.seed;
    let mut depth = found.squared;
    for offset in 0..inside.len() {
        let point = skin_of[nearest.as_slice()[offset] as usize];
        nearest.as_mut_slice()[offset] = point;
        let at = Point3::from(solid.inside.index(offset).map(|x| x as f64));
        #[expect(clippy::cast_possible_truncation, reason = "the grid is f32")]
        let below = if inside[offset] { skin[point as usize].distance(at) as f32 } else { 0.0 };
        depth.as_mut_slice()[offset] = below;
    }
    Depth { skin, skin_voxels, depth, nearest }
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
