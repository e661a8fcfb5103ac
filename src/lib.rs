//! Medial shape representation of anatomy.

pub mod space;

pub mod numerics;

pub mod samples;

pub mod pipeline;

pub mod problem;

pub mod formats;

pub mod jobs;

pub mod http;

pub mod config;

pub mod cli;
