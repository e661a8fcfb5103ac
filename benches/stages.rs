//! What each stage costs: the `timings_ms` of one shape at three sizes on one thread, and the whole from file
//! to files, as a Markdown table of milliseconds (medians).
//!
//! `make bench` prints it; docs/accuracy.md has the figures of a two-core machine.

#![allow(clippy::print_stdout, reason = "the table is what was asked for")]

use std::io::sink;
use std::time::{Duration, Instant};

use medialrep::formats::write::thickness::{InputFacts, OuterTimings};
use medialrep::formats::write::{self, glb, tables, thickness};
use medialrep::formats::{InputLimits, read};
use medialrep::model::{Model, Stage, StageTimings};
use medialrep::params::{CheckedParams, Params};
use medialrep::pipeline::observer::Silent;
use medialrep::pipeline::run;
use medialrep::samples::by_name;
use nalgebra::Rotation3;

/// Voxel edges, mm: each halving is eight times the voxels.
const SPACINGS_MM: [f64; 3] = [2.0, 1.0, 0.5];
/// Runs of each size, at the least, and for how long.
const RUNS: usize = 5;
const LONG_ENOUGH: Duration = Duration::from_secs(5);

fn main() {
    // Asked to list its tests, it has none.
    if std::env::args().any(|argument| argument == "--list") {
        return;
    }
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().expect("a thread");
    let names: Vec<&str> = Stage::ALL.iter().map(|stage| stage.name()).collect();
    println!("| voxels of the volume | {} | whole |", names.join(" | "));
    println!("|{}", "---|".repeat(names.len() + 2));
    for spacing_mm in SPACINGS_MM {
        println!("{}", pool.install(|| row(spacing_mm)));
    }
}

/// A row of the table.
fn row(spacing_mm: f64) -> String {
    let sample = by_name("bent_even").expect("a sample of that name");
    let volume = sample.voxelise([spacing_mm; 3], Rotation3::identity()).expect("fits in memory");
    let mut file = Vec::new();
    write::nifti::write(&volume, &mut file).expect("memory takes it");
    let params = Params::default().check().expect("the defaults are in range");
    let (mut stages, mut wholes) = (Vec::new(), Vec::new());
    let start = Instant::now();
    while wholes.len() < RUNS || start.elapsed() < LONG_ENOUGH {
        let begun = Instant::now();
        stages.push(from_file_to_files(&file, &params));
        wholes.push(begun.elapsed().as_secs_f64() * 1e3);
    }
    let voxels = volume.indices().as_slice().len();
    let mut cells = vec![voxels.to_string()];
    for stage in Stage::ALL {
        cells.push(short(median(stages.iter().map(|timings| timings.of(stage)).collect())));
    }
    cells.push(short(median(wholes)));
    format!("| {} |", cells.join(" | "))
}

/// The stages' times of one run.
fn from_file_to_files(file: &[u8], params: &CheckedParams) -> StageTimings {
    let read = read(file, InputLimits::default()).expect("it was written here");
    let model: Model = run(&read.volume, params, &Silent).expect("the shape has a medial sheet");
    let input = InputFacts { sha256: read.sha256, format: read.format.to_owned() };
    glb::write(&model, sink()).expect("nothing is written");
    tables::write_thickness(&model, sink()).expect("nothing is written");
    tables::write_points(&model, sink()).expect("nothing is written");
    thickness::write(&model, &input, &[], OuterTimings::default(), sink()).expect("nothing is written");
    model.structures[0].timings
}

fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    values[values.len() / 2]
}

/// Two digits are what a repeat gives again.
fn short(milliseconds: f64) -> String {
    if milliseconds < 10.0 { format!("{milliseconds:.1}") } else { format!("{milliseconds:.0}") }
}
