//! Masks like those of organs, made here: analytic solids with noise, slices and voxels that are no cubes. None
//! is of a patient, and none has to be what it is called; they bring what organs bring.

use std::f64::consts::{FRAC_PI_2, PI};

use medialrep::samples::{Patch, Sample, Solid};
use medialrep::space::LabelVolume;
use nalgebra::{Point3, Rotation3, Vector3};

use crate::help::phantoms::{counted, roughened, sample};

/// Name, what it brings, and the mask.
pub type Organ = (&'static str, &'static str, fn() -> LabelVolume);

/// All of them.
pub const ORGANS: [Organ; 6] = [
    ("kidney", "a thick bowl, 1.5 mm", kidney),
    ("caudate", "a bent and twisted leaf with a thin tail, 0.5 mm", caudate),
    ("hippocampus", "a curled strip with a tail in slices of 3 mm", hippocampus),
    ("spleen", "a bent plate with a notch in its rim, slices of 4 mm", spleen),
    ("muscle", "a fan that is thin at its tendon, 2.2 × 2.2 × 3 mm", muscle),
    ("valve", "two leaves that leave a ridge, turned in the grid, 1.2 mm", valve),
];

fn mask(patches: Vec<Patch>, spacing_mm: [f64; 3], turn: Rotation3<f64>) -> LabelVolume {
    let organ = Sample::new("organ", "like an organ", vec![Solid::new(1, patches)]);
    organ.voxelise(spacing_mm, turn).expect("fits in memory")
}

/// From `[0, 1]` to `[-1, 1]`.
fn centred(share: f64) -> f64 {
    2.0 * share - 1.0
}

/// Most of the skin of an egg, open on one side: bent in both directions, it cannot be laid flat in one piece.
fn kidney() -> LabelVolume {
    let bowl = Patch::new(
        |s, t| {
            let (long, round) = (centred(s) * 0.9, centred(t) * 2.0);
            let girth = 20.0 * (long * FRAC_PI_2).cos();
            Point3::new(61.3 + girth * round.cos(), -40.2 + 1.1 * girth * round.sin(), 30.0 * (long * FRAC_PI_2).sin())
        },
        |s, t| 7.0 - 1.5 * centred(s).powi(2) - centred(t).powi(2),
    );
    roughened(&mask(vec![bowl], [1.5; 3], Rotation3::from_euler_angles(0.13, 0.21, 0.34)), 0.03)
}

fn caudate() -> LabelVolume {
    let leaf = sample("leaf").voxelise([0.5; 3], Rotation3::from_euler_angles(0.31, -0.12, 0.07));
    roughened(&leaf.expect("fits in memory"), 0.05)
}

/// Runs backwards and down, rolled about its own axis, and ends in a tail.
fn hippocampus() -> LabelVolume {
    let strip = Patch::new(
        |s, t| {
            let (sin, cos) = (-0.4 + 1.5 * s).sin_cos();
            let axis = Vector3::new(-27.4, -38.0 * sin, 38.0 * cos);
            let outward = Vector3::new(0.0, -sin, cos);
            let roll = centred(t) * 1.3;
            let bend = 6.5 - 3.5 * s;
            Point3::from(axis + Vector3::x() * (bend * roll.sin()) + outward * (bend * roll.cos()))
        },
        |s, t| (3.4 - 1.4 * s) * (1.0 - 0.2 * centred(t).powi(2)),
    );
    roughened(&mask(vec![strip], [0.9, 3.0, 0.9], Rotation3::identity()), 0.03)
}

/// A piece of a shell whose front edge has a cut.
fn spleen() -> LabelVolume {
    let plate = Patch::new(
        |s, t| {
            let (long, wide) = (centred(s) * 0.85, centred(t) * 0.55);
            let (sin, cos) = long.sin_cos();
            let out = 54.0 * wide.cos();
            Point3::new(-31.7 + out * cos, 54.0 * wide.sin(), out * sin)
        },
        |s, t| 12.0 - 4.5 * centred(s).powi(2) - 3.0 * centred(t).powi(2),
    );
    let whole = mask(vec![plate], [1.6, 1.6, 4.0], Rotation3::from_euler_angles(0.1, -0.2, 0.15));
    let mut cut = whole.indices().clone();
    for offset in 0..cut.as_slice().len() {
        let at = Point3::from(cut.index(offset).map(|n| n as f64));
        let world = whole.world_from_voxel().point(at);
        // A wedge, 9 mm wide at the rim and 16 mm deep.
        let depth = world.y - 20.0;
        if depth > 0.0 && (world.z - 9.3).abs() < 0.28 * depth {
            cut.as_mut_slice()[offset] = 0;
        }
    }
    roughened(&counted(cut, whole.world_from_voxel()), 0.02)
}

/// Runs out from a tendon into a fan, sagging as it does.
fn muscle() -> LabelVolume {
    let fan = Patch::new(
        |s, t| {
            let (spread, reach) = (centred(t) * 0.48, 22.0 + 78.0 * s);
            let sag = 0.0022 * reach * reach * (1.0 - 0.5 * centred(t).powi(2));
            Point3::new(-100.0 + reach * spread.cos(), reach * spread.sin(), 40.3 - sag)
        },
        |s, t| (3.6 + 6.0 * (PI * s.powf(1.4)).sin()) * (1.0 - 0.25 * centred(t).powi(2)),
    );
    roughened(&mask(vec![fan], [2.2, 2.2, 3.0], Rotation3::from_euler_angles(-0.11, 0.17, 0.29)), 0.03)
}

/// Two bent leaves and a short ridge that share an edge.
fn valve() -> LabelVolume {
    let leaf = |degrees: f64, width: f64, bend: f64| {
        let (sin, cos) = degrees.to_radians().sin_cos();
        Patch::new(
            move |s, t| {
                let (out, up) = (width * s, bend * s * s);
                Point3::new(out * cos - up * sin, out * sin + up * cos, centred(t) * 21.0)
            },
            move |s, _| 4.2 - 1.2 * s,
        )
    };
    let leaves = vec![leaf(12.0, 30.0, 6.0), leaf(171.0, 26.0, -5.0), leaf(268.0, 13.0, 0.0)];
    roughened(&mask(leaves, [1.2; 3], Rotation3::from_euler_angles(0.4, 0.3, -0.6)), 0.04)
}
