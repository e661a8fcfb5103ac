//! What was chosen where the user left the choice to the program, and from what.

use serde::{Deserialize, Serialize};

use super::side::PerSurface;

/// Where the size of a lattice comes from.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub enum GridFrom {
    /// The parameter `grid`.
    #[default]
    Asked,
    /// The parameter `spacing_mm` and the sheet's extents.
    Spacing,
    /// The surfaces: as few nodes as leave chords between them near enough.
    Shape,
}

impl GridFrom {
    /// Stable name.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Asked => "asked",
            Self::Spacing => "spacing_mm",
            Self::Shape => "shape",
        }
    }
}

/// The choices for one figure with what speaks for them.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Automatic {
    /// Radius of the neighbourhood, mm; none where a number of neighbours was asked for.
    pub neighborhood_mm: Option<f64>,
    /// The same in words.
    pub neighborhood: String,
    /// Pieces that each neighbourhood graph fell into before touching points joined them; 1 when
    /// the neighbourhood was large enough.
    pub graph_pieces: PerSurface<usize>,
    /// Where the lattice's size comes from.
    pub grid_from: GridFrom,
    /// Longer side of the rectangle with the flattened sheet's second moments, mm.
    pub length_mm: f64,
    /// Its shorter side.
    pub width_mm: f64,
    /// What speaks for its kind.
    #[serde(default)]
    pub kind: Option<KindEvidence>,
}

/// What speaks for the kind of a figure.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct KindEvidence {
    /// Width of the main medial sheet over its mean radius; none where it has no lattice.
    pub width_in_radii: Option<f64>,
    /// Median over sections of the radius of the circle of their area over the inscribed radius: 1 is round. None, as the next
    /// two, where no tube was tried.
    pub flatness: Option<f64>,
    /// Share of the sections with several wall curves.
    pub split_share: Option<f64>,
    /// Length over twice the median radius.
    pub elongation: Option<f64>,
    /// Dice of what the sheets fill with the mask; none where there are none.
    pub sheet_overlap: Option<f64>,
    /// Dice of what the tubes fill; none where none was tried.
    #[serde(default)]
    pub tube_overlap: Option<f64>,
}
