//! Model → `model.glb`. Positions are mm in world space; the root node alone turns them into
//! glTF's metres.

use std::io::{self, Write};

use serde_json::{Map, Value, json};

use super::colors::viridis_linear;
use super::gltf::{Gltf, Material, Mesh, Mode};
use super::rounded::round;
use crate::model::{Figure, LatticeSize, Model, Sheet, Side, Structure, SurfaceMesh, TriangleMesh, Tube, normals};
use crate::numerics::field::id;
use crate::space::WorldPoint;

const MEDIAL: Material = Material { name: "medial", color: [1.0, 1.0, 1.0, 1.0] };
const SIDE: Material = Material { name: "side", color: [1.0, 1.0, 1.0, 0.45] };
const CREST: Material = Material { name: "crest", color: [0.75, 0.75, 0.75, 0.45] };
const VECTORS: Material = Material { name: "vectors", color: [0.08, 0.08, 0.08, 1.0] };
const CENTRELINE: Material = Material { name: "centreline", color: [0.08, 0.08, 0.08, 1.0] };
const CLOSED: Material = Material { name: "closed", color: [0.75, 0.75, 0.75, 0.12] };
const OBJECT: Material = Material { name: "object", color: [0.85, 0.80, 0.75, 0.25] };

/// X = −x, Y = z, Z = y in metres, column by column: a rotation (its determinant is positive),
/// so triangles keep their front.
const GLTF_FROM_WORLD: [f64; 16] =
    [-0.001, 0.0, 0.0, 0.0, 0.0, 0.0, 0.001, 0.0, 0.0, 0.001, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0];

/// Writes the whole scene.
///
/// # Errors
/// When writing fails or the file would exceed 4 GiB.
pub fn write(model: &Model, out: impl Write) -> io::Result<()> {
    let mut gltf = Gltf::default();
    let structures: Vec<usize> = model
        .structures
        .iter()
        .enumerate()
        .map(|(index, structure)| add_structure(&mut gltf, index, structure))
        .collect();
    let root = fields(json!({
        "name": "medialrep",
        "matrix": GLTF_FROM_WORLD,
        "extras": {"space": "RAS", "unit": "mm", "world_from_voxel": model.world_from_voxel.rows()},
    }));
    let root = gltf.node(root, &structures);
    gltf.write(root, out)
}

fn fields(value: Value) -> Map<String, Value> {
    match value {
        Value::Object(fields) => fields,
        _ => Map::new(),
    }
}

/// Lowest and highest thickness, mm.
type Range = [f64; 2];

fn add_structure(gltf: &mut Gltf, index: usize, structure: &Structure) -> usize {
    let ranges = Ranges::of(structure);
    let mut children = Vec::new();
    for (number, figure) in structure.figures.iter().enumerate() {
        let (mut parts, kind) = match figure {
            Figure::Sheet(sheet) => (add_sheet(gltf, sheet, &ranges), "sheet"),
            Figure::Tube(tube) => (add_tube(gltf, tube, &ranges), "tube"),
        };
        let closed = figure.body().smooth_closed().and_then(|mesh| solid_mesh("closed", &mesh, CLOSED));
        let LatticeSize { rows, cols } = figure.grid();
        let extras = json!({"structure": index, "label": structure.label, "figure": number, "kind": kind,
            "rows": rows, "cols": cols, "has_closed_surface": closed.is_some()});
        parts.extend(closed.map(|mesh| gltf.mesh_node(&mesh, json!({"kind": "closed"}))));
        children.push(gltf.node(fields(json!({"name": format!("figure {number}"), "extras": extras})), &parts));
    }
    if let Some(object) = solid_mesh("object", &structure.object, OBJECT) {
        children.push(gltf.mesh_node(&object, json!({"kind": "object"})));
    }
    let mut extras = json!({"structure": index, "label": structure.label});
    if let Some(refusal) = &structure.refusal {
        extras["refusal"] = refusal.code().into();
    }
    gltf.node(fields(json!({"name": format!("label {}", structure.label), "extras": extras})), &children)
}

/// Lowest and highest thickness of all figures of a structure, so that they can be compared.
struct Ranges {
    side: Range,
    total: Range,
}

