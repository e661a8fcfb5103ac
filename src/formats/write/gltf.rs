//! Just enough of binary glTF 2.0: accessors in one buffer, meshes, materials, a tree of nodes.

use std::io::{self, Write};

use serde_json::{Map, Value, json};

const ARRAY_BUFFER: u32 = 34_962;
const ELEMENT_ARRAY_BUFFER: u32 = 34_963;
const UNSIGNED_INT: u32 = 5125;
const FLOAT: u32 = 5126;

/// How vertices are joined.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Mode {
    Lines,
    Triangles,
}

/// A mesh of one primitive. Every attribute has one entry per position.
#[derive(Clone, Debug)]
pub(super) struct Mesh {
    pub name: &'static str,
    pub mode: Mode,
    pub positions: Vec<[f32; 3]>,
    pub normals: Option<Vec<[f32; 3]>>,
    pub texture_coordinates: Option<Vec<[f32; 2]>>,
    pub colors: Option<Vec<[f32; 3]>>,
    pub thickness_mm: Option<Vec<[f32; 1]>>,
    pub indices: Vec<u32>,
    pub material: Material,
}

/// How a mesh looks. All are double-sided: sheets are open.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Material {
    pub name: &'static str,
    /// Linear, with alpha; below 1 it is blended.
    pub color: [f64; 4],
}

/// A document under construction. Indices are handed out in the order of the calls.
#[derive(Default)]
pub(super) struct Gltf {
    bytes: Vec<u8>,
    views: Vec<Value>,
    accessors: Vec<Value>,
    meshes: Vec<Value>,
    material_names: Vec<&'static str>,
    materials: Vec<Value>,
    nodes: Vec<Value>,
}

impl Gltf {
    /// Adds a node; its children must be there already.
    pub fn node(&mut self, mut fields: Map<String, Value>, children: &[usize]) -> usize {
        if !children.is_empty() {
            fields.insert("children".to_owned(), json!(children));
        }
        self.nodes.push(Value::Object(fields));
        self.nodes.len() - 1
    }

    /// Adds a mesh and the node that shows it, with `extras`.
    pub fn mesh_node(&mut self, mesh: &Mesh, extras: Value) -> usize {
        let mut attributes = Map::new();
        attributes.insert("POSITION".to_owned(), json!(self.floats(&mesh.positions, true)));
        if let Some(normals) = &mesh.normals {
            attributes.insert("NORMAL".to_owned(), json!(self.floats(normals, false)));
        }
        if let Some(coordinates) = &mesh.texture_coordinates {
            attributes.insert("TEXCOORD_0".to_owned(), json!(self.floats(coordinates, false)));
        }
        if let Some(colors) = &mesh.colors {
            attributes.insert("COLOR_0".to_owned(), json!(self.floats(colors, false)));
        }
        if let Some(thickness) = &mesh.thickness_mm {
            attributes.insert("_THICKNESS".to_owned(), json!(self.floats(thickness, true)));
        }
        let primitive = json!({
            "attributes": attributes,
            "indices": self.indices(&mesh.indices),
            "material": self.material(mesh.material),
            "mode": match mesh.mode { Mode::Lines => 1, Mode::Triangles => 4 },
        });
        self.meshes.push(json!({"name": mesh.name, "primitives": [primitive]}));
        let fields = json!({"name": mesh.name, "mesh": self.meshes.len() - 1, "extras": extras});
        let Value::Object(fields) = fields else { unreachable!("json! of braces is an object") };
        self.node(fields, &[])
    }

    fn material(&mut self, material: Material) -> usize {
        if let Some(known) = self.material_names.iter().position(|name| *name == material.name) {
            return known;
        }
        let mut fields = json!({
            "name": material.name,
            "doubleSided": true,
            "pbrMetallicRoughness": {
                "baseColorFactor": material.color, "metallicFactor": 0.0, "roughnessFactor": 0.7
            },
        });
        if material.color[3] < 1.0 {
            fields["alphaMode"] = json!("BLEND");
        }
        self.material_names.push(material.name);
        self.materials.push(fields);
        self.materials.len() - 1
    }

