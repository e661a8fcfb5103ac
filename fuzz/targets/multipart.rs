//! Forms, through the service.

#![no_main]

use std::sync::LazyLock;

use libfuzzer_sys::fuzz_target;

#[path = "../bodies/multipart.rs"]
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

/// Buffers of the header check, and the connections to the database.
const FIXED: usize = 1 << 19;
/// Parameters take most, see there; a form is also kept as a whole and in pieces.
const PER_BYTE: usize = 192;

static FORMS: LazyLock<body::Forms> = LazyLock::new(body::Forms::open);

fuzz_target!(init: { seeds::write(&seeds::multipart()); LazyLock::force(&FORMS) }, |bytes: &[u8]| {
    memory::within(FIXED + PER_BYTE * bytes.len(), || FORMS.check(bytes));
});
