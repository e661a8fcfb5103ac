//! What a user is told when something cannot be done: RFC 9457 problem details, the same on the
//! command line and over HTTP.

use std::io;

use serde::{Deserialize, Serialize};

use crate::formats::ReadError;
use crate::formats::params_json::ParamsJsonError;
use crate::model::Refusal;
use crate::params::ParamsError;

/// A problem object (RFC 9457) with a stable code, a place and a hint.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, utoipa::ToSchema)]
#[schema(example = json!({
    "type": "urn:medialrep:problem:bad_dimensions", "title": "Bad dimensions", "status": 400, "code": "bad_dimensions",
    "detail": "dimension 1 is -3, allowed is 1 to 32767", "location": "header.dim[1]",
    "hint": "write the file again with the right header", "retryable": false,
    "trace_id": "0af7651916cd43dd8448eb211c80319c"
}))]
pub struct Problem {
    /// `urn:medialrep:problem:` and the code.
    #[serde(rename = "type")]
    pub kind: String,
    /// The code in words; the same for every problem of this code.
    pub title: String,
    /// HTTP status.
    pub status: u16,
    /// Stable code, snake case, to switch on.
    pub code: String,
    /// What was wrong this time, with figures. Never holds text from the file.
    pub detail: String,
    /// Where: a field (`params.grid.rows`), a header field (`header.dim[3]`), a byte offset.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub location: Option<String>,
    /// What to do.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub hint: Option<String>,
    /// Whether the same request may succeed later.
    pub retryable: bool,
    /// Trace of the request: the log's lines about it have it too.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub trace_id: Option<String>,
}

impl Problem {
    /// A problem with a status, a code and a sentence.
    #[must_use]
    pub fn new(status: u16, code: &str, detail: impl Into<String>) -> Self {
        let words = code.replace('_', " ");
        let title = words.chars().take(1).flat_map(char::to_uppercase).chain(words.chars().skip(1)).collect();
        Self {
            kind: format!("urn:medialrep:problem:{code}"),
            title,
            status,
            code: code.to_owned(),
            detail: detail.into(),
            location: None,
            hint: None,
            retryable: matches!(status, 429 | 503 | 507),
            trace_id: None,
        }
    }

    /// Says where.
    #[must_use]
    pub fn at(mut self, location: impl Into<String>) -> Self {
        self.location = Some(location.into());
        self
    }

    /// Says what to do.
    #[must_use]
    pub fn hint(mut self, hint: impl Into<String>) -> Self {
        self.hint = Some(hint.into());
        self
    }

    /// Whether it is the server's fault, not that of what was sent.
    #[must_use]
    pub fn is_our_fault(&self) -> bool {
        self.status >= 500
    }

    /// A file that cannot be written: no room, or our fault.
    #[must_use]
    pub fn of_storage(error: &io::Error) -> Self {
        if is_full(error) { Self::storage_full() } else { Self::internal() }
    }

    /// No room for what was to be written.
    #[must_use]
    pub fn storage_full() -> Self {
        Self::new(507, "storage_full", "the server has no room for more").hint("delete jobs, or try later")
    }

    /// Our fault; the sentence says nothing of the inside.
    #[must_use]
    pub fn internal() -> Self {
        Self::new(500, "internal", "the server failed; its log has the cause")
    }
}

/// Whether there was no room for what was to be written.
#[must_use]
pub fn is_full(error: &io::Error) -> bool {
    matches!(error.kind(), io::ErrorKind::StorageFull | io::ErrorKind::QuotaExceeded)
}

impl From<&Refusal> for Problem {
    fn from(refusal: &Refusal) -> Self {
        Self::new(422, refusal.code(), refusal.to_string()).hint(refusal.hint())
    }
}

impl From<&ParamsError> for Problem {
    fn from(error: &ParamsError) -> Self {
        Self::new(422, "invalid_params", error.to_string())
            .at(format!("params.{}", error.field))
            .hint(format!("allowed is {}", error.allowed))
    }
}

impl From<&ReadError> for Problem {
    fn from(error: &ReadError) -> Self {
        if matches!(error, ReadError::Io(_) | ReadError::Cancelled(_)) {
            return Self::internal();
        }
        Self::new(error.status(), error.code(), error.to_string()).at(error.location()).hint(error.hint())
    }
}

impl From<&ParamsJsonError> for Problem {
    fn from(error: &ParamsJsonError) -> Self {
        match error {
            ParamsJsonError::Syntax { .. } => Self::new(400, "malformed_params", error.to_string())
                .at("params")
                .hint("send one JSON object, such as {\"grid\": {\"rows\": 6, \"cols\": 8}}"),
            ParamsJsonError::Field(error) => Self::from(error),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::formats::params_json::parse;

    #[test]
    fn an_unknown_correspondence_is_refused_with_those_there_are() {
        let problem = Problem::from(&parse(br#"{"correspondence": "nearest"}"#).unwrap_err());
        assert_eq!((problem.status, problem.code.as_str()), (422, "invalid_params"));
        assert_eq!(problem.location.as_deref(), Some("params.correspondence"));
        assert!(problem.detail.contains("\"anchored\" or \"paper\""), "{}", problem.detail);
    }
}
