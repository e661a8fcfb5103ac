//! The whole library in one call.

use crate::model::Model;
use crate::params::{Params, ParamsError};
use crate::pipeline::observer::Silent;
use crate::pipeline::{self, PipelineError};
use crate::space::LabelVolume;

/// Why there is no model.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum RunError {
    /// A parameter is out of range.
    #[error(transparent)]
    Params(#[from] ParamsError),
    /// No structure has a medial representation.
    #[error(transparent)]
    Pipeline(#[from] PipelineError),
}

/// Represents every label of a volume, on the threads of the rayon pool. [`pipeline::run`] does the same with
/// parameters that are checked already, and with somebody who listens and may stop it.
///
/// # Errors
/// When a parameter is out of range, a label asked for is missing, or every structure is refused. One structure that
/// is refused does not spoil the others: it is in the model with its refusal.
pub fn run(volume: &LabelVolume, params: &Params) -> Result<Model, RunError> {
    let params = params.clone().check()?;
    Ok(pipeline::run(volume, &params, &Silent)?)
}
