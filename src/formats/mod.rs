//! File formats and JSON forms.

pub mod params_json;
