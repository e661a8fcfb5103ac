//! thickness.json and the tables.

use std::io::Write;

use medialrep::formats::artifacts::ARTIFACTS;
use medialrep::formats::write::record::{Record, RecordError};
use medialrep::formats::write::tables;
use medialrep::formats::write::thickness::{self, InputFacts, OuterTimings};
use medialrep::model::Model;
use medialrep::model::Uncertainty;
use medialrep::model::{Stage, Warning};
use medialrep::params::{PARAMS, Params};
use serde_json::{Value, json};

use crate::help::models::model;

fn text(write: impl FnOnce(&mut Vec<u8>) -> std::io::Result<()>) -> String {
    let mut bytes = Vec::new();
    write(&mut bytes).unwrap();
    String::from_utf8(bytes).unwrap()
}

fn input() -> InputFacts {
    InputFacts { sha256: "ab".repeat(32), format: "nifti1.gz".to_owned() }
}

fn thickness(model: &Model) -> Value {
    let input = input();
    let notices = [Warning { code: "no_orientation".into(), message: "none".to_owned() }];
    let timings = OuterTimings { read_ms: 1.0, write_ms: 2.0, total_ms: 3.0 };
    serde_json::from_str(&text(|out| thickness::write(model, &input, &notices, timings, out))).unwrap()
}

fn keys(value: &Value) -> Vec<&str> {
    value.as_object().unwrap().keys().map(String::as_str).collect()
}

#[test]
fn thickness_json_has_the_names_of_the_contract() {
    let document = thickness(&model());
    let top = ["schema", "program", "input", "space", "params", "structures", "warnings", "timings_ms"];
    assert_eq!(keys(&document), top);
    assert_eq!(document["schema"], "medialrep/thickness/1");
    assert_eq!(document["program"], json!({"name": "medialrep", "version": env!("CARGO_PKG_VERSION")}));
    assert_eq!(document["space"], json!({"name": "RAS", "unit": "mm"}));
    assert_eq!(keys(&document["input"]), ["sha256", "format", "dims", "spacing_mm", "affine"]);
    assert_eq!(document["input"]["spacing_mm"], json!([1.0, 1.0, 2.0]));
    assert_eq!(document["input"]["affine"][2], json!([0.0, 0.0, 2.0, 5.5]));
    assert_eq!(keys(&document["params"]), PARAMS.iter().map(|param| param.name).collect::<Vec<_>>());
    assert_eq!(document["warnings"][0]["code"], "no_orientation");
    assert_eq!(document["timings_ms"], json!({"read": 1.0, "write": 2.0, "total": 3.0}));
    let structure = &document["structures"][0];
    let names = [
        "index",
        "label",
        "name",
        "color",
        "code",
        "voxels",
        "volume_mm3",
        "kept_share",
        "components",
        "parts",
        "working_voxel_mm",
        "grain_mm",
        "resolved",
        "automatic",
        "figures",
        "junctions",
        "thickness_summary",
        "quality",
        "warnings",
        "timings_ms",
    ];
    assert_eq!(keys(structure), names);
    let mut stages: Vec<&str> = Stage::ALL.iter().map(|stage| stage.name()).collect();
    stages.push("total");
    assert_eq!(keys(&structure["timings_ms"]), stages);
    assert_eq!(structure["quality"]["verdict"], "warn");
    assert_eq!(structure["quality"]["reasons"][0]["value"], json!(0.3));
    assert_eq!(structure["quality"]["reasons"][0]["threshold"], Value::Null);
    assert_eq!(document["structures"][1]["refusal"]["code"], "too_small");
}

