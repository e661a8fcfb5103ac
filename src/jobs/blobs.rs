//! Files of jobs: masks as they were sent, and results.
//!
//! ```text
//! incoming/…                 uploads under way
//! masks/{job}                one per job
//! results/{job}/{token}/…    one folder per attempt, named by its lease token
//! db/…                       the store's, when it is a file
//! ```
//!
//! Plain files and no object store: the pipeline reads and writes local paths anyway, and an
//! upload must be hashed, synced and named in this order. All calls block.

use std::collections::BTreeMap;
use std::fs::{self, DirBuilder, File};
use std::io::{self, Write};
use std::os::unix::fs::DirBuilderExt;
use std::path::{Path, PathBuf};

use tempfile::{NamedTempFile, TempPath};

use super::job::JobId;

const INCOMING: &str = "incoming";
const MASKS: &str = "masks";
const RESULTS: &str = "results";
const DATABASE: &str = "db";

/// The files of all jobs under one folder.
#[derive(Clone, Debug)]
pub struct Blobs {
    root: PathBuf,
}

impl Blobs {
    /// Makes the folders that are missing, readable by nobody else: masks are patient data.
    ///
    /// # Errors
    /// When a folder cannot be made.
    pub fn open(root: &Path) -> io::Result<Self> {
        for folder in ["", INCOMING, MASKS, RESULTS, DATABASE] {
            DirBuilder::new().recursive(true).mode(0o700).create(root.join(folder))?;
        }
        Ok(Self { root: root.to_owned() })
    }

    /// Where a store that is a file lies.
    #[must_use]
    pub fn database_path(&self) -> PathBuf {
        self.root.join(DATABASE).join("jobs.sqlite")
    }

    /// A file for an upload; it vanishes when dropped.
    ///
    /// # Errors
    /// When it cannot be made.
    pub fn begin_upload(&self) -> io::Result<NamedTempFile> {
        NamedTempFile::new_in(self.root.join(INCOMING))
    }

    /// Keeps an upload, whose content must be synced, as the mask of a job. Durable on return.
    ///
    /// # Errors
    /// When it cannot be renamed or synced.
    pub fn keep_mask(&self, upload: TempPath, id: JobId) -> io::Result<()> {
        upload.persist(self.mask_path(id)).map_err(|failed| failed.error)?;
        sync_folder(&self.root.join(MASKS))
    }

    /// Where the mask of a job lies.
    #[must_use]
    pub fn mask_path(&self, id: JobId) -> PathBuf {
        self.root.join(MASKS).join(id.to_string())
    }

    /// Makes the empty folder of an attempt.
    ///
    /// # Errors
    /// When it cannot be made.
    pub fn begin_attempt(&self, id: JobId, token: &str) -> io::Result<PathBuf> {
        let folder = self.attempt_folder(id, token);
        DirBuilder::new().recursive(true).mode(0o700).create(&folder)?;
        Ok(folder)
    }

    /// Makes the files of an attempt durable; the row may name them afterwards.
    ///
    /// # Errors
    /// When a file cannot be synced.
    pub fn sync_attempt(&self, id: JobId, token: &str) -> io::Result<()> {
        let folder = self.attempt_folder(id, token);
        for entry in fs::read_dir(&folder)? {
            File::open(entry?.path())?.sync_all()?;
        }
        sync_folder(&folder)?;
        sync_folder(&self.job_folder(id))?;
        sync_folder(&self.root.join(RESULTS))
    }

    /// Where a file of an attempt lies.
    #[must_use]
    pub fn result_path(&self, id: JobId, token: &str, name: &str) -> PathBuf {
        self.attempt_folder(id, token).join(name)
    }

    /// Removes what an attempt left.
    ///
    /// # Errors
    /// When it cannot be removed.
    pub fn erase_attempt(&self, id: JobId, token: &str) -> io::Result<()> {
        gone(fs::remove_dir_all(self.attempt_folder(id, token)))?;
        // Another attempt may be in the same folder: then it stays.
        let _ = fs::remove_dir(self.job_folder(id));
        Ok(())
    }

    /// Removes the mask and all results of a job.
    ///
    /// # Errors
    /// When something cannot be removed.
    pub fn erase(&self, id: JobId) -> io::Result<()> {
        gone(fs::remove_file(self.mask_path(id)))?;
        gone(fs::remove_dir_all(self.job_folder(id)))?;
        sync_folder(&self.root.join(MASKS))?;
        sync_folder(&self.root.join(RESULTS))
    }

    /// Removes everything that `kept` does not name: uploads cut short, attempts that were never
    /// published, files of jobs that are gone. Only while nothing else uses the folder. Says how
    /// many entries went.
    ///
    /// # Errors
    /// When something cannot be listed or removed.
    pub fn sweep(&self, kept: &BTreeMap<String, Option<String>>) -> io::Result<usize> {
        let mut swept = sweep_folder(&self.root.join(INCOMING), |_| false)?;
        swept += sweep_folder(&self.root.join(MASKS), |name| kept.contains_key(name))?;
        swept += sweep_folder(&self.root.join(RESULTS), |name| kept.contains_key(name))?;
        for (job, published) in kept {
            let folder = self.root.join(RESULTS).join(job);
            if folder.is_dir() {
                swept += sweep_folder(&folder, |name| published.as_deref() == Some(name))?;
            }
        }
        Ok(swept)
    }

    /// Fails unless a file can be written.
    ///
    /// # Errors
    /// When it cannot.
    pub fn check_writable(&self) -> io::Result<()> {
        let mut file = self.begin_upload()?;
        file.write_all(b"ready")?;
        file.as_file().sync_all()
    }

    fn job_folder(&self, id: JobId) -> PathBuf {
        self.root.join(RESULTS).join(id.to_string())
    }

    fn attempt_folder(&self, id: JobId, token: &str) -> PathBuf {
        self.job_folder(id).join(token)
    }
}

fn sweep_folder(folder: &Path, is_kept: impl Fn(&str) -> bool) -> io::Result<usize> {
    let mut swept = 0;
    for entry in fs::read_dir(folder)? {
        let entry = entry?;
        if entry.file_name().to_str().is_some_and(&is_kept) {
            continue;
        }
        if entry.file_type()?.is_dir() {
            fs::remove_dir_all(entry.path())?;
        } else {
            fs::remove_file(entry.path())?;
        }
        swept += 1;
    }
    Ok(swept)
}

/// A new name in a folder is on disk only once the folder is.
fn sync_folder(folder: &Path) -> io::Result<()> {
    File::open(folder)?.sync_all()
}

/// What is not there is as good as removed.
fn gone(removed: io::Result<()>) -> io::Result<()> {
    match removed {
        Err(error) if error.kind() == io::ErrorKind::NotFound => Ok(()),
        other => other,
    }
}
