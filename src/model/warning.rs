//! What the reader of a result should know.

/// Something about a result that its reader should know. Codes are stable.
#[derive(Clone, Debug, PartialEq)]
pub struct Warning {
    /// Stable code, snake case.
    pub code: &'static str,
    /// One sentence, with figures.
    pub message: String,
}
