//! How much of the label the cells and wedges of figures fill, and how much they fill beside it, by the centres of the
//! label's own voxels.

use rayon::prelude::*;

use super::fill::filled;
use super::owners::Owners;
use super::placed::Placed;
use crate::cancel::{Cancel, Cancelled};
use crate::model::{Body, FigurePatches};
use crate::numerics::field::centre;
use crate::pipeline::draft::AnyDraft;
use crate::pipeline::solid::{NativeMask, Solid};
use crate::space::{Grid, VoxelFromVoxel, WorldFromVoxel};

/// What stands for the figures.
#[derive(Clone, Copy, Debug)]
pub enum Models {
    /// The smooth surfaces through their nodes.
    Smooth,
    /// The flat quads between them.
    Flat,
}

impl Models {
    fn body<'a>(self, figure: &'a Placed<'a>) -> Body<'a> {
        match self {
            Self::Smooth => figure.patches.body(),
            Self::Flat => figure.draft.body(),
        }
    }
}

/// For each group of figures, Dice of what its figures fill with what of the label belongs to them.
///
/// # Errors
/// When it is cancelled.
pub fn overlaps(
    label: &NativeMask,
    figures: &[Placed<'_>],
    kind: Models,
    (groups, owners, common): (&[Vec<usize>], &Owners, &WorldFromVoxel),
    cancel: &dyn Cancel,
) -> Result<Vec<f64>, Cancelled> {
    let mut models = Vec::with_capacity(figures.len());
    for figure in figures {
        models.push(filled(label.mask.dims(), kind.body(figure), &figure.into_label, cancel)?);
    }
    let into_common = label.world_from_voxel.to(common);
    let counter = Counter { mask: &label.mask, into_common, models: &models, groups, owners, cancel };
    let [_, ny, nz] = label.mask.dims();
    let rows = (0..ny * nz).into_par_iter().with_min_len(64);
    let counts = rows.map(|row| counter.of_row(row)).try_reduce(|| counter.nothing(), |a, b| Ok(sum(a, &b)))?;
    Ok(counts.iter().map(Overlap::dice).collect())
}

/// Dice of what figures of one part fill with its mask, before it was resampled; whether or not their surfaces run through
/// each other.
///
/// # Errors
/// When it is cancelled.
pub(in crate::pipeline) fn overlap_with_part(
    solid: &Solid,
    drafts: &[AnyDraft<'_>],
    cancel: &dyn Cancel,
) -> Result<f64, Cancelled> {
    let mask = &solid.native.mask;
    let into_mask = solid.world_from_work.to(&solid.native.world_from_voxel);
    let mut models = Vec::with_capacity(drafts.len());
    for draft in drafts {
        let patches = FigurePatches::unchecked(draft.body());
        models.push(filled(mask.dims(), patches.body(), &into_mask, cancel)?);
    }
    let mut overlap = Overlap::default();
    for (voxel, in_mask) in mask.as_slice().iter().enumerate() {
        overlap.add(*in_mask, models.iter().any(|model| model.as_slice()[voxel]));
    }
    Ok(overlap.dice())
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
    into_common: VoxelFromVoxel,
    /// What each figure fills.
    models: &'a [Grid<bool>],
    groups: &'a [Vec<usize>],
    owners: &'a Owners,
    cancel: &'a dyn Cancel,
}

impl Counter<'_> {
    /// Of each group.
    fn nothing(&self) -> Vec<Overlap> {
        vec![Overlap::default(); self.groups.len()]
    }

    /// Of a row of the grid, the same.
    fn of_row(&self, row: usize) -> Result<Vec<Overlap>, Cancelled> {
        self.cancel.check()?;
        let nx = self.mask.dims()[0];
        let mut counts = self.nothing();
        for voxel in row * nx..(row + 1) * nx {
            let owner = self.mask.as_slice()[voxel].then(|| self.owner(voxel));
            for (count, group) in counts.iter_mut().zip(self.groups) {
                let in_mask = owner.is_some_and(|owner| group.contains(&owner));
                count.add(in_mask, group.iter().any(|&figure| self.models[figure].as_slice()[voxel]));
            }
        }
        Ok(counts)
    }

    /// The figure that a voxel belongs to.
    fn owner(&self, voxel: usize) -> usize {
        if self.models.len() < 2 {
            return 0;
        }
        self.owners.of_point(self.into_common.point(centre(self.mask.index(voxel))))
    }
}

/// Of the rows of both.
fn sum(mut a: Vec<Overlap>, b: &[Overlap]) -> Vec<Overlap> {
    for (a, b) in a.iter_mut().zip(b) {
        *a = Overlap { mask: a.mask + b.mask, model: a.model + b.model, both: a.both + b.both };
    }
    a
}
