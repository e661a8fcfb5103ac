//! Sheets that cannot be laid flat are cut.
//!
//! ISOMAP lays a sheet out so that distances in the plane are those along it. A bowl has no such
//! plane: where its rim draws in it is laid over itself, and the map back to space takes the mean of
//! two layers. The residual variance tells such sheets, and so does the share that lies turned over. A bowl whose mesh can
//! be unrolled stays one sheet (`bowls`). Others are cut in two until every part can be
//! laid flat; the parts meet at a hinge, as branches do.
//!
//! LLE and Laplacian eigenmaps do not keep distances, so the residual variance of a good plane of theirs may be
//! large: of theirs it is the share that lies turned over.
//!
//! Two kinds of sheets can be laid flat and have no lattice: one that forks around a notch, of which an arm is cut off,
//! and one that bends in its own plane, like an L, whose rows would run into the bend at small angles (`part`).
//!
//! 1. A sheet without a plane of its own is unrolled by its mesh, if that is a disc, and a sheet with one hole (a band, a
//!    washer) is laid in a strip that begins again, if its mesh is a ring (`rings`);
//! 2. strings of single voxels, which no lattice covers, are taken off a sheet that has no plane of its own;
//! 3. of a sheet that forks, an arm is cut off;
//! 4. any other sheet without a plane or a lattice is cut in two across one axis of the plane, where that leaves the lower
//!    fault;
//! 5. and so on with the parts, as long as there may be more.
//!
//! The paper has no such step: its sheets are laid flat as they are.

mod arms;

mod bowls;

mod meshed;

mod rings;

mod part;

use self::arms::{MIN_ARM, arm};
use self::part::{Faults, Measure, Part};
use std::cell::Cell;

use crate::cancel::{Cancel, Cancelled};
use crate::numerics::field::{floor_index, id};
use crate::numerics::flood::within_steps;
use crate::params::{Embedding, GridChoice, Landmarks, LatticeKind};
use crate::pipeline::chart::LEAST_ROUND;
use crate::pipeline::context::Context;
use crate::pipeline::kind::{Kind, kind};
use crate::pipeline::medial::MedialSurface;
use crate::pipeline::plane::embedding::{EmbeddingError, Flat, Method, flatten};
use crate::pipeline::plane::region::Region;
use crate::pipeline::sheets::{NO_SHEET, Sheets, in_order};
use crate::pipeline::sides::is_orientable;
use crate::pipeline::solid::Solid;

/// Points that each half of a curled sheet keeps at least: a vertebra of 103 points was worse in two. With 200, none of
/// 75 organs and shapes changes.
const MIN_HALF: usize = 100;
/// Steps along the surface around a point that tell a sheet from a string.
const STRING_STEPS: usize = 2;
/// Points within these steps around a point of a sheet: 25 inside, 15 at a rim, 9 in a corner; on a string of single
/// voxels there are 5. From 6 to 15, one of 75 organs and shapes changes, a liver, by 0.01 in overlap.
const STRING_POINTS: usize = 10;
/// Where along the axes of the plane a sheet may be cut, as shares of its points. Each costs two planes on either axis.
/// At 0.5 alone, a part of a liver, the one of 75 organs and shapes that is cut so, is turned over on 5 % of its area;
/// with 0.1 and 0.9 for 0.4 and 0.6, its overlap is 0.88, not 0.86, but 22 of its corners fold, not 9.
const PLACES: [f64; 5] = [0.3, 0.4, 0.5, 0.6, 0.7];

/// Points that are laid out in all for the cuts of a part of a label. Of the 59 labels of a torso none takes more than 44 000,
/// nine times its own; a gyroid, of which each cut leaves nearly as many holes, took more than two million.
const MOST_LAID: usize = 1_000_000;

/// The warning that tells of a ring.
pub const RING: &str = "sheet_closes";

/// What becomes of sheets with one hole.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Rings {
    /// They stay whole, where that is sound.
    Whole,
    /// They are cut as other sheets are.
    Cut,
}

/// Sheets with the planes they were laid in.
pub struct Laid {
    /// The sheets.
    pub sheets: Sheets,
    /// The plane of the largest connected piece of each sheet, in the order of its points, unless
    /// there is none.
    pub flat: Vec<Option<Flat>>,
}

