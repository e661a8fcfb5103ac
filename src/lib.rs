//! Medial shape representation of anatomy.

pub mod space;

pub mod numerics;

pub mod pipeline;

pub mod problem;

pub mod jobs;
