//! How far the thickness of a figure is left open by the voxels.

use serde::{Deserialize, Serialize};

/// Spread of the thickness of one figure over the repeats.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Uncertainty {
    /// Repeats that were run.
    pub repeats: usize,
    /// Repeats in which the figure was found again.
    pub matched: usize,
    /// Standard deviation of the length of the vector to the upper side, one per node, mm; `None`
    /// with fewer than two matched repeats.
    pub upper_mm: Vec<Option<f64>>,
    /// The same of the lower side.
    pub lower_mm: Vec<Option<f64>>,
    /// The same of both together.
    pub total_mm: Vec<Option<f64>>,
}
