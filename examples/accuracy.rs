//! Measures how accurate the program is on shapes whose medial sheets are known, and writes the figures to
//! `docs/accuracy.json`, which a test holds.
//!
//! ```sh
//! cargo run --release --example accuracy               # measures and writes, about a minute (make accuracy)
//! cargo run --release --example accuracy -- --table    # what the file says, as tables in Markdown
//! cargo run --release --example accuracy -- --verdict  # what each verdict is worth (make verdict)
//! ```

#![allow(clippy::print_stdout, clippy::print_stderr, reason = "a program for the command line")]

#[allow(dead_code, reason = "what draws the figures of the paper is in the same module")]
#[path = "../tests/measure/mod.rs"]
mod measure;

use std::error::Error;
use std::path::Path;

use measure::accuracy::measured;
use measure::damage::{rows, to_markdown};
use measure::shapes::SHAPES;
use measure::table::{FILE, Table};

fn main() -> Result<(), Box<dyn Error>> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    match arguments.iter().map(String::as_str).collect::<Vec<_>>()[..] {
        [] => write(root),
        ["--table"] => print(root),
        ["--verdict"] => {
            println!("{}", to_markdown(&rows()));
            Ok(())
        }
        _ => Err("usage: accuracy [--table | --verdict]".into()),
    }
}

/// Measures everything and writes the file.
fn write(root: &Path) -> Result<(), Box<dyn Error>> {
    let mut rows = Vec::new();
    for shape in &SHAPES {
        eprintln!("{}", shape.sample);
        rows.push(measured(shape));
    }
    std::fs::write(root.join(FILE), Table(rows).to_text())?;
    Ok(())
}

/// Prints what the file says.
fn print(root: &Path) -> Result<(), Box<dyn Error>> {
    let table = Table::read(root).map_err(|error| format!("{FILE}: {error}; write it with make accuracy"))?;
    println!("{}", table.to_markdown());
    Ok(())
}
