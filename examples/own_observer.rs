//! Listening to a run, and stopping it when it takes too long:
//!
//! ```sh
//! cargo run --release --no-default-features --example own_observer
//! ```

#![allow(clippy::print_stdout, reason = "a program for the command line")]

use std::error::Error;
use std::time::{Duration, Instant};

use medialrep::cancel::Cancel;
use medialrep::model::Stage;
use medialrep::params::Params;
use medialrep::pipeline::observer::Observer;
use medialrep::pipeline::{PipelineError, run};
use medialrep::samples::by_name;
use nalgebra::Rotation3;

/// Prints each stage when it is done, and stops the run at a time.
struct Listener {
    deadline: Instant,
}

impl Cancel for Listener {
    /// Asked often, from every thread of the run.
    fn is_cancelled(&self) -> bool {
        Instant::now() >= self.deadline
    }
}

impl Observer for Listener {
    fn progress(&self, structure: usize, structures: usize, stage: Stage, fraction: f64) {
        if fraction >= 1.0 {
            println!("structure {} of {structures}: {} is done", structure + 1, stage.name());
        }
    }
}

fn main() -> Result<(), Box<dyn Error>> {
    let sample = by_name("wye").ok_or("no such sample")?;
    let volume = sample.voxelise([1.0; 3], Rotation3::identity())?;
    let params = Params::default().check()?;
    for patience in [Duration::from_secs(60), Duration::from_millis(50)] {
        let listener = Listener { deadline: Instant::now() + patience };
        match run(&volume, &params, &listener) {
            Ok(model) => println!("{} figures", model.structures[0].figures.len()),
            Err(PipelineError::Cancelled(_)) => println!("stopped after {patience:?}"),
            Err(PipelineError::Refused(refusal)) => println!("{refusal}; {}", refusal.hint()),
        }
    }
    Ok(())
}
