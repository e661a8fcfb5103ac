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
//!
//! 1. Strings of single voxels, which no lattice covers, are taken off a sheet that has no plane of its own;
//! 2. of a sheet that forks, an arm is cut off;
//! 3. any other sheet without a plane is cut in two across one axis of the plane, where that leaves the lower fault;
//! 4. and so on with the parts, as long as there may be more.
//!
//! The paper has no such step: its sheets are laid flat as they are.

use crate::cancel::{Cancel, Cancelled};
use crate::numerics::field::{floor_index, id};
use crate::numerics::flood::within_steps;
use crate::numerics::moments::bounds;
use crate::params::{Embedding, Landmarks};
use crate::pipeline::context::Context;
use crate::pipeline::medial::MedialSurface;
use crate::pipeline::plane::embedding::{EmbeddingError, Flat, MAX_TURNED_OVER, Method, flatten};
use crate::pipeline::plane::region::{HOLES_REFUSED, Region};
use crate::pipeline::sheets::{NO_SHEET, Sheets, in_order};
use crate::pipeline::sides::is_orientable;
use crate::pipeline::solid::Solid;
use crate::pipeline::surface::Surface;

/// Residual variance above which a sheet counts as not laid flat. Sheets known to be developable
/// have 0.0006 at most, organs that are laid out well 0.008, and sheets that lie over themselves in
/// the plane 0.04 and more.
const MAX_RESIDUAL: f64 = 0.018;
/// Points that each half of a curled sheet keeps at least: a vertebra of 103 points was worse in two. With 200, none of
/// 75 organs and shapes changes.
const MIN_HALF: usize = 100;
/// Points of an arm that is cut off, and of a piece between strings, at least: those of a lattice of 3 × 3 nodes with
/// something to fit each to. With 20 nothing changes; with 80 a spleen keeps its arm: its overlap is 0.88, not 0.91,
/// and four of its nodes end short.
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
/// Points within these steps around a point of a sheet: 25 inside, 15 at a rim, 9 in a corner; on a string of single
/// voxels there are 5. From 6 to 15, one of 75 organs and shapes changes, a liver, by 0.01 in overlap.
const STRING_POINTS: usize = 10;
/// Where along the axes of the plane a sheet may be cut, as shares of its points. Each costs two planes on either axis.
/// At 0.5 alone, a part of a liver, the one of 75 organs and shapes that is cut so, is turned over on 5 % of its area;
/// with 0.1 and 0.9 for 0.4 and 0.6, its overlap is 0.88, not 0.86, but 22 of its corners fold, not 9.
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
        let count = flat.points.len();
        let [low, high] = bounds(&flat.points);
        let length = ARM_LENGTH * (high.x - low.x);
        let least = MIN_ARM.max(floor_index(ARM_POINTS * count as f64));
        let along: Vec<f64> = flat.points.iter().map(|p| p.x).collect();
        let back = along.iter().map(std::ops::Neg::neg).collect();
        let first = Arms::new(along, length, least).grown(&self.surface, cancel)?;
        let other = Arms::new(back, length, least).grown(&self.surface, cancel)?;
        Ok([first, other].into_iter().flatten().max_by_key(|arm| smaller_part(arm, count)))
    }
}

/// Points of an arm, or of what is left of `count` without it, whichever are fewer.
fn smaller_part(arm: &[usize], count: usize) -> usize {
    arm.len().min(count - arm.len())
}

/// Lays sheets flat and cuts them.
struct Cutter<'a> {
    surface: &'a MedialSurface,
    voxel_mm: f64,
    has_tunnels: bool,
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
    let fault = Fault::of(params.embedding);
    let cutter = Cutter { surface, voxel_mm: solid.unit_mm, has_tunnels: solid.has_tunnels, fault, context };
    let mut spare = params.max_figures.unwrap_or(usize::MAX).saturating_sub(sheets.members.len());
    let mut label = sheets.sheet_of.clone();
    let mut laid = Vec::new();
    for (number, members) in sheets.members.iter().enumerate() {
        let whole = cutter.lay(members, params.landmarks)?;
        let fault = whole.fault;
        let mut parts = cutter.cut(whole, &mut spare)?;
        if parts.len() > 1 || parts[0].is_bare {
            set_label(&mut label, members, NO_SHEET);
            for (k, part) in parts.iter_mut().enumerate() {
                set_label(&mut label, &part.members, id(sheets.members.len() + laid.len() + k));
                if params.landmarks != Landmarks::Auto {
                    *part = cutter.lay(&part.members, params.landmarks)?;
                }
            }
            context.warn("sheet_cut", said(number, (cutter.fault, fault), members.len(), &parts));
        }
        laid.extend(parts);
    }
    if label == sheets.sheet_of {
        return Ok(Laid { sheets, flat: laid.into_iter().map(|part| part.flat).collect() });
    }
    let sheets = in_order(surface, solid, &label, sheets.pruned, context)?;
    let flat = sheets.members.iter().map(|members| taken_plane(&mut laid, members)).collect();
    Ok(Laid { sheets, flat })
}

