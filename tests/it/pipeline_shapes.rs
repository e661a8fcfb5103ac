//! The pipeline on shapes with a known answer.

use medialrep::samples::Sample;
use medialrep::space::{LabelVolume, WorldFromVoxel};
use nalgebra::Rotation3;

use crate::help::phantoms::{
    check_invariants, counted, drift, model_of, params, rms, roughened, sample, turned, volume,
};

/// Bars of one shape, in voxels of 1 mm. Flat faces that lie along the grid cannot be placed
/// better than half a voxel.
#[derive(Clone, Copy)]
struct Bars {
    medial: f64,
    skin: f64,
    radius: f64,
    dice: f64,
}

fn check_single_sheet(name: &str, spacing_mm: [f64; 3], bars: &Bars) {
    let shape = sample(name);
    let volume = shape.voxelise(spacing_mm, Rotation3::identity()).expect("fits");
    let model = model_of(&volume, params());
    check_invariants(&model);
    let structure = &model.structures[0];
    assert_eq!(structure.figures.len(), 1, "{name} is one sheet");
    let figure = structure.sheets().next().expect("a sheet");
    let medial = rms(figure.medial.iter().map(|p| shape.to_sheet_mm(*p)));
    let skin = rms(figure.upper.iter().chain(&figure.lower).map(|p| shape.signed_mm(*p)));
    let radius =
        rms(figure.medial.iter().zip(&figure.medial_radius_mm).map(|(p, r)| r / true_radius(&shape, *p) - 1.0));
    let found = format!(
        "{name}: medial {medial:.3} skin {skin:.3} radius {radius:.3} dice {:.3}",
        structure.quality.coverage.dice
    );
    assert!(medial <= bars.medial && skin <= bars.skin && radius <= bars.radius, "{found}");
    assert!(structure.quality.coverage.dice >= bars.dice, "{found}");
    assert!(figure.quality.spacing_variation <= 0.05, "spacing {}", figure.quality.spacing_variation);
    assert!(figure.quality.folds as f64 <= 0.01 * figure.quality.corners as f64, "{} folds", figure.quality.folds);
    assert!(figure.valid.iter().all(|v| *v), "every node of a fitted lattice lies on the sheet");
}

fn true_radius(shape: &Sample, p: medialrep::space::WorldPoint) -> f64 {
    shape.solids()[0].radius_mm(p)
}

const PLAIN: Bars = Bars { medial: 0.3, skin: 0.25, radius: 0.03, dice: 0.95 };

#[test]
fn an_ellipsoid_is_one_flat_sheet() {
    check_single_sheet("ellipsoid", [1.0; 3], &PLAIN);
}

#[test]
fn a_bent_slab_is_one_sheet() {
    check_single_sheet("bent_even", [1.0; 3], &PLAIN);
}

#[test]
fn a_bump_does_not_split_the_sheet() {
    check_single_sheet("bump", [1.0; 3], &PLAIN);
}

#[test]
fn a_slab_bent_nearly_onto_itself_is_one_sheet() {
    // The round rim is as thick as the sheet is wide, and is filled by wedges.
    check_single_sheet("thick_bend", [1.0; 3], &Bars { dice: 0.93, ..PLAIN });
}

#[test]
fn a_half_bent_slab_is_one_sheet() {
    check_single_sheet("half_bent", [1.0; 3], &PLAIN);
}

#[test]
fn a_twisted_slab_is_one_sheet() {
    check_single_sheet("twisted", [1.0; 3], &PLAIN);
}

#[test]
fn anisotropic_voxels_cost_accuracy_but_no_sheet() {
    let bars = Bars { medial: 0.4, skin: 0.5, radius: 0.08, dice: 0.93 };
    check_single_sheet("bent_even", [1.0, 1.0, 2.5], &bars);
    check_single_sheet("ellipsoid", [1.0, 1.0, 2.5], &bars);
}

