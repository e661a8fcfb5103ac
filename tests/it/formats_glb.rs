//! model.glb, read back with the gltf crate and judged by the Khronos validator.

use std::path::Path;
use std::process::Command;

use gltf::mesh::Mode;
use medialrep::formats::write::glb;
use medialrep::model::{Model, TriangleMesh};
use medialrep::numerics::triangles::volume;
use nalgebra::{Matrix4, Point3, Vector3};
use serde_json::Value;

use crate::help::left_out::left_out;
use crate::help::models::model;
use crate::pipeline_legality::check_watertight;

fn bytes(model: &Model) -> Vec<u8> {
    let mut bytes = Vec::new();
    glb::write(model, &mut bytes).unwrap();
    bytes
}

fn child<'a>(node: &gltf::Node<'a>, name: &str) -> gltf::Node<'a> {
    node.children().find(|child| child.name() == Some(name)).unwrap_or_else(|| panic!("no {name}"))
}

fn extras(node: &gltf::Node) -> Value {
    serde_json::from_str(node.extras().as_ref().unwrap().get()).unwrap()
}

#[test]
fn the_scene_is_root_structures_figures_meshes() {
    let (document, _, _) = gltf::import_slice(bytes(&model())).unwrap();
    let roots: Vec<_> = document.default_scene().unwrap().nodes().collect();
    assert_eq!(roots.len(), 1);
    let names = |node: &gltf::Node| node.children().map(|c| c.name().unwrap().to_owned()).collect::<Vec<_>>();
    assert_eq!(names(&roots[0]), ["label 11", "label 2101"]);
    let structure = child(&roots[0], "label 11");
    assert_eq!(names(&structure), ["figure 0", "figure 1", "object"]);
    assert_eq!(extras(&structure)["label"], 11);
    let parts = ["medial", "upper", "lower", "crest", "vectors", "closed"];
    assert_eq!(names(&child(&structure, "figure 0")), parts);
    assert_eq!(extras(&child(&structure, "figure 0"))["has_closed_surface"], true);
    // A node is invalid: its surface has a hole.
    assert_eq!(names(&child(&structure, "figure 1")), parts[..5]);
    assert_eq!(extras(&child(&structure, "figure 1"))["has_closed_surface"], false);
    let range = extras(&child(&child(&structure, "figure 0"), "upper"))["color_range_mm"].clone();
    assert_eq!(range, serde_json::json!([2.0, 3.625]));
    let refused = child(&roots[0], "label 2101");
    assert_eq!(refused.children().count(), 0);
    assert_eq!(extras(&refused)["refusal"], "too_small");
    assert_eq!(extras(&roots[0])["unit"], "mm");
}

#[test]
fn the_root_turns_mm_ras_into_metres_with_the_front_to_the_viewer() {
    let (document, _, _) = gltf::import_slice(bytes(&model())).unwrap();
    let root = document.nodes().find(|node| node.name() == Some("medialrep")).unwrap();
    let matrix = Matrix4::from_fn(|r, c| f64::from(root.transform().matrix()[c][r]));
    let there = matrix.transform_point(&Point3::new(1000.0, 2000.0, 3000.0));
    assert!((there - Point3::new(-1.0, 3.0, 2.0)).norm() < 1e-5);
    assert!(matrix.fixed_view::<3, 3>(0, 0).determinant() > 0.0, "a mirror would turn triangles over");
    let others = document.nodes().filter(|node| node.name() != Some("medialrep"));
    for node in others {
        assert_eq!(
            node.transform().matrix(),
            gltf::scene::Transform::Decomposed {
                translation: [0.0; 3],
                rotation: [0.0, 0.0, 0.0, 1.0],
                scale: [1.0; 3]
            }
            .matrix(),
            "only the root moves anything"
        );
    }
}

#[test]
fn surfaces_face_away_from_the_sheet() {
    let model = model();
    let figure = model.structures[0].sheets().next().expect("a sheet");
    let (document, buffers, _) = gltf::import_slice(bytes(&model)).unwrap();
    for (name, nodes) in [("upper", &figure.upper), ("lower", &figure.lower)] {
        // The first mesh of that name belongs to the first figure.
        let mesh = document.meshes().find(|mesh| mesh.name() == Some(name)).unwrap();
        let primitive = mesh.primitives().next().unwrap();
        let reader = primitive.reader(|buffer| Some(&buffers[buffer.index()]));
        let positions: Vec<Vector3<f32>> = reader.read_positions().unwrap().map(Vector3::from).collect();
        assert_eq!(positions.len(), 48);
        let outward = |n: usize| (nodes[n] - figure.medial[n]).cast::<f32>();
        for (n, normal) in reader.read_normals().unwrap().enumerate() {
            assert!((positions[n].cast::<f64>() - nodes[n].coords).norm() < 1e-4);
            assert!(Vector3::from(normal).dot(&outward(n)) > 0.0, "{name} normal {n}");
        }
        let indices: Vec<usize> = reader.read_indices().unwrap().into_u32().map(|n| n as usize).collect();
        for t in indices.chunks(3) {
            let normal = (positions[t[1]] - positions[t[0]]).cross(&(positions[t[2]] - positions[t[0]]));
            assert!(normal.dot(&outward(t[0])) > 0.0, "{name} triangle {t:?}");
        }
        let corners: Vec<[f32; 2]> = reader.read_tex_coords(0).unwrap().into_f32().collect();
        assert_eq!((corners[0], corners[7], corners[47]), ([0.0, 0.0], [1.0, 0.0], [1.0, 1.0]));
        assert!(reader.read_colors(0).is_some());
        let thickness = primitive.attributes().find(|(semantic, _)| semantic.to_string() == "_THICKNESS").unwrap().1;
        let expected = if name == "upper" { 3.0 } else { 2.0 };
        assert!((thickness.min().unwrap()[0].as_f64().unwrap() - expected).abs() < 1e-6);
    }
}

