//! `medialrep run`: one mask, no service.

use std::io::IsTerminal;
use std::num::NonZeroUsize;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::PathBuf;
use std::process::ExitCode;
use std::sync::Mutex;

use anyhow::Context;
use clap::Args;
use indicatif::{ProgressBar, ProgressStyle};

use super::{complain, exit};
use crate::cancel::Cancel;
use crate::formats::params_json;
use crate::jobs::process::{self, InputLimits, ProcessError};
use crate::model::SHAPE_CODES;
use crate::model::Stage;
use crate::params::CheckedParams;
use crate::pipeline::observer::Observer;
use crate::problem::Problem;

/// Steps of a bar.
const BAR_STEPS: u32 = 1000;

/// Arguments of `run`.
#[derive(Debug, Args)]
pub struct RunArgs {
    /// The mask: a binary or label map, .nii or .nii.gz
    mask: PathBuf,
    /// Folder for the results; made when it is not there
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// Parameters as JSON, or @FILE to read them from
    #[arg(long, value_name = "JSON|@FILE", default_value = "{}")]
    params: String,
    /// Threads to work with [default: the cores]
    #[arg(long, value_name = "N")]
    threads: Option<NonZeroUsize>,
    /// Print errors as a problem object (RFC 9457)
    #[arg(long)]
    json: bool,
}

/// Processes the mask.
///
/// # Errors
/// Only for faults of our own; what is wrong with the input ends in an exit code.
pub fn run(arguments: RunArgs) -> anyhow::Result<ExitCode> {
    let problem = match try_run(&arguments)? {
        Ok(()) => return Ok(ExitCode::SUCCESS),
        Err(problem) => problem,
    };
    if arguments.json {
        print_problem(&problem)?;
    } else {
        complain(&sentence(&problem));
    }
    Ok(ExitCode::from(exit_code(&problem)))
}

fn try_run(arguments: &RunArgs) -> anyhow::Result<Result<(), Problem>> {
    let params = match read_params(&arguments.params) {
        Ok(params) => params,
        Err(problem) => return Ok(Err(*problem)),
    };
    if let Err(error) = std::fs::File::open(&arguments.mask) {
        return Ok(Err(usage("cannot_open_mask", format!("cannot open the mask: {error}"), "MASK")));
    }
    if let Err(error) = std::fs::create_dir_all(&arguments.out) {
        return Ok(Err(usage(
            "cannot_make_folder",
            format!("cannot make the folder for the results: {error}"),
            "--out",
        )));
    }
    if let Some(threads) = arguments.threads {
        rayon::ThreadPoolBuilder::new().num_threads(threads.get()).build_global().context("starting threads")?;
    }
    let bars = Bars::new();
    let work = || process::process(&arguments.mask, &params, InputLimits::default(), &arguments.out, &bars);
    let outcome = catch_unwind(AssertUnwindSafe(work));
    bars.finish();
    Ok(match outcome {
        Ok(Ok(_)) => Ok(()),
        Ok(Err(ProcessError::Problem(problem))) => Err(*problem),
        Ok(Err(ProcessError::Cancelled)) => Err(Problem::new(500, "cancelled", "the run was stopped")),
        Err(_) => Err(Problem::new(500, "internal", "the program failed; please report it with the line above")),
    })
}

fn read_params(argument: &str) -> Result<CheckedParams, Box<Problem>> {
    let text = match argument.strip_prefix('@') {
        None => argument.as_bytes().to_vec(),
        Some(path) => std::fs::read(path)
            .map_err(|error| usage("cannot_open_params", format!("cannot read the parameters: {error}"), "--params"))?,
    };
    params_json::parse(&text).map_err(|error| Box::new(Problem::from(&error)))
}

fn usage(code: &str, detail: String, argument: &str) -> Problem {
    Problem::new(400, code, detail).at(argument).hint("see medialrep run --help")
}

/// What, where, what to do.
fn sentence(problem: &Problem) -> String {
    let mut text = problem.detail.clone();
    if let Some(location) = &problem.location {
        text.push_str(&format!(" (at {location})"));
    }
    // Parameters say in the detail already what is allowed.
    if let Some(hint) = problem.hint.as_ref().filter(|hint| !problem.detail.contains(hint.as_str())) {
        text.push_str(&format!("; {hint}"));
    }
    text.push_str(&format!(" [{}]", problem.code));
    text
}

