/** Just enough of binary glTF to make a model.glb, as the program does. */

import type { Point } from "../../src/model/thickness";

export interface MadeMesh {
  kind: string;
  positions: Point[];
  /** Corners of triangles, or of lines where `isLines`. */
  indices: number[];
  isLines?: boolean;
  normals?: Point[];
  /** (j, i), each as a share. */
  places?: [number, number][];
  thickness_mm?: number[];
}

export interface MadeNode {
  extras: object;
  matrix?: number[];
  children?: (MadeNode | MadeMesh)[];
}

/** World mm to metres, Y up: see `GLTF_FROM_WORLD` of the program. */
export const GLTF_FROM_WORLD = [-0.001, 0, 0, 0, 0, 0, 0.001, 0, 0, 0.001, 0, 0, 0, 0, 0, 1];

const [ARRAY_BUFFER, ELEMENT_ARRAY_BUFFER] = [34_962, 34_963];
const [UNSIGNED_INT, FLOAT] = [5125, 5126];
const TYPES = ["SCALAR", "VEC2", "VEC3"];

export function glbOf(root: MadeNode): ArrayBuffer {
  return new Writer().write(root);
}

class Writer {
  #chunks: Uint8Array[] = [];
  #length = 0;
  #views: object[] = [];
  #accessors: object[] = [];
  #meshes: object[] = [];
  #nodes: object[] = [];

  write(root: MadeNode): ArrayBuffer {
    const top = this.#node(root);
    const json = JSON.stringify({
      asset: { version: "2.0" },
      scene: 0,
      scenes: [{ nodes: [top] }],
      nodes: this.#nodes,
      meshes: this.#meshes,
      accessors: this.#accessors,
      bufferViews: this.#views,
      buffers: [{ byteLength: this.#length }],
    });
    const text = new TextEncoder().encode(json.padEnd(Math.ceil(json.length / 4) * 4));
    const file = new Uint8Array(12 + 8 + text.length + 8 + this.#length);
    const words = new DataView(file.buffer);
    // "glTF", "JSON" and "BIN\0".
    for (const [at, word] of [0x46546c67, 2, file.length, text.length, 0x4e4f534a].entries()) {
      words.setUint32(4 * at, word, true);
    }
    file.set(text, 20);
    words.setUint32(20 + text.length, this.#length, true);
    words.setUint32(24 + text.length, 0x004e4942, true);
    let at = 28 + text.length;
    for (const chunk of this.#chunks) {
      file.set(chunk, at);
      at += chunk.length;
    }
    return file.buffer;
  }

  #node({ extras, matrix, children = [] }: MadeNode): number {
    const numbers = children.map((child) => ("kind" in child ? this.#mesh(child) : this.#node(child)));
    return this.#nodes.push({ extras, ...(matrix && { matrix }), children: numbers }) - 1;
  }

  #mesh({ kind, positions, indices, isLines, normals, places, thickness_mm }: MadeMesh): number {
    const attributes = {
      POSITION: this.#floats(positions, true),
      ...(normals && { NORMAL: this.#floats(normals) }),
      ...(places && { TEXCOORD_0: this.#floats(places) }),
      ...(thickness_mm && { _THICKNESS: this.#floats(thickness_mm.map((mm) => [mm])) }),
    };
    const corners = this.#accessor(Uint32Array.from(indices), ELEMENT_ARRAY_BUFFER, {
      componentType: UNSIGNED_INT,
      count: indices.length,
      type: "SCALAR",
    });
    const mesh = this.#meshes.push({ primitives: [{ attributes, indices: corners, mode: isLines ? 1 : 4 }] }) - 1;
    return this.#nodes.push({ mesh, extras: { kind } }) - 1;
  }

  #floats(values: readonly number[][], hasBounds = false): number {
    const type = TYPES[(values[0]?.length ?? 1) - 1];
    const axes = (values[0] ?? []).map((_, axis) => values.map((value) => Math.fround(value[axis] ?? 0)));
    const bounds = hasBounds && {
      min: axes.map((all) => Math.min(...all)),
      max: axes.map((all) => Math.max(...all)),
    };
    return this.#accessor(Float32Array.from(values.flat()), ARRAY_BUFFER, {
      componentType: FLOAT,
      count: values.length,
      type,
      ...bounds,
    });
  }

  #accessor(array: Uint32Array | Float32Array, target: number, what: object): number {
    const bytes = new Uint8Array(array.buffer);
    const view = { buffer: 0, byteOffset: this.#length, byteLength: bytes.length, target };
    this.#chunks.push(bytes);
    this.#length += bytes.length;
    return this.#accessors.push({ bufferView: this.#views.push(view) - 1, ...what }) - 1;
  }
}
