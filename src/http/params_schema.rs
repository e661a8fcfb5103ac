//! The parameters as the API describes them. They are read and checked elsewhere; the bounds
//! here are the constants that they are checked against.

use std::borrow::Cow;

use serde::Deserialize;
use serde_json::json;
use utoipa::openapi::{RefOr, Schema};
use utoipa::{IntoParams, PartialSchema, ToSchema};

use crate::formats::readers;
use crate::params::{
    FIGURE_COUNT, LABEL_COUNT, LANDMARK_COUNT, LATTICE_SIDE, LENGTH_MM, MARGIN, NEIGHBOR_COUNT, PRUNE_STRENGTH,
    REPEAT_COUNT,
};

/// Query of a submission.
#[derive(Debug, Deserialize, IntoParams)]
#[serde(deny_unknown_fields)]
#[into_params(parameter_in = Query)]
pub struct SubmitQuery {
    /// Parameters (schema Params) as a JSON object, percent-encoded.
    #[param(example = "{\"grid\":\"auto\"}")]
    pub params: Option<String>,
    /// Labels as a JSON object of strings, percent-encoded: at most 16, to find jobs by. No patient data.
    #[param(example = "{\"study\":\"liver-07\"}")]
    pub labels: Option<String>,
    /// Where to send a webhook once the job has ended; one that the operator has listed.
    #[param(format = "uri", max_length = 2048)]
    pub callback_url: Option<String>,
}

/// The schema of a submission as a form.
pub struct FormSchema;

impl ToSchema for FormSchema {
    fn name() -> Cow<'static, str> {
        "Submission".into()
    }

    fn schemas(schemas: &mut Vec<(String, RefOr<Schema>)>) {
        schemas.push((ParamsSchema::name().into(), ParamsSchema::schema()));
    }
}

impl PartialSchema for FormSchema {
    fn schema() -> RefOr<Schema> {
        schema(json!({
            "type": "object",
            "required": ["mask"],
            "additionalProperties": false,
            "properties": {
                "mask": {
                    "type": "string", "format": "binary",
                    "description": format!("The mask: {}, plain or gzip.", readers::versions())
                },
                "params": {"$ref": "#/components/schemas/Params"},
                "labels": {
                    "type": "object", "additionalProperties": {"type": "string", "maxLength": 256}, "maxProperties": 16,
                    "propertyNames": {"type": "string", "pattern": "^[A-Za-z0-9._-]{1,64}$"},
                    "description": "To find jobs by. No patient data."
                },
                "callback_url": {
                    "type": "string", "format": "uri", "maxLength": 2048,
                    "description": "Where to send a webhook once the job has ended; one that the operator has listed."
                }
            }
        }))
    }
}

/// The schema of a body that is bytes.
pub struct BytesSchema;

impl ToSchema for BytesSchema {}

impl PartialSchema for BytesSchema {
    fn schema() -> RefOr<Schema> {
        schema(json!({"type": "string", "format": "binary"}))
    }
}

/// The schema of the parameters.
pub struct ParamsSchema;

impl ToSchema for ParamsSchema {
    fn name() -> Cow<'static, str> {
        "Params".into()
    }
}

impl PartialSchema for ParamsSchema {
    fn schema() -> RefOr<Schema> {
        schema(Self::json())
    }
}

