//! One frame for one anatomy: (i, j) and the sides follow the world, not the file.

use medialrep::model::FrameRule;
use medialrep::model::Sheet;
use medialrep::space::{Grid, LabelVolume, WorldFromVoxel, WorldPoint, WorldVector};
use nalgebra::{Rotation3, Vector3};

use crate::help::phantoms::{counted, drift, first_sheet, model_of, params, rms, sample, turned, volume};

fn figure_of(volume: &LabelVolume) -> Sheet {
    first_sheet(&model_of(volume, params()))
}

/// Largest distance between the nodes of two figures, mm.
fn worst(a: &Sheet, b: &Sheet) -> f64 {
    let pairs = |x: &[WorldPoint], y: &[WorldPoint]| x.iter().zip(y).map(|(p, q)| (p - q).norm()).fold(0.0, f64::max);
    [pairs(&a.medial, &b.medial), pairs(&a.upper, &b.upper), pairs(&a.lower, &b.lower), pairs(&a.crest, &b.crest)]
        .into_iter()
        .fold(0.0, f64::max)
}

/// The same voxels in other storage: axis `a` of the new file is `order[a]` of the old one, read
/// backwards where `is_reversed`, with `shift` voxels left out (−) or added (+) at either end.
fn stored(volume: &LabelVolume, order: [usize; 3], is_reversed: [bool; 3], shift: i64) -> LabelVolume {
    let old = volume.dims();
    let grown = |n: usize| usize::try_from(i64::try_from(n).expect("small") + 2 * shift).expect("something is left");
    let dims = order.map(|a| grown(old[a]));
    let mut indices = Grid::filled(dims, 0u16);
    let source = |at: [usize; 3]| -> Option<[usize; 3]> {
        let mut from = [0; 3];
        for a in 0..3 {
            let x = usize::try_from(i64::try_from(at[a]).expect("small") - shift).ok()?;
            let n = old[order[a]];
            from[order[a]] = if is_reversed[a] { (n - 1).checked_sub(x)? } else { x };
        }
        (0..3).all(|a| from[a] < old[a]).then_some(from)
    };
    for offset in 0..indices.as_slice().len() {
        let at = indices.index(offset);
        indices.as_mut_slice()[offset] = source(at).map_or(0, |from| volume.indices()[from]);
    }
    let rows = volume.world_from_voxel().rows();
    let rows = std::array::from_fn(|r| {
        let sign = |a: usize| if is_reversed[a] { -1.0 } else { 1.0 };
        let last = |a: usize| if is_reversed[a] { (old[order[a]] - 1) as f64 } else { 0.0 };
        let first = |a: usize| rows[r][order[a]] * (last(a) - sign(a) * shift as f64);
        let column = |a: usize| sign(a) * rows[r][order[a]];
        [column(0), column(1), column(2), rows[r][3] + first(0) + first(1) + first(2)]
    });
    counted(indices, WorldFromVoxel::from_rows(rows).expect("still an affine"))
}

const STORAGES: [([usize; 3], [bool; 3], i64); 4] = [
    ([1, 2, 0], [false; 3], 0),
    ([0, 2, 1], [true, false, true], 0),
    ([2, 1, 0], [false, true, false], 5),
    ([0, 1, 2], [true; 3], -1),
];

fn check_storages(name: &str, spacing_mm: [f64; 3], rotation: Rotation3<f64>) {
    let plain = sample(name).voxelise(spacing_mm, rotation).expect("fits");
    let figure = figure_of(&plain);
    for (order, is_reversed, shift) in STORAGES {
        let other = stored(&plain, order, is_reversed, shift);
        assert_eq!(other.voxels_of(1), plain.voxels_of(1), "nothing of the object is cut off");
        let off = worst(&figure, &figure_of(&other));
        assert!(off <= 1e-6, "{name} as {order:?} {is_reversed:?} {shift:+}: nodes are off by {off:.2e} mm");
    }
}

