//! Files.

#![no_main]

use libfuzzer_sys::fuzz_target;

use self::common::{memory, seeds};

#[path = "../bodies/mask.rs"]
mod body;
#[allow(dead_code, reason = "each target needs some of it")]
#[path = "../common.rs"]
mod common;

/// Buffers, the inflater, the table of two-byte values.
const FIXED: usize = 1 << 20;
/// What is remembered of a byte of content: at most every one is a label of its own. An entry of a table of labels
/// takes more bytes than it costs.
const PER_BYTE: usize = 64;
/// Index of a voxel.
const PER_VOXEL: usize = 2;
/// No more is remembered than this, however many values there are.
const REMEMBERED: usize = 16 << 20;
/// Deflate shrinks no more than this.
const DEFLATE: usize = 1032;

fn budget(bytes: &[u8]) -> usize {
    let content = if bytes.starts_with(&[0x1f, 0x8b]) { DEFLATE * bytes.len() } else { bytes.len() };
    FIXED + PER_VOXEL * body::LIMITS.max_voxels as usize + REMEMBERED.min(PER_BYTE * content)
}

fuzz_target!(init: seeds::write(&seeds::nifti()), |bytes: &[u8]| {
    memory::within(budget(bytes), || body::check(bytes));
    body::check_in_gzip(bytes);
});
