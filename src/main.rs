//! The `medialrep` program: arguments, then one call.

use std::process::ExitCode;

use clap::Parser;

fn main() -> ExitCode {
    medialrep::cli::main(medialrep::cli::Arguments::parse())
}
