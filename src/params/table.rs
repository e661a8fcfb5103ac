//! Every parameter, described once.

use std::fmt;
use std::ops::RangeInclusive;

use super::choices::{ARTIFACT_NAMES, Correspondence, Embedding, Kinds, LatticeKind};
use super::field::Field;
use super::given::Given;
use super::shape::{self, Shape};
use super::{Params, ParamsError};

/// Nodes per lattice side. Fewer than 3 leave no inner node to measure a spacing on; above 512
/// nodes lie closer than any scan resolves.
pub const LATTICE_SIDE: RangeInclusive<usize> = 3..=512;
/// Share of the extent left free at an edge. 0.4 leaves a fifth of the sheet.
pub const MARGIN: RangeInclusive<f64> = 0.0..=0.4;
/// Neighbours per point. A plane needs 4 at the least; above 1000 every organ is a clique.
pub const NEIGHBOR_COUNT: RangeInclusive<usize> = 4..=1000;
/// Landmarks. Two coordinates need at least 8 to be stable.
pub const LANDMARK_COUNT: RangeInclusive<usize> = 8..=20_000;
/// Lengths in mm that make sense for anatomy: nodes, neighbourhoods, working voxels. A tenth of the smallest voxel edge
/// that is read is the least: with more, a thin object of micro-CT could not be worked on more finely than it is stored;
/// less than that no mask bears.
pub const LENGTH_MM: RangeInclusive<f64> = 1e-5..=1000.0;
/// Labels in one job.
pub const LABEL_COUNT: RangeInclusive<usize> = 1..=1024;
/// Sheets per structure.
pub const FIGURE_COUNT: RangeInclusive<usize> = 1..=64;
/// Strength of pruning.
pub const PRUNE_STRENGTH: RangeInclusive<f64> = 0.0..=1.0;
/// Repeats for the uncertainty. Each costs a run; with 16 a standard deviation is known to a fifth,
/// with 64 to a tenth.
pub const REPEAT_COUNT: RangeInclusive<usize> = 0..=64;
/// Labels with names: as many as may be worked on.
pub const NAME_COUNT: RangeInclusive<usize> = 0..=*LABEL_COUNT.end();
/// Characters of a name. Longer ones fit no legend.
pub const NAME_CHARS: RangeInclusive<usize> = 1..=80;

/// A parameter: what it is called, what it does, what it takes.
pub struct Param {
    /// Its name, that of the field.
    pub name: &'static str,
    /// What it does, in one or two sentences.
    pub about: &'static str,
    /// The ways to give it.
    pub shapes: &'static [Shape],
    get: fn(&Params) -> Given,
    /// Whether the field can hold it.
    put: fn(&mut Params, &Given) -> bool,
}

/// The entry of a field of [`Params`], which gives it its name.
macro_rules! param {
    ($field:ident, $shapes:expr, $about:expr) => {
        Param {
            name: stringify!($field),
            about: $about,
            shapes: &$shapes,
            get: |params| params.$field.given(),
            put: |params, given| put(&mut params.$field, given),
        }
    };
}

fn put<T: Field>(field: &mut T, given: &Given) -> bool {
    let Some(value) = T::read(given) else { return false };
    *field = value;
    true
}

