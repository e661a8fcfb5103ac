//! Where the voxels of a NIfTI lie: sform, else qform, else pixdim, each checked, and how far they agree.

use nalgebra::{Quaternion, UnitQuaternion};

use super::header::RawHeader;
use super::orientations::difference;
use crate::formats::read::error::ReadError;
use crate::formats::read::place::{self, SPACING_MM, bad_spacing, no_orientation};
use crate::space::{VolumeNotice, WorldFromVoxel, significant};

/// How far b² + c² + d² of the quaternion may exceed 1 by rounding.
const QUATERNION_EXCESS: f64 = 1e-3;
/// sform and pixdim that differ by more than this share in a spacing are worth a notice.
const SPACING_DISAGREEMENT: f64 = 0.01;

/// Codes of an sform from here on name the space of an atlas, in which the patient may lie elsewhere than in the scanner.
const FIRST_STANDARD_SPACE: i32 = 3;

/// The voxel-to-world map in millimetres; what was odd is added to `notices`.
///
/// # Errors
/// When no orientation given is usable. A broken sform falls back to a qform, but never to
/// pixdim: that would guess which way up the patient lies.
pub(super) fn world_from_voxel(
    raw: &RawHeader,
    dims: [usize; 3],
    notices: &mut Vec<VolumeNotice>,
) -> Result<WorldFromVoxel, ReadError> {
    let unit_mm = unit_mm(raw, notices);
    if raw.sform_code > 0 {
        match checked("srow_x", scaled(raw.srow, unit_mm)) {
            Ok(map) => {
                compare_spacing(&map, raw, unit_mm, notices);
                compare_with_qform(&map, raw, dims, unit_mm, notices);
                return Ok(map);
            }
            Err(error) if raw.qform_code <= 0 => return Err(error),
            Err(_) => notices.push(VolumeNotice {
                code: "sform_unusable",
                message: "the sform of the header is unusable; its qform was taken instead".to_owned(),
            }),
        }
    }
    let spacing_mm = pixel_spacing(raw, dims, unit_mm)?;
    if raw.qform_code > 0 {
        return qform(raw, spacing_mm, unit_mm);
    }
    notices.push(no_orientation(
        "the header has neither sform nor qform: axes and sides of the patient are not known, \
         positions are voxel indices times pixdim",
    ));
    let rows = std::array::from_fn(|r| std::array::from_fn(|c| if r == c { spacing_mm[r] } else { 0.0 }));
    checked("pixdim", rows)
}

/// Millimetres in the header's unit of length; unknown means millimetres.
fn unit_mm(raw: &RawHeader, notices: &mut Vec<VolumeNotice>) -> f64 {
    match raw.space_unit {
        1 => 1000.0,
        3 => 0.001,
        0 | 2 => 1.0,
        code => {
            let message = format!("the unit of length has the unknown code {code}; millimetres were taken");
            notices.push(VolumeNotice { code: "unknown_unit", message });
            1.0
        }
    }
}

fn scaled(rows: [[f64; 4]; 3], unit_mm: f64) -> [[f64; 4]; 3] {
    rows.map(|row| row.map(|x| x * unit_mm))
}

fn checked(field: &'static str, rows: [[f64; 4]; 3]) -> Result<WorldFromVoxel, ReadError> {
    place::checked(rows).map_err(|reason| ReadError::BadAffine { field, reason })
}

/// Voxel edges from pixdim. Negative ones are met in old files and mean their length; an axis
/// of one voxel may have none.
fn pixel_spacing(raw: &RawHeader, dims: [usize; 3], unit_mm: f64) -> Result<[f64; 3], ReadError> {
    const FIELDS: [&str; 3] = ["pixdim[1]", "pixdim[2]", "pixdim[3]"];
    let mut spacing_mm = [1.0; 3];
    for axis in 0..3 {
        let edge = raw.pixdim[axis + 1].abs();
        if edge == 0.0 && dims[axis] == 1 {
            continue;
        }
        spacing_mm[axis] = edge * unit_mm;
        if !SPACING_MM.contains(&spacing_mm[axis]) {
            return Err(ReadError::BadAffine { field: FIELDS[axis], reason: bad_spacing(spacing_mm[axis]) });
        }
    }
    Ok(spacing_mm)
}

/// Method 2 of nifti1.h: a rotation quaternion of which b, c, d are stored, and a flip of the
/// third axis in the sign of pixdim[0] (where 0 means 1).
fn qform(raw: &RawHeader, spacing_mm: [f64; 3], unit_mm: f64) -> Result<WorldFromVoxel, ReadError> {
    let [b, c, d] = raw.quatern;
    let square = b * b + c * c + d * d;
    if !square.is_finite() || square > 1.0 + QUATERNION_EXCESS {
        let reason = format!("b² + c² + d² of the quaternion is {square}, at most 1 is a rotation");
        return Err(ReadError::BadAffine { field: "quatern_b", reason });
    }
    let a = (1.0 - square).max(0.0).sqrt();
    let turn = UnitQuaternion::new_normalize(Quaternion::new(a, b, c, d)).to_rotation_matrix();
    let flip = if raw.pixdim[0] < 0.0 { -1.0 } else { 1.0 };
    let edges = [spacing_mm[0], spacing_mm[1], spacing_mm[2] * flip];
    let rows = std::array::from_fn(|r| {
        std::array::from_fn(|c| if c < 3 { turn[(r, c)] * edges[c] } else { raw.qoffset[r] * unit_mm })
    });
    checked("qoffset_x", rows)
}

fn compare_spacing(map: &WorldFromVoxel, raw: &RawHeader, unit_mm: f64, notices: &mut Vec<VolumeNotice>) {
    let from_pixdim = [1, 2, 3].map(|n| raw.pixdim[n].abs() * unit_mm);
    let from_sform = map.spacing_mm();
    let differs = |axis: usize| {
        let (a, b) = (from_sform[axis], from_pixdim[axis]);
        b > 0.0 && b.is_finite() && (a - b).abs() > SPACING_DISAGREEMENT * a
    };
    if (0..3).any(differs) {
        let [a, b] = [from_sform, from_pixdim].map(|edges| edges.map(significant).join(" × "));
        let message = format!("the sform says a spacing of {a} mm, pixdim {b}; the sform was taken");
        notices.push(VolumeNotice { code: "spacing_disagrees", message });
    }
}

/// A qform that is unusable contradicts nothing: it is not looked at where there is an sform.
fn compare_with_qform(
    sform: &WorldFromVoxel,
    raw: &RawHeader,
    dims: [usize; 3],
    unit_mm: f64,
    notices: &mut Vec<VolumeNotice>,
) {
    if raw.qform_code <= 0 {
        return;
    }
    let Ok(spacing_mm) = pixel_spacing(raw, dims, unit_mm) else { return };
    let Ok(qform) = qform(raw, spacing_mm, unit_mm) else { return };
    let are_two_spaces = raw.sform_code >= FIRST_STANDARD_SPACE && raw.sform_code != raw.qform_code;
    if let Some(difference) = difference(sform, &qform, dims, are_two_spaces) {
        let message = format!("qform and sform of the header contradict each other: {difference}; the sform was taken");
        notices.push(VolumeNotice { code: "orientations_disagree", message });
    }
}
