//! Cross-sections: closed curves on the skin of a solid where a function has one value.

use nalgebra::{Point3, Vector3};

use super::cells::Cells;
use super::drain::Drain;
use super::ring::Cut;
use crate::cancel::{Cancel, Cancelled};
use crate::numerics::parallel::each;
use crate::numerics::polyline::Polyline;
use crate::numerics::surface_nets::Mesh;

/// Rounds in which values on the skin are smoothed: what is left of the stairs of the cells. With none, sections have a
/// second curve in one of ten thin tubes; with 10, those near tips come loose.
const SMOOTH_ROUNDS: usize = 2;
/// Length of a curve over that of the longest of its section above which it is one of its own: smaller ones are made by
/// bumps.
const OWN_CURVE: f64 = 0.2;

/// The skin of a solid with the values of a function.
pub struct Skin {
    mesh: Mesh,
    values: Vec<f64>,
    /// The branch of the cell nearest to each corner.
    branches: Vec<usize>,
    /// The corners on either bank of the cut that opened it.
    banks: [Vec<usize>; 2],
}

/// The curves of a cross-section, the longest first.
pub struct Section {
    /// Closed lines; their first point comes again at the end.
    pub curves: Vec<Polyline<3>>,
}

impl Section {
    /// Whether it has several curves of its own: what it cuts is no single tube.
    pub fn is_split(&self) -> bool {
        self.curves.get(1).is_some_and(|second| second.length() > OWN_CURVE * self.curves[0].length())
    }
}

impl Skin {
    /// With the values of a tube's function, opened where the cells are.
    ///
    /// # Errors
    /// When it is cancelled.
    pub fn of(mut mesh: Mesh, drain: &Drain<'_>, cancel: &dyn Cancel) -> Result<Self, Cancelled> {
        let banks = drain.cells.cut().map_or_else(Default::default, |cut| opened(&mut mesh, cut));
        let values = each(&mesh.positions, 256, |p| drain.at(*p).unwrap_or(f64::NAN), cancel)?;
        let branches = vec![0; values.len()];
        let mut skin = Self { mesh, values, branches, banks };
        skin.close_gaps();
        for _ in 0..SMOOTH_ROUNDS {
            cancel.check()?;
            skin.smooth();
        }
        Ok(skin)
    }

    /// Notes the branches of its corners: those of the cells nearest to them.
    ///
    /// # Errors
    /// When it is cancelled.
    pub fn set_branches(&mut self, cells: &Cells, branch_of: &[usize], cancel: &dyn Cancel) -> Result<(), Cancelled> {
        let branch = |p: &Point3<f64>| cells.nearest(*p).map_or(usize::MAX, |cell| branch_of[cell]);
        self.branches = each(&self.mesh.positions, 256, branch, cancel)?;
        Ok(())
    }

    /// Gives corners far from all cells the mean of those that they are joined to, as far as there is one.
    fn close_gaps(&mut self) {
        while self.values.iter().any(|value| value.is_nan()) {
            let (sums, counts) = self.around();
            let mut is_changed = false;
            for (n, value) in self.values.iter_mut().enumerate() {
                if value.is_nan() && counts[n] > 0.0 {
                    *value = sums[n] / counts[n];
                    is_changed = true;
                }
            }
            if !is_changed {
                self.values.iter_mut().filter(|value| value.is_nan()).for_each(|value| *value = 0.0);
            }
        }
    }

    fn smooth(&mut self) {
        let (sums, counts) = self.around();
        for (n, value) in self.values.iter_mut().enumerate() {
            if counts[n] > 0.0 {
                *value = (*value + sums[n] / counts[n]) / 2.0;
            }
        }
    }

    /// Of every corner the sum of the values of those that it is joined to, and how many have one; each for either
    /// triangle of an edge.
    fn around(&self) -> (Vec<f64>, Vec<f64>) {
        let (mut sums, mut counts) = (vec![0.0; self.values.len()], vec![0.0; self.values.len()]);
        for triangle in &self.mesh.triangles {
            for k in 0..3 {
                let (here, next) = (triangle[k] as usize, triangle[(k + 1) % 3] as usize);
                for (a, b) in [(here, next), (next, here)] {
                    if !self.values[b].is_nan() {
                        sums[a] += self.values[b];
                        counts[a] += 1.0;
                    }
                }
            }
        }
        (sums, counts)
    }

