//! How long a job may take, told from its header and its size: enough to let a caudate nucleus pass a
//! whole brain.

use std::time::Duration;

use super::limits::compressed_bytes;
use crate::formats::HeaderFacts;
use crate::params::{CheckedParams, GridChoice};

/// Nanoseconds for each voxel of the volume: reading, and looking for labels.
const PER_VOXEL_NS: f64 = 10.0;
/// Nanoseconds for each compressed byte. A label map compresses to its surfaces, and the time goes
/// with them: between 3 µs and 40 µs a byte on the masks it was measured on.
const PER_COMPRESSED_BYTE_NS: f64 = 10_000.0;

/// The time that a mask of `bytes` bytes is expected to take on one thread.
#[must_use]
pub fn expected(header: &HeaderFacts, bytes: u64, params: &CheckedParams) -> Duration {
    let compressed = compressed_bytes(bytes, header.is_compressed);
    let surface = compressed * PER_COMPRESSED_BYTE_NS * finer(header, params) * denser(params);
    let once = header.voxels as f64 * PER_VOXEL_NS + surface;
    Duration::from_secs_f64(once * 1e-9 * params.runs() as f64)
}

/// How much more there is to do on a grid that is finer than the file's: a caudate nucleus takes 3 times as long at half
/// the edge and 14 times at a quarter, a kidney 6 times at half.
fn finer(header: &HeaderFacts, params: &CheckedParams) -> f64 {
    let edges = params.resolution_mm.map_or(1.0, |resolution_mm| header.voxel_mm / resolution_mm);
    edges.max(1.0).powi(2)
}

/// How much more there is to do on a lattice with many nodes: a kidney takes twice as long on 40 × 60.
fn denser(params: &CheckedParams) -> f64 {
    /// Nodes that cost as much as everything else.
    const NODES: f64 = 2400.0;
    match params.grid {
        GridChoice::Auto => 1.0,
        GridChoice::Fixed { rows, cols } => 1.0 + (rows * cols) as f64 / NODES,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::params::Params;

    #[test]
    fn a_whole_brain_is_expected_to_take_longer_than_a_nucleus_and_repeats_longer_than_none() {
        let params = |uncertainty| Params { uncertainty, ..Params::default() }.check().expect("valid");
        let nucleus = HeaderFacts { voxels: 60_000, voxel_mm: 1.0, is_compressed: true };
        let brain = HeaderFacts { voxels: 37_000_000, voxel_mm: 1.0, is_compressed: true };
        let of = |header, bytes, repeats| expected(header, bytes, &params(repeats)).as_secs_f64();
        assert!((0.01..0.1).contains(&of(&nucleus, 2_000, 0)));
        assert!((0.5..3.0).contains(&of(&brain, 92_000, 0)));
        assert!(of(&nucleus, 2_000, 9) > 9.0 * of(&nucleus, 2_000, 0));
    }

    #[test]
    fn finer_grids_and_denser_lattices_are_expected_to_take_longer() {
        let nucleus = HeaderFacts { voxels: 60_000, voxel_mm: 1.0, is_compressed: true };
        let of = |params: Params| expected(&nucleus, 2_000, &params.check().expect("valid")).as_secs_f64();
        let resolved = |resolution_mm| of(Params { resolution_mm: Some(resolution_mm), ..Params::default() });
        let plain = of(Params::default());
        assert!(resolved(0.25) > 10.0 * plain && resolved(0.25) < 20.0 * plain);
        assert!((resolved(4.0) - plain).abs() < 1e-9, "a coarser grid is taken to cost the same");
        let dense = Params { grid: GridChoice::Fixed { rows: 120, cols: 120 }, ..Params::default() };
        assert!(of(dense) > 4.0 * plain);
    }
}
