//! How much of the mask the cells and wedges of figures fill, and how much they fill beside it.

use nalgebra::Point3;
use rayon::prelude::*;

use super::fill::filled;
use super::owners::Owners;
use crate::cancel::{Cancel, Cancelled};
use crate::pipeline::vectors::Nodes;
use crate::space::Grid;

/// Dice of the mask with the union of all cells and wedges, and of each figure's share of the
/// mask with its own.
///
/// # Errors
/// When it is cancelled.
pub fn overlaps(
    mask: &Grid<bool>,
    figures: &[&Nodes],
    owners: &Owners,
    cancel: &dyn Cancel,
) -> Result<(f64, Vec<f64>), Cancelled> {
    let mut models = Vec::with_capacity(figures.len());
    for nodes in figures {
        models.push(filled(mask.dims(), (*nodes).into(), cancel)?);
    }
    let counter = Counter { mask, models: &models, owners, cancel };
    let [_, ny, nz] = mask.dims();
    let rows = (0..ny * nz).into_par_iter().with_min_len(64);
    let counts = rows.map(|row| counter.of_row(row)).try_reduce(|| counter.nothing(), |a, b| Ok(sum(a, &b)))?;
    Ok((counts[0].dice(), counts[1..].iter().map(Overlap::dice).collect()))
}

/// Voxels of the mask, of the model, and of both.
#[derive(Clone, Copy, Debug, Default)]
struct Overlap {
    mask: usize,
    model: usize,
    both: usize,
}

impl Overlap {
    /// Counts a voxel.
    fn add(&mut self, in_mask: bool, in_model: bool) {
        self.mask += usize::from(in_mask);
        self.model += usize::from(in_model);
        self.both += usize::from(in_mask && in_model);
    }

    fn dice(&self) -> f64 {
        2.0 * self.both as f64 / (self.mask + self.model).max(1) as f64
    }
}

/// Counts voxels row by row.
struct Counter<'a> {
    mask: &'a Grid<bool>,
    /// What each figure fills.
    models: &'a [Grid<bool>],
    owners: &'a Owners,
    cancel: &'a dyn Cancel,
}

impl Counter<'_> {
    /// Of all figures together, and then of each.
    fn nothing(&self) -> Vec<Overlap> {
        vec![Overlap::default(); 1 + self.models.len()]
    }

    /// Of a row of the grid, the same.
    fn of_row(&self, row: usize) -> Result<Vec<Overlap>, Cancelled> {
        self.cancel.check()?;
        let [nx, ny, _] = self.mask.dims();
        let mut counts = self.nothing();
        for i in 0..nx {
            let voxel = row * nx + i;
            let in_mask = self.mask.as_slice()[voxel];
            counts[0].add(in_mask, self.models.iter().any(|model| model.as_slice()[voxel]));
            if self.models.len() > 1 {
                let at = Point3::new(i as f64, (row % ny) as f64, (row / ny) as f64);
                let owner = in_mask.then(|| self.owners.of_point(at));
                for (number, model) in self.models.iter().enumerate() {
                    counts[number + 1].add(owner == Some(number), model.as_slice()[voxel]);
                }
            }
        }
        Ok(counts)
    }
}

/// Of the rows of both.
fn sum(mut a: Vec<Overlap>, b: &[Overlap]) -> Vec<Overlap> {
    for (a, b) in a.iter_mut().zip(b) {
        *a = Overlap { mask: a.mask + b.mask, model: a.model + b.model, both: a.both + b.both };
    }
    a
}
