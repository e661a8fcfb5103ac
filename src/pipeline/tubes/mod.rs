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
//!    tube, open where it meets others; a ring alone is opened and becomes one tube (`ring`);
//! 4. the centreline leads through the middles of its sections; the end centres lie where an inscribed ball reaches the tip
//!    (`line`);
//! 5. wall nodes lie on closed curves of the skin, and beyond the end centres on caps of rays (`sections`, `wall`);
//! 6. wedges that are turned over are mended (`mend`, [`legality`]).
//!
//! A ball is a tube of two caps. What has several curves in many sections of its branches is no tube.

mod cells;

mod drain;

mod line;

mod ring;

mod sections;

mod tree;

pub mod wall;

pub mod legality;

mod mend;

mod size;

mod draft;

use std::collections::BTreeSet;

use nalgebra::Point3;

pub use self::draft::TubeDraft;

use self::cells::Cells;
use self::draft::draft;
use self::drain::Drain;
use self::line::{End, Line, Tips};
use self::ring::{is_ring, ring};
use self::sections::Skin;
use self::tree::{Branch, branches, without};
use self::wall::Laying;
use crate::cancel::{Cancel, Cancelled};
use crate::pipeline::context::Context;
use crate::pipeline::solid::Solid;
use crate::pipeline::solid::depth::Depth;

/// Branches at the most: what has more is a sponge, whose branches are no wider than long.
const MOST_BRANCHES: usize = 48;
/// Share of the sections that may have several curves. Tubes have up to 0.07, at their tips; what forks or has a hole has
/// 0.18 and more.
const SPLIT: f64 = 0.12;
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

impl Tubes {
    /// Those that are marked, and where they meet.
    pub(super) fn only(&self, is_kept: &[bool]) -> Self {
        let (mut drafts, mut number_of) = (Vec::new(), vec![None; self.drafts.len()]);
        for (number, draft) in self.drafts.iter().enumerate().filter(|(number, _)| is_kept[*number]) {
            number_of[number] = Some(drafts.len());
            // A parent comes before those that leave it.
            let parent = draft.parent.and_then(|parent| number_of[parent]);
            drafts.push(TubeDraft { parent, ..draft.clone() });
        }
        let mut forks = Vec::new();
        for fork in &self.forks {
            let mut kept = Fork { tubes: Vec::new(), places: Vec::new() };
            for (tube, place) in fork.tubes.iter().zip(&fork.places) {
                if let Some(number) = number_of[*tube] {
                    kept.tubes.push(number);
                    kept.places.push(*place);
                }
            }
            if kept.tubes.len() > 1 {
                forks.push(kept);
            }
        }
        Self { drafts, forks }
    }
}

/// The ways to take a solid as tubes: none when it is none, and two of a tree: whose branches meet in one section, where forks
/// are regular, or each where its own sections begin. Warnings name figures by their numbers.
///
/// # Errors
/// When it is cancelled.
pub fn tubes(solid: &Solid, context: &Context<'_>) -> Result<Vec<Tubes>, Cancelled> {
    let (solid, depth) = &solid.with_volume_of_mask(context)?;
    let cells = Cells::of(solid, depth, context)?;
    if cells.len() < 2 {
        return Ok(Vec::new());
    }
    let graph = cells.graph(context)?;
    let tips = Tips::of(&cells, &graph, solid, context)?;
    let lengths = graph.geodesics(tips.cells[0], context)?;
    context.advance(0.2);
    let branches = branches(&cells, &lengths, context)?;
    if is_ring(&branches)
        && let Some(tubes) = ring(solid, depth, &cells, context)?
    {
        return Ok(vec![tubes]);
    }
    if branches.len() > MOST_BRANCHES {
        return Ok(Vec::new());
    }
    let drain = Drain::at_tip(&cells, &lengths, &[], context)?;
    context.advance(0.5);
    let mut ways = Vec::new();
    if branches.len() > 1 {
        let held = held_at_forks(&cells, &branches, &drain);
        let held = Drain::at_tip(&cells, &lengths, &held, context)?;
        ways.extend(laid((solid, depth), (&held, true), branches.clone(), tips.is_round, context)?);
    }
    ways.extend(laid((solid, depth), (&drain, false), branches, tips.is_round, context)?);
    Ok(ways)
}

