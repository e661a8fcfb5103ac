//! Files as they are read.

use std::io::Read;

use medialrep::formats::{InputLimits, ReadVolume, read};
use medialrep::space::LabelVolume;
use nalgebra::{Point3, Vector3};

use super::text_bytes::TextFile;

#[track_caller]
pub fn read_all(file: &TextFile) -> ReadVolume {
    read(file.bytes().as_slice(), InputLimits::default()).unwrap()
}

/// Value per voxel of the first layer.
pub fn values(volume: &LabelVolume) -> Vec<i64> {
    let value = |index: &u16| volume.label(*index).map_or(0, |label| label.value);
    volume.indices().as_slice().iter().map(value).collect()
}

/// Where the first and the last voxel of a file of 4 × 3 × 2 lie.
#[track_caller]
pub fn check_place(file: &TextFile, first: [f64; 3], last: [f64; 3]) {
    let world_from_voxel = read_all(file).volume.world_from_voxel();
    for (voxel, expected) in [([0.0; 3], first), ([3.0, 2.0, 1.0], last)] {
        let found = world_from_voxel.point(Point3::from(voxel)).coords;
        assert!((found - Vector3::from(expected)).norm() < 1e-12, "{voxel:?}: {found} instead of {expected:?}");
    }
}

/// A reader that counts what is taken from it.
pub struct Counting<'a>(pub &'a [u8], pub &'a mut usize);

impl Read for Counting<'_> {
    fn read(&mut self, buffer: &mut [u8]) -> std::io::Result<usize> {
        let count = self.0.read(buffer)?;
        *self.1 += count;
        Ok(count)
    }
}
