import type { Point } from "./thickness";

/** What of model.glb is drawn, by the `kind` of its meshes. */
export const LAYERS = ["object", "medial", "upper", "lower", "crest", "vectors", "closed"] as const;
export type Layer = (typeof LAYERS)[number];

export interface GlbModel {
  structures: GlbStructure[];
  meshes: GlbMesh[];
  /** The axes of the positions: x right, y anterior, z superior; null if the file does not say so. */
  space: "RAS" | null;
  /** Directions in the space of the positions that the file shows upward and towards the viewer. */
  up: Point;
  front: Point;
}

export interface GlbStructure {
  index: number;
  label: number;
  refusal: string | null;
  figures: GlbFigure[];
}

export interface GlbFigure {
  index: number;
  rows: number;
  cols: number;
}

/** Positions are mm. */
export interface GlbMesh {
  layer: Layer;
  structure: number;
  /** Null for the object, which belongs to the structure. */
  figure: number | null;
  positions: Float32Array;
  normals: Float32Array | null;
  /** Corners of triangles, of `vectors` ends of lines. */
  indices: Uint32Array;
  /** Node of each vertex, row by row; only of medial, upper and lower. */
  nodes: Uint32Array | null;
  thickness_mm: Float32Array | null;
}

interface Gltf {
  scene?: number;
  scenes?: { nodes?: number[] }[];
  nodes?: GltfNode[];
  meshes?: { name?: string; primitives: { attributes: Record<string, number>; indices?: number }[] }[];
  accessors?: { bufferView?: number; byteOffset?: number; componentType: number; count: number; type: string }[];
  bufferViews?: { byteOffset?: number; byteStride?: number }[];
  extensionsRequired?: string[];
}

interface GltfNode {
  mesh?: number;
  matrix?: number[];
  children?: number[];
  extras?: Record<string, unknown>;
}

interface Owner {
  structure: GlbStructure | null;
  figure: GlbFigure | null;
}

const MAGIC = 0x46546c67;
const FLOAT = 5126;
const UNSIGNED_INT = 5125;
const UNSIGNED_SHORT = 5123;
const WIDTH: Readonly<Record<string, number>> = { SCALAR: 1, VEC2: 2, VEC3: 3, VEC4: 4 };

/** Reads a model.glb of this program. Throws an Error with a sentence for people. */
export function parseGlb(file: ArrayBuffer): GlbModel {
  const view = new DataView(file);
  if (file.byteLength < 20 || view.getUint32(0, true) !== MAGIC) throw new Error("The file is not a GLB file.");
  const length = view.getUint32(12, true);
  if (20 + length > file.byteLength) throw new Error("The GLB file ends too early.");
  const gltf = JSON.parse(new TextDecoder().decode(new Uint8Array(file, 20, length))) as Gltf;
  if (gltf.extensionsRequired?.length) {
    throw new Error(`The GLB file needs ${gltf.extensionsRequired.join(", ")}, which this viewer cannot read.`);
  }
  return new Reader(gltf, file, 20 + length + 8).model();
}

class Reader {
  #gltf: Gltf;
  #file: ArrayBuffer;
  /** Where the numbers begin. */
  #start: number;
  #structures: GlbStructure[] = [];
  #meshes: GlbMesh[] = [];

  constructor(gltf: Gltf, file: ArrayBuffer, start: number) {
    this.#gltf = gltf;
    this.#file = file;
    this.#start = start;
  }

  model(): GlbModel {
    const root = this.#gltf.scenes?.[this.#gltf.scene ?? 0]?.nodes?.[0];
    if (root === undefined) throw new Error("The GLB file has no scene.");
    this.#visit(root, { structure: null, figure: null });
    const { matrix, extras } = this.#node(root);
    // The matrix is a rotation and a scale: its rows are the directions that become Y and Z.
    const row = (n: number): Point => [matrix?.[n] ?? 0, matrix?.[n + 4] ?? 0, matrix?.[n + 8] ?? 0];
    return {
      structures: this.#structures,
      meshes: this.#meshes,
      space: extras?.space === "RAS" ? "RAS" : null,
      up: matrix ? unit(row(1)) : [0, 1, 0],
      front: matrix ? unit(row(2)) : [0, 0, 1],
    };
  }