fn exit_code(problem: &Problem) -> u8 {
    const USAGE_CODES: [&str; 5] =
        ["malformed_params", "invalid_params", "cannot_open_mask", "cannot_make_folder", "cannot_open_params"];
    match problem.code.as_str() {
        _ if problem.status >= 500 => exit::INTERNAL,
        code if USAGE_CODES.contains(&code) => exit::USAGE,
        code if SHAPE_CODES.contains(&code) => exit::SHAPE_REFUSED,
        _ => exit::FILE_REFUSED,
    }
}

#[allow(clippy::print_stderr, reason = "this is the command line")]
fn print_problem(problem: &Problem) -> anyhow::Result<()> {
    eprintln!("{}", serde_json::to_string(problem).context("writing the problem")?);
    Ok(())
}

/// A bar per stage, on a terminal only.
struct Bars {
    current: Option<Mutex<Current>>,
}

/// The bar on the screen, and the structure and stage it belongs to.
struct Current {
    of: Option<(usize, Stage)>,
    bar: ProgressBar,
}

impl Bars {
    fn new() -> Self {
        let current =
            std::io::stderr().is_terminal().then(|| Mutex::new(Current { of: None, bar: ProgressBar::hidden() }));
        Self { current }
    }

    fn finish(&self) {
        if let Some(Ok(guard)) = self.current.as_ref().map(Mutex::lock) {
            guard.bar.finish();
        }
    }
}

impl Cancel for Bars {}

impl Observer for Bars {
    fn progress(&self, structure: usize, structures: usize, stage: Stage, fraction: f64) {
        let Some(Ok(mut guard)) = self.current.as_ref().map(Mutex::lock) else {
            return;
        };
        if guard.of != Some((structure, stage)) {
            guard.bar.finish();
            guard.of = Some((structure, stage));
            guard.bar = new_bar(structure, structures, stage);
        }
        #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "clamped to the steps of the bar")]
        guard.bar.set_position((fraction.clamp(0.0, 1.0) * f64::from(BAR_STEPS)) as u64);
    }
}

fn new_bar(structure: usize, structures: usize, stage: Stage) -> ProgressBar {
    let bar = ProgressBar::new(u64::from(BAR_STEPS));
    if let Ok(style) = ProgressStyle::with_template("{prefix:>9} {msg:9} {wide_bar} {percent:>3} % {elapsed:>4}") {
        bar.set_style(style);
    }
    bar.set_message(stage.name());
    if structures > 1 {
        bar.set_prefix(format!("{} of {structures}", structure + 1));
    }
    bar
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::formats::ReadError;
    use crate::model::Refusal;

    #[test]
    fn exit_codes_follow_the_contract() {
        let label = Refusal::LabelMissing { label: 3, present: vec![1] };
        for (problem, code) in [
            (*read_params("{\"x\": 1}").unwrap_err(), 2),
            (*read_params("{").unwrap_err(), 2),
            (*read_params("@/nowhere/at/all").unwrap_err(), 2),
            (Problem::from(&ReadError::BadChecksum), 3),
            (Problem::from(&Refusal::EmptyMask), 3),
            (Problem::from(&label), 3),
            (Problem::from(&Refusal::TooSmall { points: 1, needed: 9 }), 4),
            (Problem::from(&Refusal::TooManyPoints { points: 20_000, limit: 10_000 }), 4),
            (Problem::internal(), 1),
        ] {
            assert_eq!(exit_code(&problem), code, "{}", problem.code);
        }
    }

    #[test]
    fn a_refusal_is_one_sentence_with_place_and_advice() {
        let problem = Problem::from(&ReadError::SeveralVolumes { axis: 4, count: 12 });
        assert_eq!(
            sentence(&problem),
            "the file holds 12 volumes along dimension 4, one is needed (at header.dim[4]); send one volume: \
             split the series and send the one with the mask [several_volumes]"
        );
    }
}
