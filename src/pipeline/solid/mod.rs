//! Stages `mask` and `distance` (*binary mask* in the paper's figure 2): one label of the volume as a clean solid on an isotropic
//! working grid, with a sub-voxel boundary.
//!
//! 1. The label's box is cut out, its axes in the order of the world ([`cut_out`]), and taken apart ([`parts`]); what
//!    follows is done with each part.
//! 2. Cavities that are no lumen are filled (`clean`).
//! 3. It is brought to an isotropic grid by its signed distance (`grid`), unless it is on one.
//! 4. Smoothing makes a level of it that is 0 on the sub-voxel boundary.
//! 5. What that lost of the part, and what it gained, is counted ([`changes`]).
//! 6. A repeat of the uncertainty moves the boundary (`perturb`).
//!
//! The stage that follows takes the skin and the depth of every voxel below it ([`depth`]).
//!
//! We leave the paper, which takes the voxels as they are, because the staircase of their boundary would be in
//! every length that comes after.
//!
//! Work space is the working grid's voxel coordinates: isotropic and orthogonal, so that lengths
//! in it are millimetres divided by [`Solid::unit_mm`]. Everything up to the lattice is
//! computed there.

pub mod cut_out;

pub mod parts;

pub(crate) mod clean;

pub mod level;

mod grid;

pub mod changes;

mod necks;

mod perturb;

mod portion;

pub(crate) mod senses;

pub mod depth;

use nalgebra::{Point3, Vector3};
use rayon::prelude::*;

use self::changes::Changes;
use self::clean::{Piece, keep_one_piece, without_cavities};
use self::depth::Depth;
use self::grid::resample::resample;
use self::grid::thinness::fitting_grid;
use self::grid::working_grid::{WorkingGrid, embed};
use self::level::Level;
use self::perturb::perturbed;
use self::senses::Senses;
use crate::cancel::{Cancel, Cancelled};
use crate::model::{Refusal, TriangleMesh};
use crate::numerics::components::boundary_voxels;
use crate::numerics::distance::nearest_seed;
use crate::numerics::field::floor_index;
use crate::numerics::smooth::gaussian;
use crate::numerics::surface_nets::{Mesh, zero_surface};
use crate::numerics::topology::euler_number;
use crate::pipeline::PipelineError;
use crate::pipeline::context::Context;
use crate::space::{Grid, WorldFromVoxel, WorldPoint};

/// Standard deviation of the smoothing that turns voxels into a sub-voxel boundary, working
/// voxels. Below 0.7 the staircase stays; above 1.2 edges round off by more than a tenth.
const BOUNDARY_SIGMA: f64 = 1.0;
/// The same of a boundary that was found by its shape, which has no staircase, in grains: what single wrong voxels make of it. With
/// none, 3 % of them double the error of the medial sheet; with 1, edges round off as above.
const SHAPE_SIGMA: f64 = 0.7;
/// Working voxels to a grain from which lengths count in it. Nearer to 1 both are the same but for rounding.
const LEAST_ENLARGED: f64 = 1.05;
/// How far the level may be moved to enclose the mask's volume. A tube of two voxels lacks 0.3 of a level of smoothed voxels;
/// beyond, what is lost is not the boundary's.
const MOST_SHIFT: f32 = 0.35;
/// Voxels that one thread takes at a time, or between two looks at whether to stop, where little is done with each:
/// some ten to a hundred microseconds. Fewer are not worth handing over, many more would make a stop wait.
const SLICE: usize = 1 << 16;

/// A part of a label as a solid.
#[derive(Clone, Debug)]
pub struct Solid {
    /// Inside of the sub-voxel boundary: one 26-component without cavities but its lumens.
    pub inside: Grid<bool>,
    /// Positive inside, 0 on the sub-voxel boundary, without a unit.
    pub level: Level,
    /// World position of work space.
    pub world_from_work: WorldFromVoxel,
    /// Edge of a working voxel, mm.
    pub working_voxel_mm: f64,
    /// The unit of work space, mm.
    pub unit_mm: f64,
    /// Working voxels to the length that all others count in: the mask's grain, half of the largest depth in thinner solids,
    /// a voxel at the least.
    pub voxels_per_grain: f64,
    /// The mask on its own voxels, without cavities but its lumens, before any resampling.
    pub native: NativeMask,
    /// Which way is positive in the world.
    pub senses: Senses,
    /// Tunnels that lead through it: only then does its medial sheet have holes.
    pub tunnels: i64,
    /// Cavities that it encloses as a wall does; all others were filled.
    pub lumens: usize,
}

/// Tunnels of one piece: each lumen adds one to the Euler number, each tunnel takes one off.
fn tunnels(lumens: usize, euler_number: i64) -> i64 {
    #[expect(clippy::cast_possible_wrap, reason = "fewer than voxels")]
    let lumens = lumens as i64;
    1 + lumens - euler_number
}

