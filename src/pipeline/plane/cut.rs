//! Sheets that cannot be laid flat are cut.
//!
//! ISOMAP lays a sheet out so that distances in the plane are those along it. A bowl has no such
//! plane: where its rim draws in it is laid over itself, and the map back to space takes the mean of
//! two layers. The residual variance tells such sheets. They are cut in two until every part can be
//! laid flat; the parts meet at a hinge, as branches do.
//!
//! LLE and Laplacian eigenmaps do not keep distances, so the residual variance of a good plane of theirs may be
//! large: of theirs it is the share that lies turned over.
//!
//! A sheet that forks around a notch can be laid flat, but its lattice would have to run round the
//! notch. One of its arms is cut off.

use crate::numerics::field::{floor_index, id};

use crate::cancel::{Cancel, Cancelled};
use crate::params::{Embedding, Landmarks};
use crate::pipeline::context::Context;
use crate::pipeline::medial::MedialSurface;
use crate::pipeline::plane::embedding::{EmbeddingError, Flat, MAX_TURNED_OVER, Method, flatten};
use crate::pipeline::plane::region::{HOLES_REFUSED, Region};
use crate::pipeline::sheets::sides::is_orientable;
use crate::pipeline::sheets::surface::Surface;
use crate::pipeline::sheets::{NO_SHEET, Sheets, in_order_of_size};
use crate::pipeline::solid::Solid;

/// Residual variance above which a sheet counts as not laid flat. Sheets known to be developable
/// have 0.0006 at most, organs that are laid out well 0.008, and sheets that lie over themselves in
/// the plane 0.04 and more.
const MAX_RESIDUAL: f64 = 0.018;
/// Points that each half of a curled sheet keeps at least: a vertebra of 103 points was worse in two.
const MIN_HALF: usize = 100;
/// Points of an arm that is cut off, and of a piece between strings, at least: those of a lattice of
/// 3 × 3 nodes with something to fit each to.
const MIN_ARM: usize = 40;
/// How far an arm juts out at least, as a share of the sheet's length. The notch of a spleen is
/// 25 % deep; the rims of organs without one have bays of 11 % at most.
const ARM_LENGTH: f64 = 0.15;
/// Points of an arm, as a share of the sheet's: the spleen's has 9 %, those at bays 2.4 %.
const ARM_POINTS: f64 = 0.05;
/// Distance of touching points of one arm at most, voxels: neighbouring voxels' centres are 1.7 apart.
/// Where the tips of two arms pass each other, their voxels touch and the points lie 3 apart.
const LINK: f64 = 2.5;
/// Steps along the surface around a point that tell a sheet from a string.
const STRING_STEPS: usize = 2;
/// Points within these steps around a point of a sheet: 25 inside, 15 at a rim, 9 in a corner; on a
/// string of single voxels there are 5.
const STRING_POINTS: usize = 10;
/// Where along the axes of the plane a sheet may be cut, as shares of its points.
const PLACES: [f64; 5] = [0.3, 0.4, 0.5, 0.6, 0.7];

/// Sheets with the planes they were laid in.
pub struct Laid {
    /// The sheets.
    pub sheets: Sheets,
    /// The plane of the largest connected piece of each sheet, in the order of its points, unless
    /// there is none.
    pub flat: Vec<Option<Flat>>,
}

/// The measure that tells a sheet which is not laid flat.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Fault {
    Residual,
    TurnedOver,
}

impl Fault {
    fn of(embedding: Embedding) -> Self {
        if embedding == Embedding::Isomap { Self::Residual } else { Self::TurnedOver }
    }

    /// What a plane to work in has at most.
    fn most(self) -> f64 {
        match self {
            Self::Residual => MAX_RESIDUAL,
            Self::TurnedOver => MAX_TURNED_OVER,
        }
    }

    fn name(self) -> &'static str {
        match self {
            Self::Residual => "residual variance",
            Self::TurnedOver => "share turned over",
        }
    }
}

/// A connected part of a sheet in its plane.
struct Part {
    /// Medial points, ascending.
    members: Vec<u32>,
    surface: Surface,
    flat: Option<Flat>,
    /// What is wrong with its plane, by the measure of the embedding; 0 of what is not laid flat.
    fault: f64,
    /// Strings were taken off.
    is_bare: bool,
}

impl Part {
    /// Whether it has no plane of its own.
    fn is_curled(&self, fault: Fault) -> bool {
        self.fault > fault.most()
    }

