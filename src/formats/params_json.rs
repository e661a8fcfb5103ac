//! Parameters as JSON: strict in, complete out. What there are, and what each takes, stands in
//! [`crate::params::PARAMS`].

use std::collections::BTreeSet;
use std::fmt;

use serde::de::{Deserialize, Deserializer, Error as _, MapAccess, SeqAccess, Visitor};
use serde_json::{Map, Number, Value};

use crate::params::{CheckedParams, Given, PARAMS, Params, ParamsError, echo};

/// Longest text accepted: a thousand labels take 20 kB, with names of 40 letters 50 kB more.
pub const MAX_BYTES: usize = 1 << 16;

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
    match serde_json::from_slice(text) {
        Ok(Strict(Given::Object(fields))) => Ok(Params::read(&fields)?),
        Ok(_) => Err(syntax("it must be an object".to_owned())),
        Err(error) => Err(syntax(error.to_string())),
    }
}

/// All parameters, defaults too; [`parse`] reads it back to the same.
#[must_use]
pub fn params_to_json(params: &CheckedParams) -> Value {
    let mut object = Map::new();
    for param in PARAMS {
        object.insert(param.name.to_owned(), given_to_json(&param.get(params)));
    }
    object.into()
}

/// A given value as JSON.
#[must_use]
pub(crate) fn given_to_json(given: &Given) -> Value {
    match given {
        Given::Nothing => Value::Null,
        Given::Flag(flag) => Value::Bool(*flag),
        Given::Whole(whole) => Number::from_i128(*whole).map_or(Value::Null, Value::Number),
        Given::Number(number) => Value::from(*number),
        Given::Text(text) => Value::from(text.as_str()),
        Given::List(entries) => entries.iter().map(given_to_json).collect(),
        Given::Object(entries) => {
            let mut object = Map::new();
            for (name, value) in entries {
                object.insert(name.clone(), given_to_json(value));
            }
            object.into()
        }
    }
}

/// A value read from JSON in which no object has a name twice.
struct Strict(Given);

impl<'de> Deserialize<'de> for Strict {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        deserializer.deserialize_any(StrictVisitor).map(Strict)
    }
}

struct StrictVisitor;

impl<'de> Visitor<'de> for StrictVisitor {
    type Value = Given;

    fn expecting(&self, formatter: &mut fmt::Formatter) -> fmt::Result {
        formatter.write_str("JSON")
    }

    fn visit_bool<E>(self, value: bool) -> Result<Given, E> {
        Ok(Given::Flag(value))
    }

    fn visit_i64<E>(self, value: i64) -> Result<Given, E> {
        Ok(Given::Whole(value.into()))
    }

    fn visit_u64<E>(self, value: u64) -> Result<Given, E> {
        Ok(Given::Whole(value.into()))
    }

    fn visit_f64<E>(self, value: f64) -> Result<Given, E> {
        Ok(Given::Number(value))
    }

    fn visit_str<E>(self, value: &str) -> Result<Given, E> {
        Ok(Given::text(value))
    }

    fn visit_unit<E>(self) -> Result<Given, E> {
        Ok(Given::Nothing)
    }

