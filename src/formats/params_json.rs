//! Parameters as JSON: strict in, complete out.

use std::fmt;

use serde::de::{Deserialize, Deserializer, Error as _, MapAccess, SeqAccess, Visitor};
use serde_json::{Map, Value, json};

use crate::params::{
    CheckedParams, Correspondence, GridChoice, LABEL_COUNT, Landmarks, LatticeKind, Neighbors, Params, ParamsError,
    Prune,
};

/// Longest text accepted: a thousand labels take 20 kB.
pub const MAX_BYTES: usize = 1 << 16;
/// Characters of a wrong value repeated in the error.
const MAX_ECHO: usize = 60;

/// Every parameter's name, in the order of the contract.
pub const NAMES: [&str; 12] = [
    "labels",
    "grid",
    "spacing_mm",
    "margin",
    "neighbors",
    "landmarks",
    "lattice",
    "correspondence",
    "prune",
    "max_figures",
    "resolution_mm",
    "uncertainty",
];

/// Why a text holds no parameters.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum ParamsJsonError {
    /// Not JSON, too long, too deep, or a name that is there twice.
    #[error("the parameters are not valid JSON: {reason}")]
    Syntax {
        /// What and where, line and column.
        reason: String,
    },
    /// A field is unknown, of the wrong type or out of range.
    #[error(transparent)]
    Field(#[from] ParamsError),
}

/// Parses and checks.
///
/// # Errors
/// The first field that is unknown, of the wrong type or out of range.
pub fn parse(text: &[u8]) -> Result<CheckedParams, ParamsJsonError> {
    let syntax = |reason: String| ParamsJsonError::Syntax { reason };
    if text.len() > MAX_BYTES {
        return Err(syntax(format!("{} bytes, at most {MAX_BYTES} are read", text.len())));
    }
    let Strict(value) = serde_json::from_slice(text).map_err(|error| syntax(error.to_string()))?;
    let Value::Object(fields) = value else {
        return Err(syntax("it must be an object".to_owned()));
    };
    Ok(from_fields(&fields)?.check()?)
}

fn from_fields(fields: &Map<String, Value>) -> Result<Params, ParamsError> {
    only_known("", fields, &NAMES)?;
    let mut params = Params::default();
    for (name, value) in fields {
        set(&mut params, name, value)?;
    }
    Ok(params)
}

fn set(params: &mut Params, name: &str, value: &Value) -> Result<(), ParamsError> {
    match name {
        "labels" => params.labels = optional(value, labels)?,
        "grid" => params.grid = grid(value)?,
        "spacing_mm" => params.spacing_mm = optional(value, |v| number("spacing_mm", v))?,
        "margin" => params.margin = number("margin", value)?,
        "neighbors" => params.neighbors = neighbors(value)?,
        "landmarks" => params.landmarks = landmarks(value)?,
        "lattice" => params.lattice = lattice(value)?,
        "correspondence" => params.correspondence = correspondence(value)?,
        "prune" => params.prune = prune(value)?,
        "max_figures" => params.max_figures = optional(value, |v| count("max_figures", v))?,
        "resolution_mm" => params.resolution_mm = optional(value, |v| number("resolution_mm", v))?,
        "uncertainty" => params.uncertainty = count("uncertainty", value)?,
        _ => {}
    }
    Ok(())
}

/// `null` means the default of a parameter that has none.
fn optional<T>(value: &Value, read: impl Fn(&Value) -> Result<T, ParamsError>) -> Result<Option<T>, ParamsError> {
    if value.is_null() { Ok(None) } else { read(value).map(Some) }
}

fn labels(value: &Value) -> Result<Vec<i64>, ParamsError> {
    let wrong = |value: &Value| wrong("labels", value, "a list of whole numbers, each once");
    let entries = value.as_array().ok_or_else(|| wrong(value))?;
    let mut labels = Vec::new();
    for entry in entries {
        let label = entry.as_i64().ok_or_else(|| wrong(entry))?;
        // More than are allowed are refused for their number; comparing them all would take long.
        if labels.len() <= *LABEL_COUNT.end() && labels.contains(&label) {
            return Err(wrong(entry));
        }
        labels.push(label);
    }
    Ok(labels)
}

