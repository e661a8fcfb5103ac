//! How far thickness can be trusted: the whole structure is computed again with its boundary moved
//! inside what the voxels leave open (see [`crate::pipeline::solid::perturb`]), and each node's thickness compared.

use rayon::prelude::*;

use crate::model::Uncertainty;
use crate::space::{WorldPoint, WorldVector};

use crate::model::Figure;
use crate::model::LatticeSize;
use crate::model::Stage;
use crate::pipeline::observer::{Cancelled, Observer};

/// Distance between the nodes of a figure and of its counterpart in a repeat, working voxels, root
/// mean square, up to which they are the same figure. The frame of a round sheet may turn.
const SAME_WITHIN: f64 = 4.0;

/// One repeat on its way.
#[derive(Clone, Copy, Debug)]
pub struct Repeat<'a> {
    /// Which one, from 1.
    pub number: u64,
    /// Lattice sizes of the figures that it repeats.
    pub sizes: &'a [LatticeSize],
}

/// Passes a wish to stop on, and no progress.
pub struct Muted<'a>(pub &'a dyn Observer);

impl Observer for Muted<'_> {
    fn progress(&self, _structure: usize, _structures: usize, _stage: Stage, _fraction: f64) {}

    fn is_cancelled(&self) -> bool {
        self.0.is_cancelled()
    }
}

/// Runs `repeats` repeats in parallel and gives every figure its uncertainty. `figures_of` computes
/// a repeat's figures; none when it is refused.
///
/// # Errors
/// When a repeat is cancelled.
pub fn add_uncertainty(
    figures: &mut [Figure],
    repeats: usize,
    voxel_mm: f64,
    figures_of: impl Fn(Repeat<'_>) -> Result<Vec<Figure>, Cancelled> + Sync,
) -> Result<(), Cancelled> {
    let sizes: Vec<LatticeSize> = figures.iter().map(|f| f.grid).collect();
    let repeat = |number: usize| figures_of(Repeat { number: number as u64, sizes: &sizes });
    let all: Vec<Vec<Figure>> = (1..=repeats).into_par_iter().map(repeat).collect::<Result<_, _>>()?;
    let alike: Vec<&Vec<Figure>> = all.iter().filter(|found| found.len() == sizes.len()).collect();
    for figure in figures {
        let found: Vec<[Vec<f64>; 2]> =
            alike.iter().filter_map(|others| counterpart(figure, others, SAME_WITHIN * voxel_mm)).collect();
        let spread_of = |length: &dyn Fn(&[Vec<f64>; 2], usize) -> f64| {
            let nodes = 0..figure.medial.len();
            nodes.map(|n| deviation(found.iter().map(|sides| length(sides, n)))).collect()
        };
        figure.uncertainty = Some(Uncertainty {
            repeats,
            matched: found.len(),
            upper_mm: spread_of(&|sides, n| sides[0][n]),
            lower_mm: spread_of(&|sides, n| sides[1][n]),
            total_mm: spread_of(&|sides, n| sides[0][n] + sides[1][n]),
        });
    }
    Ok(())
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
