//! The uncertainty of thickness: asked for, repeatable, and of the right size.

use std::sync::Mutex;
use std::sync::atomic::{AtomicUsize, Ordering};

use medialrep::cancel::{Cancel, Cancelled};
use medialrep::model::Sheet;
use medialrep::model::Stage;
use medialrep::params::{GridChoice, Params};
use medialrep::pipeline::observer::Observer;
use medialrep::pipeline::{PipelineError, run};
use medialrep::space::{Grid, LabelVolume, WorldFromVoxel, WorldPoint};
use nalgebra::{Point3, Rotation3};

use crate::help::phantoms::{counted, first_sheet, model_of, params, rms, turned, volume};

type Shape = fn(WorldPoint) -> bool;

/// A flat sheet of 40 × 28 mm, 7.5 mm thick with a round rim: seven or eight voxels, by the phase.
fn in_slab(p: WorldPoint) -> bool {
    let [x, y] = [(p.x.abs() - 20.0).max(0.0), (p.y.abs() - 14.0).max(0.0)];
    x * x + y * y + p.z * p.z <= 3.75 * 3.75
}

fn in_ellipsoid(p: WorldPoint) -> bool {
    (p.x / 22.0).powi(2) + (p.y / 14.0).powi(2) + (p.z / 6.0).powi(2) <= 1.0
}

/// A shape on a grid of 1 mm that lies turned in the world, at a phase given in voxels.
fn on_grid(shape: Shape, rotation: Rotation3<f64>, phase: [f64; 3]) -> LabelVolume {
    let turned = |at: [usize; 3]| rotation * Point3::from([0, 1, 2].map(|a| at[a] as f64 - 32.0 + phase[a]));
    let mut indices = Grid::filled([64; 3], 0u16);
    for offset in 0..indices.as_slice().len() {
        indices.as_mut_slice()[offset] = u16::from(shape(turned(indices.index(offset))));
    }
    let origin = turned([0; 3]);
    let matrix = rotation.matrix();
    let rows = [0, 1, 2].map(|r| [matrix[(r, 0)], matrix[(r, 1)], matrix[(r, 2)], origin[r]]);
    counted(indices, WorldFromVoxel::from_rows(rows).expect("a rotation"))
}

fn figure_of(volume: &LabelVolume, params: Params) -> Sheet {
    first_sheet(&model_of(volume, params))
}

fn with_repeats(repeats: usize) -> Params {
    Params { uncertainty: repeats, ..params() }
}

/// Deviations, all of which are there.
fn known(deviations: &[Option<f64>]) -> Vec<f64> {
    deviations.iter().map(|sd| sd.expect("found again")).collect()
}

fn totals(figure: &Sheet) -> Vec<f64> {
    figure.total_mm()
}

/// Values of the nodes at least two away from the edge of the lattice.
fn inner(values: &[f64]) -> Vec<f64> {
    let is_inner = |n: usize| (2..10).contains(&(n / 20)) && (2..18).contains(&(n % 20));
    values.iter().enumerate().filter(|(n, _)| is_inner(*n)).map(|(_, v)| *v).collect()
}

/// What the phase of the grid really does to the thickness, against what one mask alone is said to
/// leave open.
fn check_size(shape: Shape, rotation: Rotation3<f64>) {
    const PHASES: [[f64; 3]; 5] =
        [[0.1, 0.3, 0.15], [0.3, 0.7, 0.95], [0.55, 0.1, 0.8], [0.9, 0.45, 0.4], [0.2, 0.25, 0.6]];
    let runs: Vec<Vec<f64>> =
        PHASES.iter().map(|phase| inner(&totals(&figure_of(&on_grid(shape, rotation, *phase), params())))).collect();
    let spread = |n: usize| {
        let mean = runs.iter().map(|run| run[n]).sum::<f64>() / runs.len() as f64;
        (runs.iter().map(|run| (run[n] - mean).powi(2)).sum::<f64>() / (runs.len() - 1) as f64).sqrt()
    };
    let actual = rms((0..runs[0].len()).map(spread));
    let figure = figure_of(&on_grid(shape, rotation, PHASES[0]), with_repeats(8));
    let found = figure.uncertainty.expect("asked for");
    let reported = rms(inner(&known(&found.total_mm)));
    assert_eq!((found.repeats, found.matched), (8, 8));
    assert!((0.5..2.5).contains(&(reported / actual)), "actual {actual:.3} mm, reported {reported:.3} mm");
}

