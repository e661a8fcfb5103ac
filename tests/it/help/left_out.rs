//! What a test leaves out, in words that can be counted.

use std::io::Write;
use std::panic::Location;

/// Names a file to append to, so that `make test` can count: cargo hides what passing tests print.
const FILE: &str = "MEDIALREP_LEFT_OUT";

/// Says that the calling test leaves itself or a part of itself out, and why, in one line.
///
/// The test's name is that of its thread; where all tests run on the main thread, the caller's place.
#[track_caller]
pub fn left_out(why: &str) {
    let place = Location::caller();
    let thread = std::thread::current();
    let test = match thread.name() {
        Some(name) if name != "main" => name.to_owned(),
        _ => format!("{}:{}", place.file(), place.line()),
    };
    let line = format!("left out: {test}: {why}\n");
    print!("{line}");
    if let Some(file) = std::env::var_os(FILE) {
        let mut file = std::fs::OpenOptions::new().create(true).append(true).open(file).unwrap();
        file.write_all(line.as_bytes()).unwrap();
    }
}
