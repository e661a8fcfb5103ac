//! Label map → gzip NIfTI-1, for samples and tests.

use std::io::{self, Write};

use flate2::{Compression, GzBuilder};

use crate::space::LabelVolume;

/// Writes `volume` as gzip NIfTI-1 with an sform in mm: uint8 when its labels fit, else int16,
/// else int32. Equal volumes give equal bytes.
///
/// # Errors
/// When writing fails, an axis is longer than NIfTI-1 can say, a label is no int32, or labels overlap.
pub fn write(volume: &LabelVolume, out: impl Write) -> io::Result<()> {
    let unfit = |what: &str| io::Error::new(io::ErrorKind::InvalidInput, format!("{what} does not fit NIfTI-1"));
    if volume.layers().count() > 1 {
        return Err(unfit("a label that overlaps another"));
    }
    let fits = |low: i64, high: i64| volume.labels().iter().all(|label| (low..=high).contains(&label.value));
    let size = match () {
        () if fits(0, 255) => 1,
        () if fits(i64::from(i16::MIN), i64::from(i16::MAX)) => 2,
        () if fits(i64::from(i32::MIN), i64::from(i32::MAX)) => 4,
        () => return Err(unfit("a label")),
    };
    let mut dims = [0_i16; 3];
    for (dim, length) in dims.iter_mut().zip(volume.dims()) {
        *dim = i16::try_from(length).map_err(|_| unfit("an axis"))?;
    }
    let mut gzip = GzBuilder::new().mtime(0).write(out, Compression::default());
    gzip.write_all(&header(volume, dims, size))?;
    let mut patterns = vec![[0; 4]];
    for label in volume.labels() {
        patterns.push(i32::try_from(label.value).map_err(|_| unfit("a label"))?.to_le_bytes());
    }
    for slice in volume.indices().as_slice().chunks(1 << 16) {
        let bytes: Vec<u8> =
            slice.iter().flat_map(|index| patterns[usize::from(*index)].into_iter().take(size)).collect();
        gzip.write_all(&bytes)?;
    }
    gzip.finish()?.flush()
}

/// 348 bytes and the four that say there are no extensions.
#[allow(clippy::cast_possible_truncation, reason = "NIfTI-1 keeps its lengths as float32")]
fn header(volume: &LabelVolume, dims: [i16; 3], size: usize) -> [u8; 352] {
    let mut bytes = [0; 352];
    let mut put = |offset: usize, field: &[u8]| bytes[offset..offset + field.len()].copy_from_slice(field);
    put(0, &348_i32.to_le_bytes());
    put(40, &3_i16.to_le_bytes());
    for (axis, dim) in dims.iter().enumerate() {
        put(42 + 2 * axis, &dim.to_le_bytes());
    }
    for axis in 3..7 {
        put(42 + 2 * axis, &1_i16.to_le_bytes());
    }
    let (datatype, bitpix): (i16, i16) = match size {
        1 => (2, 8),
        2 => (4, 16),
        _ => (8, 32),
    };
    put(70, &datatype.to_le_bytes());
    put(72, &bitpix.to_le_bytes());
    put(76, &1.0_f32.to_le_bytes());
    for (axis, spacing) in volume.world_from_voxel().spacing_mm().iter().enumerate() {
        put(80 + 4 * axis, &(*spacing as f32).to_le_bytes());
    }
    put(108, &352.0_f32.to_le_bytes());
    put(112, &1.0_f32.to_le_bytes());
    // Millimetres.
    put(123, &[2]);
    // The sform is in scanner coordinates.
    put(254, &1_i16.to_le_bytes());
    for (row, entries) in volume.world_from_voxel().rows().iter().take(3).enumerate() {
        for (column, entry) in entries.iter().enumerate() {
            put(280 + 16 * row + 4 * column, &(*entry as f32).to_le_bytes());
        }
    }
    put(344, b"n+1\0");
    bytes
}