    /// One of two arms of a sheet that forks along its long axis: such a sheet has no lattice, for
    /// columns would have to cross the notch. Indices into the part.
    fn arm(&self, cancel: &dyn Cancel) -> Result<Option<Vec<usize>>, Cancelled> {
        let Some(flat) = &self.flat else { return Ok(None) };
        let along: Vec<f64> = flat.points.iter().map(|p| p.x).collect();
        let (low, high) = along.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), x| (l.min(*x), h.max(*x)));
        let least = MIN_ARM.max(floor_index(ARM_POINTS * along.len() as f64));
        let arm_at = |end: f64| {
            let along: Vec<f64> = along.iter().map(|x| end * x).collect();
            arm(&self.surface, &along, ARM_LENGTH * (high - low), least, cancel)
        };
        let arms = [arm_at(1.0)?, arm_at(-1.0)?];
        Ok(arms.into_iter().flatten().max_by_key(|arm| arm.len().min(along.len() - arm.len())))
    }
}

/// Lays sheets flat and cuts them.
struct Cutter<'a> {
    surface: &'a MedialSurface,
    voxel_mm: f64,
    fault: Fault,
    context: &'a Context<'a>,
}

/// Lays the sheets flat and cuts those that cannot be, as far as `max_figures` allows.
///
/// # Errors
/// When it is cancelled.
pub fn laid_flat(
    surface: &MedialSurface,
    sheets: Sheets,
    solid: &Solid,
    context: &Context<'_>,
) -> Result<Laid, Cancelled> {
    let params = context.params;
    let cutter = Cutter { surface, voxel_mm: solid.voxel_mm, fault: Fault::of(params.embedding), context };
    let most = params.max_figures.unwrap_or(usize::MAX);
    let mut count = sheets.members.len();
    let mut label = sheets.sheet_of.clone();
    let mut laid = Vec::new();
    for (number, members) in sheets.members.iter().enumerate() {
        let before = cutter.lay(members, params.landmarks)?;
        let fault = before.fault;
        let (mut parts, mut done) = (vec![before], Vec::new());
        while let Some(part) = parts.pop() {
            let is_refused = is_refused(surface, &part, cutter.fault, context)?;
            let pieces = if is_refused { Vec::new() } else { cutter.pieces(&part, most - count)? };
            if pieces.is_empty() {
                done.push(part);
            } else {
                count += pieces.len() - 1;
                parts.extend(pieces);
            }
        }
        if done.len() > 1 || done[0].is_bare {
            members.iter().for_each(|&p| label[p as usize] = NO_SHEET);
            for (k, part) in done.iter_mut().enumerate() {
                let own = id(sheets.members.len() + laid.len() + k);
                part.members.iter().for_each(|&p| label[p as usize] = own);
                if params.landmarks != Landmarks::Auto {
                    *part = cutter.lay(&part.members, params.landmarks)?;
                }
            }
            context.warn("sheet_cut", said(number, (cutter.fault, fault), members.len(), &done));
        }
        laid.extend(done);
    }
    if label == sheets.sheet_of {
        return Ok(Laid { sheets, flat: laid.into_iter().map(|part| part.flat).collect() });
    }
    let sheets = in_order_of_size(surface, &label, sheets.pruned, context)?;
    let of_sheet = |members: &Vec<u32>| {
        let own = laid.iter_mut().find(|part| members.binary_search(&part.members[0]).is_ok());
        own.and_then(|part| part.flat.take())
    };
    let flat = sheets.members.iter().map(of_sheet).collect();
    Ok(Laid { sheets, flat })
}

