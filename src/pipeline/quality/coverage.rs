//! The solid that cells and crest wedges fill, against the label as it was sent.

use nalgebra::Point3;
use rayon::prelude::*;

use super::Answered;
use super::overlap::{Models, overlaps};
use super::owners::Owners;
use super::placed::{Placed, common, moved, whole_skin};
use super::samples::surface_samples;
use super::skin_search::SkinSearch;
use crate::cancel::{Cancel, Cancelled};
use crate::model::{Coverage, DistanceSummary, WorldPlace};
use crate::numerics::stats::{mean, median, percentile};
use crate::pipeline::solid::NativeMask;
use crate::pipeline::solid::depth::SkinPoint;
use crate::space::WorldPoint;

/// Share of the radius that cells of a coarse lattice may be off: a finer mask of the same object is not to turn a
/// result that is as good into a worse one. With 0.05, 0.62 of a thalamus is covered, not 0.73; with 0.2, 0.85 of a
/// thick bend, not 0.50, and that its ends are not is no longer said.
const GRAIN: f64 = 0.1;
/// How far from the model a place is missed, grains. With 1 the rims would be, which cells only approximate; with 2 the
/// end of a thin tail that has no sheet would not.
const FAR: f64 = 1.5;

/// How well figures fit.
pub struct Fits {
    /// All figures, the whole label.
    pub whole: Coverage,
    /// Those of each answered part, what lies nearest to them.
    pub parts: Vec<Coverage>,
    /// Each figure, what lies nearest to it.
    pub figures: Vec<Coverage>,
    /// The place of the label's surface that is furthest from the model.
    pub worst: Option<WorldPlace>,
}

