//! Where the voxels of a NRRD lie: directions and origin in a space of the patient, else spacings.

use nalgebra::Vector3;

use super::header::Header;
use super::layout::Layout;
use super::vectors::vectors;
use crate::formats::read::error::ReadError;
use crate::formats::read::lines::{Line, LineFault};
use crate::formats::read::place::{LPS, Signs, checked, no_orientation, rows};
use crate::space::{VolumeNotice, WorldFromVoxel};

const RAS: Signs = [1.0, 1.0, 1.0];
const LAS: Signs = [-1.0, 1.0, 1.0];

const NAME_SPACE: &str =
    "name the space of the patient that the axes are in: `space: left-posterior-superior` or right-anterior-superior";
const MILLIMETRES: &str = "save it in millimetres";

/// The voxel-to-world map in millimetres; what was odd is added to `notices`.
///
/// # Errors
/// When the space is none of a patient, or the axes do not span it.
pub(super) fn world_from_voxel(
    header: &Header,
    layout: &Layout,
    notices: &mut Vec<VolumeNotice>,
) -> Result<WorldFromVoxel, ReadError> {
    let fields = &header.fields;
    if let Some(line) = fields.get("space") {
        return in_space(header, layout, signs(line)?, 3, notices);
    }
    if let Some(line) = fields.get("space dimension") {
        return slicer_4(header, layout, line, notices);
    }
    if let Some(line) = fields.get("space directions") {
        return Err(line.unsupported("a direction in no space", NAME_SPACE));
    }
    notices.push(no_orientation(
        "the header names no space: axes and sides of the patient are not known, positions are voxel indices times \
         spacings",
    ));
    spacings(fields.needed("spacings")?, fields.get("units"), layout, notices)
}

/// The signs of the axes of a space, in both spellings.
fn signs(line: &Line) -> Result<Signs, ReadError> {
    match line.value.to_ascii_lowercase().as_str() {
        "right-anterior-superior" | "ras" => Ok(RAS),
        "left-anterior-superior" | "las" => Ok(LAS),
        "left-posterior-superior" | "lps" => Ok(LPS),
        _ => Err(line.unsupported("a space other than RAS, LAS and LPS", NAME_SPACE)),
    }
}

/// What Slicer 4 wrote: four axes of space, RAS, of which the last counts segments, and the origin of the image that
/// was segmented, of which the file keeps a part.
fn slicer_4(
    header: &Header,
    layout: &Layout,
    line: &Line,
    notices: &mut Vec<VolumeNotice>,
) -> Result<WorldFromVoxel, ReadError> {
    match header.extent {
        Some(extent) if line.value == "4" => {
            let map = in_space(header, layout, RAS, 4, notices)?.shifted_to(Vector3::from(extent.first));
            Ok(map)
        }
        _ => Err(line.unsupported("a space without a name", NAME_SPACE)),
    }
}

/// From directions and origin in a space with `rank` coordinates, of which the first three are taken.
fn in_space(
    header: &Header,
    layout: &Layout,
    signs: Signs,
    rank: usize,
    notices: &mut Vec<VolumeNotice>,
) -> Result<WorldFromVoxel, ReadError> {
    let fields = &header.fields;
    let line = fields.needed("space directions")?;
    let unit_mm = match fields.get("space units") {
        Some(line) => unit_mm(line, notices)?,
        None => 1.0,
    };
    let mut axes = [[0.0; 3]; 3];
    let found = of_space(line, vectors(line)?, layout)?;
    for (axis, vector) in axes.iter_mut().zip(&found) {
        *axis = point(line, vector.as_deref(), rank, unit_mm)?;
    }
    let origin = match fields.get("space origin") {
        Some(line) => match vectors(line)?.as_slice() {
            [vector] => point(line, vector.as_deref(), rank, unit_mm)?,
            _ => return Err(line.malformed("one vector in brackets")),
        },
        None => {
            let message = "the header has no space origin: the first voxel was placed at the origin of the world";
            notices.push(VolumeNotice { code: "no_origin", message: message.to_owned() });
            [0.0; 3]
        }
    };
    checked(rows(axes, origin, signs)).map_err(|reason| line.fault(LineFault::Orientation { reason }))
}

/// What is said of each axis, without that of layers.
fn of_space<T>(line: &Line, mut said: Vec<T>, layout: &Layout) -> Result<Vec<T>, ReadError> {
    let axes = 3 + usize::from(layout.layer_axis.is_some());
    if said.len() != axes {
        return Err(line.malformed("one entry for each axis"));
    }
    if let Some(axis) = layout.layer_axis {
        said.remove(axis);
    }
    Ok(said)
}

/// The first three coordinates, in millimetres.
fn point(line: &Line, vector: Option<&[f64]>, rank: usize, unit_mm: f64) -> Result<[f64; 3], ReadError> {
    match vector {
        Some([x, y, z, ..]) if vector.is_some_and(|vector| vector.len() == rank) => {
            Ok([*x, *y, *z].map(|entry| entry * unit_mm))
        }
        _ if rank == 4 => Err(line.malformed("vectors of four finite numbers")),
        _ => Err(line.malformed("vectors of three finite numbers for the axes of space")),
    }
}

/// Axis-aligned voxels from their edges.
fn spacings(
    line: &Line,
    units: Option<&Line>,
    layout: &Layout,
    notices: &mut Vec<VolumeNotice>,
) -> Result<WorldFromVoxel, ReadError> {
    let expected = "one finite spacing for each axis of space";
    let said = of_space(line, line.words().take(5).collect(), layout)?;
    let unit_mm = match units {
        Some(line) => unit_mm(line, notices)?,
        None => 1.0,
    };
    let mut axes = [[0.0; 3]; 3];
    for (axis, word) in said.into_iter().enumerate() {
        let edge: f64 = word.parse().map_err(|_| line.malformed(expected))?;
        axes[axis][axis] = edge.abs() * unit_mm;
    }
    checked(rows(axes, [0.0; 3], RAS)).map_err(|reason| line.fault(LineFault::Orientation { reason }))
}

/// Millimetres in the unit of length that all axes have, in quotes; none and unknown mean millimetres.
fn unit_mm(line: &Line, notices: &mut Vec<VolumeNotice>) -> Result<f64, ReadError> {
    let mut common = None;
    // What is between two quotes, of every second part.
    for unit in line.value.split('"').skip(1).step_by(2) {
        let unit_mm = match unit.trim().to_ascii_lowercase().as_str() {
            "" | "???" | "none" => continue,
            "mm" | "millimeter" | "millimeters" => Some(1.0),
            "cm" => Some(10.0),
            "m" => Some(1000.0),
            "um" | "µm" | "μm" | "micron" | "microns" => Some(0.001),
            _ => None,
        };
        match common {
            Some(other) if other != unit_mm => return Err(line.unsupported("a unit for each axis", MILLIMETRES)),
            _ => common = Some(unit_mm),
        }
    }
    match common {
        Some(Some(unit_mm)) => Ok(unit_mm),
        Some(None) => {
            let message =
                format!("the unit of length in header line {} is unknown; millimetres were taken", line.number);
            notices.push(VolumeNotice { code: "unknown_unit", message });
            Ok(1.0)
        }
        None => Ok(1.0),
    }
}
