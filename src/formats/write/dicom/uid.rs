//! UIDs that follow from what they name: the same result has the same ones wherever and whenever it is written, so that an
//! archive that gets it twice keeps it once.

use sha2::{Digest, Sha256};

use crate::formats::params_json::params_to_json;
use crate::formats::write::record::Record;

/// The writer of the files.
pub(super) const IMPLEMENTATION: &str = "2.25.244263215943290127190866291538221305091";

/// A UID of the mask, the parameters, the program and what is named. Which files are asked for is no part of it.
pub(super) fn of(record: &Record, what: &str) -> String {
    let mut params = params_to_json(&record.model.params);
    if let Some(params) = params.as_object_mut() {
        params.remove("outputs");
    }
    let program = concat!(env!("CARGO_PKG_NAME"), " ", env!("CARGO_PKG_VERSION"));
    of_parts([&record.input.sha256, &params.to_string(), program, what])
}

/// A UID of the mask and what is named: of what stays the same however it is measured.
pub(super) fn of_mask(record: &Record, what: &str) -> String {
    of_parts([record.input.sha256.as_str(), what])
}

/// A UID of 128 bits of the hash of these (PS3.5, B.2).
fn of_parts<const N: usize>(parts: [&str; N]) -> String {
    let mut hash = Sha256::new();
    for part in parts {
        // With its length: no two lists of parts run into the same bytes.
        hash.update((part.len() as u64).to_le_bytes());
        hash.update(part.as_bytes());
    }
    let digest = hash.finalize();
    let bits = digest.iter().take(16).fold(0_u128, |bits, byte| bits << 8 | u128::from(*byte));
    format!("2.25.{bits}")
}