#[test]
fn a_figure_has_every_node_in_row_major_order() {
    let document = thickness(&model());
    let figure = &document["structures"][0]["figures"][0];
    let names = [
        "index",
        "kind",
        "part",
        "grid",
        "medial",
        "upper",
        "lower",
        "crest",
        "crest_arcs",
        "valid",
        "repaired",
        "vectors",
        "thickness",
        "thickness_summary",
        "node_area_mm2",
        "medial_radius_mm",
        "area_distortion",
        "intrinsic",
        "neighbors",
        "landmarks",
        "frame",
        "automatic",
        "quality",
    ];
    assert_eq!(keys(figure), names);
    assert_eq!(figure["grid"], json!({"rows": 6, "cols": 8}));
    for list in [
        &figure["medial"],
        &figure["upper"],
        &figure["lower"],
        &figure["valid"],
        &figure["node_area_mm2"],
        &figure["medial_radius_mm"],
        &figure["area_distortion"],
        &figure["vectors"]["upper"],
        &figure["thickness"]["total_mm"],
        &figure["intrinsic"]["lower"],
    ] {
        assert_eq!(list.as_array().unwrap().len(), 48);
    }
    assert_eq!(figure["crest"].as_array().unwrap().len(), 2 * (6 + 8) - 4);
    let arcs = figure["crest_arcs"].as_array().unwrap();
    assert_eq!(arcs.len(), 2 * (6 + 8) - 4);
    for (arc, crest) in arcs.iter().zip(figure["crest"].as_array().unwrap()) {
        assert_eq!((arc.as_array().unwrap().len(), &arc[2]), (5, crest));
    }
    // Node (1, 0) is 5 mm along y.
    assert_eq!(figure["medial"][8], json!([0.0, 5.0, 40.0]));
    assert_eq!(figure["vectors"]["lower"][8], json!([0.0, 0.0, -2.0]));
    assert_eq!(figure["thickness"]["total_mm"][8], json!(5.125));
    assert_eq!(figure["quality"]["folded_cells"], json!([{"side": "upper", "i": 1, "j": 2}]));
    assert_eq!(figure["area_distortion"][8], json!(0.25));
    let areas = figure["node_area_mm2"].as_array().unwrap().iter().map(|area| area.as_f64().unwrap());
    assert!((areas.sum::<f64>() - figure["thickness_summary"]["area_mm2"].as_f64().unwrap()).abs() < 1e-3);
    // What is no number is null.
    assert_eq!(document["structures"][0]["figures"][1]["area_distortion"][0], Value::Null);
    assert_eq!(document["structures"][0]["figures"][1]["medial"][0], json!([null, 0.0, 0.0]));
}

#[test]
fn a_result_says_what_it_rests_on() {
    let document = thickness(&model());
    let structure = &document["structures"][0];
    assert_eq!(keys(&structure["automatic"]["pruning"]), ["strength", "loss_needed", "pruned", "kept"]);
    assert_eq!(structure["automatic"]["pruning"]["loss_needed"], json!(0.03));
    let figure = &structure["figures"][0];
    let frame = ["rule", "cols_along", "rows_along", "upper_towards", "aspect", "ambiguous", "reason"];
    assert_eq!(keys(&figure["frame"]), frame);
    assert_eq!(figure["frame"]["rule"], "longer_axis");
    assert_eq!((&figure["frame"]["ambiguous"], &figure["frame"]["aspect"]), (&json!(true), &json!(1.25)));
    assert_eq!(figure["frame"]["reason"], "the sheet is nearly square");
    let automatic = &figure["automatic"];
    assert_eq!(keys(automatic), ["neighbors", "landmarks", "grid", "kind"]);
    assert_eq!(keys(&automatic["neighbors"]), ["chosen", "radius_mm", "graph_pieces"]);
    assert_eq!(keys(&automatic["landmarks"]), ["chosen", "of_points", "residual_variance"]);
    let grid = json!({"rows": 6, "cols": 8, "from": "asked", "length_mm": 35.0, "width_mm": 25.0});
    assert_eq!(automatic["grid"], grid);
}

