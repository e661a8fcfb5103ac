//! Every integration test, in one binary.

#![allow(
    clippy::unwrap_used,
    clippy::print_stdout,
    reason = "a test fails by panicking and says in plain text what it left out; helpers count as tests"
)]

mod nifti_bytes;

mod models;

mod formats_nifti;

mod formats_nifti_refused;

mod formats_real_files;

mod formats_artifacts;

mod formats_glb;

mod jobs_process;

mod cli_run;

mod phantoms;

mod pipeline_shapes;

mod pipeline_input;

mod pipeline_stages;
