//! A tube on its way through the stages: its nodes, and what is said of them.

use nalgebra::{Point2, Point3, Vector3};

use super::line::Line;
use super::mend::mended;
use super::size::size;
use super::wall::{Laying, TubeNodes};
use crate::cancel::Cancelled;
use crate::model::{Automatic, FrameFacts, FrameRule, KindEvidence, LatticeSize, NodeRepair, Repair, TubeShell};
use crate::numerics::polyline::vector_area;
use crate::numerics::stats::median;
use crate::pipeline::context::Context;
use crate::pipeline::solid::Solid;
use crate::space::WorldVector;

/// A tube on its way through the stages, in work space.
#[derive(Clone, Debug)]
pub struct TubeDraft {
    /// Its nodes.
    pub nodes: TubeNodes,
    /// Inscribed radius at the centre of each column.
    pub radii: Vec<f64>,
    /// The largest depth in the section of each.
    pub deepest: Vec<f64>,
    /// See [`KindEvidence::flatness`].
    pub flatness: f64,
    /// What was done to each node.
    pub repaired: Vec<Option<NodeRepair>>,
    /// What was repaired.
    pub repair: Repair,
    /// Lengths along and around of each node.
    pub intrinsic: Vec<Point2<f64>>,
    /// Which way it lies in the world.
    pub frame: FrameFacts,
    /// What was chosen for it.
    pub choices: Automatic,
    /// The number of the tube that it leaves.
    pub parent: Option<usize>,
    /// The same with the nodes that are asked for, where these are only there to choose by.
    pub asked: Option<Box<Self>>,
}

impl TubeDraft {
    /// The tube with the nodes that are asked for.
    #[must_use]
    pub fn into_asked(mut self) -> Self {
        let Some(asked) = self.asked.take() else { return self };
        let choices = Automatic { kind: self.choices.kind, ..asked.choices };
        Self { choices, parent: self.parent, ..*asked }
    }
}

impl<'a> From<&'a TubeNodes> for TubeShell<'a> {
    fn from(nodes: &'a TubeNodes) -> Self {
        Self { size: nodes.size, centres: &nodes.centres, wall: &nodes.wall, tips: nodes.tips }
    }
}

impl<'a> From<&'a TubeDraft> for TubeShell<'a> {
    fn from(draft: &'a TubeDraft) -> Self {
        (&draft.nodes).into()
    }
}

/// The tube that is laid so, and how many of its sections have several curves; `None` without a wall. Where the number of its nodes
/// is asked for, it comes with another one that follows its shape, which is the one to choose by.
///
/// # Errors
/// When it is cancelled.
pub(super) fn draft(
    laying: &Laying<'_>,
    which: (usize, bool),
    context: &Context<'_>,
) -> Result<Option<(TubeDraft, usize)>, Cancelled> {
    let Some(params) = context.params_of_shape() else { return draft_of_size(laying, which, context) };
    let by_shape = context.with_params(&params);
    let Some((mut tube, several)) = draft_of_size(laying, which, &by_shape)? else { return Ok(None) };
    let Some((asked, _)) = draft_of_size(laying, which, context)? else { return Ok(None) };
    tube.asked = Some(Box::new(asked));
    Ok(Some((tube, several)))
}

/// A tube whose size the parameters say.
fn draft_of_size(
    laying: &Laying<'_>,
    (number, is_round): (usize, bool),
    context: &Context<'_>,
) -> Result<Option<(TubeDraft, usize)>, Cancelled> {
    let Laying { solid, depth, line, radius, .. } = *laying;
    let Some((size, grid_from)) = size(laying, number, context)? else { return Ok(None) };
    let Some((mut nodes, several)) = laying.nodes(size, context)? else { return Ok(None) };
    let between = nodes.stations.len();
    let mended = mended(solid, &mut nodes, context)?;
    let radii: Vec<f64> = nodes.centres.iter().map(|centre| depth.at(*centre)).collect();
    let frame = frame(solid, &nodes, (line.length() / (2.0 * radius), is_round));
    if !frame.ambiguities.is_empty() {
        let message = format!("another frame of tube {number} is as good: {}", frame.ambiguities.join("; "));
        context.warn("frame_ambiguous", message);
    }
    let flatness = flatness(&nodes, &radii);
    let evidence = KindEvidence {
        width_in_radii: None,
        flatness: Some(flatness),
        split_share: Some(several as f64 / between.max(1) as f64),
        elongation: Some(line.length() / (2.0 * radius)),
        sheet_overlap: None,
        tube_overlap: None,
    };
    let choices = Automatic {
        kind: Some(evidence),
        grid_from,
        length_mm: line.length() * solid.unit_mm,
        width_mm: 2.0 * radius * solid.unit_mm,
        ..Automatic::default()
    };
    let draft = TubeDraft {
        repair: repair(&mended.repaired, mended.folds_before),
        repaired: mended.repaired,
        intrinsic: intrinsic(&nodes),
        deepest: deepest(line, &nodes, &radii),
        flatness,
        radii,
        frame,
        choices,
        nodes,
        parent: None,
        asked: None,
    };
    Ok(Some((draft, several)))
}

