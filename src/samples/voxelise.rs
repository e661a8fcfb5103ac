//! A sample on a voxel grid.

use nalgebra::{Matrix3, Point3, Rotation3, Vector3};

use super::{Ball, Sample, Solid};
use crate::space::{AffineError, Grid, Label, LabelVolume, LabelVolumeError, WorldFromVoxel};

/// Empty voxels left round a sample.
const MARGIN_VOXELS: f64 = 3.0;
/// Voxels of a sample: at 2²⁷ the row counters take half a gigabyte.
const MAX_VOXELS: f64 = 134_217_728.0;

/// Why a sample cannot be voxelised.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum VoxeliseError {
    /// The spacing is zero, negative or not finite.
    #[error("spacing {0:?} mm: every one must be more than 0")]
    Spacing([f64; 3]),
    /// Too fine.
    #[error("at this spacing the volume would have {voxels:.0} voxels, at most {MAX_VOXELS:.0} are made")]
    TooLarge {
        /// Voxels it would have.
        voxels: f64,
    },
    /// The grid is degenerate.
    #[error(transparent)]
    Affine(#[from] AffineError),
    /// Two solids have the same label, or one has 0.
    #[error(transparent)]
    Labels(#[from] LabelVolumeError),
}

impl Sample {
    /// The sample on a grid with that spacing whose axes are turned by `turn` in the world,
    /// with three empty voxels round it. A voxel belongs to a solid when its centre does; where
    /// solids overlap the last one wins.
    ///
    /// # Errors
    /// When the spacing is no length or makes the volume too large.
    pub fn voxelise(&self, spacing_mm: [f64; 3], turn: Rotation3<f64>) -> Result<LabelVolume, VoxeliseError> {
        self.voxelise_at(spacing_mm, turn, [0.0; 3])
    }

    /// As [`Self::voxelise`], on a grid that begins a further `phase` outside of the sample, in voxels. At
    /// phase 0 the outermost points lie at centres of voxels, and with them flat faces that lie along the grid:
    /// which voxels such a face takes is decided by rounding.
    ///
    /// # Errors
    /// When the spacing is no length or makes the volume too large.
    pub fn voxelise_at(
        &self,
        spacing_mm: [f64; 3],
        turn: Rotation3<f64>,
        phase: [f64; 3],
    ) -> Result<LabelVolume, VoxeliseError> {
        if spacing_mm.iter().any(|s| !s.is_finite() || *s <= 0.0) {
            return Err(VoxeliseError::Spacing(spacing_mm));
        }
        let (dims, world_from_voxel) = self.frame(spacing_mm, turn, phase)?;
        let mut indices = Grid::filled(dims, 0_u16);
        let mut by_label: Vec<(u16, &Solid)> = self.solids().iter().map(|solid| (solid.label(), solid)).collect();
        by_label.sort_by_key(|(label, _)| *label);
        for (index, (_, solid)) in (1_u16..).zip(&by_label) {
            fill(&mut indices, index, solid, &world_from_voxel);
        }
        let labels = by_label.iter().map(|(label, _)| Label::new(i64::from(*label))).collect();
        Ok(LabelVolume::new(indices, labels, world_from_voxel)?)
    }

    /// The smallest grid of these axes that holds all balls.
    fn frame(
        &self,
        spacing_mm: [f64; 3],
        turn: Rotation3<f64>,
        phase: [f64; 3],
    ) -> Result<([usize; 3], WorldFromVoxel), VoxeliseError> {
        let (mut low, mut high) = (Vector3::repeat(f64::INFINITY), Vector3::repeat(f64::NEG_INFINITY));
        for ball in self.solids().iter().flat_map(Solid::balls) {
            let local = turn.inverse() * ball.center.coords;
            low = low.inf(&local.add_scalar(-ball.radius_mm));
            high = high.sup(&local.add_scalar(ball.radius_mm));
        }
        let spacing = Vector3::from(spacing_mm);
        let first = low - spacing.component_mul(&Vector3::from(phase).add_scalar(MARGIN_VOXELS));
        let extent = (high - first).component_div(&spacing).add_scalar(MARGIN_VOXELS + 1.0).map(f64::ceil);
        let voxels = extent.product();
        if voxels > MAX_VOXELS {
            return Err(VoxeliseError::TooLarge { voxels });
        }
        let axes = turn.matrix() * Matrix3::from_diagonal(&spacing);
        let origin = turn * first;
        let rows = std::array::from_fn(|r| [axes[(r, 0)], axes[(r, 1)], axes[(r, 2)], origin[r]]);
        Ok(([0, 1, 2].map(|axis| whole(extent[axis])), WorldFromVoxel::from_rows(rows)?))
    }
}

/// Writes `index` where the solid is. In voxel coordinates a ball is an ellipsoid along the
/// axes, so each of its rows is one interval; intervals are counted by their two ends, and a
/// running sum over each row fills them all at once.
fn fill(indices: &mut Grid<u16>, index: u16, solid: &Solid, world_from_voxel: &WorldFromVoxel) {
    let [columns, rows, slices] = indices.dims();
    let mut ends = Grid::filled([columns + 1, rows, slices], 0_i32);
    for ball in solid.balls() {
        mark(&mut ends, ball, world_from_voxel);
    }
    let lines = indices.as_mut_slice().chunks_exact_mut(columns);
    for (line, ends) in lines.zip(ends.as_slice().chunks_exact(columns + 1)) {
        let mut depth = 0;
        for (voxel, end) in line.iter_mut().zip(ends) {
            depth += end;
            if depth > 0 {
                *voxel = index;
            }
        }
    }
}

fn mark(ends: &mut Grid<i32>, ball: &Ball, world_from_voxel: &WorldFromVoxel) {
    let spacing_mm = world_from_voxel.spacing_mm();
    let Point3 { coords: center } = world_from_voxel.voxel(ball.center);
    let reach = |axis: usize, squared: f64| {
        let half = squared.max(0.0).sqrt() / spacing_mm[axis];
        (whole((center[axis] - half).ceil()), whole((center[axis] + half).floor() + 1.0))
    };
    let square = ball.radius_mm * ball.radius_mm;
    let (k_first, k_end) = reach(2, square);
    for k in k_first..k_end {
        let in_slice = square - ((k as f64 - center[2]) * spacing_mm[2]).powi(2);
        let (j_first, j_end) = reach(1, in_slice);
        for j in j_first..j_end {
            let in_row = in_slice - ((j as f64 - center[1]) * spacing_mm[1]).powi(2);
            let (i_first, i_end) = reach(0, in_row);
            if i_first < i_end {
                ends[[i_first, j, k]] += 1;
                ends[[i_end, j, k]] -= 1;
            }
        }
    }
}

#[allow(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "callers pass whole numbers between 0 and the bound of `frame`"
)]
fn whole(x: f64) -> usize {
    x as usize
}
