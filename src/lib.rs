//! Medial shape representation of anatomy: a label map goes in; the medial sheet, the upper and
//! lower surfaces and the thickness vectors between them come out, after A. D. Ward and
//! G. Hamarneh, *3D surface parameterization using manifold learning for medial shape
//! representation*, Proc. SPIE 6512, 65120X (2007).
//!
//! # Architecture
//!
//! ```text
//!  mask.nii.gz                                              model.glb  thickness.json  *.csv
//!      │                                                        ▲
//!      ▼                                                        │
//!  formats::read ──► LabelVolume ──► pipeline::run ──► Model ──► formats::{glb, thickness_json, tables}
//!                                        │
//!       mask ─ depth ─ medial ─ sheets ─ sides ─ isomap ─ frame, outline, lattice ─ spokes ─ quality
//! ```
//!
//! `jobs::process` is that line from file to files. `medialrep run` calls it once; the service
//! calls it from its workers. The page that people see is in `web`: npm builds it, `http::web` serves
//! it, and it knows of the service what `openapi.yaml` says.
//!
//! Dependencies point one way: `cli → http → jobs → {audit, webhook, formats, pipeline} → numerics → space`.
//! `pipeline`, `numerics` and `space` know no web framework, no serialisation, no file system and
//! no environment; a test holds that. A stage is a plain function over plain data; progress and
//! cancelling go through [`pipeline::observer::Observer`], warnings are returned.
//!
//! # Spaces and units
//!
//! *World* is NIfTI's RAS+ in millimetres. *Work* is the voxel grid of one structure, isotropic and
//! orthogonal, in voxels ([`pipeline::mask::Solid::world_from_work`] leads out of it). *Plane* is a
//! flattened surface, in voxels until it is handed out in mm. Names say which, where it matters.
//!
//! # Invariants
//!
//! - Equal input gives equal bytes at any number of threads: no hash-map order reaches an output,
//!   floats are ordered totally, structures are computed apart.
//! - A checked thing is another type: `Params → CheckedParams`, bytes → `LabelVolume`.
//! - Nothing in a header makes the reader reserve memory that the file does not fill.
//! - A shape without a medial sheet is an answer ([`pipeline::refusal::Refusal`]), not a failure.
//! - A result whose thickness vectors cross is never called a pass.
//!
//! Modules in reading order:

pub mod cancel;

pub mod space;

pub mod numerics;

pub mod samples;

pub mod params;

pub mod model;

pub mod pipeline;

pub mod formats;

#[cfg(feature = "service")]
pub mod problem;

#[cfg(feature = "service")]
pub mod webhook;

#[cfg(feature = "service")]
pub mod audit;

#[cfg(feature = "service")]
pub mod metrics;

#[cfg(feature = "service")]
pub mod jobs;

#[cfg(feature = "service")]
pub mod http;

#[cfg(feature = "service")]
pub mod config;

#[cfg(feature = "service")]
pub mod cli;
