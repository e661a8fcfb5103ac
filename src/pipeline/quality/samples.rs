//! Points spread over quads.

use std::ops::{Add, Mul, Sub};

use nalgebra::{Point3, Vector3};

use crate::cancel::{Cancel, Cancelled};
use crate::model::{Body, Shell, Side, TubeShell};
use crate::numerics::field::floor_index;
use crate::pipeline::solid::depth::{SKIN_REACH, SkinPoint};

/// Distance between the samples of the model's surfaces, voxels. Half of it takes four times as long and changes shares of
/// the surface by 0.001; at twice of it they are too large by 0.002.
const SAMPLE_STEP: f64 = 0.7;

/// Points spread over the outer surface of a figure.
///
/// # Errors
/// When it is cancelled.
pub fn surface_samples(body: Body<'_>, cancel: &dyn Cancel) -> Result<Vec<SkinPoint>, Cancelled> {
    match body {
        Body::Sheet(shell) => of_sheet(shell, cancel),
        Body::Tube(shell) => of_tube(shell, cancel),
    }
}

/// Over the wall of a tube and the fans of its tips.
fn of_tube(shell: TubeShell<'_>, cancel: &dyn Cancel) -> Result<Vec<SkinPoint>, Cancelled> {
    let (cols, mut samples) = (shell.size.cols, Vec::new());
    for quad in shell.quads() {
        cancel.check()?;
        sample(quad.map(|n| shell.wall[n]), &mut samples);
    }
    for (tip, col) in shell.fans() {
        for row in 0..shell.size.rows {
            let [here, next] = [row, (row + 1) % shell.size.rows].map(|row| shell.wall[row * cols + col]);
            sample([here, next, tip, tip], &mut samples);
        }
    }
    Ok(samples)
}

/// Over upper side, lower side and the strips of the rim.
fn of_sheet(shell: Shell<'_>, cancel: &dyn Cancel) -> Result<Vec<SkinPoint>, Cancelled> {
    let mut samples = Vec::new();
    for side in Side::BOTH {
        for quad in shell.quads() {
            cancel.check()?;
            sample(quad.corners(shell.side(side)), &mut samples);
        }
        for step in shell.edge_steps() {
            let [a, b] = step.nodes;
            let (here, next) = (shell.half_arc(side, step.here, a), shell.half_arc(side, step.next, b));
            for k in 1..here.len() {
                sample([here[k - 1], next[k - 1], here[k], next[k]], &mut samples);
            }
        }
    }
    Ok(samples)
}

/// Adds samples of a quad with their normals.
fn sample([a, b, c, d]: [Point3<f64>; 4], samples: &mut Vec<SkinPoint>) {
    for [s, t] in places_in([a, b, c, d], SAMPLE_STEP) {
        let (across, down) = ((b - a) * (1.0 - t) + (d - c) * t, (c - a) * (1.0 - s) + (d - b) * s);
        let normal = across.cross(&down).try_normalize(1e-9).unwrap_or_else(Vector3::z);
        samples.push(SkinPoint { position: bilinear([a, b, c, d], [s, t]), normal, reach: SKIN_REACH });
    }
}

/// Places in a quad given as rows `[a b; c d]`, `step` apart at most: shares from a to b and from a to c.
#[must_use]
pub fn places_in([a, b, c, d]: [Point3<f64>; 4], step: f64) -> Vec<[f64; 2]> {
    let across = pieces((b - a).norm().max((d - c).norm()), step);
    let down = pieces((c - a).norm().max((d - b).norm()), step);
    let mut places = Vec::with_capacity((across + 1) * (down + 1));
    for y in 0..=down {
        for x in 0..=across {
            places.push([x as f64 / across as f64, y as f64 / down as f64]);
        }
    }
    places
}

/// Pieces of an edge.
fn pieces(length: f64, step: f64) -> usize {
    /// At most; a quad of 2 000 voxels is as good as any with these.
    const MOST: usize = 400;
    floor_index((length / step).ceil()).clamp(1, MOST)
}

/// What a place in a quad has, of what its corners `[a b; c d]` have.
#[must_use]
pub fn bilinear<T, V>([a, b, c, d]: [T; 4], [s, t]: [f64; 2]) -> T
where
    T: Copy + Sub<T, Output = V> + Add<V, Output = T>,
    V: Mul<f64, Output = V>,
{
    let (left, right) = (a + (c - a) * t, b + (d - b) * t);
    left + (right - left) * s
}
