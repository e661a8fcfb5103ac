//! Thickness in a few numbers, weighted by area: a mean over nodes would depend on how densely
//! the lattice lies where.

use nalgebra::Point3;

use super::shell::quad_area;
use crate::model::Shell;
use crate::model::{Figure, Structure};
use crate::space::WorldVector;

/// Area-weighted statistics of a length, mm; not a number without any area.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LengthSummary {
    /// Mean.
    pub mean: f64,
    /// Standard deviation.
    pub sd: f64,
    /// 5th percentile: the smallest value up to which 5 % of the area lie.
    pub p5: f64,
    /// Median.
    pub p50: f64,
    /// 95th percentile.
    pub p95: f64,
}

/// Thickness over a medial sheet, or over several.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ThicknessSummary {
    /// Length of the upper vectors.
    pub upper_mm: LengthSummary,
    /// Length of the lower vectors.
    pub lower_mm: LengthSummary,
    /// Their sum.
    pub total_mm: LengthSummary,
    /// Area of the medial sheets, mm².
    pub area_mm2: f64,
}

impl Figure {
    /// Thickness over the sheet.
    #[must_use]
    pub fn thickness_summary(&self) -> ThicknessSummary {
        thickness_summary(std::slice::from_ref(self))
    }
}

impl Structure {
    /// Thickness over all sheets.
    #[must_use]
    pub fn thickness_summary(&self) -> ThicknessSummary {
        thickness_summary(&self.figures)
    }
}

fn thickness_summary(figures: &[Figure]) -> ThicknessSummary {
    let mut weighted: [Vec<(f64, f64)>; 3] = Default::default();
    for figure in figures {
        let lengths = |vectors: Vec<WorldVector>| vectors.iter().map(WorldVector::norm).collect::<Vec<_>>();
        let (upper, lower) = (lengths(figure.upper_vectors()), lengths(figure.lower_vectors()));
        for (node, weight) in node_areas(figure.into()).into_iter().enumerate() {
            let both = [upper[node], lower[node], upper[node] + lower[node]];
            if weight > 0.0 && both[2].is_finite() {
                weighted.iter_mut().zip(both).for_each(|(list, length)| list.push((length, weight)));
            }
        }
    }
    let area_mm2 = weighted[2].iter().map(|(_, weight)| weight).sum();
    let [upper_mm, lower_mm, total_mm] = weighted.map(length_summary);
    ThicknessSummary { upper_mm, lower_mm, total_mm, area_mm2 }
}

/// The area of the medial lattice round each node: a quarter of each adjacent quad.
#[must_use]
pub fn node_areas(shell: Shell<'_>) -> Vec<f64> {
    let mut areas = vec![0.0; shell.medial.len()];
    for quad in shell.quads() {
        let corners: [Point3<f64>; 4] = quad.nodes.map(|n| shell.medial[n]);
        quad.nodes.iter().for_each(|&n| areas[n] += quad_area(corners) / 4.0);
    }
    areas
}

/// From pairs of a length and its weight.
fn length_summary(mut weighted: Vec<(f64, f64)>) -> LengthSummary {
    weighted.sort_by(|a, b| a.0.total_cmp(&b.0));
    let all: f64 = weighted.iter().map(|(_, weight)| weight).sum();
    let mean = weighted.iter().map(|(length, weight)| length * weight).sum::<f64>() / all;
    let variance = weighted.iter().map(|(length, weight)| (length - mean).powi(2) * weight).sum::<f64>() / all;
    let percentile = |share: f64| {
        let mut below = 0.0;
        let reached = weighted.iter().find(|(_, weight)| {
            below += weight;
            below >= share * all
        });
        reached.or(weighted.last()).map_or(f64::NAN, |(length, _)| *length)
    };
    LengthSummary { mean, sd: variance.sqrt(), p5: percentile(0.05), p50: percentile(0.5), p95: percentile(0.95) }
}
