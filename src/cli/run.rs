//! `medialrep run`: masks, no service.

use std::io::{self, ErrorKind, IsTerminal, Write};
use std::path::{Path, PathBuf};
use std::process::ExitCode;

use anyhow::Context;
use clap::Args;

use super::bar::Bar;
use super::mask::{CHECK_PATH, Named, find_masks};
use super::table::{WIDTH, json_lines, table};
use super::{cause, complain, exit};
use crate::formats::params_json;
use crate::isolation::{Isolation, IsolationLimits};
use crate::jobs::process::{InputLimits, Kept, ProcessError};
use crate::jobs::processed::StructureSummary;
use crate::model::SHAPE_CODES;
use crate::params::CheckedParams;
use crate::problem::Problem;

/// Arguments of `run`.
#[derive(Debug, Args)]
pub struct RunArgs {
    /// The mask: a binary or label map, .nii, .nii.gz, .nrrd, .seg.nrrd, .mha or DICOM SEG; or a folder with such files.
    /// Of several masks each has a folder of its own in that for the results, and a refused one holds up no other
    #[arg(required = true, value_name = "MASK")]
    masks: Vec<PathBuf>,
    /// Folder for the results; made when it is not there
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// Parameters as JSON, or @FILE to read them from
    #[arg(long, value_name = "JSON|@FILE", default_value = "{}")]
    params: String,
    /// Threads to work with [default: the cores]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=1024))]
    threads: Option<u16>,
    /// Memory to work with, MiB [default: 70 % of the machine's]
    #[arg(long, value_name = "MIB", value_parser = clap::value_parser!(u64).range(64..=16_777_216))]
    memory: Option<u64>,
    /// Print what became of each structure as JSON lines, and errors as a problem object (RFC 9457)
    #[arg(long)]
    json: bool,
    /// Print nothing but errors
    #[arg(long, short)]
    quiet: bool,
}

/// Processes the masks and tells what became of each structure. The exit code is that of the first mask that was refused.
///
/// # Errors
/// Only for faults of our own; what is wrong with the input ends in an exit code.
pub fn run(arguments: RunArgs) -> anyhow::Result<ExitCode> {
    let (params, masks) = match prepare(&arguments) {
        Ok(prepared) => prepared,
        Err(problem) => return complain_of(&problem, None, &arguments),
    };
    let defaults = IsolationLimits::default();
    let isolation = Isolation::new(IsolationLimits {
        memory_bytes: arguments.memory.map_or(defaults.memory_bytes, |mib| mib << 20),
        threads: arguments.threads,
        ..defaults
    });
    let mut first_refused = None;
    for mask in &masks {
        // Alone, its results lie in the folder that was named.
        let name = (masks.len() > 1).then_some(mask.name.as_str());
        let out = name.map_or_else(|| arguments.out.clone(), |name| arguments.out.join(name));
        match process(&isolation, &mask.file, &params, &out, &arguments) {
            Ok(structures) => tell(&structures, name, &arguments)?,
            Err(problem) => {
                let code = complain_of(&problem, name, &arguments)?;
                first_refused = first_refused.or(Some(code));
            }
        }
    }
    Ok(first_refused.unwrap_or(ExitCode::SUCCESS))
}

/// All that can be wrong before the first mask is processed.
fn prepare(arguments: &RunArgs) -> Result<(CheckedParams, Vec<Named>), Box<Problem>> {
    let params = read_params(&arguments.params)?;
    let masks = find_masks(&arguments.masks)?;
    check_folder(&arguments.out)?;
    Ok((params, masks))
}

fn process(
    isolation: &Isolation,
    mask: &Path,
    params: &CheckedParams,
    out: &Path,
    arguments: &RunArgs,
) -> Result<Vec<StructureSummary>, Box<Problem>> {
    check_folder(out)?;
    let bar = if arguments.quiet || !io::stderr().is_terminal() { Bar::hidden() } else { Bar::on_stderr() };
    let outcome = isolation.process(mask, params, InputLimits::default(), (out, Kept::Artifacts), &bar);
    bar.clear();
    outcome.map(|processed| processed.structures).map_err(|error| failed(error, out))
}

/// Says what is wrong, with which mask where there are several.
fn complain_of(problem: &Problem, name: Option<&str>, arguments: &RunArgs) -> anyhow::Result<ExitCode> {
    if arguments.json {
        print_problem(problem, name)?;
    } else {
        let of = name.map_or_else(String::new, |name| format!("{name}: "));
        complain(&format!("{of}{}", sentence(problem)));
    }
    Ok(ExitCode::from(exit_code(problem)))
}

