//! Jobs: what is done with a mask, and the durable queue of what is still to be done.
//!
//! ```text
//! upload ──► blobs (mask) ──► store (row, queued) ──► worker: claim ► process ► finish
//!                                   ▲                        │ files of the attempt, then the row
//!                                   └── lease ran out, server stopped: back to queued
//! ```
//!
//! Knows no HTTP. The row is the truth: a file that no row names does not exist for anybody, and
//! is swept at the next start.

pub mod process;

pub mod job;

pub mod expected;

pub mod store;

pub mod sqlite;

pub mod blobs;

pub mod upload;

pub mod queue;

pub mod worker;