fn grid(value: &Value) -> Result<GridChoice, ParamsError> {
    const ALLOWED: &str = "{\"rows\": n, \"cols\": m} or \"auto\"";
    match value {
        Value::String(text) if text == "auto" => Ok(GridChoice::Auto),
        Value::Object(fields) => {
            only_known("grid.", fields, &["rows", "cols"])?;
            let side = |name: &'static str, key: &str| match fields.get(key) {
                Some(value) => count(name, value),
                None => Err(wrong(name, &Value::Null, ALLOWED)),
            };
            Ok(GridChoice::Fixed { rows: side("grid.rows", "rows")?, cols: side("grid.cols", "cols")? })
        }
        _ => Err(wrong("grid", value, ALLOWED)),
    }
}

fn neighbors(value: &Value) -> Result<Neighbors, ParamsError> {
    const ALLOWED: &str = "\"auto\", {\"k\": n} or {\"epsilon_mm\": x}";
    match value {
        Value::String(text) if text == "auto" => Ok(Neighbors::Auto),
        Value::Object(fields) => {
            only_known("neighbors.", fields, &["k", "epsilon_mm"])?;
            match (fields.get("k"), fields.get("epsilon_mm")) {
                (Some(k), None) => Ok(Neighbors::Count(count("neighbors.k", k)?)),
                (None, Some(radius)) => Ok(Neighbors::RadiusMm(number("neighbors.epsilon_mm", radius)?)),
                _ => Err(wrong("neighbors", value, ALLOWED)),
            }
        }
        _ => Err(wrong("neighbors", value, ALLOWED)),
    }
}

fn landmarks(value: &Value) -> Result<Landmarks, ParamsError> {
    match value.as_str() {
        Some("auto") => Ok(Landmarks::Auto),
        Some("all") => Ok(Landmarks::All),
        Some(_) => Err(wrong("landmarks", value, "\"auto\", \"all\" or a whole number")),
        None => count("landmarks", value).map(Landmarks::Count),
    }
}

fn lattice(value: &Value) -> Result<LatticeKind, ParamsError> {
    match value.as_str() {
        Some("fitted") => Ok(LatticeKind::Fitted),
        Some("regular") => Ok(LatticeKind::Regular),
        _ => Err(wrong("lattice", value, "\"fitted\" or \"regular\"")),
    }
}

fn correspondence(value: &Value) -> Result<Correspondence, ParamsError> {
    match value.as_str() {
        Some("paper") => Ok(Correspondence::Paper),
        Some("anchored") => Ok(Correspondence::Anchored),
        _ => Err(wrong("correspondence", value, "\"anchored\" or \"paper\"")),
    }
}

fn prune(value: &Value) -> Result<Prune, ParamsError> {
    match value {
        Value::String(text) if text == "auto" => Ok(Prune::Auto),
        Value::Number(_) => number("prune", value).map(Prune::Strength),
        _ => Err(wrong("prune", value, "\"auto\" or a number from 0 to 1")),
    }
}

fn number(field: &'static str, value: &Value) -> Result<f64, ParamsError> {
    value.as_f64().ok_or_else(|| wrong(field, value, "a number"))
}

fn count(field: &'static str, value: &Value) -> Result<usize, ParamsError> {
    let count = value.as_u64().and_then(|n| usize::try_from(n).ok());
    count.ok_or_else(|| wrong(field, value, "a whole number"))
}

fn only_known(prefix: &str, fields: &Map<String, Value>, known: &[&str]) -> Result<(), ParamsError> {
    match fields.keys().find(|name| !known.contains(&name.as_str())) {
        None => Ok(()),
        Some(name) => Err(ParamsError {
            field: format!("{prefix}{}", echo(name)).into(),
            got: "an unknown name".to_owned(),
            allowed: known.join(", "),
        }),
    }
}

fn wrong(field: &'static str, value: &Value, allowed: &str) -> ParamsError {
    let got = if value.is_null() { "nothing".to_owned() } else { echo(&value.to_string()) };
    ParamsError { field: field.into(), got, allowed: allowed.to_owned() }
}

/// The start of a text, without control characters: it ends up in a terminal.
fn echo(text: &str) -> String {
    let mut short: String = text.chars().filter(|c| !c.is_control()).take(MAX_ECHO).collect();
    if text.chars().nth(MAX_ECHO).is_some() {
        short.push('…');
    }
    short
}

