//! `medialrep check`: whether a service can run as it is set up, and whether what it keeps is whole.
//! Changes nothing: an older database is told, not brought up to date; a service may run beside it.

use std::fs;
use std::os::unix::fs::MetadataExt;
use std::path::Path;
use std::process::ExitCode;

use anyhow::{Context, anyhow, bail, ensure};

use super::backup::UNFINISHED;
use super::exit;
use super::serve::ServeArgs;
use crate::config::ServeConfig;
use crate::jobs::job::Job;
use crate::jobs::place::Place;
use crate::jobs::store::blobs::{Blobs, lost_jobs, without_kept};
use crate::jobs::store::{Store, StoreError};

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
    fn tell(&mut self, what: &str, found: anyhow::Result<String>) {
        match found {
            Ok(text) => println!("ok    {what}: {text}"),
            Err(error) => {
                self.bad += 1;
                println!("BAD   {what}: {error:#}");
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
    let config = match args.serve.config() {
        Ok(config) => config,
        Err(error) => {
            findings.tell("settings", Err(error));
            return Ok(ExitCode::from(exit::USAGE));
        }
    };
    findings.tell("settings", Ok("in order".to_owned()));
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build()?;
    runtime.block_on(check_all(args, &config, &mut findings));
    Ok(if findings.bad == 0 { ExitCode::SUCCESS } else { ExitCode::from(exit::INTERNAL) })
}

async fn check_all(args: &CheckArgs, config: &ServeConfig, findings: &mut Findings) {
    let place = Place::at(&config.data_dir);
    findings.tell("data directory", check_folder(&config.data_dir));
    if !config.data_dir.is_dir() {
        return;
    }
    findings.tell("disk", check_disk(&place, config.jobs.min_free_bytes));
    if config.data_dir.join(UNFINISHED).exists() {
        findings.tell("copy", Err(anyhow!("this is a backup that was not finished: make another")));
    }
    if !place.is_used() {
        let found = match place.holds_files() {
            Ok(false) => Ok("none yet; the first start makes it".to_owned()),
            Ok(true) => Err(StoreError::Lost.into()),
            Err(error) => Err(error.into()),
        };
        return findings.tell("database", found);
    }
    let store = match place.open_store_to_read().await {
        Ok(store) => store,
        Err(error) => return findings.tell("database", Err(error.into())),
    };
    findings.tell("database", check_database(&*store).await);
    findings.tell("access", check_access(&args.serve, store.has_tokens().await.unwrap_or(false)));
    findings.tell("files", check_files(&*store, &place).await);
    findings.tell("rows", check_rows(&*store, &place).await);
    findings.tell("audit log", check_audit(&*store, &place).await);
}

fn check_folder(dir: &Path) -> anyhow::Result<String> {
    let name = dir.display().to_string();
    let about = fs::metadata(dir).with_context(|| name.clone())?;
    ensure!(about.is_dir(), "{name} is no folder");
    ensure!(about.mode() & 0o077 == 0, "{name} can be entered by others: chmod 700");
    let probe = tempfile::NamedTempFile::new_in(dir).and_then(|file| file.as_file().sync_all());
    probe.with_context(|| format!("{name} cannot be written"))?;
    Ok(name)
}

fn check_disk(place: &Place, min_free: u64) -> anyhow::Result<String> {
    let room = place.room()?;
    let (free, files) = (room.free_bytes >> 20, 100.0 * room.free_files);
    let told = format!("{free} MiB and {files:.0} % of its files free, masks are refused below {} MiB", min_free >> 20);
    ensure!(room.has(min_free), told);
    Ok(told)
}

async fn check_database(store: &dyn Store) -> anyhow::Result<String> {
    let found = store.check_integrity().await?;
    ensure!(found.is_empty(), found.join("; "));
    Ok("integrity check passed".to_owned())
}

fn check_access(args: &ServeArgs, has_tokens: bool) -> anyhow::Result<String> {
    if let Some(told) = args.open_to_strangers(has_tokens) {
        bail!(told);
    }
    let access =
        if has_tokens { "tokens are asked for" } else { "no tokens: everybody who reaches the port is let in" };
    Ok(access.to_owned())
}

/// Every file that a row names is there and is what was stored.
async fn check_files(store: &dyn Store, place: &Place) -> anyhow::Result<String> {
    let blobs = place.blobs()?;
    let (mut checked, mut bad) = (0_usize, Vec::new());
    for files in store.kept_files().await? {
        let Some(job) = store.get(files.id).await? else { continue };
        let damaged = damaged_files(&blobs, &job).await;
        // Deleted while it was looked at.
        if damaged.is_empty() || matches!(store.get(files.id).await, Ok(Some(now)) if now.state == job.state) {
            bad.extend(damaged);
        }
        checked += 1;
    }
    if let Some(first) = bad.first() {
        bail!("{} missing or damaged, the first {first}", bad.len());
    }
    Ok(format!("those of {checked} jobs are what was stored"))
}

/// No file is of a job that the audit log has and the database has not.
async fn check_rows(store: &dyn Store, place: &Place) -> anyhow::Result<String> {
    let found = place.blobs()?.stored().await?;
    let kept = store.kept_files().await?;
    let erased = store.erased_jobs().await?;
    let lost = lost_jobs(&found, (&kept, &erased), &place.jobs_by_audit()?);
    let unnamed = without_kept(found, kept);
    if let Some(first) = lost.first() {
        bail!(
            "{} jobs are in the audit log, their files are here, and the database has not got them, the first {first}: it \
             may have lost its last changes, or be an earlier one",
            lost.len()
        );
    }
    let told = if unnamed.is_empty() { String::new() } else { format!("; {} files are to be swept", unnamed.len()) };
    Ok(format!("all jobs of the audit log whose files are here{told}"))
}

async fn damaged_files(blobs: &Blobs, job: &Job) -> Vec<String> {
    let mut bad = Vec::new();
    if job.is_mask_kept && !blobs.is_mask_whole(job).await {
        bad.push(format!("mask of {}", job.id));
    }
    if let Some((token, files)) = job.kept_results() {
        for file in files {
            if !matches!(blobs.read_checked(job.id, token, file).await, Ok(Some(_))) {
                bad.push(format!("{} of {}", file.name, job.id));
            }
        }
    }
    bad
}

async fn check_audit(store: &dyn Store, place: &Place) -> anyhow::Result<String> {
    let found = match store.audit_marks().await? {
        Some(known) => Some(place.verify_audit_with(&known)?),
        None => place.verify_audit()?,
    };
    let Some(found) = found else { return Ok("none yet".to_owned()) };
    Ok(format!("{} entries, {} torn, last hash {}", found.entries, found.torn, found.last_hash))
}
