//! Where the voxels of a MetaImage lie: a matrix of directions, an offset and spacings, in LPS and millimetres.

use crate::formats::read::error::ReadError;
use crate::formats::read::lines::{Fields, Line, LineFault};
use crate::formats::read::place::{LPS, checked, no_orientation, rows};
use crate::space::{VolumeNotice, WorldFromVoxel};

const MILLIMETRES: &str = "save it in millimetres";

/// The voxel-to-world map in millimetres; what was odd is added to `notices`.
///
/// # Errors
/// When the axes do not span space, or are in another unit.
pub(super) fn world_from_voxel(
    fields: &Fields,
    rank: usize,
    notices: &mut Vec<VolumeNotice>,
) -> Result<WorldFromVoxel, ReadError> {
    if let Some(line) = fields.get("DistanceUnits")
        && !matches!(line.value.to_ascii_lowercase().as_str(), "mm" | "?" | "")
    {
        return Err(line.unsupported("a unit of length other than mm", MILLIMETRES));
    }
    let spacing_line = match fields.get("ElementSpacing") {
        Some(line) => line,
        None => fields.get("ElementSize").ok_or(ReadError::NoHeaderLine { field: "ElementSpacing" })?,
    };
    let spacing_mm = padded(spacing_line, rank, 1.0)?;
    let directions = directions(fields.get("TransformMatrix"), rank, notices)?;
    let origin = match fields.get("Offset") {
        Some(line) => padded(line, rank, 0.0)?,
        None => {
            let message = "the header has no Offset: the first voxel was placed at the origin of the world";
            notices.push(VolumeNotice { code: "no_origin", message: message.to_owned() });
            [0.0; 3]
        }
    };
    let mut axes = directions;
    for (axis, edge) in axes.iter_mut().zip(spacing_mm) {
        *axis = axis.map(|entry| entry * edge);
    }
    let line = fields.get("TransformMatrix").unwrap_or(spacing_line);
    checked(rows(axes, origin, LPS)).map_err(|reason| line.fault(LineFault::Orientation { reason }))
}

/// The first three of `rank` numbers, with `missing` where there are two.
fn padded(line: &Line, rank: usize, missing: f64) -> Result<[f64; 3], ReadError> {
    let numbers = line.numbers(rank, "as many finite numbers as there are dimensions")?;
    let mut three = [missing; 3];
    for (place, number) in three.iter_mut().zip(numbers) {
        *place = number;
    }
    Ok(three)
}

/// The directions of the three axes: those of a matrix follow each other in the file.
fn directions(line: Option<&Line>, rank: usize, notices: &mut Vec<VolumeNotice>) -> Result<[[f64; 3]; 3], ReadError> {
    let mut axes = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
    let Some(line) = line else {
        notices.push(no_orientation(
            "the header has no TransformMatrix: the axes were taken to run to the left, to the back and upwards",
        ));
        return Ok(axes);
    };
    let numbers = line.numbers(rank * rank, "a direction for each dimension, of as many finite numbers")?;
    for (axis, direction) in axes.iter_mut().zip(numbers.chunks(rank)) {
        for (entry, number) in axis.iter_mut().zip(direction) {
            *entry = *number;
        }
    }
    Ok(axes)
}
