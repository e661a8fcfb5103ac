//! Jobs: what is done with a mask, and the durable queue of what is still to be done.
//!
//! ```text
//! upload ──► submission ──► blobs (mask) ──► store (row, queued) ──► worker: claim ► process ► finish
//!                                                 ▲                      │ files of the attempt, then the row
//!                                                 └── lease ran out, process gone, server stopped: queued again
//! ```
//!
//! Beside the workers: `leases` keeps leases and sees whose worker is gone, `retention` erases
//! what is old, `callbacks` sends webhooks; `results` makes files on request from the record of a job. Several processes may share one data directory.
//!
//! The row is the truth: a file that no row names does not exist for anybody, and is swept. A row
//! moves from state to state as the table in [`moves`] says and in no other way. [`place`] says where
//! rows and files lie; nothing else names a database.
//!
//! Knows no request and no web framework. What clients see goes through here in two forms: a job
//! that failed is kept with its problem object ([`crate::problem`], whose status is one of HTTP), and
//! types that they see as they are derive their description.

use std::fs::DirBuilder;
use std::io;
use std::os::unix::fs::DirBuilderExt;
use std::path::Path;

mod drafts;

pub mod processed;

pub mod process;

pub mod job;

pub mod moves;

pub mod expected;

pub mod caller;

pub mod token;

pub(crate) mod blocking;

pub mod store;

pub mod place;

pub mod upload;

pub mod limits;

pub mod error;

pub mod changes;

mod running;

pub mod service;

pub mod results;

pub mod objects;

mod upkeep;

mod storage_health;

pub mod submission;

pub mod source;

pub mod worker;

mod leases;

mod clock;

mod retention;

mod callbacks;

mod deliveries;

pub mod audit_marks;

/// Makes a folder that only its owner may enter.
///
/// # Errors
/// When it cannot be made.
pub fn make_private(folder: &Path) -> io::Result<()> {
    DirBuilder::new().recursive(true).mode(0o700).create(folder)
}