#[test]
fn uncertainty_is_written_when_it_was_asked_for() {
    let mut model = model();
    model.params = Params { uncertainty: 2, ..Params::default() }.check().unwrap();
    let spread = |sd: Option<f64>| vec![sd; 48];
    let medialrep::model::Figure::Sheet(sheet) = &mut model.structures[0].figures[0] else { panic!("a sheet") };
    sheet.uncertainty = Some(Uncertainty {
        repeats: 2,
        matched: 2,
        upper_mm: spread(Some(0.25)),
        lower_mm: spread(Some(0.5)),
        total_mm: spread(None),
    });
    let document = thickness(&model);
    assert_eq!(document["params"]["uncertainty"], 2);
    let found = &document["structures"][0]["figures"][0]["uncertainty"];
    assert_eq!(keys(found), ["repeats", "matched", "upper_mm", "lower_mm", "total_mm"]);
    assert_eq!((&found["upper_mm"][47], &found["total_mm"][0]), (&json!(0.25), &Value::Null));
    let table = text(|out| tables::write_thickness(&model, out));
    let lines: Vec<&str> = table.lines().collect();
    assert!(lines[0].ends_with(",thickness_mm,valid,sd_mm"));
    assert_eq!(lines[1 + 48 + 8], "0,11,0,1,0,lower,0,5,40,0,0,-2,2,true,0.5");
    // A figure without one has an empty cell.
    assert!(lines[1 + 96].ends_with(",false,"), "{}", lines[97]);
}

#[test]
fn quality_has_its_names_per_figure_and_per_structure() {
    let document = thickness(&model());
    let structure = &document["structures"][0];
    let fit = ["dice", "flat_dice", "grain_mm", "covered_share", "far_share", "mask_to_model", "model_to_mask"];
    let sent = ["kept", "outside_share", "worst_place"];
    let folds = [
        "folds",
        "folds_before_repair",
        "repaired_nodes",
        "shortened_nodes",
        "past_foot_nodes",
        "off_sheet_nodes",
        "merged_nodes",
    ];
    let even = ["spacing_variation", "distortion", "medial_offset"];
    let turned = ["folded_cells", "folded_centres", "folded_wedges", "self_intersections"];
    let expected = [
        &["residual_variance", "embedding"],
        &folds[..],
        &["corners"],
        &turned,
        &fit,
        &even,
        &["valid_share", "outside_share"],
    ]
    .concat();
    assert_eq!(keys(&structure["figures"][0]["quality"]), expected);
    let verdict = ["verdict", "reasons", "thresholds"];
    let expected = [
        &verdict,
        &folds[..],
        &turned[1..],
        &fit,
        &["residual_variance", "turned_over"],
        &even,
        &["pruned_sheets"],
        &sent,
    ]
    .concat();
    assert_eq!(keys(&structure["quality"]), expected);
    let distortion = ["area_sd", "area_max_log", "angle_mean_deg", "angle_max_deg"];
    assert_eq!(keys(&structure["quality"]["distortion"]), distortion);
    assert_eq!(keys(&structure["quality"]["medial_offset"]), ["mean", "p95"]);
    assert_eq!(keys(&structure["thickness_summary"]), ["upper_mm", "lower_mm", "total_mm", "wall_mm", "area_mm2"]);
    assert_eq!(structure["figures"][0]["thickness_summary"]["lower_mm"]["p95"], json!(2.0));
    assert_eq!(keys(&structure["thickness_summary"]["total_mm"]), ["mean", "sd", "p5", "p50", "p95", "min", "max"]);
    // A refused structure has no sheet to take a mean over.
    assert_eq!(document["structures"][1]["thickness_summary"]["total_mm"]["mean"], Value::Null);
}

#[test]
fn equal_models_give_equal_bytes() {
    assert_eq!(thickness(&model()), thickness(&model()));
}

#[test]
fn thickness_csv_has_a_row_per_node_and_side() {
    let table = text(|out| tables::write_thickness(&model(), out));
    let lines: Vec<&str> = table.lines().collect();
    assert_eq!(lines[0], "structure,label,figure,i,j,side,x_mm,y_mm,z_mm,dx_mm,dy_mm,dz_mm,thickness_mm,valid");
    assert_eq!(lines.len(), 1 + 2 * (48 + 30));
    assert_eq!(lines[1 + 8], "0,11,0,1,0,upper,0,5,40,0,0,3.125,3.125,true");
    assert_eq!(lines[1 + 48 + 8], "0,11,0,1,0,lower,0,5,40,0,0,-2,2,true");
    assert!(lines[1 + 96].starts_with("0,11,1,0,0,upper,,0,0,"), "{}", lines[97]);
    assert!(lines[1 + 96].ends_with(",false"));
    assert!(lines.iter().all(|line| line.split(',').count() == 14));
}

