//! The shapes by name. Lengths are millimetres.

use std::f64::consts::{FRAC_PI_2, PI, TAU};

use nalgebra::{Point3, Vector3};

use super::patch::Patch;
use super::{Sample, Solid};

/// Name, what it is, and how to make it.
pub(super) type Entry = (&'static str, &'static str, fn() -> Vec<Solid>);

/// Every shape, simple ones first.
pub(super) const SHAPES: [Entry; 17] = [
    ("slab", "a flat sheet of constant thickness", || one(vec![flat(54.0, 38.0, 4.0)])),
    ("ellipsoid", "an ellipsoid with semi-axes 30, 20 and 8 mm", || one(vec![ellipsoid([30.0, 20.0, 8.0])])),
    ("bent", "a cylinder patch whose thickness grows along it", || one(vec![bent(30.0, 1.2, 40.0, taper)])),
    ("bent_even", "a cylinder patch of constant thickness", || one(vec![bent(30.0, 1.2, 40.0, |_, _| 6.0)])),
    ("bump", "a bent sheet with a local bump on both sides", || one(vec![bent(30.0, 1.2, 40.0, bump)])),
    ("thick_bend", "a bent sheet nearly as thick as its radius of curvature", || {
        one(vec![bent(14.0, 1.5, 50.0, |_, _| 11.0)])
    }),
    ("half_bent", "a sheet that is flat on one half and bent on the other", || one(vec![half_bent()])),
    ("twisted", "a sheet twisted by a quarter turn", || one(vec![twisted()])),
    ("leaf", "a bent, twisted leaf with a thick head and a thin tail, like a caudate nucleus", || one(vec![leaf()])),
    ("tee", "three flat sheets that meet at right angles", || one(branches(&[0.0, 90.0, 180.0]))),
    ("wye", "three flat sheets that meet at equal angles", || one(branches(&[90.0, 210.0, 330.0]))),
    ("cross", "four flat sheets that meet at right angles", || one(branches(&[0.0, 90.0, 180.0, 270.0]))),
    ("two", "two objects in one file, labels 11 and 2101", two),
    ("ball", "a ball, which has no medial sheet", || one(vec![ball()])),
    ("tube", "a straight tube, which has a medial curve and no sheet", || one(vec![tube()])),
    ("mobius", "a Möbius band, whose medial sheet has one side only", || one(vec![mobius()])),
    ("thin", "a sheet thinner than two voxels of 1 mm", || one(vec![flat(40.0, 30.0, 0.6)])),
];

/// The sample of an entry.
pub(super) fn build((name, about, solids): &Entry) -> Sample {
    Sample::new(name, about, solids())
}

fn one(patches: Vec<Patch>) -> Vec<Solid> {
    vec![Solid::new(1, patches)]
}

/// From `[0, 1]` to `[-1, 1]`.
fn centred(share: f64) -> f64 {
    2.0 * share - 1.0
}

fn flat(length: f64, width: f64, radius: f64) -> Patch {
    Patch::new(move |s, t| Point3::new(centred(s) * length / 2.0, centred(t) * width / 2.0, 0.0), move |_, _| radius)
}

/// The medial sheet of an ellipsoid with semi-axes a > b > c is the ellipse with semi-axes
/// (a² − c²)/a and (b² − c²)/b in the plane z = 0; its radius there is
/// c √(1 − x²/(a² − c²) − y²/(b² − c²)).
fn ellipsoid([a, b, c]: [f64; 3]) -> Patch {
    let (long, short) = (a * a - c * c, b * b - c * c);
    Patch::new(
        move |s, t| Point3::new(s * long / a * (TAU * t).cos(), s * short / b * (TAU * t).sin(), 0.0),
        move |s, t| {
            let (x, y) = (s * long / a * (TAU * t).cos(), s * short / b * (TAU * t).sin());
            c * (1.0 - x * x / long - y * y / short).max(0.0).sqrt()
        },
    )
}

