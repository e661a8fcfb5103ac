//! What a user may ask for, and the checked form the stages read.
//!
//! A parameter is a field of [`Params`], its default, and one entry of [`PARAMS`]. What reads and writes
//! parameters follows from the entry: the check, the JSON, the schema of the API with the form of the page,
//! the table in docs/parameters.md, the seeds and the dictionary of the fuzzer. Knows no file format:
//! [`Given`] stands for a value as it was given, whatever it was written in.

mod given;

mod choices;

mod shape;

mod field;

mod table;

use std::borrow::Cow;
use std::collections::BTreeMap;

pub use choices::{
    ARTIFACT_NAMES, Correspondence, DEFAULT_ARTIFACTS, Embedding, GridChoice, Kinds, Landmarks, LatticeKind, Neighbors,
    Prune,
};
pub use given::Given;
pub(crate) use given::echo;
pub use shape::{Shape, phrase};
pub use table::{
    FIGURE_COUNT, LABEL_COUNT, LANDMARK_COUNT, LATTICE_SIDE, LENGTH_MM, MARGIN, NAME_CHARS, NAME_COUNT, NEIGHBOR_COUNT,
    PARAMS, PRUNE_STRENGTH, Param, REPEAT_COUNT,
};

/// Parameters as asked for. [`Params::check`] makes them usable. [`PARAMS`] says what each is, in this order.
#[derive(Clone, Debug, PartialEq)]
pub struct Params {
    /// Labels to work on; `None` means all that are not 0.
    pub labels: Option<Vec<i64>>,
    /// Lattice size.
    pub grid: GridChoice,
    /// Wanted geodesic distance between nodes, mm, with `grid: auto`.
    pub spacing_mm: Option<f64>,
    /// Share of the intrinsic extent left free at each edge; none for what the lattice needs. Checked ones have it.
    pub margin: Option<f64>,
    /// Neighbourhood of the graph that is flattened.
    pub neighbors: Neighbors,
    /// ISOMAP landmarks.
    pub landmarks: Landmarks,
    /// Lattice shape.
    pub lattice: LatticeKind,
    /// Pairing of nodes.
    pub correspondence: Correspondence,
    /// Pruning.
    pub prune: Prune,
    /// Keep at most this many sheets of each part of a label, the largest first.
    pub max_figures: Option<usize>,
    /// Edge of the isotropic working voxel, mm; `None` means the finest edge of its grain.
    pub resolution_mm: Option<f64>,
    /// Repeats for the uncertainty of thickness; 0 for none.
    pub uncertainty: usize,
    /// How a sheet is laid flat.
    pub embedding: Embedding,
    /// Which kinds of figures may be made.
    pub kinds: Kinds,
    /// Names of labels. Checked ones have no space around them.
    pub names: BTreeMap<i64, String>,
    /// Which of [`ARTIFACT_NAMES`] to make. Checked ones are in that order.
    pub outputs: Vec<&'static str>,
}

impl Default for Params {
    fn default() -> Self {
        Self {
            labels: None,
            grid: GridChoice::Auto,
            spacing_mm: None,
            margin: None,
            neighbors: Neighbors::Auto,
            landmarks: Landmarks::Auto,
            lattice: LatticeKind::Fitted,
            correspondence: Correspondence::Anchored,
            prune: Prune::Auto,
            max_figures: None,
            resolution_mm: None,
            uncertainty: 0,
            embedding: Embedding::Isomap,
            kinds: Kinds::Auto,
            names: BTreeMap::new(),
            outputs: DEFAULT_ARTIFACTS.to_vec(),
        }
    }
}

/// A parameter that cannot be used.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[error("{field}: got {got}, allowed is {allowed}")]
pub struct ParamsError {
    /// The field, dotted (`grid.rows`).
    pub field: Cow<'static, str>,
    /// What was given, its first characters.
    pub got: String,
    /// What is allowed.
    pub allowed: String,
}

/// Parameters every value of which is in range. Only [`Params::check`] and [`Params::read`] make one.
#[derive(Clone, Debug, PartialEq)]
pub struct CheckedParams(Params);

impl Default for CheckedParams {
    /// The defaults, all of which are in range.
    fn default() -> Self {
        let params = Params::default();
        Self(Params { margin: Some(params.lattice.margin()), ..params })
    }
}

impl CheckedParams {
    /// Whether the paper's own pairing or its own lattice is asked for. They are there to be looked at as they are: nothing is
    /// done to them that the paper does not do.
    #[must_use]
    pub fn are_of_paper(&self) -> bool {
        self.correspondence == Correspondence::Paper || self.lattice == LatticeKind::Regular
    }

    /// The same with the lattice that follows the shape, on which figures are chosen, where another one is asked for;
    /// `None` where it is the same one, or the paper's.
    #[must_use]
    pub fn following_shape(&self) -> Option<Self> {
        let defaults = Params::default();
        let chosen = Self(Params {
            grid: defaults.grid,
            spacing_mm: defaults.spacing_mm,
            margin: Some(self.lattice.margin()),
            ..self.0.clone()
        });
        (chosen != *self && !self.are_of_paper()).then_some(chosen)
    }

    /// Share of the intrinsic extent left free at each edge.
    #[must_use]
    pub fn margin(&self) -> f64 {
        self.margin.unwrap_or(self.lattice.margin())
    }
}

impl std::ops::Deref for CheckedParams {
    type Target = Params;
    fn deref(&self) -> &Params {
        &self.0
    }
}

impl Params {
    /// Parameters from values by name; the others have their defaults.
    ///
    /// # Errors
    /// The first name that is unknown, or else the first value that is none of its parameter's.
    pub fn read(given: &[(String, Given)]) -> Result<CheckedParams, ParamsError> {
        let names = given.iter().map(|(name, _)| name);
        shape::only_known("", names, PARAMS.iter().map(|param| param.name))?;
        let mut params = Self::default();
        for (name, value) in given {
            for param in PARAMS.iter().filter(|param| param.name == name) {
                param.set(&mut params, value)?;
            }
        }
        params.fit_together()
    }

    /// Checks every value as if it had been given by name.
    ///
    /// # Errors
    /// The first field that is out of range, with what is allowed.
    pub fn check(self) -> Result<CheckedParams, ParamsError> {
        let mut params = Self::default();
        for param in PARAMS {
            param.set(&mut params, &param.get(&self))?;
        }
        params.fit_together()
    }

    /// How often each structure is computed: the result itself, and the repeats for its uncertainty.
    #[must_use]
    pub fn runs(&self) -> usize {
        1 + self.uncertainty
    }

    /// What no parameter can check alone.
    fn fit_together(self) -> Result<CheckedParams, ParamsError> {
        if self.spacing_mm.is_some() && self.grid != GridChoice::Auto {
            return Err(ParamsError {
                field: "spacing_mm".into(),
                got: "a spacing with a fixed grid".to_owned(),
                allowed: "a spacing only with grid \"auto\"".to_owned(),
            });
        }
        Ok(CheckedParams(Self { margin: self.margin.or(Some(self.lattice.margin())), ..self }))
    }
}
