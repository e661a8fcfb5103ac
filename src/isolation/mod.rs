//! Runs in processes of their own, so that one that takes more memory or time than it may, or crashes, takes nothing else down.
//!
//! ```text
//! this process                               a child (`medialrep isolated`), one per job under way
//!   Isolation::process ── Request ──► stdin    child::main: reads, computes, writes the files
//!        ▲                                        │
//!        └──────── Told: progress, time, outcome ─┘ stdout
//! ```
//!
//! A child runs one job after the other. It is killed when its job is to stop, and ends by itself when its stdin does: with
//! the process that started it. What it may take says [`budget`]: a share of the memory that all have together, which the
//! system holds it to, and processor time that follows the size of the file.

pub mod budget;

pub mod child;

mod slots;

mod wire;

pub use self::slots::{ARGUMENT, Isolation, IsolationLimits};