/// One of two arms with `points` points or more each that meet no less than `length` behind the tip
/// of the shorter one: components of a superlevel set of `along`.
fn arm(
    surface: &Surface,
    along: &[f64],
    length: f64,
    points: usize,
    cancel: &dyn Cancel,
) -> Result<Option<Vec<usize>>, Cancelled> {
    let mut order: Vec<usize> = (0..along.len()).collect();
    order.sort_by(|&a, &b| along[b].total_cmp(&along[a]));
    let mut arm_of = vec![usize::MAX; along.len()];
    // Points of each component, its tip first; none once it met another.
    let mut arms: Vec<Vec<usize>> = Vec::new();
    let (mut best, mut evenness) = (None, 0);
    for p in order {
        cancel.check()?;
        let touching = surface.adjacency[p].iter().map(|&n| n as usize);
        let linked = touching.filter(|&n| (surface.positions[n] - surface.positions[p]).norm() < LINK);
        let mut met: Vec<usize> = linked.map(|n| arm_of[n]).filter(|a| *a != usize::MAX).collect();
        met.sort_by(|&a, &b| along[arms[b][0]].total_cmp(&along[arms[a][0]]).then(a.cmp(&b)));
        met.dedup();
        let Some((&farthest, others)) = met.split_first() else {
            arm_of[p] = arms.len();
            arms.push(vec![p]);
            continue;
        };
        for &other in others {
            let met = std::mem::take(&mut arms[other]);
            let is_arm = along[met[0]] - along[p] >= length && met.len().min(arms[farthest].len()) >= points;
            // Of the two that meet, the one that leaves the more even parts.
            for arm in [&met, &arms[farthest]] {
                let smaller_part = arm.len().min(along.len() - arm.len());
                if is_arm && smaller_part > evenness {
                    evenness = smaller_part;
                    best = Some(arm.clone());
                }
            }
            met.iter().for_each(|&q| arm_of[q] = farthest);
            arms[farthest].extend(met);
        }
        arm_of[p] = farthest;
        arms[farthest].push(p);
    }
    Ok(best)
}

/// Whether a sheet is refused for what it is, a band with one side or a ring: cut, it would look like
/// one that is not.
fn is_refused(surface: &MedialSurface, part: &Part, fault: Fault, cancel: &dyn Cancel) -> Result<bool, Cancelled> {
    if !part.is_curled(fault) {
        return Ok(false);
    }
    let region = part.flat.as_ref().map(|flat| Region::of(&flat.points, cancel)).transpose()?;
    Ok(region.is_some_and(|region| region.hole_share > HOLES_REFUSED)
        || !is_orientable(surface, &part.members, cancel)?)
}

/// What was done to a sheet.
fn said(number: usize, (fault, before): (Fault, f64), points: usize, parts: &[Part]) -> String {
    let left = points - parts.iter().map(|part| part.members.len()).sum::<usize>();
    let worst = parts.iter().map(|part| part.fault).fold(0.0, f64::max);
    let why = if before > fault.most() { "cannot be laid flat" } else { "forks around a notch" };
    let name = fault.name();
    let mut message = format!("sheet {number} {why} ({name} {before:.3})");
    if left > 0 {
        message += &format!("; {left} of its {points} points are in strings and were left out");
    }
    if parts.len() > 1 {
        message += &format!("; it was cut in {} parts", parts.len());
    }
    message + &format!("; the {name} is {worst:.3} at most now")
}