impl ParamsSchema {
    /// It as JSON Schema, in the order in which a reader wants the parameters; the description of
    /// the API sorts them.
    pub fn json() -> serde_json::Value {
        let length = |what: &str| json!({"type": "number", "minimum": LENGTH_MM.start(), "maximum": LENGTH_MM.end(), "description": what});
        json!({
            "type": "object",
            "additionalProperties": false,
            "description": "Every parameter is optional; an unknown name, a wrong type or a value out of range is \
                            refused. Lengths are millimetres.",
            "properties": {
                "labels": {
                    "type": "array", "items": label(),
                    "uniqueItems": true,
                    "minItems": LABEL_COUNT.start(), "maxItems": LABEL_COUNT.end(),
                    "description": "Labels to work on, each one structure. Default: all that are not 0."
                },
                "grid": grid(),
                "spacing_mm": length("With grid \"auto\": geodesic distance wanted between nodes."),
                "margin": {
                    "type": "number", "minimum": MARGIN.start(), "maximum": MARGIN.end(), "default": 0.05,
                    "description": "Share of the intrinsic extent left free at each edge."
                },
                "neighbors": neighbors(),
                "landmarks": {
                    "oneOf": [
                        {"type": "string", "enum": ["auto", "all"]},
                        {"type": "integer", "minimum": LANDMARK_COUNT.start(), "maximum": LANDMARK_COUNT.end()}
                    ],
                    "default": "auto",
                    "description": "How many geodesic sources ISOMAP uses; \"all\" is exact ISOMAP."
                },
                "lattice": {
                    "type": "string", "enum": ["fitted", "regular"], "default": "fitted",
                    "description": "fitted: rows follow the sheet's own outline, so that every node lies on it. \
                                    regular: the paper's rectangle, nodes off the sheet flagged invalid."
                },
                "correspondence": {
                    "type": "string", "enum": ["anchored", "paper"], "default": "anchored",
                    "description": "How medial and surface nodes are paired. anchored: the medial lattice is \
                                    carried to both sides along the spokes of its inscribed balls. paper: three independent embeddings, \
                                    rigidly aligned, paired by (i, j)."
                },
                "prune": {
                    "oneOf": [
                        {"type": "string", "enum": ["auto"]},
                        {"type": "number", "minimum": PRUNE_STRENGTH.start(), "maximum": PRUNE_STRENGTH.end()}
                    ],
                    "default": "auto",
                    "description": "How much evidence a branch of the skeleton needs."
                },
                "max_figures": {
                    "type": "integer", "minimum": FIGURE_COUNT.start(), "maximum": FIGURE_COUNT.end(),
                    "description": "Keep at most this many sheets, the largest first."
                },
                "resolution_mm": length("Isotropic working voxel. Default: the finest spacing of the mask."),
                "uncertainty": {
                    "type": "integer", "minimum": REPEAT_COUNT.start(), "maximum": REPEAT_COUNT.end(), "default": 0,
                    "description": "How often everything is computed again with the boundary moved inside what the \
                                    voxels leave open. The spread of each node's thickness is written as its \
                                    standard deviation."
                }
            }
        })
    }
}

/// 0 is the background.
fn label() -> serde_json::Value {
    let whole = |bound: &str, value: i8| json!({"type": "integer", "format": "int64", bound: value});
    json!({"oneOf": [whole("minimum", 1), whole("maximum", -1)]})
}

fn grid() -> serde_json::Value {
    let side = json!({"type": "integer", "minimum": LATTICE_SIDE.start(), "maximum": LATTICE_SIDE.end()});
    json!({
        "oneOf": [
            {
                "type": "object", "required": ["rows", "cols"], "additionalProperties": false,
                "properties": {"rows": side, "cols": side}
            },
            {"type": "string", "enum": ["auto"]}
        ],
        "default": {"rows": 6, "cols": 8},
        "description": "N × M lattice. Rows run across the shorter intrinsic axis, cols along the longer."
    })
}

fn neighbors() -> serde_json::Value {
    let k = json!({"type": "integer", "minimum": NEIGHBOR_COUNT.start(), "maximum": NEIGHBOR_COUNT.end()});
    let epsilon = json!({"type": "number", "minimum": LENGTH_MM.start(), "maximum": LENGTH_MM.end()});
    json!({
        "oneOf": [
            {"type": "string", "enum": ["auto"]},
            {"type": "object", "required": ["k"], "additionalProperties": false, "properties": {"k": k}},
            {
                "type": "object", "required": ["epsilon_mm"], "additionalProperties": false,
                "properties": {"epsilon_mm": epsilon}
            }
        ],
        "default": "auto",
        "description": "k-ISOMAP or ε-ISOMAP."
    })
}

fn schema(json: serde_json::Value) -> RefOr<Schema> {
    RefOr::T(serde_json::from_value(json).expect("the literals above are schemas"))
}
