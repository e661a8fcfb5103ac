//! What the targets share.

#[path = "../tests/it/help/dicom_bytes.rs"]
mod dicom_bytes;
#[path = "memory.rs"]
pub mod memory;
#[path = "../tests/it/help/nifti_bytes.rs"]
mod nifti_bytes;
#[path = "seeds.rs"]
pub mod seeds;
#[path = "text_budget.rs"]
pub mod text_budget;
#[path = "../tests/it/help/text_bytes.rs"]
mod text_bytes;
