//! UIDs that follow from what they name: the same result has the same ones wherever and whenever it is written, so that an
//! archive that gets it twice keeps it once.

use sha2::{Digest, Sha256};

use crate::formats::params_json::params_to_json;
use crate::formats::write::record::Record;

/// The writer of the files.
pub(super) const IMPLEMENTATION: &str = "2.25.244263215943290127190866291538221305091";

/// A UID of 128 bits of the hash of the mask, the parameters, the program and what is named (PS3.5, B.2).
pub(super) fn of(record: &Record, what: &str) -> String {
    let params = params_to_json(&record.model.params).to_string();
    let program = concat!(env!("CARGO_PKG_NAME"), " ", env!("CARGO_PKG_VERSION"));
    let mut hash = Sha256::new();
    for part in [record.input.sha256.as_str(), &params, program, what] {
        // With its length: no two lists of parts run into the same bytes.
        hash.update((part.len() as u64).to_le_bytes());
        hash.update(part.as_bytes());
    }
    let digest = hash.finalize();
    let bits = digest.iter().take(16).fold(0_u128, |bits, byte| bits << 8 | u128::from(*byte));
    format!("2.25.{bits}")
}