  #node(index: number): GltfNode {
    const node = this.#gltf.nodes?.[index];
    if (!node) throw new Error("The GLB file refers to a node it does not have.");
    return node;
  }

  #visit(index: number, owner: Owner): void {
    const node = this.#node(index);
    const extras = node.extras ?? {};
    const own = { ...owner };
    if (typeof extras.figure === "number" && own.structure) {
      own.figure = { index: extras.figure, rows: Number(extras.rows), cols: Number(extras.cols) };
      own.structure.figures.push(own.figure);
    } else if (typeof extras.structure === "number") {
      const refusal = typeof extras.refusal === "string" ? extras.refusal : null;
      own.structure = { index: extras.structure, label: Number(extras.label), refusal, figures: [] };
      this.#structures.push(own.structure);
    }
    if (node.mesh !== undefined) this.#addMesh(node.mesh, extras.kind, own);
    for (const child of node.children ?? []) this.#visit(child, own);
  }

  #addMesh(index: number, kind: unknown, { structure, figure }: Owner): void {
    const layer = LAYERS.find((name) => name === kind);
    const primitive = this.#gltf.meshes?.[index]?.primitives[0];
    if (!layer || !structure || !primitive) return;
    const { attributes } = primitive;
    const positions = this.#floats(attributes.POSITION, 3);
    const indices = this.#indices(primitive.indices);
    if (!positions || !indices) return;
    const places = this.#floats(attributes.TEXCOORD_0, 2);
    this.#meshes.push({
      layer,
      structure: structure.index,
      figure: figure?.index ?? null,
      positions,
      normals: this.#floats(attributes.NORMAL, 3),
      indices,
      nodes: places && figure ? nodesOf(places, figure) : null,
      thickness_mm: this.#floats(attributes._THICKNESS, 1),
    });
  }

  #floats(index: number | undefined, width: number): Float32Array | null {
    if (index === undefined) return null;
    const [offset, length] = this.#place(index, FLOAT, width, 4);
    return new Float32Array(this.#file, offset, length);
  }

  #indices(index: number | undefined): Uint32Array | null {
    if (index === undefined) return null;
    if (this.#gltf.accessors?.[index]?.componentType === UNSIGNED_SHORT) {
      const [offset, length] = this.#place(index, UNSIGNED_SHORT, 1, 2);
      return Uint32Array.from(new Uint16Array(this.#file, offset, length));
    }
    const [offset, length] = this.#place(index, UNSIGNED_INT, 1, 4);
    return new Uint32Array(this.#file, offset, length);
  }

  /** Where in the file the numbers of an accessor are, and how many. */
  #place(index: number, type: number, width: number, bytes: number): [number, number] {
    const accessor = this.#gltf.accessors?.[index];
    const view = this.#gltf.bufferViews?.[accessor?.bufferView ?? -1];
    if (!accessor || !view || accessor.componentType !== type || WIDTH[accessor.type] !== width) {
      throw new Error("The GLB file holds numbers of a kind this viewer cannot read.");
    }
    const stride = view.byteStride ?? width * bytes;
    const offset = this.#start + (view.byteOffset ?? 0) + (accessor.byteOffset ?? 0);
    const length = accessor.count * width;
    if (stride !== width * bytes || offset % bytes !== 0) {
      throw new Error("The GLB file holds numbers in an order this viewer cannot read.");
    }
    if (offset + length * bytes > this.#file.byteLength) throw new Error("The GLB file ends too early.");
    return [offset, length];
  }
}

/** The texture coordinates are (j, i), each as a share of its last value. */
function nodesOf(places: Float32Array, { rows, cols }: GlbFigure): Uint32Array {
  const nodes = new Uint32Array(places.length / 2);
  for (let vertex = 0; vertex < nodes.length; vertex++) {
    const j = Math.round((places[2 * vertex] ?? 0) * Math.max(1, cols - 1));
    const i = Math.round((places[2 * vertex + 1] ?? 0) * Math.max(1, rows - 1));
    nodes[vertex] = i * cols + j;
  }
  return nodes;
}

function unit([x, y, z]: Point): Point {
  const length = Math.hypot(x, y, z) || 1;
  return [x / length, y / length, z / length];
}
