//! Analytic shapes and what is true of every result.

use medialrep::formats::params_json;
use medialrep::model::{Model, Sheet};
use medialrep::params::{CheckedParams, Kinds, Params};
use medialrep::pipeline::context::Context;
use medialrep::pipeline::observer::Silent;
use medialrep::pipeline::solid::cut_out::{Label, label_boxes};
use medialrep::pipeline::solid::depth::{Depth, depth};
use medialrep::pipeline::solid::parts::Sent;
use medialrep::pipeline::solid::{Masked, Solid, masked};
use medialrep::pipeline::{PipelineError, run};
use medialrep::samples::{Sample, by_name};
use medialrep::space::{Grid, LabelVolume, WorldFromVoxel};
use nalgebra::Rotation3;

pub use crate::measure::accuracy::{figure_drift as drift, rms};
use crate::measure::shapes::PHASE;
pub use crate::measure::shapes::{counted, roughened, turned};
pub use crate::measure::{params, run_of};

pub fn sample(name: &str) -> Sample {
    by_name(name).expect("a sample of that name")
}

pub fn volume(name: &str) -> LabelVolume {
    sample(name).voxelise([1.0; 3], Rotation3::identity()).expect("fits in memory")
}

/// As [`volume`], at a phase of the grid at which no voxel of a flat face is decided by rounding.
pub fn plain(name: &str) -> LabelVolume {
    sample(name).voxelise_at([1.0; 3], Rotation3::identity(), PHASE).expect("fits in memory")
}

/// Parameters of sheets alone.
pub fn sheets() -> Params {
    Params { kinds: Kinds::These { sheet: true, tube: false }, ..params() }
}

pub fn model_of(volume: &LabelVolume, params: Params) -> Model {
    run_of(volume, params).expect("the shape has a medial representation")
}

/// Runs with parameters as a user writes them.
pub fn run_with(volume: &LabelVolume, params: &str) -> Result<Model, PipelineError> {
    run(volume, &params_json::parse(params.as_bytes()).expect("parameters in range"), &Silent)
}

/// The first sheet of the first structure.
pub fn first_sheet(model: &Model) -> Sheet {
    model.structures[0].sheets().next().expect("a sheet").clone()
}

/// Parameters that nothing is asked for in.
pub fn defaults() -> CheckedParams {
    Params::default().check().expect("the defaults are in range")
}

/// What stages are handed beside their input, when nobody listens.
pub fn context(params: &CheckedParams) -> Context<'_> {
    Context::new(params, &Silent, 0, 1)
}

/// Label 1 as it was sent.
pub fn sent(volume: &LabelVolume, context: &Context<'_>) -> Sent {
    let bounds = label_boxes(volume, context).expect("not cancelled")[1].expect("label 1 is there");
    Sent::of(volume, Label { index: 1, bounds }, context).expect("not cancelled")
}

/// The stages up to the depth, of label 1.
pub fn deepened(volume: &LabelVolume) -> (Solid, Depth) {
    let params = defaults();
    let context = context(&params);
    let sent = sent(volume, &context);
    let Masked { solid, .. } = masked(&sent.parts[0].native, &context).expect("a solid");
    let depth = depth(&solid, &context).expect("not cancelled");
    (solid, depth)
}

/// A volume from a predicate on voxel indices.
pub fn painted(dims: [usize; 3], spacing_mm: [f64; 3], label_at: impl Fn([usize; 3]) -> u16) -> LabelVolume {
    let mut indices = Grid::filled(dims, 0u16);
    for offset in 0..indices.as_slice().len() {
        indices.as_mut_slice()[offset] = label_at(indices.index(offset));
    }
    counted(indices, WorldFromVoxel::axis_aligned(spacing_mm, [0.0; 3]).expect("a box"))
}

/// Structural truths of every result.
pub fn check_invariants(model: &Model) {
    for structure in &model.structures {
        for figure in structure.sheets() {
            let nodes = figure.grid.rows * figure.grid.cols;
            let edge = 2 * (figure.grid.rows + figure.grid.cols) - 4;
            assert_eq!([figure.medial.len(), figure.upper.len(), figure.lower.len(), figure.valid.len()], [nodes; 4]);
            assert_eq!((figure.crest.len(), figure.medial_radius_mm.len()), (edge, nodes));
            let points = figure.medial.iter().chain(&figure.upper).chain(&figure.lower).chain(&figure.crest);
            assert!(points.flat_map(|p| p.iter()).all(|x| x.is_finite()));
            assert!(figure.medial_radius_mm.iter().all(|r| r.is_finite() && *r > 0.0));
            for (name, points) in figure.points.named() {
                assert_eq!(points.positions.len(), points.flat.len(), "{name}");
                assert!(points.flat.iter().flat_map(|p| p.iter()).all(|x| x.is_finite()));
            }
        }
        for tube in structure.tubes() {
            let nodes = tube.grid.rows * tube.grid.cols;
            assert_eq!([tube.wall.len(), tube.repaired.len(), tube.intrinsic.len()], [nodes; 3]);
            assert_eq!([tube.centreline.len(), tube.medial_radius_mm.len()], [tube.grid.cols; 2]);
            let points = tube.wall.iter().chain(&tube.centreline).chain(&tube.tips);
            assert!(points.flat_map(|p| p.iter()).all(|x| x.is_finite()));
            assert!(tube.caps[0] + tube.caps[1] < tube.grid.cols);
        }
        for junction in &structure.junctions {
            assert!(junction.figures.iter().all(|f| *f < structure.figures.len()));
            assert!(!junction.points.is_empty());
        }
    }
}
