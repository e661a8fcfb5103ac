//! Stage 3: single sheets and the junctions (hinges) between them.
//!
//! The paper drops voxels with more than 8 of 26 neighbours and takes components. On a bent
//! sheet that rule drops a quarter of the voxels and breaks it into pieces. We use what makes a
//! sheet a sheet instead: its points see the same two sides of the object. Walking along one
//! sheet, both feet move on smoothly; where sheets meet, one foot jumps to another side.
//!
//! 1. two adjacent medial points are *linked* when both feet move less than a share of the radius;
//! 2. linked components of points that see their feet under a wide angle are sheets, if they are
//!    large enough; other points are handed to the sheets they lie between;
//! 3. sheets without which the others still account for the object are pruned (stage 2 of the
//!    paper), and sheets that only met at a pruned one become one again.

pub mod surface;

pub mod sides;

use std::collections::{BTreeMap, BTreeSet, VecDeque};

use nalgebra::{Matrix3, Point3};
use rayon::prelude::*;

use crate::numerics::balls::Balls;
use crate::numerics::field::id;

use crate::cancel::{Cancel, Cancelled};
use crate::model::Refusal;
use crate::params::Prune;
use crate::pipeline::PipelineError;
use crate::pipeline::context::Context;
use crate::pipeline::medial::{MedialPoint, MedialSurface};
use crate::pipeline::solid::Solid;
use crate::pipeline::solid::depth::{Depth, SkinPoint};

/// How far a foot may move between adjacent points of one sheet, as a share of the radius. Where
/// n equal arms meet it jumps by 2 sin(180°/n) radii: 1.7 for three, 1.4 for four, 1.2 for five.
const FOOT_JUMP: f64 = 0.75;
/// Movement that is always allowed, voxels: what the grid does to thin sheets.
const FOOT_JUMP_FLOOR: f64 = 2.5;
/// Cosine of the angle between the feet of a point that belongs to a sheet beyond doubt: 105°. The
/// edges of a box have medial sheets of their own that see them under 90°.
const SURE_FEET_COSINE: f64 = -0.25;
/// Points that a sheet of its own needs; fewer cannot carry a lattice.
const MIN_POINTS: usize = 16;
/// Share of the object's volume that would be lost without a sheet, for it to stay (`auto`).
const AUTO_LOSS: f64 = 0.03;

/// Medial points that the main sheet needs: fewer are less than a lattice of 3 × 3 nodes with
/// something to fit each to.
pub const MIN_SHEET_POINTS: usize = 40;

/// Half the width of a bridge between two sheets, steps along the surface.
const BRIDGE_STEPS: usize = 3;
/// Cosine between the normals of touching points of one sheet on average: 45°.
const SMOOTH_COSINE: f64 = 0.7;

/// Steps along the surface within which sheets meet at one junction: thinning leaves the
/// junction of thick arms up to two voxels wide.
const NEAR_STEPS: usize = 4;

/// No sheet.
pub const NO_SHEET: u32 = u32::MAX;

/// The sheets of a medial surface.
#[derive(Clone, Debug, Default)]
pub struct Sheets {
    /// Sheet of every medial point, or [`NO_SHEET`] where it was pruned.
    pub sheet_of: Vec<u32>,
    /// Points of each sheet; sheets are in descending order of size.
    pub members: Vec<Vec<u32>>,
    /// Which sheets meet, and at which medial points.
    pub hinges: Vec<Hinge>,
    /// Sheets that were pruned.
    pub pruned: usize,
}

/// Where sheets meet.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Hinge {
    /// The sheets, ascending.
    pub sheets: Vec<u32>,
    /// Medial points that touch another of the sheets.
    pub points: Vec<u32>,
}

