//! Sheets with one hole, bands and washers, are one figure that meets itself.

use std::collections::BTreeMap;
use std::f64::consts::TAU;

use medialrep::model::{LatticeSize, Sheet, Shell, Side, Structure, Verdict, closed};
use medialrep::params::{Correspondence, Embedding, GridChoice, Params};
use medialrep::space::{LabelVolume, WorldPoint};
use nalgebra::{Rotation3, Vector3};

use crate::help::phantoms::{check_invariants, model_of, painted, params, roughened};

const RADIUS: f64 = 16.0;
const HALF: f64 = 3.0;
/// Of a band.
const HEIGHT: f64 = 24.0;
/// Of a washer, from the hole to the outside.
const WIDTH: f64 = 18.0;

/// Directions of the axis: along one of the grid's, and oblique to all.
fn turns() -> [Rotation3<f64>; 3] {
    [(0.0, 0.0), (1.571, 0.0), (0.65, 0.37)].map(|(x, y)| Rotation3::from_euler_angles(x, y, 0.0))
}

/// Voxels of 1 mm that are inside, by how far they lie from the axis and along it.
fn round_solid(turn: Rotation3<f64>, is_inside: impl Fn(f64, f64) -> bool) -> LabelVolume {
    painted([66; 3], [1.0; 3], |index| {
        let [x, y, z] = index.map(|i| i as f64);
        let p = turn.inverse() * Vector3::new(x - 32.3, y - 32.2, z - 32.4);
        u16::from(is_inside(p.x.hypot(p.y), p.z))
    })
}

fn band(turn: Rotation3<f64>) -> LabelVolume {
    round_solid(turn, |away, along| (away - RADIUS).abs() <= HALF && along.abs() <= HEIGHT / 2.0)
}

fn washer(turn: Rotation3<f64>) -> LabelVolume {
    round_solid(turn, |away, along| (away - 20.0).abs() <= WIDTH / 2.0 && along.abs() <= HALF)
}

fn structure(volume: &LabelVolume, params: Params) -> Structure {
    let mut model = model_of(volume, params);
    check_invariants(&model);
    model.structures.remove(0)
}

/// The one figure of a structure, which is a ring.
fn ring_of<'a>(name: &str, structure: &'a Structure) -> &'a Sheet {
    let figures = structure.figures.len();
    assert_eq!(figures, 1, "{name}: {:?}", structure.warnings);
    assert!(structure.warnings.iter().any(|warning| warning.code == "sheet_closes"), "{name}");
    structure.sheets().next().expect("a sheet")
}

fn check_legal(name: &str, structure: &Structure, least_overlap: f64) {
    let quality = &structure.quality;
    assert_eq!((quality.folds, quality.folded_centres, quality.folded_wedges), (0, 0, 0), "{name}");
    assert_eq!(quality.self_intersections, Some(0), "{name}");
    assert!(quality.coverage.dice > least_overlap, "{name}: overlap {:.3}", quality.coverage.dice);
    assert_eq!(quality.verdict, Verdict::Pass, "{name}: {:?}", quality.reasons);
}

fn check_banks(name: &str, sheet: &Sheet) {
    let cols = sheet.grid.cols;
    for nodes in [&sheet.medial, &sheet.upper, &sheet.lower] {
        for row in nodes.chunks(cols) {
            assert_eq!(row[0], row[cols - 1], "{name}");
        }
    }
    assert_eq!(sheet.medial_radius_mm[0].to_bits(), sheet.medial_radius_mm[cols - 1].to_bits(), "{name}");
}

/// Mean length of the rows, mm.
fn around(sheet: &Sheet) -> f64 {
    let LatticeSize { rows, cols } = sheet.grid;
    let length = |row: &[WorldPoint]| row.windows(2).map(|step| (step[1] - step[0]).norm()).sum::<f64>();
    sheet.medial.chunks(cols).map(length).sum::<f64>() / rows as f64
}

/// The mean length of the vectors to a side, mm, in the middle half of the rows.
fn mean_length(sheet: &Sheet, side: Side) -> f64 {
    let LatticeSize { rows, cols } = sheet.grid;
    let lengths = &sheet.lengths_mm(side)[rows / 4 * cols..(rows - rows / 4) * cols];
    lengths.iter().sum::<f64>() / lengths.len() as f64
}

fn check_within(name: &str, found: f64, truth: f64, share: f64) {
    assert!((found / truth - 1.0).abs() < share, "{name}: {found:.3} of {truth:.3}");
}

#[test]
fn a_band_is_one_figure_with_true_lengths() {
    for (number, turn) in turns().into_iter().enumerate() {
        let (name, structure) = (format!("band {number}"), structure(&band(turn), params()));
        let sheet = ring_of(&name, &structure);
        check_legal(&name, &structure, 0.96);
        check_banks(&name, sheet);
        check_within(&name, around(sheet), TAU * RADIUS, 0.02);
        for side in Side::BOTH {
            check_within(&name, mean_length(sheet, side), HALF, 0.02);
        }
    }
}

