//! Closed surfaces → binary STL, for printers and viewers: LPS mm, the space of DICOM.

use std::io::{self, Write};

use crate::model::{Model, TriangleMesh};

use crate::space::WorldPoint;

/// Begins the file; not `solid`, with which files of text begin.
const HEADER: &str = "medialrep SPACE=LPS UNIT=mm";
const HEADER_BYTES: usize = 80;

/// The closed surfaces of all figures that have one: a sheet with holes has none.
#[must_use]
pub fn surfaces(model: &Model) -> Vec<TriangleMesh> {
    let figures = model.structures.iter().flat_map(|structure| &structure.figures);
    figures.filter_map(|figure| figure.body().smooth_closed()).collect()
}

/// Writes the [`surfaces`] of a model.
///
/// # Errors
/// As [`write_meshes`].
pub fn write(model: &Model, out: &mut dyn Write) -> io::Result<()> {
    write_meshes(&surfaces(model), out)
}

/// Writes meshes one after the other; triangles are counter-clockwise seen from outside.
///
/// # Errors
/// When writing fails, or there are more than 2³² triangles.
pub fn write_meshes(meshes: &[TriangleMesh], out: &mut dyn Write) -> io::Result<()> {
    let count = meshes.iter().map(|mesh| mesh.triangles.len()).sum::<usize>();
    let mut header = [0; HEADER_BYTES];
    header[..HEADER.len()].copy_from_slice(HEADER.as_bytes());
    out.write_all(&header)?;
    out.write_all(&u32::try_from(count).map_err(io::Error::other)?.to_le_bytes())?;
    for mesh in meshes {
        for triangle in &mesh.triangles {
            write_triangle(triangle.map(|corner| mesh.positions[corner as usize]), out)?;
        }
    }
    Ok(())
}

fn write_triangle(corners: [WorldPoint; 3], out: &mut dyn Write) -> io::Result<()> {
    // A turn by half about the third axis: triangles keep their front.
    let [a, b, c] = corners.map(|corner| WorldPoint::new(-corner.x, -corner.y, corner.z));
    let normal = (b - a).cross(&(c - a)).try_normalize(0.0).unwrap_or_default();
    let mut bytes = Vec::with_capacity(50);
    for vector in [normal, a.coords, b.coords, c.coords] {
        for coordinate in vector.iter() {
            #[expect(clippy::cast_possible_truncation, reason = "the format has single precision")]
            bytes.extend((*coordinate as f32).to_le_bytes());
        }
    }
    // No attributes.
    bytes.extend([0; 2]);
    out.write_all(&bytes)
}