fn check_branching(name: &str, sheets: usize) {
    for rotation in [Rotation3::identity(), turned()] {
        let volume = sample(name).voxelise([1.0; 3], rotation).expect("fits");
        let model = model_of(&volume, params());
        check_invariants(&model);
        let structure = &model.structures[0];
        assert_eq!(structure.figures.len(), sheets, "{name}");
        let all: Vec<usize> = (0..sheets).collect();
        assert!(structure.junctions.iter().any(|j| j.figures == all), "{name} meets in one hinge");
    }
}

#[test]
fn a_tee_is_three_sheets_that_meet_in_one_hinge() {
    check_branching("tee", 3);
}

#[test]
fn a_wye_is_three_sheets_that_meet_in_one_hinge() {
    check_branching("wye", 3);
}

#[test]
fn a_cross_is_four_sheets_that_meet_in_one_hinge() {
    check_branching("cross", 4);
}

#[test]
fn boundary_noise_makes_no_sheets() {
    for (name, sheets) in [("bent_even", 1), ("ellipsoid", 1), ("wye", 3)] {
        let model = model_of(&roughened(&volume(name), 0.05), params());
        check_invariants(&model);
        assert_eq!(model.structures[0].figures.len(), sheets, "{name} with 5 % of its boundary flipped");
    }
}

#[test]
fn the_same_solid_on_a_turned_grid_gives_the_same_nodes() {
    for name in ["bent_even", "half_bent", "twisted"] {
        let turned = sample(name).voxelise([1.0; 3], turned()).expect("fits");
        let (a, b) = (model_of(&volume(name), params()), model_of(&turned, params()));
        let drift =
            drift(a.structures[0].sheets().next().expect("a sheet"), b.structures[0].sheets().next().expect("a sheet"));
        assert!(drift <= 1.0, "{name} drifts by {drift:.2} voxels");
    }
}

/// The same voxels stored with axes permuted (i→j→k→i) and the first one reversed.
fn restored(volume: &LabelVolume) -> LabelVolume {
    let [nx, ny, nz] = volume.dims();
    let mut indices = medialrep::space::Grid::filled([ny, nz, nx], 0u16);
    for k in 0..nz {
        for j in 0..ny {
            for i in 0..nx {
                indices[[ny - 1 - j, k, i]] = volume.indices()[[i, j, k]];
            }
        }
    }
    let old = volume.world_from_voxel().rows();
    let last = (ny - 1) as f64;
    let rows = std::array::from_fn(|r| [-old[r][1], old[r][2], old[r][0], old[r][3] + old[r][1] * last]);
    counted(indices, WorldFromVoxel::from_rows(rows).expect("still an affine"))
}

#[test]
fn permuted_and_mirrored_storage_gives_the_same_nodes() {
    let plain = volume("leaf");
    let (a, b) = (model_of(&plain, params()), model_of(&restored(&plain), params()));
    let drift =
        drift(a.structures[0].sheets().next().expect("a sheet"), b.structures[0].sheets().next().expect("a sheet"));
    assert!(drift <= 0.5, "drift {drift:.3} voxels");
}

#[test]
fn every_thread_count_gives_the_same_result() {
    // Two small structures side by side, and a large one that all threads work on.
    let large = sample("bent_even").voxelise([0.7; 3], turned()).expect("fits in memory");
    for (volume, structures) in [(volume("two"), 2), (large, 1)] {
        let on = |threads: usize| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("a pool");
            pool.install(|| model_of(&volume, params()))
        };
        let (one, three) = (on(1), on(3));
        assert_eq!(one.structures.len(), structures);
        for (a, b) in one.structures.iter().zip(&three.structures) {
            assert_eq!((&a.quality, &a.object.positions), (&b.quality, &b.object.positions));
            for (f, g) in a.sheets().zip(b.sheets()) {
                assert_eq!((&f.medial, &f.upper, &f.lower, &f.crest), (&g.medial, &g.upper, &g.lower, &g.crest));
                assert_eq!(f.points, g.points);
            }
        }
    }
}
