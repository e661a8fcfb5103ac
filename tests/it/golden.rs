//! Golden results: what the program says of samples, of masks like those of organs, and of one mask under many
//! parameters. They hold what no other test measures: the whole answer, codes and counts exactly, numbers to
//! what a rewrite of the same mathematics may move.
//!
//! `MEDIALREP_GOLDEN=write cargo test --test it golden` writes `tests/golden.json` anew.

use std::fmt::Write;
use std::path::PathBuf;
use std::sync::Mutex;

use medialrep::formats::write::thickness::{self, InputFacts, OuterTimings};
use medialrep::pipeline::PipelineError;
use medialrep::space::LabelVolume;
use serde_json::{Map, Value, json};

use crate::help::organs::ORGANS;
use crate::help::phantoms::{plain, run_with, sample, turned};
use crate::measure::shapes::PHASE;
use crate::measure::table::text_of;

/// How far a number may lie from the golden one.
#[derive(Clone, Copy)]
struct Tolerance {
    /// Share of the golden number.
    share: f64,
    /// At least this much.
    least: f64,
}

/// By the name of a quantity; what is not here is equal or wrong. All are far above what another order of
/// sums or another machine's sine does, some 1e-9 of a number, so that a rewrite of the same mathematics passes;
/// were they as small as that, it would not.
const TOLERANCES: [(&str, Tolerance); 11] = [
    // Positions, mm: a fiftieth of the finest voxel here. Ten times as much, and a lattice that has slipped
    // along its sheet would pass.
    ("medial", Tolerance { share: 0.0, least: 0.01 }),
    ("upper", Tolerance { share: 0.0, least: 0.01 }),
    ("lower", Tolerance { share: 0.0, least: 0.01 }),
    // Thickness, mm: mean, sd, 5th and 95th percentile. More than a percent is another thickness to whoever
    // compares two scans. A percentile is one node's length, and moves as far as a node.
    ("thickness_mm", Tolerance { share: 0.002, least: 0.01 }),
    ("thickness_sd_mm", Tolerance { share: 0.05, least: 0.005 }),
    ("area_mm2", Tolerance { share: 0.002, least: 0.0 }),
    // Of few repeats: a boundary moved by a little more moves it by much.
    ("uncertainty_mm", Tolerance { share: 0.05, least: 0.005 }),
    // A share of what is not explained: small numbers of large ones, so their digits are few.
    ("residual_variance", Tolerance { share: 0.05, least: 1e-4 }),
    ("spacing_variation", Tolerance { share: 0.02, least: 1e-3 }),
    // Counted in voxels and points of the surface: some of them lie on the edge between in and out.
    ("dice", Tolerance { share: 0.0, least: 0.002 }),
    ("covered_share", Tolerance { share: 0.0, least: 0.005 }),
];

/// Differences that are listed.
const TOLD: usize = 40;

/// The lattice of the tests, spelled out so that it stays when defaults change.
const LATTICE: &str = r#"{"grid":{"rows":12,"cols":20},"margin":0.02}"#;

