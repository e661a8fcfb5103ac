//! Tubes: solids round a curve, whose wall is known.

use std::f64::consts::{FRAC_PI_2, PI, TAU};

use medialrep::model::{Figure, Structure, Tube, Verdict};
use medialrep::params::Params;
use medialrep::space::{LabelVolume, WorldPoint};
use nalgebra::{Point3, Rotation3, Vector3};

use crate::help::phantoms::{check_invariants, model_of, painted, run_with};

/// Points of a curve, each with the radius there.
type Curve = Vec<(Point3<f64>, f64)>;

/// All that is no further from a point of the curve than its radius, turned about the origin, voxels of 1 mm.
fn round(curve: &Curve, turn: Rotation3<f64>) -> LabelVolume {
    let curve: Curve = curve.iter().map(|(p, r)| (turn * p, *r)).collect();
    let (mut low, mut high) = (Vector3::repeat(f64::INFINITY), Vector3::repeat(f64::NEG_INFINITY));
    for (p, r) in &curve {
        low = low.inf(&(p.coords - Vector3::repeat(r + 3.0)));
        high = high.sup(&(p.coords + Vector3::repeat(r + 3.0)));
    }
    let dims = [0, 1, 2].map(|axis| {
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a hundred voxels")]
        let count = (high[axis] - low[axis]).ceil() as usize;
        count
    });
    painted(dims, [1.0; 3], |index| {
        let at = Point3::from(low) + Vector3::from(index.map(|i| i as f64));
        u16::from(curve.iter().any(|(p, r)| (at - p).norm_squared() <= r * r))
    })
}

fn along(steps: usize, at: impl Fn(f64) -> (Point3<f64>, f64)) -> Curve {
    (0..=steps).map(|n| at(n as f64 / steps as f64)).collect()
}

/// Two straight legs of 30 and a quarter turn of a bend radius between.
fn elbow(bend: f64, radius: f64) -> Curve {
    let mut curve = along(40, |s| (Point3::new(30.0 * (s - 1.0), 0.0, 0.0), radius));
    curve.extend(along(40, |s| {
        let turn = s * FRAC_PI_2;
        (Point3::new(bend * turn.sin(), bend * (1.0 - turn.cos()), 0.0), radius)
    }));
    curve.extend(along(40, |s| (Point3::new(bend, bend + 30.0 * s, 0.0), radius)));
    curve
}

fn rod() -> Curve {
    along(120, |s| (Point3::new(70.0 * s, 0.0, 0.0), 8.0))
}

fn helix() -> Curve {
    along(400, |s| {
        let turn = s * 3.0 * PI;
        (Point3::new(18.0 * turn.cos(), 18.0 * turn.sin(), 45.0 * s), 5.0)
    })
}

/// A gut with seven haustra.
fn gut() -> Curve {
    along(300, |s| {
        let turn = s * PI;
        (Point3::new(35.0 * turn.cos(), 35.0 * turn.sin(), 10.0 * s), 8.0 + 1.5 * (s * 7.0 * TAU).sin())
    })
}

fn cone() -> Curve {
    along(200, |s| {
        let turn = s * 0.6 * PI;
        (Point3::new(50.0 * turn.cos(), 50.0 * turn.sin(), 0.0), 11.0 - 7.0 * s)
    })
}

fn ball() -> Curve {
    vec![(Point3::origin(), 14.0)]
}

fn structure(volume: &LabelVolume) -> Structure {
    let mut model = model_of(volume, Params::default());
    check_invariants(&model);
    model.structures.remove(0)
}

/// The one tube that a structure is.
fn tube(structure: &Structure) -> &Tube {
    assert_eq!(structure.figures.len(), 1, "{:?}", structure.warnings);
    match &structure.figures[0] {
        Figure::Tube(tube) => tube,
        Figure::Sheet(_) => panic!("a sheet, {:?}", structure.quality.coverage.dice),
    }
}

/// Corners of wedges on the wall with the sign of the fewer, from the coordinates alone.
fn folds(tube: &Tube) -> usize {
    let (rows, cols) = (tube.grid.rows, tube.grid.cols);
    let wall = |i: usize, j: usize| tube.wall[i % rows * cols + j];
    let (mut positive, mut negative) = (0, 0);
    for i in 0..rows {
        for j in 0..cols - 1 {
            for (di, dj) in [(0, 0), (0, 1), (1, 0), (1, 1)] {
                let down = wall(i + 1, j + dj) - wall(i, j + dj);
                let along = wall(i + di, j + 1) - wall(i + di, j);
                let out = wall(i + di, j + dj) - tube.centreline[j + dj];
                if down.cross(&along).dot(&out) > 0.0 { positive += 1 } else { negative += 1 }
            }
        }
    }
    positive.min(negative)
}