fn set_label(label: &mut [u32], members: &[u32], value: u32) {
    for &p in members {
        label[p as usize] = value;
    }
}

/// The plane of the part that a sheet (ascending) was made of.
fn taken_plane(parts: &mut [Part], members: &[u32]) -> Option<Flat> {
    for part in parts {
        if members.binary_search(&part.members[0]).is_ok() {
            return part.flat.take();
        }
    }
    None
}

/// What was done to a sheet.
fn said(number: usize, (fault, before): (Fault, f64), points: usize, parts: &[Part]) -> String {
    let left = points - parts.iter().map(|part| part.members.len()).sum::<usize>();
    let worst = worst_fault(parts);
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

fn worst_fault(parts: &[Part]) -> f64 {
    let mut worst = 0.0f64;
    for part in parts {
        worst = worst.max(part.fault);
    }
    worst
}

impl Cutter<'_> {
    /// The parts that a sheet is cut into, itself if it stays. `spare` counts the sheets that there may still be more.
    fn cut(&self, whole: Part, spare: &mut usize) -> Result<Vec<Part>, Cancelled> {
        let (mut parts, mut done) = (vec![whole], Vec::new());
        while let Some(part) = parts.pop() {
            let pieces = if self.is_refused(&part)? { Vec::new() } else { self.pieces(&part, *spare)? };
            if pieces.is_empty() {
                done.push(part);
            } else {
                *spare -= pieces.len() - 1;
                parts.extend(pieces);
            }
        }
        Ok(done)
    }

    /// Whether a sheet is refused for what it is, a band with one side or a ring: cut, it would look like
    /// one that is not.
    fn is_refused(&self, part: &Part) -> Result<bool, Cancelled> {
        if !part.is_curled(self.fault) {
            return Ok(false);
        }
        if self.has_tunnels
            && let Some(flat) = &part.flat
            && Region::of(&flat.points, self.context)?.hole_share > HOLES_REFUSED
        {
            return Ok(true);
        }
        Ok(!is_orientable(self.surface, &part.members, self.context)?)
    }

    /// What a part that cannot be laid flat, or forks, falls into, at most `more` parts more than there
    /// were; nothing when it stays. Strings are taken off first.
    fn pieces(&self, part: &Part, more: usize) -> Result<Vec<Part>, Cancelled> {
        let is_curled = part.is_curled(self.fault);
        if is_curled
            && !part.is_bare
            && let Some(bare) = self.bared(part, more)?
        {
            return Ok(bare);
        }
        if more == 0 {
            return Ok(Vec::new());
        }
        if let Some(arm) = part.arm(self.context)?
            && let Some(members) = self.split(part, &arm, MIN_ARM)?
        {
            return Ok(self.lay_both(part, &members)?.into());
        }
        let halves = if is_curled { self.halves(part)? } else { None };
        Ok(halves.map_or_else(Vec::new, Vec::from))
    }

    /// A part without its strings, in at most `more` pieces more; `None` where it has none.
    fn bared(&self, part: &Part, more: usize) -> Result<Option<Vec<Part>>, Cancelled> {
        let mut pieces = self.without_strings(&part.members)?;
        pieces.truncate(more.saturating_add(1));
        if pieces.first().is_none_or(|largest| largest.len() == part.members.len()) {
            return Ok(None);
        }
        let mut bare = Vec::with_capacity(pieces.len());
        for members in &pieces {
            bare.push(Part { is_bare: true, ..self.lay(members, Landmarks::Auto)? });
        }
        Ok(Some(bare))
    }

    /// The connected pieces of a part that are wider than a string, the largest first.
    fn without_strings(&self, members: &[u32]) -> Result<Vec<Vec<u32>>, Cancelled> {
        let part = self.surface.part(members, self.context)?;
        let mut is_kept = vec![false; members.len()];
        for start in 0..members.len() {
            self.context.check()?;
            let near = within_steps(&part.adjacency, id(start), STRING_STEPS);
            if near.len() >= STRING_POINTS {
                for k in near {
                    is_kept[k as usize] = true;
                }
            }
        }
        let mut left = marked(members, &is_kept);
        let mut pieces = Vec::new();
        while left.len() >= MIN_ARM {
            let piece = self.largest_piece(&left)?;
            if piece.len() < MIN_ARM {
                break;
            }
            left = without(&left, &piece);
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
        let fault = match &flat {
            Some(flat) => self.fault_of(flat, &surface)?,
            None => 0.0,
        };
        Ok(Part { members, surface, flat, fault, is_bare: false })
    }

    /// What is wrong with a plane, by the measure of the embedding.
    fn fault_of(&self, flat: &Flat, surface: &Surface) -> Result<f64, Cancelled> {
        Ok(match self.fault {
            Fault::Residual => flat.embedded.map_or(0.0, |embedded| embedded.residual_variance),
            Fault::TurnedOver => flat.distortion(surface, self.context)?.map_or(0.0, |found| found.turned_over),
        })
    }

    /// Two parts of one, laid flat.
    fn lay_both(&self, part: &Part, [first, second]: &[Vec<u32>; 2]) -> Result<[Part; 2], Cancelled> {
        let first = Part { is_bare: part.is_bare, ..self.lay(first, Landmarks::Auto)? };
        let second = Part { is_bare: part.is_bare, ..self.lay(second, Landmarks::Auto)? };
        Ok([first, second])
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
                let low = &order[..floor_index(order.len() as f64 * place)];
                let Some(members) = self.split(part, low, MIN_HALF)? else { continue };
                let halves = self.lay_both(part, &members)?;
                if worst_fault(&halves) < least {
                    least = worst_fault(&halves);
                    best = Some(halves);
                }
            }
        }
        Ok(best)
    }

    /// Two connected parts: the largest piece of `low` (indices into the part), and the largest of
    /// the rest. What is left over goes to the first, which it touches. `None` when one is too small.
    fn split(&self, part: &Part, low: &[usize], least: usize) -> Result<Option<[Vec<u32>; 2]>, Cancelled> {
        let mut is_low = vec![false; part.members.len()];
        for &k in low {
            is_low[k] = true;
        }
        let first = self.largest_piece(&marked(&part.members, &is_low))?;
        let second = self.largest_piece(&without(&part.members, &first))?;
        let first = without(&part.members, &second);
        Ok((first.len().min(second.len()) >= least).then_some([first, second]))
    }
}

