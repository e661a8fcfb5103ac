//! Stage `sides`: the upper and lower side of each sheet, and the crest between them (section 2.3 of
//! the paper).
//!
//! The skin point that an inscribed ball touches belongs to that ball's medial point: the ball
//! nearest in power distance. It is upper or lower by the side of the sheet it lies on, and
//! crest where the vector to it leans more than `CREST_COSINE` out of the normal: there it
//! comes from the sheet's rim. Skin that no ball comes near, beyond the end of a sheet, is crest too.

use nalgebra::{Point3, Vector3};

use crate::pipeline::sheets::inscribed::Inscribed;
mod orientation;

use self::orientation::upward_normals;
use crate::cancel::{Cancel, Cancelled};
use crate::numerics::field::id;
use crate::numerics::parallel::{POINTS_PER_TASK, each};
use crate::numerics::topology::cube;
use crate::pipeline::PipelineError;
use crate::pipeline::context::Context;
use crate::pipeline::medial::MedialSurface;
use crate::pipeline::sheets::{Hinge, Sheets};
use crate::pipeline::solid::Solid;
use crate::pipeline::solid::depth::Depth;
use crate::pipeline::surface::{Places, Surface, picked};

pub use self::orientation::{agreeing_normals, is_orientable};

/// Cosine between a spoke and the sheet's normal below which the skin point is crest: 60°. With less, the rim's
/// round skin is of both sides, and they are laid flat far beyond the sheet; with more, slanted sides count as crest.
const CREST_COSINE: f64 = 0.5;
/// How far a skin point may lie outside of its ball, in voxels and as a share of the radius. Further
/// off, beyond the end of the sheet, the skin is crest. With less, noise on the boundary makes holes in the sides.
const BALL_GAP: f64 = 1.0;
/// See [`BALL_GAP`].
const BALL_GAP_SHARE: f64 = 0.25;

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
/// [`Refusal::NotOrientable`](crate::model::Refusal::NotOrientable) when a sheet has one side only; when it is
/// cancelled.
pub fn sides(
    solid: &Solid,
    depth: &Depth,
    surface: &MedialSurface,
    sheets: &Sheets,
    context: &Context<'_>,
) -> Result<Vec<SheetSides>, PipelineError> {
    let mut all = Vec::new();
    let mut seats = vec![None; surface.points.len()];
    for (number, members) in sheets.members.iter().enumerate() {
        let sheet = id(number);
        let (members, medial) = largest_part(surface.part(members, context)?, members, context)?;
        let normals = upward_normals(surface, &members, &medial, solid, context)?;
        for (local, (&p, &normal)) in members.iter().zip(&normals).enumerate() {
            seats[p as usize] = Some(Seat { sheet, local: id(local), normal });
        }
        let radii = members.iter().map(|&p| surface.point(p).radius).collect();
        let hinge = met_at(surface, &sheets.hinges, sheet);
        all.push(SheetSides { medial, normals, radii, hinge, ..SheetSides::default() });
    }
    let classes = classified(depth, surface, &seats, &mut all, context)?;
    for (sheet, [upper, lower]) in all.iter_mut().zip(classes) {
        let (above, below) = rayon::join(|| one_piece(depth, &upper, context), || one_piece(depth, &lower, context));
        (sheet.upper, sheet.lower) = (above?, below?);
        sheet.crest += upper.skin.len() + lower.skin.len() - sheet.upper.partners.len() - sheet.lower.partners.len();
    }
    Ok(all)
}

/// A medial point's place in the sheet that it is of.
#[derive(Clone, Copy)]
struct Seat {
    sheet: u32,
    /// Its index in the sheet.
    local: u32,
    /// Unit normal, towards the upper side.
    normal: Vector3<f64>,
}

/// The skin of one side of a sheet.
#[derive(Clone, Debug, Default)]
struct Class {
    /// Skin points, ascending.
    skin: Vec<u32>,
    /// The medial point of the sheet that each belongs to.
    partners: Vec<u32>,
}

/// The largest connected piece of a surface, and what its points are by the names of those of the whole.
fn largest_part(whole: Surface, names: &[u32], cancel: &dyn Cancel) -> Result<(Vec<u32>, Surface), Cancelled> {
    let kept = whole.largest_piece(cancel)?;
    let part = if kept.len() < names.len() { whole.part(&kept, cancel)? } else { whole };
    Ok((picked(names, &kept), part))
}

/// The medial points of all hinges of a sheet.
fn met_at(surface: &MedialSurface, hinges: &[Hinge], sheet: u32) -> Vec<Point3<f64>> {
    let mut points = Vec::new();
    for hinge in hinges {
        if hinge.sheets.contains(&sheet) {
            for &p in &hinge.points {
                points.push(surface.point(p).position);
            }
        }
    }
    points
}

/// The upper and the lower class of each sheet; what is neither is counted as crest.
fn classified(
    depth: &Depth,
    surface: &MedialSurface,
    seats: &[Option<Seat>],
    sheets: &mut [SheetSides],
    cancel: &dyn Cancel,
) -> Result<Vec<[Class; 2]>, Cancelled> {
    let mut classes = vec![[Class::default(), Class::default()]; sheets.len()];
    let owners = Inscribed::of(surface, |p| seats[p].is_some(), cancel)?.of_skin(depth, cancel)?;
    for ((s, skin), owner) in depth.skin.iter().enumerate().zip(owners) {
        cancel.check()?;
        let Some((p, gap)) = owner else { continue };
        let Some(Seat { sheet, local, normal }) = seats[p] else { continue };
        let medial = &surface.points[p];
        let spoke = (skin.position - medial.position).try_normalize(1e-9).unwrap_or_else(Vector3::zeros);
        let height = spoke.dot(&normal);
        if height.abs() < CREST_COSINE || gap > BALL_GAP + BALL_GAP_SHARE * medial.radius {
            sheets[sheet as usize].crest += 1;
        } else {
            let class = &mut classes[sheet as usize][usize::from(height < 0.0)];
            class.skin.push(id(s));
            class.partners.push(local);
        }
    }
    Ok(classes)
}

/// The largest connected piece of a side; what is cut off from it counts as crest.
fn one_piece(depth: &Depth, class: &Class, cancel: &dyn Cancel) -> Result<Side, Cancelled> {
    let positions = class.skin.iter().map(|&s| depth.skin[s as usize].position).collect();
    let places = Places::of(&class.skin, depth.skin.len());
    let list = |s: &u32| places.of_those(&touching_skin(depth, *s));
    let whole = Surface { positions, adjacency: each(&class.skin, POINTS_PER_TASK, list, cancel)? };
    let (partners, surface) = largest_part(whole, &class.partners, cancel)?;
    Ok(Side { surface, partners })
}

/// The skin points of the voxels around that of one, ascending. Skin is never on the edge of the grid.
fn touching_skin(depth: &Depth, s: u32) -> Vec<u32> {
    let [nx, ny, _] = depth.depth.dims();
    let own = depth.skin_voxels[s as usize];
    let mut touching = Vec::new();
    for voxel in cube(own, nx, nx * ny) {
        if voxel != own {
            touching.extend(depth.skin_at(voxel));
        }
    }
    touching
}
