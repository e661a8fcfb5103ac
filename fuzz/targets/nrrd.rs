//! Files of NRRD, and what is nearly one.

#![no_main]

use libfuzzer_sys::fuzz_target;

#[path = "../bodies/mask.rs"]
mod body;
#[allow(dead_code, reason = "as above")]
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

/// Buffers of the file and of what is packed in it, two inflaters, the table of two-byte values, what is dealt to layers.
const FIXED: usize = 2 << 20;
/// What is remembered of a byte of content: at most every one is a label of its own, or five a key of a segment.
const PER_BYTE: usize = 64;
/// Index of a voxel, in each of four layers of the file and as many of the volume.
const PER_VOXEL: usize = 16;
/// No more is remembered than this, however many values there are.
const REMEMBERED: usize = 16 << 20;
/// Deflate shrinks no more than this, and may be within deflate.
const DEFLATE: usize = 1032;

fn budget(bytes: &[u8]) -> usize {
    let content = DEFLATE.saturating_mul(bytes.len());
    FIXED + PER_VOXEL * body::LIMITS.max_voxels as usize + REMEMBERED.min(PER_BYTE.saturating_mul(content))
}

fuzz_target!(init: seeds::write(&seeds::nrrd()), |bytes: &[u8]| {
    memory::within(budget(bytes), || body::check(bytes));
    body::check_in_gzip(bytes);
});
