//! Normals of a sheet that agree with one another, if there are such.

use nalgebra::Vector3;

use crate::cancel::{Cancel, Cancelled};
use crate::model::Refusal;
use crate::numerics::moments::mean;
use crate::numerics::spanning::along_strongest;
use crate::pipeline::PipelineError;
use crate::pipeline::medial::MedialSurface;
use crate::pipeline::solid::Solid;
use crate::pipeline::surface::Surface;

/// Cosine of the feet of points whose normal is beyond doubt, for the orientability test: 135°. Nearer to the rim, where
/// feet are seen under smaller angles, normals turn with every bump.
const SURE_FEET_COSINE: f64 = -0.7;
/// Cosine below which two touching, sure normals disagree: 120°. However sharply a sheet bends, normals of touching
/// points differ by a right angle or so; where they were turned wrongly, by nearly 180°.
const CONFLICT_COSINE: f64 = -0.5;
/// Disagreeing links below which they are noise: a strip of a Möbius band has one across its
/// whole width.
const MIN_CONFLICTS: usize = 10;
/// Length of the mean of unit normals below which a sheet closes round, so that none of its sides is upper: a band has 0, half a
/// tube 0.64, a bowl of 150°, the most closed one that stays whole, 0.07.
const CLOSED: f64 = 0.05;
/// How often normals are smoothed over touching points: enough to take the grid out of them, few enough to leave a bend
/// of a few voxels. With none or 6, nothing changes but by chance.
const SMOOTHINGS: usize = 2;

/// Whether a sheet (ascending medial points) has two sides.
///
/// # Errors
/// When it is cancelled.
pub fn is_orientable(surface: &MedialSurface, members: &[u32], cancel: &dyn Cancel) -> Result<bool, Cancelled> {
    Ok(agreeing_normals(surface, members, cancel)?.is_some())
}

/// Unit normals of a sheet's points (ascending) that agree along it; `None` where it has one side.
///
/// # Errors
/// When it is cancelled.
pub fn agreeing_normals(
    surface: &MedialSurface,
    members: &[u32],
    cancel: &dyn Cancel,
) -> Result<Option<Vec<Vector3<f64>>>, Cancelled> {
    match oriented_normals(surface, members, &surface.part(members, cancel)?, cancel) {
        Ok(normals) => Ok(Some(normals)),
        Err(PipelineError::Refused(_)) => Ok(None),
        Err(PipelineError::Cancelled(stop)) => Err(stop),
    }
}

/// Normals of a sheet's points towards its upper side: the one that is so in the world, on average, and of a sheet that closes
/// round the one that is outside.
pub(super) fn upward_normals(
    surface: &MedialSurface,
    members: &[u32],
    medial: &Surface,
    solid: &Solid,
    cancel: &dyn Cancel,
) -> Result<Vec<Vector3<f64>>, PipelineError> {
    let mut normals = oriented_normals(surface, members, medial, cancel)?;
    let sum: Vector3<f64> = normals.iter().sum();
    let is_closed = sum.norm() < CLOSED * normals.len() as f64;
    let is_lower = if is_closed {
        let middle = mean(&medial.positions);
        medial.positions.iter().zip(&normals).map(|(p, normal)| (p.coords - middle).dot(normal)).sum::<f64>() < 0.0
    } else {
        solid.senses.of_direction(solid.world_from_work.vector(sum)).sign < 0.0
    };
    if is_lower {
        for normal in &mut normals {
            *normal = -*normal;
        }
    }
    Ok(normals)
}

/// Normals of a sheet's points, consistent along the sheet and smoothed over touching points.
fn oriented_normals(
    surface: &MedialSurface,
    members: &[u32],
    medial: &Surface,
    cancel: &dyn Cancel,
) -> Result<Vec<Vector3<f64>>, PipelineError> {
    let (mut normals, mut is_sure) = (Vec::new(), Vec::new());
    for &p in members {
        let point = surface.point(p);
        normals.push(point.normal);
        is_sure.push(point.feet_cosine < SURE_FEET_COSINE);
    }
    propagate(medial, &mut normals, cancel)?;
    check_orientable(medial, &normals, &is_sure)?;
    for _ in 0..SMOOTHINGS {
        cancel.check()?;
        normals = smoothed(medial, &normals);
    }
    Ok(normals)
}

/// Turns normals to agree with their neighbours, along the links where they are most parallel
/// first (a maximum spanning tree; Hoppe et al., SIGGRAPH 1992).
fn propagate(medial: &Surface, normals: &mut [Vector3<f64>], cancel: &dyn Cancel) -> Result<(), Cancelled> {
    let axes = normals.to_vec();
    let parallel = |a: usize, b: usize| axes[a].dot(&axes[b]).abs();
    let agree = |to: usize, from: usize| {
        if normals[to].dot(&normals[from]) < 0.0 {
            normals[to] = -normals[to];
        }
    };
    along_strongest(&medial.adjacency, parallel, agree, cancel)
}

/// Refuses a sheet on which normals that agree with their neighbours one by one do not all agree.
fn check_orientable(medial: &Surface, normals: &[Vector3<f64>], is_sure: &[bool]) -> Result<(), Refusal> {
    let (mut conflicts, mut links) = (0, 0);
    for (a, list) in medial.adjacency.iter().enumerate() {
        for &b in list {
            let b = b as usize;
            if a < b && is_sure[a] && is_sure[b] {
                links += 1;
                conflicts += usize::from(normals[a].dot(&normals[b]) < CONFLICT_COSINE);
            }
        }
    }
    if conflicts >= MIN_CONFLICTS { Err(Refusal::NotOrientable { conflicts, links }) } else { Ok(()) }
}

/// Each normal with those of the touching points, on average.
fn smoothed(medial: &Surface, normals: &[Vector3<f64>]) -> Vec<Vector3<f64>> {
    let mut smoothed = Vec::with_capacity(normals.len());
    for (&normal, touching) in normals.iter().zip(&medial.adjacency) {
        let around: Vector3<f64> = touching.iter().map(|&n| normals[n as usize]).sum();
        smoothed.push((normal + around).try_normalize(1e-9).unwrap_or(normal));
    }
    smoothed
}
