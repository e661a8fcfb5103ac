//! How accurate the program is, measured on analytic shapes whose medial sheets are known.
//!
//! `examples/accuracy.rs` writes what is measured here to `docs/accuracy.json`; a test measures it again and
//! holds it against that file. Both take this module by its path: it is no part of the library, and there is
//! one of it.

pub mod shapes;

pub mod accuracy;

pub mod table;

pub mod damage;

pub mod figures;

use medialrep::model::Model;
use medialrep::params::{GridChoice, Params};
use medialrep::pipeline::observer::Silent;
use medialrep::pipeline::{PipelineError, run};
use medialrep::space::LabelVolume;

/// The lattice that results are compared on. Its size and its margin are said here, so that figures are
/// those of the same lattice when the defaults change.
pub fn params() -> Params {
    Params { grid: GridChoice::Fixed { rows: 12, cols: 20 }, margin: Some(0.02), ..Params::default() }
}

/// Runs the pipeline, in silence.
///
/// # Errors
/// When the shape is refused.
pub fn run_of(volume: &LabelVolume, params: Params) -> Result<Model, PipelineError> {
    run(volume, &params.check().expect("params in range"), &Silent)
}
