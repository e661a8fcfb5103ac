//! Builds the program again when the page was built again: the page is part of it.

#[allow(clippy::print_stdout, reason = "this is how a build script speaks to cargo")]
fn main() {
    println!("cargo:rerun-if-changed=web/dist");
}