#[test]
fn storage_crop_and_padding_change_no_node() {
    check_storages("leaf", [1.0; 3], Rotation3::identity());
    check_storages("leaf", [1.0; 3], turned());
}

#[test]
fn storage_crop_and_padding_change_no_node_of_uneven_voxels() {
    check_storages("bent_even", [1.0, 1.2, 2.5], Rotation3::identity());
    check_storages("bent_even", [1.2, 1.2, 2.5], turned());
}

/// A sample moved to one side of the body.
fn beside(name: &str, x: f64, rotation: Rotation3<f64>) -> LabelVolume {
    let volume = sample(name).voxelise([1.0; 3], rotation).expect("fits");
    let there = volume.world_from_voxel().translated(Vector3::x() * x);
    volume.placed(there)
}

/// The mirror image of a volume in the plane x = 0.
fn mirrored(volume: &LabelVolume) -> LabelVolume {
    let mut rows = volume.world_from_voxel().rows();
    rows[0] = rows[0].map(|x| -x);
    let world_from_voxel = WorldFromVoxel::from_rows([rows[0], rows[1], rows[2]]).expect("still an affine");
    volume.clone().placed(world_from_voxel)
}

fn reflected(mut figure: Sheet) -> Sheet {
    for points in [&mut figure.medial, &mut figure.upper, &mut figure.lower, &mut figure.crest] {
        points.iter_mut().for_each(|p| p.x = -p.x);
    }
    figure
}

/// (columns × rows) · upper: the sense in which the frame turns.
fn handedness(figure: &Sheet) -> f64 {
    figure.frame.cols_along.cross(&figure.frame.rows_along).dot(&figure.frame.upper_towards)
}

#[test]
fn left_and_right_organs_have_mirrored_frames() {
    for name in ["leaf", "bent", "half_bent", "twisted"] {
        for rotation in [Rotation3::identity(), turned()] {
            let right = beside(name, 60.0, rotation);
            let (right, left) = (figure_of(&right), figure_of(&mirrored(&right)));
            let off = drift(&right, &reflected(left.clone()));
            // A pointed end has its corners by the turn of few voxels, in which skeletons of mirror images differ.
            let most = if name == "leaf" { 0.45 } else { 0.1 };
            assert!(off <= most, "{name}: mirrored nodes are {off:.2} voxels apart");
            assert!(handedness(&right) * handedness(&left) < 0.0, "{name}: a mirror turns the frame over");
            assert!(right.frame.ambiguities.iter().all(|why| !why.contains("x = 0")), "{name} lies on one side");
        }
    }
}

#[test]
fn sheets_of_nearly_one_size_are_in_the_order_of_their_place() {
    for rotation in [Rotation3::identity(), turned()] {
        let volume = sample("wye").voxelise([1.0; 3], rotation).expect("fits");
        let model = model_of(&volume, params());
        let lead = |p: &WorldPoint| p.z + 0.5 * p.y + 0.25 * p.x;
        let mean = |sheet: &Sheet| sheet.medial.iter().map(lead).sum::<f64>() / sheet.medial.len() as f64;
        let leads: Vec<f64> = model.structures[0].sheets().map(mean).collect();
        assert_eq!(leads.len(), 3);
        // Middles of nodes are not those of voxels.
        assert!(leads.is_sorted_by(|a, b| a + 0.5 >= *b), "superior, anterior and lateral ones first: {leads:?}");
    }
}

/// A flat box of 8 mm, its sides along two directions in the world, centred well to the right.
fn plate(sides: [f64; 2], along: [WorldVector; 2]) -> LabelVolume {
    let center = WorldVector::new(80.0, 0.0, 0.0);
    let across = along[0].cross(&along[1]);
    let mut indices = Grid::filled([72; 3], 0u16);
    let world = WorldFromVoxel::axis_aligned([1.0; 3], [80.0 - 35.7, -35.6, -35.3]).expect("a box");
    for offset in 0..indices.as_slice().len() {
        let at = world.point(indices.index(offset).map(|x| x as f64).into()).coords - center;
        let is_inside = [(along[0], sides[0]), (along[1], sides[1]), (across, 8.0)]
            .iter()
            .all(|(axis, side)| at.dot(axis).abs() <= side / 2.0);
        indices.as_mut_slice()[offset] = u16::from(is_inside);
    }
    counted(indices, world)
}

