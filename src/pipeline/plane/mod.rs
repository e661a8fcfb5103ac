//! Stage 5: sheets laid flat.

pub mod isomap;

pub mod cut;

pub mod frame;

pub mod strip;
