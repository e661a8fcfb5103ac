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
use crate::model::{Figure, LatticeSize, Sheet, Side, Structure, Tube, Uncertainty, WallUncertainty, opposite_sums};
use crate::numerics::stats::deviation;
use crate::space::{LabelVolume, WorldPoint};

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
    let (figures, mut sizes) = (structure.figures.len(), Vec::new());
    for part in &structure.parts {
        sizes.push(part.figures.iter().map(|&figure| structure.figures[figure].grid()).collect());
    }
    let all = repeated(volume, label, context, (blank, &sizes))?;
    let within_mm = SAME_WITHIN * structure.working_voxel_mm;
    for (number, figure) in structure.figures.iter_mut().enumerate() {
        let others: Vec<&Vec<Figure>> = all.iter().filter(|others| others.len() == figures).collect();
        let matched = match figure {
            Figure::Sheet(sheet) => {
                let found: Vec<Lengths> =
                    others.iter().filter_map(|others| counterpart(sheet, others, within_mm)).collect();
                sheet.uncertainty = Some(uncertainty(repeats, &found, sheet.medial.len()));
                found.len()
            }
            Figure::Tube(tube) => {
                let found: Vec<Vec<f64>> =
                    others.iter().filter_map(|others| tube_counterpart(tube, others, within_mm)).collect();
                tube.uncertainty = Some(wall_uncertainty(repeats, &found, tube.grid));
                found.len()
            }
        };
        if 2 * matched < repeats {
            let message = format!("figure {number} was found again in {matched} of {repeats} repeats only");
            context.warn("uncertainty_unmatched", message);
        }
    }
    Ok(())
}

/// The figures of every repeat, in the order of the repeats; none of one that is refused.
fn repeated(
    volume: &LabelVolume,
    label: Label,
    context: &Context<'_>,
    (blank, sizes): (&Structure, &[Vec<LatticeSize>]),
) -> Result<Vec<Vec<Figure>>, Cancelled> {
    let repeats = context.params.uncertainty;
    let (muted, done) = (Muted(context.observer), AtomicUsize::new(0));
    let repeat = |number: usize| {
        let context_of_repeat = context.of_repeat(Repeat { number: number as u64, sizes }, &muted);
        let figures = figures_of(volume, label, &context_of_repeat, blank.clone())?;
        let done = done.fetch_add(1, Ordering::Relaxed) + 1;
        context.observer.repeated(context.structure, context.structures, done, repeats);
        Ok(figures)
    };
    (1..=repeats).into_par_iter().map(repeat).collect()
}

/// The figures of one run; none where it is refused.
fn figures_of(
    volume: &LabelVolume,
    label: Label,
    context: &Context<'_>,
    mut structure: Structure,
) -> Result<Vec<Figure>, Cancelled> {
    match stages(volume, label, context, &mut structure) {
        Err(PipelineError::Cancelled(stop)) => Err(stop),
        _ => Ok(structure.figures),
    }
}

/// The spread of the lengths that the sheet's counterparts have.
fn uncertainty(repeats: usize, found: &[Lengths], nodes: usize) -> Uncertainty {
    let mut result = Uncertainty { repeats, matched: found.len(), ..Uncertainty::default() };
    for n in 0..nodes {
        let (mut upper, mut lower, mut total) = (Vec::new(), Vec::new(), Vec::new());
        for lengths in found {
            upper.push(lengths.upper[n]);
            lower.push(lengths.lower[n]);
            total.push(lengths.upper[n] + lengths.lower[n]);
        }
        result.upper_mm.push(deviation(&upper));
        result.lower_mm.push(deviation(&lower));
        result.total_mm.push(deviation(&total));
    }
    result
}

/// The spread of the lengths that the tube's counterparts have.
fn wall_uncertainty(repeats: usize, found: &[Vec<f64>], grid: LatticeSize) -> WallUncertainty {
    let mut result = WallUncertainty { repeats, matched: found.len(), ..WallUncertainty::default() };
    let totals: Vec<Vec<f64>> = found.iter().map(|lengths| opposite_sums(lengths, grid)).collect();
    for n in 0..grid.rows * grid.cols {
        let of_node = |all: &[Vec<f64>]| deviation(&all.iter().map(|lengths| lengths[n]).collect::<Vec<_>>());
        result.wall_mm.push(of_node(found));
        result.total_mm.push(of_node(&totals));
    }
    result
}

