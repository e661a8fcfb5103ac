//! How long a job may take, told from its header and its size: enough to let a caudate nucleus pass a
//! whole brain.

use std::time::Duration;

use super::limits::compressed_bytes;
use crate::formats::HeaderFacts;
use crate::params::CheckedParams;

/// Nanoseconds for each voxel of the volume: reading, and looking for labels.
const PER_VOXEL_NS: f64 = 10.0;
/// Nanoseconds for each compressed byte. A label map compresses to its surfaces, and the time goes
/// with them: between 3 µs and 40 µs a byte on the masks it was measured on.
const PER_COMPRESSED_BYTE_NS: f64 = 10_000.0;

/// The time that a mask of `bytes` bytes is expected to take on one thread.
#[must_use]
pub fn expected(header: &HeaderFacts, bytes: u64, params: &CheckedParams) -> Duration {
    let compressed = compressed_bytes(bytes, header.is_compressed);
    let once = header.voxels as f64 * PER_VOXEL_NS + compressed * PER_COMPRESSED_BYTE_NS;
    Duration::from_secs_f64(once * 1e-9 * params.runs() as f64)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::params::Params;

    #[test]
    fn a_whole_brain_is_expected_to_take_longer_than_a_nucleus_and_repeats_longer_than_none() {
        let params = |uncertainty| Params { uncertainty, ..Params::default() }.check().expect("valid");
        let nucleus = HeaderFacts { voxels: 60_000, is_compressed: true };
        let brain = HeaderFacts { voxels: 37_000_000, is_compressed: true };
        let of = |header, bytes, repeats| expected(header, bytes, &params(repeats)).as_secs_f64();
        assert!((0.01..0.1).contains(&of(&nucleus, 2_000, 0)));
        assert!((0.5..3.0).contains(&of(&brain, 92_000, 0)));
        assert!(of(&nucleus, 2_000, 9) > 9.0 * of(&nucleus, 2_000, 0));
    }
}