#[test]
fn the_uncertainty_of_a_slab_is_that_of_its_grids_phase() {
    check_size(in_slab, Rotation3::identity());
    check_size(in_slab, turned());
}

#[test]
fn the_uncertainty_of_an_ellipsoid_is_that_of_its_grids_phase() {
    check_size(in_ellipsoid, Rotation3::identity());
    check_size(in_ellipsoid, turned());
}

#[test]
fn it_is_not_computed_unless_asked_for() {
    assert!(figure_of(&volume("slab"), params()).uncertainty.is_none());
}

#[test]
fn it_leaves_the_result_alone_and_is_the_same_on_any_number_of_threads() {
    let volume = on_grid(in_ellipsoid, turned(), [0.0; 3]);
    let on = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("a pool");
        pool.install(|| figure_of(&volume, with_repeats(3)))
    };
    let (one, two, without) = (on(1), on(2), figure_of(&volume, params()));
    assert_eq!(one.uncertainty, two.uncertainty);
    assert_eq!((&one.medial, &one.upper, &one.frame), (&without.medial, &without.upper, &without.frame));
}

#[test]
fn repeats_keep_the_lattice_that_was_chosen() {
    let volume = on_grid(in_ellipsoid, turned(), [0.0; 3]);
    let asked = Params { grid: GridChoice::Auto, spacing_mm: Some(2.5), uncertainty: 3, ..params() };
    let figure = figure_of(&volume, asked);
    let found = figure.uncertainty.expect("asked for");
    assert_eq!((found.matched, found.total_mm.len()), (3, figure.medial.len()));
    assert!(found.upper_mm.iter().chain(&found.lower_mm).all(|sd| sd.is_some_and(|sd| sd < 2.0)));
}

#[test]
fn voxels_three_times_as_long_leave_more_open() {
    let coarse = |z_mm: f64| {
        let world = WorldFromVoxel::axis_aligned([1.0, 1.0, z_mm], [-27.9, -19.3, -11.7]).expect("a box");
        let mut indices = Grid::filled([56, 40, 26], 0u16);
        for offset in 0..indices.as_slice().len() {
            let at = Point3::from(indices.index(offset).map(|x| x as f64));
            indices.as_mut_slice()[offset] = u16::from(in_ellipsoid(world.point(at)));
        }
        let found = figure_of(&counted(indices, world), with_repeats(4)).uncertainty.expect("asked for");
        rms(inner(&known(&found.total_mm)))
    };
    let (even, long) = (coarse(1.0), coarse(3.0));
    assert!(long > 1.5 * even, "{even:.3} mm with even voxels, {long:.3} mm with long ones");
}

/// Hears of repeats.
#[derive(Default)]
struct Heard(Mutex<Vec<(usize, usize)>>);

impl Cancel for Heard {}

impl Observer for Heard {
    fn progress(&self, _structure: usize, _structures: usize, _stage: Stage, _fraction: f64) {}

    fn repeated(&self, _structure: usize, _structures: usize, done: usize, repeats: usize) {
        self.0.lock().unwrap().push((done, repeats));
    }
}

#[test]
fn every_repeat_is_told_of() {
    let heard = Heard::default();
    run(&volume("slab"), &with_repeats(3).check().expect("in range"), &heard).expect("a slab has a sheet");
    let mut heard = heard.0.into_inner().unwrap();
    heard.sort_unstable();
    assert_eq!(heard, [(0, 3), (1, 3), (2, 3), (3, 3)]);
}

/// Stops once the result itself is done.
struct StopsInRepeats {
    is_done: AtomicUsize,
}

impl Observer for StopsInRepeats {
    fn progress(&self, _structure: usize, _structures: usize, stage: Stage, fraction: f64) {
        if stage == Stage::Quality && fraction >= 1.0 {
            self.is_done.store(1, Ordering::Relaxed);
        }
    }
}

impl Cancel for StopsInRepeats {
    fn is_cancelled(&self) -> bool {
        self.is_done.load(Ordering::Relaxed) > 0
    }
}

#[test]
fn repeats_stop_when_asked_to() {
    let stops = StopsInRepeats { is_done: AtomicUsize::new(0) };
    let checked = with_repeats(64).check().expect("in range");
    assert_eq!(run(&volume("slab"), &checked, &stops).err(), Some(PipelineError::Cancelled(Cancelled)));
}