#[test]
fn an_invalid_node_is_not_drawn() {
    let (document, buffers, _) = gltf::import_slice(bytes(&model())).unwrap();
    let second = |name: &str| document.meshes().filter(|mesh| mesh.name() == Some(name)).nth(1).unwrap();
    let count = |name: &str| {
        let mesh = second(name);
        let primitive = mesh.primitives().next().unwrap();
        let reader = primitive.reader(|buffer| Some(&buffers[buffer.index()]));
        let positions = reader.read_positions().unwrap();
        assert!(positions.flatten().all(f32::is_finite), "{name}");
        reader.read_indices().unwrap().into_u32().count()
    };
    assert_eq!(count("medial"), 3 * 2 * (4 * 5 - 1));
    assert_eq!(count("vectors"), 2 * 2 * 29);
    assert_eq!(count("crest"), 3 * 12 * (18 - 2));
    assert_eq!(second("vectors").primitives().next().unwrap().mode(), Mode::Lines);
}

#[test]
fn the_closed_surface_is_one_watertight_mesh_that_faces_outward() {
    let (document, buffers, _) = gltf::import_slice(bytes(&model())).unwrap();
    let mesh = document.meshes().find(|mesh| mesh.name() == Some("closed")).unwrap();
    let primitive = mesh.primitives().next().unwrap();
    let reader = primitive.reader(|buffer| Some(&buffers[buffer.index()]));
    let positions = reader.read_positions().unwrap().map(|p| Point3::from(p).cast::<f64>()).collect::<Vec<_>>();
    let indices: Vec<u32> = reader.read_indices().unwrap().into_u32().collect();
    let triangles = indices.chunks(3).map(|t| [t[0], t[1], t[2]]).collect();
    let mesh = TriangleMesh { positions, triangles };
    check_watertight(&mesh);
    // 25 × 35 of 5 to 6 thick, and the crest.
    let volume = volume(&mesh.positions, &mesh.triangles);
    assert!((4400.0..5600.0).contains(&volume), "{volume}");
    let normals: Vec<Vector3<f32>> = reader.read_normals().unwrap().map(Vector3::from).collect();
    assert_eq!(normals.len(), mesh.positions.len());
    assert!(normals.iter().all(|normal| (normal.norm() - 1.0).abs() < 1e-5));
}

#[test]
fn equal_models_give_equal_bytes() {
    assert_eq!(bytes(&model()), bytes(&model()));
}

#[test]
fn a_model_without_any_mesh_is_a_valid_file() {
    let mut empty = model();
    empty.structures.remove(0);
    assert!(gltf::Gltf::from_slice(&bytes(&empty)).is_ok());
    check_validator(&bytes(&empty));
}

#[test]
fn the_khronos_validator_finds_nothing() {
    check_validator(&bytes(&model()));
}

/// Runs the validator from `tests/tools` (`npm ci` there). Without it the check is left out,
/// but never in continuous integration.
#[track_caller]
fn check_validator(glb: &[u8]) {
    let tools = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/tools");
    if !tools.join("node_modules/gltf-validator").is_dir() {
        assert!(std::env::var_os("CI").is_none(), "run `npm ci` in tests/tools first");
        return left_out("no gltf-validator; run `npm ci` in tests/tools");
    }
    let file = tempfile::NamedTempFile::with_suffix(".glb").unwrap();
    std::fs::write(file.path(), glb).unwrap();
    let done = Command::new("node").arg(tools.join("validate.mjs")).arg(file.path()).output().unwrap();
    assert!(done.status.success(), "{}", String::from_utf8_lossy(&done.stderr));
    let report: Value = serde_json::from_slice(&done.stdout).unwrap();
    let issues = &report["issues"];
    assert_eq!((&issues["numErrors"], &issues["numWarnings"]), (&0.into(), &0.into()), "{issues:#}");
    // An empty node is what a refused structure is, and the texture coordinates are there for
    // textures of the user's; nothing else is worth even a remark.
    let meant = |message: &&Value| {
        message["code"] == "NODE_EMPTY" || message["pointer"].as_str().is_some_and(|at| at.ends_with("TEXCOORD_0"))
    };
    assert_eq!(
        issues["messages"].as_array().unwrap().iter().filter(|message| !meant(message)).count(),
        0,
        "{issues:#}"
    );
}