    /// An accessor of floats with `N` components; `bounds` writes min and max.
    fn floats<const N: usize>(&mut self, values: &[[f32; N]], bounds: bool) -> usize {
        let view = self.view(values.as_flattened().iter().map(|x| x.to_le_bytes()), ARRAY_BUFFER);
        let shape = ["SCALAR", "VEC2", "VEC3", "VEC4"][N - 1];
        let mut accessor = json!({"bufferView": view, "componentType": FLOAT, "count": values.len(), "type": shape});
        if bounds {
            let (mut low, mut high) = ([f32::INFINITY; N], [f32::NEG_INFINITY; N]);
            for value in values {
                for n in 0..N {
                    low[n] = low[n].min(value[n]);
                    high[n] = high[n].max(value[n]);
                }
            }
            // As f64 the very value of the f32 is written.
            accessor["min"] = low.map(f64::from).to_vec().into();
            accessor["max"] = high.map(f64::from).to_vec().into();
        }
        self.accessors.push(accessor);
        self.accessors.len() - 1
    }

    fn indices(&mut self, values: &[u32]) -> usize {
        let view = self.view(values.iter().map(|x| x.to_le_bytes()), ELEMENT_ARRAY_BUFFER);
        let accessor =
            json!({"bufferView": view, "componentType": UNSIGNED_INT, "count": values.len(), "type": "SCALAR"});
        self.accessors.push(accessor);
        self.accessors.len() - 1
    }

    /// Everything is made of four-byte numbers, so every view is aligned.
    fn view(&mut self, words: impl Iterator<Item = [u8; 4]>, target: u32) -> usize {
        let start = self.bytes.len();
        self.bytes.extend(words.flatten());
        let length = self.bytes.len() - start;
        self.views.push(json!({"buffer": 0, "byteOffset": start, "byteLength": length, "target": target}));
        self.views.len() - 1
    }

    /// Writes the document with one scene that shows `root`.
    ///
    /// # Errors
    /// When writing fails or the file would exceed the 4 GiB of the format.
    pub fn write(self, root: usize, mut out: impl Write) -> io::Result<()> {
        let mut document = json!({
            "asset": {"version": "2.0", "generator": concat!("medialrep ", env!("CARGO_PKG_VERSION"))},
            "scene": 0,
            "scenes": [{"nodes": [root]}],
            "nodes": self.nodes,
        });
        let lists = [
            ("meshes", self.meshes),
            ("materials", self.materials),
            ("accessors", self.accessors),
            ("bufferViews", self.views),
        ];
        for (name, list) in lists {
            // Empty lists are not allowed.
            if !list.is_empty() {
                document[name] = list.into();
            }
        }
        if !self.bytes.is_empty() {
            document["buffers"] = json!([{"byteLength": self.bytes.len()}]);
        }
        let mut text = serde_json::to_vec(&document)?;
        text.resize(text.len().next_multiple_of(4), b' ');
        let binary_chunk = if self.bytes.is_empty() { 0 } else { 8 + self.bytes.len() };
        out.write_all(b"glTF")?;
        out.write_all(&2_u32.to_le_bytes())?;
        out.write_all(&length_field(12 + 8 + text.len() + binary_chunk)?)?;
        out.write_all(&length_field(text.len())?)?;
        out.write_all(b"JSON")?;
        out.write_all(&text)?;
        if !self.bytes.is_empty() {
            out.write_all(&length_field(self.bytes.len())?)?;
            out.write_all(b"BIN\0")?;
            out.write_all(&self.bytes)?;
        }
        Ok(())
    }
}

fn length_field(bytes: usize) -> io::Result<[u8; 4]> {
    let too_large = |_| io::Error::new(io::ErrorKind::FileTooLarge, "glTF binary files end at 4 GiB");
    u32::try_from(bytes).map(u32::to_le_bytes).map_err(too_large)
}
