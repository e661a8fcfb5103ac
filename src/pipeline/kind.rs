//! What a medial set is by its extents: a ball's or a tube's is no sheet that a lattice could be laid over.

use super::plane::region::Region;

/// A sheet shorter than this many radii is that of a ball, one narrower than this many that of a tube. From 0.5 to 1
/// nothing changes; with 2, a bladder is refused.
const BALL_LENGTH: f64 = 1.0;
/// See [`BALL_LENGTH`]. With 1.6, eight of 75 organs and shapes are refused, two thalami among them, which pass; with
/// 0.4, a rectum and a bladder are laid out that then fail, and an accumbens that does not.
const TUBE_WIDTH: f64 = 0.8;

/// What a medial set is that was laid flat.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Kind {
    /// Shorter than it is thick.
    Ball,
    /// Narrower than it is thick.
    Tube {
        /// Its extent along, voxels.
        length: f64,
    },
    /// Neither.
    Sheet,
}

/// The kind of a medial set by its region in the plane and its largest inscribed radius, voxels.
#[must_use]
pub fn kind(region: &Region, largest_radius: f64) -> Kind {
    let [length, width] = region.rectangle();
    if length < BALL_LENGTH * largest_radius {
        Kind::Ball
    } else if width < TUBE_WIDTH * largest_radius {
        Kind::Tube { length }
    } else {
        Kind::Sheet
    }
}