#[test]
fn points_csv_has_a_row_per_point() {
    let table = text(|out| tables::write_points(&model(), out));
    let lines: Vec<&str> = table.lines().collect();
    assert_eq!(lines[0], "structure,figure,surface,x_mm,y_mm,z_mm,u_mm,v_mm");
    assert_eq!(lines.len(), 1 + 3 * (48 + 30));
    assert_eq!(lines[1 + 8], "0,0,medial,0,5,40,0,5");
}

#[test]
fn a_full_disk_is_an_error_of_the_writer() {
    struct Full;
    impl Write for Full {
        fn write(&mut self, _: &[u8]) -> std::io::Result<usize> {
            Err(std::io::ErrorKind::StorageFull.into())
        }
        fn flush(&mut self) -> std::io::Result<()> {
            Ok(())
        }
    }
    assert_eq!(tables::write_points(&model(), Full).unwrap_err().kind(), std::io::ErrorKind::StorageFull);
}

#[test]
fn a_document_reads_what_it_writes() {
    let mut bytes = Vec::new();
    thickness::write(&model(), &input(), &[], OuterTimings::default(), &mut bytes).unwrap();
    let read = thickness::Document::read(&bytes).unwrap();
    let mut again = Vec::new();
    read.write(&mut again).unwrap();
    assert_eq!(String::from_utf8(again), String::from_utf8(bytes));
}

#[test]
fn a_document_of_before_is_read_and_one_of_another_schema_is_not() {
    let mut document = thickness(&model());
    let older = document["structures"][0]["figures"][0].as_object_mut().unwrap();
    older.shift_remove("kind");
    older["quality"].as_object_mut().unwrap().shift_remove("embedding");
    document["structures"][0].as_object_mut().unwrap().shift_remove("color");
    assert!(thickness::Document::read(document.to_string().as_bytes()).is_ok());
    document["schema"] = json!("medialrep/thickness/2");
    let error = thickness::Document::read(document.to_string().as_bytes()).unwrap_err();
    assert!(error.to_string().contains("medialrep/thickness/2"), "{error}");
    assert!(thickness::Document::read(b"{}").is_err());
}

#[test]
fn every_artifact_of_a_record_has_the_bytes_it_had_before() {
    let timings = OuterTimings { read_ms: 1.25, write_ms: 1.0 / 3.0, total_ms: 7.0 };
    let warnings = vec![Warning { code: "no_orientation".into(), message: "none".to_owned() }];
    let record =
        Record { model: model(), input: input(), warnings, timings, ended_unix_s: Some(1_764_446_400), dicom: None };
    let mut kept = Vec::new();
    record.write(&mut kept).unwrap();
    let read = Record::read(kept.as_slice()).unwrap();
    for artifact in &ARTIFACTS {
        let [before, after] = [&record, &read].map(|record| {
            let mut bytes = Vec::new();
            (artifact.write)(record, &mut bytes).unwrap();
            bytes
        });
        assert!(before == after, "{} changed", artifact.name);
    }
}

#[test]
fn a_record_that_is_damaged_or_of_another_version_is_refused() {
    let timings = OuterTimings::default();
    let record =
        Record { model: model(), input: input(), warnings: Vec::new(), timings, ended_unix_s: None, dicom: None };
    let mut kept = Vec::new();
    record.write(&mut kept).unwrap();
    assert!(matches!(Record::read(&kept[..kept.len() / 2]), Err(RecordError::Damaged(_))));
    assert!(matches!(Record::read(&kept[..2]), Err(RecordError::Damaged(_))));
    // One of before there was a hash.
    let mut unhashed = kept[..kept.len() - 32].to_vec();
    unhashed[3] = 1;
    assert!(Record::read(unhashed.as_slice()).is_ok());
    let mut turned_over = kept.clone();
    turned_over[kept.len() / 2] ^= 1;
    assert!(matches!(Record::read(turned_over.as_slice()), Err(RecordError::Damaged(_))));
    kept[3] = 99;
    assert!(matches!(Record::read(kept.as_slice()), Err(RecordError::Version { found: 99 })));
}
