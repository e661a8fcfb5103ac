//! Every integration test, in one binary.

#![allow(clippy::unwrap_used, reason = "a test that cannot go on panics")]

mod support;

mod api_submit;

mod api_jobs;

mod api_results;

mod api_store;

mod api_restart;

mod api_wire;

mod api_document;

mod tidy;
