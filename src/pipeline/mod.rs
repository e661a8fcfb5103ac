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

mod peel;

pub mod medial;

pub mod sheets;

pub mod cut;

pub mod sides;

pub mod isomap;

pub mod lle;

pub mod laplacian;

pub mod distortion;

pub mod embedding;

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

use std::cmp::Reverse;
use std::sync::atomic::{AtomicUsize, Ordering::Relaxed};

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
/// [`Refusal`]. Only when all are refused is the run.
///
/// As many structures are in work at a time as the rayon pool has threads, the largest first. A small one
/// is worked on by one thread, the loops of a large one use the whole pool. Each is computed on its own,
/// so the result does not depend on the threads.
///
/// # Errors
/// When cancelled, when a label asked for is missing, or when every structure is refused.
pub fn run(volume: &LabelVolume, params: &CheckedParams, observer: &dyn Observer) -> Result<Model, PipelineError> {
    let indices = label_indices(volume, params)?;
    let boxes = mask::label_boxes(volume, observer)?;
    let structure = |number: usize| {
        let index = indices[number];
        let bounds = boxes[usize::from(index)].ok_or(Refusal::EmptyMask)?;
        let work =
            structure::Work { volume, index, bounds, params, observer, number, count: indices.len(), repeat: None };
        let is_small = bounds.voxels() <= SMALL_BOX;
        Ok::<Structure, PipelineError>(if is_small { on_one_thread(|| work.run())? } else { work.run()? })
    };
    let mut order: Vec<usize> = (0..indices.len()).collect();
    order.sort_by_key(|&number| Reverse(boxes[usize::from(indices[number])].map_or(0, |bounds| bounds.voxels())));
    let structures: Vec<Structure> = in_lanes(&order, structure).into_iter().collect::<Result<_, _>>()?;
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

/// Box, in voxels, up to which a structure is worked on by one thread: there is too little to share.
const SMALL_BOX: u64 = 1 << 18;

/// Does `work` on one thread, its loops included.
///
/// On the shared pool, a thread that waits for a part of a loop takes up other work: it would begin the
/// next structure, and the one it came from would wait for that one's end. So small structures have a
/// pool of their own, and large ones are worked on by threads outside of the pool, which lends itself
/// to their loops only.
fn on_one_thread<T: Send>(work: impl FnOnce() -> T + Send) -> T {
    match rayon::ThreadPoolBuilder::new().num_threads(1).build() {
        Ok(pool) => pool.install(work),
        // No thread to be had: the shared pool does it.
        Err(_) => work(),
    }
}

/// Does `work` for every number of `order`, in that order, as many at a time as the rayon pool has
/// threads; the results are in the order of the numbers.
fn in_lanes<T: Send>(order: &[usize], work: impl Fn(usize) -> T + Sync) -> Vec<T> {
    let next = AtomicUsize::new(0);
    let lane = || {
        let mut done = Vec::new();
        while let Some(&number) = order.get(next.fetch_add(1, Relaxed)) {
            done.push((number, work(number)));
        }
        done
    };
    let mut done = std::thread::scope(|scope| {
        let others: Vec<_> = (1..rayon::current_num_threads().min(order.len())).map(|_| scope.spawn(lane)).collect();
        let mut done = lane();
        for other in others {
            done.extend(other.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic)));
        }
        done
    });
    done.sort_by_key(|(number, _)| *number);
    done.into_iter().map(|(_, result)| result).collect()
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