#[test]
fn tubes_of_any_bend_are_legal_and_fill_their_solid() {
    let turn = Rotation3::from_euler_angles(0.35, 0.6, 0.2);
    for (name, curve) in [
        ("rod", rod()),
        ("elbow of 10, radius 8", elbow(10.0, 8.0)),
        ("elbow of 4, radius 9", elbow(4.0, 9.0)),
        ("helix", helix()),
        ("gut", gut()),
        ("cone", cone()),
        ("ball", ball()),
    ] {
        for rotation in [Rotation3::identity(), turn] {
            let structure = structure(&round(&curve, rotation));
            let tube = tube(&structure);
            let quality = &structure.quality;
            assert_eq!((folds(tube), quality.folds), (0, 0), "{name}");
            assert_eq!(quality.self_intersections, Some(0), "{name}");
            assert!(quality.coverage.dice > 0.955, "{name}: overlap {:.3}", quality.coverage.dice);
            assert_eq!(quality.verdict, Verdict::Pass, "{name}: {:?}", quality.reasons);
        }
    }
}

#[test]
fn vectors_have_the_radius_and_the_line_its_length() {
    let structure = structure(&round(&rod(), Rotation3::from_euler_angles(0.35, 0.6, 0.2)));
    let tube = tube(&structure);
    let cols = tube.grid.cols;
    let lengths = tube.lengths_mm();
    for (node, length) in lengths.iter().enumerate() {
        if (tube.caps[0]..cols - tube.caps[1]).contains(&(node % cols)) {
            assert!((length - 8.0).abs() < 0.4, "{length:.2} at node {node}");
        }
    }
    let summary = tube.summary();
    assert!((summary.length_mm - 86.0).abs() < 1.5, "length {:.1}", summary.length_mm);
    assert!((summary.tortuosity.expect("has two tips") - 1.0).abs() < 0.01);
    let radius = summary.radius_mm.expect("sections");
    assert!((radius.mean - 8.0).abs() < 0.24 && radius.sd < 0.15, "radius {:.2} ± {:.2}", radius.mean, radius.sd);
    let total = tube.wall_summary().total_mm.expect("a wall");
    assert!((total.p50 - 16.0).abs() < 0.3, "diameter {:.2}", total.p50);
    let area = 4.0 * PI * 64.0 + TAU * 8.0 * 70.0;
    assert!((tube.wall_summary().area_mm2 / area - 1.0).abs() < 0.06, "area {:.0}", tube.wall_summary().area_mm2);
}

#[test]
fn a_ball_has_one_centre_and_vectors_of_its_radius() {
    let structure = structure(&round(&ball(), Rotation3::identity()));
    let tube = tube(&structure);
    for length in tube.lengths_mm() {
        assert!((length - 14.0).abs() < 0.7, "{length:.2}");
    }
    assert!(structure.warnings.iter().any(|warning| warning.code == "frame_ambiguous"));
}

#[test]
fn curvature_is_that_of_the_bend() {
    let ring = along(200, |s| {
        let turn = s * 1.5 * PI;
        (Point3::new(30.0 * turn.cos(), 30.0 * turn.sin(), 0.0), 7.0)
    });
    let structure = structure(&round(&ring, Rotation3::identity()));
    let curvature = tube(&structure).summary().curvature_per_mm.expect("a line");
    assert!((curvature.p50 * 30.0 - 1.0).abs() < 0.06, "curvature {:.4}", curvature.p50);
}

#[test]
fn a_seam_faces_up_and_columns_run_up() {
    let lying = structure(&round(&rod(), Rotation3::identity()));
    let lying = tube(&lying);
    let middle = lying.grid.cols / 2;
    let out = lying.wall[middle] - lying.centreline[middle];
    assert!(out.normalize().z > 0.9, "row 0 faces {out:?}");
    let standing = structure(&round(&rod(), Rotation3::from_euler_angles(0.0, FRAC_PI_2, 0.0)));
    let standing = tube(&standing);
    assert!(standing.tips[1].z > standing.tips[0].z, "columns run from {:?}", standing.tips);
}

