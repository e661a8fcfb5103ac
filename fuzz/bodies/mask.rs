//! Any bytes as a file of any format: what the header check refuses the reader refuses, what is read fits
//! together, and gzip around it changes nothing.

use std::io::Write;

use medialrep::formats::readers::{check_header, check_magic};
use medialrep::formats::{Identity, InputLimits, ReadError, ReadVolume, read, read_file};
use tempfile::NamedTempFile;

/// Small, so that inputs of a few kilobytes reach them.
pub const LIMITS: InputLimits = InputLimits { max_voxels: 1 << 16, max_decompressed_bytes: 2 << 20 };
/// Most that a block of deflate holds uncompressed.
const STORED_BLOCK: usize = 65_535;

/// What must hold of any bytes.
pub fn check(bytes: &[u8]) {
    let mut file = NamedTempFile::new().unwrap();
    file.write_all(bytes).unwrap();
    let header = check_header(file.path(), LIMITS);
    // Of anything, as archives send it.
    let _ = Identity::of_head(bytes);
    match (read_file(file.path(), LIMITS, &medialrep::cancel::Never), header) {
        (Ok(found), Ok(facts)) => {
            assert_eq!(facts.voxels, found.volume.indices().as_slice().len() as u64);
            assert!(check_magic(bytes).is_ok());
            check_volume(&found);
            assert_eq!(found.bytes, bytes.len() as u64);
        }
        (Err(found), Ok(_)) => check_error(&found),
        (Err(found), Err(header)) => {
            check_error(&found);
            assert_eq!(found.to_string(), header.to_string());
        }
        (Ok(_), Err(header)) => panic!("the header is refused, the file is read: {header}"),
    }
}

/// The same content in gzip, in one member and in two, is read as it is without.
pub fn check_in_gzip(bytes: &[u8]) {
    if bytes.starts_with(&[0x1f, 0x8b]) {
        return;
    }
    let plain = read(bytes, LIMITS);
    let (left, right) = bytes.split_at(bytes.len() / 3);
    for packed in [stored(&[bytes]), stored(&[left, right])] {
        match (&plain, read(&packed[..], LIMITS)) {
            (Ok(plain), Ok(unpacked)) => {
                assert_eq!(unpacked.format, format!("{}.gz", plain.format));
                assert_eq!(unpacked.volume, plain.volume);
            }
            (Err(plain), Err(unpacked)) => assert_eq!(unpacked.to_string(), plain.to_string()),
            (plain, unpacked) => panic!("plain: {plain:?}, in gzip: {unpacked:?}"),
        }
    }
}

fn check_volume(found: &ReadVolume) {
    let volume = &found.volume;
    let count = volume.indices().as_slice().len();
    assert_eq!(volume.dims().iter().product::<usize>(), count);
    assert!(count as u64 <= LIMITS.max_voxels);
    assert!((volume.layers().count() * count) as u64 <= 4 * LIMITS.max_voxels);
    let labels = volume.labels();
    assert!(labels.is_sorted_by(|a, b| a.value < b.value) && labels.iter().all(|label| label.value != 0));
    for name in labels.iter().filter_map(|label| label.name.as_deref()) {
        assert!(!name.is_empty() && name.chars().count() <= 80 && !name.chars().any(char::is_control));
    }
    let mut voxels = vec![0; labels.len() + 1];
    for layer in volume.layers() {
        assert_eq!(layer.dims(), volume.dims());
        layer.as_slice().iter().for_each(|index| voxels[usize::from(*index)] += 1);
    }
    for (index, voxels) in (1..=u16::MAX).zip(&voxels[1..]) {
        assert_eq!(volume.voxels_of(index), *voxels);
        let own = volume.layer_of(index).as_slice().iter().filter(|found| **found == index).count();
        assert!(*voxels > 0 && own as u64 == *voxels);
    }
    let world_from_voxel = volume.world_from_voxel();
    assert!(world_from_voxel.rows().iter().flatten().all(|entry| entry.is_finite()));
    assert!(world_from_voxel.spacing_mm().iter().all(|spacing| *spacing > 0.0 && spacing.is_finite()));
    assert_eq!(found.sha256.len(), 64);
}

/// Bytes are never our fault or the disk's.
fn check_error(error: &ReadError) {
    assert!((400..500).contains(&error.status()), "{error}");
}

/// Gzip without compression: quick to make, and every byte of the input stays one of the output.
fn stored(members: &[&[u8]]) -> Vec<u8> {
    let mut out = Vec::new();
    for content in members {
        out.extend([0x1f, 0x8b, 8, 0, 0, 0, 0, 0, 0, 255]);
        let mut rest = *content;
        loop {
            let (block, after) = rest.split_at(rest.len().min(STORED_BLOCK));
            let length = u16::try_from(block.len()).unwrap();
            out.push(u8::from(after.is_empty()));
            out.extend([length.to_le_bytes(), (!length).to_le_bytes()].as_flattened());
            out.extend(block);
            rest = after;
            if rest.is_empty() {
                break;
            }
        }
        let mut crc = flate2::Crc::new();
        crc.update(content);
        out.extend([crc.sum().to_le_bytes(), crc.amount().to_le_bytes()].as_flattened());
    }
    out
}