impl Ranges {
    fn of(structure: &Structure) -> Self {
        let (mut sides, mut totals) = (Vec::new(), Vec::new());
        for sheet in structure.sheets() {
            let drawable = sheet.drawable();
            let drawn = |lengths: Vec<f64>| lengths.into_iter().zip(&drawable).filter(|(_, ok)| **ok).map(|(x, _)| x);
            for side in Side::BOTH {
                sides.extend(drawn(sheet.lengths_mm(side)));
            }
            totals.extend(drawn(sheet.total_mm()));
        }
        for tube in structure.tubes() {
            sides.extend(tube.lengths_mm().into_iter().filter(|length| length.is_finite()));
        }
        Self { side: range(&sides), total: range(&totals) }
    }
}

fn range(values: &[f64]) -> Range {
    let (mut low, mut high) = (f64::INFINITY, f64::NEG_INFINITY);
    for &value in values {
        (low, high) = (low.min(value), high.max(value));
    }
    if low <= high { [low, high] } else { [0.0, 0.0] }
}

fn color(value: f64, [low, high]: Range) -> [f32; 3] {
    let share = if high > low { (value - low) / (high - low) } else { 0.5 };
    viridis_linear(share).map(single)
}

/// Surfaces, crest and vectors of a sheet.
fn add_sheet(gltf: &mut Gltf, sheet: &Sheet, ranges: &Ranges) -> Vec<usize> {
    let [upper_mm, lower_mm] = Side::BOTH.map(|side| sheet.lengths_mm(side));
    let [upper, lower] = Side::BOTH.map(|side| sheet.side_mesh(side));
    let surfaces = [
        ("medial", sheet.medial_mesh(), sheet.total_mm(), ranges.total, MEDIAL),
        ("upper", upper, upper_mm, ranges.side, SIDE),
        ("lower", lower, lower_mm, ranges.side, SIDE),
    ];
    let mut nodes = Vec::new();
    for (name, surface, thickness_mm, range, material) in surfaces {
        if let Some(surface) = surface {
            let mesh = colored(plain(name, Mode::Triangles, material), &surface, &thickness_mm, range);
            let mesh = Mesh { texture_coordinates: Some(sheet_places(&surface, sheet.grid)), ..mesh };
            nodes.push(gltf.mesh_node(&mesh, json!({"kind": name, "color_range_mm": range.map(round)})));
        }
    }
    if let Some(crest) = sheet.crest_mesh() {
        let mesh = shaped(plain("crest", Mode::Triangles, CREST), &crest);
        nodes.push(gltf.mesh_node(&mesh, json!({"kind": "crest"})));
    }
    if let Some(mesh) = vectors_mesh(sheet) {
        nodes.push(gltf.mesh_node(&mesh, json!({"kind": "vectors"})));
    }
    nodes
}

/// Centreline, wall and vectors of a tube.
fn add_tube(gltf: &mut Gltf, tube: &Tube, ranges: &Ranges) -> Vec<usize> {
    let mut nodes = Vec::new();
    if tube.centreline.iter().all(|p| p.iter().all(|x| x.is_finite())) {
        let mesh = centreline_mesh(tube);
        nodes.push(gltf.mesh_node(&mesh, json!({"kind": "centreline"})));
    }
    let Some(surface) = tube.wall_mesh() else { return nodes };
    let wall = colored(plain("wall", Mode::Triangles, SIDE), &surface, &tube.lengths_mm(), ranges.side);
    let wall = Mesh { texture_coordinates: Some(wall_places(&surface, tube.grid)), ..wall };
    let extras = json!({"kind": "wall", "color_range_mm": ranges.side.map(round)});
    nodes.push(gltf.mesh_node(&wall, extras));
    let mut vectors = plain("vectors", Mode::Lines, VECTORS);
    for (from, to) in tube.medial().iter().zip(&tube.wall) {
        let first = id(vectors.positions.len());
        vectors.positions.extend([vertex(from), vertex(to)]);
        vectors.indices.extend([first, first + 1]);
    }
    nodes.push(gltf.mesh_node(&vectors, json!({"kind": "vectors"})));
    nodes
}

