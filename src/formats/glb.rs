//! Model → `model.glb`. Positions are mm in world space; the root node alone turns them into
//! glTF's metres.

use std::io::{self, Write};

use serde_json::{Map, Value, json};

use super::colors::viridis_linear;
use super::gltf_build::{Gltf, Material, Mesh, Mode};
use super::mesh_parts::{crest_strip, outward_normals, quads};
use super::rounded::round;
use crate::model::closed;
use crate::model::{Figure, Model, Structure, TriangleMesh};
use crate::space::{WorldPoint, WorldVector};

const MEDIAL: Material = Material { name: "medial", color: [1.0, 1.0, 1.0, 1.0] };
const SIDE: Material = Material { name: "side", color: [1.0, 1.0, 1.0, 0.45] };
const CREST: Material = Material { name: "crest", color: [0.75, 0.75, 0.75, 0.45] };
const VECTORS: Material = Material { name: "vectors", color: [0.08, 0.08, 0.08, 1.0] };
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
    let figures: Vec<Usable> = structure.figures.iter().map(Usable::new).collect();
    // One scale for all figures of a structure, so that they can be compared.
    let side_range = range(figures.iter().flat_map(|f| f.side_mm.iter().flatten().zip(f.ok.iter().cycle())));
    let total_range = range(figures.iter().flat_map(|f| f.total_mm.iter().zip(&f.ok)));
    let mut children = Vec::new();
    for (number, figure) in figures.iter().enumerate() {
        let mut parts = figure.add_to(gltf, side_range, total_range);
        let closed = closed(figure.figure.into()).and_then(|mesh| solid_mesh("closed", &mesh, CLOSED));
        let extras = json!({"structure": index, "label": structure.label, "figure": number,
            "rows": figure.figure.grid.rows, "cols": figure.figure.grid.cols,
            "has_closed_surface": closed.is_some()});
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

fn range<'a>(values: impl Iterator<Item = (&'a f64, &'a bool)>) -> Range {
    let (low, high) = values
        .filter(|(_, ok)| **ok)
        .fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), (x, _)| (low.min(*x), high.max(*x)));
    if low <= high { [low, high] } else { [0.0, 0.0] }
}

fn color(value: f64, [low, high]: Range) -> [f32; 3] {
    let share = if high > low { (value - low) / (high - low) } else { 0.5 };
    viridis_linear(share).map(single)
}

/// A figure with the nodes that can be drawn: valid and finite.
struct Usable<'a> {
    figure: &'a Figure,
    ok: Vec<bool>,
    side_mm: [Vec<f64>; 2],
    total_mm: Vec<f64>,
}

impl<'a> Usable<'a> {
    fn new(figure: &'a Figure) -> Self {
        let finite = |point: &WorldPoint| point.iter().all(|x| x.is_finite());
        let surfaces = figure.medial.iter().zip(&figure.upper).zip(&figure.lower).zip(&figure.valid);
        let ok = surfaces.map(|(((m, u), l), valid)| *valid && finite(m) && finite(u) && finite(l)).collect();
        let side_mm = [figure.upper_vectors(), figure.lower_vectors()]
            .map(|vectors| vectors.iter().map(WorldVector::norm).collect::<Vec<f64>>());
        let total_mm = side_mm[0].iter().zip(&side_mm[1]).map(|(upper, lower)| upper + lower).collect();
        Self { figure, ok, side_mm, total_mm }
    }

    fn add_to(&self, gltf: &mut Gltf, side_range: Range, total_range: Range) -> Vec<usize> {
        let figure = self.figure;
        let [upper_mm, lower_mm] = &self.side_mm;
        let surfaces = [
            ("medial", &figure.medial, figure.upper_vectors(), &self.total_mm, total_range, MEDIAL),
            ("upper", &figure.upper, figure.upper_vectors(), upper_mm, side_range, SIDE),
            ("lower", &figure.lower, figure.lower_vectors(), lower_mm, side_range, SIDE),
        ];
        let mut nodes = Vec::new();
        for (name, points, outward, thickness_mm, range, material) in surfaces {
            let surface = Surface { name, points, outward: &outward, thickness_mm, range, material };
            if let Some(mesh) = self.surface_mesh(&surface) {
                nodes.push(gltf.mesh_node(&mesh, json!({"kind": name, "color_range_mm": range.map(round)})));
            }
        }
        if let Some(mesh) = self.crest_mesh() {
            nodes.push(gltf.mesh_node(&mesh, json!({"kind": "crest"})));
        }
        if let Some(mesh) = self.vectors_mesh() {
            nodes.push(gltf.mesh_node(&mesh, json!({"kind": "vectors"})));
        }
        nodes
    }

