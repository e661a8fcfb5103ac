//! Numbers and names in words.

use crate::model::{Figure, Structure};

/// What is shown where there is no number.
pub(super) const NONE: &str = "–";

/// A length, mm, to the hundredth: a tenth of what a scan resolves.
pub(super) fn length(mm: Option<f64>) -> String {
    match mm {
        Some(mm) if mm.is_finite() => format!("{mm:.2}"),
        _ => NONE.to_owned(),
    }
}

/// A volume, in ml from a tenth of one on.
pub(super) fn volume(mm3: f64) -> String {
    match mm3 {
        _ if !mm3.is_finite() => NONE.to_owned(),
        _ if mm3 >= 1e5 => format!("{:.0} ml", mm3 / 1e3),
        _ if mm3 >= 1e4 => format!("{:.1} ml", mm3 / 1e3),
        _ if mm3 >= 100.0 => format!("{:.2} ml", mm3 / 1e3),
        _ => format!("{mm3:.1} mm³"),
    }
}

/// An area, in cm² from one on.
pub(super) fn area(mm2: f64) -> String {
    match mm2 {
        _ if !mm2.is_finite() => NONE.to_owned(),
        _ if mm2 >= 100.0 => format!("{:.2} cm²", mm2 / 100.0),
        _ => format!("{mm2:.1} mm²"),
    }
}

/// A share in per cent.
pub(super) fn percent(share: f64) -> String {
    if share.is_finite() { format!("{:.1} %", 100.0 * share) } else { NONE.to_owned() }
}

/// What a structure is called, else its label.
pub(super) fn name(structure: &Structure) -> String {
    match &structure.name {
        Some(name) if !name.trim().is_empty() => name.clone(),
        _ => format!("Label {}", structure.label),
    }
}

/// The kinds of the figures of a structure with their numbers: `1 sheet, 2 tubes`.
pub(super) fn figures(structure: &Structure) -> String {
    let told = |count: usize, what: &str| match count {
        0 => None,
        1 => Some(format!("1 {what}")),
        _ => Some(format!("{count} {what}s")),
    };
    let sheets = structure.figures.iter().filter(|figure| matches!(figure, Figure::Sheet(_))).count();
    let all = [told(sheets, "sheet"), told(structure.figures.len() - sheets, "tube")];
    let all: Vec<String> = all.into_iter().flatten().collect();
    if all.is_empty() { "no figure".to_owned() } else { all.join(", ") }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_have_their_unit_and_what_is_none_a_dash() {
        assert_eq!([length(Some(7.126)), length(None), length(Some(f64::NAN))], ["7.13", NONE, NONE]);
        let volumes = [99.0, 4321.0, 43_210.0, 1_432_100.0, f64::NAN].map(volume);
        assert_eq!(volumes, ["99.0 mm³", "4.32 ml", "43.2 ml", "1432 ml", NONE]);
        assert_eq!([area(99.0), area(250.0), percent(0.9876)], ["99.0 mm²", "2.50 cm²", "98.8 %"]);
    }
}
