//! The same solid on other grids is the same result: voxels that were repeated, slices, and lattices by default.

use std::f64::consts::TAU;

use medialrep::model::{LatticeSize, Structure, Verdict};
use medialrep::params::{GridChoice, LatticeKind, Params};
use medialrep::samples::{Patch, Sample, Solid};
use medialrep::space::{Grid, LabelVolume, WorldFromVoxel};
use nalgebra::{Point3, Rotation3, Vector3};

use crate::help::phantoms::{check_invariants, context, counted, defaults, model_of, painted, sample, sent};
use crate::measure::shapes::SHAPES;

/// A mask as the nearest voxels of a finer grid have it: `factors` of them to a voxel along each axis.
#[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "places of small grids")]
fn repeated(volume: &LabelVolume, factors: [f64; 3]) -> LabelVolume {
    let coarse = volume.indices();
    let mut dims = coarse.dims();
    for axis in 0..3 {
        dims[axis] = (dims[axis] as f64 * factors[axis]).ceil() as usize;
    }
    let mut fine = Grid::filled(dims, 0u16);
    for offset in 0..fine.as_slice().len() {
        let mut from = fine.index(offset);
        for axis in 0..3 {
            let place = (from[axis] as f64 + 0.5) / factors[axis];
            from[axis] = (place as usize).min(coarse.dims()[axis] - 1);
        }
        fine.as_mut_slice()[offset] = coarse[from];
    }
    let rows = volume.world_from_voxel().rows();
    let rows = [0, 1, 2].map(|row| {
        let mut scaled = rows[row];
        for axis in 0..3 {
            scaled[axis] /= factors[axis];
            scaled[3] += (scaled[axis] - rows[row][axis]) / 2.0;
        }
        scaled
    });
    counted(fine, WorldFromVoxel::from_rows(rows).expect("axes that were so before"))
}

fn grain_mm(volume: &LabelVolume) -> [f64; 3] {
    let params = defaults();
    sent(volume, &context(&params)).grain_mm
}

fn structure_of(volume: &LabelVolume, params: Params) -> Structure {
    let mut model = model_of(volume, params);
    check_invariants(&model);
    model.structures.remove(0)
}

fn mean_mm(structure: &Structure) -> f64 {
    structure.thickness_summary().total_mm.expect("an area").mean
}

fn oblique() -> Rotation3<f64> {
    Rotation3::from_euler_angles(0.31, -0.12, 0.07)
}

/// A flat elliptic plate of 80 × 60 × 12 mm with a round rim, tilted by so many degrees in slices along z.
fn tilted_plate(degrees: f64, spacing_mm: [f64; 3]) -> LabelVolume {
    let ellipse = Patch::new(
        |s, t| {
            let (sin, cos) = (TAU * t).sin_cos();
            Point3::new(34.0 * s * cos, 24.0 * s * sin, 0.0)
        },
        |_, _| 6.0,
    );
    let plate = Sample::new("plate", "a flat plate", vec![Solid::new(1, vec![ellipse])]);
    let tilt = Rotation3::from_axis_angle(&Vector3::y_axis(), degrees.to_radians());
    plate.voxelise(spacing_mm, tilt).expect("fits in memory")
}

#[test]
fn masks_have_the_grain_that_they_are_stored_with() {
    for shape in SHAPES {
        for turn in [Rotation3::identity(), oblique()] {
            let volume = sample(shape.sample).voxelise([1.0; 3], turn).expect("fits in memory");
            let found = grain_mm(&volume);
            assert!(found.iter().all(|mm| (mm - 1.0).abs() < 1e-9), "{}: {found:?}", shape.sample);
        }
    }
}

#[test]
fn the_grain_of_repeated_voxels_is_found() {
    for name in ["ellipsoid", "leaf", "twisted"] {
        let coarse = sample(name).voxelise([1.0; 3], oblique()).expect("fits in memory");
        for factors in [[2.0; 3], [3.0; 3], [1.0, 1.0, 5.0], [1.0, 2.0, 1.0]] {
            let found = grain_mm(&repeated(&coarse, factors));
            for axis in 0..3 {
                assert!((found[axis] - 1.0).abs() < 1e-9, "{name} {factors:?}: {found:?}");
            }
        }
        for factor in [1.5, 1.7, 2.4] {
            let found = grain_mm(&repeated(&coarse, [factor; 3]));
            assert!(found.iter().all(|mm| (mm - 1.0).abs() < 0.01), "{name} {factor}: {found:?}");
        }
    }
}

#[test]
fn two_flat_banks_have_no_grain_of_their_own() {
    // The faces of a ribbon that is folded on itself lie on few planes along z: they fit to many a factor.
    for gap in [1.0, 2.0, 3.0] {
        let folded = painted([80, 42, 30], [1.0; 3], |at| {
            let (x, y, z) = (at[0] as f64 - 38.3, at[1] as f64 - 20.2, at[2] as f64 - 14.4);
            let middle = 2.5 + gap / 2.0;
            let banks = (z.abs() - middle).abs() <= 2.5 && (-30.0..=0.0).contains(&x);
            let turn = (x.hypot(z) - middle).abs() <= 2.5 && x >= 0.0;
            u16::from((banks || turn) && y.abs() <= 16.0)
        });
        assert_eq!(grain_mm(&folded), [1.0; 3], "{gap}");
    }
}

