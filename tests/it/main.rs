//! Every integration test, in one binary.

#![allow(
    clippy::unwrap_used,
    clippy::print_stdout,
    reason = "a test fails by panicking and says in plain text what it left out; helpers count as tests"
)]

#[path = "../measure/mod.rs"]
mod measure;

mod help;

mod formats_nifti;

mod formats_nifti_refused;

mod formats_dicom;

mod formats_dicom_refused;

mod formats_dicom_hostile;

mod formats_nrrd;

mod formats_metaimage;

mod formats_text_refused;

mod formats_real_files;

mod fuzz_corpus;

mod formats_artifacts;

mod params_told;

mod formats_glb;

mod formats_pages;

mod formats_dicom_results;

mod jobs_process;

mod jobs_blobs;

mod jobs_versions;

mod cli_run;

mod first_contact;

mod pipeline_shapes;

mod accuracy;

mod paper;

mod golden;

mod pipeline_input;

mod pipeline_stages;

mod pipeline_embedding;

mod pipeline_strip;

mod pipeline_frame;

mod pipeline_cancel;

mod pipeline_refusals;

mod pipeline_anchored;
mod pipeline_auto;
mod pipeline_cut;
mod pipeline_division;

mod pipeline_bowls;
mod pipeline_rings;

mod pipeline_grain;

mod pipeline_kept;

mod pipeline_legality;

mod pipeline_folds;

mod pipeline_paper;

mod pipeline_kinds;
mod pipeline_tubes;
mod pipeline_uncertainty;

mod pipeline_quality;

mod cli_serve;

mod audit_log;

mod isolation;

mod soak;

mod soak_hostile;
mod soak_pair;

mod api_submit;

mod api_service;

mod api_access;

mod api_webhooks;

mod api_sources;

mod api_stow;

mod api_deliver;

mod api_qido;

mod api_wado;

mod cli_operate;

mod patient_text;

mod api_jobs;

mod api_results;

mod jobs_store;

mod api_restart;

mod api_wire;

mod api_document;

mod api_page;

mod api_samples;

mod webhooks_send;

mod tidy;
