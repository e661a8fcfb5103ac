//! Files: label maps in, medial representations out. In reading order: which formats are read, the
//! readers, the parameters, then one writer per artifact.

pub mod readers;

mod read;

pub mod write;

pub mod params_json;

mod rounded;

pub mod glb;

mod gltf_build;

mod colors;

mod mesh_parts;

mod evidence_json;
mod quality_json;

pub mod thickness_json;

pub mod tables;

#[cfg(feature = "service")]
pub(crate) use read::stream::hex;
pub use read::{HeaderFacts, InputLimits, ReadError};
pub use readers::{ReadVolume, read, read_file};
