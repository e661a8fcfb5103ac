//! The pipeline of Ward and Hamarneh (Proc. SPIE 6512, 2007): a label map goes in, a medial
//! representation comes out. A folder for each box of their figure 2, and one for the quality of
//! the result, which they have not; `stages` has their order.

pub mod observer;

pub mod context;

pub mod progress;

pub mod solid;

pub mod surface;

pub mod medial;

pub mod sheets;

pub mod sides;

pub mod plane;

pub mod kind;

pub mod chart;

pub mod cutting;

pub mod lattice;

pub mod vectors;

pub mod tubes;

pub mod draft;

mod division;

mod soundness;

pub mod quality;

mod hand_out;

mod stages;

mod choice;

mod repeats;

mod levels;

mod run;

use crate::cancel::Cancelled;
use crate::model::Refusal;

pub use run::run;

/// Why a run ends without a model.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum PipelineError {
    /// The observer asked to stop.
    #[error(transparent)]
    Cancelled(#[from] Cancelled),
    /// No structure has a medial representation; the reason of the first.
    #[error(transparent)]
    Refused(#[from] Refusal),
}