/// Each a way through the pipeline that the defaults do not take: name, sample, parameters.
const WAYS: [(&str, &str, &str); 11] = [
    ("exact_isomap", "leaf", r#"{"landmarks":"all"}"#),
    ("few_landmarks_and_a_radius", "bump", r#"{"landmarks":20,"neighbors":{"epsilon_mm":5}}"#),
    ("counted_neighbours", "twisted", r#"{"neighbors":{"k":24}}"#),
    ("regular_lattice", "ellipsoid", r#"{"lattice":"regular","grid":{"rows":8,"cols":12}}"#),
    ("lattice_by_size", "bent", r#"{"grid":"auto"}"#),
    ("lattice_by_spacing", "leaf", r#"{"grid":"auto","spacing_mm":3}"#),
    ("main_sheet_alone", "tee", r#"{"max_figures":1}"#),
    ("every_branch", "cross", r#"{"prune":0}"#),
    ("coarser_voxels", "half_bent", r#"{"resolution_mm":1.7}"#),
    ("repeats", "twisted", r#"{"uncertainty":2}"#),
    ("paper", "half_bent", r#"{"correspondence":"paper","grid":{"rows":12,"cols":20}}"#),
];

#[test]
fn samples_give_their_golden_results_with_the_defaults() {
    let names = medialrep::samples::list().map(|(name, _)| name);
    check("samples", names.map(|name| (name, entry(&plain(name), "{}"))));
}

#[test]
fn samples_on_an_oblique_grid_give_their_golden_results() {
    let oblique = |name: &str| sample(name).voxelise_at([1.3; 3], turned(), PHASE).expect("fits in memory");
    let names = ["slab", "bent", "thick_bend", "leaf", "tee", "two", "ball", "tube", "mobius"];
    check("oblique", names.into_iter().map(|name| (name, entry(&oblique(name), LATTICE))));
}

#[test]
fn masks_like_those_of_organs_give_their_golden_results() {
    check("organs", ORGANS.into_iter().map(|(name, _, mask)| (name, entry(&mask(), LATTICE))));
}

#[test]
fn every_way_through_the_parameters_gives_its_golden_result() {
    check("ways", WAYS.into_iter().map(|(name, sample, params)| (name, entry(&plain(sample), params))));
}

fn file() -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("tests/golden.json")
}

fn read() -> Map<String, Value> {
    let bytes = std::fs::read(file()).unwrap_or_else(|_| b"{}".to_vec());
    serde_json::from_slice(&bytes).expect("an object of sections")
}

/// Holds one section of the file, or writes it.
fn check<'a>(section: &str, entries: impl Iterator<Item = (&'a str, Value)>) {
    let now: Map<String, Value> = entries.map(|(name, entry)| (name.to_owned(), entry)).collect();
    if std::env::var_os("MEDIALREP_GOLDEN").is_some_and(|value| value == "write") {
        return write(section, now);
    }
    let golden = read().remove(section).unwrap_or_default();
    let mut lines = String::new();
    compare(section, "", &golden, &Value::Object(now), &mut lines);
    let told = lines.lines().take(TOLD).collect::<Vec<_>>().join("\n");
    assert!(
        lines.is_empty(),
        "{told}\n{} differences; if they are meant, MEDIALREP_GOLDEN=write cargo test --test it golden writes anew",
        lines.lines().count()
    );
}

/// The sections are in the order of their names, whichever test ends first.
fn write(section: &str, now: Map<String, Value>) {
    static WRITING: Mutex<()> = Mutex::new(());
    let _one_at_a_time = WRITING.lock().unwrap();
    let mut all = read();
    all.insert(section.to_owned(), Value::Object(now));
    let mut sections: Vec<(String, Value)> = all.into_iter().collect();
    sections.sort_by(|a, b| a.0.cmp(&b.0));
    std::fs::write(file(), text_of(&Value::Object(sections.into_iter().collect()))).unwrap();
}

/// Appends a line for each difference; `quantity` is the name that a number's tolerance goes by.
fn compare(place: &str, quantity: &str, golden: &Value, now: &Value, lines: &mut String) {
    match (golden, now) {
        (Value::Object(a), Value::Object(b)) => {
            for name in a.keys().chain(b.keys().filter(|name| !a.contains_key(*name))) {
                let at = |map: &Map<String, Value>| map.get(name).cloned().unwrap_or_default();
                compare(&format!("{place}.{name}"), name, &at(a), &at(b), lines);
            }
        }
        (Value::Array(a), Value::Array(b)) if a.len() == b.len() => {
            for (number, (a, b)) in a.iter().zip(b).enumerate() {
                compare(&format!("{place}[{number}]"), quantity, a, b, lines);
            }
        }
        _ if is_near(quantity, golden, now) => {}
        _ => writeln!(lines, "{place}: golden {golden}, now {now}").unwrap(),
    }
}

fn is_near(quantity: &str, golden: &Value, now: &Value) -> bool {
    let tolerance = TOLERANCES.iter().find(|(name, _)| *name == quantity).map(|(_, tolerance)| *tolerance);
    match (tolerance, golden.as_f64(), now.as_f64()) {
        (Some(Tolerance { share, least }), Some(a), Some(b)) => (a - b).abs() <= (share * a.abs()).max(least),
        _ => golden == now,
    }
}

/// What is held of a run, from what its thickness.json says.
fn entry(volume: &LabelVolume, params: &str) -> Value {
    let model = match run_with(volume, params) {
        Ok(model) => model,
        Err(PipelineError::Refused(refusal)) => return json!({ "refused": refusal.code() }),
        Err(PipelineError::Cancelled(_)) => panic!("nobody cancels"),
    };
    let mut bytes = Vec::new();
    let input = InputFacts { sha256: String::new(), format: "nifti1".to_owned() };
    thickness::write(&model, &input, &[], OuterTimings::default(), &mut bytes).unwrap();
    let document: Value = serde_json::from_slice(&bytes).unwrap();
    let structures = list(&document["structures"]).iter().map(structure).collect();
    json!({ "structures": Value::Array(structures) })
}

fn list(value: &Value) -> &[Value] {
    value.as_array().expect("a list")
}

fn codes(value: &Value) -> Value {
    list(value).iter().map(|entry| entry["code"].clone()).collect()
}

fn structure(structure: &Value) -> Value {
    let quality = &structure["quality"];
    json!({
        "label": structure["label"],
        "refused": structure["refusal"]["code"],
        "verdict": quality["verdict"],
        "reasons": codes(&quality["reasons"]),
        "warnings": codes(&structure["warnings"]),
        "junctions": list(&structure["junctions"]).iter().map(|j| j["figures"].clone()).collect::<Value>(),
        "pruned": quality["pruned_sheets"],
        "dice": short(&quality["dice"]),
        "covered_share": short(&quality["covered_share"]),
        "figures": list(&structure["figures"]).iter().map(any_figure).collect::<Value>(),
    })
}

fn any_figure(value: &Value) -> Value {
    if value["kind"] == json!("tube") { tube(value) } else { figure(value) }
}

fn tube(figure: &Value) -> Value {
    let (quality, summary) = (&figure["quality"], &figure["tube_summary"]);
    let (rows, cols) = (count(&figure["grid"]["rows"]), count(&figure["grid"]["cols"]));
    let middle = cols / 2;
    json!({
        "kind": "tube",
        "grid": [rows, cols],
        "caps": figure["caps"]["columns"],
        "thickness_mm": [short(&figure["thickness_summary"]["total_mm"]["mean"]), short(&summary["length_mm"])],
        "area_mm2": short(&figure["thickness_summary"]["area_mm2"]),
        "shortened": quality["shortened_nodes"],
        "folds": quality["folds"],
        "self_intersections": quality["self_intersections"],
        "dice": short(&quality["dice"]),
        "medial": positions(&figure["centreline"], &[0, middle, cols - 1]),
        "wall": positions(&figure["wall"], &[0, middle, rows / 2 * cols + middle, rows * cols - 1]),
    })
}

fn figure(figure: &Value) -> Value {
    let (quality, total) = (&figure["quality"], &figure["thickness_summary"]["total_mm"]);
    let residual = &quality["residual_variance"];
    let (rows, cols) = (count(&figure["grid"]["rows"]), count(&figure["grid"]["cols"]));
    // The four corners and one in the middle.
    let nodes = [0, cols - 1, (rows - 1) * cols, rows * cols - 1, rows / 2 * cols + cols / 2];
    json!({
        "frame": figure["frame"]["rule"],
        "grid": [rows, cols],
        "invalid": list(&figure["valid"]).iter().filter(|valid| **valid == json!(false)).count(),
        "thickness_mm": [short(&total["mean"]), short(&total["p5"]), short(&total["p95"])],
        "thickness_sd_mm": short(&total["sd"]),
        "uncertainty_mm": mean(&figure["uncertainty"]["total_mm"]),
        "area_mm2": short(&figure["thickness_summary"]["area_mm2"]),
        "residual_variance": [short(&residual["medial"]), short(&residual["upper"]), short(&residual["lower"])],
        "spacing_variation": short(&quality["spacing_variation"]),
        "shortened": quality["shortened_nodes"],
        "folds": quality["folds"],
        "folded_wedges": list(&quality["folded_wedges"]).len(),
        "self_intersections": quality["self_intersections"],
        "dice": short(&quality["dice"]),
        "covered_share": short(&quality["covered_share"]),
        "medial": positions(&figure["medial"], &nodes),
        "upper": positions(&figure["upper"], &nodes),
        "lower": positions(&figure["lower"], &nodes),
    })
}

/// Of a list of numbers, where there is one.
fn mean(numbers: &Value) -> Value {
    let Some(numbers) = numbers.as_array() else { return Value::Null };
    let sum: f64 = numbers.iter().filter_map(Value::as_f64).sum();
    short(&json!(sum / numbers.len() as f64))
}

fn positions(points: &Value, nodes: &[usize]) -> Value {
    let position = |&n: &usize| list(&points[n]).iter().map(short).collect::<Value>();
    nodes.iter().map(position).collect()
}

fn count(value: &Value) -> usize {
    usize::try_from(value.as_u64().expect("a count")).expect("small")
}

/// A number with four decimals; what is none stays so.
fn short(value: &Value) -> Value {
    value.as_f64().map_or_else(|| value.clone(), |x| json!((x * 1e4).round() / 1e4))
}

#[test]
fn a_number_is_golden_up_to_its_tolerance_and_all_else_exactly() {
    let told = |golden: Value, now: Value| {
        let mut lines = String::new();
        compare("slab", "", &golden, &now, &mut lines);
        lines
    };
    assert_eq!(told(json!({"medial": [[1.0, 2.0]]}), json!({"medial": [[1.009, 2.0]]})), "");
    let moved = told(json!({"medial": [[1.0, 2.0]]}), json!({"medial": [[1.0, 2.02]]}));
    assert_eq!(moved, "slab.medial[0][1]: golden 2.0, now 2.02\n");
    assert_eq!(told(json!({"folds": 1}), json!({"folds": 2})), "slab.folds: golden 1, now 2\n");
    assert_eq!(told(json!({"dice": 0.9}), json!({"dice": null})), "slab.dice: golden 0.9, now null\n");
    assert_eq!(told(json!({}), json!({"tee": "new"})), "slab.tee: golden null, now \"new\"\n");
    assert!(told(json!({"figures": [1]}), json!({"figures": [1, 2]})).contains("figures"));
}