impl Cutter<'_> {
    /// What a part that cannot be laid flat, or forks, falls into, at most `more` parts more than there
    /// were; nothing when it stays. Strings are taken off first.
    fn pieces(&self, part: &Part, more: usize) -> Result<Vec<Part>, Cancelled> {
        if part.is_curled(self.fault) && !part.is_bare {
            let mut bare = self.without_strings(&part.members)?;
            bare.truncate(more.saturating_add(1));
            if bare.first().is_some_and(|largest| largest.len() < part.members.len()) {
                let lay =
                    |members: &Vec<u32>| self.lay(members, Landmarks::Auto).map(|part| Part { is_bare: true, ..part });
                return bare.iter().map(lay).collect();
            }
        }
        if more == 0 {
            return Ok(Vec::new());
        }
        let arm = part.arm(self.context)?;
        let halves = if let Some(members) = arm.map(|arm| self.split(part, &arm, MIN_ARM)).transpose()?.flatten() {
            Some(self.lay_both(part, &members)?)
        } else if part.is_curled(self.fault) {
            self.halves(part)?
        } else {
            None
        };
        Ok(halves.map_or_else(Vec::new, Vec::from))
    }

    /// Two parts of one, laid flat.
    fn lay_both(&self, part: &Part, members: &[Vec<u32>; 2]) -> Result<[Part; 2], Cancelled> {
        let halves = [self.lay(&members[0], Landmarks::Auto)?, self.lay(&members[1], Landmarks::Auto)?];
        Ok(halves.map(|half| Part { is_bare: part.is_bare, ..half }))
    }

    /// The connected pieces of a part that are wider than a string, the largest first.
    fn without_strings(&self, members: &[u32]) -> Result<Vec<Vec<u32>>, Cancelled> {
        let part = self.surface.part(members, self.context)?;
        let around = |start: usize| {
            let mut near = vec![id(start)];
            let mut from = 0;
            for _ in 0..STRING_STEPS {
                let layer = from..near.len();
                from = near.len();
                for k in layer {
                    for &n in &part.adjacency[near[k] as usize] {
                        if !near.contains(&n) {
                            near.push(n);
                        }
                    }
                }
            }
            near
        };
        let mut is_kept = vec![false; members.len()];
        for start in 0..members.len() {
            self.context.check()?;
            let near = around(start);
            if near.len() >= STRING_POINTS {
                near.iter().for_each(|&k| is_kept[k as usize] = true);
            }
        }
        let mut left: Vec<u32> = (0..members.len()).filter(|&k| is_kept[k]).map(|k| members[k]).collect();
        let mut pieces = Vec::new();
        while left.len() >= MIN_ARM {
            let piece = self.largest_piece(&left)?;
            if piece.len() < MIN_ARM {
                break;
            }
            left.retain(|p| piece.binary_search(p).is_err());
            pieces.push(piece);
        }
        Ok(pieces)
    }

    /// The largest connected piece of some points (ascending), laid flat.
    fn lay(&self, members: &[u32], landmarks: Landmarks) -> Result<Part, Cancelled> {
        let members = self.largest_piece(members)?;
        let surface = self.surface.part(&members, self.context)?;
        let method = Method { landmarks, ..self.context.params.into() };
        let flat = match flatten(&surface, method, self.voxel_mm, self.context) {
            Ok(flat) => Some(flat),
            Err(EmbeddingError::Cancelled(stop)) => return Err(stop),
            // Said where the sheet is laid out.
            Err(_) => None,
        };
        let fault = match (&flat, self.fault) {
            (None, _) => 0.0,
            (Some(flat), Fault::Residual) => flat.embedded.map_or(0.0, |embedded| embedded.residual_variance),
            (Some(flat), Fault::TurnedOver) => {
                flat.distortion(&surface, self.context)?.map_or(0.0, |distortion| distortion.turned_over)
            }
        };
        Ok(Part { members, surface, flat, fault, is_bare: false })
    }

    fn largest_piece(&self, members: &[u32]) -> Result<Vec<u32>, Cancelled> {
        let largest = self.surface.part(members, self.context)?.largest_piece(self.context)?;
        Ok(largest.into_iter().map(|k| members[k as usize]).collect())
    }

    /// The two parts of the cut that leaves the lowest fault, if that is lower than before.
    fn halves(&self, part: &Part) -> Result<Option<[Part; 2]>, Cancelled> {
        let Some(flat) = &part.flat else { return Ok(None) };
        let mut best: Option<[Part; 2]> = None;
        let mut least = part.fault;
        for axis in 0..2 {
            let mut order: Vec<usize> = (0..part.members.len()).collect();
            order.sort_by(|&a, &b| flat.points[a][axis].total_cmp(&flat.points[b][axis]));
            for place in PLACES {
                let split = floor_index(order.len() as f64 * place);
                let Some(members) = self.split(part, &order[..split], MIN_HALF)? else { continue };
                let halves = self.lay_both(part, &members)?;
                let worst = halves.iter().map(|half| half.fault).fold(0.0, f64::max);
                if worst < least {
                    least = worst;
                    best = Some(halves);
                }
            }
        }
        Ok(best)
    }

    /// Two connected parts: the largest piece of `low` (indices into the part), and the largest of
    /// the rest. What is left over goes to the first, which it touches. `None` when one is too small.
    fn split(&self, part: &Part, low: &[usize], least: usize) -> Result<Option<[Vec<u32>; 2]>, Cancelled> {
        let mut side = vec![false; part.members.len()];
        low.iter().for_each(|&k| side[k] = true);
        let of = |side: &[bool], wanted: bool| -> Vec<u32> {
            part.members.iter().zip(side).filter(|(_, s)| **s == wanted).map(|(p, _)| *p).collect()
        };
        let first = self.largest_piece(&of(&side, true))?;
        let not_in = |set: &[u32]| -> Vec<u32> {
            part.members.iter().copied().filter(|p| set.binary_search(p).is_err()).collect()
        };
        let second = self.largest_piece(&not_in(&first))?;
        let first = not_in(&second);
        Ok((first.len().min(second.len()) >= least).then_some([first, second]))
    }
}
