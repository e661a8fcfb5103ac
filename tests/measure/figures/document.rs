//! The document: its words are written by hand, its tables between marks by the program.

use std::path::Path;

/// The document, from the root of the repository.
pub const FILE: &str = "docs/paper.md";
/// The folder of its pictures.
pub const PICTURES: &str = "docs/paper";

/// The begin of the part that is written for a figure.
fn begin(slug: &str) -> String {
    format!("<!-- {slug}: written by `make paper` -->\n")
}

/// The end of each part.
const END: &str = "<!-- end -->";

/// What the document has for a figure; `None` without its marks.
pub fn part<'a>(document: &'a str, slug: &str) -> Option<&'a str> {
    let (_, rest) = document.split_once(&begin(slug))?;
    Some(rest.split_once(END)?.0)
}

/// The document with another part for a figure; `None` without its marks.
pub fn with_part(document: &str, slug: &str, part: &str) -> Option<String> {
    let begin = begin(slug);
    let (before, rest) = document.split_once(&begin)?;
    let (_, after) = rest.split_once(END)?;
    Some(format!("{before}{begin}{part}{END}{after}"))
}

/// The document as it is.
///
/// # Errors
/// When it cannot be read.
pub fn read(root: &Path) -> std::io::Result<String> {
    std::fs::read_to_string(root.join(FILE))
}
