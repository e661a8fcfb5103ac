//! Tubes, which the paper names (vessels, the gut) and does not lay out: a centreline, the wall round it, and vectors from
//! the one to the other.
//!
//! Cross-sections are level sets of one function of the solid, so that no two cross whatever the bend (planes across the
//! centreline do where it bends more sharply than the tube is thick):
//!
//! 1. the boundary is moved to where it encloses the mask's volume, and the solid is taken as cells (`cells`); its two
//!    tips are found (`line`);
//! 2. a function grows from the first one to all others (`drain`);
//! 3. what a wave from the first tip falls into are branches (`tree`): one of a tube, more of a tree or a ring; each is a
//!    tube, open where it meets others;
//! 4. the centreline leads through the middles of its sections; the end centres lie where an inscribed ball reaches the tip
//!    (`line`);
//! 5. wall nodes lie on closed curves of the skin, and beyond the end centres on caps of rays (`sections`, `wall`);
//! 6. wedges that are turned over are mended (`mend`, [`legality`]).
//!
//! A ball is a tube of two caps. What has several curves in many sections of its branches is no tube.

mod cells;

mod drain;

mod line;

mod sections;

mod tree;

pub mod wall;

pub mod legality;

mod mend;

use std::collections::BTreeSet;

use nalgebra::{Point2, Point3, Vector3};

use self::cells::Cells;
use self::drain::Drain;
use self::line::{End, Line, Tips, drained};
use self::mend::mended;
use self::sections::{Skin, doubled_area};
use self::tree::{Branch, branches, without};
use self::wall::{Laying, TubeNodes};
use crate::cancel::Cancelled;
use crate::model::{
    Automatic, FrameFacts, FrameRule, GridFrom, KindEvidence, LatticeSize, NodeRepair, Repair, TubeShell,
};
use crate::numerics::field::floor_index;
use crate::numerics::polyline::{Polyline, share_within};
use crate::numerics::stats::median;
use crate::params::GridChoice;
use crate::pipeline::context::Context;
use crate::pipeline::lattice::chords::{LEAST_SPACING, MOST_NODES, TOLERANCE, WITHIN};
use crate::pipeline::solid::Solid;
use crate::pipeline::solid::depth::Depth;

/// Branches at the most: what has more is a sponge, whose branches are no wider than long.
const MOST_BRANCHES: usize = 48;
/// Share of the sections that may have several curves. Tubes have up to 0.07, at their tips; what forks or has a hole has
/// 0.18 and more.
const SPLIT: f64 = 0.12;
/// The wall that is looked at for the size of another.
const FINE: LatticeSize = LatticeSize { rows: 48, cols: 24 };
/// Nodes around at the least, and along: fewer are no wall.
const LEAST: LatticeSize = LatticeSize { rows: 12, cols: 8 };
/// Nodes along at the most: a gut of nine haustra takes 80.
const MOST_ALONG: usize = 128;
/// The way over which the direction of the line is taken, median radii.
const WAY: f64 = 0.5;

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
}

impl<'a> From<&'a TubeDraft> for TubeShell<'a> {
    fn from(draft: &'a TubeDraft) -> Self {
        let TubeNodes { size, centres, wall, tips, .. } = &draft.nodes;
        Self { size: *size, centres, wall, tips: *tips }
    }
}

/// Where tubes meet.
#[derive(Clone, Debug)]
pub struct Fork {
    /// Their numbers.
    pub tubes: Vec<usize>,
    /// The centres of their open ends.
    pub places: Vec<Point3<f64>>,
}

/// The tubes of a solid.
#[derive(Clone, Debug, Default)]
pub struct Tubes {
    /// In the order in which they begin, from the first tip.
    pub drafts: Vec<TubeDraft>,
    /// Where they meet.
    pub forks: Vec<Fork>,
}