/// How well the figures of all parts fit the label: together, part by part, one by one. Of a single one all are the
/// same. `unanswered` is the surface of what has no figures.
///
/// # Errors
/// When it is cancelled.
pub fn coverage(
    label: &NativeMask,
    parts: &[Answered<'_>],
    figures: &[Placed<'_>],
    unanswered: &[WorldPoint],
    cancel: &dyn Cancel,
) -> Result<Fits, Cancelled> {
    let skin = whole_skin(parts, unanswered);
    let owners = Owners::of(figures, cancel)?;
    let groups = Groups::of(parts.len(), figures);
    let against = |models| overlaps(label, figures, models, (&groups.0, &owners, common(parts)), cancel);
    let (dice, flat_dice) = (against(Models::Smooth)?, against(Models::Flat)?);
    let shares = owners.shares(&skin, cancel)?;
    let samples = samples(figures, cancel)?;
    let skin = SkinSearch::of(&skin, cancel)?;
    let voxel_mm = parts[0].solid.unit_mm;
    let fit = Fit { skin: &skin, grain: grain(figures), voxel_mm, cancel };
    let (mut fits, mut worst) = (Vec::new(), None);
    for (number, group) in groups.0.iter().enumerate() {
        let (own, model) = (joined(&shares, group), joined(&samples, group));
        let (coverage, furthest) = fit.coverage([dice[number], flat_dice[number]], &own, &model)?;
        fits.push(coverage);
        worst = worst.or(furthest);
    }
    let place = |at: Point3<f64>| WorldPlace { figure: Some(owners.of_point(at)), position: common(parts).point(at) };
    let [whole, parts, figures] = groups.taken_apart(&fits, parts.len(), figures.len());
    Ok(Fits { whole: whole[0], parts, figures, worst: worst.map(place) })
}

/// Figures that are measured together: all of them, those of each part, each one. What would be the same again is left
/// out.
struct Groups(Vec<Vec<usize>>);

impl Groups {
    fn of(parts: usize, figures: &[Placed<'_>]) -> Self {
        let all: Vec<usize> = (0..figures.len()).collect();
        let mut groups = vec![all.clone()];
        for part in if parts > 1 { 0..parts } else { 0..0 } {
            groups.push(all.iter().copied().filter(|&figure| figures[figure].part == part).collect());
        }
        for figure in if figures.len() > 1 { all } else { Vec::new() } {
            groups.push(vec![figure]);
        }
        Self(groups)
    }

    /// What was found for each group, as that of all, of each part, and of each figure.
    fn taken_apart(&self, found: &[Coverage], parts: usize, figures: usize) -> [Vec<Coverage>; 3] {
        let whole = found[0];
        let after_parts = if parts > 1 { 1 + parts } else { 1 };
        let of_parts = if parts > 1 { found[1..after_parts].to_vec() } else { vec![whole; parts] };
        let of_figures = if figures > 1 { found[after_parts..].to_vec() } else { vec![whole; figures] };
        [vec![whole], of_parts, of_figures]
    }
}

/// Points of the outer surface of each figure, in the common space.
fn samples(figures: &[Placed<'_>], cancel: &dyn Cancel) -> Result<Vec<Vec<SkinPoint>>, Cancelled> {
    let of_figure = |figure: &Placed<'_>| {
        let mut samples = surface_samples(figure.patches.body(), cancel)?;
        for sample in &mut samples {
            *sample = moved(*sample, &figure.into_common);
        }
        Ok(samples)
    };
    figures.par_iter().map(of_figure).collect()
}

/// The points of a group's figures.
fn joined(of_figures: &[Vec<SkinPoint>], group: &[usize]) -> Vec<SkinPoint> {
    let mut all = Vec::new();
    for &figure in group {
        all.extend_from_slice(&of_figures[figure]);
    }
    all
}

/// The unit of the fit, voxels: one, or a share of the median radius if that is more.
fn grain(figures: &[Placed<'_>]) -> f64 {
    let mut radii = Vec::new();
    for figure in figures {
        let scale = figure.into_common.scale();
        radii.extend(figure.draft.radii().iter().map(|radius| radius * scale));
    }
    median(radii).map_or(1.0, |median| (GRAIN * median).max(1.0))
}

/// What a model is held against.
struct Fit<'a> {
    skin: &'a SkinSearch<'a>,
    grain: f64,
    voxel_mm: f64,
    cancel: &'a dyn Cancel,
}

impl Fit<'_> {
    /// How well a model, by samples of its surface, fits its own share of the skin, and where it fits least.
    fn coverage(
        &self,
        [dice, flat_dice]: [f64; 2],
        own: &[SkinPoint],
        samples: &[SkinPoint],
    ) -> Result<(Coverage, Option<Point3<f64>>), Cancelled> {
        let to_model = SkinSearch::of(samples, self.cancel)?.distances(own, self.cancel)?;
        let to_mask = self.skin.distances(samples, self.cancel)?;
        let mut furthest: Option<usize> = None;
        for (point, distance) in to_model.iter().enumerate() {
            if furthest.is_none_or(|other| *distance > to_model[other]) {
                furthest = Some(point);
            }
        }
        let coverage = Coverage {
            dice,
            flat_dice,
            grain_mm: self.grain * self.voxel_mm,
            covered_share: share_within(&to_model, self.grain),
            far_share: 1.0 - share_within(&to_model, FAR * self.grain),
            mask_to_model: summary(to_model, self.voxel_mm),
            model_to_mask: summary(to_mask, self.voxel_mm),
        };
        Ok((coverage, furthest.map(|point| own[point].position)))
    }
}

/// Share of distances up to a limit; none of nothing.
fn share_within(distances: &[f64], limit: f64) -> f64 {
    let within = distances.iter().filter(|distance| **distance <= limit).count();
    within as f64 / distances.len().max(1) as f64
}

/// Of distances in voxels; zero when there are none.
fn summary(mut voxels: Vec<f64>, voxel_mm: f64) -> DistanceSummary {
    voxels.par_sort_unstable_by(f64::total_cmp);
    DistanceSummary {
        mean_mm: mean(&voxels).unwrap_or(0.0) * voxel_mm,
        p95_mm: percentile(&voxels, 95).unwrap_or(0.0) * voxel_mm,
        max_mm: percentile(&voxels, 100).unwrap_or(0.0) * voxel_mm,
    }
}
