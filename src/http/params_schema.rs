//! The parameters as the API describes them: the table that they are read and checked by, as JSON Schema.

use std::borrow::Cow;

use serde::Deserialize;
use serde_json::{Map, Value, json};
use utoipa::openapi::{RefOr, Schema};
use utoipa::{IntoParams, PartialSchema, ToSchema};

use crate::formats::params_json::given_to_json;
use crate::formats::readers;
use crate::params::{Given, PARAMS, Param, Shape};

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
    /// The PACS that DICOM results are stored in once the job has succeeded, by the name that the operator gave it. For
    /// DICOM segmentations: results get patient and study from them.
    #[param(example = "main", max_length = 64)]
    pub deliver_to: Option<String>,
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
                "labels": labels(),
                "callback_url": callback_url(),
                "deliver_to": deliver_to()
            }
        }))
    }
}

fn labels() -> Value {
    json!({
        "type": "object", "additionalProperties": {"type": "string", "maxLength": 256}, "maxProperties": 16,
        "propertyNames": {"type": "string", "pattern": "^[A-Za-z0-9._-]{1,64}$"},
        "description": "To find jobs by. No patient data."
    })
}

fn callback_url() -> Value {
    json!({
        "type": "string", "format": "uri", "maxLength": 2048,
        "description": "Where to send a webhook once the job has ended; one that the operator has listed."
    })
}

fn deliver_to() -> Value {
    json!({
        "type": "string", "maxLength": 64,
        "description": "The PACS that DICOM results are stored in once the job has succeeded, by the name that the operator gave it."
    })
}

/// The schema of a submission that says where its mask is.
pub struct SourceSchema;

impl ToSchema for SourceSchema {
    fn name() -> Cow<'static, str> {
        "SourceSubmission".into()
    }

    fn schemas(schemas: &mut Vec<(String, RefOr<Schema>)>) {
        schemas.push((ParamsSchema::name().into(), ParamsSchema::schema()));
    }
}

impl PartialSchema for SourceSchema {
    fn schema() -> RefOr<Schema> {
        let uid = |about: &str| json!({"type": "string", "maxLength": 64, "pattern": "^[0-9]+([.][0-9]+)*$", "description": about});
        let dicomweb = json!({
            "type": "object",
            "required": ["server", "study", "series"],
            "additionalProperties": false,
            "properties": {
                "server": {"type": "string", "description": "A PACS, by the name that the operator gave it (`--pacs`)."},
                "study": uid("Study Instance UID."),
                "series": uid("Series Instance UID."),
                "instance": uid("SOP Instance UID; may be left out where the series has one segmentation.")
            }
        });
        schema(json!({
            "type": "object",
            "required": ["source"],
            "additionalProperties": false,
            "properties": {
                "source": {
                    "type": "object", "required": ["dicomweb"], "additionalProperties": false,
                    "properties": {"dicomweb": dicomweb}
                },
                "params": {"$ref": "#/components/schemas/Params"},
                "labels": labels(),
                "callback_url": callback_url(),
                "deliver_to": deliver_to()
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
    pub fn json() -> Value {
        let mut properties = Map::new();
        for param in PARAMS {
            properties.insert(param.name.to_owned(), property(param));
        }
        json!({
            "type": "object",
            "additionalProperties": false,
            "description": "Every parameter is optional; an unknown name, a wrong type or a value out of range is \
                            refused. Lengths are millimetres.",
            "properties": properties
        })
    }
}

/// One parameter: its shapes, its default if it has one, what it does.
fn property(param: &Param) -> Value {
    let mut property = match param.shapes {
        [only] => shape(only),
        several => json!({"oneOf": several.iter().map(shape).collect::<Vec<_>>()}),
    };
    match param.default_value() {
        Given::Nothing => {}
        default => property["default"] = given_to_json(&default),
    }
    property["description"] = param.about.into();
    property
}

/// What matches the values that have this shape.
fn shape(shape: &Shape) -> Value {
    match shape {
        Shape::Words(words) => json!({"type": "string", "enum": words}),
        Shape::Count(range) => json!({"type": "integer", "minimum": range.start(), "maximum": range.end()}),
        Shape::Number(range) => json!({"type": "number", "minimum": range.start(), "maximum": range.end()}),
        Shape::Label => label(),
        Shape::Fields(fields) => object(fields),
        Shape::List { of, lengths } => json!({
            "type": "array", "items": self::shape(of), "uniqueItems": true,
            "minItems": lengths.start(), "maxItems": lengths.end()
        }),
        Shape::Texts { chars, lengths } => json!({
            "type": "object", "minProperties": lengths.start(), "maxProperties": lengths.end(),
            "propertyNames": {"type": "string", "pattern": LABEL_TEXT},
            "additionalProperties": {
                "type": "string", "pattern": PRINTED, "minLength": chars.start(), "maxLength": chars.end()
            }
        }),
    }
}

/// A label in digits; those of 19, the largest that fit 64 bits, are taken too.
const LABEL_TEXT: &str = "^-?[1-9][0-9]{0,17}$";
/// No control characters, and not blank.
const PRINTED: &str = r"^[^\u0000-\u001f\u007f-\u009f]*[^\s\u0000-\u001f\u007f-\u009f][^\u0000-\u001f\u007f-\u009f]*$";

/// 0 is the background.
fn label() -> Value {
    let whole = |bound: &str, value: i8| json!({"type": "integer", "format": "int64", bound: value});
    json!({"oneOf": [whole("minimum", 1), whole("maximum", -1)]})
}

/// All of these properties, and no others.
fn object(fields: &[(&str, Shape)]) -> Value {
    let mut properties = Map::new();
    for (name, part) in fields {
        properties.insert((*name).to_owned(), shape(part));
    }
    let names: Vec<&str> = fields.iter().map(|(name, _)| *name).collect();
    json!({"type": "object", "required": names, "additionalProperties": false, "properties": properties})
}

fn schema(json: Value) -> RefOr<Schema> {
    RefOr::T(serde_json::from_value(json).expect("what is made above is a schema"))
}
