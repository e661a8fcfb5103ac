//! `medialrep check`: whether a service can run as it is set up, and whether what it keeps is whole.
//! Reads only; a service may run beside it.

use std::os::unix::fs::MetadataExt;
use std::path::Path;
use std::process::ExitCode;

use super::exit;
use super::serve::ServeArgs;
use crate::audit;
use crate::config::ServeConfig;
use crate::jobs::audit_path;
use crate::jobs::job::{Job, JobState};
use crate::jobs::store::blobs::{Blobs, free_bytes};
use crate::jobs::store::sqlite::SqliteStore;
use crate::jobs::store::{JobStore, RetentionStore, TokenStore};

/// Arguments of `medialrep check`: those of `serve`, which are checked too.
#[derive(Debug, clap::Args)]
pub struct CheckArgs {
    #[command(flatten)]
    serve: ServeArgs,
}

/// What was found.
#[derive(Default)]
struct Findings {
    bad: usize,
}

impl Findings {
    #[expect(clippy::print_stdout, reason = "this is what was asked for")]
    fn tell(&mut self, what: &str, found: Result<String, String>) {
        match found {
            Ok(text) => println!("ok    {what}: {text}"),
            Err(text) => {
                self.bad += 1;
                println!("BAD   {what}: {text}");
            }
        }
    }
}

/// Checks everything; exit 0 when all is well, 1 when something is not, 2 when the settings are wrong.
///
/// # Errors
/// When the runtime cannot start.
pub fn check(args: &CheckArgs) -> anyhow::Result<ExitCode> {
    let mut findings = Findings::default();
    let config = args.serve.config();
    findings.tell("settings", config.as_ref().map(|_| "in order".to_owned()).map_err(|error| format!("{error:#}")));
    let Ok(config) = config else { return Ok(ExitCode::from(exit::USAGE)) };
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build()?;
    runtime.block_on(check_all(args, &config, &mut findings));
    Ok(if findings.bad == 0 { ExitCode::SUCCESS } else { ExitCode::from(exit::INTERNAL) })
}

async fn check_all(args: &CheckArgs, config: &ServeConfig, findings: &mut Findings) {
    let dir = &config.data_dir;
    findings.tell("data directory", check_folder(dir));
    if !dir.is_dir() {
        return;
    }
    findings.tell("disk", check_disk(dir, config.jobs.min_free_bytes));
    let database = Blobs::database_path(dir);
    if !database.exists() {
        findings.tell("database", Ok("none yet; the first start makes it".to_owned()));
        return;
    }
    let store = match SqliteStore::open(&database).await {
        Ok(store) => store,
        Err(error) => return findings.tell("database", Err(error.to_string())),
    };
    findings.tell("database", check_database(&store).await);
    let has_tokens = store.has_tokens().await.unwrap_or(false);
    let access =
        if has_tokens { "tokens are asked for" } else { "no tokens: everybody who reaches the port is let in" };
    findings.tell("access", args.serve.open_to_strangers(has_tokens).map_or(Ok(access.to_owned()), Err));
    findings.tell("files", check_files(&store, dir).await);
    findings.tell("audit log", check_audit(dir));
}

fn check_folder(dir: &Path) -> Result<String, String> {
    let about = std::fs::metadata(dir).map_err(|error| format!("{}: {error}", dir.display()))?;
    if !about.is_dir() {
        return Err(format!("{} is no folder", dir.display()));
    }
    if about.mode() & 0o077 != 0 {
        return Err(format!("{} can be entered by others: chmod 700", dir.display()));
    }
    let probe = tempfile::NamedTempFile::new_in(dir).and_then(|file| file.as_file().sync_all());
    probe.map_err(|error| format!("{} cannot be written: {error}", dir.display()))?;
    Ok(dir.display().to_string())
}

fn check_disk(dir: &Path, min_free: u64) -> Result<String, String> {
    let free = free_bytes(dir).map_err(|error| error.to_string())?;
    let told = format!("{} MiB free, masks are refused below {} MiB", free >> 20, min_free >> 20);
    if free < min_free { Err(told) } else { Ok(told) }
}

async fn check_database(store: &SqliteStore) -> Result<String, String> {
    let found = store.check_integrity().await.map_err(|error| error.to_string())?;
    if found.is_empty() { Ok("integrity check passed".to_owned()) } else { Err(found.join("; ")) }
}

/// Every file that a row names is there and is what was stored.
async fn check_files(store: &SqliteStore, dir: &Path) -> Result<String, String> {
    let kept = store.kept_files().await.map_err(|error| error.to_string())?;
    let blobs = Blobs::beside(dir).map_err(|error| error.to_string())?;
    let (mut checked, mut bad) = (0_usize, Vec::new());
    for files in kept {
        let Some(job) = store.get(files.id).await.map_err(|error| error.to_string())? else { continue };
        let damaged = damaged_files(&blobs, &job).await;
        // Deleted while it was looked at.
        if damaged.is_empty() || matches!(store.get(files.id).await, Ok(Some(now)) if now.state == job.state) {
            bad.extend(damaged);
        }
        checked += 1;
    }
    match bad.as_slice() {
        [] => Ok(format!("those of {checked} jobs are what was stored")),
        [first, ..] => Err(format!("{} missing or damaged, the first {first}", bad.len())),
    }
}

async fn damaged_files(blobs: &Blobs, job: &Job) -> Vec<String> {
    let mut bad = Vec::new();
    if job.is_mask_kept && !blobs.is_mask_whole(job).await {
        bad.push(format!("mask of {}", job.id));
    }
    if let (JobState::Succeeded, true, Some(token)) = (job.state, job.are_results_kept, &job.results_token) {
        for file in &job.results {
            if !matches!(blobs.read_checked(job.id, token, file).await, Ok(Some(_))) {
                bad.push(format!("{} of {}", file.name, job.id));
            }
        }
    }
    bad
}

fn check_audit(dir: &Path) -> Result<String, String> {
    let path = audit_path(dir);
    if !path.exists() {
        return Ok("none yet".to_owned());
    }
    let found = audit::verify(&path).map_err(|error| error.to_string())?;
    Ok(format!("{} entries, {} torn, last hash {}", found.entries, found.torn, found.last_hash))
}
