//! What a user may ask for, and the checked form the stages read.

use std::borrow::Cow;
use std::collections::BTreeMap;
use std::fmt;

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
    /// From `spacing_mm`, else from the sheet's size and aspect.
    Auto,
}

/// The neighbourhood of the ISOMAP graph.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Neighbors {
    /// A ball of a few voxels, checked against the sheet.
    Auto,
    /// The k nearest along the sheet.
    Count(usize),
    /// All within this distance along the sheet, mm.
    RadiusMm(f64),
}

/// How a surface is laid flat (section 2.4 of the paper names all three).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Embedding {
    /// ISOMAP: keeps distances along the surface.
    #[default]
    Isomap,
    /// Modified locally linear embedding: keeps neighbourhoods.
    Lle,
    /// Laplacian eigenmaps: keep neighbours close.
    Laplacian,
}

impl Embedding {
    /// All of them, the default first.
    pub const ALL: [Self; 3] = [Self::Isomap, Self::Lle, Self::Laplacian];

    /// Stable name, snake case.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Isomap => "isomap",
            Self::Lle => "lle",
            Self::Laplacian => "laplacian",
        }
    }
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

/// Parameters as asked for. [`Params::check`] makes them usable.
#[derive(Clone, Debug, PartialEq)]
pub struct Params {
    /// Labels to work on; `None` means all that are not 0.
    pub labels: Option<Vec<i64>>,
    /// Lattice size.
    pub grid: GridChoice,
    /// Wanted geodesic distance between nodes, mm, with `grid: auto`.
    pub spacing_mm: Option<f64>,
    /// Share of the intrinsic extent left free at each edge.
    pub margin: f64,
    /// ISOMAP neighbourhood.
    pub neighbors: Neighbors,
    /// ISOMAP landmarks.
    pub landmarks: Landmarks,
    /// Lattice shape.
    pub lattice: LatticeKind,
    /// Pairing of nodes.
    pub correspondence: Correspondence,
    /// Pruning.
    pub prune: Prune,
    /// Keep at most this many sheets, the largest first.
    pub max_figures: Option<usize>,
    /// Edge of the isotropic working voxel, mm; `None` means the finest spacing of the mask.
    pub resolution_mm: Option<f64>,
    /// Repeats for the uncertainty of thickness; 0 for none.
    pub uncertainty: usize,
    /// How surfaces are laid flat.
    pub embedding: Embedding,
    /// Names of labels.
    pub names: BTreeMap<i64, String>,
}

impl Default for Params {
    fn default() -> Self {
        Self {
            labels: None,
            grid: GridChoice::Fixed { rows: 6, cols: 8 },
            spacing_mm: None,
            margin: 0.05,
            neighbors: Neighbors::Auto,
            landmarks: Landmarks::Auto,
            lattice: LatticeKind::Fitted,
            correspondence: Correspondence::Anchored,
            prune: Prune::Auto,
            max_figures: None,
            resolution_mm: None,
            uncertainty: 0,
            embedding: Embedding::Isomap,
            names: BTreeMap::new(),
        }
    }
}

/// A parameter that cannot be used.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[error("{field}: got {got}, allowed is {allowed}")]
pub struct ParamsError {
    /// The field, dotted (`grid.rows`).
    pub field: Cow<'static, str>,
    /// What was given.
    pub got: String,
    /// What is allowed.
    pub allowed: String,
}

