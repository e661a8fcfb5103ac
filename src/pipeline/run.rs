//! Which labels are worked on, and on how many threads.

use std::cmp::Reverse;
use std::sync::atomic::{AtomicUsize, Ordering::Relaxed};

use super::PipelineError;
use super::context::{Context, Notes};
use super::observer::Observer;
use super::repeats::add_uncertainty;
use super::sheets::{loss_needed, strength};
use super::solid::cut_out::{Label, label_boxes};
use super::stages::stages;
use crate::cancel::Cancelled;
use crate::model::StageTimings;
use crate::model::{Model, Pruning, Refusal, Structure, StructureQuality, TriangleMesh, Verdict};
use crate::params::CheckedParams;
use crate::space::LabelVolume;

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
    let boxes = label_boxes(volume, observer)?;
    observer.begun(&indices.iter().map(|&index| volume.voxels_of(index)).collect::<Vec<_>>());
    let structure = |number: usize| {
        let index = indices[number];
        let bounds = boxes[usize::from(index)].ok_or(Refusal::EmptyMask)?;
        let context = Context::new(params, observer, number, indices.len());
        let work = || structure(volume, Label { index, bounds }, context);
        let is_small = bounds.voxels() <= SMALL_BOX;
        let structure = if is_small { on_one_thread(work)? } else { work()? };
        observer.ended(number, indices.len());
        Ok::<Structure, PipelineError>(structure)
    };
    let mut order: Vec<usize> = (0..indices.len()).collect();
    order.sort_by_key(|&number| Reverse(boxes[usize::from(indices[number])].map_or(0, |bounds| bounds.voxels())));
    let structures: Vec<Structure> = in_lanes(&order, structure).into_iter().collect::<Result<_, _>>()?;
    match structures.iter().find_map(|s| s.refusal.clone()) {
        Some(refusal) if structures.iter().all(|s| s.refusal.is_some()) => Err(refusal.into()),
        _ => Ok(Model {
            params: params.clone(),
            world_from_voxel: volume.world_from_voxel(),
            dims: volume.dims(),
            structures,
        }),
    }
}

/// All of one label. A shape without a medial representation is a structure with a refusal.
fn structure(volume: &LabelVolume, label: Label, context: Context<'_>) -> Result<Structure, Cancelled> {
    let blank = blank(volume, label, context.params);
    let mut structure = blank.clone();
    let repeats = context.params.uncertainty;
    if repeats > 0 {
        context.observer.repeated(context.structure, context.structures, 0, repeats);
    }
    match stages(volume, label, &context, &mut structure) {
        Ok(()) if repeats > 0 => add_uncertainty(volume, label, &context, (&blank, &mut structure))?,
        Ok(()) => {}
        Err(PipelineError::Cancelled(stop)) => return Err(stop),
        Err(PipelineError::Refused(refusal)) => {
            structure.quality.verdict = Verdict::Fail;
            structure.refusal = Some(refusal);
        }
    }
    let Notes { warnings, timings, .. } = context.into_notes();
    Ok(Structure { warnings, timings, ..structure })
}

/// A structure of which nothing is known yet but its label.
fn blank(volume: &LabelVolume, label: Label, params: &CheckedParams) -> Structure {
    let voxels = volume.voxels_of(label.index);
    let known = &volume.labels()[usize::from(label.index)];
    Structure {
        label: known.value,
        name: params.names.get(&known.value).or(known.name.as_ref()).cloned(),
        color: known.color,
        voxels,
        volume_mm3: voxels as f64 * volume.world_from_voxel().voxel_volume_mm3(),
        working_voxel_mm: 0.0,
        figures: Vec::new(),
        junctions: Vec::new(),
        pruning: Pruning { strength: strength(params.prune), loss_needed: loss_needed(params.prune), pruned: 0 },
        quality: StructureQuality::default(),
        warnings: Vec::new(),
        refusal: None,
        object: TriangleMesh::default(),
        timings: StageTimings::default(),
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
    let present: Vec<i64> = volume.labels().iter().map(|label| label.value).collect();
    if present.is_empty() {
        return Err(Refusal::EmptyMask);
    }
    let wanted = params.labels.as_deref().unwrap_or(&present);
    let missing = |label: i64| Refusal::LabelMissing { label, present: present.iter().copied().take(NAMED).collect() };
    wanted.iter().map(|&label| volume.index_of(label).ok_or_else(|| missing(label))).collect()
}
