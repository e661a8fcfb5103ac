//! What became of the voxels of a label.

use super::Answered;
use super::verdict::Places;
use crate::model::{Kept, WorldPlace};
use crate::pipeline::solid::parts::Sent;
use crate::space::WorldPoint;

/// The voxels of a label as shares of all that were sent, and where some of them are. `unanswered` is the surface of
/// what has no figures.
pub fn kept(sent: &Sent, parts: &[Answered<'_>], unanswered: &[WorldPoint], places: &mut Places) -> Kept {
    let (mut answered, mut lost, mut thin, mut filled, mut closed) = (0, 0, 0, 0, 0);
    for part in parts {
        let changes = part.changes;
        answered += sent.parts[part.part].voxels;
        lost += changes.lost.voxels;
        thin += changes.thin;
        filled += changes.filled.voxels;
        closed += changes.closed.voxels;
        places.lost = places.lost.or(of_mask(changes.lost.at));
        places.filled = places.filled.or(of_mask(changes.filled.at));
        places.closed = places.closed.or(of_mask(changes.closed.at));
    }
    places.kept = of_mask(unanswered.get(unanswered.len() / 2).copied()).or(places.lost);
    let share = |voxels: usize| voxels as f64 / sent.voxels.max(1) as f64;
    let dropped = sent.dropped();
    Kept {
        kept: share(answered - lost),
        dropped: share(dropped),
        refused: share(sent.voxels - dropped - answered),
        lost: share(lost),
        thin: share(thin),
        filled: share(filled),
        closed: share(closed),
    }
}

/// Share of the voxels of a part that its figures stand for.
#[must_use]
pub fn kept_share(sent: &Sent, part: &Answered<'_>) -> f64 {
    let all = sent.parts[part.part].voxels;
    (all - part.changes.lost.voxels) as f64 / all.max(1) as f64
}

/// A place of the mask, near no figure.
fn of_mask(position: Option<WorldPoint>) -> Option<WorldPlace> {
    position.map(|position| WorldPlace { figure: None, position })
}
