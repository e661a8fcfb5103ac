//! Stage `skeleton` (*skeletonize and prune* in the paper's figure 2): the medial surface.
//!
//! Distance-ordered homotopic thinning (Pudney, CVIU 72, 1998; Siddiqi et al., *Hamilton-Jacobi
//! skeletons*, IJCV 48, 2002) of the solid:
//!
//! 1. a voxel is *medial* where two skin points far apart, seen under a wide angle, are equally
//!    near (the integer medial axis of Hesselink, Roerdink, PAMI 30, 2008, on sub-voxel feet;
//!    `ends`);
//! 2. all others are taken away from the skin inward as long as no topology changes: those far from
//!    medial voxels by all threads together (`peel`), the rest one by one, by depth (`thin`);
//! 3. medial voxels that are no end of a surface are taken away where it is thicker than one voxel
//!    (`thin`);
//! 4. each voxel is moved to where its two feet are equally far: the sub-voxel medial point
//!    (`points`).
//!
//! We leave the paper (Palágyi's 3-subiteration thinning) because the order of the distance
//! field centres the surface at any orientation, where subiterations favour grid directions. Pruning
//! is a matter of whole sheets, and comes after them.

mod ends;

mod thin;

mod peel;

mod points;

use nalgebra::{Point3, Vector3};

use crate::cancel::{Cancel, Cancelled};
use crate::pipeline::solid::Solid;
use crate::pipeline::solid::depth::Depth;
use crate::pipeline::surface::Surface;

/// A voxel of the medial surface with its sub-voxel centre, in work space.
#[derive(Clone, Copy, Debug)]
pub struct MedialPoint {
    /// Offset of the voxel in the working grid.
    pub voxel: usize,
    /// Sub-voxel position.
    pub position: Point3<f64>,
    /// Nearest points of the boundary on the two sides.
    pub feet: [Point3<f64>; 2],
    /// Unit normal of the sheet, towards the first foot; the sign is arbitrary.
    pub normal: Vector3<f64>,
    /// Distance to the boundary, voxels.
    pub radius: f64,
    /// Cosine of the angle between the two feet: −1 inside a sheet, towards 0 at its rim.
    pub feet_cosine: f64,
}

/// The medial surface.
#[derive(Clone, Debug)]
pub struct MedialSurface {
    /// Its voxels, ascending in offset.
    pub points: Vec<MedialPoint>,
    /// 26-neighbours of each point.
    pub adjacency: Vec<Vec<u32>>,
}

impl MedialSurface {
    /// The same in a unit of so many working voxels.
    pub(in crate::pipeline) fn in_units(mut self, voxels_per_unit: f64) -> Self {
        for point in &mut self.points {
            point.position /= voxels_per_unit;
            point.radius /= voxels_per_unit;
            for foot in &mut point.feet {
                *foot /= voxels_per_unit;
            }
        }
        self
    }

    /// A point by its index.
    pub(in crate::pipeline) fn point(&self, p: u32) -> &MedialPoint {
        &self.points[p as usize]
    }

    /// The part made of some points (ascending).
    ///
    /// # Errors
    /// When it is cancelled.
    pub fn part(&self, members: &[u32], cancel: &dyn Cancel) -> Result<Surface, Cancelled> {
        let positions = members.iter().map(|&p| self.point(p).position).collect();
        Surface::part_of(&self.adjacency, members, positions, cancel)
    }
}

/// Thins a solid to its medial surface.
///
/// # Errors
/// When it is cancelled.
pub fn medial_surface(solid: &Solid, depth: &Depth, cancel: &dyn Cancel) -> Result<MedialSurface, Cancelled> {
    let medial = ends::medial_voxels(solid, depth, cancel)?;
    let left = thin::thinned(&solid.inside, depth, &medial, cancel)?;
    points::surface_of(&left, depth, cancel)
}