/// The centreline from tip to tip.
fn centreline_mesh(tube: &Tube) -> Mesh {
    let mut mesh = plain("centreline", Mode::Lines, CENTRELINE);
    let mut points = vec![tube.tips[0]];
    points.extend(&tube.centreline);
    points.push(tube.tips[1]);
    // Those of a cap are one.
    points.dedup();
    mesh.positions = points.iter().map(vertex).collect();
    for n in 1..id(points.len()) {
        mesh.indices.extend([n - 1, n]);
    }
    mesh
}

/// A mesh with the corners, normals and triangles of a surface.
fn shaped(mesh: Mesh, surface: &SurfaceMesh) -> Mesh {
    Mesh {
        positions: surface.mesh.positions.iter().map(vertex).collect(),
        normals: Some(surface.normals.iter().map(|normal| normal.map(single).into()).collect()),
        indices: surface.mesh.triangles.iter().flatten().copied().collect(),
        ..mesh
    }
}

/// The same with the colour of the thickness.
fn colored(mesh: Mesh, surface: &SurfaceMesh, thickness_mm: &[f64], range: Range) -> Mesh {
    let (mut colors, mut thickness) = (Vec::new(), Vec::new());
    for &node in &surface.nodes {
        colors.push(color(thickness_mm[node], range));
        thickness.push([single(thickness_mm[node])]);
    }
    Mesh { colors: Some(colors), thickness_mm: Some(thickness), ..shaped(mesh, surface) }
}

/// Where the corners of a sheet's surface lie in its lattice: (j, i), each from 0 to 1.
fn sheet_places(surface: &SurfaceMesh, LatticeSize { rows, cols }: LatticeSize) -> Vec<[f32; 2]> {
    let place = |node: &usize| [share(node % cols, cols - 1), share(node / cols, rows - 1)];
    surface.nodes.iter().map(place).collect()
}

/// The same of a wall, whose first row comes again at the end, once round.
fn wall_places(surface: &SurfaceMesh, LatticeSize { rows, cols }: LatticeSize) -> Vec<[f32; 2]> {
    (0..surface.nodes.len()).map(|corner| [share(corner % cols, cols - 1), share(corner / cols, rows)]).collect()
}

/// A number over what it is at the end.
fn share(n: usize, last: usize) -> f32 {
    single(n as f64 / last.max(1) as f64)
}

/// A line from every drawn medial node to each side.
fn vectors_mesh(sheet: &Sheet) -> Option<Mesh> {
    let mut mesh = plain("vectors", Mode::Lines, VECTORS);
    let drawable = sheet.drawable();
    for node in (0..drawable.len()).filter(|node| drawable[*node]) {
        let first = u32::try_from(mesh.positions.len()).ok()?;
        let ends = [&sheet.medial, &sheet.upper, &sheet.lower];
        mesh.positions.extend(ends.map(|points| vertex(&points[node])));
        mesh.indices.extend([first, first + 1, first, first + 2]);
    }
    (!mesh.positions.is_empty()).then_some(mesh)
}

/// A mesh of triangles that face outward. `None` when it has none or a corner is not finite.
fn solid_mesh(name: &'static str, solid: &TriangleMesh, material: Material) -> Option<Mesh> {
    let triangles: Vec<[usize; 3]> = solid.triangles.iter().map(|t| t.map(|n| n as usize)).collect();
    if triangles.is_empty() || !solid.positions.iter().all(|p| p.iter().all(|x| x.is_finite())) {
        return None;
    }
    let normals = normals(&solid.positions, &triangles, None);
    let mut mesh = plain(name, Mode::Triangles, material);
    mesh.positions = solid.positions.iter().map(vertex).collect();
    mesh.normals = Some(normals.iter().map(|normal| normal.map(single).into()).collect());
    mesh.indices = solid.triangles.iter().flatten().copied().collect();
    Some(mesh)
}

fn plain(name: &'static str, mode: Mode, material: Material) -> Mesh {
    Mesh {
        name,
        mode,
        positions: Vec::new(),
        normals: None,
        texture_coordinates: None,
        colors: None,
        thickness_mm: None,
        indices: Vec::new(),
        material,
    }
}

fn vertex(point: &WorldPoint) -> [f32; 3] {
    point.coords.map(single).into()
}

#[allow(clippy::cast_possible_truncation, reason = "glTF knows no doubles")]
fn single(x: f64) -> f32 {
    x as f32
}