/// All parameters, defaults too; [`parse`] reads it back to the same.
#[must_use]
pub fn params_to_json(params: &CheckedParams) -> Value {
    let grid = match params.grid {
        GridChoice::Fixed { rows, cols } => json!({"rows": rows, "cols": cols}),
        GridChoice::Auto => json!("auto"),
    };
    let neighbors = match params.neighbors {
        Neighbors::Auto => json!("auto"),
        Neighbors::Count(k) => json!({"k": k}),
        Neighbors::RadiusMm(radius) => json!({"epsilon_mm": radius}),
    };
    let landmarks = match params.landmarks {
        Landmarks::Auto => json!("auto"),
        Landmarks::All => json!("all"),
        Landmarks::Count(count) => json!(count),
    };
    let lattice = match params.lattice {
        LatticeKind::Fitted => "fitted",
        LatticeKind::Regular => "regular",
    };
    let correspondence = match params.correspondence {
        Correspondence::Anchored => "anchored",
        Correspondence::Paper => "paper",
    };
    let prune = match params.prune {
        Prune::Auto => json!("auto"),
        Prune::Strength(strength) => json!(strength),
    };
    json!({
        "labels": params.labels,
        "grid": grid,
        "spacing_mm": params.spacing_mm,
        "margin": params.margin,
        "neighbors": neighbors,
        "landmarks": landmarks,
        "lattice": lattice,
        "correspondence": correspondence,
        "prune": prune,
        "max_figures": params.max_figures,
        "resolution_mm": params.resolution_mm,
        "uncertainty": params.uncertainty,
    })
}

/// A JSON value in which no object has a name twice.
struct Strict(Value);

impl<'de> Deserialize<'de> for Strict {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        deserializer.deserialize_any(StrictVisitor).map(Strict)
    }
}

struct StrictVisitor;

impl<'de> Visitor<'de> for StrictVisitor {
    type Value = Value;

    fn expecting(&self, formatter: &mut fmt::Formatter) -> fmt::Result {
        formatter.write_str("JSON")
    }

    fn visit_bool<E>(self, value: bool) -> Result<Value, E> {
        Ok(value.into())
    }

    fn visit_i64<E>(self, value: i64) -> Result<Value, E> {
        Ok(value.into())
    }

    fn visit_u64<E>(self, value: u64) -> Result<Value, E> {
        Ok(value.into())
    }

    fn visit_f64<E>(self, value: f64) -> Result<Value, E> {
        Ok(value.into())
    }

    fn visit_str<E>(self, value: &str) -> Result<Value, E> {
        Ok(value.into())
    }

    fn visit_unit<E>(self) -> Result<Value, E> {
        Ok(Value::Null)
    }

