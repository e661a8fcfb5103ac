//! `medialrep backup`: a copy of a data directory while a service works on it. A service started on
//! the copy has the same jobs.

use std::path::{Path, PathBuf};
use std::process::ExitCode;

use anyhow::{Context, ensure};

use crate::jobs::job::Job;
use crate::jobs::make_private;
use crate::jobs::place::Place;
use crate::jobs::store::blobs::Blobs;

/// Arguments of `medialrep backup`.
#[derive(Debug, clap::Args)]
pub struct BackupArgs {
    /// The service's data directory.
    #[arg(long, env = "MEDIALREP_DATA_DIR", default_value = "data", value_name = "DIR")]
    data_dir: PathBuf,

    /// Where the copy goes: a folder that is not there yet or is empty.
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
}

/// Makes the copy.
///
/// # Errors
/// When something cannot be read or written; the copy is not whole then.
pub fn backup(args: &BackupArgs) -> anyhow::Result<ExitCode> {
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build()?;
    runtime.block_on(copy(&args.data_dir, &args.out))?;
    Ok(ExitCode::SUCCESS)
}

/// The database first: what it names afterwards is either still there, or was deleted meanwhile, and
/// then the copy forgets it too.
async fn copy(from: &Path, to: &Path) -> anyhow::Result<()> {
    let (old, new) = (Place::at(from), Place::at(to));
    ensure!(old.is_used(), "there is no database in {old}");
    make_private(to).with_context(|| format!("cannot use {new}"))?;
    ensure!(to.read_dir()?.next().is_none(), "{new} is not empty");
    old.copy_store_to(&new).await.context("cannot copy the database")?;
    let store = new.open_store().await?;
    let (source, target) = (old.blobs()?, new.blobs()?);
    let (mut copied, mut gone) = (0_usize, 0_usize);
    for files in store.kept_files().await? {
        let Some(job) = store.get(files.id).await? else { continue };
        if copy_files(&source, &target, &job).await? {
            copied += 1;
        } else {
            store.delete(job.id).await?;
            gone += 1;
        }
    }
    old.copy_audit_to(&new).context("cannot copy the audit log")?;
    tell(&format!("{copied} jobs copied, {gone} deleted meanwhile"));
    Ok(())
}

/// `false` when one of them is gone: the job was deleted meanwhile.
async fn copy_files(source: &Blobs, target: &Blobs, job: &Job) -> anyhow::Result<bool> {
    if job.is_mask_kept && !source.copy_mask_to(target, job.id).await? {
        return Ok(false);
    }
    if let Some((token, files)) = job.kept_results() {
        for file in files {
            if !source.copy_result_to(target, (job.id, token, &file.name)).await? {
                return Ok(false);
            }
        }
    }
    Ok(true)
}

#[expect(clippy::print_stdout, reason = "says what was done")]
fn tell(text: &str) {
    println!("{text}");
}