#[test]
fn repeated_voxels_give_the_result_of_the_solid() {
    let coarse = sample("leaf").voxelise([1.0; 3], oblique()).expect("fits in memory");
    let once = structure_of(&coarse, Params::default());
    for (factor, nodes_mm) in [(2.0, 1e-6), (3.0, 1e-6), (1.5, 0.5)] {
        let again = structure_of(&repeated(&coarse, [factor; 3]), Params::default());
        assert!(again.grain_mm.iter().all(|mm| (mm - 1.0).abs() < 0.01), "{factor}: {:?}", again.grain_mm);
        assert_eq!(again.figures.len(), once.figures.len(), "{factor}");
        assert_eq!(again.quality.verdict, once.quality.verdict, "{factor}: {:?}", again.quality.reasons);
        let ratio = mean_mm(&again) / mean_mm(&once);
        assert!((ratio - 1.0).abs() < 0.01, "{factor}: {ratio}");
        for (a, b) in again.sheets().zip(once.sheets()) {
            assert_eq!(a.grid, b.grid, "{factor}");
            let off = crate::help::phantoms::drift(a, b);
            assert!(off < nodes_mm, "{factor}: {off} mm");
        }
    }
}

#[test]
fn a_plate_tilted_in_its_slices_is_one_plate() {
    let thick = tilted_plate(20.0, [1.0, 1.0, 3.0]);
    let stored = structure_of(&thick, Params::default());
    let thin = structure_of(&repeated(&thick, [1.0, 1.0, 3.0]), Params::default());
    for (structure, spacing_mm) in [(&stored, 3.0), (&thin, 1.0)] {
        assert_eq!(structure.figures.len(), 1, "slices of {spacing_mm} mm");
        assert!((structure.grain_mm[2] - 3.0).abs() < 1e-9, "{:?}", structure.grain_mm);
        let mean = mean_mm(structure);
        assert!((mean - 12.0).abs() <= 0.6, "{mean} mm in slices of {spacing_mm} mm");
    }
}

/// A round flat plate, 80 mm across, with a round rim, tilted by 25°, in voxels of 1 mm.
fn tilted_disk(thickness_mm: f64) -> LabelVolume {
    let radius = thickness_mm / 2.0;
    let disk = Patch::new(
        move |s, t| {
            let (sin, cos) = (TAU * t).sin_cos();
            Point3::new((40.0 - radius) * s * cos, (40.0 - radius) * s * sin, 0.0)
        },
        move |_, _| radius,
    );
    let tilt = Rotation3::from_axis_angle(&Vector3::y_axis(), 25f64.to_radians());
    let disk = Sample::new("disk", "a flat disk", vec![Solid::new(1, vec![disk])]);
    disk.voxelise([1.0; 3], tilt).expect("fits in memory")
}

#[test]
fn a_disk_of_few_voxels_is_a_sheet_as_thick_as_it_is() {
    for thickness_mm in [3.0, 4.0, 5.0] {
        let structure = structure_of(&tilted_disk(thickness_mm), Params::default());
        assert_eq!(structure.figures.len(), 1, "{thickness_mm}");
        let (mean, quality) = (mean_mm(&structure), &structure.quality);
        assert!((mean - thickness_mm).abs() < 0.25, "{mean} mm of {thickness_mm}");
        assert_eq!(quality.verdict, Verdict::Pass, "{thickness_mm} mm: {:?}", quality.reasons);
        assert!(quality.coverage.dice > 0.95, "{thickness_mm} mm: {}", quality.coverage.dice);
    }
}

#[test]
fn the_verdict_is_that_of_the_shape_not_of_its_lattice() {
    let leaf = sample("leaf").voxelise([1.0; 3], oblique()).expect("fits in memory");
    let mut dice = Vec::new();
    for (rows, cols) in [(4, 6), (6, 8), (12, 20), (20, 32)] {
        let structure = structure_of(&leaf, Params { grid: GridChoice::Fixed { rows, cols }, ..Params::default() });
        let quality = &structure.quality;
        assert_eq!(quality.verdict, Verdict::Pass, "{rows} × {cols}: {:?}", quality.reasons);
        dice.push([quality.coverage.dice, quality.coverage.flat_dice]);
    }
    // What flat quads leave out is told beside it.
    let [[smooth, flat], .., [finest, _]] = dice[..] else { panic!("{dice:?}") };
    assert!(smooth > flat + 0.02 && finest - smooth < 0.06, "{dice:?}");
}

#[test]
fn the_margin_by_default_is_that_of_the_lattice() {
    for (lattice, margin) in [(LatticeKind::Fitted, 0.0), (LatticeKind::Regular, 0.05)] {
        let params = Params { lattice, ..Params::default() };
        assert_eq!(params.clone().check().expect("in range").margin, Some(margin));
        let asked = Params { margin: Some(0.1), ..params };
        assert_eq!(asked.check().expect("in range").margin, Some(0.1));
    }
}

#[test]
fn a_lattice_by_default_has_the_nodes_that_the_shape_needs() {
    assert_eq!(Params::default().grid, GridChoice::Auto);
    let size = |name: &str, edge_mm: f64| {
        let volume = sample(name).voxelise([edge_mm; 3], Rotation3::identity()).expect("fits in memory");
        structure_of(&volume, Params::default()).sheets().next().expect("a sheet").grid
    };
    let sizes @ [coarse, fine] = [size("bent_even", 2.0), size("bent_even", 1.0)];
    for LatticeSize { rows, cols } in sizes {
        assert!(rows >= 6 && cols >= 8, "{sizes:?}");
    }
    assert!(fine.rows * fine.cols > coarse.rows * coarse.cols, "{sizes:?}");
}
