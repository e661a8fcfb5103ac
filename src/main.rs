//! The `medialrep` program: one call.

use std::process::ExitCode;

fn main() -> ExitCode {
    medialrep::cli::main()
}
