//! Stage 4: the upper and lower side of each sheet, and the crest between them (section 2.3 of
//! the paper).
//!
//! The skin point that an inscribed ball touches belongs to that ball's medial point: the ball
//! nearest in power distance. It is upper or lower by the side of the sheet it lies on, and
//! crest where the vector to it leans more than [`CREST_COSINE`] out of the normal: there it
//! comes from the sheet's rim. Skin that no ball comes near, beyond the end of a sheet, is crest too.

use std::cmp::Reverse;
use std::collections::BinaryHeap;

use nalgebra::{Point3, Vector3};

use crate::numerics::components::{Connectivity, neighbors};
use crate::numerics::field::id;

use crate::cancel::{Cancel, Cancelled};
use crate::model::Refusal;
use crate::pipeline::PipelineError;
use crate::pipeline::context::Context;
use crate::pipeline::medial::MedialSurface;
use crate::pipeline::sheets::surface::Surface;
use crate::pipeline::sheets::{Inscribed, Sheets};
use crate::pipeline::solid::Solid;
use crate::pipeline::solid::depth::Depth;

/// Cosine between a spoke and the sheet's normal below which the skin point is crest: 60°.
const CREST_COSINE: f64 = 0.5;
/// How far a skin point may lie outside of its ball, in voxels and as a share of the radius. Further
/// off, beyond the end of the sheet, the skin is crest.
const BALL_GAP: f64 = 1.0;
/// See [`BALL_GAP`].
const BALL_GAP_SHARE: f64 = 0.25;
/// Cosine of the feet of points whose normal is beyond doubt, for the orientability test.
const SURE_FEET_COSINE: f64 = -0.7;
/// Cosine below which two touching, sure normals disagree.
const CONFLICT_COSINE: f64 = -0.5;
/// Disagreeing links below which they are noise: a strip of a Möbius band has one across its
/// whole width.
const MIN_CONFLICTS: usize = 10;

/// One side of a sheet.
#[derive(Clone, Debug, Default)]
pub struct Side {
    /// Its skin points.
    pub surface: Surface,
    /// The medial point of each, an index into [`SheetSides::medial`].
    pub partners: Vec<u32>,
}

/// A sheet with its sides.
#[derive(Clone, Debug, Default)]
pub struct SheetSides {
    /// The medial points of the sheet.
    pub medial: Surface,
    /// Unit normals of the medial points, towards the upper side.
    pub normals: Vec<Vector3<f64>>,
    /// Radius of the inscribed ball at each, voxels.
    pub radii: Vec<f64>,
    /// The upper side.
    pub upper: Side,
    /// The lower side.
    pub lower: Side,
    /// Skin points of the crest.
    pub crest: usize,
    /// Medial points where this sheet meets others, on both sides of the hinges.
    pub hinge: Vec<Point3<f64>>,
}

/// Splits the skin into the sides of the sheets.
///
/// # Errors
/// [`Refusal::NotOrientable`] when a sheet has one side only; when it is cancelled.
pub fn sides(
    solid: &Solid,
    depth: &Depth,
    surface: &MedialSurface,
    sheets: &Sheets,
    context: &Context<'_>,
) -> Result<Vec<SheetSides>, PipelineError> {
    let mut all = Vec::new();
    let mut normal_of = vec![Vector3::zeros(); surface.points.len()];
    let mut local_of = vec![u32::MAX; surface.points.len()];
    for (number, members) in sheets.members.iter().enumerate() {
        let whole = surface.part(members, context)?;
        let kept = whole.largest_piece(context)?;
        let medial = if kept.len() < members.len() { whole.part(&kept, context)? } else { whole };
        let members: Vec<u32> = kept.into_iter().map(|k| members[k as usize]).collect();
        let mut normals = oriented_normals(surface, &members, &medial, context)?;
        let mean = normals.iter().map(|n| solid.world_from_work.vector(*n)).sum();
        if solid.senses.of_direction(mean).sign < 0.0 {
            normals.iter_mut().for_each(|n| *n = -*n);
        }
        for (local, (&p, n)) in members.iter().zip(&normals).enumerate() {
            normal_of[p as usize] = *n;
            local_of[p as usize] = id(local);
        }
        let radii = members.iter().map(|&p| surface.points[p as usize].radius).collect();
        let met = sheets.hinges.iter().filter(|h| h.sheets.contains(&id(number)));
        let hinge = met.flat_map(|h| &h.points).map(|&p| surface.points[p as usize].position).collect();
        all.push(SheetSides { medial, normals, radii, hinge, ..SheetSides::default() });
    }
    let mut classes: Vec<[Vec<(u32, u32)>; 2]> = vec![[Vec::new(), Vec::new()]; all.len()];
    let owners = Inscribed::of(surface, |p| local_of[p] != u32::MAX, context)?.of_skin(depth, context)?;
    for ((s, point), owner) in depth.skin.iter().enumerate().zip(owners) {
        context.check()?;
        let Some((p, gap)) = owner else { continue };
        let sheet = sheets.sheet_of[p] as usize;
        let spoke = (point.position - surface.points[p].position).try_normalize(1e-9).unwrap_or_else(Vector3::zeros);
        let height = spoke.dot(&normal_of[p]);
        if height.abs() < CREST_COSINE || gap > BALL_GAP + BALL_GAP_SHARE * surface.points[p].radius {
            all[sheet].crest += 1;
        } else {
            classes[sheet][usize::from(height < 0.0)].push((id(s), local_of[p]));
        }
    }
    for (sheet, [upper, lower]) in all.iter_mut().zip(classes) {
        let piece = |class| move || one_piece(depth, class, context);
        let (above, below) = rayon::join(piece(&upper), piece(&lower));
        (sheet.upper, sheet.lower) = (above?, below?);
        sheet.crest += upper.len() + lower.len() - sheet.upper.partners.len() - sheet.lower.partners.len();
    }
    Ok(all)
}

