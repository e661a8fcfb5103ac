//! Which way a figure lies in the world.

use serde::{Deserialize, Serialize};

use crate::space::WorldVector;

/// How the axes of a figure were found.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub enum FrameRule {
    /// Columns along the longer extent.
    #[default]
    LongerAxis,
    /// A sheet with corners as long as wide: its own two axes, columns along the more superior.
    SuperiorOfEqualAxes,
    /// A round sheet: columns along the most superior direction.
    SuperiorDirection,
    /// A ring: columns run round its hole.
    RoundHole,
}

impl FrameRule {
    /// Stable name, snake case.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::LongerAxis => "longer_axis",
            Self::SuperiorOfEqualAxes => "superior_of_equal_axes",
            Self::SuperiorDirection => "superior_direction",
            Self::RoundHole => "round_hole",
        }
    }
}

/// The frame of a figure in the world.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct FrameFacts {
    /// How the axes were found.
    pub rule: FrameRule,
    /// Unit direction along which j grows, a mean over the sheet.
    pub cols_along: WorldVector,
    /// Unit direction along which i grows.
    pub rows_along: WorldVector,
    /// Unit direction from the lower side to the upper one.
    pub upper_towards: WorldVector,
    /// Longer over shorter extent of the sheet.
    pub aspect: f64,
    /// Why another frame would be as good; empty when none would.
    pub ambiguities: Vec<String>,
}
