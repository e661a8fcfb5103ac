//! What values a parameter takes, and the check of a given value against it.

use std::borrow::Cow;
use std::collections::BTreeSet;
use std::fmt::Display;
use std::ops::RangeInclusive;

use super::ParamsError;
use super::given::{Given, echo};

/// One way to give a value.
#[derive(Clone, Debug, PartialEq)]
pub enum Shape {
    /// One of these words.
    Words(&'static [&'static str]),
    /// A whole number from 0 up.
    Count(RangeInclusive<usize>),
    /// A number.
    Number(RangeInclusive<f64>),
    /// A whole number other than 0, the background.
    Label,
    /// Values by name, all of these and no others.
    Fields(&'static [(&'static str, Shape)]),
    /// A list, each entry once.
    List {
        /// What an entry is.
        of: &'static Shape,
        /// How many there are.
        lengths: RangeInclusive<usize>,
    },
    /// Texts by label, none of them with control characters. Space around a text does not count.
    Texts {
        /// Characters of a text.
        chars: RangeInclusive<usize>,
        /// How many there are.
        lengths: RangeInclusive<usize>,
    },
}

impl Shape {
    /// Whether a value is meant in this way, be it in range or not.
    fn is_meant_by(&self, given: &Given) -> bool {
        match self {
            Self::Words(words) => given.as_text().is_some_and(|text| words.contains(&text)),
            Self::Count(_) => matches!(given, Given::Whole(_)),
            Self::Number(_) => matches!(given, Given::Whole(_) | Given::Number(_)),
            Self::Label => given.as_whole::<i64>().is_some(),
            Self::Fields(_) | Self::Texts { .. } => matches!(given, Given::Object(_)),
            Self::List { .. } => matches!(given, Given::List(_)),
        }
    }

    /// The ways that it stands for, in words.
    fn phrases(&self) -> Vec<String> {
        vec![match self {
            Self::Words(words) => return words.iter().map(|word| format!("\"{word}\"")).collect(),
            Self::Count(range) => format!("a whole number from {}", to(range)),
            Self::Number(range) => format!("a number from {}", to(range)),
            Self::Label => "a whole number other than 0".to_owned(),
            Self::Fields(fields) => {
                let fields: Vec<_> =
                    fields.iter().map(|(name, shape)| format!("\"{name}\": {}", shape.short())).collect();
                format!("{{{}}}", fields.join(", "))
            }
            Self::List { of, lengths } => format!("a list of {} {}, each once", to(lengths), of.plural()),
            Self::Texts { chars, lengths } => {
                format!("{{\"label\": \"text\", …}}, {} texts of {} characters", to(lengths), to(chars))
            }
        }]
    }

    /// What stands for it in an object.
    fn short(&self) -> String {
        match self {
            Self::Count(range) => to(range),
            Self::Number(range) => to(range),
            other => phrase(std::slice::from_ref(other)),
        }
    }

    /// What stands for it in a list.
    fn plural(&self) -> String {
        match self {
            Self::Label => "whole numbers other than 0".to_owned(),
            other => format!("of {}", phrase(std::slice::from_ref(other))),
        }
    }
}

/// What `shapes` allow, in words: `"auto" or a number from 0 to 1`.
#[must_use]
pub fn phrase(shapes: &[Shape]) -> String {
    let mut ways: Vec<String> = shapes.iter().flat_map(Shape::phrases).collect();
    let last = ways.pop().unwrap_or_default();
    if ways.is_empty() { last } else { format!("{} or {last}", ways.join(", ")) }
}

/// A range in words.
fn to<T: Display>(range: &RangeInclusive<T>) -> String {
    format!("{} to {}", range.start(), range.end())
}

/// Checks a value against the shapes it may have.
///
/// # Errors
/// What is wrong, the field within the value named.
pub(super) fn check(field: &str, shapes: &[Shape], given: &Given) -> Result<(), ParamsError> {
    let mut meant = shapes.iter().filter(|shape| shape.is_meant_by(given));
    let Some(first) = meant.next() else { return Err(wrong(field, given, phrase(shapes))) };
    match (first, given) {
        (Shape::Count(range), Given::Whole(whole)) => {
            within(field, whole, &(*range.start() as i128..=*range.end() as i128))
        }
        (Shape::Number(range), _) => number(field, given, range),
        (Shape::Label, Given::Whole(0)) => Err(wrong(field, given, "labels other than 0, the background".to_owned())),
        (Shape::Fields(_), Given::Object(entries)) => object(field, shapes, given, entries),
        (Shape::List { of, lengths }, Given::List(entries)) => {
            within(field, &entries.len(), lengths)?;
            each_once(field, first, of, entries)
        }
        (Shape::Texts { chars, lengths }, Given::Object(entries)) => {
            within(field, &entries.len(), lengths)?;
            entries.iter().try_for_each(|(label, text)| named_text(field, label, text, chars))
        }
        _ => Ok(()),
    }
}

