//! Step 3: two sheets that go on into one another are one.

use std::collections::BTreeSet;

use nalgebra::Matrix3;

use super::junctions::{contacts, is_third_near};
use super::rename;
use crate::cancel::{Cancel, Cancelled};
use crate::pipeline::medial::MedialSurface;

/// Cosine between the normals of touching points of one sheet on average: 45°. A branch stands on the sheet it
/// leaves, at 60° where three equal arms meet: with less it would be joined to it. With more, the halves of
/// a sheet with a step in it would stay two.
const SMOOTH_COSINE: f64 = 0.7;

/// Which sheets that go on smoothly into one another are one.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Joining {
    /// Those that do where no third one is near.
    Alone,
    /// All: the wall of a pipe comes in strips, some no wider than a junction is, and has no junctions.
    Smooth,
}

/// Two sheets that touch mostly where no third one is near are one sheet with a step in it.
pub(super) fn join_across_pairs(
    surface: &MedialSurface,
    label: &mut [u32],
    joining: Joining,
    cancel: &dyn Cancel,
) -> Result<(), Cancelled> {
    while let Some((a, b)) = stepped_pair(surface, label, joining, cancel)? {
        rename(label, b, a);
    }
    Ok(())
}

/// The first two such sheets.
fn stepped_pair(
    surface: &MedialSurface,
    label: &[u32],
    joining: Joining,
    cancel: &dyn Cancel,
) -> Result<Option<(u32, u32)>, Cancelled> {
    for (pair, points) in contacts(surface, label, cancel)? {
        let mut lone = 0;
        for &p in &points {
            cancel.check()?;
            lone += usize::from(joining == Joining::Smooth || !is_third_near(surface, label, pair, p));
        }
        if 2 * lone > points.len() && is_smooth(surface, label, &points) {
            return Ok(Some(pair));
        }
    }
    Ok(None)
}

/// Whether two sheets go on into one another at the points where they touch: on average their normals agree.
fn is_smooth(surface: &MedialSurface, label: &[u32], points: &BTreeSet<u32>) -> bool {
    let (mut sum, mut count) = (0.0, 0.0);
    for &a in points {
        for &b in &surface.adjacency[a as usize] {
            if a < b && points.contains(&b) && label[a as usize] != label[b as usize] {
                let (u, v) = (normals_around(surface, label, a), normals_around(surface, label, b));
                sum += (u.dot(&v) / (u.norm() * v.norm()).max(1e-12)).max(0.0).sqrt();
                count += 1.0;
            }
        }
    }
    sum >= SMOOTH_COSINE * f64::max(count, 1.0)
}

/// The normals around a point, those of its own sheet only, as a quadratic form: their signs are arbitrary.
fn normals_around(surface: &MedialSurface, label: &[u32], p: u32) -> Matrix3<f64> {
    let mut sum = Matrix3::zeros();
    for &q in surface.adjacency[p as usize].iter().chain([&p]) {
        if label[q as usize] == label[p as usize] {
            let normal = surface.point(q).normal;
            sum += normal * normal.transpose();
        }
    }
    sum
}
