//! Where a service keeps what it knows. Servers and the commands beside them open it here, and only
//! here: none of them names a database.

use std::collections::BTreeSet;
use std::fmt;
use std::io;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use super::audit_marks::compare;
use super::make_private;
use super::store::AuditMarks;
use super::store::blobs::{Blobs, Room, room};
use super::store::liveness::Instance;
use super::store::sqlite::SqliteStore;
use super::store::{Store, StoreError};
use crate::audit::{self, Audit, AuditError, Verified};

/// Why it cannot be opened.
#[derive(Debug, thiserror::Error)]
pub enum OpenError {
    /// The directory cannot be used.
    #[error(transparent)]
    Files(#[from] io::Error),
    /// The database cannot be used.
    #[error(transparent)]
    Store(#[from] StoreError),
}

/// A data directory: a folder of this machine that nobody else may enter.
///
/// ```text
/// db/         jobs and tokens
/// masks/      files of jobs
/// results/    files of jobs
/// scratch/    files under way, by server
/// instances/  servers that live
/// audit/      who did what
/// reserve     room for what must work on a full disk
/// ```
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Place {
    folder: PathBuf,
}

impl Place {
    /// The data directory at this path, which may not be there yet. Makes nothing.
    #[must_use]
    pub fn at(folder: &Path) -> Self {
        Self { folder: folder.to_owned() }
    }

    /// Whether anything was kept here yet.
    #[must_use]
    pub fn is_used(&self) -> bool {
        self.database().exists()
    }

    /// Whether there are files of jobs, or entries of an audit log: there must be a database then.
    ///
    /// # Errors
    /// When a folder cannot be read.
    pub fn holds_files(&self) -> io::Result<bool> {
        for name in ["masks", "results"] {
            match self.folder.join(name).read_dir() {
                Ok(mut entries) => {
                    if entries.next().is_some() {
                        return Ok(true);
                    }
                }
                Err(error) if error.kind() == io::ErrorKind::NotFound => {}
                Err(error) => return Err(error),
            }
        }
        Ok(self.audit_log().metadata().is_ok_and(|about| about.len() > 0))
    }

    /// Opens the store, making it when there is none and nothing that it should know, and brings it up to date.
    ///
    /// # Errors
    /// When it cannot be used, was lost, or is of a later version of this program.
    pub async fn open_store(&self) -> Result<Arc<dyn Store>, OpenError> {
        make_private(&self.folder)?;
        make_private(&self.folder.join("db"))?;
        // Asked first: who makes the first database has nothing beside it yet.
        let may_be_new = !self.holds_files()?;
        Ok(Arc::new(SqliteStore::open(&self.database(), may_be_new).await?))
    }

    /// Opens the store to be read, as it is: nothing of it changes.
    ///
    /// # Errors
    /// When it cannot be used, or is of another version of this program.
    pub async fn open_store_to_read(&self) -> Result<Arc<dyn Store>, OpenError> {
        match SqliteStore::open_to_read(&self.database()).await {
            // No start brings up to date what is gone.
            Err(StoreError::Older { found: 0, .. }) if self.holds_files()? => Err(StoreError::Lost.into()),
            opened => Ok(Arc::new(opened?)),
        }
    }

    /// Copies the store as it is now to another place, which has none. Others may write meanwhile.
    ///
    /// # Errors
    /// When one of them cannot be used.
    pub async fn copy_store_to(&self, other: &Self) -> Result<(), OpenError> {
        make_private(&other.folder.join("db"))?;
        Ok(self.open_store_to_read().await?.copy_to(&other.database()).await?)
    }

    /// Begins to take part in the work here: as a server that lives as long as the instance, with the files
    /// of jobs, a folder of its own for what is under way, and the audit log. Blocks.
    ///
    /// # Errors
    /// When a folder cannot be made or written to.
    pub fn begin(&self) -> io::Result<(Instance, Blobs, Audit)> {
        make_private(&self.folder)?;
        let instance = Instance::begin(&self.folder)?;
        let blobs = Blobs::open(&self.folder, instance.id())?;
        Ok((instance, blobs, self.open_audit()?))
    }

    /// The files of jobs, for one who takes no part in the work. Blocks.
    ///
    /// # Errors
    /// When the folder is not there.
    pub fn blobs(&self) -> io::Result<Blobs> {
        Blobs::beside(&self.folder)
    }

    /// Opens the audit log, making it when there is none. Blocks.
    ///
    /// # Errors
    /// When it cannot be read or written.
    pub fn open_audit(&self) -> io::Result<Audit> {
        Audit::open(&self.audit_log())
    }

    /// Jobs that by the audit log were taken in and not removed. Blocks.
    ///
    /// # Errors
    /// When the log cannot be read.
    pub fn jobs_by_audit(&self) -> io::Result<BTreeSet<String>> {
        audit::jobs_left(&self.audit_log())
    }

    /// Follows the chain of the audit log; `None` when there is no log yet. Blocks.
    ///
    /// # Errors
    /// When the chain does not hold.
    pub fn verify_audit(&self) -> Result<Option<Verified>, AuditError> {
        let log = self.audit_log();
        if log.exists() { audit::verify(&log).map(Some) } else { Ok(None) }
    }

    /// The same, and that it is the log that the database remembers. Blocks.
    ///
    /// # Errors
    /// When the chain does not hold, or something is missing.
    pub fn verify_audit_with(&self, known: &AuditMarks) -> Result<Verified, AuditError> {
        let log = self.audit_log();
        if !log.exists() {
            return Err(AuditError::NotTheKnown(format!("it is missing, and had {} entries", known.tip.seq)));
        }
        let (verified, hash) = audit::verify_with(&log, known.tip.seq)?;
        compare(Some(known), &audit::ends_of(&log, &verified)?).map_err(AuditError::NotTheKnown)?;
        // An entry that is in a file before this one cannot be looked at.
        if known.tip.seq >= verified.first_seq && hash.as_ref() != Some(&known.tip.hash) {
            return Err(AuditError::NotTheKnown(format!("its entry {} is another one", known.tip.seq)));
        }
        Ok(verified)
    }

    /// Copies the audit log, if there is one, to another place. Blocks.
    ///
    /// # Errors
    /// When it cannot be read or written.
    pub fn copy_audit_to(&self, other: &Self) -> io::Result<()> {
        let log = self.audit_log();
        if log.exists() {
            make_private(&other.folder.join("audit"))?;
            std::fs::copy(&log, other.audit_log())?;
        }
        Ok(())
    }

    /// Room left for files, bytes.
    ///
    /// # Errors
    /// When the file system does not say.
    pub fn room(&self) -> io::Result<Room> {
        room(&self.folder)
    }

    fn database(&self) -> PathBuf {
        self.folder.join("db").join("jobs.sqlite")
    }

    fn audit_log(&self) -> PathBuf {
        self.folder.join("audit").join("audit.jsonl")
    }
}

impl fmt::Display for Place {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.folder.display().fmt(f)
    }
}
