//! Draws the paper's figures 5, 6 and 7 from solids that stand in for its organs, with its parameters and with the
//! defaults, and writes the pictures to `docs/paper/` and what differs to `docs/paper.md`.
//!
//! ```sh
//! cargo run --release --no-default-features --example paper                   # writes (make paper)
//! cargo run --release --no-default-features --example paper -- --masks DIR    # draws masks of your own to target/paper
//! ```
//!
//! Masks are told by their names: `*thalamus*.nii.gz`, `*caudate*.nii.gz`, `*supraspinatus*.nii.gz`.

#![allow(clippy::print_stdout, reason = "a program for the command line")]

#[allow(dead_code, reason = "what measures accuracy is in the same module")]
#[path = "../tests/measure/mod.rs"]
mod measure;

use std::error::Error;
use std::path::{Path, PathBuf};

use measure::figures::pictures::picture;
use measure::figures::rows::to_markdown;
use measure::figures::{FIGURES, Figure, Pair, document};
use medialrep::cancel::Never;
use medialrep::formats::{InputLimits, read_file};

fn main() -> Result<(), Box<dyn Error>> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    match arguments.iter().map(String::as_str).collect::<Vec<_>>()[..] {
        [] => write(root),
        ["--masks", folder] => draw_masks(Path::new(folder), &root.join("target/paper")),
        _ => Err("usage: paper [--masks DIR]".into()),
    }
}

/// Draws the stand-ins and writes the document.
fn write(root: &Path) -> Result<(), Box<dyn Error>> {
    let mut text = document::read(root).map_err(|error| format!("{}: {error}", document::FILE))?;
    let folder = root.join(document::PICTURES);
    std::fs::create_dir_all(&folder)?;
    for figure in &FIGURES {
        let slug = figure.slug();
        println!("{slug}");
        let pair = Pair::of_stand_in(figure);
        let name = format!("{}, stand-in", figure.subject);
        std::fs::write(folder.join(format!("{slug}.svg")), picture(figure, &name, &pair).to_svg())?;
        text = document::with_part(&text, &slug, &to_markdown(&pair))
            .ok_or_else(|| format!("{} has no marks for {slug}", document::FILE))?;
    }
    std::fs::write(root.join(document::FILE), text)?;
    Ok(())
}

/// Draws masks of what the paper has, and prints their tables.
fn draw_masks(from: &Path, to: &Path) -> Result<(), Box<dyn Error>> {
    std::fs::create_dir_all(to)?;
    for figure in &FIGURES {
        for mask in masks_of(figure, from)? {
            let name = mask.file_name().and_then(|name| name.to_str()).unwrap_or("mask").trim_end_matches(".nii.gz");
            let read = read_file(&mask, InputLimits::default(), &Never)?;
            let pair = Pair::of_mask(figure.joined, &read.volume);
            let file = to.join(format!("{}-{name}.svg", figure.number));
            std::fs::write(&file, picture(figure, name, &pair).to_svg())?;
            println!("figure {}, {name}, {}: {}\n", figure.number, figure.joined_told(), file.display());
            println!("{}", to_markdown(&pair));
        }
    }
    Ok(())
}

/// The masks of a figure's subject in a folder, in the order of their names.
fn masks_of(figure: &Figure, folder: &Path) -> Result<Vec<PathBuf>, Box<dyn Error>> {
    let mut masks = Vec::new();
    for entry in std::fs::read_dir(folder).map_err(|error| format!("{}: {error}", folder.display()))? {
        let path = entry?.path();
        let name = path.file_name().and_then(|name| name.to_str()).unwrap_or_default();
        if name.contains(figure.subject) && name.ends_with(".nii.gz") {
            masks.push(path);
        }
    }
    masks.sort();
    Ok(masks)
}
