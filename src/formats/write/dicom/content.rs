//! Content items of a structured report (PS3.3, C.17.3): each an item of the sequence of its parent.

use super::dataset::{Code, Dataset, Text};

/// How an item belongs to its parent.
#[derive(Clone, Copy, Debug)]
pub(super) enum Relation {
    Contains,
    /// Who observed.
    Context,
    /// What the parent's name means more precisely.
    Modifier,
}

impl Relation {
    fn name(self) -> &'static str {
        match self {
            Self::Contains => "CONTAINS",
            Self::Context => "HAS OBS CONTEXT",
            Self::Modifier => "HAS CONCEPT MOD",
        }
    }
}

fn item(relation: Relation, kind: &str, name: Code<'_>) -> Dataset {
    let mut item = Dataset::default();
    item.text((0x0040, 0xa010), Text::Cs, relation.name());
    item.text((0x0040, 0xa040), Text::Cs, kind);
    item.code((0x0040, 0xa043), name);
    item
}

pub(super) fn code(relation: Relation, name: Code<'_>, value: Code<'_>) -> Dataset {
    let mut item = item(relation, "CODE", name);
    item.code((0x0040, 0xa168), value);
    item
}

/// A text in the letters that every character set has; others are set by the caller.
pub(super) fn text(relation: Relation, name: Code<'_>, value: &str) -> Dataset {
    let mut item = item(relation, "TEXT", name);
    item.ascii((0x0040, 0xa160), Text::Ut, value);
    item
}

pub(super) fn uid(relation: Relation, name: Code<'_>, value: &str) -> Dataset {
    let mut item = item(relation, "UIDREF", name);
    item.text((0x0040, 0xa124), Text::Ui, value);
    item
}

/// A measured number; `None` of what is none.
pub(super) fn number(name: Code<'_>, value: f64, unit: Code<'_>, modifiers: Vec<Dataset>) -> Option<Dataset> {
    let mut measured = Dataset::default();
    measured.text((0x0040, 0xa30a), Text::Ds, &decimal(value)?);
    measured.code((0x0040, 0x08ea), unit);
    let mut item = item(Relation::Contains, "NUM", name);
    item.items((0x0040, 0xa300), vec![measured]);
    if !modifiers.is_empty() {
        item.items((0x0040, 0xa730), modifiers);
    }
    Some(item)
}

pub(super) fn container(name: Code<'_>, template: Option<&str>, content: Vec<Dataset>) -> Dataset {
    let mut item = item(Relation::Contains, "CONTAINER", name);
    add_content(&mut item, template, content);
    item
}

/// What makes a container of a data set.
pub(super) fn add_content(set: &mut Dataset, template: Option<&str>, content: Vec<Dataset>) {
    set.text((0x0040, 0xa050), Text::Cs, "SEPARATE");
    if let Some(template) = template {
        let mut of = Dataset::default();
        of.text((0x0008, 0x0105), Text::Cs, "DCMR");
        of.text((0x0040, 0xdb00), Text::Cs, template);
        set.items((0x0040, 0xa504), vec![of]);
    }
    set.items((0x0040, 0xa730), content);
}

/// A segment of the object that the mask came in.
pub(super) fn segment(name: Code<'_>, mut reference: Dataset, number: u16) -> Dataset {
    reference.short((0x0062, 0x000b), number);
    let mut item = item(Relation::Contains, "IMAGE", name);
    item.items((0x0008, 0x1199), vec![reference]);
    item
}

/// A number in up to 16 characters, with six decimals where they have room; `None` of what is none.
fn decimal(value: f64) -> Option<String> {
    const MOST: usize = 16;
    if !value.is_finite() {
        return None;
    }
    let told = format!("{value:.6}");
    if told.len() <= MOST { Some(told) } else { Some(format!("{value:.8e}")) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_have_room_in_their_kind() {
        let told = [0.1 + 0.2, -123_456_789.25, 1e300, -1e-300].map(decimal).map(Option::unwrap_or_default);
        assert_eq!(told, ["0.300000", "-1.23456789e8", "1.00000000e300", "-0.000000"]);
        assert_eq!(decimal(f64::NAN), None);
    }
}
