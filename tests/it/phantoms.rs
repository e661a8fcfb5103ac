//! Analytic shapes and what is measured on their results.

use medialrep::model::{Figure, Model};
use medialrep::params::{CheckedParams, GridChoice, Params};
use medialrep::pipeline::context::Context;
use medialrep::pipeline::observer::Silent;
use medialrep::pipeline::solid::cut_out::{Label, label_boxes};
use medialrep::pipeline::solid::depth::{Depth, depth};
use medialrep::pipeline::solid::{Masked, Solid, masked};
use medialrep::pipeline::{PipelineError, run};
use medialrep::samples::{Sample, by_name};
use medialrep::space::{Grid, LabelVolume, WorldFromVoxel, WorldPoint};
use nalgebra::{Rotation3, Unit, Vector3};

pub fn sample(name: &str) -> Sample {
    by_name(name).expect("a sample of that name")
}

pub fn volume(name: &str) -> LabelVolume {
    sample(name).voxelise([1.0; 3], Rotation3::identity()).expect("fits in memory")
}

/// A grid that lies oblique to the world.
pub fn turned() -> Rotation3<f64> {
    Rotation3::from_axis_angle(&Unit::new_normalize(Vector3::new(1.0, 2.0, 3.0)), 37.0f64.to_radians())
}

/// The lattice that results are compared on.
pub fn params() -> Params {
    Params { grid: GridChoice::Fixed { rows: 12, cols: 20 }, margin: 0.02, ..Params::default() }
}

pub fn model_of(volume: &LabelVolume, params: Params) -> Model {
    run_of(volume, params).expect("the shape has a medial representation")
}

pub fn run_of(volume: &LabelVolume, params: Params) -> Result<Model, PipelineError> {
    run(volume, &params.check().expect("params in range"), &Silent)
}

/// Parameters that nothing is asked for in.
pub fn defaults() -> CheckedParams {
    Params::default().check().expect("the defaults are in range")
}

/// What stages are handed beside their input, when nobody listens.
pub fn context(params: &CheckedParams) -> Context<'_> {
    Context::new(params, &Silent, 0, 1)
}

/// The stages up to the depth, of label 1.
pub fn deepened(volume: &LabelVolume) -> (Solid, Depth) {
    let params = defaults();
    let context = context(&params);
    let bounds = label_boxes(volume, &context).expect("not cancelled")[1].expect("label 1 is there");
    let Masked { solid, .. } = masked(volume, Label { index: 1, bounds }, &context).expect("a solid");
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

/// Labels equal to their indices.
pub fn counted(indices: Grid<u16>, world_from_voxel: WorldFromVoxel) -> LabelVolume {
    let most = usize::from(*indices.as_slice().iter().max().expect("voxels"));
    let mut label_voxels = vec![0u64; most + 1];
    indices.as_slice().iter().for_each(|&l| label_voxels[usize::from(l)] += 1);
    let label_values = (0..=i64::try_from(most).expect("small")).collect();
    LabelVolume { indices, label_values, label_voxels, world_from_voxel, notices: Vec::new() }
}

pub fn rms(values: impl Iterator<Item = f64>) -> f64 {
    let (sum, count) = values.fold((0.0, 0.0), |(s, n), v| (s + v * v, n + 1.0));
    (sum / f64::max(count, 1.0)).sqrt()
}

/// Root mean square distance between the nodes of two figures.
pub fn drift(a: &Figure, b: &Figure) -> f64 {
    let pairs = |x: &[WorldPoint], y: &[WorldPoint]| x.iter().zip(y).map(|(p, q)| (p - q).norm()).collect::<Vec<_>>();
    let all = [pairs(&a.medial, &b.medial), pairs(&a.upper, &b.upper), pairs(&a.lower, &b.lower)];
    rms(all.into_iter().flatten())
}

/// Structural truths of every result.
pub fn check_invariants(model: &Model) {
    for structure in &model.structures {
        for figure in &structure.figures {
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
        for junction in &structure.junctions {
            assert!(junction.figures.iter().all(|f| *f < structure.figures.len()));
            assert!(!junction.points.is_empty());
        }
    }
}