/// The tubes whose sections are the level sets of a function, with one of them where branches meet if it `is_level` there.
fn laid(
    (solid, depth): (&Solid, &Depth),
    (drain, is_level): (&Drain<'_>, bool),
    branches: Vec<Branch>,
    is_round: bool,
    context: &Context<'_>,
) -> Result<Option<Tubes>, Cancelled> {
    let skin = Skin::of(solid.skin_mesh(depth.voxels_per_unit, context)?, drain, context)?;
    let mut tree = Tree { solid, depth, cells: drain.cells, drain, is_level, skin, branches, branch_of: Vec::new() };
    let Some(lines) = tree.settled_lines(context)? else { return Ok(None) };
    tree.tubes(&lines, is_round, context)
}

/// The cells on either side of every fork, each with the mean that a function has on that side: held to it, the function has one
/// level set between them where branches meet, and none of the solid lies between the last section of one and the first of the next.
fn held_at_forks(cells: &Cells, branches: &[Branch], drain: &Drain<'_>) -> Vec<(usize, f64)> {
    let mut branch_of = vec![0; cells.len()];
    for (number, branch) in branches.iter().enumerate() {
        for &cell in &branch.cells {
            branch_of[cell] = number;
        }
    }
    // The fork at the beginning and at the end of each branch: that which it shares with those before, or after.
    let mut fork_of: Vec<[usize; 2]> = (0..branches.len()).map(|number| [2 * number, 2 * number + 1]).collect();
    for (number, branch) in branches.iter().enumerate() {
        for &before in &branch.before {
            let [one, other] = [fork_of[before][1], fork_of[number][0]];
            for fork in fork_of.iter_mut().flatten() {
                *fork = if *fork == other { one } else { *fork };
            }
        }
    }
    // The cells on this side of each fork, and on the far side.
    let mut beside: Vec<[BTreeSet<usize>; 2]> = vec![Default::default(); 2 * branches.len()];
    for (number, branch) in branches.iter().enumerate() {
        let fork = fork_of[number][0];
        for &cell in &branch.cells {
            cells.near(cells.places[cell], 1, |next| {
                if branch.before.contains(&branch_of[next]) {
                    beside[fork][0].insert(next);
                    beside[fork][1].insert(cell);
                }
            });
        }
    }
    let mut held = Vec::new();
    for side in beside.into_iter().flatten().filter(|side| !side.is_empty()) {
        let value = side.iter().map(|&cell| drain.values[cell]).sum::<f64>() / side.len() as f64;
        held.extend(side.into_iter().map(|cell| (cell, value)));
    }
    held
}

/// A solid with its branches.
struct Tree<'a> {
    solid: &'a Solid,
    depth: &'a Depth,
    cells: &'a Cells,
    drain: &'a Drain<'a>,
    /// Whether the function has one level set where branches meet.
    is_level: bool,
    skin: Skin,
    branches: Vec<Branch>,
    /// The branch of every cell.
    branch_of: Vec<usize>,
}

impl Tree<'_> {
    /// The centrelines of all branches. What has no line of its own between its forks becomes a part of what it touches;
    /// `None` when nothing is left.
    fn settled_lines(&mut self, cancel: &dyn Cancel) -> Result<Option<Vec<Line>>, Cancelled> {
        loop {
            self.note_branches(cancel)?;
            let lines: Vec<Option<Line>> = (0..self.branches.len()).map(|number| self.line(number)).collect();
            let Some(missing) = lines.iter().position(Option::is_none) else {
                return Ok(Some(lines.into_iter().flatten().collect()));
            };
            match without(std::mem::take(&mut self.branches), missing) {
                Some(fewer) => self.branches = fewer,
                None => return Ok(None),
            }
        }
    }

    /// Notes which branch every cell and every corner of the skin belongs to.
    fn note_branches(&mut self, cancel: &dyn Cancel) -> Result<(), Cancelled> {
        self.branch_of = vec![0; self.cells.len()];
        for (number, branch) in self.branches.iter().enumerate() {
            for &cell in &branch.cells {
                self.branch_of[cell] = number;
            }
        }
        self.skin.set_branches(self.cells, &self.branch_of, cancel)
    }

    /// The tubes along the lines of the branches; `None` when they are none.
    fn tubes(&self, lines: &[Line], is_round: bool, context: &Context<'_>) -> Result<Option<Tubes>, Cancelled> {
        let is_round = is_round && lines.len() == 1;
        let (mut drafts, mut number_of) = (Vec::new(), vec![None; lines.len()]);
        let (mut several, mut sections) = (0, 0);
        for (branch, line) in lines.iter().enumerate() {
            let laying = self.laying(branch, line);
            let Some((mut tube, split)) = draft(&laying, (drafts.len(), is_round), context)? else { continue };
            several += split;
            sections += tube.nodes.stations.len();
            tube.parent = self.branches[branch].before.iter().find_map(|before| number_of[*before]);
            number_of[branch] = Some(drafts.len());
            drafts.push(tube);
            context.advance(0.5 + 0.5 * (branch + 1) as f64 / lines.len() as f64);
        }
        if drafts.is_empty() || several as f64 > SPLIT * sections as f64 {
            return Ok(None);
        }
        let forks = self.forks(&drafts, &number_of);
        Ok(Some(Tubes { drafts, forks }))
    }

    /// What the nodes of a branch are laid on.
    fn laying<'b>(&'b self, branch: usize, line: &'b Line) -> Laying<'b> {
        let Self { solid, depth, .. } = *self;
        Laying {
            solid,
            depth,
            skin: &self.skin,
            line,
            branch,
            ends: line.ends(depth),
            radius: line.median_radius(depth),
        }
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
                    let [own, next] = [cell, next].map(|cell| self.drain.values[cell]);
                    let value = if self.is_level { (own + next) / 2.0 } else { next };
                    limit = Some(limit.map_or(value, |limit| beyond(limit, value)));
                }
            });
        }
        limit
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