/// A cylinder patch; `radius` takes the arc length across the bend and the length along it.
fn bent(curvature_radius: f64, half_angle: f64, length: f64, radius: fn(f64, f64) -> f64) -> Patch {
    let arc = half_angle * curvature_radius;
    Patch::new(
        move |s, t| {
            let angle = centred(s) * half_angle;
            let (sin, cos) = angle.sin_cos();
            Point3::new(curvature_radius * sin, centred(t) * length / 2.0, curvature_radius * cos)
        },
        move |s, t| radius(centred(s) * arc, centred(t) * length / 2.0),
    )
}

fn taper(_across: f64, along: f64) -> f64 {
    6.0 + 0.1 * along
}

fn bump(across: f64, along: f64) -> f64 {
    6.0 + 3.0 * (-(across * across + along * along) / 50.0).exp()
}

fn half_bent() -> Patch {
    const RADIUS: f64 = 14.0;
    const FLAT: f64 = 40.0;
    const ANGLE: f64 = 2.2;
    Patch::new(
        |s, t| {
            let arc = -FLAT + s * (FLAT + ANGLE * RADIUS);
            let angle = arc.max(0.0) / RADIUS;
            let x = if arc < 0.0 { arc } else { RADIUS * angle.sin() };
            Point3::new(x, centred(t) * 25.0, RADIUS * angle.cos())
        },
        |_, _| 6.0,
    )
}

fn twisted() -> Patch {
    Patch::new(
        |s, t| {
            let (across, along) = (centred(s) * 18.0, centred(t) * 35.0);
            let (sin, cos) = (centred(t) * FRAC_PI_2 / 2.0).sin_cos();
            Point3::new(across * cos, across * sin, along)
        },
        |_, _| 5.0,
    )
}

/// Runs back along an arc, as the caudate nucleus does: s along from the head to the tail, t
/// across.
fn leaf() -> Patch {
    Patch::new(on_leaf, |s, t| (2.5 + 3.2 * (-(s - 0.18).powi(2) / 0.07).exp()) * (1.0 - 0.35 * centred(t).powi(2)))
}

fn on_leaf(s: f64, t: f64) -> Point3<f64> {
    let half_width = 3.0 + 9.0 * (PI * (0.10 + 0.85 * s.powf(0.62))).sin();
    let (sin, cos) = (-0.75 + 1.95 * s).sin_cos();
    let axis = Vector3::new(0.0, -32.0 * sin, 32.0 * cos);
    let outward = Vector3::new(0.0, -sin, cos);
    let (tilt_sin, tilt_cos) = (0.35 + 0.9 * s).sin_cos();
    let ruling = Vector3::x() * tilt_cos + outward * tilt_sin;
    let across = centred(t) * half_width;
    let sag = outward * (-0.012 * across * across * tilt_cos);
    Point3::from(axis + ruling * across + sag)
}

/// Flat strips that leave the z axis at the given angles.
fn branches(degrees: &[f64]) -> Vec<Patch> {
    let strip = |angle: &f64| {
        let (sin, cos) = angle.to_radians().sin_cos();
        Patch::new(move |s, t| Point3::new(26.0 * s * cos, 26.0 * s * sin, centred(t) * 22.0), |_, _| 4.0)
    };
    degrees.iter().map(strip).collect()
}

fn ball() -> Patch {
    Patch::new(|_, _| Point3::origin(), |_, _| 15.0)
}

fn tube() -> Patch {
    Patch::new(|s, _| Point3::new(0.0, 0.0, centred(s) * 35.0), |_, _| 8.0)
}

fn mobius() -> Patch {
    Patch::new(
        |s, t| {
            let (angle, across) = (TAU * s, centred(t) * 10.0);
            let (half_sin, half_cos) = (angle / 2.0).sin_cos();
            let ring = 26.0 + across * half_cos;
            Point3::new(ring * angle.cos(), ring * angle.sin(), across * half_sin)
        },
        |_, _| 3.0,
    )
}

fn two() -> Vec<Solid> {
    let beside = |patch: Patch, x: f64| {
        let patch = std::sync::Arc::new(patch);
        let other = std::sync::Arc::clone(&patch);
        Patch::new(move |s, t| patch.position([s, t]) + Vector3::x() * x, move |s, t| other.radius_mm([s, t]))
    };
    vec![
        Solid::new(11, vec![beside(leaf(), -24.0)]),
        Solid::new(2101, vec![beside(ellipsoid([22.0, 15.0, 6.0]), 24.0)]),
    ]
}
