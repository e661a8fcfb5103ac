//! From a mask to its meshes and numbers, without the service:
//!
//! ```sh
//! cargo run --release --no-default-features --example mask_to_model -- mask.nii.gz results
//! ```

#![allow(clippy::print_stdout, reason = "a program for the command line")]

use std::error::Error;
use std::fs::{File, create_dir_all};
use std::io::{BufWriter, Write};
use std::path::Path;

use medialrep::cancel::Never;
use medialrep::formats::artifacts::ARTIFACTS;
use medialrep::formats::write::record::Record;
use medialrep::formats::write::thickness::{InputFacts, OuterTimings};
use medialrep::formats::{InputLimits, read_file};
use medialrep::model::Warning;
use medialrep::params::{GridChoice, Params};

fn main() -> Result<(), Box<dyn Error>> {
    let mut arguments = std::env::args().skip(1);
    let (Some(mask), Some(out)) = (arguments.next(), arguments.next()) else {
        return Err("usage: mask_to_model MASK OUT".into());
    };
    let read = read_file(Path::new(&mask), InputLimits::default(), &Never)?;
    let params = Params { grid: GridChoice::Fixed { rows: 12, cols: 20 }, ..Params::default() };
    let model = medialrep::run(&read.volume, &params)?;
    for structure in &model.structures {
        let verdict = structure.quality.verdict.name();
        match &structure.refusal {
            None => println!("label {}: {} figures, {verdict}", structure.label, structure.figures.len()),
            Some(refusal) => println!("label {}: {refusal}", structure.label),
        }
    }
    let input = InputFacts { sha256: read.sha256, format: read.format.to_owned() };
    let mut warnings = Vec::new();
    for notice in read.volume.into_notices() {
        warnings.push(Warning { code: notice.code.into(), message: notice.message });
    }
    let timings = OuterTimings::default();
    let record = Record { model, input, warnings, timings, ended_unix_s: None, dicom: read.origin };
    create_dir_all(&out)?;
    for artifact in ARTIFACTS.iter().filter(|artifact| artifact.is_default) {
        let mut file = BufWriter::new(File::create(Path::new(&out).join(artifact.name))?);
        (artifact.write)(&record, &mut file)?;
        file.flush()?;
    }
    Ok(())
}
