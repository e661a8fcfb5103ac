//! Stages `mask` and `distance` (*binary mask* in the paper's figure 2): one label of the volume as a clean solid on an isotropic
//! working grid, with a sub-voxel boundary.
//!
//! 1. The label's box is cut out, its axes in the order of the world ([`cut_out`]).
//! 2. The largest part is kept, cavities are filled (`clean`).
//! 3. It is brought to an isotropic grid by its signed distance (`resample`), unless it is on one.
//! 4. Smoothing makes a level of it that is 0 on the sub-voxel boundary.
//! 5. A repeat of the uncertainty moves the boundary (`perturb`).
//!
//! The stage that follows takes the skin and the depth of every voxel below it ([`depth`]).
//!
//! We leave the paper, which takes the voxels as they are, because the staircase of their boundary would be in
//! every length that comes after.
//!
//! Work space is the working grid's voxel coordinates: isotropic and orthogonal, so that lengths
//! in it are millimetres divided by [`Solid::voxel_mm`]. Everything up to the lattice is
//! computed there.

pub mod cut_out;

pub(crate) mod clean;

mod working_grid;

mod resample;

mod perturb;

pub(crate) mod senses;

pub mod depth;

use nalgebra::Point3;
use rayon::prelude::*;

use self::clean::{clean, keep_one_piece};
use self::cut_out::{Label, cut_out, refuse_background, warn_if_cut};
use self::perturb::perturbed;
use self::resample::resample;
use self::senses::Senses;
use self::working_grid::{WorkingGrid, embed};
use crate::cancel::{Cancel, Cancelled};
use crate::model::{Refusal, TriangleMesh};
use crate::numerics::components::boundary_voxels;
use crate::numerics::distance::nearest_seed;
use crate::numerics::field::Field;
use crate::numerics::smooth::gaussian;
use crate::numerics::surface_nets::zero_surface;
use crate::numerics::topology::euler_number;
use crate::pipeline::PipelineError;
use crate::pipeline::context::Context;
use crate::space::{Grid, LabelVolume, WorldFromVoxel, WorldPoint};

/// Standard deviation of the smoothing that turns voxels into a sub-voxel boundary, working
/// voxels. Below 0.7 the staircase stays; above 1.2 edges round off by more than a tenth.
const BOUNDARY_SIGMA: f64 = 1.0;
/// Voxels that one thread takes at a time, or between two looks at whether to stop, where little is done with each:
/// some ten to a hundred microseconds. Fewer are not worth handing over, many more would make a stop wait.
const SLICE: usize = 1 << 16;

/// A label as a solid.
#[derive(Clone, Debug)]
pub struct Solid {
    /// Inside of the sub-voxel boundary: one 26-component without cavities.
    pub inside: Grid<bool>,
    /// The mask itself on the working grid, for the quality measures.
    pub mask: Grid<bool>,
    /// Positive inside, 0 on the sub-voxel boundary, without a unit.
    pub level: Field,
    /// World position of work space.
    pub world_from_work: WorldFromVoxel,
    /// Edge of a working voxel, mm.
    pub voxel_mm: f64,
    /// The mask on its own voxels, before any resampling.
    pub native: NativeMask,
    /// Which way is positive in the world.
    pub senses: Senses,
}

/// A label as it was cut out of the volume: cleaned, with one free voxel all around, its axes in
/// the order of the world.
#[derive(Clone, Debug)]
pub struct NativeMask {
    /// The voxels.
    pub mask: Grid<bool>,
    /// Where they lie.
    pub world_from_voxel: WorldFromVoxel,
}

/// What the first stage makes of a label.
#[derive(Clone, Debug)]
pub struct Masked {
    /// The solid.
    pub solid: Solid,
    /// The smooth outer surface of the mask, in the world; empty in a repeat.
    pub object: TriangleMesh,
}

