//! Step 1: the medial voxels, which thinning stops at.

use nalgebra::Vector3;

use crate::cancel::{Cancel, Cancelled};
use crate::numerics::field::centre;
use crate::numerics::parallel::each_number;
use crate::pipeline::solid::Solid;
use crate::pipeline::solid::depth::Depth;

/// Cosine of the angle under which a medial voxel must see its two feet: 60°. Where n arms meet,
/// the middle sees feet 360°/n apart: with a wider angle, five and six arms would come apart there. Bumps and
/// edges are seen under small angles too, and are told apart by stage 3; with a smaller angle there are more.
const FEET_COSINE: f64 = 0.5;
/// Distance of the two feet of a medial voxel at the least, voxels: below it the staircase
/// of the grid makes feet of its own. Above it, what is thinner has no medial voxels.
const MIN_CHORD: f64 = 3.0;
/// The same in grains of the mask: what its own staircase makes. With less, every bump of an organ on a finer grid has a
/// sheet; with more, thin organs have none there either.
const MIN_CHORD_GRAINS: f64 = 2.0;
/// Difference of two distances that rounding can make, voxels: feet are a little off the boundary. With less, an
/// even thickness gets a mixture of its two middle layers; with more, the layer that is further off.
const TIE: f64 = 0.05;
/// Rows of voxels that one thread takes at a time; fewer are not worth handing over.
const ROWS_PER_TASK: usize = 16;

/// Voxels between two far feet: one for each pair of neighbours that see two, in the order of pairs.
pub(super) fn medial_voxels(solid: &Solid, depth: &Depth, cancel: &dyn Cancel) -> Result<Vec<usize>, Cancelled> {
    let [_, ny, nz] = solid.inside.dims();
    Ok(each_number(ny * nz, ROWS_PER_TASK, |row| medial_of_row(solid, depth, row), cancel)?.concat())
}

/// Those of which the first of the pair is in a row.
fn medial_of_row(solid: &Solid, depth: &Depth, row: usize) -> Vec<usize> {
    let [nx, ny, _] = solid.inside.dims();
    let (inside, nearest) = (solid.inside.as_slice(), depth.nearest.as_slice());
    let chord = MIN_CHORD.max(MIN_CHORD_GRAINS * solid.voxels_per_grain);
    let mut found = Vec::new();
    for i in 0..nx {
        let offset = row * nx + i;
        if !inside[offset] {
            continue;
        }
        for (axis, stride) in [1, nx, nx * ny].into_iter().enumerate() {
            let next = offset + stride;
            if nearest[offset] == nearest[next] || !inside[next] {
                continue;
            }
            let mut between = centre([i, row % ny, row / ny]);
            between[axis] += 0.5;
            let a = depth.skin[nearest[offset] as usize].position - between;
            let b = depth.skin[nearest[next] as usize].position - between;
            if are_far(a, b, chord) {
                // Of the two, the one nearer to the bisector of the feet; the first of equals,
                // so that the middle of an even thickness is one layer, not a mixture of two.
                let is_beyond = b.norm() - a.norm() > TIE;
                found.push(if is_beyond { next } else { offset });
            }
        }
    }
    found
}

/// Whether two feet, as seen from between them, lie far apart.
fn are_far(a: Vector3<f64>, b: Vector3<f64>, chord: f64) -> bool {
    let is_wide = a.dot(&b) < FEET_COSINE * a.norm() * b.norm();
    is_wide && (a - b).norm_squared() >= chord * chord
}
