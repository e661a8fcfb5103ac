//! How two orientations of one volume differ, in words with figures: place, direction and side.

use nalgebra::{Matrix3, Point3, Vector3};

use crate::space::{WorldFromVoxel, significant};

/// Degrees between two directions of a voxel axis that are as good as none. A quaternion in float32 is wrong by up to
/// 0.04 where it stands for half a turn; more than 0.1 moves the end of an axis of 600 voxels by one.
const SAME_DIRECTION_DEG: f64 = 0.1;
/// Distance of a voxel's two places that is as good as none, in its smallest edge. Two ideas of where a voxel is, its
/// centre or its corner, are half an edge apart; an offset rounded to two decimals is a hundredth away.
const SAME_PLACE: f64 = 0.25;
/// Cosine below which an axis of the world counts as reversed: it is nearer to its opposite than to what is crosswise.
const REVERSED: f64 = -std::f64::consts::FRAC_1_SQRT_2;
/// Ends of the axes of the world.
const SIDES: [&str; 3] = ["left and right", "front and back", "top and bottom"];

/// What sets `b` apart from `a`, or nothing. Of orientations in two spaces only the side is compared: between them lies
/// a registration, which moves and turns but does not mirror.
pub(super) fn difference(
    a: &WorldFromVoxel,
    b: &WorldFromVoxel,
    dims: [usize; 3],
    are_two_spaces: bool,
) -> Option<String> {
    let is_mirrored = is_left_handed(a) != is_left_handed(b);
    if are_two_spaces && !is_mirrored {
        return None;
    }
    let reversed = reversed_axes(a, b);
    let mut parts = swapped_sides(reversed);
    if is_mirrored {
        parts.push("one is the mirror image of the other".to_owned());
    }
    let angle_deg = largest_angle_deg(a, b, reversed);
    if angle_deg > SAME_DIRECTION_DEG {
        parts.push(format!("their axes are up to {}° apart", significant(angle_deg)));
    }
    // The offsets alone where the axes are the same: those of a header are exact, its directions are rounded.
    let at = if parts.is_empty() { Point3::origin() } else { centre(dims) };
    let apart_mm = (a.point(at) - b.point(at)).norm();
    if apart_mm > SAME_PLACE * a.spacing_mm().into_iter().fold(f64::INFINITY, f64::min) {
        parts.push(format!("they place the image {} mm apart", significant(apart_mm)));
    }
    if parts.is_empty() { None } else { Some(parts.join(", ")) }
}

fn is_left_handed(map: &WorldFromVoxel) -> bool {
    directions(map).determinant() < 0.0
}

/// Unit vectors along the voxel axes, as columns.
fn directions(map: &WorldFromVoxel) -> Matrix3<f64> {
    Matrix3::from_columns(&[0, 1, 2].map(|axis| map.vector(Vector3::ith(axis, 1.0)).normalize()))
}

/// Which axes of the world lead the other way in `b`.
fn reversed_axes(a: &WorldFromVoxel, b: &WorldFromVoxel) -> [bool; 3] {
    let Some(back) = directions(a).try_inverse() else { return [false; 3] };
    let turn = directions(b) * back;
    [0, 1, 2].map(|axis| turn[(axis, axis)] < REVERSED)
}

fn swapped_sides(reversed: [bool; 3]) -> Vec<String> {
    let mut swapped = Vec::new();
    for (axis, sides) in SIDES.into_iter().enumerate() {
        if reversed[axis] {
            swapped.push(format!("{sides} are swapped"));
        }
    }
    swapped
}

/// The largest angle between a voxel axis of `a` and the same of `b`, once the swapped sides are swapped back.
fn largest_angle_deg(a: &WorldFromVoxel, b: &WorldFromVoxel, reversed: [bool; 3]) -> f64 {
    let back = Matrix3::from_diagonal(&Vector3::from(reversed.map(|is| if is { -1.0 } else { 1.0 })));
    let (a, b) = (directions(a), back * directions(b));
    let mut largest = 0.0f64;
    for axis in 0..3 {
        largest = largest.max(a.column(axis).angle(&b.column(axis)));
    }
    largest.to_degrees()
}

/// The middle of the volume, in voxels.
fn centre(dims: [usize; 3]) -> Point3<f64> {
    Point3::from(dims.map(|n| (n as f64 - 1.0) / 2.0))
}
