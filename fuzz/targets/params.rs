//! Parameters.

#![no_main]

use libfuzzer_sys::fuzz_target;

use self::common::{memory, seeds};

#[path = "../bodies/params.rs"]
mod body;
#[allow(dead_code, reason = "each target needs some of it")]
#[path = "../common.rs"]
mod common;

/// Texts of refusals, and the parameters as JSON.
const FIXED: usize = 1 << 16;
/// A value of two bytes (`1,`) takes 32 in memory, and twice as many again while its list grows.
const PER_BYTE: usize = 160;

fuzz_target!(init: seeds::write(&seeds::params()), |bytes: &[u8]| {
    memory::within(FIXED + PER_BYTE * bytes.len(), || body::check(bytes));
});