/// Nodes per lattice side. Fewer than 3 leave no inner node to measure a spacing on; above 512
/// nodes lie closer than any scan resolves.
pub const LATTICE_SIDE: std::ops::RangeInclusive<usize> = 3..=512;
/// Share of the extent left free at an edge. 0.4 leaves a fifth of the sheet.
pub const MARGIN: std::ops::RangeInclusive<f64> = 0.0..=0.4;
/// Neighbours per point. A plane needs 4 at the least; above 1000 every organ is a clique.
pub const NEIGHBOR_COUNT: std::ops::RangeInclusive<usize> = 4..=1000;
/// Landmarks. Two coordinates need at least 8 to be stable.
pub const LANDMARK_COUNT: std::ops::RangeInclusive<usize> = 8..=20_000;
/// Lengths in mm that make sense for anatomy: nodes, neighbourhoods, working voxels.
pub const LENGTH_MM: std::ops::RangeInclusive<f64> = 0.01..=1000.0;
/// Labels in one job.
pub const LABEL_COUNT: std::ops::RangeInclusive<usize> = 1..=1024;
/// Sheets per structure.
pub const FIGURE_COUNT: std::ops::RangeInclusive<usize> = 1..=64;
/// Strength of pruning.
pub const PRUNE_STRENGTH: std::ops::RangeInclusive<f64> = 0.0..=1.0;

/// Repeats for the uncertainty. Each costs a run; with 16 a standard deviation is known to a fifth,
/// with 64 to a tenth.
pub const REPEAT_COUNT: std::ops::RangeInclusive<usize> = 0..=64;

/// Parameters every value of which is in range. Only [`Params::check`] makes one.
#[derive(Clone, Debug, PartialEq)]
pub struct CheckedParams(Params);

impl Default for CheckedParams {
    /// The defaults, all of which are in range.
    fn default() -> Self {
        Self(Params::default())
    }
}

impl std::ops::Deref for CheckedParams {
    type Target = Params;
    fn deref(&self) -> &Params {
        &self.0
    }
}

impl Params {
    /// Checks every value against its range.
    ///
    /// # Errors
    /// The first field that is out of range, with what is allowed.
    pub fn check(self) -> Result<CheckedParams, ParamsError> {
        if let GridChoice::Fixed { rows, cols } = self.grid {
            within("grid.rows", rows, &LATTICE_SIDE)?;
            within("grid.cols", cols, &LATTICE_SIDE)?;
        }
        within("margin", self.margin, &MARGIN)?;
        match self.neighbors {
            Neighbors::Auto => {}
            Neighbors::Count(k) => within("neighbors.k", k, &NEIGHBOR_COUNT)?,
            Neighbors::RadiusMm(radius) => within("neighbors.epsilon_mm", radius, &LENGTH_MM)?,
        }
        if let Landmarks::Count(count) = self.landmarks {
            within("landmarks", count, &LANDMARK_COUNT)?;
        }
        if let Prune::Strength(strength) = self.prune {
            within("prune", strength, &PRUNE_STRENGTH)?;
        }
        for (field, value) in [("spacing_mm", self.spacing_mm), ("resolution_mm", self.resolution_mm)] {
            value.map_or(Ok(()), |v| within(field, v, &LENGTH_MM))?;
        }
        self.max_figures.map_or(Ok(()), |n| within("max_figures", n, &FIGURE_COUNT))?;
        within("uncertainty", self.uncertainty, &REPEAT_COUNT)?;
        if let Some(labels) = &self.labels {
            within("labels", labels.len(), &LABEL_COUNT)?;
            if labels.contains(&0) {
                let allowed = "labels other than 0, the background".to_owned();
                return Err(ParamsError { field: "labels".into(), got: "0".to_owned(), allowed });
            }
        }
        self.check_combinations()?;
        Ok(CheckedParams(self))
    }

    fn check_combinations(&self) -> Result<(), ParamsError> {
        if self.spacing_mm.is_some() && self.grid != GridChoice::Auto {
            return Err(ParamsError {
                field: "spacing_mm".into(),
                got: "a spacing with a fixed grid".to_owned(),
                allowed: "a spacing only with grid \"auto\"".to_owned(),
            });
        }
        Ok(())
    }
}

fn within<T: PartialOrd + fmt::Display>(
    field: &'static str,
    value: T,
    range: &std::ops::RangeInclusive<T>,
) -> Result<(), ParamsError> {
    if range.contains(&value) {
        return Ok(());
    }
    let allowed = format!("{} to {}", range.start(), range.end());
    Err(ParamsError { field: field.into(), got: value.to_string(), allowed })
}