/// Splits a medial surface into single sheets and prunes those without evidence.
///
/// # Errors
/// When no sheet has enough points for a lattice; when it is cancelled.
pub fn sheets(
    surface: &MedialSurface,
    solid: &Solid,
    depth: &Depth,
    context: &Context<'_>,
) -> Result<Sheets, PipelineError> {
    let needed = Needed { loss: loss_needed(context.params.prune), most: context.params.max_figures };
    let mut label = linked_components(surface, context)?;
    context.advance(0.3);
    hand_over_rest(surface, &mut label, context)?;
    join_across_pairs(surface, &mut label, context)?;
    context.advance(0.5);
    let mut pruned = 0;
    while let Some(weak) = weakest(surface, depth, &label, needed, context)? {
        label.iter_mut().filter(|l| **l == weak).for_each(|l| *l = NO_SHEET);
        pruned += 1;
        join_across_pairs(surface, &mut label, context)?;
    }
    context.advance(0.9);
    trim_edges(surface, &mut label, context)?;
    let sheets = in_order_of_size(surface, &label, pruned, context)?;
    check_sheet(surface, &sheets, solid)?;
    Ok(sheets)
}

/// Refuses an object whose medial surface has too few points for a sheet.
fn check_sheet(surface: &MedialSurface, sheets: &Sheets, solid: &Solid) -> Result<(), Refusal> {
    let points = sheets.members.first().map_or(0, Vec::len);
    if points >= MIN_SHEET_POINTS {
        return Ok(());
    }
    let radius = surface.points.iter().map(|p| p.radius).fold(0.0, f64::max);
    let volume = solid.inside.as_slice().iter().filter(|m| **m).count() as f64;
    let ball = 4.0 / 3.0 * std::f64::consts::PI * radius.powi(3);
    if radius < 2.0 {
        let thickness_mm = 2.0 * radius * solid.voxel_mm;
        let resolution_mm = solid.voxel_mm * radius / 3.0;
        return Err(Refusal::TooThin { thickness_mm, voxels: 2.0 * radius, voxel_mm: solid.voxel_mm, resolution_mm });
    }
    if volume < 2.5 * ball {
        let radius_mm = radius * solid.voxel_mm;
        return Err(Refusal::Ball { radius_mm });
    }
    // Twice what a sheet of too few points holds: a tube, straight or closed, whose medial points
    // see skin all around.
    if volume > 4.0 * radius * MIN_SHEET_POINTS as f64 {
        let length = volume / (std::f64::consts::PI * radius * radius);
        return Err(Refusal::Tube { length_mm: length * solid.voxel_mm, radius_mm: radius * solid.voxel_mm });
    }
    Err(Refusal::TooSmall { points, needed: MIN_SHEET_POINTS })
}

/// What a sheet needs to be kept.
#[derive(Clone, Copy)]
struct Needed {
    /// Share of the volume that would be lost without it.
    loss: f64,
    /// To be one of so many.
    most: Option<usize>,
}

/// Share of the object's volume that would be lost without a sheet, for it to be kept.
#[must_use]
pub fn loss_needed(prune: Prune) -> f64 {
    match prune {
        Prune::Auto => AUTO_LOSS,
        Prune::Strength(s) => s * s / (1.0 - s * s),
    }
}

/// The strength of pruning that is used. A sheet needs a loss of s²/(1 − s²): none at 0, more than
/// any sheet has at 1 (a loss is no true share: arms that stand far out lose more than the whole).
#[must_use]
pub fn strength(prune: Prune) -> f64 {
    match prune {
        Prune::Auto => (AUTO_LOSS / (1.0 + AUTO_LOSS)).sqrt(),
        Prune::Strength(strength) => strength,
    }
}

/// Sheets of linked sure points. Where a branch starts, the foot jumps by next to nothing, and two
/// sheets hang together by a bridge there: sheets are told apart a few steps away from all jumps,
/// and get back what lies between.
fn linked_components(surface: &MedialSurface, cancel: &dyn Cancel) -> Result<Vec<u32>, Cancelled> {
    let from_jump = steps_from_jumps(surface, cancel)?;
    let mut label = vec![NO_SHEET; surface.points.len()];
    let mut count = 0;
    for bridge in [BRIDGE_STEPS, 0] {
        for start in 0..label.len() {
            let is_core = |p: usize| from_jump[p] >= bridge && is_sure(&surface.points[p]);
            if label[start] != NO_SHEET || !is_core(start) {
                continue;
            }
            label[start] = count;
            let (mut piece, mut next) = (vec![id(start)], 0);
            while next < piece.len() {
                cancel.check()?;
                let a = piece[next] as usize;
                for &b in &surface.adjacency[a] {
                    if label[b as usize] == NO_SHEET && is_core(b as usize) && is_linked(surface, a, b as usize) {
                        label[b as usize] = count;
                        piece.push(b);
                    }
                }
                next += 1;
            }
            if bridge > 0 && piece.len() < MIN_POINTS {
                piece.iter().for_each(|&p| label[p as usize] = NO_SHEET);
            } else {
                count += 1;
            }
        }
        grow_back(surface, &mut label, cancel)?;
    }
    Ok(label)
}

