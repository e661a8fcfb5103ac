//! Parameters.

#![no_main]

use libfuzzer_sys::fuzz_target;

#[path = "../bodies/params.rs"]
mod body;
#[allow(dead_code, reason = "the seeds of the other targets are there too")]
#[path = "../../tests/it/help/dicom_bytes.rs"]
mod dicom_bytes;
#[path = "../memory.rs"]
mod memory;
#[allow(dead_code, reason = "the seeds of the other targets are there too")]
#[path = "../../tests/it/help/nifti_bytes.rs"]
mod nifti_bytes;
#[allow(dead_code, reason = "as above")]
#[path = "../seeds.rs"]
mod seeds;
#[allow(dead_code, reason = "as above")]
#[path = "../../tests/it/help/text_bytes.rs"]
mod text_bytes;

/// Texts of refusals, and the parameters as JSON.
const FIXED: usize = 1 << 16;
/// A value of two bytes (`1,`) takes 32 in memory, and twice as many again while its list grows.
const PER_BYTE: usize = 160;

fuzz_target!(init: seeds::write(&seeds::params()), |bytes: &[u8]| {
    memory::within(FIXED + PER_BYTE * bytes.len(), || body::check(bytes));
});