/// The largest connected piece of a side; what is cut off from it counts as crest.
fn one_piece(depth: &Depth, class: &[(u32, u32)], cancel: &dyn Cancel) -> Result<Side, Cancelled> {
    let touching = |s: u32, list: &mut Vec<u32>| {
        neighbors(depth.depth.dims(), depth.skin_voxels[s as usize], Connectivity::Corners26, |n| {
            list.extend(depth.skin_at(n));
        });
    };
    let members: Vec<u32> = class.iter().map(|c| c.0).collect();
    let position = |s: u32| depth.skin[s as usize].position;
    let whole = Surface::made_of(&members, depth.skin.len(), position, touching, cancel)?;
    let kept = whole.largest_piece(cancel)?;
    let surface = if kept.len() < members.len() { whole.part(&kept, cancel)? } else { whole };
    Ok(Side { surface, partners: kept.iter().map(|&k| class[k as usize].1).collect() })
}

/// Whether a sheet (ascending medial points) has two sides.
///
/// # Errors
/// When it is cancelled.
pub fn is_orientable(surface: &MedialSurface, members: &[u32], cancel: &dyn Cancel) -> Result<bool, Cancelled> {
    match oriented_normals(surface, members, &surface.part(members, cancel)?, cancel) {
        Ok(_) => Ok(true),
        Err(PipelineError::Refused(_)) => Ok(false),
        Err(PipelineError::Cancelled(stop)) => Err(stop),
    }
}

/// Normals of a sheet's points, consistent along the sheet and smoothed over touching points.
fn oriented_normals(
    surface: &MedialSurface,
    members: &[u32],
    medial: &Surface,
    cancel: &dyn Cancel,
) -> Result<Vec<Vector3<f64>>, PipelineError> {
    let mut normals: Vec<Vector3<f64>> = members.iter().map(|&p| surface.points[p as usize].normal).collect();
    propagate(medial, &mut normals, cancel)?;
    let is_sure = |k: usize| surface.points[members[k] as usize].feet_cosine < SURE_FEET_COSINE;
    check_orientable(medial, &normals, is_sure)?;
    for _ in 0..2 {
        cancel.check()?;
        normals = smoothed(medial, &normals);
    }
    Ok(normals)
}

/// Turns normals to agree with their neighbours, along the links where they are most parallel
/// first (a maximum spanning tree; Hoppe et al., SIGGRAPH 1992).
fn propagate(medial: &Surface, normals: &mut [Vector3<f64>], cancel: &dyn Cancel) -> Result<(), Cancelled> {
    let mut is_done = vec![false; normals.len()];
    for start in 0..normals.len() {
        let mut heap = BinaryHeap::new();
        heap.push((0u64, Reverse(id(start)), id(start)));
        while let Some((_, Reverse(to), from)) = heap.pop() {
            cancel.check()?;
            let (to, from) = (to as usize, from as usize);
            if std::mem::replace(&mut is_done[to], true) {
                continue;
            }
            if normals[to].dot(&normals[from]) < 0.0 {
                normals[to] = -normals[to];
            }
            for &next in &medial.adjacency[to] {
                if !is_done[next as usize] {
                    let parallel = normals[to].dot(&normals[next as usize]).abs();
                    heap.push((parallel.to_bits(), Reverse(next), id(to)));
                }
            }
        }
    }
    Ok(())
}

fn check_orientable(
    medial: &Surface,
    normals: &[Vector3<f64>],
    is_sure: impl Fn(usize) -> bool,
) -> Result<(), Refusal> {
    let (mut conflicts, mut links) = (0, 0);
    for (a, list) in medial.adjacency.iter().enumerate() {
        for &b in list {
            let b = b as usize;
            if a < b && is_sure(a) && is_sure(b) {
                links += 1;
                conflicts += usize::from(normals[a].dot(&normals[b]) < CONFLICT_COSINE);
            }
        }
    }
    if conflicts >= MIN_CONFLICTS { Err(Refusal::NotOrientable { conflicts, links }) } else { Ok(()) }
}

fn smoothed(medial: &Surface, normals: &[Vector3<f64>]) -> Vec<Vector3<f64>> {
    let mean = |k: usize| {
        let around: Vector3<f64> = medial.adjacency[k].iter().map(|&n| normals[n as usize]).sum();
        (normals[k] + around).try_normalize(1e-9).unwrap_or(normals[k])
    };
    (0..normals.len()).map(mean).collect()
}
