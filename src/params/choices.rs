//! Values of parameters that are one of several things.

/// The lattice asked for.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum GridChoice {
    /// A fixed size.
    Fixed {
        /// Nodes across (i).
        rows: usize,
        /// Nodes along (j).
        cols: usize,
    },
    /// From `spacing_mm`, else as many nodes as chords need to follow the surface.
    Auto,
}

/// The neighbourhood of the graph that is flattened.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Neighbors {
    /// A ball of a few voxels, checked against the sheet.
    Auto,
    /// The k nearest along the sheet.
    Count(usize),
    /// All within this distance along the sheet, mm.
    RadiusMm(f64),
}

/// How many geodesic sources ISOMAP uses.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Landmarks {
    /// Enough for the sheet at hand.
    Auto,
    /// This many farthest-point landmarks.
    Count(usize),
    /// Every point: exact ISOMAP.
    All,
}

/// The shape of the lattice in the flattened sheet.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum LatticeKind {
    /// Rows follow the sheet's outline, every node lies on the sheet.
    Fitted,
    /// The paper's rectangle; nodes off the sheet are flagged invalid.
    Regular,
}

/// How medial and surface nodes are paired.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Correspondence {
    /// One parameterisation of the medial sheet, carried to both sides along the spokes.
    Anchored,
    /// Three independent embeddings, rigidly aligned, paired by (i, j).
    Paper,
}

/// How much evidence a branch of the skeleton needs.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Prune {
    /// From the data.
    Auto,
    /// 0 keeps everything, 1 keeps the main sheet alone.
    Strength(f64),
}

/// Which kinds of figures may be made.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kinds {
    /// That which suits the solid.
    Auto,
    /// These alone: where both may be, that which suits the solid.
    These {
        /// Sheets, as in the paper.
        sheet: bool,
        /// Tubes.
        tube: bool,
    },
}

impl Kinds {
    /// The names of the kinds.
    pub const NAMES: [&'static str; 2] = ["sheet", "tube"];

    /// Whether sheets may be made.
    #[must_use]
    pub fn may_be_sheets(self) -> bool {
        !matches!(self, Self::These { sheet: false, .. })
    }

    /// Whether tubes may be made.
    #[must_use]
    pub fn may_be_tubes(self) -> bool {
        !matches!(self, Self::These { tube: false, .. })
    }
}

/// The manifold learning that lays a sheet flat: the three that the paper names.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Embedding {
    /// Distances in the plane follow those along the sheet.
    Isomap,
    /// Locally linear embedding: each point stays the same mean of its neighbours.
    Lle,
    /// Laplacian eigenmaps: neighbours stay near.
    Laplacian,
}

impl LatticeKind {
    /// All of them.
    pub const ALL: [Self; 2] = [Self::Fitted, Self::Regular];
    /// Their names.
    pub const NAMES: [&'static str; 2] = [Self::Fitted.name(), Self::Regular.name()];

    /// Share of the extent that it leaves free at each edge by default: one that follows the outline none, the paper's
    /// rectangle what its corners lack.
    #[must_use]
    pub const fn margin(self) -> f64 {
        match self {
            Self::Fitted => 0.0,
            Self::Regular => 0.05,
        }
    }

    /// Stable name.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Fitted => "fitted",
            Self::Regular => "regular",
        }
    }
}

impl Correspondence {
    /// All of them.
    pub const ALL: [Self; 2] = [Self::Anchored, Self::Paper];
    /// Their names.
    pub const NAMES: [&'static str; 2] = [Self::Anchored.name(), Self::Paper.name()];

    /// Stable name.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Anchored => "anchored",
            Self::Paper => "paper",
        }
    }
}

impl Embedding {
    /// All of them.
    pub const ALL: [Self; 3] = [Self::Isomap, Self::Lle, Self::Laplacian];
    /// Their names.
    pub const NAMES: [&'static str; 3] = [Self::Isomap.name(), Self::Lle.name(), Self::Laplacian.name()];

    /// Stable name.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Isomap => "isomap",
            Self::Lle => "lle",
            Self::Laplacian => "laplacian",
        }
    }
}

/// What can be made of a result, in the order in which it is listed.
pub const ARTIFACT_NAMES: [&str; 11] = [
    "model.glb",
    "thickness.json",
    "thickness.csv",
    "points.csv",
    "picture.png",
    "report.pdf",
    "surfaces.stl",
    "picture.dcm",
    "report.pdf.dcm",
    "surfaces.stl.dcm",
    "report.sr.dcm",
];

/// Those that are made unless others are asked for.
pub const DEFAULT_ARTIFACTS: [&str; 4] = ["model.glb", "thickness.json", "thickness.csv", "points.csv"];
