//! The pipeline of Ward and Hamarneh (Proc. SPIE 6512, 2007): a label map goes in, a medial
//! representation comes out. This file holds the order of the stages and nothing else.
//!
//! ```text
//! LabelVolume ── mask ── Solid ── depth ── Depth ── medial ── MedialSurface ── sheets, cut ── Sheets
//!   ── sides ── SheetSides ── isomap ── Flat ── frame, strip, outline, rim ── WholeSheet ── lattice ── Lattice
//!   ── anchored, repair (or spokes, for `paper`) ── Nodes ── legality, closed, coverage, measures, verdict ── quality ── Figure, StructureQuality
//! ```

pub mod params;

pub mod observer;

pub mod refusal;

pub mod model;

pub mod mask;

pub mod depth;

pub mod surface;

pub mod medial;

pub mod sheets;

pub mod cut;

pub mod sides;

pub mod isomap;

pub mod outline;

pub mod patch;

pub mod frame;

pub mod automatic;

pub mod lattice;

pub mod spokes;

pub mod strip;

pub mod rim;

pub mod anchored;

pub mod repair;
pub mod shell;

pub mod legality;

pub mod closed;

pub mod coverage;

pub mod measures;

pub mod summary;

pub mod verdict;

pub mod quality;

pub mod perturb;

pub mod uncertainty;

mod structure;

use rayon::prelude::*;

use crate::space::LabelVolume;
use model::{Model, Structure};
use observer::{Cancelled, Observer};
use params::CheckedParams;
use refusal::Refusal;

/// Why a run ends without a model.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum PipelineError {
    /// The observer asked to stop.
    #[error(transparent)]
    Cancelled(#[from] Cancelled),
    /// No structure has a medial representation; the reason of the first.
    #[error(transparent)]
    Refused(#[from] Refusal),
}

/// Runs all stages on every label asked for.
///
/// One structure that is refused does not spoil the others: it is listed with its
/// [`Refusal`]. Only when all are refused is the run. Structures run in parallel on the current
/// rayon pool; each is computed on its own, so the result does not depend on the threads.
///
/// # Errors
/// When cancelled, when a label asked for is missing, or when every structure is refused.
pub fn run(volume: &LabelVolume, params: &CheckedParams, observer: &dyn Observer) -> Result<Model, PipelineError> {
    let indices = label_indices(volume, params)?;
    let boxes = mask::label_boxes(volume);
    let structure = |(number, &index): (usize, &u16)| {
        let bounds = boxes[usize::from(index)].ok_or(Refusal::EmptyMask)?;
        let work =
            structure::Work { volume, index, bounds, params, observer, number, count: indices.len(), repeat: None };
        Ok::<Structure, PipelineError>(work.run()?)
    };
    let structures: Vec<Structure> = indices.par_iter().enumerate().map(structure).collect::<Result<_, _>>()?;
    match structures.iter().find_map(|s| s.refusal.clone()) {
        Some(refusal) if structures.iter().all(|s| s.refusal.is_some()) => Err(refusal.into()),
        _ => Ok(Model {
            params: params.clone(),
            world_from_voxel: volume.world_from_voxel,
            dims: volume.indices.dims(),
            structures,
        }),
    }
}

/// The volume's index of every label asked for.
fn label_indices(volume: &LabelVolume, params: &CheckedParams) -> Result<Vec<u16>, Refusal> {
    /// Labels named in a refusal.
    const NAMED: usize = 20;
    let present = &volume.label_values[1..];
    let index_of = |label: i64| {
        let position = volume.label_values.iter().skip(1).position(|&v| v == label)?;
        u16::try_from(position + 1).ok()
    };
    if present.is_empty() {
        return Err(Refusal::EmptyMask);
    }
    let wanted = params.labels.as_deref().unwrap_or(present);
    let missing = |label: i64| Refusal::LabelMissing { label, present: present.iter().copied().take(NAMED).collect() };
    wanted.iter().map(|&label| index_of(label).ok_or_else(|| missing(label))).collect()
}
