//! Which kind of figure stands for a solid: the same on any grid.

use medialrep::model::{Figure, Model};
use medialrep::space::LabelVolume;
use nalgebra::{Point3, Rotation3, Vector3};

use crate::help::phantoms::{check_invariants, painted, run_with};

/// What lies at `inside`, which is within `reach` of the origin on each axis, turned, in voxels of `spacing_mm`.
fn drawn(
    reach: Vector3<f64>,
    turn: Rotation3<f64>,
    spacing_mm: f64,
    inside: impl Fn(Point3<f64>) -> bool,
) -> LabelVolume {
    let half = (turn.matrix().abs() * reach).add_scalar(3.0 * spacing_mm);
    let dims = [0, 1, 2].map(|axis| {
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a hundred voxels")]
        let count = (2.0 * half[axis] / spacing_mm).ceil() as usize;
        count
    });
    painted(dims, [spacing_mm; 3], |index| {
        let at = Vector3::from(index.map(|i| spacing_mm * i as f64)) - half;
        u16::from(inside(turn.inverse() * Point3::from(at)))
    })
}

/// The figures on several grids: `s` for a sheet, `t` for a tube.
fn kinds(reach: [f64; 3], inside: impl Fn(Point3<f64>) -> bool) -> Vec<String> {
    let turns = [(0.0, 0.0, 0.0), (0.4, 0.3, 0.6), (-0.7, 0.5, 1.2)];
    let grids = turns.map(|(x, y, z)| (Rotation3::from_euler_angles(x, y, z), 1.0));
    let coarse = (grids[1].0, 1.5);
    let models = grids.into_iter().chain([coarse]).map(|(turn, spacing_mm)| {
        let volume = drawn(Vector3::from(reach), turn, spacing_mm, &inside);
        run_with(&volume, "{}").expect("answered")
    });
    models.map(|model| letters(&model)).collect()
}

fn letters(model: &Model) -> String {
    check_invariants(model);
    let figures = model.structures[0].figures.iter();
    figures.map(|figure| if matches!(figure, Figure::Sheet(_)) { 's' } else { 't' }).collect()
}

fn ellipsoid([a, b, c]: [f64; 3]) -> impl Fn(Point3<f64>) -> bool {
    move |p| Vector3::new(p.x / a, p.y / b, p.z / c).norm_squared() <= 1.0
}

#[test]
fn a_short_solid_of_nearly_round_sections_is_a_tube() {
    let axes = [17.0, 13.0, 11.0];
    assert_eq!(kinds(axes, ellipsoid(axes)), ["t"; 4]);
}

#[test]
fn a_solid_that_may_be_either_is_a_sheet_where_that_fills_it() {
    let axes = [26.0, 16.0, 10.0];
    assert_eq!(kinds(axes, ellipsoid(axes)), ["s"; 4]);
}

#[test]
fn a_very_long_solid_of_flat_sections_is_a_tube_as_ribs_are() {
    let axes = [70.0, 8.0, 4.0];
    assert_eq!(kinds(axes, ellipsoid(axes)), ["t"; 4]);
}

#[test]
fn a_strap_is_a_sheet() {
    let axes = [45.0, 20.0, 6.0];
    assert_eq!(kinds(axes, ellipsoid(axes)), ["s"; 4]);
}

#[test]
fn what_is_asked_of_the_lattice_does_not_change_what_the_figures_are() {
    let lattices = [
        "{}",
        r#"{"grid":{"rows":3,"cols":4}}"#,
        r#"{"grid":{"rows":12,"cols":20},"margin":0.02}"#,
        r#"{"grid":{"rows":40,"cols":30}}"#,
        r#"{"spacing_mm":6.0}"#,
        r#"{"margin":0.2}"#,
    ];
    type Inside = Box<dyn Fn(Point3<f64>) -> bool>;
    // A sheet, a tube, what may be either, and a bent strap with a tail.
    let strap = |p: Point3<f64>| {
        let bent = p.z - 0.02 * p.x * p.x + 8.0;
        let half = if p.x > 12.0 { 3.0 } else { 11.0 };
        p.x.abs() <= 30.0 && p.y.hypot(1.5 * bent) <= half && bent.abs() <= 3.0
    };
    let solids: [(&str, [f64; 3], Inside); 4] = [
        ("strap", [45.0, 20.0, 6.0], Box::new(ellipsoid([45.0, 20.0, 6.0]))),
        ("bladder", [17.0, 13.0, 11.0], Box::new(ellipsoid([17.0, 13.0, 11.0]))),
        ("thalamus", [26.0, 16.0, 10.0], Box::new(ellipsoid([26.0, 16.0, 10.0]))),
        ("tailed", [31.0, 12.0, 14.0], Box::new(strap)),
    ];
    for (name, reach, inside) in solids {
        let volume = drawn(Vector3::from(reach), Rotation3::from_euler_angles(0.4, 0.3, 0.6), 1.0, &inside);
        let found = lattices.map(|lattice| letters(&run_with(&volume, lattice).expect("answered")));
        assert!(found.iter().all(|letters| *letters == found[0]), "{name}: {found:?}");
    }
}
