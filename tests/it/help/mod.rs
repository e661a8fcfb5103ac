//! What tests are made of. None is in here.

pub mod left_out;

pub mod process;

pub mod nifti_bytes;

pub mod dicom_bytes;

pub mod text_bytes;

pub mod dicom_read;

pub mod phantoms;

pub mod organs;

pub mod models;

pub mod support;

pub mod published;

pub mod pacs;

pub mod reading;
