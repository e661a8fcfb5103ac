//! How well figures stand for a solid, as far as a choice between several ways of representing it needs to know.

use super::draft::AnyDraft;
use super::quality::overlap::overlap_with_part;
use super::solid::Solid;
use super::tubes::Tubes;
use crate::cancel::{Cancel, Cancelled};

/// Overlap with the solid's mask from which figures are sound. With 0.8, L1, L3, L4 and L5 have overlaps of 0.80 to 0.83, not 0.88;
/// with 0.92 adrenal glands are tubes.
pub(super) const SOUND_OVERLAP: f64 = 0.87;
/// Share of their nodes that may be spoilt: with more the verdict is `fail`.
const SOUND_SPOILT: f64 = 0.05;

/// Overlap that more figures must add to be worth it. With none the first small gain is taken, which leaves less to be gained:
/// L1 and L2 have 0.82 and 0.85, not 0.89; with 0.03 an L4 has a figure less.
const WORTH_MORE: f64 = 0.01;

/// How well figures stand for a solid.
#[derive(Clone, Copy, Debug)]
pub(super) struct Soundness {
    /// Whether no vectors cross.
    pub is_legal: bool,
    /// Share of the nodes that are spoilt.
    pub spoilt: f64,
    /// Dice of what they fill with the mask.
    pub overlap: f64,
    /// Whether every sheet lies flat where it was laid so.
    pub lies_flat: bool,
}

impl Soundness {
    /// Of the figures of a solid.
    ///
    /// # Errors
    /// When it is cancelled.
    pub fn of(solid: &Solid, drafts: &[AnyDraft<'_>], cancel: &dyn Cancel) -> Result<Self, Cancelled> {
        let overlap = overlap_with_part(solid, drafts, cancel)?;
        let (mut is_legal, mut lies_flat, mut nodes, mut spoilt) = (true, true, 0, 0);
        for draft in drafts {
            lies_flat &= !draft.is_turned_over();
            is_legal &= draft.is_legal();
            nodes += draft.repair().nodes;
            spoilt += draft.repair().marred_nodes;
        }
        Ok(Self { is_legal, spoilt: spoilt as f64 / nodes.max(1) as f64, overlap, lies_flat })
    }

    /// Of tubes.
    ///
    /// # Errors
    /// When it is cancelled.
    pub fn of_tubes(solid: &Solid, tubes: &Tubes, cancel: &dyn Cancel) -> Result<Self, Cancelled> {
        let drafts: Vec<AnyDraft<'_>> = tubes.drafts.iter().map(AnyDraft::Tube).collect();
        Self::of(solid, &drafts, cancel)
    }

    /// Whether no vectors cross, and few nodes are spoilt.
    pub fn spoils_few(self) -> bool {
        self.is_legal && self.spoilt <= SOUND_SPOILT
    }

    /// Whether they fill the solid with few spoilt nodes.
    pub fn fills(self) -> bool {
        self.spoils_few() && self.overlap >= SOUND_OVERLAP
    }

    /// Whether there is no need to divide the solid.
    pub fn is_sound(self) -> bool {
        self.fills() && self.lies_flat
    }

    /// Whether these are worth more figures than others have: legal ones are; of two that are, or are not, what fills clearly
    /// more without spoilt nodes.
    pub fn is_better_than(self, other: Self) -> bool {
        if self.is_legal != other.is_legal {
            return self.is_legal;
        }
        self.merit() > other.merit() + WORTH_MORE
    }

    fn merit(self) -> f64 {
        self.overlap - self.spoilt
    }
}

/// Whether a figure is sound by itself, whatever it fills.
pub(super) fn is_sound(draft: AnyDraft<'_>) -> bool {
    let repair = draft.repair();
    draft.is_legal() && !draft.is_turned_over() && repair.marred_nodes as f64 <= SOUND_SPOILT * repair.nodes as f64
}
