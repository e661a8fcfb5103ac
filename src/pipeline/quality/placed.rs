//! Figures of several parts of a label, each with the ways from its work space to what they are held against together:
//! the label's own voxels, and the work space of the first part, in which lengths are compared.

use nalgebra::{Point3, Vector3};

use super::Answered;
use crate::model::FigurePatches;
use crate::pipeline::draft::AnyDraft;
use crate::pipeline::solid::NativeMask;
use crate::pipeline::solid::depth::{SKIN_REACH, SkinPoint};
use crate::space::{VoxelFromVoxel, WorldFromVoxel, WorldPoint};

/// A figure and where it lies.
pub struct Placed<'a> {
    /// The figure, in the work space of its part.
    pub draft: AnyDraft<'a>,
    /// The smooth surfaces through its nodes.
    pub patches: FigurePatches,
    /// Which of the answered parts it belongs to.
    pub part: usize,
    /// From there to the first part's work space.
    pub into_common: VoxelFromVoxel,
    /// From there to the voxels of the label.
    pub into_label: VoxelFromVoxel,
}

/// The figures of all parts in their order, each with its patches.
#[must_use]
pub fn placed<'a>(parts: &[Answered<'a>], patches: Vec<FigurePatches>, label: &NativeMask) -> Vec<Placed<'a>> {
    let (mut all, mut patches) = (Vec::new(), patches.into_iter());
    for (part, answered) in parts.iter().enumerate() {
        let work = &answered.solid.world_from_work;
        for (draft, patches) in answered.drafts.iter().zip(patches.by_ref()) {
            all.push(Placed {
                draft: *draft,
                patches,
                part,
                into_common: work.to(common(parts)),
                into_label: work.to(&label.world_from_voxel),
            });
        }
    }
    all
}

/// The work space that all are compared in.
#[must_use]
pub fn common<'a>(parts: &[Answered<'a>]) -> &'a WorldFromVoxel {
    &parts[0].solid.world_from_work
}

/// What is known of the label's surface, in the common space: the skin of every part's solid, and the surface that the
/// label has beside them.
#[must_use]
pub fn whole_skin(parts: &[Answered<'_>], unanswered: &[WorldPoint]) -> Vec<SkinPoint> {
    let common = common(parts);
    let mut skin = Vec::new();
    for answered in parts {
        let into_common = answered.solid.world_from_work.to(common);
        for point in answered.skin {
            skin.push(moved(*point, &into_common));
        }
        for place in &answered.changes.surface {
            skin.push(without_normal(common.voxel(*place)));
        }
    }
    for place in unanswered {
        skin.push(without_normal(common.voxel(*place)));
    }
    skin
}

/// A point of a surface in another space.
#[must_use]
pub fn moved(point: SkinPoint, into: &VoxelFromVoxel) -> SkinPoint {
    let normal = into.vector(point.normal).try_normalize(0.0).unwrap_or(point.normal);
    SkinPoint { position: into.point(point.position), normal, reach: point.reach }
}

/// A voxel of the surface, of which no normal is known.
fn without_normal(position: Point3<f64>) -> SkinPoint {
    SkinPoint { position, normal: Vector3::z(), reach: SKIN_REACH }
}