/// Hands linked sure points to the sheet that reaches them in the fewest steps.
fn grow_back(surface: &MedialSurface, label: &mut [u32], cancel: &dyn Cancel) -> Result<(), Cancelled> {
    let mut queue: VecDeque<u32> = (0..id(label.len())).filter(|&p| label[p as usize] != NO_SHEET).collect();
    while let Some(a) = queue.pop_front() {
        cancel.check()?;
        for &b in &surface.adjacency[a as usize] {
            let (to, from) = (b as usize, a as usize);
            if label[to] == NO_SHEET && is_sure(&surface.points[to]) && is_linked(surface, from, to) {
                label[to] = label[from];
                queue.push_back(b);
            }
        }
    }
    Ok(())
}

/// Steps along the surface to the nearest sure point whose foot jumps towards a sure neighbour;
/// counted up to [`BRIDGE_STEPS`].
fn steps_from_jumps(surface: &MedialSurface, cancel: &dyn Cancel) -> Result<Vec<usize>, Cancelled> {
    let is_sure = |p: usize| is_sure(&surface.points[p]);
    let jumps =
        |p: usize| surface.adjacency[p].iter().any(|&b| is_sure(b as usize) && !is_linked(surface, p, b as usize));
    let mut steps = vec![BRIDGE_STEPS; surface.points.len()];
    let mut front = Vec::new();
    for p in 0..steps.len() {
        cancel.check()?;
        if is_sure(p) && jumps(p) {
            front.push(p);
        }
    }
    for step in 0..BRIDGE_STEPS {
        cancel.check()?;
        front.iter().for_each(|&p| steps[p] = step);
        let around = front.iter().flat_map(|&p| &surface.adjacency[p]).map(|&b| b as usize);
        front = around.filter(|&b| steps[b] > step + 1 || (step + 1 == BRIDGE_STEPS)).collect();
        front.sort_unstable();
        front.dedup();
    }
    Ok(steps)
}

fn is_linked(surface: &MedialSurface, a: usize, b: usize) -> bool {
    are_linked(&surface.points[a], &surface.points[b])
}

/// Whether a point belongs to a sheet beyond doubt.
fn is_sure(point: &MedialPoint) -> bool {
    point.feet_cosine < SURE_FEET_COSINE
}

/// Whether both feet move on smoothly from `a` to `b`.
fn are_linked(a: &MedialPoint, b: &MedialPoint) -> bool {
    let limit = (FOOT_JUMP * a.radius.min(b.radius)).max(FOOT_JUMP_FLOOR);
    let moved = |p: usize, q: usize| (a.feet[p] - b.feet[q]).norm();
    moved(0, 0).max(moved(1, 1)).min(moved(0, 1).max(moved(1, 0))) <= limit
}

/// Points without a sheet of their own go to the nearest sheet along the surface, if they lie
/// between sheets or belong to one beyond doubt. The rest are edges and bumps of the boundary.
fn hand_over_rest(surface: &MedialSurface, label: &mut [u32], cancel: &dyn Cancel) -> Result<(), Cancelled> {
    let sizes = sizes(label);
    label.iter_mut().filter(|l| sizes.get(l).is_some_and(|s| *s < MIN_POINTS)).for_each(|l| *l = NO_SHEET);
    let is_between = between_sheets(surface, label, cancel)?;
    let mut queue: VecDeque<u32> = (0..id(label.len())).filter(|&p| label[p as usize] != NO_SHEET).collect();
    while let Some(a) = queue.pop_front() {
        cancel.check()?;
        for &b in &surface.adjacency[a as usize] {
            let stays = is_between[b as usize] || is_sure(&surface.points[b as usize]);
            if label[b as usize] == NO_SHEET && stays {
                label[b as usize] = label[a as usize];
                queue.push_back(b);
            }
        }
    }
    Ok(())
}

