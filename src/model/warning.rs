//! What the reader of a result should know.

use std::borrow::Cow;

use serde::{Deserialize, Serialize};

/// Something about a result that its reader should know. Codes are stable.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Warning {
    /// Stable code, snake case.
    pub code: Cow<'static, str>,
    /// One sentence, with figures.
    pub message: String,
}
