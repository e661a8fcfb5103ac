import { type Box3, Vector3 } from "three";
import type { GlbMesh } from "../model/glb";
import type { Part } from "./merged";

/** Cells along the diagonal of a mesh that keep its shape recognisable, however small it is. */
const FEWEST_CELLS = 14;

/**
 * The meshes with about `triangles` triangles in all: vertices in one cell of a cubic grid become one.
 * Rough, but quick to make, and to be seen only while the model turns.
 */
export function coarse(parts: readonly Part[], triangles: number): GlbMesh[] {
  const area = parts.reduce((sum, { mesh }) => sum + areaOf(mesh), 0);
  // A surface meets about 1.5 cells per area of a cell, and each gives one vertex, that is two triangles.
  const cell = Math.sqrt((3 * area) / triangles);
  return parts.map((part) => clustered(part, Math.min(cell, part.box.min.distanceTo(part.box.max) / FEWEST_CELLS)));
}

function areaOf({ positions, indices }: GlbMesh): number {
  const [a, b, c] = [new Vector3(), new Vector3(), new Vector3()];
  let twice = 0;
  for (let n = 0; n < indices.length; n += 3) {
    a.fromArray(positions, 3 * (indices[n] ?? 0));
    b.fromArray(positions, 3 * (indices[n + 1] ?? 0)).sub(a);
    c.fromArray(positions, 3 * (indices[n + 2] ?? 0)).sub(a);
    twice += b.cross(c).length();
  }
  return twice / 2;
}

function clustered({ mesh, box }: Part, cell: number): GlbMesh {
  const { positions, normals, indices } = mesh;
  const [clusterOf, clusters] = clustersOf(positions, box, cell);
  const middles = new Float32Array(3 * clusters);
  const directions = new Float32Array(3 * clusters);
  const members = new Uint32Array(clusters);
  for (let vertex = 0; vertex < clusterOf.length; vertex++) {
    const cluster = clusterOf[vertex] ?? 0;
    members[cluster] = (members[cluster] ?? 0) + 1;
    for (let axis = 0; axis < 3; axis++) {
      const to = 3 * cluster + axis;
      middles[to] = (middles[to] ?? 0) + (positions[3 * vertex + axis] ?? 0);
      directions[to] = (directions[to] ?? 0) + (normals?.[3 * vertex + axis] ?? 0);
    }
  }
  for (let n = 0; n < middles.length; n++) middles[n] = (middles[n] ?? 0) / (members[Math.floor(n / 3)] ?? 1);
  return { ...mesh, positions: middles, normals: directions, indices: keptTriangles(indices, clusterOf) };
}

/** The number of the cluster of each vertex, and how many clusters there are. */
function clustersOf(positions: Float32Array, { min, max }: Box3, cell: number): [Uint32Array, number] {
  const [columns, rows, layers] = [max.x - min.x, max.y - min.y, max.z - min.z].map((x) => Math.floor(x / cell) + 1);
  const numbers = new Int32Array((columns ?? 1) * (rows ?? 1) * (layers ?? 1)).fill(-1);
  const clusterOf = new Uint32Array(positions.length / 3);
  let clusters = 0;
  for (let vertex = 0; vertex < clusterOf.length; vertex++) {
    const x = Math.floor(((positions[3 * vertex] ?? 0) - min.x) / cell);
    const y = Math.floor(((positions[3 * vertex + 1] ?? 0) - min.y) / cell);
    const z = Math.floor(((positions[3 * vertex + 2] ?? 0) - min.z) / cell);
    const place = (z * (rows ?? 1) + y) * (columns ?? 1) + x;
    if ((numbers[place] ?? -1) < 0) numbers[place] = clusters++;
    clusterOf[vertex] = numbers[place] ?? 0;
  }
  return [clusterOf, clusters];
}

/** Without the triangles that have shrunk to a line or a point. */
function keptTriangles(indices: Uint32Array, clusterOf: Uint32Array): Uint32Array {
  const kept = new Uint32Array(indices.length);
  let length = 0;
  for (let n = 0; n < indices.length; n += 3) {
    const a = clusterOf[indices[n] ?? 0] ?? 0;
    const b = clusterOf[indices[n + 1] ?? 0] ?? 0;
    const c = clusterOf[indices[n + 2] ?? 0] ?? 0;
    if (a === b || b === c || c === a) continue;
    kept[length++] = a;
    kept[length++] = b;
    kept[length++] = c;
  }
  return kept.slice(0, length);
}
