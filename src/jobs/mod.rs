//! Jobs: what is done with a mask, and the durable queue of what is still to be done.
//!
//! ```text
//! upload ──► submission ──► blobs (mask) ──► store (row, queued) ──► worker: claim ► process ► finish
//!                                                 ▲                      │ files of the attempt, then the row
//!                                                 └── lease ran out, process gone, server stopped: queued again
//! ```
//!
//! Beside the workers: `beat` keeps leases and sees whose worker is gone, `retention` erases
//! what is old, `callbacks` sends webhooks. Several processes may share one data directory.
//!
//! Knows no HTTP. The row is the truth: a file that no row names does not exist for anybody, and
//! is swept.

use std::fs::DirBuilder;
use std::io;
use std::os::unix::fs::DirBuilderExt;
use std::path::{Path, PathBuf};

pub mod process;

pub mod job;

pub mod expected;

pub mod caller;

pub mod token;

pub mod store;

pub mod sqlite;

pub mod blobs;

pub mod instance;

pub mod upload;

pub mod changes;

mod running;

pub mod queue;

pub mod submission;

pub mod worker;

mod beat;

mod retention;

mod callbacks;

/// Makes a folder that only its owner may enter.
///
/// # Errors
/// When it cannot be made.
pub fn make_private(folder: &Path) -> io::Result<()> {
    DirBuilder::new().recursive(true).mode(0o700).create(folder)
}

/// Where the audit log of a data directory lies.
#[must_use]
pub fn audit_path(data_dir: &Path) -> PathBuf {
    data_dir.join("audit").join("audit.jsonl")
}
