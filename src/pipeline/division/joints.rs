//! Where the portions of a solid meet.

use nalgebra::Point3;
use std::collections::BTreeMap;

use super::Group;
use crate::cancel::{Cancel, Cancelled};
use crate::model::{Shell, Side};
use crate::numerics::balls::Balls;
use crate::pipeline::draft::AnyDraft;
use crate::pipeline::solid::Solid;

/// How deep in the solid, by its level, what is of a portion's skin and not of the solid's lies: the level is 0 on the skin and
/// half in voxels further in. With 0.1 or 0.4 an eighth more or fewer of the skin is of the cut.
const WITHIN: f64 = 0.25;
/// How far apart figures are that meet, grains: the cut is a grain or two from the nodes on either side. With 2 an eighth of the
/// cut is of no joint; with 8 it is 2 % more.
const MEET_WITHIN: f64 = 4.0;

/// Where two figures of different groups meet.
pub struct Joint {
    /// Their numbers among the figures of all groups.
    pub figures: [usize; 2],
    /// Places on the cut between them.
    pub places: Vec<Point3<f64>>,
}

/// Where the figures of groups meet: the places of the skin of a portion that are inside of the solid, each with the nearest figure
/// of its own group and the nearest of the others.
///
/// # Errors
/// When it is cancelled.
pub(super) fn joints(solid: &Solid, groups: &[Group], cancel: &dyn Cancel) -> Result<Vec<Joint>, Cancelled> {
    if groups.len() < 2 {
        return Ok(Vec::new());
    }
    let outers = Outers::of(groups, cancel)?;
    let mut joints: BTreeMap<[usize; 2], Vec<Point3<f64>>> = BTreeMap::new();
    for (own, group) in groups.iter().enumerate() {
        for point in &group.skin {
            cancel.check()?;
            if solid.level.at(point.position) >= WITHIN
                && let Some(figures) = outers.meeting(own, point.position)
            {
                joints.entry(figures).or_default().push(point.position);
            }
        }
    }
    Ok(joints.into_iter().map(|(figures, places)| Joint { figures, places }).collect())
}

/// The outer nodes of all groups.
struct Outers {
    of_groups: Vec<Outer>,
    /// The number of each group's first figure among those of all.
    first: Vec<usize>,
}

impl Outers {
    fn of(groups: &[Group], cancel: &dyn Cancel) -> Result<Self, Cancelled> {
        let (mut of_groups, mut first, mut figures) = (Vec::new(), Vec::new(), 0);
        for group in groups {
            let outer = Outer::of(group, cancel)?;
            first.push(figures);
            figures += outer.figures;
            of_groups.push(outer);
        }
        Ok(Self { of_groups, first })
    }

    /// The figure of a group that is nearest to a place, and the nearest of other groups, in their order; `None` where that is far.
    fn meeting(&self, own: usize, place: Point3<f64>) -> Option<[usize; 2]> {
        let (figure, _) = self.of_groups[own].nearest(place)?;
        let mut nearest: Option<(f64, usize)> = None;
        for (other, outer) in self.of_groups.iter().enumerate().filter(|(other, _)| *other != own) {
            let Some((figure, distance)) = outer.nearest(place) else { continue };
            if distance < nearest.map_or(MEET_WITHIN, |nearest| nearest.0) {
                nearest = Some((distance, self.first[other] + figure));
            }
        }
        let mut pair = [self.first[own] + figure, nearest?.1];
        pair.sort_unstable();
        Some(pair)
    }
}

/// The outer nodes of the figures of a group.
struct Outer {
    nodes: Vec<Point3<f64>>,
    balls: Balls,
    figure_of: Vec<usize>,
    figures: usize,
}

impl Outer {
    fn of(group: &Group, cancel: &dyn Cancel) -> Result<Self, Cancelled> {
        let (mut nodes, mut figure_of, mut figures) = (Vec::new(), Vec::new(), 0);
        for draft in group.figures.drafts() {
            nodes.extend(outer_nodes(draft));
            figure_of.resize(nodes.len(), figures);
            figures += 1;
        }
        let balls: Vec<(Point3<f64>, f64)> = nodes.iter().map(|node| (*node, 0.0)).collect();
        Ok(Self { balls: Balls::new(&balls, cancel)?, nodes, figure_of, figures })
    }

    /// The figure with the nearest node, and how far that is.
    fn nearest(&self, place: Point3<f64>) -> Option<(usize, f64)> {
        let node = self.balls.nearest(place)?;
        Some((self.figure_of[node], (self.nodes[node] - place).norm()))
    }
}

/// The nodes of a figure on the skin.
fn outer_nodes(draft: AnyDraft<'_>) -> Vec<Point3<f64>> {
    match draft {
        AnyDraft::Tube(draft) => draft.nodes.wall.clone(),
        AnyDraft::Sheet(draft) => {
            let shell = Shell::from(&draft.nodes);
            let mut nodes = Vec::new();
            for side in Side::BOTH {
                nodes.extend_from_slice(shell.side(side));
            }
            nodes.extend_from_slice(&draft.nodes.crest);
            nodes
        }
    }
}
