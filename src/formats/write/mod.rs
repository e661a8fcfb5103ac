//! Medial representations out: a file per artifact, each a plain function from a model to bytes.
//! [`super::artifacts`] lists them.

mod rounded;

mod colors;

mod gltf;

mod ordered;

pub mod glb;

pub mod thickness;

pub mod tables;

pub mod record;

pub mod nifti;

#[cfg(feature = "service")]
pub(crate) use rounded::round;
