//! Files of MetaImage, and what is nearly one.

#![no_main]

use libfuzzer_sys::fuzz_target;

use self::common::{memory, seeds, text_budget};

#[path = "../bodies/mask.rs"]
mod body;
#[allow(dead_code, reason = "each target needs some of it")]
#[path = "../common.rs"]
mod common;

/// Index of a voxel.
const PER_VOXEL: usize = 2;

fuzz_target!(init: seeds::write(&seeds::metaimage()), |bytes: &[u8]| {
    let voxels = PER_VOXEL * body::LIMITS.max_voxels as usize;
    memory::within(text_budget::budget(bytes) + voxels, || body::check(bytes));
    body::check_in_gzip(bytes);
});
