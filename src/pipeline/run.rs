//! Which labels are worked on, and on how many threads.

use std::cmp::Reverse;
use std::collections::BTreeMap;
use std::sync::atomic::{AtomicUsize, Ordering::Relaxed};

use super::PipelineError;
use super::context::{Context, Notes};
use super::levels::check_is_label_map;
use super::observer::Observer;
use super::repeats::add_uncertainty;
use super::sheets::{loss_needed, strength};
use super::solid::cut_out::{Label, label_boxes};
use super::stages::stages;
use crate::cancel::{Cancel, Cancelled};
use crate::model::{Model, Pruning, Refusal, StageTimings, Structure, StructureQuality, TriangleMesh, Verdict};
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
    let labels = labels(volume, params, observer)?;
    observer.begun(&labels.iter().map(|label| volume.voxels_of(label.index)).collect::<Vec<_>>());
    let mut order: Vec<usize> = (0..labels.len()).collect();
    order.sort_by_key(|&number| Reverse(labels[number].bounds.voxels()));
    let work = Work { volume, params, observer, labels };
    let structures = in_lanes(&order, |number| work.on(number)).into_iter().collect::<Result<Vec<_>, _>>()?;
    match refusal_of_all(&structures) {
        Some(refusal) => Err(refusal.clone().into()),
        None => Ok(Model {
            params: params.clone(),
            world_from_voxel: volume.world_from_voxel(),
            dims: volume.dims(),
            structures,
        }),
    }
}

/// The refusal of the first structure, when all are refused.
fn refusal_of_all(structures: &[Structure]) -> Option<&Refusal> {
    for structure in structures {
        structure.refusal.as_ref()?;
    }
    structures.first()?.refusal.as_ref()
}

/// What a run has to do.
struct Work<'a> {
    volume: &'a LabelVolume,
    params: &'a CheckedParams,
    observer: &'a dyn Observer,
    labels: Vec<Label>,
}

impl Work<'_> {
    /// Does all of one label.
    fn on(&self, number: usize) -> Result<Structure, Cancelled> {
        let (label, count) = (self.labels[number], self.labels.len());
        let context = Context::new(self.params, self.observer, number, count);
        let structure = if label.bounds.voxels() <= SMALL_BOX {
            on_one_thread(|| structure(self.volume, label, context))?
        } else {
            structure(self.volume, label, context)?
        };
        self.observer.ended(number, count);
        Ok(structure)
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
    // The background is not among them.
    let known = &volume.labels()[usize::from(label.index) - 1];
    Structure {
        label: known.value,
        name: params.names.get(&known.value).or(known.name.as_ref()).cloned(),
        color: known.color,
        code: known.code.clone(),
        voxels,
        volume_mm3: voxels as f64 * volume.world_from_voxel().voxel_volume_mm3(),
        working_voxel_mm: 0.0,
        grain_mm: volume.world_from_voxel().spacing_mm(),
        parts: Vec::new(),
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

/// Box, in voxels, up to which a structure is worked on by one thread: there is too little to share. With less, small
/// ones wait for one another at the end of every loop; with more, a run ends on one thread at a large one.
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
    let lanes = rayon::current_num_threads().min(order.len());
    let mut done = BTreeMap::new();
    std::thread::scope(|scope| {
        let others: Vec<_> = (1..lanes).map(|_| scope.spawn(|| lane(order, &next, &work))).collect();
        done.extend(lane(order, &next, &work));
        for other in others {
            done.extend(other.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic)));
        }
    });
    done.into_values().collect()
}

/// Takes the next of the numbers as long as there are any, and keeps the result with each.
fn lane<T>(order: &[usize], next: &AtomicUsize, work: &(impl Fn(usize) -> T + Sync)) -> Vec<(usize, T)> {
    let mut done = Vec::new();
    while let Some(&number) = order.get(next.fetch_add(1, Relaxed)) {
        done.push((number, work(number)));
    }
    done
}

/// The labels asked for, and their boxes.
fn labels(volume: &LabelVolume, params: &CheckedParams, cancel: &dyn Cancel) -> Result<Vec<Label>, PipelineError> {
    let present: Vec<i64> = volume.labels().iter().map(|label| label.value).collect();
    if present.is_empty() {
        return Err(Refusal::EmptyMask.into());
    }
    // Who names the labels knows them to be labels.
    if params.labels.is_none() {
        check_is_label_map(volume, cancel)?;
    }
    let mut indices = Vec::new();
    for &label in params.labels.as_deref().unwrap_or(&present) {
        indices.push(volume.index_of(label).ok_or_else(|| missing(label, &present))?);
    }
    let boxes = label_boxes(volume, cancel)?;
    let mut labels = Vec::new();
    for index in indices {
        let bounds = boxes[usize::from(index)].ok_or(Refusal::EmptyMask)?;
        labels.push(Label { index, bounds });
    }
    Ok(labels)
}

/// The refusal of a label that is none of those present.
fn missing(label: i64, present: &[i64]) -> Refusal {
    /// Labels named in a refusal.
    const NAMED: usize = 20;
    Refusal::LabelMissing { label, present: present.iter().copied().take(NAMED).collect() }
}
