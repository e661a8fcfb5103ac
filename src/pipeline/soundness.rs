//! How well figures stand for a solid, as far as a choice between several ways of representing it needs to know.

use super::draft::AnyDraft;
use super::quality::overlap::overlap_with_part;
use super::solid::Solid;
use super::tubes::Tubes;
use crate::cancel::{Cancel, Cancelled};

/// Overlap with the solid's mask from which figures are sound.
const SOUND_OVERLAP: f64 = 0.87;
/// Share of their nodes that may be spoilt: with more the verdict is `fail`.
const SOUND_SPOILT: f64 = 0.05;

/// Overlap that more figures must add to be worth it. With none, a sacrum falls into eight figures for 0.01.
const WORTH_MORE: f64 = 0.01;
/// What a sheet that lies turned over where it was laid flat counts in overlap: the verdict is `fail`.
const TURNED_OVER: f64 = 0.03;

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
        let turned_over = if self.lies_flat { 0.0 } else { TURNED_OVER };
        self.overlap - self.spoilt - turned_over
    }
}

/// Whether a figure is sound by itself, whatever it fills.
pub(super) fn is_sound(draft: AnyDraft<'_>) -> bool {
    let repair = draft.repair();
    draft.is_legal() && !draft.is_turned_over() && repair.marred_nodes as f64 <= SOUND_SPOILT * repair.nodes as f64
}