    fn visit_seq<A: SeqAccess<'de>>(self, mut entries: A) -> Result<Value, A::Error> {
        let mut list = Vec::new();
        while let Some(Strict(value)) = entries.next_element()? {
            list.push(value);
        }
        Ok(list.into())
    }

    fn visit_map<A: MapAccess<'de>>(self, mut entries: A) -> Result<Value, A::Error> {
        let mut object = Map::new();
        while let Some((name, Strict(value))) = entries.next_entry::<String, Strict>()? {
            let twice = format!("the name \"{}\" is there twice", echo(&name));
            if object.insert(name, value).is_some() {
                return Err(A::Error::custom(twice));
            }
        }
        Ok(object.into())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn refused_field(text: &str) -> String {
        match parse(text.as_bytes()) {
            Err(ParamsJsonError::Field(error)) => error.field.into_owned(),
            other => panic!("{text}: {other:?}"),
        }
    }

    #[test]
    fn a_wrong_field_is_named() {
        for (text, field) in [
            (r#"{"gird": 1}"#, "gird"),
            (r#"{"grid": 6}"#, "grid"),
            (r#"{"grid": {"rows": 6}}"#, "grid.cols"),
            (r#"{"grid": {"rows": 6, "cols": 8, "x": 1}}"#, "grid.x"),
            (r#"{"grid": {"rows": 6.5, "cols": 8}}"#, "grid.rows"),
            (r#"{"grid": {"rows": 2, "cols": 8}}"#, "grid.rows"),
            (r#"{"grid": {"rows": 6, "cols": 100000}}"#, "grid.cols"),
            (r#"{"grid": null}"#, "grid"),
            (r#"{"margin": 0.9}"#, "margin"),
            (r#"{"margin": "0.1"}"#, "margin"),
            (r#"{"neighbors": {"k": 4, "epsilon_mm": 2}}"#, "neighbors"),
            (r#"{"neighbors": {"k": -4}}"#, "neighbors.k"),
            (r#"{"neighbors": {"epsilon_mm": 0}}"#, "neighbors.epsilon_mm"),
            (r#"{"landmarks": "some"}"#, "landmarks"),
            (r#"{"landmarks": 2}"#, "landmarks"),
            (r#"{"lattice": "round"}"#, "lattice"),
            (r#"{"correspondence": "nearest"}"#, "correspondence"),
            (r#"{"prune": 2}"#, "prune"),
            (r#"{"max_figures": 0}"#, "max_figures"),
            (r#"{"resolution_mm": -1}"#, "resolution_mm"),
            (r#"{"labels": [0]}"#, "labels"),
            (r#"{"labels": [1, 1]}"#, "labels"),
            (r#"{"labels": []}"#, "labels"),
            (r#"{"labels": [1.5]}"#, "labels"),
            (r#"{"labels": 1}"#, "labels"),
            (r#"{"spacing_mm": 2}"#, "spacing_mm"),
            (r#"{"uncertainty": 65}"#, "uncertainty"),
            (r#"{"uncertainty": -1}"#, "uncertainty"),
            (r#"{"uncertainty": "yes"}"#, "uncertainty"),
        ] {
            assert_eq!(refused_field(text), field, "{text}");
        }
    }

    #[test]
    fn what_is_no_object_is_malformed() {
        let deep = format!("{}{}", "[".repeat(10_000), "]".repeat(10_000));
        let long = format!("{{\"labels\": [{}]}}", " ".repeat(MAX_BYTES));
        for text in ["", "[]", "1", "{", "{\"margin\": NaN}", "{\"margin\": 1e999}", &deep, &long] {
            assert!(matches!(parse(text.as_bytes()), Err(ParamsJsonError::Syntax { .. })), "{text:.40}");
        }
        let twice = parse(br#"{"margin": 0.1, "margin": 0.2}"#).unwrap_err();
        assert!(twice.to_string().contains("\"margin\" is there twice"), "{twice}");
        assert!(parse(br#"{"grid": {"rows": 6, "rows": 6, "cols": 8}}"#).is_err());
    }

    #[test]
    fn labels_too_many_to_be_compared_are_refused_for_their_number() {
        let labels: Vec<String> = (1..2000).chain([1999]).map(|label: i64| label.to_string()).collect();
        match parse(format!("{{\"labels\": [{}]}}", labels.join(",")).as_bytes()) {
            Err(ParamsJsonError::Field(error)) => assert_eq!((&*error.field, &*error.got), ("labels", "2000")),
            other => panic!("{other:?}"),
        }
    }

    #[test]
    fn a_number_is_read_to_its_last_digit() {
        let exact = parse(br#"{"margin": 0.050000000019287325}"#).unwrap();
        assert_eq!(exact.margin.to_bits(), 0.050000000019287325_f64.to_bits());
        let tiny = parse(br#"{"margin": 2.922444426354807e-300}"#).unwrap();
        assert_eq!(parse(params_to_json(&tiny).to_string().as_bytes()).unwrap(), tiny);
    }

    #[test]
    fn parameters_come_back_as_they_went() {
        for text in [
            "{}",
            r#"{"labels": [11, -3], "grid": "auto", "spacing_mm": 2.5, "neighbors": {"k": 12}, "landmarks": "all"}"#,
            r#"{"grid": {"rows": 4, "cols": 9}, "neighbors": {"epsilon_mm": 4.0}, "landmarks": 60, "prune": 0.25}"#,
            r#"{"lattice": "regular", "correspondence": "paper", "max_figures": 3, "resolution_mm": null, "uncertainty": 16}"#,
        ] {
            let params = parse(text.as_bytes()).unwrap();
            let again = params_to_json(&params);
            assert_eq!(again.as_object().unwrap().keys().map(String::as_str).collect::<Vec<_>>(), NAMES);
            assert_eq!(parse(again.to_string().as_bytes()).unwrap(), params);
        }
    }
}
