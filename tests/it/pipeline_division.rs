//! Solids that one kind of figure does not stand for: they are divided.

use std::collections::BTreeSet;

use medialrep::model::{Structure, Verdict};
use medialrep::params::{Correspondence, Params};
use medialrep::space::LabelVolume;
use nalgebra::Vector3;

use crate::help::phantoms::{check_invariants, model_of, painted, run_with};

fn structure(volume: &LabelVolume, params: Params) -> Structure {
    let mut model = model_of(volume, params);
    check_invariants(&model);
    model.structures.remove(0)
}

/// Voxels of 1 mm that are inside, by their places from a middle.
fn solid(dims: [usize; 3], middle: [f64; 3], is_inside: impl Fn(Vector3<f64>) -> bool) -> LabelVolume {
    painted(dims, [1.0; 3], |index| {
        u16::from(is_inside(Vector3::from(index.map(|i| i as f64)) - Vector3::from(middle)))
    })
}

/// A body, an arch behind it with a canal between, two transverse processes and a spinous one.
fn vertebra() -> LabelVolume {
    solid([101, 118, 42], [50.3, 40.2, 20.4], |p| {
        let body = (p.x / 20.0).hypot(p.y / 15.0) <= 1.0 && p.z.abs() <= 12.0;
        let arch = (p.x.hypot(p.y - 27.0) - 14.0).abs() <= 4.0 && p.z.abs() <= 8.0 && p.y > 12.0;
        let spinous = p.x.abs() <= 3.0 && (38.0..70.0).contains(&p.y) && p.z.abs() <= 7.0;
        let beyond = p.x.abs() - p.x.abs().clamp(14.0, 42.0);
        let transverse = Vector3::new(beyond, p.y - 27.0, p.z).norm() <= 5.0;
        body || arch || spinous || transverse
    })
}

/// A ring that a rod leads away from.
fn ring_with_a_stem() -> LabelVolume {
    solid([145, 80, 30], [40.3, 40.2, 14.4], |p| {
        let ring = (p.x.hypot(p.y) - 25.0).hypot(p.z) <= 8.0;
        let beyond = p.x - p.x.clamp(25.0, 90.0);
        ring || Vector3::new(beyond, p.y, p.z).norm() <= 9.0
    })
}

/// A rod with a plate along it.
fn rod_with_a_wing() -> LabelVolume {
    solid([105, 85, 42], [12.3, 20.2, 20.4], |p| {
        let beyond = p.x - p.x.clamp(0.0, 80.0);
        let rod = Vector3::new(beyond, p.y, p.z).norm() <= 10.0;
        let plate = p.z.abs() <= 3.0 && (15.0..65.0).contains(&p.x) && (0.0..55.0).contains(&p.y);
        rod || plate
    })
}

/// How many sets of figures there are that junctions do not join.
fn pieces(structure: &Structure) -> usize {
    let mut set_of: Vec<usize> = (0..structure.figures.len()).collect();
    for junction in &structure.junctions {
        let joined: BTreeSet<usize> = junction.figures.iter().map(|figure| set_of[*figure]).collect();
        let least = *joined.first().expect("a junction joins figures");
        for set in &mut set_of {
            *set = if joined.contains(set) { least } else { *set };
        }
    }
    set_of.into_iter().collect::<BTreeSet<_>>().len()
}

fn is_divided(structure: &Structure) -> bool {
    structure.warnings.iter().any(|warning| warning.code == "divided")
}

#[test]
fn a_vertebra_has_figures_for_its_body_and_its_processes() {
    let structure = structure(&vertebra(), Params::default());
    assert!(is_divided(&structure), "{:?}", structure.warnings);
    assert_eq!(structure.quality.folds, 0);
    assert!(structure.quality.coverage.dice > 0.94, "overlap {:.3}", structure.quality.coverage.dice);
    assert_ne!(structure.quality.verdict, Verdict::Fail, "{:?}", structure.quality.reasons);
    assert!(structure.figures.len() > 2);
}

#[test]
fn portions_meet_where_they_were_cut() {
    for (name, volume) in [("vertebra", vertebra()), ("ring with a stem", ring_with_a_stem())] {
        let structure = structure(&volume, Params::default());
        assert_eq!(pieces(&structure), 1, "{name}: {:?}", structure.junctions);
        for junction in &structure.junctions {
            assert!(!junction.points.is_empty(), "{name}");
        }
    }
}

#[test]
fn a_ring_with_a_stem_is_answered_without_crossings() {
    let structure = structure(&ring_with_a_stem(), Params::default());
    assert_eq!(structure.quality.folds, 0);
    assert!(structure.quality.coverage.dice > 0.95, "overlap {:.3}", structure.quality.coverage.dice);
}

#[test]
fn what_is_left_over_has_figures_of_its_own_up_to_as_many_as_are_asked_for() {
    let all = structure(&rod_with_a_wing(), Params::default());
    assert!(is_divided(&all), "{:?}", all.warnings);
    assert!(all.quality.coverage.dice > 0.92, "overlap {:.3}", all.quality.coverage.dice);
    let one = structure(&rod_with_a_wing(), Params { max_figures: Some(1), ..Params::default() });
    assert_eq!(one.figures.len(), 1);
    assert!(!is_divided(&one));
    let paper = Params { correspondence: Correspondence::Paper, ..Params::default() };
    assert!(!is_divided(&structure(&rod_with_a_wing(), paper)));
}

#[test]
fn a_sponge_is_not_divided_and_ends() {
    let wave = |i: usize| std::f64::consts::TAU * i as f64 / 12.0;
    let gyroid = painted([36; 3], [1.0; 3], |[i, j, k]| {
        let [x, y, z] = [i, j, k].map(wave);
        let value = x.sin() * y.cos() + y.sin() * z.cos() + z.sin() * x.cos();
        u16::from([i, j, k].iter().all(|n| (2..34).contains(n)) && value.abs() < 0.5)
    });
    let start = std::time::Instant::now();
    if let Ok(model) = run_with(&gyroid, "{}") {
        let structure = &model.structures[0];
        assert!(!is_divided(structure), "{:?}", structure.warnings);
        assert_eq!(structure.quality.verdict, Verdict::Fail);
    }
    // Alone it takes a sixth of that on one thread.
    assert!(start.elapsed().as_secs() < 60, "{:?}", start.elapsed());
}
