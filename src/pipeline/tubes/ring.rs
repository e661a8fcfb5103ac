//! A ring of round sections: one tube that meets itself.
//!
//! 1. A wave from any place of it parts into two arms that meet again ([`is_ring`]);
//! 2. it is opened by a half-plane from its axis, in a direction of the world ([`Cut`]);
//! 3. a harmonic function grows from one bank of the cut to the other: its level sets go on through the cut, so the nodes
//!    of both banks are the same.

use nalgebra::{Point3, Vector3};

use super::Tubes;
use super::cells::Cells;
use super::draft::draft;
use super::drain::Drain;
use super::line::{End, Line};
use super::sections::Skin;
use super::tree::Branch;
use super::wall::Laying;
use super::{Fork, SPLIT};
use crate::cancel::Cancelled;
use crate::pipeline::context::Context;
use crate::pipeline::solid::Solid;
use crate::pipeline::solid::depth::Depth;

/// Branches that a wave makes of a ring: where it begins, two arms, and where they meet.
const BRANCHES: usize = 4;
/// Way from one bank of the cut round to the other, in largest depths, from which the cut opened a ring: the narrowest ring
/// of round sections has π on its inside.
const ROUND: f64 = 3.0;

/// A half-plane through which no way leads.
#[derive(Clone, Copy, Debug)]
pub struct Cut {
    /// A place on its edge.
    through: Point3<f64>,
    /// From its edge into it.
    outward: Vector3<f64>,
    /// Across it, from the last section to the first.
    across: Vector3<f64>,
}

impl Cut {
    /// Across a ring of cells, on the side of the middle that is most superior, of a ring that lies level the most anterior.
    fn of(cells: &Cells, solid: &Solid) -> Self {
        let (middle, axes) = cells.axes();
        let [.., normal] = axes.directions;
        let sign = solid.senses.of_direction(solid.world_from_work.vector(normal).normalize()).sign;
        let normal = if sign < 0.0 { -normal } else { normal };
        let outward = solid.superior_across(normal);
        Self { through: middle, outward, across: normal.cross(&outward) }
    }

    /// Whether it lies between two places near each other.
    #[must_use]
    pub fn parts(&self, a: Point3<f64>, b: Point3<f64>) -> bool {
        let [a, b] = [a, b].map(|place| place - self.through);
        let is_beside = a.dot(&self.outward) > 0.0 && b.dot(&self.outward) > 0.0;
        is_beside && (a.dot(&self.across) > 0.0) != (b.dot(&self.across) > 0.0)
    }

    /// Which bank a place beside it lies on: 0 where sections begin, 1 where they end.
    #[must_use]
    pub fn bank(&self, place: Point3<f64>) -> usize {
        usize::from((place - self.through).dot(&self.across) <= 0.0)
    }
}

/// Whether the branches of a solid are those of a ring and nothing else.
pub fn is_ring(branches: &[Branch]) -> bool {
    let is_arm = |branch: &Branch| branch.before.len() == 1 && branch.after.len() == 1;
    let arms: Vec<&Branch> = branches.iter().filter(|branch| is_arm(branch)).collect();
    let [one, other] = arms[..] else { return false };
    branches.len() <= BRANCHES && one.before == other.before && one.after == other.after
}

/// The tube round a ring; `None` when it has no one section where it is opened.
///
/// # Errors
/// When it is cancelled.
pub fn ring(solid: &Solid, depth: &Depth, cells: &Cells, context: &Context<'_>) -> Result<Option<Tubes>, Cancelled> {
    let cut = Cut::of(cells, solid);
    let banks = cells.banks(&cut);
    let deepest = cells.depths[cells.deepest()];
    let cells = cells.opened(cut);
    let [Some(&first), Some(_)] = [banks[0].first(), banks[1].first()] else { return Ok(None) };
    let lengths = cells.graph(context)?.geodesics(first, context)?;
    let way = banks[1].iter().map(|&cell| f64::from(lengths[cell])).fold(f64::INFINITY, f64::min);
    if !way.is_finite() || way < ROUND * deepest {
        return Ok(None);
    }
    let drain = Drain::between(&cells, &banks, context)?;
    let skin = Skin::of(solid.skin_mesh(depth.voxels_per_unit, context)?, &drain, context)?;
    let ends = skin.bank_values();
    if ends[0] >= ends[1] {
        return Ok(None);
    }
    let all: Vec<usize> = (0..cells.len()).collect();
    let Some(line) = Line::of(&cells, &all, &drain, ends.map(End::Joined)) else { return Ok(None) };
    let laying = Laying {
        solid,
        depth,
        skin: &skin,
        line: &line,
        branch: 0,
        ends: line.ends(depth),
        radius: line.median_radius(depth),
    };
    let Some((tube, split)) = draft(&laying, (0, false), context)? else { return Ok(None) };
    if split as f64 > SPLIT * tube.nodes.stations.len() as f64 {
        return Ok(None);
    }
    let forks = vec![Fork { tubes: vec![0, 0], places: vec![tube.nodes.centres[0]] }];
    Ok(Some(Tubes { drafts: vec![tube], forks }))
}
