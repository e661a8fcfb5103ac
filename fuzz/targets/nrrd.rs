//! Files of NRRD, and what is nearly one.

#![no_main]

use libfuzzer_sys::fuzz_target;

use self::common::{memory, seeds, text_budget};

#[path = "../bodies/mask.rs"]
mod body;
#[allow(dead_code, reason = "each target needs some of it")]
#[path = "../common.rs"]
mod common;

/// Index of a voxel, in each of four layers of the file and as many of the volume.
const PER_VOXEL: usize = 16;

fuzz_target!(init: seeds::write(&seeds::nrrd()), |bytes: &[u8]| {
    let voxels = PER_VOXEL * body::LIMITS.max_voxels as usize;
    memory::within(text_budget::budget(bytes) + voxels, || body::check(bytes));
    body::check_in_gzip(bytes);
});