/// Every parameter, in the order in which a reader wants them.
pub static PARAMS: &[Param] = &[
    param!(
        labels,
        [Shape::List { of: &Shape::Label, lengths: LABEL_COUNT }],
        "Labels to work on, each one structure. Default: all that are not 0."
    ),
    param!(
        grid,
        [
            Shape::Fields(&[("rows", Shape::Count(LATTICE_SIDE)), ("cols", Shape::Count(LATTICE_SIDE))]),
            Shape::Words(&["auto"])
        ],
        "N × M lattice. Rows run across the shorter intrinsic axis, cols along the longer. \"auto\" takes as many as chords \
         need to follow the surface within a quarter of a working voxel, 6 × 8 at the least."
    ),
    param!(spacing_mm, [Shape::Number(LENGTH_MM)], "With grid \"auto\": geodesic distance wanted between nodes."),
    param!(
        margin,
        [Shape::Number(MARGIN)],
        "Share of the intrinsic extent left free at each edge. Default: 0 with lattice \"fitted\", 0.05 with \"regular\"."
    ),
    param!(
        neighbors,
        [
            Shape::Words(&["auto"]),
            Shape::Fields(&[("k", Shape::Count(NEIGHBOR_COUNT))]),
            Shape::Fields(&[("epsilon_mm", Shape::Number(LENGTH_MM))])
        ],
        "Whom a point is joined with in the graph that is flattened: its k nearest, or all within epsilon_mm. \
         \"auto\" takes a radius of a few voxels."
    ),
    param!(
        landmarks,
        [Shape::Words(&["auto", "all"]), Shape::Count(LANDMARK_COUNT)],
        "How many geodesic sources ISOMAP uses. \"all\" is exact ISOMAP, which takes up to 10 000 points a surface \
         (1.2 GB); more are refused."
    ),
    param!(
        lattice,
        [Shape::Words(&LatticeKind::NAMES)],
        "fitted: rows follow the sheet's own outline, so that every node lies on it. regular: the paper's rectangle, \
         nodes off the sheet flagged invalid."
    ),
    param!(
        correspondence,
        [Shape::Words(&Correspondence::NAMES)],
        "How medial and surface nodes are paired. anchored: the medial lattice is carried to both sides along the \
         spokes of its inscribed balls. paper: three independent embeddings, rigidly aligned, paired by (i, j)."
    ),
    param!(
        prune,
        [Shape::Words(&["auto"]), Shape::Number(PRUNE_STRENGTH)],
        "How much evidence a branch of the skeleton needs: 0 keeps everything, 1 the main sheet alone."
    ),
    param!(
        max_figures,
        [Shape::Count(FIGURE_COUNT)],
        "Keep at most this many sheets of each part of the label, the largest first."
    ),
    param!(
        resolution_mm,
        [Shape::Number(LENGTH_MM)],
        "Edge of the isotropic working voxel. Default: the finest edge of the mask's own grain, half of it for objects that are nowhere thicker than about four voxels."
    ),
    param!(
        uncertainty,
        [Shape::Count(REPEAT_COUNT)],
        "How often everything is computed again with the boundary moved inside what the voxels leave open. The spread \
         of each node's thickness is written as its standard deviation."
    ),
    param!(
        embedding,
        [Shape::Words(&Embedding::NAMES)],
        "The manifold learning that lays a sheet flat (in paper mode its two sides too): ISOMAP, locally linear \
         embedding (of up to 20 neighbours) or Laplacian eigenmaps, all on the same graph."
    ),
    param!(
        kinds,
        [Shape::Words(&["auto"]), Shape::List { of: &Shape::Words(&Kinds::NAMES), lengths: 1..=Kinds::NAMES.len() }],
        "Which kinds of figures may be made. sheet: a medial sheet with its two sides, as in the paper. tube: a \
         centreline with the wall round it. \"auto\" takes the one that suits the solid."
    ),
    param!(
        names,
        [Shape::Texts { chars: NAME_CHARS, lengths: NAME_COUNT }],
        "Names by label (11: left caudate), in place of those of the file."
    ),
    param!(
        outputs,
        [Shape::List { of: &Shape::Words(&ARTIFACT_NAMES), lengths: 1..=ARTIFACT_NAMES.len() }],
        "Which files are made with the result. A service makes the others when they are asked for."
    ),
];

impl Param {
    /// What it is among `params`.
    #[must_use]
    pub fn get(&self, params: &Params) -> Given {
        (self.get)(params)
    }

    /// What it is if it is not given; nothing for one that has no such value.
    #[must_use]
    pub fn default_value(&self) -> Given {
        self.get(&Params::default())
    }

    /// Checks what was given and takes it. Nothing is the default of a parameter that has none.
    ///
    /// # Errors
    /// When it is none of the shapes.
    pub(super) fn set(&self, params: &mut Params, given: &Given) -> Result<(), ParamsError> {
        if *given != Given::Nothing || self.default_value() != Given::Nothing {
            shape::check(self.name, self.shapes, given)?;
        }
        if (self.put)(params, given) { Ok(()) } else { Err(shape::wrong(self.name, given, shape::phrase(self.shapes))) }
    }
}

impl fmt::Debug for Param {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Param").field("name", &self.name).field("shapes", &self.shapes).finish_non_exhaustive()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Fields of `Params`, as its debug output has them.
    fn fields() -> Vec<String> {
        let shown = format!("{:#?}", Params::default());
        let tops = shown.lines().filter_map(|line| line.strip_prefix("    ").filter(|rest| !rest.starts_with(' ')));
        tops.filter_map(|line| line.split_once(": ")).map(|(name, _)| name.to_owned()).collect()
    }

    #[test]
    fn every_field_has_one_entry_in_its_order() {
        let names: Vec<&str> = PARAMS.iter().map(|param| param.name).collect();
        assert_eq!(names, fields());
    }

    #[test]
    fn defaults_are_allowed_and_stay_what_they_are() {
        // But for the margin, which the lattice has.
        let defaults = Params { margin: Some(0.0), ..Params::default() };
        assert_eq!(*Params::default().check().unwrap(), defaults);
        assert_eq!(*Params::read(&[]).unwrap(), defaults);
    }

    #[test]
    fn checked_names_and_outputs_have_one_form() {
        let params = Params {
            names: [(11, " left caudate ".to_owned())].into(),
            outputs: vec!["points.csv", "model.glb"],
            ..Params::default()
        };
        let checked = params.check().unwrap();
        assert_eq!(checked.names[&11], "left caudate");
        assert_eq!(checked.outputs, ["model.glb", "points.csv"]);
    }
}