/// Points in a piece without a label that touches two labels or more.
fn between_sheets(surface: &MedialSurface, label: &[u32], cancel: &dyn Cancel) -> Result<Vec<bool>, Cancelled> {
    let mut is_between = vec![false; label.len()];
    let mut seen = vec![false; label.len()];
    for start in 0..label.len() {
        if seen[start] || label[start] != NO_SHEET {
            continue;
        }
        seen[start] = true;
        let (mut piece, mut touched, mut next) = (vec![id(start)], BTreeSet::new(), 0);
        while next < piece.len() {
            cancel.check()?;
            for &n in &surface.adjacency[piece[next] as usize] {
                if label[n as usize] != NO_SHEET {
                    touched.insert(label[n as usize]);
                } else if !std::mem::replace(&mut seen[n as usize], true) {
                    piece.push(n);
                }
            }
            next += 1;
        }
        piece.iter().for_each(|&p| is_between[p as usize] = touched.len() > 1);
    }
    Ok(is_between)
}

fn sizes(label: &[u32]) -> BTreeMap<u32, usize> {
    let mut sizes = BTreeMap::new();
    for &l in label {
        *sizes.entry(l).or_insert(0) += 1;
    }
    sizes.remove(&NO_SHEET);
    sizes
}

/// The sheet to prune next: the one whose loss is the smallest, if that is less than is needed or
/// there are too many. `None` when all have evidence, or one is left.
fn weakest(
    surface: &MedialSurface,
    depth: &Depth,
    label: &[u32],
    needed: Needed,
    cancel: &dyn Cancel,
) -> Result<Option<u32>, Cancelled> {
    let sizes = sizes(label);
    if sizes.len() < 2 {
        return Ok(None);
    }
    let losses = losses(surface, depth, label, cancel)?;
    let too_many = needed.most.is_some_and(|most| sizes.len() > most);
    let least = losses.iter().min_by(|a, b| a.1.total_cmp(b.1).then(b.0.cmp(a.0)));
    Ok(least.filter(|(_, loss)| too_many || **loss < needed.loss).map(|(weak, _)| *weak))
}

/// For each sheet, the share of the object's volume that sticks out of the balls of all other
/// sheets: the height of every skin point of the sheet above them, summed.
fn losses(
    surface: &MedialSurface,
    depth: &Depth,
    label: &[u32],
    cancel: &dyn Cancel,
) -> Result<BTreeMap<u32, f64>, Cancelled> {
    let numbers: Vec<u32> = sizes(label).into_keys().collect();
    let owner = Inscribed::of(surface, |p| label[p] != NO_SHEET, cancel)?;
    let mut skin_of: BTreeMap<u32, Vec<usize>> = numbers.iter().map(|&n| (n, Vec::new())).collect();
    let owners = owner.of_skin(depth, cancel)?;
    for (s, owner) in owners.into_iter().enumerate() {
        if let Some((p, _)) = owner {
            skin_of.entry(label[p]).or_default().push(s);
        }
    }
    let volume = depth.depth.as_slice().iter().filter(|d| **d > 0.0).count() as f64;
    let mut losses = BTreeMap::new();
    for &number in &numbers {
        let others = Inscribed::of(surface, |p| label[p] != NO_SHEET && label[p] != number, cancel)?;
        let height = |&s: &usize| {
            cancel.check()?;
            Ok(others.nearest(depth.skin[s].position).map_or(0.0, |f| f.1.max(0.0)))
        };
        let heights: Vec<f64> = skin_of[&number].par_iter().map(height).collect::<Result<_, _>>()?;
        losses.insert(number, heights.into_iter().sum::<f64>() / volume.max(1.0));
    }
    Ok(losses)
}

/// The inscribed balls of medial points, to be found by power distance.
pub struct Inscribed {
    balls: Balls,
    points: Vec<u32>,
    centres: Vec<(Point3<f64>, f64)>,
}

impl Inscribed {
    /// The balls of the medial points (by index) that `take` accepts.
    ///
    /// # Errors
    /// When it is cancelled.
    pub fn of(surface: &MedialSurface, take: impl Fn(usize) -> bool, cancel: &dyn Cancel) -> Result<Self, Cancelled> {
        let points: Vec<u32> = (0..surface.points.len()).filter(|&p| take(p)).map(id).collect();
        let centres: Vec<_> =
            points.iter().map(|&p| &surface.points[p as usize]).map(|m| (m.position, m.radius)).collect();
        Ok(Self { balls: Balls::new(&centres, cancel)?, points, centres })
    }

