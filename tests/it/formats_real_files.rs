//! Real files, where they are there: the expected counts and positions were computed with
//! nibabel 5.4 and written down.

use std::path::{Path, PathBuf};

use medialrep::formats::{InputLimits, read_file};
use nalgebra::{Point3, Vector3};

use crate::help::left_out::left_out;

/// The folder of real segmentations: `MEDIALREP_SHARED`, else `../shared` beside the
/// repository. `None` when it is not there.
#[track_caller]
fn shared_data() -> Option<PathBuf> {
    let beside = || Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared");
    let folder = std::env::var_os("MEDIALREP_SHARED").map_or_else(beside, PathBuf::from).join("data");
    if !folder.is_dir() {
        left_out(&format!("no real files at {}", folder.display()));
        return None;
    }
    Some(folder)
}

/// File, dims, (label, voxels) ascending, world position of voxel (1, 2, 3).
type Case = (&'static str, [usize; 3], &'static [(i64, u64)], [f64; 3]);

const CASES: [Case; 13] = [
    ("masks/bigbrain_caudate_L.nii.gz", [40, 105, 85], &[(1, 39986)], [-22.0, -24.0, -12.5]),
    ("masks/cmrep_caudate.nii.gz", [22, 43, 54], &[(1, 4079)], [-130.0, -119.8438, 86.3281]),
    ("masks/cmrep_hippocampus_t001.nii.gz", [29, 38, 39], &[(1, 2281)], [-54.6896, -97.66, 44.0]),
    ("masks/ct_kidney_left.nii.gz", [30, 31, 41], &[(1, 5144)], [-117.9563, 86.319, 307.3018]),
    ("masks/rt_Rectum.nii.gz", [33, 38, 88], &[(1, 15750)], [20.951, -14.3581, -119.375]),
    ("masks/supraspinatus_L.nii.gz", [51, 37, 19], &[(1, 2994)], [-191.9643, -98.2143, -61.5]),
    ("volumes/bigbrain.nii.gz", [310, 374, 317], BIGBRAIN, [-76.5, -108.0, -69.5]),
    ("volumes/caudate_target.nii.gz", [256, 256, 192], &[(1, 4079)], [-1.0156, -2.0312, 3.0469]),
    ("volumes/fs_brain_hipp_L_manual.nii.gz", [160, 256, 240], &[(1, 1239)], [-95.6528, -123.339, -135.6029]),
    ("volumes/kidney_left.nii.gz", [122, 101, 112], &[(1, 5144)], [-174.9563, 17.319, 103.3018]),
    ("volumes/shoulder_left_labels.nii.gz", [99, 67, 59], SHOULDER, [-245.5357, -125.0, -163.5]),
    ("volumes/spleen.nii.gz", [122, 101, 112], &[(1, 9677)], [-174.9563, 17.319, 103.3018]),
    ("volumes/t001_img_binary.nii.gz", [41, 50, 51], &[(127, 2281)], [-48.83, -91.8004, 38.0]),
];

const SHOULDER: &[(i64, u64)] = &[(2101, 2994), (2111, 8489), (2121, 7102), (2141, 9542), (4101, 2899)];

#[rustfmt::skip]
const BIGBRAIN: &[(i64, u64)] = &[
    (1, 2536), (2, 2558), (3, 3791), (4, 4127), (5, 1252), (6, 1315), (7, 39986), (8, 36254), (9, 53385),
    (10, 53960), (11, 10718), (12, 9683), (13, 4405), (14, 4825), (15, 66104), (16, 66745), (17, 34503),
    (18, 33468), (19, 4499), (20, 4886), (21, 16032), (22, 15722),
];

#[test]
fn real_files_are_read_as_nibabel_reads_them() {
    let Some(folder) = shared_data() else { return };
    CASES.into_iter().for_each(|case| check(&folder, case));
}

fn check(folder: &Path, (name, dims, labels, position): Case) {
    let volume = read_file(&folder.join(name), InputLimits::default(), &medialrep::cancel::Never).unwrap().volume;
    assert_eq!(volume.dims(), dims, "{name}");
    let found = volume.labels().iter().zip(1..).map(|(label, index)| (label.value, volume.voxels_of(index)));
    assert_eq!(found.collect::<Vec<_>>(), labels, "{name}");
    let at = volume.world_from_voxel().point(Point3::new(1.0, 2.0, 3.0)).coords;
    assert!((at - Vector3::from(position)).abs().max() < 2e-4, "{name}: {at}");
}

/// As SimpleITK 2.5 reads them, but for the last: Slicer 4 wrote the place in its own way, RAS and by an extent.
const NRRD_CASES: [Case; 4] = [
    ("nrrd/Segmentation.seg.nrrd", [128, 128, 34], SEGMENTATION, [-190.0491, -210.3022, -310.25]),
    ("nrrd/heart_seg.nrrd", [512, 512, 3], &[(3, 41449)], [234.3895, 225.1789, -125.69]),
    ("nrrd/EclipseProstate_Rectum_IndexedLabelmap.nrrd", [272, 172, 184], &[(7, 15750)], [162.201, 103.1419, -119.375]),
    ("nrrd/EclipseProstate_Expanded_5_5_5_Rectum.seg.nrrd", [46, 52, 48], &[(1, 34608)], [23.4376, -11.7186, -120.0]),
];

const SEGMENTATION: &[(i64, u64)] = &[(1, 8487), (2, 1216), (3, 2712), (4, 3259), (5, 34450), (6, 33700), (7, 154_589)];

#[test]
fn real_nrrd_files_are_read_as_itk_reads_them() {
    let Some(folder) = shared_data() else { return };
    NRRD_CASES.into_iter().for_each(|case| check(&folder, case));
}
