//! Bodies of DICOMweb.

#![no_main]

use libfuzzer_sys::fuzz_target;

use self::common::{memory, seeds};

#[path = "../bodies/related.rs"]
mod body;
#[allow(dead_code, reason = "each target needs some of it")]
#[path = "../common.rs"]
mod common;

/// Buffers of the streams.
const FIXED: usize = 1 << 14;
/// The data as it was sent, as it came in one piece and in several, and a list entry for a part of few bytes.
const PER_BYTE: usize = 64;

fuzz_target!(init: seeds::write(&seeds::related()), |bytes: &[u8]| {
    memory::within(FIXED + PER_BYTE * bytes.len(), || body::check(bytes));
});
