//! Tails: strips of a sheet that are a few voxels wide at most.

use medialrep::cancel::Never;
use medialrep::pipeline::plane::Flat;
use medialrep::pipeline::plane::strip::{SheetPoints, unfolded, widened};
use medialrep::pipeline::sides::SheetSides;
use medialrep::pipeline::solid::depth::Depth;
use medialrep::pipeline::surface::Surface;
use nalgebra::{Point2, Point3, Vector3};

use crate::help::phantoms::{deepened, model_of, painted, params, turned};

/// A disc of points with a tail of `rows` rows to its right, flat in the plane and oblique in
/// space; `hand` −1 mirrors the plane.
fn tailed(rows: i32, hand: f64) -> (SheetSides, Vec<Point2<f64>>) {
    let half = (rows - 1) / 2;
    let places = (-8..=22).flat_map(|x| (-8..=8).map(move |y: i32| (x, y)));
    let flat: Vec<Point2<f64>> = places
        .filter(|(x, y)| x * x + y * y <= 64 || (*x > 0 && y.abs() <= half))
        .map(|(x, y)| Point2::new(f64::from(x), f64::from(y)))
        .collect();
    let positions: Vec<Point3<f64>> = flat.iter().map(|p| in_space(*p, hand)).collect();
    let count = flat.len();
    let normals = vec![turned() * Vector3::z(); count];
    let medial = Surface { positions, adjacency: vec![Vec::new(); count] };
    (SheetSides { medial, normals, radii: vec![3.0; count], ..SheetSides::default() }, flat)
}

fn in_space(p: Point2<f64>, hand: f64) -> Point3<f64> {
    Point3::new(30.0, 30.0, 30.0) + turned() * Vector3::new(p.x, hand * p.y, 0.0)
}

/// A block that all of it lies deep inside of.
fn block() -> Depth {
    let volume = painted([62; 3], [1.0; 3], |index| u16::from(index.iter().all(|x| (1..61).contains(x))));
    deepened(&volume).1
}

fn wide(sheet: &SheetSides, flat: &[Point2<f64>], depth: &Depth) -> SheetPoints {
    let flat = Flat { points: flat.to_vec(), embedded: None, period: None };
    widened(sheet, &flat, depth, &Never).unwrap()
}

#[test]
fn a_strand_gets_points_on_both_sides_with_the_sheets_handedness() {
    let depth = block();
    for hand in [1.0, -1.0] {
        let (sheet, flat) = tailed(1, hand);
        let points = wide(&sheet, &flat, &depth);
        let own = flat.len();
        assert_eq!((&points.flat[..own], &points.positions[..own]), (&flat[..], &sheet.medial.positions[..]));
        for aside in [-1.0, 1.0] {
            let beside = points.flat[own..].iter().filter(|p| (p.y - aside).abs() < 0.1 && p.x > 12.0);
            assert_eq!(beside.count(), 10, "one for each point of the tail");
        }
        for (p, x) in points.flat.iter().zip(&points.positions) {
            let gap = (x - in_space(*p, hand)).norm();
            assert!(gap < 1e-6, "({:.1}, {:.1}) lies {gap:.2} voxels off", p.x, p.y);
        }
        assert!(points.flat[own..].iter().all(|p| p.x > 8.0), "the disc is no strand");
    }
}

#[test]
fn points_outside_of_the_object_are_not_added() {
    let (mut sheet, flat) = tailed(1, 1.0);
    // Balls this large do not fit into the block.
    sheet.radii.fill(70.0);
    assert_eq!(wide(&sheet, &flat, &block()).flat.len(), flat.len());
}

#[test]
fn filaments_are_left_as_they_are() {
    let (mut sheet, flat) = tailed(1, 1.0);
    flat.iter().zip(&mut sheet.radii).filter(|(p, _)| p.x > 8.0).for_each(|(_, r)| *r = 0.5);
    assert_eq!(wide(&sheet, &flat, &block()).flat.len(), flat.len());
}

#[test]
fn a_strip_that_was_laid_on_a_line_gets_its_width_back() {
    for (rows, hand) in [(3, 1.0), (3, -1.0), (5, 1.0), (5, -1.0)] {
        let (sheet, flat) = tailed(rows, hand);
        let laid = |p: &Point2<f64>| Point2::new(p.x, p.y * (1.0 - (p.x - 10.0) / 4.0).clamp(0.0, 1.0));
        let squeezed: Vec<Point2<f64>> = flat.iter().map(|p| if p.x > 8.0 { laid(p) } else { *p }).collect();
        let back = unfolded(&sheet, &squeezed, &Never).unwrap();
        for (found, p) in back.iter().zip(&flat) {
            let (gap, tail) = ((found - p).norm(), p.x > 14.0);
            assert!(gap < if tail { 0.05 } else { 0.6 }, "{rows} rows, ({}, {}): {gap:.2}", p.x, p.y);
        }
    }
}

#[test]
fn a_wide_sheet_is_left_as_it_is() {
    let (sheet, flat) = tailed(9, 1.0);
    assert_eq!(unfolded(&sheet, &flat, &Never).unwrap(), flat);
    assert_eq!(wide(&sheet, &flat, &block()).flat, flat);
}

#[test]
fn an_organ_keeps_its_tail() {
    // A flat body with a tail that bends out of its plane.
    let volume = painted([64, 40, 40], [1.0; 3], |index| {
        let [x, y, z] = index.map(|i| i as f64);
        let body = ((x - 20.0) / 17.0).powi(2) + ((y - 20.0) / 11.0).powi(2) + ((z - 14.0) / 4.5).powi(2);
        let along = x - 34.0;
        let tail =
            ((y - 20.0 - along * along / 120.0) / 3.0).powi(2) + ((z - 14.0 - along * along / 60.0) / 2.0).powi(2);
        u16::from(body < 1.0 || (tail < 1.0 && (30.0..60.0).contains(&x)))
    });
    let model = model_of(&volume, params());
    let figure = model.structures[0].sheets().next().expect("a sheet");
    let reached = figure.medial.iter().map(|p| p.x).fold(0.0, f64::max);
    // The body ends at 37 mm, the sheet's own points at 54 mm.
    assert!(reached > 50.0, "the lattice ends at {reached:.1} mm");
    assert_eq!(figure.quality.folds, 0);
    // What was added is no point of the sheet.
    assert_eq!(figure.points.medial.positions.len(), figure.points.medial.flat.len());
}