#[test]
fn a_thin_tube_of_two_voxels_is_answered() {
    let vessel = along(150, |s| (Point3::new(50.0 * s, 12.0 * (s * PI).sin(), 0.3), 2.0));
    let structure = structure(&round(&vessel, Rotation3::from_euler_angles(0.3, 0.2, 0.1)));
    let tube = tube(&structure);
    assert_eq!(structure.quality.folds, 0);
    let radius = tube.summary().radius_mm.expect("sections").mean;
    assert!((radius - 2.0).abs() < 0.2, "radius {radius:.2}");
    assert!(structure.quality.coverage.dice > 0.9, "overlap {:.3}", structure.quality.coverage.dice);
}

#[test]
fn kinds_are_kept_to() {
    let rod = round(&rod(), Rotation3::identity());
    let refused = run_with(&rod, r#"{"kinds": ["sheet"]}"#).expect_err("no sheet");
    assert!(refused.to_string().contains("tube"), "{refused}");
    let slab = painted([60, 40, 14], [1.0; 3], |[x, y, z]| {
        u16::from((4..56).contains(&x) && (4..36).contains(&y) && (4..10).contains(&z))
    });
    assert!(structure(&slab).figures[0].as_sheet().is_some(), "a slab is a sheet");
    let asked = run_with(&slab, r#"{"kinds": ["tube"]}"#).expect("a flat tube");
    let evidence = tube(&asked.structures[0]).automatic.kind.expect("told");
    assert!(evidence.flatness.is_some_and(|flatness| flatness > 1.5), "{evidence:?}");
    let slab = structure(&slab);
    let evidence = slab.figures[0].as_sheet().expect("a sheet").automatic.kind.expect("told");
    assert!(evidence.width_in_radii.is_some_and(|width| width > 4.0), "{evidence:?}");
    assert!(
        evidence.sheet_overlap.is_some_and(|overlap| overlap > 0.95) && evidence.tube_overlap.is_none(),
        "{evidence:?}"
    );
}

/// A trunk of radius 6 that forks in two of radius 5, in the plane z = 0.
fn fork() -> Curve {
    let mut fork = along(60, |s| (Point3::new(-40.0 * s, 0.0, 0.0), 6.0));
    for side in [-1.0, 1.0] {
        fork.extend(along(80, |s| (Point3::new(40.0 * s, side * 30.0 * s, 0.0), 5.0)));
    }
    fork
}

#[test]
fn a_fork_is_three_tubes_that_meet() {
    for rotation in [Rotation3::identity(), Rotation3::from_euler_angles(0.35, 0.6, 0.2)] {
        let structure = structure(&round(&fork(), rotation));
        // What lies between the three may have a figure of its own.
        assert!((3..=4).contains(&structure.figures.len()), "{:?}", structure.warnings);
        assert!(structure.quality.folds == 0);
        let tubes: Vec<&Tube> = structure.tubes().take(3).collect();
        assert!(tubes.len() == 3 && tubes.iter().all(|tube| folds(tube) == 0));
        let quality = &structure.quality;
        assert_eq!(quality.verdict, Verdict::Pass, "{:?}", quality.reasons);
        assert!(quality.coverage.dice > 0.95, "overlap {:.3}", quality.coverage.dice);
        // One junction, near the fork, of all three; the two that lead on have the first as their parent.
        let of_three: Vec<_> = structure.junctions.iter().filter(|junction| junction.figures.len() == 3).collect();
        let [junction] = &of_three[..] else { panic!("{:?}", structure.junctions) };
        for point in &junction.points {
            assert!((point - junction.points[0]).norm() < 16.0, "{:?}", junction.points);
        }
        let parents: Vec<_> = tubes.iter().map(|tube| tube.parent).collect();
        assert_eq!(parents.iter().flatten().count(), 2, "{parents:?}");
        let mut radii: Vec<f64> = tubes.iter().map(|t| t.summary().radius_mm.expect("sections").p50).collect();
        radii.sort_by(f64::total_cmp);
        for (radius, wanted) in radii.iter().zip([5.0, 5.0, 6.0]) {
            assert!((radius - wanted).abs() < 0.5, "{radii:?}");
        }
    }
}

#[test]
fn a_bump_is_no_branch() {
    let mut bumped = rod();
    bumped.push((Point3::new(35.0, 9.0, 0.0), 4.0));
    let structure = structure(&round(&bumped, Rotation3::identity()));
    assert_eq!(tube(&structure).parent, None);
}

#[test]
fn a_ring_of_round_sections_is_one_tube_that_meets_itself() {
    let ring = along(200, |s| {
        let turn = s * TAU;
        (Point3::new(26.0 * turn.cos(), 26.0 * turn.sin(), 0.0), 7.0)
    });
    let structure = structure(&round(&ring, Rotation3::identity()));
    let tube = tube(&structure);
    let (summary, last) = (tube.summary(), tube.grid.cols - 1);
    assert_eq!((structure.figures.len(), folds(tube), summary.tortuosity), (1, 0, None));
    let [junction] = &structure.junctions[..] else { panic!("{:?}", structure.junctions) };
    assert_eq!(junction.figures, [0, 0]);
    // Both banks share their nodes.
    assert_eq!(tube.centreline[0], tube.centreline[last]);
    for row in 0..tube.grid.rows {
        assert_eq!(tube.wall[row * tube.grid.cols], tube.wall[row * tube.grid.cols + last]);
    }
    assert!((summary.length_mm / (TAU * 26.0) - 1.0).abs() < 0.03, "{:.1} mm", summary.length_mm);
    let radius = summary.radius_mm.expect("has sections").mean;
    // Of a polygon of so many sides: 0.977 of the circle with twelve.
    assert!((radius - 7.0).abs() < 0.3, "{radius:.2} mm");
    assert!(structure.quality.coverage.dice > 0.96, "overlap {:.3}", structure.quality.coverage.dice);
}

#[test]
fn a_ring_is_opened_where_the_world_says() {
    let upright = Rotation3::from_axis_angle(&Vector3::x_axis(), 80f64.to_radians());
    let ring = along(200, |s| (Point3::new(20.0 * (s * TAU).cos(), 20.0 * (s * TAU).sin(), 0.0), 6.0));
    let structure = structure(&round(&ring, upright));
    let tube = tube(&structure);
    let middle = tube.centreline.iter().map(|p| p.z).sum::<f64>() / tube.centreline.len() as f64;
    assert!(tube.centreline[0].z - middle > 17.0, "{:.1} mm above the middle", tube.centreline[0].z - middle);
}

#[test]
fn the_spread_of_a_tube_is_told() {
    let rod = round(&along(60, |s| (Point3::new(40.0 * s, 0.0, 0.0), 6.0)), Rotation3::identity());
    let model = model_of(&rod, Params { uncertainty: 3, ..Params::default() });
    let spread = tube(&model.structures[0]).uncertainty.as_ref().expect("asked for");
    assert_eq!((spread.repeats, spread.matched), (3, 3));
    let largest = spread.wall_mm.iter().map(|sd| sd.expect("matched")).fold(0.0, f64::max);
    assert!(largest > 0.0 && largest < 1.0, "{largest:.2} mm");
}

#[test]
fn a_tube_and_its_mirror_image_are_mirror_images() {
    // On either side of the plane x = 0, so that lateral is known.
    let place =
        |side: f64| along(100, move |s| (Point3::new(side * (40.0 + 10.0 * (s * PI).sin()), 45.0 * s, 20.0 * s), 5.0));
    let [left, right] = [-1.0, 1.0].map(|side| {
        let curve = place(side);
        painted([120, 64, 40], [1.0; 3], move |index| {
            let at = Point3::from(index.map(|i| i as f64)) - Vector3::new(59.5, 8.0, 9.0);
            u16::from(curve.iter().any(|(p, r)| (at - p).norm_squared() <= r * r))
        })
    });
    let centred = |volume: LabelVolume| {
        let place = medialrep::space::WorldFromVoxel::axis_aligned([1.0; 3], [-59.5, 0.0, 0.0]).expect("a map");
        structure(&volume.placed(place))
    };
    let [left, right] = [centred(left), centred(right)];
    let [left, right] = [tube(&left), tube(&right)];
    assert_eq!(left.grid, right.grid);
    for (a, b) in left.centreline.iter().zip(&right.centreline) {
        let mirrored = WorldPoint::new(-b.x, b.y, b.z);
        assert!((a - mirrored).norm() < 0.5, "{a} against {mirrored}");
    }
}
