//! Arguments in, one call, an exit code out.

use std::process::ExitCode;

use clap::{Parser, Subcommand};
use medialrep::cli::probe::{ProbeArgs, probe};
use medialrep::cli::serve::{ServeArgs, serve};

/// Medial shape representation of anatomy.
#[derive(Debug, Parser)]
#[command(version)]
struct Args {
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, Subcommand)]
enum Command {
    /// The service.
    Serve(ServeArgs),
    /// Whether a running service is ready.
    #[command(hide = true)]
    Probe(ProbeArgs),
    /// The description of the service's routes.
    #[command(hide = true)]
    Openapi,
}

#[expect(clippy::print_stdout, reason = "the document goes to stdout")]
fn main() -> anyhow::Result<ExitCode> {
    match Args::parse().command {
        Command::Serve(args) => serve(&args),
        Command::Probe(args) => Ok(probe(&args)),
        Command::Openapi => {
            print!("{}", medialrep::http::openapi_yaml());
            Ok(ExitCode::SUCCESS)
        }
    }
}
