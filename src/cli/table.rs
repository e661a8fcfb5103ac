//! What `medialrep run` ends with: what became of each structure, as a table or as JSON lines.

use clap::builder::styling::{AnsiColor, Style};
use serde::Serialize;

use crate::formats::write::round;
use crate::jobs::processed::StructureSummary;
use crate::model::Verdict;
use crate::space::significant;

/// Columns of a table that goes to a file, and at most on a terminal: longer lines are hard to read.
pub(super) const WIDTH: usize = 100;

/// Characters between two columns.
const GAP: &str = "  ";
/// Characters of a name; what is longer is cut.
const MAX_NAME: usize = 28;
/// Characters that the last column has at least, though the table then is wider than it should be.
const MIN_REASON: usize = 24;

const TITLES: [&str; 6] = ["label", "name", "figures", "verdict", "mean thickness", "first reason"];
/// Columns of numbers end in line.
const IS_RIGHT: [bool; 6] = [true, false, true, false, true, false];
const NAME: usize = 1;
const VERDICT: usize = 3;
const REASON: usize = 5;

/// A structure's cells, in the order of [`TITLES`], and the colour of its verdict.
struct Row {
    cells: [String; 6],
    style: Style,
}

/// The table, at most `width` characters wide where that can be; the reasons are broken into lines.
/// There is no column of names when no structure has one.
pub(super) fn table(structures: &[StructureSummary], width: usize, has_color: bool) -> String {
    let rows: Vec<Row> = structures.iter().map(row).collect();
    let columns: Vec<usize> = (0..REASON).filter(|&column| column != NAME || has_names(structures)).collect();
    let widths = TITLES.map(characters);
    let widths: [usize; 6] = std::array::from_fn(|column| {
        rows.iter().map(|row| characters(&row.cells[column])).fold(widths[column], usize::max)
    });
    let before_reason: usize = columns.iter().map(|&column| widths[column] + GAP.len()).sum();
    let reason_width = width.saturating_sub(before_reason).max(MIN_REASON);
    let head = Row { cells: TITLES.map(str::to_owned), style: Style::new() };
    let mut text = String::new();
    for row in std::iter::once(&head).chain(&rows) {
        let mut line = String::new();
        for &column in &columns {
            line += &padded(row, column, widths[column], has_color);
            line += GAP;
        }
        for reason in broken(&row.cells[REASON], reason_width) {
            text += (line + &reason).trim_end();
            text.push('\n');
            line = " ".repeat(before_reason);
        }
    }
    text
}

fn row(structure: &StructureSummary) -> Row {
    let name = short(structure.name.as_deref().unwrap_or("-"));
    let [figures, verdict, thickness, reason] = match &structure.found {
        Err(refusal) => ["-".to_owned(), "refused".to_owned(), "-".to_owned(), refusal.to_string()],
        Ok(found) => [
            found.figures.to_string(),
            found.verdict.name().to_owned(),
            found.mean_thickness_mm.map_or("-".to_owned(), |mean_mm| format!("{} mm", significant(mean_mm))),
            found.reason.as_ref().map_or(String::new(), |reason| reason.message.clone()),
        ],
    };
    let style = match structure.found.as_ref().map(|found| found.verdict) {
        Ok(Verdict::Pass) => AnsiColor::Green.on_default(),
        Ok(Verdict::Warn) => AnsiColor::Yellow.on_default(),
        Ok(Verdict::Fail) | Err(_) => AnsiColor::Red.on_default(),
    };
    Row { cells: [structure.label.to_string(), name, figures, verdict, thickness, reason], style }
}

fn has_names(structures: &[StructureSummary]) -> bool {
    structures.iter().any(|structure| structure.name.is_some())
}

/// A name without what would move the cursor: it comes from a file.
fn short(name: &str) -> String {
    let mut short: String = name.chars().map(|c| if c.is_control() { ' ' } else { c }).collect();
    if let Some((end, _)) = short.char_indices().nth(MAX_NAME) {
        short.truncate(end);
        short.pop();
        short.push('…');
    }
    short
}

fn characters(text: impl AsRef<str>) -> usize {
    text.as_ref().chars().count()
}

fn padded(row: &Row, column: usize, width: usize, has_color: bool) -> String {
    let cell = &row.cells[column];
    let space = " ".repeat(width - characters(cell));
    if column == VERDICT && has_color {
        let style = row.style;
        return format!("{style}{cell}{style:#}{space}");
    }
    if IS_RIGHT[column] { space + cell } else { cell.clone() + &space }
}

/// The lines of a text, broken between words; one empty line of no text.
fn broken(text: &str, width: usize) -> Vec<String> {
    let mut lines = vec![String::new()];
    for word in text.split_whitespace() {
        match lines.last_mut() {
            Some(line) if line.is_empty() => line.push_str(word),
            Some(line) if characters(&*line) + 1 + characters(word) <= width => {
                line.push(' ');
                line.push_str(word);
            }
            _ => lines.push(word.to_owned()),
        }
    }
    lines
}

/// A structure as a line of JSON. The fields are those of thickness.json, where it has them.
#[derive(Serialize)]
struct StructureLine<'a> {
    #[serde(skip_serializing_if = "Option::is_none")]
    mask: Option<&'a str>,
    index: usize,
    label: i64,
    name: Option<&'a str>,
    figures: usize,
    verdict: &'static str,
    mean_thickness_mm: Option<f64>,
    reason: Option<Told<'a>>,
    refusal: Option<Told<'a>>,
}

#[derive(Serialize)]
struct Told<'a> {
    code: &'a str,
    message: String,
    #[serde(skip_serializing_if = "Option::is_none")]
    hint: Option<String>,
}

