import { Vector3 } from "three";
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
  return parts.map(({ mesh, box }) => clustered(mesh, Math.min(cell, box.min.distanceTo(box.max) / FEWEST_CELLS)));
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

function clustered(mesh: GlbMesh, cell: number): GlbMesh {
  const { positions, normals, indices } = mesh;
  const count = positions.length / 3;
  const clusters = new Map<number, number>();
  const clusterOf = new Uint32Array(count);
  const members: number[] = [];
  const at = (vertex: number, axis: number) => Math.floor((positions[3 * vertex + axis] ?? 0) / cell) + 0x8000;
  for (let vertex = 0; vertex < count; vertex++) {
    const key = (at(vertex, 0) * 0x10000 + at(vertex, 1)) * 0x10000 + at(vertex, 2);
    const cluster = clusters.get(key) ?? clusters.size;
    clusters.set(key, cluster);
    clusterOf[vertex] = cluster;
    members[cluster] = (members[cluster] ?? 0) + 1;
  }
  const middles = new Float32Array(3 * clusters.size);
  const directions = new Float32Array(3 * clusters.size);
  for (let n = 0; n < 3 * count; n++) {
    const cluster = clusterOf[Math.floor(n / 3)] ?? 0;
    const to = 3 * cluster + (n % 3);
    middles[to] = (middles[to] ?? 0) + (positions[n] ?? 0) / (members[cluster] ?? 1);
    directions[to] = (directions[to] ?? 0) + (normals?.[n] ?? 0);
  }
  const kept = new Uint32Array(indices.length);
  let length = 0;
  for (let n = 0; n < indices.length; n += 3) {
    const [a, b, c] = [0, 1, 2].map((corner) => clusterOf[indices[n + corner] ?? 0] ?? 0) as [number, number, number];
    if (a === b || b === c || c === a) continue;
    kept.set([a, b, c], length);
    length += 3;
  }
  return { ...mesh, positions: middles, normals: directions, indices: kept.slice(0, length) };
}
