//! Medial shape representation of anatomy: a label map goes in; the medial sheets, their upper and
//! lower surfaces and the thickness vectors between them come out, after A. D. Ward and
//! G. Hamarneh, *3D surface parameterization using manifold learning for medial shape
//! representation*, Proc. SPIE 6512, 65120X (2007).
//!
//! ```
//! use medialrep::params::Params;
//! use medialrep::samples::by_name;
//! use nalgebra::Rotation3;
//!
//! let sample = by_name("slab").expect("a sample of that name");
//! let volume = sample.voxelise([1.0; 3], Rotation3::identity())?;
//! let model = medialrep::run(&volume, &Params::default())?;
//!
//! let structure = &model.structures[0];
//! let sheet = structure.sheets().next().expect("a slab is one sheet");
//! println!("{} nodes, {}", sheet.medial.len(), structure.quality.verdict.name());
//! let thickness = structure.thickness_summary().total_mm.expect("it has an area");
//! assert!((thickness.p50 - 7.0).abs() < 0.3, "the slab is 7 mm thick");
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! Files are read with [`formats::read_file`], written with the entries of [`formats::artifacts`]. The examples
//! `mask_to_model`, `own_observer` and `thickness_table` go on from here. Without the feature `service` the crate is
//! this library alone.
//!
//! # The rooms
//!
//! ```text
//!  mask.nii.gz                                        model.glb  thickness.json  *.csv
//!      │                                                  ▲
//!      ▼                                                  │
//!  formats::readers ──► LabelVolume ──► pipeline ──► Model ──► formats::artifacts
//!                                          │
//!               solid ─ medial ─ sheets ─ sides ─ plane ─ lattice ─ vectors ─ quality
//! ```
//!
//! [`drawing`] makes pictures of a model, for documents and reports: `formats::write::report` lays them out with the numbers,
//! and PNG, PDF and DICOM are written of its pages.
//!
//! The folders of [`pipeline`] are the boxes of the paper's figure 2, and the quality, which the paper has not; its
//! `stages` have their order. `jobs::process` is
//! the line from file to files: `medialrep run` calls it once, the service calls it from its workers. The page that
//! people see is in `web`: npm builds it, `http::web` serves it, and it knows of the service what `openapi.yaml` says.
//!
//! Dependencies point one way: `cli → http → jobs → {audit, webhook, dicomweb, formats, pipeline} → {drawing, model} → {params,
//! numerics} → space`, and `drawing → model`. `pipeline`, `numerics` and `space` know no web framework, no file system and no environment; a test holds
//! that. Stages are plain functions over plain data with one [`pipeline::context::Context`]; progress and cancelling go
//! through [`pipeline::observer::Observer`].
//!
//! # Spaces and units
//!
//! *World* is NIfTI's RAS+ in millimetres. *Work* is the voxel grid of one structure, isotropic and
//! orthogonal, in voxels. *Plane* is a flattened surface, in voxels until it is handed out in mm. Names say which,
//! where it matters.
//!
//! # Glossary
//!
//! - *Medial surface*: the centres of all balls inside an object that touch its boundary in two places or more
//!   (Blum). *Medial sheet*: a part of it without a branch.
//! - *Figure*: a part of an organ that is represented by itself. A *hinge* or *junction* is where figures meet.
//! - *Crest*: the curve on the boundary where its upper and its lower side meet.
//! - *Spoke* or *thickness vector*: from a medial node to the corresponding node of a side; its length is the
//!   paper's thickness. *Medial radius*: that of the largest ball inside the object at a medial node.
//! - *Embedding*: a surface laid flat (ISOMAP, LLE, Laplacian eigenmaps). *Geodesic*: the shortest way along a
//!   surface. *Residual variance*: what part of the geodesic distances the plane does not tell (Tenenbaum et al.).
//!   *Turned over*: of a part of a surface whose plane shows its back. *Unrolled*: of a bowl that was laid flat by an
//!   injective map of its mesh, since ISOMAP cannot.
//! - *Lattice*: the grid of nodes over a flattened sheet, `rows` across and `cols` along. *Ring*: the nodes round its
//!   edge. *Cell*: what a medial quad and its surface quad enclose; *wedge*: the same at the crest. A *fold* is a
//!   corner of a cell that is turned inside out: there vectors cross.
//! - *Anchored*: of sides whose nodes are carried from the medial sheet; *paper*: of sides that are laid flat on
//!   their own.
//! - *Structure*: all of one label. *Verdict*: pass, warn or fail, from a table of thresholds. *Refusal*: why a shape
//!   has no medial representation.
//!
//! # Invariants
//!
//! - Equal input gives equal bytes at any number of threads: no hash-map order reaches an output,
//!   floats are ordered totally, structures are computed apart.
//! - A checked thing is another type: `Params → CheckedParams`, bytes → `LabelVolume`.
//! - Nothing in a header makes the reader reserve memory that the file does not fill.
//! - A shape without a medial sheet is an answer ([`model::Refusal`]), not a failure.
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

pub mod drawing;

pub mod formats;

mod run;

pub use run::{RunError, run};

#[cfg(feature = "service")]
pub mod problem;

#[cfg(feature = "service")]
mod media_type;

#[cfg(feature = "service")]
mod name;

#[cfg(feature = "service")]
mod outbound;

#[cfg(feature = "service")]
pub mod webhook;

#[cfg(feature = "service")]
pub mod dicomweb;

#[cfg(feature = "service")]
pub mod audit;

#[cfg(feature = "service")]
pub mod metrics;

#[cfg(feature = "service")]
pub mod jobs;

#[cfg(feature = "service")]
pub mod isolation;

#[cfg(feature = "service")]
pub mod http;

#[cfg(feature = "service")]
pub mod config;

#[cfg(feature = "service")]
pub mod cli;
