//! Spokes that are cut short of the boundary, because they cross whichever way they are turned.

use std::collections::BTreeSet;

use super::spoked_lattice::{SpokedLattice, longest};
use crate::cancel::Cancelled;

/// What a vector is shortened to in a round. At 0.95 the rounds are over while four of 33 structures still fold; at 0.7
/// a fifth more nodes end short (288 against 244): more is cut than can be given back.
pub(super) const CUT: f64 = 0.85;

impl SpokedLattice<'_> {
    /// Cuts a spoke back, by a share of what is left of it.
    pub(super) fn shorten(&mut self, side: usize, n: usize) {
        self.set_length(side, n, self.lengths[side][n] * CUT);
    }

    /// Gives the spokes of nodes that were cut back what they can have.
    pub(super) fn lengthen(&mut self, cut: &BTreeSet<usize>) -> Result<(), Cancelled> {
        for &n in cut {
            self.cancel.check()?;
            self.lengthen_spoke(0, n);
            self.lengthen_spoke(1, n);
        }
        Ok(())
    }

    /// The greatest length, by halving, with which the cells around are legal; that it has, when it is none.
    fn lengthen_spoke(&mut self, side: usize, n: usize) {
        /// Halvings of what was cut. Without them 338 nodes end short instead of 244; twice as many make 5 nodes less.
        const HALVINGS: usize = 6;
        let mut low = self.lengths[side][n];
        self.let_reach(side, n);
        let mut high = self.lengths[side][n];
        for _ in 0..HALVINGS {
            if self.is_legal_around(side, n) {
                low = self.lengths[side][n];
            } else {
                high = self.lengths[side][n];
            }
            if low >= high {
                break;
            }
            self.set_length(side, n, (low + high) / 2.0);
        }
        self.set_length(side, n, low);
    }

    /// Nodes with a spoke that was cut short.
    ///
    /// # Errors
    /// When it is cancelled.
    pub fn short(&self) -> Result<BTreeSet<usize>, Cancelled> {
        self.nodes_where(Self::falls_short)
    }

    /// Nodes with a spoke that runs past its foot.
    ///
    /// # Errors
    /// When it is cancelled.
    pub fn past_foot(&self) -> Result<BTreeSet<usize>, Cancelled> {
        self.nodes_where(Self::runs_past_foot)
    }

    /// Nodes of which something holds on a side.
    fn nodes_where(&self, holds: impl Fn(&Self, usize, usize) -> bool) -> Result<BTreeSet<usize>, Cancelled> {
        let mut nodes = BTreeSet::new();
        for n in 0..self.medial.len() {
            self.cancel.check()?;
            if self.links().own(n) == n && (holds(self, 0, n) || holds(self, 1, n)) {
                nodes.insert(n);
            }
        }
        Ok(nodes)
    }

    /// Whether a spoke ends before it need.
    fn falls_short(&self, side: usize, n: usize) -> bool {
        /// Share of a length that rounding may take.
        const ROUNDING: f64 = 1e-6;
        let whole = self.around.length(&self.medial[n], self.directions[side][n]);
        self.lengths[side][n] < whole * (1.0 - ROUNDING)
    }

    /// Whether a spoke does not meet the boundary within [`longest`].
    fn runs_past_foot(&self, side: usize, n: usize) -> bool {
        let node = &self.medial[n];
        self.around.boundary(node, self.directions[side][n]).is_none_or(|length| length > longest(node))
    }
}