/// One JSON object per structure and line, with the name of the mask where there are several.
///
/// # Errors
/// When a structure cannot be put into JSON.
pub(super) fn json_lines(structures: &[StructureSummary], mask: Option<&str>) -> serde_json::Result<String> {
    let mut text = String::new();
    for (index, structure) in structures.iter().enumerate() {
        text += &serde_json::to_string(&StructureLine { mask, ..line(index, structure) })?;
        text.push('\n');
    }
    Ok(text)
}

fn line(index: usize, structure: &StructureSummary) -> StructureLine<'_> {
    let (label, name) = (structure.label, structure.name.as_deref());
    match &structure.found {
        Err(refusal) => {
            let told = Told { code: refusal.code(), message: refusal.to_string(), hint: Some(refusal.hint()) };
            let (verdict, refusal) = (Verdict::Fail.name(), Some(told));
            StructureLine {
                mask: None,
                index,
                label,
                name,
                figures: 0,
                verdict,
                mean_thickness_mm: None,
                reason: None,
                refusal,
            }
        }
        Ok(found) => {
            let reason = found.reason.as_ref();
            let reason = reason.map(|reason| Told { code: &reason.code, message: reason.message.clone(), hint: None });
            let mean_thickness_mm = found.mean_thickness_mm.map(round);
            let (figures, verdict) = (found.figures, found.verdict.name());
            StructureLine { mask: None, index, label, name, figures, verdict, mean_thickness_mm, reason, refusal: None }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::jobs::processed::Measured;
    use crate::model::Reason;
    use crate::model::Refusal;

    fn measured(label: i64, verdict: Verdict, mean_mm: Option<f64>, reason: &str) -> StructureSummary {
        let reason =
            Reason { code: "dice".into(), message: reason.to_owned(), value: 0.8, threshold: 0.9, place: None };
        let reason = (verdict != Verdict::Pass).then_some(reason);
        let found = Measured { figures: 2, verdict, mean_thickness_mm: mean_mm, reason };
        StructureSummary { label, name: None, found: Ok(found) }
    }

    fn three() -> Vec<StructureSummary> {
        let long = "overlap of the cells with the mask is 0.812, the threshold is 0.900";
        vec![
            measured(11, Verdict::Pass, Some(9.876_543_21), ""),
            measured(1200, Verdict::Warn, Some(123.4), long),
            StructureSummary { label: 3, name: None, found: Err(Refusal::Ball { radius_mm: 4.0 }) },
        ]
    }

    #[test]
    fn columns_are_in_line_and_reasons_are_broken() {
        let expected = "\
label  figures  verdict  mean thickness  first reason
   11        2  pass            9.88 mm
 1200        2  warn             123 mm  overlap of the cells with the mask is 0.812,
                                         the threshold is 0.900
    3        -  refused               -  the object is a ball of radius 4.00 mm: its
                                         medial sheet is shorter than that
";
        assert_eq!(table(&three(), 86, false), expected);
    }

    #[test]
    fn a_narrow_table_keeps_every_word() {
        let text = table(&three(), 10, false);
        let words: Vec<_> = text.split_whitespace().collect();
        for word in "overlap of the cells with the mask is 0.812, the threshold is 0.900".split_whitespace() {
            assert!(words.contains(&word), "{text}");
        }
    }

    #[test]
    fn lines_are_no_longer_than_asked_for() {
        assert!(table(&three(), WIDTH, false).lines().all(|line| line.chars().count() <= WIDTH));
    }

    #[test]
    fn names_have_a_column_once_there_is_one() {
        let mut structures = three();
        structures[0].name = Some("left \u{1b}[31mcaudate".to_owned());
        structures[1].name = Some("é".repeat(40));
        let text = table(&structures, WIDTH, false);
        let lines: Vec<_> = text.lines().collect();
        assert!(lines[0].starts_with("label  name  "), "{text}");
        assert!(lines[1].starts_with("   11  left  [31mcaudate  "), "{text}");
        assert!(lines[2].contains(&format!("{}…  ", "é".repeat(MAX_NAME - 1))), "{text}");
        assert!(text.lines().any(|line| line.starts_with("    3  -  ")), "{text}");
    }

    #[test]
    fn color_changes_the_verdict_and_nothing_else() {
        let (plain, colored) = (table(&three(), WIDTH, false), table(&three(), WIDTH, true));
        assert!(!plain.contains('\u{1b}'));
        for verdict in ["\u{1b}[32mpass\u{1b}[0m", "\u{1b}[33mwarn\u{1b}[0m", "\u{1b}[31mrefused\u{1b}[0m"] {
            assert!(colored.contains(verdict), "{colored:?}");
        }
        let without = ["\u{1b}[32m", "\u{1b}[33m", "\u{1b}[31m", "\u{1b}[0m"];
        assert_eq!(without.iter().fold(colored, |text, code| text.replace(code, "")), plain);
    }

    #[test]
    fn a_structure_is_a_line_of_json() {
        let text = json_lines(&three(), None).unwrap();
        let lines: Vec<serde_json::Value> = text.lines().map(|line| serde_json::from_str(line).unwrap()).collect();
        assert_eq!(
            lines[0],
            serde_json::json!({"index": 0, "label": 11, "name": null, "figures": 2, "verdict": "pass",
                "mean_thickness_mm": 9.876_543, "reason": null, "refusal": null})
        );
        assert_eq!((&lines[1]["reason"]["code"], &lines[1]["verdict"]), (&"dice".into(), &"warn".into()));
        let refusal = &lines[2]["refusal"];
        assert_eq!((&refusal["code"], &lines[2]["verdict"]), (&"shape_is_a_ball".into(), &"fail".into()));
        assert!(refusal["hint"].is_string() && lines[2]["mean_thickness_mm"].is_null());
    }
}
