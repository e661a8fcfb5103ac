//! How far thickness can be trusted: the whole structure is computed again with its boundary moved
//! inside what the voxels leave open (see [`crate::pipeline::solid::perturb`]), and each node's thickness compared.

use std::sync::atomic::{AtomicUsize, Ordering};

use rayon::prelude::*;

use super::PipelineError;
use super::context::{Context, Repeat};
use super::observer::Muted;
use super::solid::cut_out::Label;
use super::stages::stages;
use crate::cancel::Cancelled;
use crate::model::{Figure, LatticeSize, Structure, Uncertainty};
use crate::space::{LabelVolume, WorldPoint, WorldVector};

/// Distance between the nodes of a figure and of its counterpart in a repeat, working voxels, root
/// mean square, up to which they are the same figure. The frame of a round sheet may turn.
const SAME_WITHIN: f64 = 4.0;

/// Computes a structure again with moved boundaries, as often as was asked for, and gives every figure its
/// uncertainty. `blank` is the structure before its stages.
///
/// # Errors
/// When it is cancelled.
pub(super) fn add_uncertainty(
    volume: &LabelVolume,
    label: Label,
    context: &Context<'_>,
    (blank, structure): (&Structure, &mut Structure),
) -> Result<(), Cancelled> {
    let repeats = context.params.uncertainty;
    let sizes: Vec<LatticeSize> = structure.figures.iter().map(|f| f.grid).collect();
    let all = repeated(volume, label, context, (blank, &sizes))?;
    let alike: Vec<&Vec<Figure>> = all.iter().filter(|found| found.len() == sizes.len()).collect();
    let within_mm = SAME_WITHIN * structure.working_voxel_mm;
    for (number, figure) in structure.figures.iter_mut().enumerate() {
        let found: Vec<[Vec<f64>; 2]> =
            alike.iter().filter_map(|others| counterpart(figure, others, within_mm)).collect();
        if 2 * found.len() < repeats {
            let matched = found.len();
            let message = format!("figure {number} was found again in {matched} of {repeats} repeats only");
            context.warn("uncertainty_unmatched", message);
        }
        figure.uncertainty = Some(uncertainty(repeats, &found, figure.medial.len()));
    }
    Ok(())
}

/// The figures of every repeat, in the order of the repeats; none of one that is refused.
fn repeated(
    volume: &LabelVolume,
    label: Label,
    context: &Context<'_>,
    (blank, sizes): (&Structure, &[LatticeSize]),
) -> Result<Vec<Vec<Figure>>, Cancelled> {
    let repeats = context.params.uncertainty;
    let (muted, done) = (Muted(context.observer), AtomicUsize::new(0));
    let repeat = |number: usize| {
        let context_of_repeat = context.of_repeat(Repeat { number: number as u64, sizes }, &muted);
        let mut structure = blank.clone();
        if let Err(PipelineError::Cancelled(stop)) = stages(volume, label, &context_of_repeat, &mut structure) {
            return Err(stop);
        }
        let done = done.fetch_add(1, Ordering::Relaxed) + 1;
        context.observer.repeated(context.structure, context.structures, done, repeats);
        Ok(structure.figures)
    };
    (1..=repeats).into_par_iter().map(repeat).collect()
}

/// The spread of the lengths that the figure's counterparts have.
fn uncertainty(repeats: usize, found: &[[Vec<f64>; 2]], nodes: usize) -> Uncertainty {
    let mut result = Uncertainty { repeats, matched: found.len(), ..Uncertainty::default() };
    for n in 0..nodes {
        result.upper_mm.push(deviation(found.iter().map(|sides| sides[0][n])));
        result.lower_mm.push(deviation(found.iter().map(|sides| sides[1][n])));
        result.total_mm.push(deviation(found.iter().map(|sides| sides[0][n] + sides[1][n])));
    }
    result
}

/// Lengths of the upper and the lower vectors of the figure's counterpart in a repeat, in the
/// figure's own order of nodes.
fn counterpart(figure: &Figure, others: &[Figure], within_mm: f64) -> Option<[Vec<f64>; 2]> {
    let same_size = others.iter().filter(|other| other.grid == figure.grid);
    let ways = same_size.flat_map(|other| (0..4).map(move |flips| (other, order(other.grid, flips))));
    let measured = ways.map(|(other, order)| (distance(&figure.medial, &other.medial, &order), other, order));
    let (distance_mm, other, order) = measured.min_by(|a, b| a.0.total_cmp(&b.0))?;
    if distance_mm > within_mm {
        return None;
    }
    let lengths = |vectors: Vec<WorldVector>| order.iter().map(|&n| vectors[n].norm()).collect::<Vec<f64>>();
    let sides = [lengths(other.upper_vectors()), lengths(other.lower_vectors())];
    let is_turned = distance(&figure.upper, &other.lower, &order) < distance(&figure.upper, &other.upper, &order);
    let [upper, lower] = sides;
    Some(if is_turned { [lower, upper] } else { [upper, lower] })
}

/// Nodes row by row, with rows (bit 0) or columns (bit 1) in reverse.
fn order(LatticeSize { rows, cols }: LatticeSize, flips: usize) -> Vec<usize> {
    let turned = |k: usize, count: usize, bit: usize| if flips >> bit & 1 == 1 { count - 1 - k } else { k };
    (0..rows * cols).map(|n| turned(n / cols, rows, 0) * cols + turned(n % cols, cols, 1)).collect()
}

/// Root mean square distance between points and others taken in an order.
fn distance(points: &[WorldPoint], others: &[WorldPoint], order: &[usize]) -> f64 {
    let sum: f64 = points.iter().zip(order).map(|(p, &n)| (p - others[n]).norm_squared()).sum();
    (sum / points.len().max(1) as f64).sqrt()
}

/// Sample standard deviation; NaN for fewer than two values.
fn deviation(values: impl Iterator<Item = f64> + Clone) -> f64 {
    let count = values.clone().count() as f64;
    let mean = values.clone().sum::<f64>() / count;
    let square = values.map(|v| (v - mean).powi(2)).sum::<f64>();
    if count < 2.0 { f64::NAN } else { (square / (count - 1.0)).sqrt() }
}