/// The lengths that the tube's counterpart in a repeat has, in the tube's own order of nodes: it may run the other way,
/// and its seam may lie elsewhere.
fn tube_counterpart(tube: &Tube, others: &[Figure], within_mm: f64) -> Option<Vec<f64>> {
    let mut nearest: Option<(f64, Vec<f64>)> = None;
    for other in others.iter().filter_map(Figure::as_tube).filter(|other| other.grid == tube.grid) {
        let lengths = other.lengths_mm();
        for order in turned_orders(tube.grid) {
            let distance_mm = distance(&tube.wall, &other.wall, &order);
            if nearest.as_ref().is_none_or(|nearest| distance_mm < nearest.0) {
                nearest = Some((distance_mm, order.iter().map(|&n| lengths[n]).collect()));
            }
        }
    }
    nearest.filter(|nearest| nearest.0 <= within_mm).map(|nearest| nearest.1)
}

/// The orders of the nodes of a tube that runs either way, its seam in any row.
fn turned_orders(LatticeSize { rows, cols }: LatticeSize) -> Vec<Vec<usize>> {
    let mut orders = Vec::new();
    for is_reversed in [false, true] {
        for first in 0..rows {
            let mut order = Vec::with_capacity(rows * cols);
            for n in 0..rows * cols {
                let (row, col) = (n / cols, n % cols);
                let [row, col] = if is_reversed { [first + rows - row, cols - 1 - col] } else { [first + row, col] };
                order.push(row % rows * cols + col);
            }
            orders.push(order);
        }
    }
    orders
}

/// Lengths of the vectors to both sides, one per node, mm.
struct Lengths {
    upper: Vec<f64>,
    lower: Vec<f64>,
}

/// The lengths that the sheet's counterpart in a repeat has, in the sheet's own order of nodes.
fn counterpart(sheet: &Sheet, others: &[Figure], within_mm: f64) -> Option<Lengths> {
    let mut nearest: Option<(f64, &Sheet, Vec<usize>)> = None;
    for other in others.iter().filter_map(Figure::as_sheet) {
        if other.grid != sheet.grid {
            continue;
        }
        for flips in 0..4 {
            let order = order(other.grid, flips);
            let distance_mm = distance(&sheet.medial, &other.medial, &order);
            if nearest.as_ref().is_none_or(|nearest| distance_mm.total_cmp(&nearest.0).is_lt()) {
                nearest = Some((distance_mm, other, order));
            }
        }
    }
    let (distance_mm, other, order) = nearest?;
    if distance_mm > within_mm {
        return None;
    }
    let is_turned = distance(&sheet.upper, &other.lower, &order) < distance(&sheet.upper, &other.upper, &order);
    let [upper, lower] = if is_turned { [Side::Lower, Side::Upper] } else { [Side::Upper, Side::Lower] };
    Some(Lengths { upper: lengths(other, upper, &order), lower: lengths(other, lower, &order) })
}

/// Lengths of the vectors to a side, in an order of nodes.
fn lengths(sheet: &Sheet, side: Side, order: &[usize]) -> Vec<f64> {
    let lengths = sheet.lengths_mm(side);
    order.iter().map(|&n| lengths[n]).collect()
}

/// Nodes row by row, with rows (bit 0) or columns (bit 1) in reverse.
fn order(LatticeSize { rows, cols }: LatticeSize, flips: usize) -> Vec<usize> {
    let mut order = Vec::new();
    for i in 0..rows {
        for j in 0..cols {
            let row = if flips & 1 == 1 { rows - 1 - i } else { i };
            let col = if flips & 2 == 2 { cols - 1 - j } else { j };
            order.push(row * cols + col);
        }
    }
    order
}

/// Root mean square distance between points and others taken in an order.
fn distance(points: &[WorldPoint], others: &[WorldPoint], order: &[usize]) -> f64 {
    let sum: f64 = points.iter().zip(order).map(|(p, &n)| (p - others[n]).norm_squared()).sum();
    (sum / points.len().max(1) as f64).sqrt()
}
