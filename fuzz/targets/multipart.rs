//! Forms, through the service.

#![no_main]

use std::sync::LazyLock;

use libfuzzer_sys::fuzz_target;

use self::common::{memory, seeds};

#[path = "../bodies/multipart.rs"]
mod body;
#[allow(dead_code, reason = "each target needs some of it")]
#[path = "../common.rs"]
mod common;

/// Buffers of the header check, and the connections to the database.
const FIXED: usize = 1 << 19;
/// Parameters take most, see there; a form is also kept as a whole and in pieces.
const PER_BYTE: usize = 192;

static FORMS: LazyLock<body::Forms> = LazyLock::new(body::Forms::open);

fuzz_target!(init: { seeds::write(&seeds::multipart()); LazyLock::force(&FORMS) }, |bytes: &[u8]| {
    memory::within(FIXED + PER_BYTE * bytes.len(), || FORMS.check(bytes));
});
