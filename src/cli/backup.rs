//! `medialrep backup`: a copy of a data directory while a service works on it. A service started on
//! the copy has the same jobs.

use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::sync::Arc;

use anyhow::{Context, ensure};

use crate::jobs::job::Job;
use crate::jobs::make_private;
use crate::jobs::place::Place;
use crate::jobs::store::Store;
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

/// Lies in a copy until it is whole.
pub(super) const UNFINISHED: &str = "unfinished-backup";

/// The database first: what it names afterwards is either still there, or was erased meanwhile, and
/// then the copy forgets it too.
async fn copy(from: &Path, to: &Path) -> anyhow::Result<()> {
    let (old, new) = (Place::at(from), Place::at(to));
    ensure!(old.is_used(), "there is no database in {old}");
    make_private(to).with_context(|| format!("cannot use {new}"))?;
    ensure!(to.read_dir()?.next().is_none(), "{new} is not empty");
    let unfinished = to.join(UNFINISHED);
    std::fs::File::create(&unfinished)?.sync_all()?;
    let source = old.open_store_to_read().await.context("cannot read the database")?;
    old.copy_store_to(&new).await.context("cannot copy the database")?;
    let store = new.open_store().await?;
    let found = store.check_integrity().await?;
    ensure!(found.is_empty(), "the database is damaged, and so is its copy: {}", found.join("; "));
    let copy = Copy { source, store, from: old.blobs()?, to: new.blobs()? };
    let (mut copied, mut gone) = (0_usize, 0_usize);
    for files in copy.store.kept_files().await? {
        let Some(job) = copy.store.get(files.id).await? else { continue };
        if copy.job(&job).await? {
            copied += 1;
        } else {
            copy.store.delete(job.id).await?;
            gone += 1;
        }
    }
    copy.store.close().await;
    old.copy_audit_to(&new).context("cannot copy the audit log")?;
    std::fs::remove_file(unfinished)?;
    tell(&format!("{copied} jobs copied, {gone} deleted meanwhile"));
    Ok(())
}

/// A data directory and its copy.
struct Copy {
    source: Arc<dyn Store>,
    store: Arc<dyn Store>,
    from: Blobs,
    to: Blobs,
}

impl Copy {
    /// Copies the files of a job; of what was erased meanwhile, that it was. `false` when the job was deleted.
    async fn job(&self, job: &Job) -> anyhow::Result<bool> {
        if job.is_mask_kept && !self.from.copy_mask_to(&self.to, job.id).await? {
            let Some(now) = self.source.get(job.id).await? else { return Ok(false) };
            ensure!(!now.is_mask_kept, "the mask of {} is missing", job.id);
            self.store.forget_mask(job.id).await?;
        }
        let Some((token, files)) = job.kept_results() else { return Ok(true) };
        for file in files {
            if self.from.copy_result_to(&self.to, (job.id, token, &file.name)).await? {
                continue;
            }
            let Some(now) = self.source.get(job.id).await? else { return Ok(false) };
            ensure!(!now.are_results_kept, "{} of {} is missing", file.name, job.id);
            self.store.forget_results(job.id).await?;
            self.to.erase_results(job.id).await?;
            break;
        }
        Ok(true)
    }
}

#[expect(clippy::print_stdout, reason = "says what was done")]
fn tell(text: &str) {
    println!("{text}");
}