/// The members that are marked.
fn marked(members: &[u32], is_marked: &[bool]) -> Vec<u32> {
    let mut left = Vec::new();
    for (&p, &is) in members.iter().zip(is_marked) {
        if is {
            left.push(p);
        }
    }
    left
}

/// The members that are not in `taken` (ascending).
fn without(members: &[u32], taken: &[u32]) -> Vec<u32> {
    members.iter().copied().filter(|p| taken.binary_search(p).is_err()).collect()
}

/// No arm.
const NO_ARM: usize = usize::MAX;

/// The arms of a sheet, grown from their tips back by the points in the order of `along`: components of its
/// superlevel sets.
struct Arms {
    /// The coordinate that tips have most of.
    along: Vec<f64>,
    /// How far behind its tip an arm must meet another at the least.
    length: f64,
    /// Points it must have by then.
    least: usize,
    arm_of: Vec<usize>,
    /// Points of each, its tip first; none once it met another.
    members: Vec<Vec<usize>>,
    /// Of all arms that met, the one that leaves the most even parts, and the points of the smaller part.
    best: Option<Vec<usize>>,
    evenness: usize,
}

impl Arms {
    fn new(along: Vec<f64>, length: f64, least: usize) -> Self {
        let arm_of = vec![NO_ARM; along.len()];
        Self { along, length, least, arm_of, members: Vec::new(), best: None, evenness: 0 }
    }

    /// Of two arms that meet no less than `length` behind the tip of the shorter one, with `least` points or more each,
    /// the one that leaves the more even parts.
    fn grown(mut self, surface: &Surface, cancel: &dyn Cancel) -> Result<Option<Vec<usize>>, Cancelled> {
        let mut order: Vec<usize> = (0..self.along.len()).collect();
        order.sort_by(|&a, &b| self.along[b].total_cmp(&self.along[a]));
        for p in order {
            cancel.check()?;
            let met = self.met_by(surface, p);
            let own = met.first().copied().unwrap_or(self.members.len());
            if met.is_empty() {
                self.members.push(Vec::new());
            }
            for &shorter in met.iter().skip(1) {
                self.join(shorter, own, p);
            }
            self.arm_of[p] = own;
            self.members[own].push(p);
        }
        Ok(self.best)
    }

    /// The arms that a point touches, the one with the farthest tip first.
    fn met_by(&self, surface: &Surface, p: usize) -> Vec<usize> {
        let mut met = Vec::new();
        for &n in &surface.adjacency[p] {
            let arm = self.arm_of[n as usize];
            let is_linked = (surface.positions[n as usize] - surface.positions[p]).norm() < LINK;
            if is_linked && arm != NO_ARM {
                met.push(arm);
            }
        }
        met.sort_by(|&a, &b| self.tip(b).total_cmp(&self.tip(a)).then(a.cmp(&b)));
        met.dedup();
        met
    }

    /// Where an arm ends.
    fn tip(&self, arm: usize) -> f64 {
        self.along[self.members[arm][0]]
    }

    /// Two arms meet at a point and become one.
    fn join(&mut self, shorter: usize, longer: usize, p: usize) {
        let length = self.tip(shorter) - self.along[p];
        let met = std::mem::take(&mut self.members[shorter]);
        if length >= self.length && met.len().min(self.members[longer].len()) >= self.least {
            for arm in [&met, &self.members[longer]] {
                let smaller = smaller_part(arm, self.along.len());
                if smaller > self.evenness {
                    self.evenness = smaller;
                    self.best = Some(arm.clone());
                }
            }
        }
        for &q in &met {
            self.arm_of[q] = longer;
        }
        self.members[longer].extend(met);
    }
}