    /// [`Self::nearest`] of every skin point.
    ///
    /// # Errors
    /// When it is cancelled.
    pub fn of_skin(&self, depth: &Depth, cancel: &dyn Cancel) -> Result<Vec<Option<(usize, f64)>>, Cancelled> {
        let nearest = |point: &SkinPoint| cancel.check().map(|()| self.nearest(point.position));
        depth.skin.par_iter().map(nearest).collect()
    }

    /// The medial point whose ball comes nearest to `p`, and how far `p` is outside of it.
    #[must_use]
    pub fn nearest(&self, p: Point3<f64>) -> Option<(usize, f64)> {
        let k = self.balls.nearest(p)?;
        let (centre, radius) = self.centres[k];
        Some((self.points[k] as usize, (p - centre).norm() - radius))
    }
}

/// Which sheets touch, with the points that touch.
fn contacts(
    surface: &MedialSurface,
    label: &[u32],
    cancel: &dyn Cancel,
) -> Result<BTreeMap<(u32, u32), BTreeSet<u32>>, Cancelled> {
    let mut contacts: BTreeMap<(u32, u32), BTreeSet<u32>> = BTreeMap::new();
    for (a, list) in surface.adjacency.iter().enumerate() {
        cancel.check()?;
        for &b in list {
            let (la, lb) = (label[a], label[b as usize]);
            if la < lb && lb != NO_SHEET {
                contacts.entry((la, lb)).or_default().extend([id(a), b]);
            }
        }
    }
    Ok(contacts)
}

/// Two sheets that touch mostly where no third one is near are one sheet with a step in it.
fn join_across_pairs(surface: &MedialSurface, label: &mut [u32], cancel: &dyn Cancel) -> Result<(), Cancelled> {
    while let Some((a, b)) = stepped_pair(surface, label, cancel)? {
        label.iter_mut().filter(|l| **l == b).for_each(|l| *l = a);
    }
    Ok(())
}

fn stepped_pair(surface: &MedialSurface, label: &[u32], cancel: &dyn Cancel) -> Result<Option<(u32, u32)>, Cancelled> {
    for (pair, points) in contacts(surface, label, cancel)? {
        let mut lone = 0;
        for &p in &points {
            cancel.check()?;
            lone += usize::from(!has_third_near(surface, label, pair, p));
        }
        if 2 * lone > points.len() && is_smooth(surface, label, &points) {
            return Ok(Some(pair));
        }
    }
    Ok(None)
}

/// Whether two sheets go on into one another where they touch: on average their normals agree. A
/// branch stands on the sheet it leaves.
fn is_smooth(surface: &MedialSurface, label: &[u32], points: &BTreeSet<u32>) -> bool {
    let mean = |p: u32| {
        // The normals around the place, those of its own sheet only, as a quadratic form.
        let own = |q: &u32| label[*q as usize] == label[p as usize];
        let near = surface.adjacency[p as usize].iter().copied().filter(own).chain([p]);
        near.map(|q| surface.points[q as usize].normal).map(|n| n * n.transpose()).sum::<Matrix3<f64>>()
    };
    let (mut sum, mut count) = (0.0, 0.0);
    for &a in points {
        for &b in surface.adjacency[a as usize].iter().filter(|b| points.contains(b) && a < **b) {
            if label[a as usize] != label[b as usize] {
                let (u, v) = (mean(a), mean(b));
                sum += (u.dot(&v) / (u.norm() * v.norm()).max(1e-12)).max(0.0).sqrt();
                count += 1.0;
            }
        }
    }
    sum >= SMOOTH_COSINE * f64::max(count, 1.0)
}

/// Whether a sheet other than two lies within a few steps along the surface.
fn has_third_near(surface: &MedialSurface, label: &[u32], (a, b): (u32, u32), start: u32) -> bool {
    let mut seen = BTreeSet::from([start]);
    let mut front = vec![start];
    for _ in 0..NEAR_STEPS {
        let mut next = Vec::new();
        for p in front {
            for &n in &surface.adjacency[p as usize] {
                let l = label[n as usize];
                if l != a && l != b && l != NO_SHEET {
                    return true;
                }
                if seen.insert(n) {
                    next.push(n);
                }
            }
        }
        front = next;
    }
    false
}

