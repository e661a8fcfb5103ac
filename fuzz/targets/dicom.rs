//! Segmentations.

#![no_main]

use libfuzzer_sys::fuzz_target;

use self::common::{memory, seeds};

#[path = "../bodies/mask.rs"]
mod body;
#[allow(dead_code, reason = "each target needs some of it")]
#[path = "../common.rs"]
mod common;

/// Buffers, the inflater, tables by number of segment and by index.
const FIXED: usize = 4 << 20;
/// What is kept of a byte of content: an item of eight bytes with an element of eight costs two hundred.
const PER_BYTE: usize = 64;
/// Index of a voxel, in the layers that there can be.
const PER_VOXEL: usize = 2 * 4;
/// No more is kept than this, however much comes.
const KEPT: usize = 32 << 20;
/// Deflate shrinks no more than this.
const DEFLATE: usize = 1032;

fn budget(bytes: &[u8]) -> usize {
    // Any of it may be deflated.
    FIXED + PER_VOXEL * body::LIMITS.max_voxels as usize + KEPT.min(PER_BYTE * DEFLATE * bytes.len())
}

fuzz_target!(init: seeds::write(&seeds::dicom()), |bytes: &[u8]| {
    memory::within(budget(bytes), || body::check(bytes));
    body::check_in_gzip(bytes);
});
