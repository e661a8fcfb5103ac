//! `medialrep sample`: an analytic mask to try the program on.

use std::fs::File;
use std::io::BufWriter;
use std::path::PathBuf;
use std::process::ExitCode;

use anyhow::Context;
use clap::Args;
use nalgebra::{Rotation3, Unit, Vector3};

use super::{cause, complain, exit};
use crate::formats::write;
use crate::samples;

/// Arguments of `sample`.
#[derive(Debug, Args)]
pub struct SampleArgs {
    /// Which shape; see --list
    #[arg(required_unless_present = "list")]
    name: Option<String>,
    /// The file to write
    #[arg(long, value_name = "FILE.nii.gz", required_unless_present = "list")]
    out: Option<PathBuf>,
    /// Voxel spacing in mm: one number, or three along i, j and k
    #[arg(long, value_name = "X,Y,Z", value_delimiter = ',', default_values_t = [samples::SPACING_MM], num_args = 1)]
    spacing: Vec<f64>,
    /// Turn the voxel grid by this angle about the axis (1, 2, 3), so that it is oblique
    #[arg(long, value_name = "DEGREES", default_value_t = 0.0, allow_hyphen_values = true)]
    rotate_deg: f64,
    /// Print the names of all shapes
    #[arg(long)]
    list: bool,
}

/// Writes the sample, or prints the list.
///
/// # Errors
/// When writing the file fails on the way.
pub fn sample(arguments: SampleArgs) -> anyhow::Result<ExitCode> {
    if arguments.list {
        print_list();
        return Ok(ExitCode::SUCCESS);
    }
    let (Some(name), Some(out)) = (arguments.name, arguments.out) else {
        return Ok(wrong("a name and --out are needed"));
    };
    let Some(sample) = samples::by_name(&name) else {
        let names: Vec<_> = samples::list().map(|(name, _)| name).collect();
        return Ok(wrong(&format!("there is no sample of this name; there are {}", names.join(", "))));
    };
    let spacing_mm = match arguments.spacing[..] {
        [edge] => [edge; 3],
        [x, y, z] => [x, y, z],
        _ => return Ok(wrong("--spacing takes one number or three")),
    };
    let axis = Unit::new_normalize(Vector3::new(1.0, 2.0, 3.0));
    let turn = Rotation3::from_axis_angle(&axis, arguments.rotate_deg.to_radians());
    let volume = match sample.voxelise(spacing_mm, turn) {
        Ok(volume) => volume,
        Err(error) => return Ok(wrong(&error.to_string())),
    };
    let file = match File::create(&out) {
        Ok(file) => file,
        Err(error) => {
            let why = cause(&error);
            return Ok(wrong(&format!("cannot write {}: {why}; name another file with --out", out.display())));
        }
    };
    write::nifti::write(&volume, BufWriter::new(file)).context("cannot write the sample")?;
    Ok(ExitCode::SUCCESS)
}

fn wrong(text: &str) -> ExitCode {
    complain(text);
    ExitCode::from(exit::USAGE)
}

#[allow(clippy::print_stdout, reason = "this is what was asked for")]
fn print_list() {
    for (name, about) in samples::list() {
        println!("{name:<12} {about}");
    }
}
