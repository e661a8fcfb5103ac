//! Medial representations out: a file per artifact, each a plain function from a model to bytes.
//! [`super::artifacts`] lists them.

mod rounded;

mod colors;

mod gltf;

mod ordered;

mod dates;

mod report;

mod png;

mod pdf;

pub mod stl;

pub mod glb;

pub mod thickness;

pub mod tables;

pub mod picture;

pub mod dicom;

pub mod record;

pub mod nifti;

#[cfg(feature = "service")]
pub(crate) use rounded::round;
