import { Box3, BufferAttribute, BufferGeometry, DynamicDrawUsage } from "three";
import type { GlbMesh } from "../model/glb";

/** Where one mesh of the file lies in the arrays of a merged one. */
export interface Part {
  mesh: GlbMesh;
  firstVertex: number;
  firstIndex: number;
  box: Box3;
}

/** Many meshes drawn by one call. Hiding some means leaving their corners out of the index. */
export class Merged {
  readonly geometry = new BufferGeometry();
  readonly parts: Part[] = [];
  /** Red, green, blue, opacity per vertex, 0 to 255. */
  readonly colors: BufferAttribute;
  #all: Uint32Array;
  #index: BufferAttribute;

  constructor(meshes: readonly GlbMesh[]) {
    const vertices = meshes.reduce((sum, mesh) => sum + mesh.positions.length / 3, 0);
    const corners = meshes.reduce((sum, mesh) => sum + mesh.indices.length, 0);
    const positions = new Float32Array(3 * vertices);
    const normals = new Float32Array(3 * vertices);
    this.#all = new Uint32Array(corners);
    let [firstVertex, firstIndex] = [0, 0];
    for (const mesh of meshes) {
      positions.set(mesh.positions, 3 * firstVertex);
      if (mesh.normals) normals.set(mesh.normals, 3 * firstVertex);
      for (let n = 0; n < mesh.indices.length; n++) this.#all[firstIndex + n] = (mesh.indices[n] ?? 0) + firstVertex;
      const box = new Box3().setFromArray(mesh.positions);
      this.parts.push({ mesh, firstVertex, firstIndex, box });
      firstVertex += mesh.positions.length / 3;
      firstIndex += mesh.indices.length;
    }
    this.colors = new BufferAttribute(new Uint8Array(4 * vertices), 4, true);
    this.#index = new BufferAttribute(this.#all.slice(), 1).setUsage(DynamicDrawUsage);
    this.geometry.setAttribute("position", new BufferAttribute(positions, 3));
    this.geometry.setAttribute("normal", new BufferAttribute(normals, 3));
    this.geometry.setIndex(this.#index);
  }

  /** Gives every vertex a colour; without this the vertices have none. */
  enableColors(): void {
    this.geometry.setAttribute("color", this.colors);
  }

  /** The corners that are drawn, in the order of drawing. */
  get index(): BufferAttribute {
    return this.#index;
  }

  /** How many corners are drawn. */
  get count(): number {
    return this.geometry.drawRange.count === Number.POSITIVE_INFINITY
      ? this.#all.length
      : this.geometry.drawRange.count;
  }

  show(shown: (part: Part) => boolean): void {
    let count = 0;
    for (const part of this.parts.filter(shown)) {
      const { firstIndex, mesh } = part;
      this.#index.array.set(this.#all.subarray(firstIndex, firstIndex + mesh.indices.length), count);
      count += mesh.indices.length;
    }
    this.#index.needsUpdate = true;
    this.geometry.setDrawRange(0, count);
  }

  dispose(): void {
    this.geometry.dispose();
  }
}