/// The tubes of a solid; `None` when it is none. Warnings name figures by their numbers.
///
/// # Errors
/// When it is cancelled.
pub fn tubes(solid: &Solid, context: &Context<'_>) -> Result<Option<Tubes>, Cancelled> {
    let (solid, depth) = &solid.with_volume_of_mask(context)?;
    let cells = Cells::of(solid, depth, context)?;
    if cells.len() < 2 {
        return Ok(None);
    }
    let tips = Tips::of(&cells, solid, context)?;
    let lengths = cells.graph(context)?.geodesics(tips.cells[0], context)?;
    context.advance(0.2);
    let drain = drained(&cells, &lengths, context)?;
    let mut branches = branches(&cells, &lengths, context)?;
    if branches.len() > MOST_BRANCHES {
        return Ok(None);
    }
    context.advance(0.5);
    let mesh = solid.skin_mesh(depth.voxels_per_unit, context)?;
    let mut skin = Skin::of(mesh, &drain, context)?;
    let mut lines;
    let mut branch_of;
    loop {
        branch_of = branch_of_cells(&branches, cells.len());
        skin.set_branches(&cells, &branch_of, context)?;
        let tree = Tree {
            solid,
            depth,
            cells: &cells,
            drain: &drain,
            skin: &skin,
            branches: &branches,
            branch_of: &branch_of,
        };
        lines = tree.lines();
        // What has no line of its own between its forks is a part of what it touches.
        let Some(missing) = lines.iter().position(Option::is_none) else { break };
        match without(branches, missing) {
            Some(fewer) => branches = fewer,
            None => return Ok(None),
        }
    }
    let tree =
        Tree { solid, depth, cells: &cells, drain: &drain, skin: &skin, branches: &branches, branch_of: &branch_of };
    let (mut drafts, mut number_of) = (Vec::new(), vec![None; branches.len()]);
    let (mut several, mut sections) = (0, 0);
    for (number, line) in lines.iter().enumerate() {
        let Some(line) = line else { continue };
        let is_round = tips.is_round && branches.len() == 1;
        let Some((mut draft, split)) = tree.draft(number, line, (drafts.len(), is_round), context)? else { continue };
        several += split;
        sections += draft.nodes.stations.len();
        draft.parent = branches[number].before.iter().find_map(|before| number_of[*before]);
        number_of[number] = Some(drafts.len());
        drafts.push(draft);
        context.advance(0.5 + 0.5 * (number + 1) as f64 / branches.len() as f64);
    }
    if drafts.is_empty() || several as f64 > SPLIT * sections as f64 {
        return Ok(None);
    }
    let forks = tree.forks(&drafts, &number_of);
    Ok(Some(Tubes { drafts, forks }))
}

/// The branch of every cell.
fn branch_of_cells(branches: &[Branch], cells: usize) -> Vec<usize> {
    let mut branch_of = vec![0; cells];
    for (number, branch) in branches.iter().enumerate() {
        for &cell in &branch.cells {
            branch_of[cell] = number;
        }
    }
    branch_of
}

/// A solid with its branches.
struct Tree<'a> {
    solid: &'a Solid,
    depth: &'a Depth,
    cells: &'a Cells,
    drain: &'a Drain<'a>,
    skin: &'a Skin,
    branches: &'a [Branch],
    branch_of: &'a [usize],
}

impl Tree<'_> {
    /// The centrelines of all branches.
    fn lines(&self) -> Vec<Option<Line>> {
        (0..self.branches.len()).map(|number| self.line(number)).collect()
    }

    /// The centreline of a branch; `None` of one too short to have one between its forks.
    fn line(&self, number: usize) -> Option<Line> {
        let branch = &self.branches[number];
        let tips = self.skin.tips(number)?;
        let start = self.limit(number, &branch.before, f64::max);
        let end = self.limit(number, &branch.after, f64::min);
        let ends = [
            start.map_or(End::Tip(tips[0].0, tips[0].1), End::Open),
            end.map_or(End::Tip(tips[1].0, tips[1].1), End::Open),
        ];
        Line::of(self.cells, &branch.cells, self.drain, ends)
    }

    /// The value of f beyond which the sections of a branch hold nothing of some others that it touches; `None` where it
    /// touches none.
    fn limit(&self, number: usize, others: &BTreeSet<usize>, beyond: fn(f64, f64) -> f64) -> Option<f64> {
        let mut limit: Option<f64> = None;
        for &cell in &self.branches[number].cells {
            self.cells.near(self.cells.places[cell], 1, |next| {
                if others.contains(&self.branch_of[next]) {
                    let value = self.drain.values[next];
                    limit = Some(limit.map_or(value, |limit| beyond(limit, value)));
                }
            });
        }
        limit
    }

    /// The tube of a branch along its line, and how many of its sections have several curves; `None` without a wall.
    fn draft(
        &self,
        branch: usize,
        line: &Line,
        (number, is_round): (usize, bool),
        context: &Context<'_>,
    ) -> Result<Option<(TubeDraft, usize)>, Cancelled> {
        let (solid, depth) = (self.solid, self.depth);
        let radius = median_radius(line, depth);
        let laying = Laying { solid, depth, skin: self.skin, line, branch, ends: line.ends(depth), way: WAY * radius };
        let Some((size, grid_from)) = size(&laying, radius, number, context)? else { return Ok(None) };
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
            flatness,
            split_share: several as f64 / between.max(1) as f64,
            elongation: line.length() / (2.0 * radius),
            sheet_overlap: None,
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
        };
        Ok(Some((draft, several)))
    }

    /// Where tubes meet: each with those that lead on from it, at their open ends.
    fn forks(&self, drafts: &[TubeDraft], number_of: &[Option<usize>]) -> Vec<Fork> {
        let mut forks = Vec::new();
        for (branch, own) in number_of.iter().enumerate() {
            let Some(own) = *own else { continue };
            let after: Vec<usize> = self.branches[branch].after.iter().filter_map(|after| number_of[*after]).collect();
            if after.is_empty() {
                continue;
            }
            let mut places = vec![drafts[own].nodes.centres[drafts[own].nodes.size.cols - 1]];
            places.extend(after.iter().map(|&number| drafts[number].nodes.centres[0]));
            let mut tubes = vec![own];
            tubes.extend(after);
            forks.push(Fork { tubes, places });
        }
        forks
    }
}