    /// Quads as two triangles; nodes of no quad are left out.
    fn surface_mesh(&self, surface: &Surface) -> Option<Mesh> {
        let grid = self.figure.grid;
        let triangles = quads(grid, &self.ok);
        let (triangles, normals) = outward_normals(surface.points, triangles, surface.outward)?;
        let mut used = vec![None; surface.points.len()];
        let mut mesh = Mesh {
            name: surface.name,
            mode: Mode::Triangles,
            positions: Vec::new(),
            normals: Some(Vec::new()),
            texture_coordinates: Some(Vec::new()),
            colors: Some(Vec::new()),
            thickness_mm: Some(Vec::new()),
            indices: Vec::new(),
            material: surface.material,
        };
        for node in triangles.iter().flatten() {
            used[*node] = Some(0_u32);
        }
        let share = |n: usize, count: usize| single(n as f64 / (count - 1).max(1) as f64);
        for (node, slot) in used.iter_mut().enumerate().filter(|(_, slot)| slot.is_some()) {
            *slot = u32::try_from(mesh.positions.len()).ok();
            let thickness = surface.thickness_mm[node];
            mesh.positions.push(vertex(&surface.points[node]));
            mesh.normals.as_mut()?.push(normals[node].map(single).into());
            mesh.texture_coordinates
                .as_mut()?
                .push([share(node % grid.cols, grid.cols), share(node / grid.cols, grid.rows)]);
            mesh.colors.as_mut()?.push(color(thickness, surface.range));
            mesh.thickness_mm.as_mut()?.push([single(thickness)]);
        }
        mesh.indices = triangles.iter().flatten().filter_map(|node| used[*node]).collect();
        Some(mesh)
    }

    fn crest_mesh(&self) -> Option<Mesh> {
        let (points, triangles) = crest_strip(self.figure, &self.ok)?;
        let outward: Vec<WorldVector> = points.iter().map(|(point, inner)| point - inner).collect();
        let points: Vec<WorldPoint> = points.into_iter().map(|(point, _)| point).collect();
        let (triangles, normals) = outward_normals(&points, triangles, &outward)?;
        let mut slots = vec![None; points.len()];
        let mut mesh = plain("crest", Mode::Triangles, CREST);
        let mut unit = Vec::new();
        for node in triangles.iter().flatten() {
            if slots[*node].is_none() {
                slots[*node] = u32::try_from(mesh.positions.len()).ok();
                mesh.positions.push(vertex(&points[*node]));
                unit.push(normals[*node].map(single).into());
            }
            mesh.indices.extend(slots[*node]);
        }
        mesh.normals = Some(unit);
        Some(mesh)
    }

    /// A line from every drawn medial node to each side.
    fn vectors_mesh(&self) -> Option<Mesh> {
        let mut mesh = plain("vectors", Mode::Lines, VECTORS);
        let figure = self.figure;
        for node in (0..self.ok.len()).filter(|node| self.ok[*node]) {
            let first = u32::try_from(mesh.positions.len()).ok()?;
            let ends = [&figure.medial, &figure.upper, &figure.lower];
            mesh.positions.extend(ends.map(|points| vertex(&points[node])));
            mesh.indices.extend([first, first + 1, first, first + 2]);
        }
        (!mesh.positions.is_empty()).then_some(mesh)
    }
}

struct Surface<'a> {
    name: &'static str,
    points: &'a [WorldPoint],
    outward: &'a [WorldVector],
    thickness_mm: &'a [f64],
    range: Range,
    material: Material,
}

/// A mesh of triangles that face outward. `None` when it has none or a corner is not finite.
fn solid_mesh(name: &'static str, solid: &TriangleMesh, material: Material) -> Option<Mesh> {
    let triangles: Vec<[usize; 3]> = solid.triangles.iter().map(|t| t.map(|n| n as usize)).collect();
    if triangles.is_empty() || !solid.positions.iter().all(|p| p.iter().all(|x| x.is_finite())) {
        return None;
    }
    let normals = super::mesh_parts::normals(&solid.positions, &triangles, None);
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
