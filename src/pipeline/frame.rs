//! The frame of a figure: which way rows and columns run. It is fixed by the anatomy's position
//! in the world, not by the signs of an eigen solver, so that the same organ has the same (i, j)
//! however the scanner lay.

use nalgebra::{Point2, Point3, Vector2, Vector3};

use crate::space::WorldFromVoxel;

use super::outline::Region;
use super::sides::towards;

/// Turns flattened points so that the first axis is the longer extent of the region they cover,
/// and both axes run towards positive world directions (see [`towards`]).
#[must_use]
pub fn canonical(
    flat: &[Point2<f64>],
    positions: &[Point3<f64>],
    world_from_work: &WorldFromVoxel,
) -> Vec<Point2<f64>> {
    let (axes, _) = Region::of(flat).principal_axes();
    let turned: Vec<Point2<f64>> =
        flat.iter().map(|p| Point2::new(axes[0].dot(&p.coords), axes[1].dot(&p.coords))).collect();
    let signs = [0, 1].map(|axis| towards(world_from_work.vector(direction(&turned, positions, axis))));
    turned.iter().map(|p| Point2::from(p.coords.component_mul(&Vector2::from(signs)))).collect()
}

/// The direction in space along which a plane coordinate grows: their covariance.
fn direction(flat: &[Point2<f64>], positions: &[Point3<f64>], axis: usize) -> Vector3<f64> {
    let count = flat.len().max(1) as f64;
    let mean = flat.iter().map(|p| p[axis]).sum::<f64>() / count;
    flat.iter().zip(positions).map(|(p, x)| x.coords * (p[axis] - mean)).sum()
}
