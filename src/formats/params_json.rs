//! Parameters as JSON.

use crate::pipeline::params::{CheckedParams, Params, ParamsError};

/// Reads a JSON object of parameters.
///
/// # Errors
/// When it is anything but an empty object.
pub fn parse(json: &[u8]) -> Result<CheckedParams, ParamsError> {
    match serde_json::from_slice::<serde_json::Value>(json) {
        Ok(serde_json::Value::Object(map)) if map.is_empty() => Params::default().check(),
        _ => Err(ParamsError { field: "params", got: "something else".into(), allowed: "an empty object".into() }),
    }
}
