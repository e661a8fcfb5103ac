import { type BufferGeometry, LineSegments, Mesh, type Object3D } from "three";
import { GLTFLoader } from "three/addons/loaders/GLTFLoader.js";
import { type GlbFigure, type GlbMesh, type GlbModel, type GlbStructure, LAYERS } from "../model/glb";
import type { Point } from "../model/thickness";

/** Reads a model.glb of this program. Rejects anything else with a sentence for people. */
export async function readGlb(file: ArrayBuffer): Promise<GlbModel> {
  const { scene } = await new GLTFLoader().parseAsync(file, "").catch((error: unknown) => {
    throw new Error("This is no whole GLB file.", { cause: error });
  });
  const root = scene.children[0];
  if (root === undefined) throw new Error("The GLB file has no scene.");
  root.updateMatrix();
  const { elements } = root.matrix;
  // A rotation and a scale: its rows are the directions that become Y and Z.
  const row = (n: number): Point => unit([elements[n] ?? 0, elements[n + 4] ?? 0, elements[n + 8] ?? 0]);
  const model: GlbModel = {
    structures: [],
    meshes: [],
    space: root.userData.space === "RAS" ? "RAS" : null,
    up: row(1),
    front: row(2),
  };
  for (const node of root.children) addStructure(model, node);
  return model;
}

function addStructure(model: GlbModel, node: Object3D): void {
  const { structure: index, label, refusal = null } = node.userData;
  if (typeof index !== "number") return;
  const structure: GlbStructure = { index, label, refusal, figures: [] };
  model.structures.push(structure);
  for (const child of node.children) {
    const { figure: number, rows, cols, kind } = child.userData;
    if (typeof number !== "number") {
      addMesh(model, child, index, null);
      continue;
    }
    const figure: GlbFigure = { kind: kind === "tube" ? "tube" : "sheet", index: number, rows, cols };
    structure.figures.push(figure);
    for (const mesh of child.children) addMesh(model, mesh, index, figure);
  }
}

function addMesh(model: GlbModel, object: Object3D, structure: number, figure: GlbFigure | null): void {
  const layer = LAYERS.find((name) => name === object.userData.kind);
  if (layer === undefined || !(object instanceof Mesh || object instanceof LineSegments)) return;
  const { geometry } = object;
  const positions = numbersOf(geometry, "position");
  if (positions === null || geometry.index === null) return;
  const places = numbersOf(geometry, "uv");
  model.meshes.push({
    layer,
    structure,
    figure: figure?.index ?? null,
    positions,
    normals: numbersOf(geometry, "normal"),
    indices: new Uint32Array(geometry.index.array),
    nodes: places && figure ? nodesOf(places, figure) : null,
    thickness_mm: numbersOf(geometry, "_thickness"),
  } satisfies GlbMesh);
}

function numbersOf(geometry: BufferGeometry, name: string): Float32Array | null {
  const array = geometry.getAttribute(name)?.array;
  return array instanceof Float32Array ? array : null;
}

/** The texture coordinates are (j, i), each as a share of its last value; round a tube, row 0 comes again as the last. */
function nodesOf(places: Float32Array, { kind, rows, cols }: GlbFigure): Uint32Array {
  const last = kind === "tube" ? rows : rows - 1;
  const nodes = new Uint32Array(places.length / 2);
  for (let vertex = 0; vertex < nodes.length; vertex++) {
    const j = Math.round((places[2 * vertex] ?? 0) * Math.max(1, cols - 1));
    const i = Math.round((places[2 * vertex + 1] ?? 0) * Math.max(1, last));
    nodes[vertex] = (i % rows) * cols + j;
  }
  return nodes;
}

function unit([x, y, z]: Point): Point {
  const length = Math.hypot(x, y, z) || 1;
  return [x / length, y / length, z / length];
}