/// Cuts a label out, cleans it, and brings it to an isotropic grid with a sub-voxel boundary.
///
/// Keeps the largest 26-component and fills cavities, both with a warning. The working voxel is
/// `resolution_mm`, or the finest spacing of the mask.
///
/// # Errors
/// [`Refusal::Background`] when the label lies all around the image, [`Refusal::TooLarge`] when the working grid would be, [`Refusal::TooThin`] when nothing is
/// left of the object on it; when it is cancelled.
pub fn masked(volume: &LabelVolume, label: Label, context: &Context<'_>) -> Result<Masked, PipelineError> {
    refuse_background(volume, label)?;
    warn_if_cut(volume, label, context);
    let mut native = cut_out(volume, label, context)?;
    let plan = WorkingGrid::plan(&native, context.params.resolution_mm);
    plan.check_size()?;
    context.advance(0.2);
    native.mask = clean(native.mask, context)?;
    context.advance(0.4);
    let (mask, soft) =
        if plan.is_native { embed(&native.mask, &plan, context)? } else { resample(&native, &plan, context)? };
    context.advance(0.6);
    let (inside, level) = smooth_boundary(soft, context)?;
    if !inside.as_slice().contains(&true) {
        return Err(too_thin(&mask, plan.voxel_mm, context)?.into());
    }
    warn_if_tunnels_closed(&inside, &mask, context)?;
    context.advance(0.8);
    let WorkingGrid { world_from_work, voxel_mm, .. } = plan;
    let senses = Senses::of(&inside, &world_from_work, context)?;
    let solid = Solid { inside, mask, level, world_from_work, voxel_mm, native, senses };
    Ok(match context.repeat {
        Some(repeat) => Masked { solid: perturbed(solid, repeat.number, context)?, object: TriangleMesh::default() },
        None => Masked { object: object_mesh(&solid, context)?, solid },
    })
}

/// The level that is 0 on the boundary of soft voxels, and what lies inside of it, one piece without
/// cavities.
fn smooth_boundary(mut soft: Grid<f32>, cancel: &dyn Cancel) -> Result<(Grid<bool>, Field), Cancelled> {
    gaussian(&mut soft, [BOUNDARY_SIGMA; 3], cancel)?;
    soft.as_mut_slice().par_chunks_mut(SLICE).try_for_each(|slice| {
        cancel.check()?;
        for v in slice {
            *v -= 0.5;
        }
        Ok::<_, Cancelled>(())
    })?;
    let inside = keep_one_piece(&mut soft, cancel)?;
    Ok((inside, Field(soft)))
}

/// One piece without cavities has one tunnel for each that its Euler number is below 1.
fn warn_if_tunnels_closed(inside: &Grid<bool>, mask: &Grid<bool>, context: &Context<'_>) -> Result<(), Cancelled> {
    let closed = euler_number(inside, context)? - euler_number(mask, context)?;
    if closed > 0 {
        context.warn(
            "tunnels_closed",
            format!("tunnels of the mask that are too narrow for the grid were closed: {closed}"),
        );
    }
    Ok(())
}

/// The smooth outer surface of the mask in the world.
fn object_mesh(solid: &Solid, cancel: &dyn Cancel) -> Result<TriangleMesh, Cancelled> {
    let mesh = zero_surface(&solid.level.0, cancel)?;
    let mut triangles = mesh.triangles;
    if solid.world_from_work.matrix().determinant() < 0.0 {
        for triangle in &mut triangles {
            triangle.swap(1, 2);
        }
    }
    Ok(TriangleMesh { positions: solid.in_world(&mesh.positions), triangles })
}

impl Solid {
    /// Points of work space in the world.
    #[must_use]
    pub(crate) fn in_world(&self, points: &[Point3<f64>]) -> Vec<WorldPoint> {
        points.iter().map(|p| self.world_from_work.point(*p)).collect()
    }
}

/// What is said of a mask of which smoothing leaves nothing: its thickness is twice the depth of its deepest voxel.
fn too_thin(mask: &Grid<bool>, voxel_mm: f64, cancel: &dyn Cancel) -> Result<Refusal, Cancelled> {
    let outward = nearest_seed(mask.dims(), [1.0; 3], &boundary_voxels(mask, false, cancel)?, cancel)?.squared;
    let mut deepest = 0.0f32;
    for (squared, is_inside) in outward.as_slice().iter().zip(mask.as_slice()) {
        deepest = if *is_inside { deepest.max(*squared) } else { deepest };
    }
    let voxels = 2.0 * f64::from(deepest.sqrt()) - 1.0;
    let (thickness_mm, resolution_mm) = (voxels * voxel_mm, voxel_mm * voxels / 4.0);
    Ok(Refusal::TooThin { thickness_mm, voxels, voxel_mm, resolution_mm })
}
