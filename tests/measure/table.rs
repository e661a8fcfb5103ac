//! What was measured as a file and as tables.

use std::path::Path;

use serde_json::{Map, Value};

use super::accuracy::{Accuracy, Outcome};
use super::shapes::{CASES, SHAPES};

/// The file, from the root of the repository.
pub const FILE: &str = "docs/accuracy.json";

/// What was measured: of each of [`SHAPES`], in their order, each of [`CASES`] in theirs.
pub struct Table(pub Vec<Vec<Outcome>>);

impl Table {
    /// As text, one line for a case.
    pub fn to_text(&self) -> String {
        let mut shapes = Map::new();
        for (shape, row) in SHAPES.iter().zip(&self.0) {
            let cases = CASES.iter().zip(row).map(|(case, outcome)| (case.name.to_owned(), value_of(outcome)));
            shapes.insert(shape.sample.to_owned(), Value::Object(cases.collect()));
        }
        text_of(&Value::Object(shapes))
    }

    /// From the file.
    ///
    /// # Errors
    /// When it is not there, or is no such file.
    pub fn read(root: &Path) -> Result<Self, Box<dyn std::error::Error>> {
        let file: Value = serde_json::from_slice(&std::fs::read(root.join(FILE))?)?;
        let mut table = Vec::new();
        for shape in &SHAPES {
            let mut row = Vec::new();
            for case in &CASES {
                row.push(serde_json::from_value(file[shape.sample][case.name].clone())?);
            }
            table.push(row);
        }
        Ok(Self(table))
    }

    /// Two tables in Markdown: the plain case with the drift of the turned one, and every case in short.
    pub fn to_markdown(&self) -> String {
        format!("{}\n{}", self.plain(), self.cases())
    }

    fn plain(&self) -> String {
        let mut lines = heading(&["shape", "medial", "skin", "radius", "vector", "drift", "folds", "Dice"]);
        for (shape, row) in SHAPES.iter().zip(&self.0) {
            let drift = row.iter().find_map(|outcome| outcome.measured()?.drift);
            let Some(plain) = row[0].measured() else { continue };
            lines += &line(&[
                shape.title.to_owned(),
                decimals(Some(plain.medial), 2),
                decimals(Some(plain.skin), 2),
                decimals(plain.radius, 3),
                decimals(Some(plain.vector), 3),
                decimals(drift, 2),
                format!("{} of {}", plain.folds, plain.corners),
                decimals(Some(plain.dice), 3),
            ]);
        }
        lines
    }

    fn cases(&self) -> String {
        let titles = CASES.iter().map(|case| case.title);
        let mut lines = heading(&std::iter::once("skin, vector, folds").chain(titles).collect::<Vec<_>>());
        for (shape, row) in SHAPES.iter().zip(&self.0) {
            let mut cells = vec![shape.title.to_owned()];
            cells.extend(row.iter().map(in_short));
            lines += &line(&cells);
        }
        lines
    }
}

fn in_short(outcome: &Outcome) -> String {
    match outcome {
        Outcome::Measured(Accuracy { skin, vector, folds, .. }) => format!("{skin:.2}, {vector:.3}, {folds}"),
        Outcome::Refused { refused } => format!("refused: `{refused}`"),
    }
}

fn value_of(outcome: &Outcome) -> Value {
    serde_json::to_value(outcome).expect("numbers and names")
}

fn decimals(value: Option<f64>, count: usize) -> String {
    value.map_or_else(|| "–".to_owned(), |value| format!("{value:.count$}"))
}

fn heading(names: &[&str]) -> String {
    let names: Vec<String> = names.iter().map(|&name| name.to_owned()).collect();
    let rule = "|---".repeat(names.len());
    format!("{}{rule}|\n", line(&names))
}

fn line(cells: &[String]) -> String {
    format!("| {} |\n", cells.join(" | "))
}

/// JSON that is easy to compare: what holds objects has a line for each of them, all else is one line.
pub fn text_of(value: &Value) -> String {
    let mut text = String::new();
    append(&mut text, value, 0);
    text.push('\n');
    text
}

fn append(text: &mut String, value: &Value, depth: usize) {
    if !has_objects(value) {
        *text += &value.to_string();
        return;
    }
    let entries: Vec<(String, &Value)> = match value {
        Value::Object(map) => {
            map.iter().map(|(key, value)| (format!("{}: ", Value::from(key.as_str())), value)).collect()
        }
        Value::Array(list) => list.iter().map(|value| (String::new(), value)).collect(),
        _ => Vec::new(),
    };
    let [open, close] = if value.is_object() { ['{', '}'] } else { ['[', ']'] };
    text.push(open);
    for (number, (key, value)) in entries.iter().enumerate() {
        let comma = if number == 0 { "" } else { "," };
        *text += &format!("{comma}\n{}{key}", " ".repeat(depth + 1));
        append(text, value, depth + 1);
    }
    *text += &format!("\n{}{close}", " ".repeat(depth));
}

fn has_objects(value: &Value) -> bool {
    let is_nested = |value: &Value| value.is_object() || has_objects(value);
    match value {
        Value::Object(map) => map.values().any(is_nested),
        Value::Array(list) => list.iter().any(is_nested),
        _ => false,
    }
}