fn read_params(argument: &str) -> Result<CheckedParams, Box<Problem>> {
    let text = match argument.strip_prefix('@') {
        None => argument.as_bytes().to_vec(),
        Some(path) => std::fs::read(path).map_err(|error| {
            let detail = format!("cannot read the parameters in {path}: {}", cause(&error));
            usage("cannot_open_params", detail, "--params", CHECK_PATH)
        })?,
    };
    let problem = match params_json::parse(&text) {
        Ok(params) => return Ok(params),
        Err(error) => Problem::from(&error),
    };
    let is_path = problem.code == "malformed_params" && Path::new(argument).is_file();
    let hint = format!("write --params @{argument} to read them from that file");
    Err(Box::new(if is_path { problem.hint(hint) } else { problem }))
}

/// A folder, made if need be, that can be written into: found out now, not after the work.
fn check_folder(out: &Path) -> Result<(), Box<Problem>> {
    const ELSEWHERE: &str = "name another folder";
    if out.exists() && !out.is_dir() {
        let detail = format!("{} is a file, a folder for the results is needed", out.display());
        return Err(usage("cannot_make_folder", detail, "--out", ELSEWHERE));
    }
    std::fs::create_dir_all(out).map_err(|error| {
        let detail = format!("cannot make the folder {} for the results: {}", out.display(), cause(&error));
        usage("cannot_make_folder", detail, "--out", ELSEWHERE)
    })?;
    tempfile::NamedTempFile::new_in(out).map(|_| ()).map_err(|error| {
        let detail = format!("cannot write into the folder {}: {}", out.display(), cause(&error));
        usage("cannot_write_folder", detail, "--out", "make it writable, or name another folder")
    })
}

fn usage(code: &str, detail: String, argument: &str, hint: &str) -> Box<Problem> {
    Box::new(Problem::new(400, code, detail).at(argument).hint(hint))
}

fn failed(error: ProcessError, out: &Path) -> Box<Problem> {
    match error {
        ProcessError::Problem(problem) => problem,
        ProcessError::Crashed { how } => {
            Box::new(Problem::new(500, "run_crashed", format!("the run crashed; please report it: {how}")))
        }
        ProcessError::Cancelled => Box::new(Problem::new(500, "cancelled", "the run was stopped")),
        ProcessError::Io { doing, error } => {
            let problem = Problem::of_storage(&error);
            let detail = format!("{doing} failed: {}", cause(&error));
            let hint = format!("look whether the disk of {} is full or at fault", out.display());
            Box::new(Problem { detail, hint: Some(hint), ..problem })
        }
    }
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
    const USAGE_CODES: [&str; 8] = [
        "malformed_params",
        "invalid_params",
        "cannot_open_mask",
        "no_mask_in_folder",
        "too_many_files",
        "cannot_make_folder",
        "cannot_write_folder",
        "cannot_open_params",
    ];
    match problem.code.as_str() {
        _ if problem.status >= 500 => exit::INTERNAL,
        code if USAGE_CODES.contains(&code) => exit::USAGE,
        code if SHAPE_CODES.contains(&code) => exit::SHAPE_REFUSED,
        _ => exit::FILE_REFUSED,
    }
}

#[allow(clippy::print_stderr, reason = "this is the command line")]
fn print_problem(problem: &Problem, mask: Option<&str>) -> anyhow::Result<()> {
    let mut told = serde_json::to_value(problem).context("writing the problem")?;
    if let Some(mask) = mask {
        told["mask"] = mask.into();
    }
    eprintln!("{told}");
    Ok(())
}

/// What became of each structure, on stdout.
fn tell(structures: &[StructureSummary], name: Option<&str>, arguments: &RunArgs) -> anyhow::Result<()> {
    let text = match (arguments.quiet, arguments.json) {
        (true, _) => return Ok(()),
        (false, true) => json_lines(structures, name).context("writing the structures")?,
        (false, false) => {
            let stdout = io::stdout();
            let head = name.map_or_else(String::new, |name| format!("{name}\n"));
            head + &table(structures, width_of(&stdout), stdout.is_terminal() && is_color_wanted())
        }
    };
    match io::stdout().write_all(text.as_bytes()).and_then(|()| io::stdout().flush()) {
        // Whoever reads has read enough.
        Err(error) if error.kind() == ErrorKind::BrokenPipe => Ok(()),
        written => written.context("the results are there, but stdout cannot be written"),
    }
}

/// Columns to use: those of the terminal, if it is a narrow one.
fn width_of(stdout: &io::Stdout) -> usize {
    match rustix::termios::tcgetwinsize(stdout) {
        Ok(size) if size.ws_col > 0 => WIDTH.min(size.ws_col.into()),
        _ => WIDTH,
    }
}

/// See <https://no-color.org>.
fn is_color_wanted() -> bool {
    std::env::var_os("NO_COLOR").is_none_or(|value| value.is_empty())
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
            (
                Problem::from(&Refusal::TooManyPoints { method: "exact ISOMAP".into(), points: 20_000, limit: 10_000 }),
                4,
            ),
            (*find_masks(&["/nowhere/at/all".into()]).unwrap_err(), 2),
            (*check_folder(Path::new("/proc")).unwrap_err(), 2),
            (*check_folder(Path::new("/dev/null")).unwrap_err(), 2),
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