fn number(field: &str, given: &Given, range: &RangeInclusive<f64>) -> Result<(), ParamsError> {
    // What is no number is in no range.
    let value = given.as_number().unwrap_or(f64::NAN);
    if range.contains(&value) { Ok(()) } else { Err(wrong(field, given, to(range))) }
}

/// Checks an object against those of the shapes that are objects: the one whose names it has, or else the
/// only one, to say which name is lacking.
fn object(field: &str, shapes: &[Shape], given: &Given, entries: &[(String, Given)]) -> Result<(), ParamsError> {
    let mut objects = Vec::new();
    for shape in shapes {
        if let Shape::Fields(fields) = shape {
            objects.push(*fields);
        }
    }
    let known = objects.iter().flat_map(|fields| fields.iter().map(|(name, _)| *name));
    only_known(&format!("{field}."), entries.iter().map(|(name, _)| name), known)?;
    let fields = match (objects.iter().find(|fields| has_all(given, fields, entries.len())), &objects[..]) {
        (Some(fields), _) => *fields,
        (None, [only]) => *only,
        _ => return Err(wrong(field, given, phrase(shapes))),
    };
    for (name, shape) in fields {
        let field = format!("{field}.{name}");
        match given.part(name) {
            Some(part) => check(&field, std::slice::from_ref(shape), part)?,
            None => return Err(wrong(&field, &Given::Nothing, phrase(shapes))),
        }
    }
    Ok(())
}

/// Whether an object of `count` values has all fields and nothing else.
fn has_all(given: &Given, fields: &[(&str, Shape)], count: usize) -> bool {
    fields.len() == count && fields.iter().all(|(name, _)| given.part(name).is_some())
}

fn each_once(field: &str, list: &Shape, of: &Shape, entries: &[Given]) -> Result<(), ParamsError> {
    let mut seen = BTreeSet::new();
    for entry in entries {
        if !of.is_meant_by(entry) {
            return Err(wrong(field, entry, phrase(std::slice::from_ref(list))));
        }
        check(field, std::slice::from_ref(of), entry)?;
        if !seen.insert(entry.to_string()) {
            return Err(wrong(field, entry, phrase(std::slice::from_ref(list))));
        }
    }
    Ok(())
}

fn named_text(field: &str, label: &str, text: &Given, chars: &RangeInclusive<usize>) -> Result<(), ParamsError> {
    let at = format!("{field}.{}", echo(label));
    if label_of(label).is_none() {
        return Err(wrong(&at, &Given::text(label), "labels other than 0, the background, in digits".to_owned()));
    }
    let is_fit = |text: &str| chars.contains(&text.trim().chars().count()) && !text.contains(char::is_control);
    if text.as_text().is_some_and(is_fit) {
        return Ok(());
    }
    Err(wrong(&at, text, format!("a text of {} characters, none of them a control character", to(chars))))
}

/// The label that a text names. Each has one way to be written, so that none is there twice.
pub(super) fn label_of(text: &str) -> Option<i64> {
    let label: i64 = text.parse().ok()?;
    (label != 0 && label.to_string() == text).then_some(label)
}

/// Checks that every name is one of those that are known.
///
/// # Errors
/// The first that is not.
pub(super) fn only_known<'a>(
    prefix: &str,
    names: impl Iterator<Item = &'a String>,
    known: impl Iterator<Item = &'static str>,
) -> Result<(), ParamsError> {
    let known: Vec<_> = known.collect();
    for name in names {
        if !known.contains(&name.as_str()) {
            let field = Cow::Owned(format!("{prefix}{}", echo(name)));
            return Err(ParamsError { field, got: "an unknown name".to_owned(), allowed: known.join(", ") });
        }
    }
    Ok(())
}

fn within<T: PartialOrd + Display>(field: &str, value: &T, range: &RangeInclusive<T>) -> Result<(), ParamsError> {
    if range.contains(value) {
        return Ok(());
    }
    Err(ParamsError { field: Cow::Owned(field.to_owned()), got: value.to_string(), allowed: to(range) })
}

/// A value that is not `allowed`.
pub(super) fn wrong(field: &str, given: &Given, allowed: String) -> ParamsError {
    let got = if *given == Given::Nothing { "nothing".to_owned() } else { echo(&given.to_string()) };
    ParamsError { field: Cow::Owned(field.to_owned()), got, allowed }
}
