//! The command line: `serve`, `run`, `sample`, and what an operator needs: `token`, `check`, `backup`.

pub mod serve;

pub mod run;

pub mod sample;

pub mod probe;

pub mod token;

pub mod check;

pub mod backup;

use std::process::ExitCode;

use clap::{Parser, Subcommand};

/// Exit codes, as the contract has them. 0 is done.
pub mod exit {
    /// Our fault.
    pub const INTERNAL: u8 = 1;
    /// Wrong usage.
    pub const USAGE: u8 = 2;
    /// The file was refused.
    pub const FILE_REFUSED: u8 = 3;
    /// The shape has no medial representation.
    pub const SHAPE_REFUSED: u8 = 4;
}

/// Medial representation of anatomical shapes: a mask in, the medial sheet, surfaces and
/// thickness vectors out.
#[derive(Debug, Parser)]
#[command(version, about, max_term_width = 100)]
pub struct Arguments {
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, Subcommand)]
enum Command {
    /// Start the service
    Serve(Box<serve::ServeArgs>),
    /// Process one mask, without the service
    Run(run::RunArgs),
    /// Write an analytic mask to try the program on
    Sample(sample::SampleArgs),
    /// Make, list and revoke access tokens
    #[command(subcommand)]
    Token(token::TokenCommand),
    /// Look whether settings, data directory, disk, database, files and audit log are in order
    Check(Box<check::CheckArgs>),
    /// Copy the data directory of a running service
    Backup(backup::BackupArgs),
    /// Ask a running service whether it is ready
    #[command(hide = true)]
    Probe(probe::ProbeArgs),
    /// Write the description of the service's routes
    #[command(hide = true)]
    Openapi,
}

/// Does what the arguments say; an error is told in one line.
#[must_use]
pub fn main(arguments: Arguments) -> ExitCode {
    let outcome = match arguments.command {
        Command::Serve(arguments) => serve::serve(&arguments),
        Command::Run(arguments) => run::run(arguments),
        Command::Sample(arguments) => sample::sample(arguments),
        Command::Token(command) => token::token(command),
        Command::Check(arguments) => check::check(&arguments),
        Command::Backup(arguments) => backup::backup(&arguments),
        Command::Probe(arguments) => Ok(probe::probe(&arguments)),
        Command::Openapi => Ok(openapi()),
    };
    outcome.unwrap_or_else(|error| {
        complain(&format!("{error:#}"));
        ExitCode::from(exit::INTERNAL)
    })
}

#[expect(clippy::print_stdout, reason = "the document goes to stdout")]
fn openapi() -> ExitCode {
    print!("{}", crate::http::openapi_yaml());
    ExitCode::SUCCESS
}

/// One line on stderr, whatever is in `text`.
#[allow(clippy::print_stderr, reason = "this is the command line")]
fn complain(text: &str) {
    eprintln!("medialrep: {}", text.replace(['\n', '\r'], " "));
}