    fn visit_seq<A: SeqAccess<'de>>(self, mut entries: A) -> Result<Given, A::Error> {
        let mut list = Vec::new();
        while let Some(Strict(value)) = entries.next_element()? {
            list.push(value);
        }
        Ok(Given::List(list))
    }

    fn visit_map<A: MapAccess<'de>>(self, mut entries: A) -> Result<Given, A::Error> {
        let mut object = Vec::new();
        let mut seen = BTreeSet::new();
        while let Some((name, Strict(value))) = entries.next_entry::<String, Strict>()? {
            if !seen.insert(name.clone()) {
                return Err(A::Error::custom(format!("the name \"{}\" is there twice", echo(&name))));
            }
            object.push((name, value));
        }
        Ok(Given::Object(object))
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
            (r#"{"grid": {"rows": 6, "cols": 8}, "spacing_mm": 2}"#, "spacing_mm"),
            (r#"{"uncertainty": 65}"#, "uncertainty"),
            (r#"{"uncertainty": -1}"#, "uncertainty"),
            (r#"{"uncertainty": "yes"}"#, "uncertainty"),
            (r#"{"uncertainty": null}"#, "uncertainty"),
            (r#"{"embedding": "umap"}"#, "embedding"),
            (r#"{"names": []}"#, "names"),
            (r#"{"names": {"0": "background"}}"#, "names.0"),
            (r#"{"names": {"011": "left caudate"}}"#, "names.011"),
            (r#"{"names": {"left": "11"}}"#, "names.left"),
            (r#"{"names": {"11": " "}}"#, "names.11"),
            (r#"{"names": {"11": "a\nb"}}"#, "names.11"),
            (r#"{"names": {"11": 11}}"#, "names.11"),
            (r#"{"outputs": []}"#, "outputs"),
            (r#"{"outputs": ["model.stl"]}"#, "outputs"),
            (r#"{"outputs": ["model.glb", "model.glb"]}"#, "outputs"),
            (r#"{"outputs": "model.glb"}"#, "outputs"),
        ] {
            assert_eq!(refused_field(text), field, "{text}");
        }
    }

    #[test]
    fn a_refusal_says_what_was_given_and_all_that_is_allowed() {
        for (text, told) in [
            (r#"{"margin": "0.1"}"#, "margin: got \"0.1\", allowed is a number from 0 to 0.4"),
            (r#"{"margin": 0.9}"#, "margin: got 0.9, allowed is 0 to 0.4"),
            (r#"{"margin": 1e300}"#, "margin: got 1e300, allowed is 0 to 0.4"),
            (r#"{"prune": []}"#, "prune: got [], allowed is \"auto\" or a number from 0 to 1"),
            (
                r#"{"landmarks": 1.5}"#,
                "landmarks: got 1.5, allowed is \"auto\", \"all\" or a whole number from 8 to 20000",
            ),
            (
                r#"{"grid": {"rows": 6}}"#,
                "grid.cols: got nothing, allowed is {\"rows\": 3 to 512, \"cols\": 3 to 512} or \"auto\"",
            ),
            (r#"{"grid": {"rows": 2, "cols": 8}}"#, "grid.rows: got 2, allowed is 3 to 512"),
            (r#"{"grid": {"x": 8}}"#, "grid.x: got an unknown name, allowed is rows, cols"),
            (
                r#"{"labels": [1, 1]}"#,
                "labels: got 1, allowed is a list of 1 to 1024 whole numbers other than 0, each once",
            ),
            (r#"{"labels": [0]}"#, "labels: got 0, allowed is labels other than 0, the background"),
            (
                r#"{"names": {"11": ""}}"#,
                "names.11: got \"\", allowed is a text of 1 to 80 characters, none of them a control character",
            ),
        ] {
            assert_eq!(parse(text.as_bytes()).unwrap_err().to_string(), told);
        }
    }

    #[test]
    fn a_name_has_no_more_characters_than_are_allowed_and_there_are_no_more_than_are_allowed() {
        let named = |name: &str| parse(format!("{{\"names\": {{\"-3\": \"{name}\"}}}}").as_bytes());
        assert_eq!(named(&format!("  {} ", "é".repeat(80))).unwrap().names[&-3], "é".repeat(80));
        assert!(named(&"é".repeat(81)).is_err());
        let names = |count: usize| {
            let entries: Vec<String> = (1..=count).map(|label| format!("\"{label}\":\"x\"")).collect();
            parse(format!("{{\"names\": {{{}}}}}", entries.join(",")).as_bytes())
        };
        assert_eq!(names(1024).unwrap().names.len(), 1024);
        assert!(names(1025).is_err());
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
        assert_eq!(exact.margin.map(f64::to_bits), Some(0.050000000019287325_f64.to_bits()));
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
            r#"{"embedding": "laplacian", "names": {"11": "left caudate", "-3": "\u00e9"}, "outputs": ["points.csv"]}"#,
        ] {
            let params = parse(text.as_bytes()).unwrap();
            let again = params_to_json(&params);
            let names: Vec<&str> = PARAMS.iter().map(|param| param.name).collect();
            assert_eq!(again.as_object().unwrap().keys().map(String::as_str).collect::<Vec<_>>(), names);
            assert_eq!(parse(again.to_string().as_bytes()).unwrap(), params);
        }
    }
}
