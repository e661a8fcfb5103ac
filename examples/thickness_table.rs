//! A table of the thicknesses in a thickness.json:
//!
//! ```sh
//! cargo run --no-default-features --example thickness_table -- results/thickness.json
//! ```

#![allow(clippy::print_stdout, reason = "a program for the command line")]

use std::error::Error;

use medialrep::formats::write::thickness::{Document, FigureDoc, LengthDoc, Number};

fn main() -> Result<(), Box<dyn Error>> {
    let path = std::env::args().nth(1).ok_or("usage: thickness_table thickness.json")?;
    let document = Document::read(&std::fs::read(path)?)?;
    println!("label  name             figure  kind   verdict   mean mm    sd mm  median mm");
    for structure in &document.structures {
        let name = structure.name.as_deref().unwrap_or("-");
        for figure in &structure.figures {
            let (kind, index, total) = match figure {
                FigureDoc::Sheet(sheet) => ("sheet", sheet.index, &sheet.thickness_summary.total_mm),
                FigureDoc::Tube(tube) => ("tube", tube.index, &tube.thickness_summary.total_mm),
            };
            let LengthDoc { mean, sd, p50, .. } = total;
            let [mean, sd, median] = [mean, sd, p50].map(|length| length.map_or(f64::NAN, |Number(mm)| mm));
            let (label, verdict) = (structure.label, &structure.quality.verdict);
            println!("{label:5}  {name:15}  {index:6}  {kind:5}  {verdict:7}  {mean:8.3}  {sd:7.3}  {median:9.3}");
        }
        if let Some(refusal) = &structure.refusal {
            println!("{:5}  {name:15}       -  {}", structure.label, refusal.message);
        }
    }
    Ok(())
}