/// Voxels of a label as they were cut out of the volume: with one free voxel all around, their axes in the order of the
/// world.
#[derive(Clone, Debug)]
pub struct NativeMask {
    /// The voxels.
    pub mask: Grid<bool>,
    /// Where they lie.
    pub world_from_voxel: WorldFromVoxel,
    /// The axis of the file that each of its own runs along.
    pub file_axes: [usize; 3],
}

/// What the first stage makes of a part of a label.
#[derive(Clone, Debug)]
pub struct Masked {
    /// The solid.
    pub solid: Solid,
    /// The smooth outer surface of the mask, in the world; empty in a repeat.
    pub object: TriangleMesh,
    /// What the solid has lost and gained; nothing in a repeat.
    pub changes: Changes,
}

/// Brings a part of a label to an isotropic grid with a sub-voxel boundary.
///
/// Cavities that are no lumen are filled, with a warning. The working voxel is `resolution_mm`, or the finest spacing of the mask, or
/// half of that where the part is thin.
///
/// # Errors
/// [`Refusal::TooLarge`] when the working grid would be, [`Refusal::Hollow`] of a part with many cavities,
/// [`Refusal::TooThin`] when nothing is left of it on the grid; when it is cancelled.
pub fn masked(part: &NativeMask, context: &Context<'_>) -> Result<Masked, PipelineError> {
    WorkingGrid::plan(part, context.params.resolution_mm).check_size(context.memory_bytes())?;
    context.advance(0.2);
    let Piece { inside: mask, lumens } = without_cavities(&part.mask, context)?;
    let native = NativeMask { mask, ..*part };
    let plan = fitting_grid(&native, context)?;
    context.advance(0.4);
    let (mask, mut level, voxels_per_grain) = if plan.is_native {
        let (mask, soft) = embed(&native.mask, &plan, context)?;
        (mask, smoothed(soft, context)?, 1.0)
    } else {
        let (mask, mut level) = resample(&native, &plan, context)?;
        let voxels_per_grain = voxels_per_grain(&native, plan.voxel_mm, &level);
        gaussian(&mut level, [SHAPE_SIGMA * voxels_per_grain; 3], context)?;
        (mask, level, voxels_per_grain)
    };
    context.advance(0.6);
    let Piece { inside, lumens } = keep_one_piece(&mut level, lumens, context)?;
    let level = Level::new(level);
    if !inside.as_slice().contains(&true) {
        return Err(too_thin(&mask, plan.voxel_mm, context)?.into());
    }
    let euler_number = euler_number(&inside, context)?;
    warn_if_tunnels_closed(euler_number, &mask, context)?;
    context.advance(0.8);
    let WorkingGrid { world_from_work, voxel_mm: working_voxel_mm, .. } = plan;
    let senses = Senses::of(&inside, &world_from_work, context)?;
    let unit_mm = working_voxel_mm;
    let tunnels = tunnels(lumens, euler_number);
    let solid = Solid {
        inside,
        level,
        world_from_work,
        working_voxel_mm,
        unit_mm,
        voxels_per_grain,
        native,
        senses,
        tunnels,
        lumens,
    };
    if let Some(repeat) = context.repeat {
        let solid = perturbed(solid, repeat.number, context)?;
        return Ok(Masked { solid, object: TriangleMesh::default(), changes: Changes::default() });
    }
    let changes = Changes::of(part, &solid, context)?;
    Ok(Masked { object: object_mesh(&solid, context)?, solid, changes })
}

/// The level that is 0 on the boundary of soft voxels.
fn smoothed(mut soft: Grid<f32>, cancel: &dyn Cancel) -> Result<Grid<f32>, Cancelled> {
    gaussian(&mut soft, [BOUNDARY_SIGMA; 3], cancel)?;
    soft.as_mut_slice().par_chunks_mut(SLICE).try_for_each(|slice| {
        cancel.check()?;
        for v in slice {
            *v -= 0.5;
        }
        Ok::<_, Cancelled>(())
    })?;
    Ok(soft)
}

/// Each tunnel that is closed adds one to the Euler number, here that of the solid.
fn warn_if_tunnels_closed(of_solid: i64, mask: &Grid<bool>, context: &Context<'_>) -> Result<(), Cancelled> {
    let closed = of_solid - euler_number(mask, context)?;
    if closed > 0 {
        context.warn(
            "tunnels_closed",
            format!("tunnels of the mask that are too narrow for the grid were closed: {closed}"),
        );
    }
    Ok(())
}

/// See [`Solid::voxels_per_grain`]. `level`: of the mask on the working grid, in its voxels.
fn voxels_per_grain(native: &NativeMask, working_voxel_mm: f64, level: &Grid<f32>) -> f64 {
    let finest = native.world_from_voxel.spacing_mm().into_iter().fold(f64::INFINITY, f64::min);
    let mut deepest = 0.0f32;
    for &value in level.as_slice() {
        deepest = deepest.max(value);
    }
    let voxels = (finest / working_voxel_mm).min(f64::from(deepest) / 2.0);
    if voxels < LEAST_ENLARGED { 1.0 } else { voxels }
}