#[test]
fn a_square_sheet_keeps_its_own_axes_and_says_that_they_are_equals() {
    let turn = |degrees: f64| {
        let (sin, cos) = degrees.to_radians().sin_cos();
        [WorldVector::new(0.0, cos, sin), WorldVector::new(0.0, -sin, cos)]
    };
    for (sides, degrees) in [([40.0, 40.0], 20.0), ([40.0, 39.0], 20.0), ([39.0, 40.0], 20.0), ([40.0, 40.0], 70.0)] {
        let axes = turn(degrees);
        let structure = model_of(&plate(sides, axes), params()).structures.remove(0);
        let frame = &structure.sheets().next().expect("a sheet").frame;
        // Of the two the one nearer to superior, whichever is a little longer.
        let superior = if degrees < 45.0 { axes[1] } else { axes[0] };
        assert_eq!(frame.rule, FrameRule::SuperiorOfEqualAxes);
        assert!(frame.cols_along.dot(&superior) > 0.99, "{sides:?} at {degrees}°: {:?}", frame.cols_along);
        assert!(structure.warnings.iter().any(|w| w.code == "frame_ambiguous"));
    }
}

#[test]
fn an_oblong_sheet_beside_the_midline_has_one_frame() {
    let structure = model_of(&plate([50.0, 30.0], [WorldVector::z(), WorldVector::y()]), params()).structures.remove(0);
    let frame = &structure.sheets().next().expect("a sheet").frame;
    assert_eq!((frame.rule, frame.ambiguities.len()), (FrameRule::LongerAxis, 0), "{:?}", frame.ambiguities);
    // The sheet ends half a thickness inside the sides.
    assert!((frame.aspect - 42.0 / 22.0).abs() < 0.05, "aspect {:.2}", frame.aspect);
    assert!(frame.cols_along.z > 0.99 && frame.rows_along.y > 0.99 && frame.upper_towards.x > 0.99);
    let left = figure_of(&mirrored(&plate([50.0, 30.0], [WorldVector::z(), WorldVector::y()])));
    assert!(left.frame.upper_towards.x < -0.99, "lateral is to the left on the left");
}

#[test]
fn a_round_sheet_runs_towards_superior() {
    let mut disc = Grid::filled([56, 56, 24], 0u16);
    for offset in 0..disc.as_slice().len() {
        let [i, j, k] = disc.index(offset).map(|x| x as f64);
        disc.as_mut_slice()[offset] = u16::from((i - 27.6).hypot(j - 27.8) <= 22.0 && (k - 11.7).abs() <= 4.0);
    }
    // The disc's plane holds x and the direction 60° up from anterior.
    let (sin, cos) = 60.0f64.to_radians().sin_cos();
    let rows = [[0.0, 1.0, 0.0, 60.0], [cos, 0.0, -sin, 0.0], [sin, 0.0, cos, 0.0]];
    let figure = figure_of(&counted(disc, WorldFromVoxel::from_rows(rows).expect("an affine")));
    assert_eq!(figure.frame.rule, FrameRule::SuperiorDirection);
    assert!(figure.frame.cols_along.z > 0.98 * sin, "{:?}", figure.frame.cols_along);
    assert!(figure.frame.ambiguities.iter().any(|why| why.contains("nearly as wide")));
}

#[test]
fn an_organ_on_the_midline_says_that_it_has_no_lateral_side() {
    let figure = figure_of(&volume("half_bent"));
    assert!(figure.frame.ambiguities.iter().any(|why| why.contains("x = 0")), "{:?}", figure.frame);
    let lengths = [figure.frame.cols_along, figure.frame.rows_along, figure.frame.upper_towards].map(|v| v.norm());
    assert!(rms(lengths.iter().map(|l| l - 1.0)) < 1e-9);
}
