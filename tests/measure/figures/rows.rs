//! What the two results of a mask say, as a table of what differs.

use medialrep::model::{Sheet, Structure};
use medialrep::samples::Solid;

use super::super::accuracy::vector_errors;
use super::Pair;

/// A measure in words and what both results have of it.
type Row = (&'static str, [String; 2]);

/// A measure of a result.
type Measure = (&'static str, fn(&Structure, Option<&Solid>) -> String);

/// In the order of the table.
const MEASURES: [Measure; 14] = [
    ("figures", |structure, _| figures(structure)),
    ("lattice", |structure, _| lattices(structure)),
    ("nodes on the sheet", |structure, _| valid(structure)),
    ("mean thickness, mm", |structure, _| thickness(structure)),
    ("area of the sheets, mm²", |structure, _| format!("{:.0}", structure.thickness_summary().area_mm2)),
    ("vectors, mean length over the inscribed radius", |structure, _| stretch(structure)),
    ("inner vectors off the true radius, mean", true_error),
    ("folded corners", |structure, _| folds(structure)),
    ("Dice", |structure, _| format!("{:.3}", structure.quality.coverage.dice)),
    ("Dice of the flat quads", |structure, _| format!("{:.3}", structure.quality.coverage.flat_dice)),
    ("largest residual variance", |structure, _| format!("{:.4}", structure.quality.residual_variance)),
    ("largest spacing variation", |structure, _| format!("{:.2}", structure.quality.spacing_variation)),
    ("verdict", |structure, _| structure.quality.verdict.name().to_owned()),
    ("first reason", |structure, _| reason(structure)),
];

/// The table in Markdown: measures that differ, and a sentence on those that do not.
pub fn to_markdown(pair: &Pair) -> String {
    let mut text = "| | paper | defaults |\n|---|---|---|\n".to_owned();
    let mut equal = Vec::new();
    for (what, [paper, defaults]) in rows(pair) {
        if paper == defaults {
            if paper != "–" {
                equal.push(format!("{what} {paper}"));
            }
        } else {
            text += &format!("| {what} | {paper} | {defaults} |\n");
        }
    }
    if !equal.is_empty() {
        text += &format!("\nEqual: {}.\n", equal.join("; "));
    }
    text
}

/// All measures of both results.
fn rows(pair: &Pair) -> Vec<Row> {
    let mut rows = Vec::new();
    if let [Err(paper), Err(defaults)] = pair.both() {
        return vec![("refused", [paper.clone(), defaults.clone()])];
    }
    for (what, measure) in MEASURES {
        rows.push((
            what,
            pair.both().map(|result| match result {
                Ok(structure) => measure(structure, pair.solid.as_ref()),
                Err(refusal) if what == "first reason" => refusal.clone(),
                Err(_) if what == "verdict" => "refused".to_owned(),
                Err(_) => "–".to_owned(),
            }),
        ));
    }
    rows
}

fn figures(structure: &Structure) -> String {
    let counted = |count: usize, what: &str| match count {
        0 => None,
        1 => Some(format!("1 {what}")),
        _ => Some(format!("{count} {what}s")),
    };
    let both = [counted(structure.sheets().count(), "sheet"), counted(structure.tubes().count(), "tube")];
    both.into_iter().flatten().collect::<Vec<_>>().join(", ")
}

/// Each size once, in the order of the figures.
fn lattices(structure: &Structure) -> String {
    let mut sizes: Vec<String> = Vec::new();
    for figure in &structure.figures {
        let size = format!("{} × {}", figure.grid().rows, figure.grid().cols);
        if !sizes.contains(&size) {
            sizes.push(size);
        }
    }
    sizes.join(", ")
}

fn valid(structure: &Structure) -> String {
    let nodes = || structure.sheets().flat_map(|sheet| &sheet.valid);
    format!("{} of {}", nodes().filter(|valid| **valid).count(), nodes().count())
}

fn thickness(structure: &Structure) -> String {
    match structure.thickness_summary().total_mm {
        Some(total) => format!("{:.2} ± {:.2}", total.mean, total.sd),
        None => "–".to_owned(),
    }
}

/// 1 where every vector is a spoke of the largest ball at its node; more where they lean.
fn stretch(structure: &Structure) -> String {
    let mut ratios = Vec::new();
    for sheet in structure.sheets() {
        let drawable = sheet.drawable();
        for (node, total) in sheet.total_mm().into_iter().enumerate() {
            if drawable[node] && !sheet.is_marred(node) {
                ratios.push(total / 2.0 / sheet.medial_radius_mm[node]);
            }
        }
    }
    mean_told(&ratios, |mean| format!("{mean:.2}"))
}

/// Against the solid that the mask was made of, over the middle half of rows and columns.
fn true_error(structure: &Structure, solid: Option<&Solid>) -> String {
    let Some(solid) = solid else { return "–".to_owned() };
    let errors: Vec<f64> = structure.sheets().flat_map(|sheet: &Sheet| vector_errors(solid, sheet)).collect();
    mean_told(&errors, |mean| format!("{:.1} %", 100.0 * mean))
}

fn mean_told(values: &[f64], told: impl Fn(f64) -> String) -> String {
    if values.is_empty() { "–".to_owned() } else { told(values.iter().sum::<f64>() / values.len() as f64) }
}

fn folds(structure: &Structure) -> String {
    let corners: usize = structure.figures.iter().map(|figure| figure.quality().corners).sum();
    format!("{} of {corners}", structure.quality.folds)
}

fn reason(structure: &Structure) -> String {
    let Some(reason) = structure.quality.deciding_reason() else { return "–".to_owned() };
    // Where it is worst says nothing beside a picture.
    reason.message.split(';').next().unwrap_or_default().to_owned()
}
