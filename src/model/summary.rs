//! Thickness in a few numbers, weighted by area: a mean over nodes would depend on how densely
//! the lattice lies where.

use nalgebra::Point3;

use super::figure::{Figure, Sheet};
use super::quality::NodeRepair;
use super::shell::{Shell, quad_area};
use super::side::Side;
use super::structure::Structure;
use super::tube::Tube;
use crate::numerics::stats::Weighted;

/// Area-weighted statistics of a length, mm.
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
    /// Smallest.
    pub min: f64,
    /// Largest.
    pub max: f64,
}

/// Thickness over one figure, or over several, but for nodes that repair spoilt; a length is `None` without any area.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ThicknessSummary {
    /// Length of the upper vectors.
    pub upper_mm: Option<LengthSummary>,
    /// Length of the lower vectors.
    pub lower_mm: Option<LengthSummary>,
    /// Their sum; of tubes that of a vector and the one opposite.
    pub total_mm: Option<LengthSummary>,
    /// Length of the vectors to the walls of tubes.
    pub wall_mm: Option<LengthSummary>,
    /// Area of the medial sheets, and half of that of the walls of tubes, mm².
    pub area_mm2: f64,
}

impl LengthSummary {
    /// Of so many times the length.
    #[must_use]
    pub fn scaled(self, by: f64) -> Self {
        let Self { mean, sd, p5, p50, p95, min, max } = self;
        let [mean, sd, p5, p50, p95, min, max] = [mean, sd, p5, p50, p95, min, max].map(|length| length * by);
        Self { mean, sd, p5, p50, p95, min, max }
    }
}

impl Sheet {
    /// Thickness over the sheet.
    #[must_use]
    pub fn thickness_summary(&self) -> ThicknessSummary {
        thickness_summary(std::iter::once(self), std::iter::empty())
    }

    /// Whether repair spoilt a node, so that its vectors are no lengths of the organ.
    #[must_use]
    pub fn is_marred(&self, node: usize) -> bool {
        self.repaired.get(node).copied().flatten() >= Some(NodeRepair::Shortened)
    }

    /// The area of the medial lattice round each node, mm²: a quarter of each adjacent quad.
    #[must_use]
    pub fn node_areas_mm2(&self) -> Vec<f64> {
        node_areas(self.into())
    }
}

impl Figure {
    /// Thickness over the figure.
    #[must_use]
    pub fn thickness_summary(&self) -> ThicknessSummary {
        match self {
            Self::Sheet(sheet) => sheet.thickness_summary(),
            Self::Tube(tube) => thickness_summary(std::iter::empty(), std::iter::once(tube)),
        }
    }
}

impl Structure {
    /// Thickness over all figures.
    #[must_use]
    pub fn thickness_summary(&self) -> ThicknessSummary {
        thickness_summary(self.sheets(), self.tubes())
    }

    /// Thickness over the figures of a part.
    #[must_use]
    pub fn part_thickness(&self, part: usize) -> ThicknessSummary {
        thickness_summary(self.sheets_of_part(part), self.tubes().filter(|tube| tube.part == part))
    }
}

fn thickness_summary<'a>(
    sheets: impl Iterator<Item = &'a Sheet>,
    tubes: impl Iterator<Item = &'a Tube>,
) -> ThicknessSummary {
    let mut weighted: [Vec<(f64, f64)>; 3] = Default::default();
    for sheet in sheets {
        let [upper, lower] = Side::BOTH.map(|side| sheet.lengths_mm(side));
        for (node, weight) in sheet.node_areas_mm2().into_iter().enumerate() {
            let both = [upper[node], lower[node], upper[node] + lower[node]];
            if weight > 0.0 && both[2].is_finite() && !sheet.is_marred(node) {
                weighted.iter_mut().zip(both).for_each(|(list, length)| list.push((length, weight)));
            }
        }
    }
    let mut walls = Vec::new();
    for tube in tubes {
        // A sheet has its area once, and a surface on either side.
        let [wall, total] = tube.weighted_lengths().map(halved);
        walls.extend(wall);
        weighted[2].extend(total);
    }
    let area_mm2 = weighted[2].iter().map(|(_, weight)| weight).sum();
    let [upper_mm, lower_mm, total_mm] = weighted.map(length_summary);
    ThicknessSummary { upper_mm, lower_mm, total_mm, wall_mm: length_summary(walls), area_mm2 }
}

/// The same with half of the weights.
fn halved(mut weighted: Vec<(f64, f64)>) -> Vec<(f64, f64)> {
    for (_, weight) in &mut weighted {
        *weight /= 2.0;
    }
    weighted
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

/// From pairs of a length and its weight; `None` without any.
pub(super) fn length_summary(weighted: Vec<(f64, f64)>) -> Option<LengthSummary> {
    let lengths = Weighted::new(weighted)?;
    let [min, p5, p50, p95, max] = [0.0, 0.05, 0.5, 0.95, 1.0].map(|share| lengths.percentile(share));
    Some(LengthSummary { mean: lengths.mean(), sd: lengths.deviation(), p5, p50, p95, min, max })
}