/// The smooth outer surface of the mask in the world.
fn object_mesh(solid: &Solid, cancel: &dyn Cancel) -> Result<TriangleMesh, Cancelled> {
    let mesh = zero_surface(&solid.level.field.0, cancel)?;
    let mut triangles = mesh.triangles;
    if solid.world_from_work.matrix().determinant() < 0.0 {
        for triangle in &mut triangles {
            triangle.swap(1, 2);
        }
    }
    Ok(TriangleMesh { positions: solid.in_world(&mesh.positions), triangles })
}

impl Solid {
    /// The most superior direction across another; across one that runs up or down the most anterior.
    #[must_use]
    pub(in crate::pipeline) fn superior_across(&self, direction: Vector3<f64>) -> Vector3<f64> {
        let matrix = self.world_from_work.matrix();
        let axis = |row: usize| matrix.fixed_view::<1, 3>(row, 0).transpose().normalize();
        let across = |v: Vector3<f64>| v - direction * v.dot(&direction);
        let up = across(axis(2));
        let seam = if up.norm() > 0.5 { up } else { across(axis(1)) };
        seam.try_normalize(1e-9).unwrap_or_else(Vector3::x)
    }

    /// Whether tunnels lead through it.
    #[must_use]
    pub fn has_tunnels(&self) -> bool {
        self.tunnels > 0
    }

    /// The same solid in a unit of so many working voxels.
    pub(in crate::pipeline) fn in_units(self, voxels_per_unit: f64) -> Self {
        Self {
            level: self.level.in_units(voxels_per_unit),
            world_from_work: self.world_from_work.enlarged([voxels_per_unit; 3]),
            unit_mm: self.working_voxel_mm * voxels_per_unit,
            ..self
        }
    }

    /// The same solid with its boundary moved along with the level, so that it encloses what the mask does: smoothing takes
    /// half the variance over the radius off a tube, and nothing off a plate. With the depth below it.
    ///
    /// # Errors
    /// When it is cancelled.
    pub(in crate::pipeline) fn with_volume_of_mask(&self, context: &Context<'_>) -> Result<(Self, Depth), Cancelled> {
        let k = self.voxels_per_grain;
        let grid = &self.level.field.0;
        let mask_voxels = self.native.mask.as_slice().iter().filter(|is_in| **is_in).count() as f64;
        let wanted = mask_voxels * self.native.world_from_voxel.voxel_volume_mm3() / self.working_voxel_mm.powi(3);
        let mut near: Vec<f32> = grid.as_slice().iter().copied().filter(|level| *level > -MOST_SHIFT).collect();
        let place = floor_index(wanted).clamp(1, near.len().max(1)) - 1;
        let shift = if near.is_empty() {
            0.0
        } else {
            let (_, level, _) = near.select_nth_unstable_by(place, |a, b| b.total_cmp(a));
            level.clamp(-MOST_SHIFT, MOST_SHIFT)
        };
        let mut level = grid.try_map(|level| level - shift, context)?;
        let Piece { inside, lumens } = keep_one_piece(&mut level, self.lumens, context)?;
        let in_voxels = Self {
            inside,
            lumens,
            level: Level::new(level),
            world_from_work: self.world_from_work.enlarged([1.0 / k; 3]),
            unit_mm: self.working_voxel_mm,
            native: self.native.clone(),
            ..*self
        };
        let depth = depth::depth(&in_voxels, context)?;
        Ok((in_voxels.in_units(k), depth.in_units(k)))
    }

    /// How many of the voxels of a cube from `first` on, `edge` voxels wide, are inside; those at the boundary in part.
    #[must_use]
    pub(crate) fn share_of_block(&self, first: [usize; 3], edge: usize) -> f64 {
        let (grid, mut sum) = (&self.level.field.0, 0.0);
        let end = [0, 1, 2].map(|axis| (first[axis] + edge).min(grid.dims()[axis]));
        for k in first[2]..end[2] {
            for j in first[1]..end[1] {
                for i in first[0]..end[0] {
                    let at = [i, j, k];
                    let level = f64::from(grid[at]);
                    // What is positive beside the one piece of the solid is none of it.
                    sum += if level > 0.0 && !self.inside[at] { 0.0 } else { (level + 0.5).clamp(0.0, 1.0) };
                }
            }
        }
        sum
    }

    /// The boundary as triangles, counter-clockwise seen from outside, in work space.
    ///
    /// # Errors
    /// When it is cancelled.
    pub(crate) fn skin_mesh(&self, voxels_per_unit: f64, cancel: &dyn Cancel) -> Result<Mesh, Cancelled> {
        let mut mesh = zero_surface(&self.level.field.0, cancel)?;
        for position in &mut mesh.positions {
            *position /= voxels_per_unit;
        }
        Ok(mesh)
    }

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