/// Points that are not sure stay only near another sheet, where they make the junction, or where
/// they hold a sheet together. Elsewhere they are the start of a sheet that runs into an edge of
/// the boundary.
fn trim_edges(surface: &MedialSurface, label: &mut [u32], cancel: &dyn Cancel) -> Result<(), Cancelled> {
    let before = label.to_vec();
    for (p, l) in label.iter_mut().enumerate() {
        cancel.check()?;
        if *l != NO_SHEET && !is_sure(&surface.points[p]) && !has_third_near(surface, &before, (*l, *l), id(p)) {
            *l = NO_SHEET;
        }
    }
    for sheet in sizes(label).into_keys() {
        hold_together(surface, &before, label, sheet, cancel)?;
    }
    Ok(())
}

/// Joins the pieces of a trimmed sheet to its largest one by the shortest paths over points that
/// were trimmed.
fn hold_together(
    surface: &MedialSurface,
    before: &[u32],
    label: &mut [u32],
    sheet: u32,
    cancel: &dyn Cancel,
) -> Result<(), Cancelled> {
    let mut from = vec![u32::MAX; label.len()];
    let members: Vec<u32> = (0..id(label.len())).filter(|&p| label[p as usize] == sheet).collect();
    let largest = surface.part(&members, cancel)?.largest_piece(cancel)?;
    let mut queue: VecDeque<u32> = largest.into_iter().map(|k| members[k as usize]).collect();
    queue.iter().for_each(|&p| from[p as usize] = p);
    while let Some(a) = queue.pop_front() {
        cancel.check()?;
        for &b in &surface.adjacency[a as usize] {
            if from[b as usize] != u32::MAX || before[b as usize] != sheet {
                continue;
            }
            from[b as usize] = a;
            queue.push_back(b);
            let mut path = a;
            while label[b as usize] == sheet && label[path as usize] != sheet {
                label[path as usize] = sheet;
                path = from[path as usize];
            }
        }
    }
    Ok(())
}

/// Connected sets of touching points with the sheets that touch there.
fn hinges(surface: &MedialSurface, label: &[u32], cancel: &dyn Cancel) -> Result<Vec<Hinge>, Cancelled> {
    let touching: BTreeSet<u32> = contacts(surface, label, cancel)?.into_values().flatten().collect();
    let mut seen = BTreeSet::new();
    let mut hinges = Vec::new();
    for &start in &touching {
        if !seen.insert(start) {
            continue;
        }
        let (mut points, mut stack) = (Vec::new(), vec![start]);
        while let Some(p) = stack.pop() {
            points.push(p);
            stack.extend(surface.adjacency[p as usize].iter().filter(|n| touching.contains(n) && seen.insert(**n)));
        }
        points.sort_unstable();
        let sheets: BTreeSet<u32> = points.iter().map(|&p| label[p as usize]).collect();
        hinges.push(Hinge { sheets: sheets.into_iter().collect(), points });
    }
    Ok(hinges)
}

/// Renumbers the sheets, the largest first.
pub fn in_order_of_size(
    surface: &MedialSurface,
    label: &[u32],
    pruned: usize,
    cancel: &dyn Cancel,
) -> Result<Sheets, Cancelled> {
    let mut order: Vec<(u32, usize)> = sizes(label).into_iter().collect();
    order.sort_by(|a, b| b.1.cmp(&a.1).then(a.0.cmp(&b.0)));
    let new: BTreeMap<u32, u32> = order.iter().enumerate().map(|(k, (old, _))| (*old, id(k))).collect();
    let sheet_of: Vec<u32> = label.iter().map(|l| new.get(l).copied().unwrap_or(NO_SHEET)).collect();
    let mut members = vec![Vec::new(); order.len()];
    for (p, &sheet) in sheet_of.iter().enumerate() {
        if sheet != NO_SHEET {
            members[sheet as usize].push(id(p));
        }
    }
    let hinges = hinges(surface, &sheet_of, cancel)?;
    Ok(Sheets { sheet_of, members, hinges, pruned })
}
