//! The command line: `serve`, `run`, `sample`, and what an operator needs: `token`, `check`, `backup`.

pub mod serve;

mod pacs;

pub mod run;

mod bar;

mod mask;

mod table;

pub mod sample;

pub mod probe;

pub mod token;

pub mod check;

pub mod backup;

use std::process::ExitCode;

use clap::error::ErrorKind;
use clap::{Parser, Subcommand};

use crate::isolation;

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
    /// Run masks for the process that started this one
    #[command(hide = true, name = isolation::ARGUMENT)]
    Isolated {
        /// Threads to work with
        #[arg(long)]
        threads: Option<u16>,
    },
    /// Write the description of the service's routes
    #[command(hide = true)]
    Openapi,
}

/// Does what the arguments of this process say; an error is told in one line.
#[must_use]
pub fn main() -> ExitCode {
    match Arguments::try_parse() {
        Ok(arguments) => obey(arguments),
        Err(error) if is_help(&error) => error.exit(),
        Err(error) => {
            complain(&one_line(&error.to_string()));
            ExitCode::from(exit::USAGE)
        }
    }
}

fn is_help(error: &clap::Error) -> bool {
    matches!(
        error.kind(),
        ErrorKind::DisplayHelp | ErrorKind::DisplayVersion | ErrorKind::DisplayHelpOnMissingArgumentOrSubcommand
    )
}

/// What is wrong with the arguments, without the paragraphs on usage: where to read it up is enough.
fn one_line(told: &str) -> String {
    let mut command = vec!["medialrep"];
    let mut parts = Vec::new();
    for paragraph in told.split("\n\n") {
        let mut words = paragraph.split_whitespace();
        match words.next() {
            Some("Usage:") => command = words.take_while(|word| !word.starts_with(['-', '<', '['])).collect(),
            Some("error:") => parts.push(words.collect::<Vec<_>>().join(" ")),
            Some("tip:") => parts.push(paragraph.split_whitespace().collect::<Vec<_>>().join(" ")),
            _ => {}
        }
    }
    parts.push(format!("see {} --help", command.join(" ")));
    parts.join("; ")
}

fn obey(arguments: Arguments) -> ExitCode {
    let outcome = match arguments.command {
        Command::Serve(arguments) => serve::serve(&arguments),
        Command::Run(arguments) => run::run(arguments),
        Command::Sample(arguments) => sample::sample(arguments),
        Command::Token(command) => token::token(command),
        Command::Check(arguments) => check::check(&arguments),
        Command::Backup(arguments) => backup::backup(&arguments),
        Command::Probe(arguments) => Ok(probe::probe(&arguments)),
        Command::Isolated { threads } => isolation::child::main(threads),
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

/// Why something failed, without the number that the system has for it.
fn cause(error: &std::io::Error) -> String {
    let text = error.to_string();
    text.split(" (os error").next().unwrap_or(&text).to_owned()
}

/// One line on stderr, whatever is in `text`.
#[allow(clippy::print_stderr, reason = "this is the command line")]
fn complain(text: &str) {
    eprintln!("medialrep: {}", text.replace(['\n', '\r'], " "));
}

#[cfg(test)]
mod tests {
    use super::*;

    fn told(arguments: &[&str]) -> String {
        let arguments = ["medialrep"].iter().chain(arguments);
        one_line(&Arguments::try_parse_from(arguments).unwrap_err().to_string())
    }

    #[test]
    fn wrong_arguments_are_one_line_with_the_place_to_look() {
        for (arguments, line) in [
            (
                vec!["run", "mask.nii"],
                "the following required arguments were not provided: --out <DIR>; see medialrep run --help",
            ),
            (
                vec!["run", "mask.nii", "--out", "out", "--thread", "2"],
                "unexpected argument '--thread' found; tip: a similar argument exists: '--threads'; see medialrep run --help",
            ),
            (
                vec!["rum"],
                "unrecognized subcommand 'rum'; tip: a similar subcommand exists: 'run'; see medialrep --help",
            ),
        ] {
            assert_eq!(told(&arguments), line);
        }
        let value = told(&["run", "mask.nii", "--out", "out", "--threads", "none"]);
        assert!(value.contains("'none' for '--threads <N>'") && value.ends_with("--help"), "{value}");
    }
}