/// See [`KindEvidence::flatness`]: over the columns between the caps.
fn flatness(nodes: &TubeNodes, radii: &[f64]) -> f64 {
    let between = nodes.caps[0]..nodes.size.cols - nodes.caps[1];
    let mut ratios = Vec::with_capacity(between.len());
    for (col, radius) in between.clone().zip(&radii[between]) {
        let mut ring: Vec<Vector3<f64>> = nodes.ring(col).iter().map(|wall| wall - nodes.centres[col]).collect();
        ring.push(ring[0]);
        let area = vector_area(&ring).norm();
        ratios.push((area / std::f64::consts::PI).sqrt() / radius.max(1e-9));
    }
    median(ratios).unwrap_or(1.0)
}

/// The largest depth in the section of each column, that of its centre at the least.
fn deepest(line: &Line, nodes: &TubeNodes, radii: &[f64]) -> Vec<f64> {
    let between = nodes.size.cols - nodes.caps[0] - nodes.caps[1];
    let mut deepest = radii.to_vec();
    for n in 0..between {
        let col = nodes.caps[0] + n;
        deepest[col] = deepest[col].max(line.deepest(nodes.stations[n]).0);
    }
    deepest
}

/// Lengths along and around of each node: along, those of the centreline, and in caps those of the wall.
fn intrinsic(nodes: &TubeNodes) -> Vec<Point2<f64>> {
    let LatticeSize { rows, cols } = nodes.size;
    let mut along = vec![0.0; cols];
    for col in 1..cols {
        let moved = (nodes.centres[col] - nodes.centres[col - 1]).norm();
        let mean = |row: usize| (nodes.wall_at(row, col) - nodes.wall_at(row, col - 1)).norm() / rows as f64;
        let step = if moved > 1e-9 { moved } else { (0..rows).map(mean).sum() };
        along[col] = along[col - 1] + step;
    }
    let mut places = vec![Point2::origin(); rows * cols];
    for col in 0..cols {
        let mut around = 0.0;
        for row in 0..rows {
            places[nodes.node(row, col)] = Point2::new(along[col], around);
            around += (nodes.wall_at(row + 1, col) - nodes.wall_at(row, col)).norm();
        }
    }
    places
}

/// Which way a tube lies in the world.
fn frame(solid: &Solid, nodes: &TubeNodes, (aspect, is_round): (f64, bool)) -> FrameFacts {
    let world = &solid.world_from_work;
    let unit = |from: Point3<f64>, to: Point3<f64>| {
        world.vector(to - from).try_normalize(1e-12).unwrap_or_else(WorldVector::x)
    };
    let middle = nodes.size.cols / 2;
    // A ring runs on from where it began: the direction is that of its middle, which lies opposite.
    let ends = if nodes.is_ring() { [nodes.centres[middle - 1], nodes.centres[middle + 1]] } else { nodes.tips };
    let cols_along = unit(ends[0], ends[1]);
    let upper_towards = unit(nodes.centres[middle], nodes.wall_at(0, middle));
    let mut ambiguities = Vec::new();
    if is_round {
        ambiguities.push("the object is nearly as wide as it is long".to_owned());
    } else if let Some(reason) = solid.senses.of_direction(cols_along).ambiguity {
        ambiguities.push(format!("the direction along it {reason}"));
    }
    FrameFacts {
        rule: if is_round { FrameRule::SuperiorDirection } else { FrameRule::LongerAxis },
        cols_along,
        rows_along: upper_towards.cross(&cols_along),
        upper_towards,
        aspect,
        ambiguities,
    }
}

/// What was repaired, in numbers.
fn repair(repaired: &[Option<NodeRepair>], folds_before: usize) -> Repair {
    let count = |what: NodeRepair| repaired.iter().filter(|repair| **repair == Some(what)).count();
    let shortened_nodes = count(NodeRepair::Shortened);
    Repair {
        nodes: repaired.len(),
        folds_before,
        moved_nodes: count(NodeRepair::Turned),
        shortened_nodes,
        marred_nodes: shortened_nodes,
        ..Repair::default()
    }
}
