//! Arms of a sheet that forks around a notch: such a sheet has no lattice, for columns would have to cross the notch.

use crate::cancel::{Cancel, Cancelled};
use crate::numerics::field::floor_index;
use crate::numerics::moments::bounds;
use crate::pipeline::plane::Flat;
use crate::pipeline::surface::Surface;

/// Points of an arm that is cut off, and of a piece between strings, at least: those of a lattice of 3 × 3 nodes with
/// something to fit each to. With 20 nothing changes; with 80 a spleen keeps its arm: its overlap is 0.88, not 0.91,
/// and four of its nodes end short.
pub(super) const MIN_ARM: usize = 40;
/// How far an arm juts out at least, as a share of the sheet's length. The notch of a spleen is
/// 25 % deep; the rims of organs without one have bays of 11 % at most.
const ARM_LENGTH: f64 = 0.15;
/// Points of an arm, as a share of the sheet's: the spleen's has 9 %, those at bays 2.4 %.
const ARM_POINTS: f64 = 0.05;
/// Distance of touching points of one arm at most, voxels: neighbouring voxels' centres are 1.7 apart.
/// Where the tips of two arms pass each other, their voxels touch and the points lie 3 apart.
const LINK: f64 = 2.5;

/// One of two arms of a sheet that forks along its long axis. Indices into its points.
pub(super) fn arm(surface: &Surface, flat: &Flat, cancel: &dyn Cancel) -> Result<Option<Vec<usize>>, Cancelled> {
    let count = flat.points.len();
    let [low, high] = bounds(&flat.points);
    let length = ARM_LENGTH * (high.x - low.x);
    let least = MIN_ARM.max(floor_index(ARM_POINTS * count as f64));
    let along: Vec<f64> = flat.points.iter().map(|p| p.x).collect();
    let back = along.iter().map(std::ops::Neg::neg).collect();
    let first = Arms::new(along, length, least).grown(surface, cancel)?;
    let other = Arms::new(back, length, least).grown(surface, cancel)?;
    Ok([first, other].into_iter().flatten().max_by_key(|arm| smaller_part(arm, count)))
}

/// Points of an arm, or of what is left of `count` without it, whichever are fewer.
fn smaller_part(arm: &[usize], count: usize) -> usize {
    arm.len().min(count - arm.len())
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
