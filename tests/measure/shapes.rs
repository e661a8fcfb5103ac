//! The shapes, and the masks that are made of them.

use medialrep::samples::Sample;
use medialrep::space::{Grid, Label, LabelVolume, WorldFromVoxel};
use nalgebra::{Rotation3, Unit, Vector3};

/// Where the grid begins, in voxels. Of a grid along the shape's axes a flat face is off by half a voxel less
/// this: 0.29, which is what all phases have in the root mean square (1/√12). At 0 its voxels would be decided by
/// rounding, at 0.5 it would be in place by luck.
pub const PHASE: [f64; 3] = [0.21; 3];

/// A sample with a known medial sheet.
pub struct Shape {
    /// Name of the sample.
    pub sample: &'static str,
    /// What it is called in tables.
    pub title: &'static str,
}

/// All of them, simple ones first.
pub const SHAPES: [Shape; 11] = [
    Shape { sample: "slab", title: "flat slab" },
    Shape { sample: "ellipsoid", title: "ellipsoid" },
    Shape { sample: "bent_even", title: "bent slab" },
    Shape { sample: "bump", title: "bent slab with a bump" },
    Shape { sample: "thick_bend", title: "slab nearly as thick as its bend" },
    Shape { sample: "half_bent", title: "slab bent on one half" },
    Shape { sample: "twisted", title: "twisted slab" },
    Shape { sample: "leaf", title: "leaf with a thin tail" },
    Shape { sample: "tee", title: "three sheets at right angles" },
    Shape { sample: "wye", title: "three sheets at equal angles" },
    Shape { sample: "cross", title: "four sheets at right angles" },
];

/// How a mask is made of a shape.
pub struct Case {
    /// Its name in the file.
    pub name: &'static str,
    /// What it is called in tables.
    pub title: &'static str,
    /// Voxel edges, mm.
    pub spacing_mm: [f64; 3],
    /// Whether the grid lies oblique to the shape; else along its axes.
    pub is_turned: bool,
    /// Share of the voxels at the boundary that are flipped.
    pub flipped: f64,
}

const PLAIN: Case = Case { name: "plain", title: "1 mm", spacing_mm: [1.0; 3], is_turned: false, flipped: 0.0 };

/// All of them. The first is what the others are compared with.
pub const CASES: [Case; 5] = [
    PLAIN,
    Case { name: "turned", title: "turned by 37°", is_turned: true, ..PLAIN },
    Case { name: "noisy", title: "5 % of the boundary flipped", flipped: 0.05, ..PLAIN },
    Case { name: "anisotropic", title: "1 × 1 × 2.5 mm", spacing_mm: [1.0, 1.0, 2.5], ..PLAIN },
    Case { name: "half_voxel", title: "0.5 mm", spacing_mm: [0.5; 3], ..PLAIN },
];

impl Case {
    /// The mask of a sample.
    pub fn mask(&self, sample: &Sample) -> LabelVolume {
        let turn = if self.is_turned { turned() } else { Rotation3::identity() };
        let volume = sample.voxelise_at(self.spacing_mm, turn, PHASE).expect("fits in memory");
        if self.flipped > 0.0 { roughened(&volume, self.flipped) } else { volume }
    }

    /// The finest edge of its voxels, mm: what lengths are told in.
    pub fn voxel_mm(&self) -> f64 {
        self.spacing_mm.into_iter().fold(f64::INFINITY, f64::min)
    }
}

/// A grid that lies oblique to the world.
pub fn turned() -> Rotation3<f64> {
    Rotation3::from_axis_angle(&Unit::new_normalize(Vector3::new(1.0, 2.0, 3.0)), 37.0_f64.to_radians())
}

/// Flips a share of the voxels of the one label that touch its boundary. Which ones follows from where they
/// lie in the grid alone: one voxel more or less in the mask does not flip others far from it.
pub fn roughened(volume: &LabelVolume, share: f64) -> LabelVolume {
    let [nx, ny, _] = volume.dims();
    let old = volume.indices().as_slice();
    let mut new = volume.indices().clone();
    for o in nx * ny + nx + 1..old.len() - nx * ny - nx - 1 {
        let around = [o - 1, o + 1, o - nx, o + nx, o - nx * ny, o + nx * ny];
        if around.iter().any(|&n| old[n] != old[o]) && share_of(o as u64) < share {
            new.as_mut_slice()[o] = 1 - old[o];
        }
    }
    counted(new, volume.world_from_voxel())
}

/// Labels equal to their indices.
pub fn counted(indices: Grid<u16>, world_from_voxel: WorldFromVoxel) -> LabelVolume {
    let most = *indices.as_slice().iter().max().expect("voxels");
    let labels = (1..=most).map(|label| Label::new(i64::from(label))).collect();
    LabelVolume::new(indices, labels, world_from_voxel).expect("labels that ascend")
}

/// A number from 0 to 1 that looks random and is the same in every run (splitmix64, Steele et al. 2014).
fn share_of(place: u64) -> f64 {
    let mut z = place.wrapping_add(1).wrapping_mul(0x9E37_79B9_7F4A_7C15);
    z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
    ((z ^ (z >> 31)) >> 11) as f64 / (1_u64 << 53) as f64
}