#[test]
fn a_washer_is_one_figure_with_true_lengths() {
    for (number, turn) in turns().into_iter().enumerate() {
        let (name, structure) = (format!("washer {number}"), structure(&washer(turn), params()));
        let sheet = ring_of(&name, &structure);
        check_legal(&name, &structure, 0.96);
        check_banks(&name, sheet);
        // Rows are equally far apart: the mean of their lengths is that of the middle.
        check_within(&name, around(sheet), TAU * 20.0, 0.02);
        for side in Side::BOTH {
            check_within(&name, mean_length(sheet, side), HALF, 0.02);
        }
    }
}

#[test]
fn a_rough_boundary_leaves_a_ring_whole() {
    let [level, _, oblique] = turns();
    for turn in [level, oblique] {
        for (name, volume) in [("band", band(turn)), ("washer", washer(turn))] {
            let structure = structure(&roughened(&volume, 0.03), params());
            check_banks(name, ring_of(name, &structure));
            check_legal(name, &structure, 0.95);
        }
    }
}

#[test]
fn the_closed_surface_of_a_ring_is_that_of_a_solid_ring() {
    let structure = structure(&washer(turns()[2]), params());
    let mesh = closed(Shell::from(ring_of("washer", &structure))).expect("all nodes are valid");
    let mut edges = BTreeMap::new();
    for [a, b, c] in &mesh.triangles {
        for edge in [[a, b], [b, c], [c, a]] {
            *edges.entry(edge).or_insert(0) += 1;
        }
    }
    for ([a, b], count) in &edges {
        assert_eq!((*count, edges.get(&[*b, *a])), (1, Some(&1)), "one triangle on either side");
    }
    assert_eq!(mesh.positions.len() + mesh.triangles.len(), edges.len() / 2);
}

#[test]
fn a_ring_meets_itself_at_its_banks_and_has_no_crest_there() {
    let structure = structure(&band(turns()[0]), params());
    let sheet = ring_of("band", &structure);
    let LatticeSize { rows, cols } = sheet.grid;
    let [junction] = &structure.junctions[..] else { panic!("{:?}", structure.junctions) };
    assert_eq!((&junction.figures[..], junction.points.len()), (&[0, 0][..], rows));
    let bank: Vec<WorldPoint> = sheet.medial.iter().step_by(cols).copied().collect();
    assert_eq!(junction.points, bank);
    // The right bank comes after the first row, the left one last and from below.
    let last = sheet.crest.len() - 1;
    for (k, node) in bank.iter().enumerate().take(rows - 1).skip(1) {
        assert_eq!([sheet.crest[cols - 1 + k], sheet.crest[last + 1 - k]], [*node; 2]);
    }
    assert_eq!(sheet.crest[0], sheet.crest[cols - 1]);
    let summary = sheet.medial_mesh().expect("quads");
    assert_eq!(summary.normals[0], summary.normals[cols - 1], "it is shaded as one surface");
}

#[test]
fn columns_begin_where_a_ring_is_most_superior_or_anterior() {
    for (name, volume) in [("band", band(turns()[0])), ("washer", washer(turns()[0]))] {
        let structure = structure(&volume, params());
        let sheet = ring_of(name, &structure);
        // It lies level: y is anterior. Seen from above, columns run counter-clockwise.
        let [first, next] = [0, 1].map(|n| sheet.medial[n] - Vector3::new(32.3, 32.2, 32.4));
        assert!(first.y > 0.99 * first.x.hypot(first.y) && next.x < first.x, "{name}: {first}");
        assert_eq!(structure.warnings.iter().filter(|w| w.code == "frame_ambiguous").count(), 0, "{name}");
    }
    let structure = structure(&band(turns()[0]), params());
    let sheet = ring_of("band", &structure);
    let outward = sheet.upper[0] - sheet.medial[0];
    assert!(outward.y > 0.0 && sheet.medial[0].z < sheet.medial[(sheet.grid.rows - 1) * sheet.grid.cols].z);
}

#[test]
fn a_ring_has_the_grid_that_is_asked_for() {
    let grid = GridChoice::Fixed { rows: 6, cols: 12 };
    let structure = structure(&washer(turns()[0]), Params { grid, ..params() });
    assert_eq!(ring_of("washer", &structure).grid, LatticeSize { rows: 6, cols: 12 });
}

#[test]
fn the_paper_s_pairing_and_other_embeddings_cut_rings() {
    let others = [
        Params { correspondence: Correspondence::Paper, ..params() },
        Params { embedding: Embedding::Lle, ..params() },
    ];
    for params in others {
        let structure = structure(&band(turns()[0]), params);
        assert!(structure.warnings.iter().all(|warning| warning.code != "sheet_closes"));
        assert!(structure.figures.len() > 1);
    }
}
