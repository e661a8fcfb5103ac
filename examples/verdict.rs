//! What each verdict is worth: a plate with faults of many sizes, how wrong its thickness comes out, and what the
//! program says. Prints the table of `docs/quality.md`; a test holds that what passes is right.
//!
//! ```sh
//! cargo run --release --no-default-features --example verdict      # make verdict
//! ```

#![allow(clippy::print_stdout, reason = "a program for the command line")]

#[path = "../tests/measure/mod.rs"]
mod measure;

use measure::damage::{rows, to_markdown};

fn main() {
    println!("{}", to_markdown(&rows()));
}