/// Lays sheets flat and cuts them.
struct Cutter<'a> {
    surface: &'a MedialSurface,
    voxel_mm: f64,
    has_tunnels: bool,
    measure: Measure,
    /// Whether what has no plane may be unrolled.
    may_unroll: bool,
    /// Whether what has one hole may be a ring.
    may_close: bool,
    /// Points that may still be laid out.
    left: Cell<usize>,
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
    rings: Rings,
    context: &Context<'_>,
) -> Result<Laid, Cancelled> {
    let params = context.params;
    let measure = Measure::of(params.embedding);
    let left = Cell::new(MOST_LAID);
    // The other embeddings are there to be looked at as they are.
    let may_unroll = params.embedding == Embedding::Isomap && !params.are_of_paper();
    let (voxel_mm, has_tunnels) = (solid.unit_mm, solid.has_tunnels());
    let has_columns = !matches!(params.grid, GridChoice::Fixed { cols, .. } if cols < LEAST_ROUND);
    let may_close = may_unroll && rings == Rings::Whole && params.lattice == LatticeKind::Fitted && has_columns;
    let cutter = Cutter { surface, voxel_mm, has_tunnels, measure, may_unroll, may_close, left, context };
    let mut spare = params.max_figures.unwrap_or(usize::MAX).saturating_sub(sheets.members.len());
    let mut label = sheets.sheet_of.clone();
    let mut laid = Vec::new();
    for (number, members) in sheets.members.iter().enumerate() {
        let whole = cutter.lay(members, params.landmarks)?;
        let before = whole.faults;
        let mut parts = cutter.cut(whole, &mut spare)?;
        if parts.len() > 1 || parts[0].is_bare {
            set_label(&mut label, members, NO_SHEET);
            for (k, part) in parts.iter_mut().enumerate() {
                if params.landmarks != Landmarks::Auto {
                    let is_bare = part.is_bare;
                    *part = cutter.closed_round(cutter.flattened(cutter.lay(&part.members, params.landmarks)?)?)?;
                    part.is_bare |= is_bare;
                }
                set_label(&mut label, &part.members, id(sheets.members.len() + laid.len() + k));
            }
        }
        match &parts[..] {
            [part] if part.is_ring() => {
                context.warn(RING, said_of_ring(number, before, members.len(), part));
            }
            [part] if part.is_unrolled() => {
                context.warn("sheet_unrolled", said_of_bowl(number, before, members.len(), part));
            }
            [part] if !part.is_bare => {}
            _ => context.warn("sheet_cut", said(number, before, members.len(), &parts)),
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
fn said(number: usize, before: Faults, points: usize, parts: &[Part]) -> String {
    let left = points - parts.iter().map(|part| part.members.len()).sum::<usize>();
    let why = if before.has_holes() {
        "has holes"
    } else if before.is_curled() {
        "cannot be laid flat"
    } else if before.is_bent() {
        "is bent so that no lattice fits it"
    } else {
        "forks around a notch"
    };
    let mut message = format!("sheet {number} {why} ({before})");
    if left > 0 {
        message += &format!("; {left} of its {points} points are in strings and were left out");
    }
    if parts.len() > 1 {
        message += &format!("; it was cut in {} parts", parts.len());
    }
    match worst(parts) {
        Some(faults) => message + &format!("; now at the worst {faults}"),
        None => message,
    }
}

/// What was done to a sheet that was unrolled in one.
fn said_of_bowl(number: usize, before: Faults, points: usize, part: &Part) -> String {
    let mut message = format!("sheet {number} cannot be laid flat by ISOMAP ({before}): its mesh was unrolled");
    if let Some(stretch) = part.flat.as_ref().and_then(|flat| flat.embedded?.unrolled) {
        message += &format!(", to {:.2} to {:.2} of its lengths", stretch.least, stretch.most);
    }
    let left = points - part.members.len();
    if left > 0 {
        message += &format!("; {left} of its {points} points lie off the mesh and were left out");
    }
    message
}

/// What was done to a sheet that is a ring.
fn said_of_ring(number: usize, before: Faults, points: usize, part: &Part) -> String {
    let mut message = format!("sheet {number} goes round a hole ({before}): it is one figure, which meets itself");
    let left = points - part.members.len();
    if left > 0 {
        message += &format!("; {left} of its {points} points lie off the mesh and were left out");
    }
    message
}

/// The faults of the worst part.
fn worst(parts: &[Part]) -> Option<Faults> {
    parts.iter().map(|part| part.faults).max_by(|a, b| a.worse().total_cmp(&b.worse()))
}

impl Cutter<'_> {
    /// The parts that a sheet is cut into, itself if it stays. `spare` counts the sheets that there may still be more.
    fn cut(&self, whole: Part, spare: &mut usize) -> Result<Vec<Part>, Cancelled> {
        let (mut parts, mut done) = (vec![whole], Vec::new());
        while let Some(part) = parts.pop() {
            let part = self.closed_round(self.flattened(part)?)?;
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

    /// Whether a sheet is refused for what it is, a band with one side: cut, it would look like one that is not.
    fn is_refused(&self, part: &Part) -> Result<bool, Cancelled> {
        Ok(part.faults.worse() > 1.0 && !is_orientable(self.surface, &part.members, self.context)?)
    }

    /// What a part that cannot be laid flat, or forks, falls into, at most `more` parts more than there
    /// were; nothing when it stays. Strings are taken off first.
    fn pieces(&self, part: &Part, more: usize) -> Result<Vec<Part>, Cancelled> {
        let is_faulty = part.faults.worse() > 1.0;
        if is_faulty
            && !part.is_bare
            && let Some(bare) = self.bared(part, more)?
        {
            return Ok(bare);
        }
        if more == 0 || self.left.get() == 0 {
            return Ok(Vec::new());
        }
        if let Some(flat) = &part.flat
            && let Some(arm) = arm(&part.surface, flat, self.context)?
            && let Some(members) = self.split(part, &arm, MIN_ARM)?
        {
            return Ok(self.lay_both(part, &members)?.into());
        }
        let halves = if is_faulty { self.halves(part)? } else { None };
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
        self.left.set(self.left.get().saturating_sub(members.len()));
        let surface = self.surface.part(&members, self.context)?;
        let method = Method { landmarks, ..self.context.params.into() };
        let flat = match flatten(&surface, method, self.voxel_mm, self.context.memory_bytes(), self.context) {
            Ok(flat) => Some(flat),
            Err(EmbeddingError::Cancelled(stop)) => return Err(stop),
            // Said where the sheet is laid out.
            Err(_) => None,
        };
        let (mut of_kind, mut faults) = (Kind::Sheet, Faults::none(self.measure));
        if let Some(flat) = &flat {
            let region = Region::of(&flat.points, self.context)?;
            of_kind = kind(&region, self.largest_radius(&members));
            faults = Faults::of((self.measure, self.has_tunnels), (flat, &region), &surface, self.context)?;
        }
        Ok(Part { members, surface, flat, kind: of_kind, faults, is_bare: false })
    }

    fn largest_radius(&self, members: &[u32]) -> f64 {
        members.iter().map(|&p| self.surface.point(p).radius).fold(0.0, f64::max)
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

    /// The two sheets of the cut that leaves the lowest fault, if that is lower than before.
    fn halves(&self, part: &Part) -> Result<Option<[Part; 2]>, Cancelled> {
        let Some(flat) = &part.flat else { return Ok(None) };
        let mut best: Option<[Part; 2]> = None;
        let mut least = part.faults.worse();
        for axis in 0..2 {
            let mut order: Vec<usize> = (0..part.members.len()).collect();
            order.sort_by(|&a, &b| flat.points[a][axis].total_cmp(&flat.points[b][axis]));
            for place in PLACES {
                if self.left.get() == 0 {
                    return Ok(best);
                }
                let low = &order[..floor_index(order.len() as f64 * place)];
                let Some(members) = self.split(part, low, MIN_HALF)? else { continue };
                let halves = self.lay_both(part, &members)?;
                let worse = halves[0].faults.worse().max(halves[1].faults.worse());
                if worse < least && halves.iter().all(|half| half.kind == Kind::Sheet) {
                    least = worse;
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