    /// The values between which sections reach neither bank of the cut.
    pub fn bank_values(&self) -> [f64; 2] {
        let values = |bank: usize| self.banks[bank].iter().map(|&n| self.values[n]);
        [values(0).fold(f64::NEG_INFINITY, f64::max), values(1).fold(f64::INFINITY, f64::min)]
    }

    /// The corners of a branch with the least and the largest value, and these; `None` of a branch without skin.
    pub fn tips(&self, branch: usize) -> Option<[(Point3<f64>, f64); 2]> {
        let mut ends: Option<[usize; 2]> = None;
        for (n, value) in self.values.iter().enumerate().filter(|(n, _)| self.branches[*n] == branch) {
            let [least, largest] = ends.get_or_insert([n, n]);
            if *value < self.values[*least] {
                *least = n;
            }
            if *value > self.values[*largest] {
                *largest = n;
            }
        }
        ends.map(|ends| ends.map(|n| (self.mesh.positions[n], self.values[n])))
    }

    /// The section of a branch where the function has a value: curves of which most is its own.
    pub fn section(&self, branch: usize, value: f64) -> Section {
        let mut steps = Vec::new();
        for triangle in &self.mesh.triangles {
            steps.extend(self.step(triangle.map(|n| n as usize), value));
        }
        steps.sort_unstable();
        let mut curves = Vec::new();
        let mut is_taken = vec![false; steps.len()];
        for first in 0..steps.len() {
            let (curve, own) = self.curve(&steps, first, &mut is_taken, (branch, value));
            if curve.len() > 2 && 2 * own > curve.len() {
                curves.push(Polyline::closed(curve));
            }
        }
        curves.sort_by(|a, b| b.length().total_cmp(&a.length()));
        Section { curves }
    }

    /// From the edge where a section comes into a triangle to the one where it leaves.
    fn step(&self, corners: [usize; 3], value: f64) -> Option<[Edge; 2]> {
        let is_above = corners.map(|n| self.values[n] > value);
        let (mut from, mut to) = (None, None);
        for k in 0..3 {
            let next = (k + 1) % 3;
            let edge = [corners[k].min(corners[next]), corners[k].max(corners[next])];
            match (is_above[k], is_above[next]) {
                (true, false) => from = Some(edge),
                (false, true) => to = Some(edge),
                _ => {}
            }
        }
        Some([from?, to?])
    }

    /// The points of a curve from a step on, round to where it began, and how many lie on a branch.
    fn curve(
        &self,
        steps: &[[Edge; 2]],
        first: usize,
        is_taken: &mut [bool],
        (branch, value): (usize, f64),
    ) -> (Vec<Vector3<f64>>, usize) {
        let (mut points, mut own) = (Vec::new(), 0);
        let mut step = first;
        while !is_taken[step] {
            is_taken[step] = true;
            points.push(self.crossing(steps[step][0], value));
            own += usize::from(self.branches[steps[step][0][0]] == branch);
            let wanted = steps[step][1];
            let from = steps.partition_point(|step| step[0] < wanted);
            // Several curves may meet in one edge of a mesh that touches itself: any that is left.
            let left = (from..steps.len()).take_while(|&n| steps[n][0] == wanted).find(|&n| !is_taken[n]);
            let Some(next) = left else { break };
            step = next;
        }
        (points, own)
    }

    fn crossing(&self, [a, b]: Edge, value: f64) -> Vector3<f64> {
        let [from, to] = [self.values[a], self.values[b]];
        let share = ((value - from) / (to - from)).clamp(0.0, 1.0);
        let [a, b] = [a, b].map(|n| self.mesh.positions[n].coords);
        a + (b - a) * share
    }
}

/// Takes the triangles that a cut passes through out of a mesh; their corners, on either bank.
fn opened(mesh: &mut Mesh, cut: &Cut) -> [Vec<usize>; 2] {
    let mut banks = [Vec::new(), Vec::new()];
    let positions = &mesh.positions;
    mesh.triangles.retain(|triangle| {
        let corners = triangle.map(|n| positions[n as usize]);
        let is_cut = (0..3).any(|k| cut.parts(corners[k], corners[(k + 1) % 3]));
        if is_cut {
            for (n, corner) in triangle.iter().zip(corners) {
                banks[cut.bank(corner)].push(*n as usize);
            }
        }
        !is_cut
    });
    banks
}

/// An edge of the mesh by its corners, the lower number first.
type Edge = [usize; 2];