/// The inscribed radius along the middle of a line, the median.
fn median_radius(line: &Line, depth: &Depth) -> f64 {
    const PLACES: usize = 64;
    let at = |n: usize| depth.at(line.at(line.length() * (n as f64 + 0.5) / PLACES as f64));
    median((PLACES / 4..3 * PLACES / 4).map(at).collect()).unwrap_or(1.0).max(0.5)
}

/// How many nodes around and along; `None` when there is no wall.
fn size(
    laying: &Laying<'_>,
    radius: f64,
    number: usize,
    context: &Context<'_>,
) -> Result<Option<(LatticeSize, GridFrom)>, Cancelled> {
    let params = context.params;
    if let Some(size) = context.repeated_size(number) {
        return Ok(Some((size, GridFrom::Shape)));
    }
    Ok(match (params.grid, params.spacing_mm) {
        (GridChoice::Fixed { rows, cols }, _) => Some((LatticeSize { rows, cols }, GridFrom::Asked)),
        (GridChoice::Auto, Some(spacing_mm)) => {
            let spacing = spacing_mm / laying.solid.unit_mm;
            let around = std::f64::consts::TAU * radius / spacing;
            let rows = (2 * floor_index((around / 2.0).ceil())).clamp(4, 512);
            let cols = (floor_index(laying.line.length() / spacing) + 1).clamp(3, 512);
            Some((LatticeSize { rows, cols }, GridFrom::Spacing))
        }
        (GridChoice::Auto, None) => following(laying, context)?.map(|size| (size, GridFrom::Shape)),
    })
}

/// As few nodes as leave chords between them within a tolerance of a finer wall: along from tip to tip, and around.
fn following(laying: &Laying<'_>, context: &Context<'_>) -> Result<Option<LatticeSize>, Cancelled> {
    let most = |length: f64, most: usize| (floor_index(length / LEAST_SPACING) + 1).min(most);
    let fine = LatticeSize { rows: FINE.rows, cols: most(2.0 * laying.line.length(), MOST_ALONG).max(FINE.cols) };
    let Some((nodes, _)) = laying.nodes(fine, context)? else { return Ok(None) };
    let (mut along, mut around) = (Vec::with_capacity(fine.rows), Vec::with_capacity(fine.cols));
    for row in 0..fine.rows {
        let mut line = vec![nodes.tips[0].coords];
        line.extend((0..fine.cols).map(|col| nodes.wall_at(row, col).coords));
        line.push(nodes.tips[1].coords);
        along.push(Polyline::open(line));
    }
    for col in 0..fine.cols {
        around.push(Polyline::closed(nodes.ring(col).iter().map(|wall| wall.coords).collect()));
    }
    let longest = |lines: &[Polyline<3>]| lines.iter().map(Polyline::length).fold(0.0, f64::max);
    let fewest = |lines: &[Polyline<3>], (least, largest): (usize, usize), step: usize| {
        let all: Vec<&Polyline<3>> = lines.iter().collect();
        // The ends of a line are nodes of their own: the tips, or the first row again.
        let mut count = least;
        while count < most(longest(lines), largest) && share_within(&all, count + step, TOLERANCE) < WITHIN {
            count += step;
        }
        count
    };
    let (cols, rows) = (fewest(&along, (LEAST.cols, MOST_ALONG), 1), fewest(&around, (LEAST.rows, MOST_NODES), 2));
    Ok(Some(LatticeSize { rows, cols }))
}

/// See [`KindEvidence::flatness`]: over the columns between the caps.
fn flatness(nodes: &TubeNodes, radii: &[f64]) -> f64 {
    let between = nodes.caps[0]..nodes.size.cols - nodes.caps[1];
    let mut ratios = Vec::with_capacity(between.len());
    for (col, radius) in between.clone().zip(&radii[between]) {
        let mut ring: Vec<Vector3<f64>> = nodes.ring(col).iter().map(|wall| wall - nodes.centres[col]).collect();
        ring.push(ring[0]);
        let area = doubled_area(&ring).norm() / 2.0;
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
        world.vector(to - from).try_normalize(1e-12).unwrap_or_else(crate::space::WorldVector::x)
    };
    let cols_along = unit(nodes.tips[0], nodes.tips[1]);
    let middle = nodes.size.cols / 2;
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
